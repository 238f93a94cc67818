//! The daemon's settings. The command line overrides the configuration file, which overrides the defaults.

use std::fs::File;
use std::io::{self, Read};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::Duration;

use nix::fcntl::OFlag;
use nix::unistd::geteuid;
use serde::Deserialize;

use super::board_settings::CheckedSettings;
use super::checks::{
    functions, groups, limited, period_ns, readings, segment_mode, shared_functions, socket_mode,
    something_to_do,
};
use super::family::{self, FamilyKnown, Recognised};
use super::mirrored::{BackgroundTable, ServoTable};
use super::motors::{self, MotorNames, MotorTable};
use super::ports::{HostPortConfig, HostPortTable, MailboxConfig, MailboxTable};
use super::span::{Refusal, position};
use super::user::{self, UserArea, UserTable};
use crate::daemon::options::Options;
use crate::daemon::socket::policy::{Characters, Roles};
use crate::device::board::spec::SpecError;
use crate::device::{Access, BoardSpec};
use crate::format::{TextOrder, WordOrder};
use crate::function::servo::ServoReading;
use crate::map::{BufferSettings, Family};
use crate::protocol::{BoardSettings, Function, Functions, VariablesSettings};
use crate::rotary;
use crate::segment::SegmentName;

/// Largest configuration file, in bytes.
const LARGEST: u64 = 1 << 20;

/// The configuration file: TOML. Every key is optional, an unknown key is an error.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ConfigFile {
    board: Option<String>,
    name: Option<String>,
    socket: Option<PathBuf>,
    /// Mode of the socket file, as "0660".
    socket_mode: Option<toml::Value>,
    /// Group of the socket file.
    socket_group: Option<String>,
    /// Group of the segment.
    segment_group: Option<String>,
    /// Mode of the segment, as "0644".
    segment_mode: Option<toml::Value>,
    /// pmac, pmac2, turbo, turbo2 or auto.
    family: Option<String>,
    /// Firmware, as "1.16D", for a board that the daemon cannot ask.
    firmware: Option<String>,
    /// Motors to read (I59, on Turbo boards the mask), for a board that the daemon cannot ask.
    motors: Option<u32>,
    /// I10, for a board that the daemon cannot ask.
    i10: Option<u32>,
    /// I19, for a board that the daemon cannot ask.
    i19: Option<u32>,
    servo_reading: Option<ServoReading>,
    word_order: Option<WordOrder>,
    text_order: Option<TextOrder>,
    /// Background reports a second.
    background_hz: Option<f64>,
    /// Whether to identify the board (TYPE, VERSION, I-variables).
    ask_board: Option<bool>,
    /// Whether to ask the board where its M-variables point.
    ask_m_variables: Option<bool>,
    /// The longest wake-up time of the machine's processors, in microseconds.
    cpu_latency_us: Option<u32>,
    /// How long a motor may still move after its held jog is over, in milliseconds; then ^A. 0: never.
    stop_all_after_ms: Option<u32>,
    /// Groups whose members may do more than read.
    roles: Option<RolesTable>,
    /// The mailbox circuit of a VME board.
    mailbox: Option<MailboxTable>,
    /// The interrupt controller behind the host port.
    host_port: Option<HostPortTable>,
    /// The automatic functions in use.
    functions: Option<Functions>,
    /// The functions that the daemon uses although M-variables of the board point into their words.
    shared_functions: Option<Functions>,
    #[serde(default)]
    servo: ServoTable,
    #[serde(default)]
    background: BackgroundTable,
    /// Names and units of motors.
    #[serde(default)]
    motor: Vec<MotorTable>,
    /// Words that the site's own programs write.
    #[serde(default)]
    user: Vec<UserTable>,
    /// Choices that no manual decides: see [`super::board_settings`].
    #[serde(default)]
    plan: BufferSettings,
    #[serde(default)]
    variables: VariablesSettings,
    #[serde(default)]
    readings: toml::Table,
    #[serde(default)]
    rotary: rotary::Settings,
}

#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct RolesTable {
    #[serde(default)]
    stop: Vec<String>,
    #[serde(default)]
    operate: Vec<String>,
    #[serde(default)]
    engineer: Vec<String>,
    /// The control characters that operators may send, as "^R".
    operate_characters: Option<Vec<String>>,
}

impl RolesTable {
    fn decide(self) -> Result<Roles, Refusal> {
        for (role, names) in [("stop", &self.stop), ("operate", &self.operate), ("engineer", &self.engineer)]
        {
            let key = |index| format!("roles.{role}.{index}");
            groups(names.iter().enumerate().map(|(index, name)| (key(index), name.clone())))?;
        }
        let operate_characters = match &self.operate_characters {
            None => Characters::default(),
            Some(names) => Characters::named(names)
                .map_err(|(index, why)| Refusal::of(format!("roles.operate_characters.{index}"), why))?,
        };
        Ok(Roles { stop: self.stop, operate: self.operate, engineer: self.engineer, operate_characters })
    }
}

/// The complete settings.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The board.
    pub board: BoardSpec,
    /// The board as the user wrote it.
    pub board_text: String,
    /// The segment's name.
    pub name: SegmentName,
    /// The command socket; `None`: the first usual place that the daemon can use.
    pub socket: Option<PathBuf>,
    /// Mode of the socket file.
    pub socket_mode: u32,
    /// Group of the socket file.
    pub socket_group: Option<String>,
    /// Mode of the segment.
    pub segment_mode: u32,
    /// Group of the segment, if it is not the daemon's own.
    pub segment_group: Option<String>,
    /// The board's family.
    pub family: &'static Family,
    /// The source of the family.
    pub family_known: FamilyKnown,
    /// Firmware, for a board that the daemon cannot ask.
    pub firmware: Option<String>,
    /// Motors to read, for a board that the daemon cannot ask.
    pub motors: Option<u32>,
    /// Names and units of motors.
    pub motor_names: Vec<MotorNames>,
    /// Words that the site's own programs write.
    pub user: UserArea,
    /// I10, for a board that the daemon cannot ask.
    pub i10: Option<u32>,
    /// I19, for a board that the daemon cannot ask.
    pub i19: Option<u32>,
    /// The reading mode of the servo buffer.
    pub servo_reading: ServoReading,
    /// Byte order of the words on the bus.
    pub word_order: WordOrder,
    /// Character order in a word.
    pub text_order: TextOrder,
    /// The period of background reports, in nanoseconds.
    pub background_period_ns: u64,
    /// Whether to identify the board.
    pub ask_board: bool,
    /// Whether to ask the board where its M-variables point.
    pub ask_m_variables: bool,
    /// The longest wake-up time of the machine's processors, if one is requested.
    pub cpu_latency_us: Option<u32>,
    /// How long a motor may still move after its held jog is over, until ^A stops everything; `None`: for ever.
    pub stop_all_after: Option<Duration>,
    /// Groups whose members may do more than look.
    pub roles: Roles,
    /// The mailbox circuit of a VME board.
    pub mailbox: Option<MailboxConfig>,
    /// The interrupt controller behind the host port.
    pub host_port: Option<HostPortConfig>,
    /// Choices that no manual decides.
    pub board_settings: CheckedSettings,
}

/// Why the daemon refused the settings, on one line: the fault, its place and the cure.
#[derive(Debug, thiserror::Error)]
#[error("{}", one_line(.text))]
pub struct SettingsError {
    text: String,
    typed: bool,
}

impl SettingsError {
    /// The fault is the file itself, or a setting that it lacks.
    fn of_file(text: String) -> Self {
        Self { text, typed: false }
    }

    /// Whether the fault is in the command line, not in the file.
    #[must_use]
    pub const fn is_typed(&self) -> bool {
        self.typed
    }
}

/// Escapes line ends and other control characters of the file, as TOML does.
fn one_line(text: &str) -> String {
    let shown = |c: char| if c.is_control() { c.escape_default().collect() } else { String::from(c) };
    text.chars().map(shown).collect()
}

impl Settings {
    /// Combines the command line and the file that it names.
    ///
    /// # Errors
    /// The first mistake, with file, line and column if it is in the file.
    pub fn decide(options: &Options) -> Result<Self, SettingsError> {
        Self::decide_for(options, None)
    }

    /// As [`Settings::decide`], after a look at the board.
    ///
    /// # Errors
    /// As [`Settings::decide`]; or a board of this family lacks some of the settings.
    pub fn decide_seen(options: &Options, seen: Recognised) -> Result<Self, SettingsError> {
        Self::decide_for(options, Some(seen))
    }

    fn decide_for(options: &Options, seen: Option<Recognised>) -> Result<Self, SettingsError> {
        let Some(path) = &options.config else {
            let decided = Self::of(options, &ConfigFile::default(), seen);
            return decided.map_err(|refusal| SettingsError { text: refusal.text, typed: true });
        };
        let text = read(path)?;
        let file = parse(path, &text)?;
        Self::of(options, &file, seen)
            .map_err(|refusal| SettingsError { text: refusal.placed(path, &text), typed: refusal.typed })
    }

    /// The settings, for the first possible family of the board that the settings fit.
    fn of(options: &Options, file: &ConfigFile, seen: Option<Recognised>) -> Result<Self, Refusal> {
        let board_text = options.board.clone().or_else(|| file.board.clone()).ok_or_else(|| {
            Refusal::anywhere("no board given: write --board SPEC, or board = \"SPEC\" in the configuration")
        })?;
        let typed = options.board.is_some();
        let board = board_text.parse().map_err(|error: SpecError| refused("board", typed, error))?;
        let (families, known) = family::candidates(&board, file.family.as_deref(), seen)
            .map_err(|(key, reason)| refused(key, typed && key == "board", reason))?;
        let of = |family| Self::of_family(options, file.clone(), (&board, &board_text), family, known);
        let mut refusal = None;
        for family in families {
            match of(family) {
                Ok(settings) => return Ok(settings),
                Err(other) => refusal = refusal.or(Some(other)),
            }
        }
        Err(refusal.unwrap_or_else(|| Refusal::anywhere("there is no board family")))
    }

    fn of_family(
        options: &Options,
        file: ConfigFile,
        (board, board_text): (&BoardSpec, &str),
        family: &'static Family,
        known: FamilyKnown,
    ) -> Result<Self, Refusal> {
        let name = options.name.clone().or(file.name).unwrap_or_else(|| "pmac0".to_owned());
        let roles = file.roles.unwrap_or_default().decide()?;
        let (servo, background) = (file.servo.decide(family)?, file.background.decide(family)?);
        let functions = functions(file.functions, family)?;
        let shared = shared_functions(file.shared_functions, &functions)?;
        something_to_do(&functions, &servo)?;
        let unknown = known == FamilyKnown::Unknown;
        let lines = functions.has(Function::Ascii);
        let mailbox = MailboxConfig::decide(file.mailbox, board, lines)?;
        if file.host_port.is_some() && !lines {
            let text = "functions leaves \"ascii\" out, but [host_port] serves only its responses: add \"ascii\" or remove [host_port]";
            return Err(Refusal::of("host_port", text));
        }
        let host_port = file.host_port.map(|table| table.decide(family)).transpose()?;
        let configured = BoardSettings {
            functions: if unknown { Functions::none() } else { functions },
            shared_functions: shared,
            servo,
            background,
            plan: file.plan,
            variables: file.variables,
            readings: readings(file.readings)?,
            rotary: file.rotary,
        };
        let recorded = board.recording().map(super::replay::settings).transpose();
        let board_settings = recorded.map_err(Refusal::anywhere)?.unwrap_or(configured);
        if let BoardSpec::Window(window) = board {
            let bytes = window.bytes(family.length as usize);
            bytes.map_err(|reason| refused("board", options.board.is_some(), reason))?;
        }
        if file.word_order == Some(WordOrder::Swapped) && board.access() == Access::Bits32 {
            let text = "access=32 and word_order = \"swapped\" do not go together, because a bridge may swap 32 bits in more than one way; leave access=32 out";
            return Err(Refusal::of("word_order", text));
        }
        groups(file.socket_group.iter().map(|name| ("socket_group".to_owned(), name.clone())))?;
        groups(file.segment_group.iter().map(|name| ("segment_group".to_owned(), name.clone())))?;
        Ok(Self {
            board: board.clone(),
            board_text: board_text.to_owned(),
            socket: options.socket.clone().or(file.socket),
            name: SegmentName::new(&name).map_err(|error| refused("name", options.name.is_some(), error))?,
            socket_mode: socket_mode(file.socket_mode.as_ref())?,
            socket_group: file.socket_group,
            segment_group: file.segment_group,
            segment_mode: segment_mode(file.segment_mode.as_ref())?,
            family,
            family_known: known,
            board_settings: CheckedSettings::decide(board_settings, family, file.firmware.as_deref())?,
            firmware: file.firmware,
            motors: limited("motors", file.motors, 1, family.motors as u32)?,
            motor_names: motors::decide(&file.motor, family)?,
            user: user::decide(if unknown { &[] } else { &file.user }, family)?,
            i10: limited("i10", file.i10, 1, 8_388_607)?,
            i19: limited("i19", file.i19, 1, 8_388_607)?,
            servo_reading: file.servo_reading.unwrap_or_default(),
            word_order: file.word_order.unwrap_or_default(),
            text_order: file.text_order.unwrap_or_default(),
            background_period_ns: period_ns(file.background_hz.unwrap_or(20.0))?,
            ask_board: file.ask_board.unwrap_or(true),
            ask_m_variables: file.ask_m_variables.unwrap_or(true),
            cpu_latency_us: limited("cpu_latency_us", file.cpu_latency_us, 0, 1_000_000)?,
            stop_all_after: limited("stop_all_after_ms", file.stop_all_after_ms, 0, 60_000)?
                .map_or(Some(1000), |ms| (ms > 0).then_some(ms))
                .map(|ms| Duration::from_millis(ms.into())),
            roles,
            mailbox: mailbox.filter(|_| !unknown),
            host_port: host_port.filter(|_| !unknown),
        })
    }
}

/// The refusal of a setting. A setting from the command line has no place in the file.
fn refused(key: &str, typed: bool, error: impl std::fmt::Display) -> Refusal {
    if typed { Refusal::typed(error) } else { Refusal::of(key, error) }
}

/// Reads the file. Only root and this user may be able to write it.
fn read(path: &Path) -> Result<String, SettingsError> {
    let fail = |error: io::Error| {
        SettingsError::of_file(format!("cannot read the configuration {}: {error}", path.display()))
    };
    let refuse = |why: String| {
        Err(SettingsError::of_file(format!("the configuration {} is refused: {why}", path.display())))
    };
    // Otherwise the opening of a FIFO would wait for a writer.
    let mut open = File::options();
    let file = open.read(true).custom_flags(OFlag::O_NONBLOCK.bits()).open(path).map_err(fail)?;
    let there = file.metadata().map_err(fail)?;
    if !there.is_file() {
        return refuse("it is no regular file: check --config".to_owned());
    }
    let (owner, user) = (there.uid(), geteuid().as_raw());
    if owner != 0 && owner != user {
        return refuse(format!("it belongs to user {owner}, neither root nor this user: chown root"));
    }
    if there.mode() & 0o002 != 0 {
        return refuse(format!("everybody can write to it (mode {:03o}): chmod o-w", there.mode() & 0o777));
    }
    let mut text = String::new();
    file.take(LARGEST + 1).read_to_string(&mut text).map_err(fail)?;
    if text.len() as u64 > LARGEST {
        return refuse("it is larger than 1 MiB, so it is probably another file: check --config".to_owned());
    }
    Ok(text)
}

fn parse(path: &Path, text: &str) -> Result<ConfigFile, SettingsError> {
    toml::from_str(text).map_err(|error| {
        let (line, column) = error.span().map_or((1, 1), |span| position(text, span.start));
        SettingsError::of_file(format!(
            "{}:{line}:{column}: {}",
            path.display(),
            error.message().replace('\n', "; ")
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::board::spec::SimulatorSpec;
    use std::io::Write;

    fn with_file(text: &str) -> Result<Settings, String> {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(text.as_bytes()).unwrap();
        let options = Options { config: Some(file.path().to_owned()), ..Options::default() };
        Settings::decide(&options)
            .map_err(|error| error.to_string().replace(&file.path().display().to_string(), "FILE"))
    }

    #[test]
    fn a_configuration_that_others_can_write_to_or_that_is_none_is_refused() {
        use std::os::unix::fs::PermissionsExt;
        let file = tempfile::NamedTempFile::new().unwrap();
        let decide = || {
            let options = Options { config: Some(file.path().to_owned()), ..Options::default() };
            Settings::decide(&options).map_err(|error| error.to_string())
        };
        let mode =
            |mode| std::fs::set_permissions(file.path(), std::fs::Permissions::from_mode(mode)).unwrap();
        let text = "board = \"sim\"\n#";
        std::fs::write(file.path(), text).unwrap();
        mode(0o664);
        decide().unwrap();
        mode(0o646);
        let error = decide().unwrap_err();
        assert!(error.contains("everybody can write to it (mode 646): chmod o-w"), "{error}");
        mode(0o600);
        let padded = text.to_owned() + &"#".repeat((1 << 20) - text.len());
        std::fs::write(file.path(), &padded).unwrap();
        decide().unwrap();
        std::fs::write(file.path(), padded + "#").unwrap();
        assert!(decide().unwrap_err().contains("larger than 1 MiB"));
    }

    #[test]
    fn a_configuration_that_is_no_file_is_refused_without_waiting() {
        let directory = tempfile::tempdir().unwrap();
        let fifo = directory.path().join("pmacd.toml");
        nix::unistd::mkfifo(&fifo, nix::sys::stat::Mode::S_IRWXU).unwrap();
        for path in [&fifo, directory.path()] {
            let options = Options { config: Some(path.to_owned()), ..Options::default() };
            let error = Settings::decide(&options).unwrap_err().to_string();
            assert!(error.contains("is refused: it is no regular file"), "{error}");
        }
    }

    #[test]
    #[ignore = "needs root, to give a file to another user"]
    fn as_root_b4_6_a_configuration_of_a_stranger_is_refused() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), "board = \"sim\"\n").unwrap();
        std::os::unix::fs::chown(file.path(), Some(12345), None).unwrap();
        let options = Options { config: Some(file.path().to_owned()), ..Options::default() };
        let error = Settings::decide(&options).unwrap_err().to_string();
        assert!(error.contains("it belongs to user 12345") && error.contains("chown root"), "{error}");
    }

    #[test]
    fn the_command_line_wins_over_the_file_and_the_file_over_the_default() {
        let settings = with_file("board = \"sim\"\nname = \"lathe\"\nmotors = 4\n").unwrap();
        assert_eq!(settings.board, BoardSpec::Simulator(SimulatorSpec::default()));
        assert_eq!((settings.name.as_str(), &settings.socket), ("lathe", &None));
        assert_eq!((settings.motors, settings.socket_mode, settings.segment_mode), (Some(4), 0o660, 0o644));
        let options = Options {
            board: Some("file:x".to_owned()),
            name: Some("pmac7".to_owned()),
            socket: Some("s".into()),
            ..Options::default()
        };
        let settings = Settings::decide(&options).unwrap();
        assert_eq!((settings.name.as_str(), settings.socket.as_deref()), ("pmac7", Some(Path::new("s"))));
    }

    #[test]
    fn what_is_wrong_is_said_with_its_place() {
        for (text, message) in [
            ("", "no board given"),
            ("board = \"sim\"\nspeed = 3\n", "FILE:2:1: unknown field `speed`"),
            ("board = \n", "FILE:1:"),
            (
                "board = \"mem:0xD4000,length=0x2000\"\n",
                "FILE:1:9: length=0x2000 is too short: the DPRAM of this family has 0x4000 bytes",
            ),
            (
                "board = \"sim\"\nfamily = \"turbo9\"\n",
                "FILE:2:10: no board family is called \"turbo9\"; there are pmac, pmac2, turbo, turbo2",
            ),
            (
                "board = \"sim\"\nfamily = \"turbo2\"\nfunctions = [\"servo\", \"panel\"]\n",
                "FILE:3:23: pmacd does not use the function `panel` on a Turbo PMAC2: no text tells of a firmware that acts on its words; jog-stop",
            ),
            (
                "board = \"sim,family=pmac\"\nfamily = \"turbo2\"\n",
                "FILE:1:9: the board is sim,family=pmac, but family = \"turbo2\" in the configuration says otherwise",
            ),
            ("board = \"sim,dpram=32k\"\n", "FILE:1:9: no PMAC has a DPRAM of `32k`; write 8k"),
            ("board = \"sim\"\nmotors = 9\n", "FILE:2:10: motors = 9 is out of range: write 1 to 8"),
            ("board = \"sim\"\nsocket_mode = \"9\"\n", "FILE:2:15: socket_mode = \"9\" is not a file mode"),
            (
                "board = \"sim\"\nsocket_mode = 0o666\n",
                "FILE:2:15: socket_mode = 438 is not a file mode; write three or four octal digits in quotes, such as \"0660\"",
            ),
            (
                "board = \"sim\"\nsocket_mode = \"999\"\n",
                "FILE:2:15: socket_mode = \"999\" is not a file mode",
            ),
            (
                "board = \"sim\"\nsocket_mode = \"0400\"\n",
                "FILE:2:15: socket_mode = \"0400\" lets nobody connect",
            ),
            (
                "board = \"sim\"\nsegment_mode = \"0200\"\n",
                "FILE:2:16: segment_mode = \"0200\" keeps the daemon's own",
            ),
            (
                "board = \"sim\"\nsegment_mode = \"0666\"\n",
                "FILE:2:16: segment_mode = \"0666\" would let others forge",
            ),
            (
                "board = \"sim\"\ncpu_latency_us = 1000001\n",
                "FILE:2:18: cpu_latency_us = 1000001 is out of range: write 0 to 1000000",
            ),
            ("board = \"sim\"\nbackground_hz = 0\n", "FILE:2:17: background_hz = 0 is out of range"),
            (
                "board = \"sim\"\n[rotary]\nexponent_bias = 64\n",
                "FILE:3:17: [rotary] exponent_bias = 64: 0 to 63",
            ),
            ("board = \"sim\"\n[plan]\nrotary_longs = [5, 0]\n", "FILE:2:1: [plan] rotary"),
            (
                "board = \"sim\"\n[servo]\nfields = [\n'actual_position',\n'speed']\n",
                "FILE:5:1: there is no servo field `speed`",
            ),
            ("board = \"sim\"\n[background]\nmotors = [1, 9]\n", "FILE:3:14: there is no motor 9"),
            ("board = \"sim\"\nfunctions = [\"seervo\"]\n", ": unknown variant `seervo`"),
            (
                "board = \"sim\"\nfunctions = []\n",
                "FILE:2:13: functions = [] leaves the daemon nothing to do",
            ),
            ("board = \"sim\"\n[servo]\nmotors = []\n", "FILE:3:10: [servo] motors = [] leaves nothing"),
            ("board = \"sim\"\n[servo]\nfields = []\n", "FILE:3:10: [servo] fields = [] leaves nothing"),
            (
                "board = \"sim\"\nfunctions = [\"servo\"]\n[mailbox]\nregisters = \"file:m\"\ntaken = \"unix:t\"\nreply = \"unix:r\"\n",
                "FILE:3:1: functions leaves \"ascii\" out, so the mailboxes can only set the page: write use = \"never\" in [mailbox]",
            ),
            (
                "board = \"sim\"\n[mailbox]\nregisters = \"file:m\"\nuse = \"never\"\npage = 64\n",
                "FILE:5:8: mailbox.page = 64",
            ),
            (
                "board = \"sim\"\nfunctions = [\"servo\"]\n[host_port]\nregisters = \"file:p\"\n",
                "FILE:3:1: functions leaves \"ascii\" out, but [host_port] serves only its responses",
            ),
            (
                "board = \"sim\"\n[readings]\nold = \"done\"\n",
                "FILE:3:7: [readings] takes rotary_code2 alone, and has old; docs/evidence.md, \"What became of the settings\"",
            ),
            (
                "board = \"sim\"\n[readings]\nrotary_code2 = \"bit13\"\n",
                "FILE:3:16: unknown variant `bit13`, expected `bit12` or `bit16`",
            ),
            ("board = \"sim\"\n[plan]\nplace = 3\n", "FILE:3:1: unknown field `place`"),
            ("board = \"sim\"\nfirmware = \"new\"\n", "FILE:2:12: "),
            ("board = \"file:m,access=32\"\nword_order = \"swapped\"\n", "FILE:2:14: access=32"),
            ("board = \"boat\"\n", "FILE:1:9: board `boat`: there is no board kind `boat`"),
            (
                "board = \"\\n\\u001b[2J\"\n",
                "FILE:1:9: board `\\n\\u{1b}[2J`: there is no board kind `\\n\\u{1b}[2J`",
            ),
            ("board = \"sim\"\nname = \"a/b\"\n", "FILE:2:8: "),
            ("board = \"sim\"\n[roles]\nking = []\n", "FILE:3:1: unknown field `king`"),
            (
                "board = \"sim\"\n[roles]\nengineer = [\"no-such-group\"]\n",
                "FILE:3:13: group \"no-such-group\" does not exist",
            ),
            (
                "board = \"sim\"\n[roles]\noperate_characters = [\"^R\", \"^Z\"]\n",
                "FILE:3:29: ^Z ends command lines for everybody",
            ),
            ("board = \"sim\"\nsegment_group = \"no-such-group\"\n", "FILE:2:17: group \"no-such-group\""),
            ("board = \"sim\"\nsocket_group = \"no-such-group\"\n", "FILE:2:16: group \"no-such-group\""),
        ] {
            let error = with_file(text).unwrap_err();
            assert!(error.contains(message), "{text:?}: {error}");
            assert_eq!(error.lines().count(), 1, "{error}");
        }
        // A setting from the command line has no place in a file.
        let options = Options { board: Some("boat".to_owned()), ..Options::default() };
        assert!(Settings::decide(&options).unwrap_err().to_string().starts_with("board `boat`: "));
        let options = Options { config: Some("/nonexistent.toml".into()), ..Options::default() };
        assert!(Settings::decide(&options).unwrap_err().to_string().contains("/nonexistent.toml"));
    }
}
