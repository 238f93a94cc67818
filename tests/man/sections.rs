//! What no definition of a command line holds: the names that may be typed, examples, exit statuses, what else to read.
//!
//! Lists of names come from the code that takes them.

use pmac_dpram::daemon::socket::policy::Role;
use pmac_dpram::function::panel::PanelAction;
use pmac_dpram::gather::Source;
use pmac_dpram::map::{FAMILIES, Layout, PMAC, TURBO2};
use pmac_dpram::protocol::{BackgroundSettings, Function, ServoSettings};
use pmac_dpram::rotary::Settings;
use pmac_dpram::sim::control::COMMANDS;
use pmac_dpram::sim::fault::faults;

use super::roff::{Page, bold};

/// A list of names that may be typed.
pub struct Names {
    /// Its heading.
    pub title: &'static str,
    /// What it is a list of.
    pub about: &'static str,
    /// The names.
    pub names: Vec<String>,
}

fn list(
    title: &'static str,
    about: &'static str,
    names: impl IntoIterator<Item = impl Into<String>>,
) -> Names {
    Names { title, about, names: names.into_iter().map(Into::into).collect() }
}

fn families() -> Names {
    families_of("What --family takes:")
}

fn families_of(about: &'static str) -> Names {
    list("FAMILIES", about, FAMILIES.iter().map(|family| family.name))
}

fn functions() -> Names {
    list("FUNCTIONS", "What `functions` of pmacd.toml(5) lists:", Function::ALL.map(Function::name))
}

fn roles() -> Names {
    list(
        "ROLES",
        "From the least to the most; stop only stops the machine, operate moves it:",
        Role::ALL.map(|role| role.to_string()),
    )
}

fn words() -> Names {
    let about = "Words of the DPRAM, as the manual prints addresses (Y and DP: low word, X and F: see pmacctl-board(1)), a host \
                 offset, or some bits of a word (lowest bit, width):";
    let names = ["Y:$D001", "X:$D009", "DP:$D200", "D:$D014", "L:$D09A", "F:$D210", "0x0024", "Y:$D001,8,4"];
    list("REGISTER SPELLINGS", about, names)
}

fn registers() -> Names {
    let about = "Registers of the board: 24 bits signed, 24 bits unsigned, 48 bits, 48-bit float; or by name, with the number of any \
                 motor or coordinate system:";
    let names = Source::names(&Layout::new(&PMAC, None));
    let addresses = ["Y:$0003", "X:$0028", "Y:$0770,u", "D:$002B", "L:$1005"].map(str::to_owned);
    let names = names.split(", ").map(str::to_owned);
    list("REGISTER SPELLINGS", about, addresses.into_iter().chain(names))
}

fn rotary_settings() -> Names {
    let defaults = serde_json::to_value(Settings::default()).unwrap_or_default();
    let defaults = defaults.as_object().into_iter().flatten();
    let defaults = defaults.map(|(name, value)| format!("{name}={}", value.to_string().replace('"', "")));
    let about = "What --set takes, with the values that hold without it, and rotary_code2 (bit12 or bit16), which has none:";
    list("SETTINGS", about, defaults)
}

/// What may be typed, with what each of it does.
pub struct Entries {
    /// Its heading.
    pub title: &'static str,
    /// What it is a list of.
    pub about: &'static str,
    /// How each is typed, and what it does.
    pub entries: Vec<(&'static str, String)>,
}

/// The explained lists on a page.
pub fn entries(page: &str) -> Vec<Entries> {
    match page {
        "pmac-sim" => vec![
            Entries {
                title: "CONTROL SOCKET",
                about: "What the socket of --control takes, a line in and a line out. Numbers of motors begin at 1.",
                entries: COMMANDS
                    .iter()
                    .map(|command| (command.form, format!("{}.", capital(command.effect))))
                    .collect(),
            },
            Entries {
                title: "FAULTS",
                about: "What `fault` on the control socket takes. A fault lasts until it is taken back.",
                entries: faults()
                    .map(|fault| (fault.name, format!("{}: {}.", capital(fault.values()), fault.effect)))
                    .collect(),
            },
        ],
        _ => Vec::new(),
    }
}

/// The text with a capital first letter.
fn capital(text: &str) -> String {
    let (first, rest) = text.split_at(1);
    first.to_uppercase() + rest
}

/// The lists on a page.
pub fn names(page: &str) -> Vec<Names> {
    match page {
        "pmacd.toml" => vec![
            functions(),
            families_of("What `family` takes:"),
            roles(),
            list("SERVO FIELDS", "What `fields` of [servo] lists:", ServoSettings::all(&PMAC).fields),
            list(
                "BACKGROUND FIELDS",
                "What `fields` of [background] lists:",
                BackgroundSettings::all(&PMAC).fields,
            ),
            list(
                "SERVO FIELDS OF TURBO BOARDS",
                "The same on Turbo boards:",
                ServoSettings::all(&TURBO2).fields,
            ),
            list(
                "BACKGROUND FIELDS OF TURBO BOARDS",
                "The same on Turbo boards:",
                BackgroundSettings::all(&TURBO2).fields,
            ),
        ],
        "pmacctl" => vec![families(), functions(), roles()],
        "pmacctl-board" | "pmacctl-doctor" | "pmacctl-demo" => vec![families()],
        "pmacctl-read" | "pmacctl-write" => vec![words(), families()],
        "pmacctl-gather" | "pmacctl-top" | "pmacctl-variable" => vec![registers()],
        "pmacctl-panel" => {
            let about = "What an action is called here, in the log and on the socket:";
            vec![list("ACTIONS", about, PanelAction::ALL.map(PanelAction::name))]
        }
        "pmacctl-rotary" => vec![rotary_settings()],
        "pmacctl-setup" => vec![
            list(
                "FUNCTIONS",
                "What setup enable takes, in the order in which it enables them:",
                Function::ALL.map(Function::name),
            ),
            families(),
        ],
        _ => Vec::new(),
    }
}

/// What somebody would type, and why.
pub type Example = (&'static str, &'static [&'static str]);

/// The examples of a page.
pub fn examples(page: &str) -> &'static [Example] {
    match page {
        "pmacd" => &[
            (
                "A simulated board, its socket in a place of one's own:",
                &["pmacd --board sim --socket /tmp/pmac0.sock"],
            ),
            (
                "An ISA board by /dev/mem, started as root, which becomes user pmacd once the board is open:",
                &["pmacd --board mem:0xD4000 --user pmacd"],
            ),
            ("A captured board again:", &["pmacd --board replay:/var/tmp/board-7 --socket /tmp/pmac0.sock"]),
            ("What is wrong with a configuration:", &["pmacd --config /etc/pmacd/pmac0.toml --check"]),
        ],
        "pmac-sim" => &[
            (
                "A board for pmacd --board file:/dev/shm/dpram,irq=unix:/tmp/pmac-irq:",
                &["pmac-sim --memory /dev/shm/dpram --interrupt unix:/tmp/pmac-irq --dpram-startup"],
            ),
            (
                "A PMAC2 with four motors that only moves when its control socket says `step N`:",
                &[
                    "pmac-sim --memory /dev/shm/dpram --family pmac2 --motors 4 --control unix:/tmp/control --virtual",
                ],
            ),
            (
                "A Turbo PMAC2 whose 32 motors and 16 coordinate systems are reported:",
                &["pmac-sim --memory /dev/shm/dpram --family turbo2 --dpram-startup"],
            ),
        ],
        "pmacctl" => &[
            ("Try everything without a board:", &["pmacctl demo"]),
            ("Look at a board that pmacd serves:", &["pmacctl status", "pmacctl watch"]),
            ("The positions for a script:", &["pmacctl --json motors"]),
            ("Stop everything:", &["pmacctl abort"]),
        ],
        "pmacctl-demo" => &[
            ("Ten seconds of a simulated board:", &["pmacctl demo --seconds 10"]),
            ("The same of a Turbo PMAC2:", &["pmacctl demo --seconds 10 --family turbo2"]),
        ],
        "pmacctl-status" => &[("Of the board called rig, as JSON:", &["pmacctl --name rig --json status"])],
        "pmacctl-doctor" => &[
            ("What keeps this user from live data:", &["pmacctl doctor"]),
            ("Which boards there are, with the udev rule for a slot:", &["pmacctl doctor --boards"]),
            ("Where programs of the board keep data of their own:", &["pmacctl doctor --memory"]),
            ("What lives behind an address, without writing to it:", &["pmacctl doctor --probe mem:0xD4000"]),
            ("One file to send to somebody who is to help:", &["pmacctl doctor --report report.tar"]),
        ],
        "pmacctl-motors" => &[("Once, for a script:", &["pmacctl motors --json"])],
        "pmacctl-coordinates" => &[("Once:", &["pmacctl coordinates"])],
        "pmacctl-motor" => &[("Every status bit of motor 1, and what it means:", &["pmacctl motor 1"])],
        "pmacctl-system" => &[
            ("Every status bit of coordinate system 1:", &["pmacctl system 1"]),
            ("Those of the board:", &["pmacctl system"]),
        ],
        "pmacctl-explain" => &[
            (
                "A variable, an error, an address and a status bit:",
                &["pmacctl explain I130 ERR003 'Y:$D009' home_complete"],
            ),
            ("A variable of every motor of a Turbo board:", &["pmacctl explain Ixx97 --family turbo2"]),
        ],
        "pmacctl-watch" => &[
            ("Ten lines, two a second:", &["pmacctl watch --count 10 --rate 2"]),
            ("The coordinate systems:", &["pmacctl watch coordinates"]),
        ],
        "pmacctl-top" => &[
            ("Everything on one screen:", &["pmacctl top"]),
            ("With a variable and a register:", &["pmacctl top P1 1.actual_position"]),
        ],
        "pmacctl-board" => &[
            ("The printed map:", &["pmacctl board map"]),
            ("As firmware 1.16D has it, for a program:", &["pmacctl board map --firmware 1.16D --json"]),
            ("An image that was copied from a board:", &["pmacctl board decode image.bin --motors 4"]),
            ("Two seconds of a board, for a test or for somebody else:", &["pmacctl board capture board-7"]),
            ("A moment, without variables:", &["pmacctl board capture board-8 --seconds 0.1 --no-variables"]),
            ("What Ix10 of a PMAC reads:", &["pmacctl board absolute --ix10 0x8D0010"]),
        ],
        "pmacctl-jog" => &[
            ("To a position in counts:", &["pmacctl jog 1 =5000 --wait"]),
            ("Motors 1 and 3 until they are stopped:", &["pmacctl jog 1,3 +", "pmacctl jog 1,3 stop"]),
            ("Only while the command runs, two seconds at most:", &["pmacctl jog 1 + --hold --seconds 2"]),
        ],
        "pmacctl-home" => &[("Motors 1 and 2, and wait for both:", &["pmacctl home 1 2 --wait"])],
        "pmacctl-set-position" => &[("Motor 1 is at 0 from now on:", &["pmacctl set-position 1 =0 --yes"])],
        "pmacctl-run" => &[("The program of coordinate system 1, to its end:", &["pmacctl run 1 --wait"])],
        "pmacctl-resume" => &[("Go on after a hold:", &["pmacctl hold 1", "pmacctl resume 1"])],
        "pmacctl-step" => &[("One step of two programs:", &["pmacctl step 1 2"])],
        "pmacctl-hold" => &[("Pause the program of coordinate system 1:", &["pmacctl hold 1"])],
        "pmacctl-read" => &[(
            "Three registers, and four bits of one:",
            &["pmacctl read 'Y:$D001' 0x0024 'D:$D014' 'Y:$D001,8,4'"],
        )],
        "pmacctl-write" => &[
            ("An open word:", &["pmacctl write 'Y:$D800' -5"]),
            ("Four bits of it, from bit 8 on:", &["pmacctl write 'Y:$D800,8,4' 3"]),
        ],
        "pmacctl-panel" => &[
            ("What the panel was asked last:", &["pmacctl panel show"]),
            ("Half the feed rate in coordinate system 1:", &["pmacctl panel feed 1 50%"]),
        ],
        "pmacctl-send" => &[
            ("A question:", &["pmacctl send '#1P'"]),
            ("A command that moves:", &["pmacctl send '#1J=3000'"]),
            ("A control character:", &["pmacctl send '^K'"]),
        ],
        "pmacctl-rotary" => &[
            ("What a program compiles to:", &["pmacctl rotary encode engrave.pmc"]),
            (
                "Define the board's buffer, stream a program and run it, then end it:",
                &["pmacctl rotary stream engrave.pmc --define 1000 --run", "pmacctl send '&1Q'"],
            ),
            (
                "Whether the board reads such commands as they are meant:",
                &["pmacctl rotary check --define 1000"],
            ),
        ],
        "pmacctl-variable" => &[
            (
                "Two registers and a position, ten times a second:",
                &["pmacctl variable watch 'X:$0000' 'Y:$0770,u' 1.actual_position --rate 10"],
            ),
            (
                "Variables beside them, which are asked for by command line:",
                &["pmacctl variable watch 1.actual_position P1 M102 I122"],
            ),
            ("Write one, and four bits of another:", &["pmacctl variable set 'X:$0771=-2' 'Y:$0770,8,4=5'"]),
        ],
        "pmacctl-gather" => &[
            (
                "Half a second of motor 1, every servo cycle:",
                &[
                    "pmacctl gather --source 1.actual_position --source 1.commanded_position --seconds 0.5 -o data.csv",
                ],
            ),
            (
                "A jog that is sent once the board gathers, with a picture:",
                &[
                    "pmacctl gather -s 1.actual_position --seconds 1 --then '#1J:1000' -o data.csv --plot data.svg",
                ],
            ),
            ("End a gather that was left running:", &["pmacctl gather --stop"]),
        ],
        "pmacctl-log" => &[
            (
                "Motors 1 and 2, until ^C, and a picture of it:",
                &["pmacctl log --motors 1,2 -o run.csv --plot run.svg"],
            ),
            (
                "For days, in files of 100 MB, of which 10 GB stay:",
                &["pmacctl log -o run.csv --rotate-bytes 100M --keep 10G"],
            ),
        ],
        "pmacctl-plot" => &[
            ("What gather or log wrote:", &["pmacctl plot run.csv -o run.svg"]),
            ("One column of it:", &["pmacctl plot run.csv --columns 1.following_error -o run.svg"]),
            (
                "The difference of two columns:",
                &["pmacctl plot data.csv --columns 1.commanded_position-1.actual_position -o run.svg"],
            ),
        ],
        "pmacctl-tune" => &[
            ("A step of 200 counts, with a picture:", &["pmacctl tune step 1 --size 200 --plot step.svg"]),
            (
                "2000 counts there and back, to judge feed forward:",
                &["pmacctl tune parabolic 1 --size 2000 --yes"],
            ),
        ],
        "pmacctl-abort" => &[
            ("Every motion:", &["pmacctl abort"]),
            ("Coordinate systems 1 and 2 only:", &["pmacctl abort 1 2"]),
        ],
        "pmacctl-kill" => &[("Every motor:", &["pmacctl kill"])],
        "pmacctl-terminal" => &[("With more time for every line:", &["pmacctl terminal --timeout 30"])],
        "pmacctl-download" => &[
            ("What would be sent:", &["pmacctl download --dry-run program.pmc"]),
            ("Send it, after CLOSE and DELETE GATHER:", &["pmacctl download --prologue program.pmc"]),
        ],
        "pmacctl-backup" => &[
            ("All I-variables:", &["pmacctl backup --what I -o saved.pmc"]),
            ("Does the board still hold them?", &["pmacctl backup --check saved.pmc --what I"]),
        ],
        "pmacctl-diff" => &[("What the board has otherwise than a file:", &["pmacctl diff saved.pmc"])],
        "pmacctl-restore" => &[
            ("What would be sent:", &["pmacctl restore --dry-run saved.pmc"]),
            ("Send it without asking:", &["pmacctl restore --yes saved.pmc"]),
        ],
        "pmacctl-setup" => &[
            (
                "The lines that place the DPRAM of an ISA board, explained:",
                &["pmacctl setup isa --address 0xD4000"],
            ),
            (
                "Switch servo and background data on, and send the lines over a serial line:",
                &["pmacctl setup enable servo background --send --port /dev/ttyS0"],
            ),
        ],
        "pmacd.toml" => &[(
            "A UIO board. Live data are for group pmac alone; two groups may do more than look:",
            &[
                "board = \"uio:/dev/uio0\"",
                "segment_mode = \"0640\"",
                "servo_reading = \"handshake\"",
                "[servo]",
                "motors = [1, 2, 3]",
                "[roles]",
                "stop = [\"pmac-stop\"]",
                "operate = [\"pmac-operator\"]",
                "engineer = [\"pmac-engineer\"]",
            ],
        )],
        _ => &[],
    }
}

/// The exit statuses of a page's program.
pub fn statuses(page: &str) -> &'static [(&'static str, &'static str)] {
    match page {
        "pmacd" | "pmacd.toml" => &[
            ("0", "It was asked to end."),
            ("64", "The command line is wrong."),
            ("69", "The board, its name or its socket is unavailable. The service is started again."),
            ("70", "A defect of pmacd. The service is started again."),
            ("71", "The system refused memory, a descriptor or a thread. The service is started again."),
            (
                "75",
                "The board has not taken the stop of a held jog: a motor may still move. The log names it.",
            ),
            ("77", "A right is missing."),
            ("78", "The configuration is wrong."),
        ],
        "pmac-sim" => &[
            ("0", "It was asked to end."),
            ("1", "It failed while it ran."),
            ("2", "The request could not be made: an option, a file or a socket."),
        ],
        _ => &[
            ("0", "Done."),
            ("1", "The answer is no, or the board or the daemon refused."),
            ("2", "The request could not be made: an option, a file, no daemon."),
        ],
    }
}

/// What else to read.
fn also(page: &str) -> &'static [&'static str] {
    match page {
        "pmacd" => &["pmacctl(1)", "pmac-sim(1)", "pmacd.toml(5)", "systemd.unit(5)"],
        "pmacd.toml" => &["pmacd(8)", "pmacctl(1)", "systemd.unit(5)"],
        "pmac-sim" => &["pmacd(8)", "pmacctl-demo(1)"],
        "pmacctl" => &["pmacd(8)", "pmacd.toml(5)", "pmac-sim(1)"],
        _ => &["pmacctl(1)", "pmacd(8)"],
    }
}

/// The sections behind what the command line's definition gives.
pub fn complete(page: &mut Page, name: &str) {
    for Names { title, about, names } in names(name) {
        page.section(title);
        page.text(about);
        page.paragraph();
        page.markup(&(names.iter().map(|name| bold(name)).collect::<Vec<_>>().join(", ") + "."));
    }
    for Entries { title, about, entries } in entries(name) {
        page.section(title);
        page.text(about);
        for (typed, about) in entries {
            page.entry(&bold(typed), &about);
        }
    }
    page.section("EXAMPLES");
    for (about, lines) in examples(name) {
        page.text(about);
        page.typed(lines);
        page.paragraph();
    }
    page.section("EXIT STATUS");
    for (status, about) in statuses(name) {
        page.entry(&bold(status), about);
    }
    page.section("SEE ALSO");
    let also = also(name).iter().map(|page| match page.split_once('(') {
        Some((name, section)) => format!("{}({section}", bold(name)),
        None => bold(page),
    });
    page.markup(&also.collect::<Vec<_>>().join(", "));
}
