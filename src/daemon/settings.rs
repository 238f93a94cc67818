//! What the daemon works by: the configuration file, the command line over it, and defaults under both.

use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::options::Options;
use super::policy::Roles;
use super::ports::{HostPortConfig, HostPortTable, MailboxConfig, MailboxTable, Use};
use super::uncertain::Uncertain;
use crate::device::{Access, BoardSpec};
use crate::format::{TextOrder, WordOrder};
use crate::function::servo::ServoReading;
use crate::map::{PlanSettings, classic};
use crate::protocol::{
    BackgroundSettings, BoardSettings, Function, Functions, GatherSettings, ServoSettings, VariablesSettings,
};
use crate::rotary;
use crate::segment::SegmentName;

/// The configuration file as it is written: TOML, every key optional, an unknown one an error.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ConfigFile {
    board: Option<String>,
    name: Option<String>,
    socket: Option<PathBuf>,
    /// Mode of the socket file, as "0660".
    socket_mode: Option<String>,
    /// Group of the socket file.
    socket_group: Option<String>,
    /// Group of the segment.
    segment_group: Option<String>,
    /// Mode of the segment, as "0644".
    segment_mode: Option<String>,
    /// pmac or pmac2.
    family: Option<FamilyName>,
    /// Firmware, as "1.16D", where the board cannot be asked.
    firmware: Option<String>,
    /// Motors to read where the board cannot be asked (I59).
    motors: Option<u32>,
    /// I10, where the board cannot be asked.
    i10: Option<u32>,
    /// I19, where the board cannot be asked.
    i19: Option<u32>,
    servo_reading: Option<ServoReading>,
    word_order: Option<WordOrder>,
    text_order: Option<TextOrder>,
    /// Background reports a second.
    background_hz: Option<f64>,
    /// Whether the board is asked who it is (TYPE, VERSION, I-variables).
    ask_board: Option<bool>,
    /// Groups whose members may do more than look.
    roles: Option<RolesTable>,
    /// The mailbox circuit of a VME board.
    mailbox: Option<MailboxTable>,
    /// The interrupt controller behind the host port.
    host_port: Option<HostPortTable>,
    /// The automatic functions that are used.
    #[serde(default)]
    functions: Functions,
    #[serde(default)]
    servo: ServoSettings,
    #[serde(default)]
    background: BackgroundSettings,
    /// What no document decides: see [`super::uncertain`].
    #[serde(default)]
    plan: PlanSettings,
    #[serde(default)]
    gather: GatherSettings,
    #[serde(default)]
    variables: VariablesSettings,
    #[serde(default)]
    rotary: rotary::Settings,
}

#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct RolesTable {
    #[serde(default)]
    operate: Vec<String>,
    #[serde(default)]
    engineer: Vec<String>,
}

/// The board families this version knows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FamilyName {
    /// PMAC(1).
    #[default]
    Pmac,
    /// PMAC2.
    Pmac2,
}

impl FamilyName {
    /// As the command line and the segment's page spell it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Pmac => "pmac",
            Self::Pmac2 => "pmac2",
        }
    }

    /// Its number in the segment's board region.
    #[must_use]
    pub fn number(self) -> u32 {
        match self {
            Self::Pmac => 1,
            Self::Pmac2 => 2,
        }
    }
}

/// Everything decided.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The board.
    pub board: BoardSpec,
    /// The board as it was written.
    pub board_text: String,
    /// The segment's name.
    pub name: SegmentName,
    /// The command socket.
    pub socket: PathBuf,
    /// Mode of the socket file.
    pub socket_mode: u32,
    /// Group of the socket file.
    pub socket_group: Option<String>,
    /// Mode of the segment.
    pub segment_mode: u32,
    /// Group of the segment, when it is not the daemon's own.
    pub segment_group: Option<String>,
    /// The board's family.
    pub family: FamilyName,
    /// Firmware, where the board cannot be asked.
    pub firmware: Option<String>,
    /// Motors to read, where the board cannot be asked.
    pub motors: Option<u32>,
    /// I10, where the board cannot be asked.
    pub i10: Option<u32>,
    /// I19, where the board cannot be asked.
    pub i19: Option<u32>,
    /// How the servo buffer is read.
    pub servo_reading: ServoReading,
    /// Byte order of the bus's words.
    pub word_order: WordOrder,
    /// Order of the characters in a word.
    pub text_order: TextOrder,
    /// Nanoseconds from one background report to the next.
    pub background_period_ns: u64,
    /// Whether the board is asked who it is.
    pub ask_board: bool,
    /// Groups whose members may do more than look.
    pub roles: Roles,
    /// The mailbox circuit of a VME board.
    pub mailbox: Option<MailboxConfig>,
    /// The interrupt controller behind the host port.
    pub host_port: Option<HostPortConfig>,
    /// What no document decides.
    pub uncertain: Uncertain,
}

/// Why the settings were refused. One line: what, where, what to do.
#[derive(Debug, thiserror::Error)]
#[error("{}", one_line(.0))]
pub struct SettingsError(String);

/// What was written may have line ends and other control characters in it, which are shown as in TOML.
fn one_line(text: &str) -> String {
    let shown = |c: char| if c.is_control() { c.escape_default().collect() } else { String::from(c) };
    text.chars().map(shown).collect()
}

impl Settings {
    /// Decides from the command line and the file it names.
    ///
    /// # Errors
    /// The first thing that is wrong, with file, line and column where it stands in the file.
    pub fn decide(options: &Options) -> Result<Self, SettingsError> {
        let file = match &options.config {
            Some(path) => read(path)?,
            None => ConfigFile::default(),
        };
        let board_text = options.board.clone().or(file.board).ok_or_else(|| {
            SettingsError(
                "no board given: write --board SPEC, or board = \"SPEC\" in the configuration".to_owned(),
            )
        })?;
        let name = options.name.clone().or(file.name).unwrap_or_else(|| "pmac0".to_owned());
        let socket = options.socket.clone().or(file.socket);
        let roles = file.roles.unwrap_or_default();
        let family = file.family.unwrap_or_default();
        let mailbox = file.mailbox.map(MailboxTable::decide).transpose().map_err(SettingsError)?;
        if !file.functions.has(Function::Ascii) {
            if mailbox.as_ref().is_some_and(|mailbox| mailbox.when != Use::Never) {
                let text = "functions leaves \"ascii\" out, so the mailboxes have no use but for the page: write use = \"never\" in [mailbox]";
                return Err(SettingsError(text.to_owned()));
            }
            if file.host_port.is_some() {
                let text = "functions leaves \"ascii\" out, whose responses [host_port] is for: leave one or the other out";
                return Err(SettingsError(text.to_owned()));
            }
        }
        let host_port = file.host_port.map(|table| table.decide(family)).transpose();
        let uncertain = BoardSettings {
            functions: file.functions,
            servo: file.servo,
            background: file.background,
            plan: file.plan,
            gather: file.gather,
            variables: file.variables,
            rotary: file.rotary,
        };
        let board: BoardSpec = board_text.parse().map_err(refused)?;
        if file.word_order == Some(WordOrder::Swapped) && board.access() == Access::Bits32 {
            let text = "access=32 and word_order = \"swapped\" do not go together: how a bridge that swaps bytes would swap 32 bits is not known; leave access=32 out";
            return Err(SettingsError(text.to_owned()));
        }
        Ok(Self {
            board,
            board_text,
            socket: socket
                .unwrap_or_else(|| format!("/run/pmacd/{}.sock", name.trim_start_matches('/')).into()),
            name: SegmentName::new(&name).map_err(refused)?,
            socket_mode: mode("socket_mode", file.socket_mode.as_deref(), 0o660)?,
            socket_group: file.socket_group,
            segment_group: file.segment_group,
            segment_mode: mode("segment_mode", file.segment_mode.as_deref(), 0o644)?,
            family,
            uncertain: Uncertain::decide(uncertain, family.name(), file.firmware.as_deref())
                .map_err(refused)?,
            firmware: file.firmware,
            motors: limited("motors", file.motors, 1, classic::MOTORS as u32)?,
            i10: limited("i10", file.i10, 1, 8_388_607)?,
            i19: limited("i19", file.i19, 1, 8_388_607)?,
            servo_reading: file.servo_reading.unwrap_or_default(),
            word_order: file.word_order.unwrap_or_default(),
            text_order: file.text_order.unwrap_or_default(),
            background_period_ns: period_ns(file.background_hz.unwrap_or(20.0))?,
            ask_board: file.ask_board.unwrap_or(true),
            roles: Roles { operate: roles.operate, engineer: roles.engineer },
            mailbox,
            host_port: host_port.map_err(SettingsError)?,
        })
    }
}

fn refused(error: impl std::fmt::Display) -> SettingsError {
    SettingsError(error.to_string())
}

fn read(path: &Path) -> Result<ConfigFile, SettingsError> {
    let text = std::fs::read_to_string(path).map_err(|error| {
        SettingsError(format!("cannot read the configuration {}: {error}", path.display()))
    })?;
    toml::from_str(&text).map_err(|error| {
        let (line, column) = error.span().map_or((1, 1), |span| position(&text, span.start));
        SettingsError(format!("{}:{line}:{column}: {}", path.display(), error.message().replace('\n', "; ")))
    })
}

/// Line and column, from 1, of the byte at `offset`.
fn position(text: &str, offset: usize) -> (usize, usize) {
    let before = text.get(..offset).unwrap_or(text);
    let line = before.matches('\n').count() + 1;
    let column = before.rsplit('\n').next().map_or(0, |last| last.chars().count()) + 1;
    (line, column)
}

fn mode(key: &str, text: Option<&str>, default: u32) -> Result<u32, SettingsError> {
    let Some(text) = text else { return Ok(default) };
    u32::from_str_radix(text, 8).ok().filter(|mode| *mode <= 0o777).ok_or_else(|| {
        SettingsError(format!(
            "{key} = \"{text}\" is no file mode; write three or four octal digits, as \"0660\""
        ))
    })
}

fn limited(key: &str, value: Option<u32>, least: u32, most: u32) -> Result<Option<u32>, SettingsError> {
    match value {
        Some(value) if !(least..=most).contains(&value) => {
            Err(SettingsError(format!("{key} = {value} is out of range: write {least} to {most}")))
        }
        value => Ok(value),
    }
}

fn period_ns(hz: f64) -> Result<u64, SettingsError> {
    if (0.1..=1000.0).contains(&hz) {
        Ok((1e9 / hz) as u64)
    } else {
        Err(SettingsError(format!("background_hz = {hz} is out of range: write 0.1 to 1000")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn with_file(text: &str) -> Result<Settings, String> {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(text.as_bytes()).unwrap();
        let options = Options { config: Some(file.path().to_owned()), ..Options::default() };
        Settings::decide(&options)
            .map_err(|error| error.to_string().replace(&file.path().display().to_string(), "FILE"))
    }

    #[test]
    fn the_command_line_wins_over_the_file_and_the_file_over_the_default() {
        let settings = with_file("board = \"sim\"\nname = \"lathe\"\nmotors = 4\n").unwrap();
        assert_eq!(settings.board, BoardSpec::Simulator);
        assert_eq!(settings.socket, Path::new("/run/pmacd/lathe.sock"));
        assert_eq!((settings.motors, settings.socket_mode, settings.segment_mode), (Some(4), 0o660, 0o644));
        let options = Options {
            board: Some("file:x".to_owned()),
            name: Some("pmac7".to_owned()),
            socket: Some("s".into()),
            ..Options::default()
        };
        let settings = Settings::decide(&options).unwrap();
        assert_eq!((settings.name.as_str(), settings.socket.as_path()), ("pmac7", Path::new("s")));
    }

    #[test]
    fn what_is_wrong_is_said_with_its_place() {
        for (text, message) in [
            ("", "no board given"),
            ("board = \"sim\"\nspeed = 3\n", "FILE:2:1: unknown field `speed`"),
            ("board = \n", "FILE:1:"),
            ("board = \"sim\"\nfamily = \"turbo9\"\n", "FILE:2:10: unknown variant `turbo9`"),
            ("board = \"sim\"\nmotors = 9\n", "motors = 9 is out of range: write 1 to 8"),
            ("board = \"sim\"\nsocket_mode = \"9\"\n", "no file mode"),
            ("board = \"sim\"\nbackground_hz = 0\n", "background_hz = 0 is out of range"),
            ("board = \"sim\"\n[rotary]\nexponent_bias = 64\n", "[rotary] exponent_bias = 64: 0 to 63"),
            ("board = \"sim\"\n[plan]\nrotary_longs = [5, 0]\n", "[plan] rotary"),
            (
                "board = \"sim\"\n[servo]\nfields = [\n'actual_position',\n'speed']\n",
                "FILE:3:10: there is no servo field `speed`",
            ),
            ("board = \"sim\"\n[background]\nmotors = [1, 9]\n", "FILE:3:10: there is no motor 9"),
            ("board = \"sim\"\nfunctions = [\"seervo\"]\n", ": unknown variant `seervo`"),
            (
                "board = \"sim\"\nfunctions = [\"servo\"]\n[mailbox]\nregisters = \"file:m\"\ntaken = \"unix:t\"\nreply = \"unix:r\"\n",
                "write use = \"never\" in [mailbox]",
            ),
            ("board = \"sim\"\nfunctions = []\n[host_port]\nregisters = \"file:p\"\n", "[host_port] is for"),
            ("board = \"sim\"\n[gather]\nplace = 3\n", "FILE:3:1: unknown field `place`"),
            ("board = \"sim\"\nfirmware = \"new\"\n", "not a firmware version"),
            ("board = \"file:m,access=32\"\nword_order = \"swapped\"\n", "leave access=32 out"),
            ("board = \"boat\"\n", "no board kind `boat`"),
            ("board = \"\\n\\u001b[2J\"\n", "no board kind `\\n\\u{1b}[2J`"),
            ("board = \"sim\"\nname = \"a/b\"\n", "cannot be a segment's name"),
            ("board = \"sim\"\n[roles]\nking = []\n", "FILE:3:1: unknown field `king`"),
        ] {
            let error = with_file(text).unwrap_err();
            assert!(error.contains(message), "{text:?}: {error}");
            assert_eq!(error.lines().count(), 1, "{error}");
        }
        let options = Options { config: Some("/nonexistent.toml".into()), ..Options::default() };
        assert!(Settings::decide(&options).unwrap_err().to_string().contains("/nonexistent.toml"));
    }
}
