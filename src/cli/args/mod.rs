//! The arguments of `pmacctl`.

pub mod values;

use std::ffi::OsString;
use std::path::PathBuf;

use clap::error::{ContextKind, ContextValue};
use clap::{Args as ClapArgs, CommandFactory, FromArgMatches, Parser, Subcommand};

use crate::cli::act::drive::Home;
use crate::cli::act::jog::Jog;
use crate::cli::act::panel::{Panel, Programs, Systems};
use crate::cli::act::registers::Variable;
use crate::cli::act::send::Send;
use crate::cli::act::set_position::SetPosition;
use crate::cli::act::stop::Abort;
use crate::cli::act::terminal::Terminal;
use crate::cli::act::write::Write;
use crate::cli::capture::Capture;
use crate::cli::doctor::Doctor;
use crate::cli::explain::Explain;
use crate::cli::files::backup::{Backup, Diff, Restore};
use crate::cli::files::download::Download;
use crate::cli::gather::Gather;
use crate::cli::log::Log;
use crate::cli::plot::Plot;
use crate::cli::rotary::Rotary;
use crate::cli::setup::absolute::Absolute;
use crate::cli::setup::send::Setup;
use crate::cli::show::bits::{MotorBits, SystemBits};
use crate::cli::show::decode::Decode;
use crate::cli::show::demo::Demo;
use crate::cli::show::map::Map;
use crate::cli::show::read::Read;
use crate::cli::show::watch::Watch;
use crate::cli::top::Top;
use crate::cli::tune::Tune;

/// Reads and commands a PMAC through its daemon pmacd.
#[derive(Debug, Parser)]
#[command(name = "pmacctl", version, arg_required_else_help = true, disable_help_subcommand = true)]
#[command(override_help = include_str!("help.txt"))]
pub struct Args {
    #[command(flatten)]
    pub global: Global,
    #[command(subcommand)]
    pub command: Command,
}

/// The help heading of the global options.
const GLOBAL: &str = "Options of every command";

#[derive(Debug, ClapArgs)]
pub struct Global {
    /// The board's name [default: that of --socket, else pmac0]
    #[arg(long, global = true, help_heading = GLOBAL, value_name = "NAME")]
    pub name: Option<String>,
    /// The daemon's socket [default: /run/pmacd/NAME.sock, else $XDG_RUNTIME_DIR/pmacd/NAME.sock]
    #[arg(long, global = true, help_heading = GLOBAL, value_name = "PATH")]
    pub socket: Option<PathBuf>,
    /// Print JSON
    #[arg(long, global = true, help_heading = GLOBAL)]
    pub json: bool,
    /// Suppress output; use the exit status
    #[arg(long, short, global = true, help_heading = GLOBAL)]
    pub quiet: bool,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run a simulated board, its daemon and a live view in a private directory. Leaves nothing behind
    Demo(Demo),
    /// Show the state of the daemon, its board and its data
    Status,
    /// Check everything between you and live data, and say what to do. Find boards in this machine
    Doctor(Doctor),
    /// Show positions, velocities and status of the activated motors (Ix00=1)
    Motors,
    /// Show the coordinate systems' targets and status
    Coordinates,
    /// Show every status bit of a motor, the words of ?, and what each means
    Motor(MotorBits),
    /// Show every status bit of a coordinate system (??) or of the board (???), and what each means
    System(SystemBits),
    /// Explain an I-variable, an error, an address or a status bit (needs no daemon)
    Explain(Explain),
    /// Show the motors or coordinate systems live: repainted on a terminal, one line a print in a pipe
    Watch(Watch),
    /// Show motors, coordinate systems, health and watched values on one screen; jog with armed keys
    Top(Top),
    /// Read DPRAM addresses, written as in the manual
    Read(Read),
    /// Write words or bits of the DPRAM's free area; with --engineer any word
    Write(Write),
    /// Move a motor by hand: to a position or in a direction (role operate), or to a stop (role stop)
    Jog(Jog),
    /// Search for the home of motors. Role operate
    Home(Home),
    /// Tell a motor that stands at which position it is, after asking. Nothing moves; software limits count from there.
    /// While the loop is closed, only 0 can be set (HMZ). Role engineer
    SetPosition(SetPosition),
    /// Run the programs of coordinate systems that run none, from where each stands. Exit status 1: pmacctl did not see a
    /// program run. Role operate
    Run(Programs),
    /// Run the programs of coordinate systems on after hold, step or a stop. Role operate
    Resume(Programs),
    /// Execute one step of the programs of coordinate systems. A running program stops, as after Q. Role operate
    Step(Systems),
    /// Hold the feed of coordinate systems: their programs pause, and resume goes on. Role stop
    Hold(Systems),
    /// Override the feed rate, home motors, run, step, hold and stop programs through the control panel (I2=3). Role
    /// operate; to stop and hold, role stop
    Panel(Panel),
    /// Send a command line (role engineer), or a control character as '^K', and print the reply
    Send(Send),
    /// Compile motion programs to binary rotary commands, decode them, or stream them to the board
    Rotary(Rotary),
    /// Have the board copy or write registers in its background (I55=1)
    Variable(Variable),
    /// Sample registers at servo rate into a .csv or .npy file (I20 to I45, DEFINE GATHER, GATHER, ENDGATHER)
    Gather(Gather),
    /// Write every servo update to a .csv or .npy file, with exact counts of missing updates. Only reads
    Log(Log),
    /// Draw a file of gather or log as SVG (needs no daemon)
    Plot(Plot),
    /// Move a motor, record its response, and print rise time, overshoot, settling time and following error. Role engineer.
    /// Moves the machine, after asking
    Tune(Tune),
    /// Abort all motion at once by ^A, or the motion of some coordinate systems. Exit status 0: the board took the abort
    Abort(Abort),
    /// Kill every motor at once by ^K: every loop opens; a vertical axis without a brake falls. Exit status 0: the board
    /// took the kill
    Kill,
    /// Talk to the board line by line, with editing, history and the messages of its programs. Works in a pipe, too
    Terminal(Terminal),
    /// Send a program or command file line by line. Removes comments and resolves #include and #define
    Download(Download),
    /// Save the board's variables, axis definitions and programs as lines that can be sent again
    Backup(Backup),
    /// Show the differences between a file that backup wrote and the board or another file
    Diff(Diff),
    /// Send the lines of a backup's file that differ from the board's values, after asking
    Restore(Restore),
    /// Show and explain the lines that set up a board; --send sends them
    Setup(Setup),
    /// List the registers, decode an image, record the board, explain an absolute-position setting
    Board {
        #[command(subcommand)]
        command: Rare,
    },
    /// The spellings of old.
    #[command(flatten)]
    Rare(Rare),
}

#[derive(Debug, Subcommand)]
pub enum Rare {
    /// List the registers of the DPRAM with their addresses (needs no daemon)
    Map(Map),
    /// Decode a raw image of the DPRAM from a file
    Decode(Decode),
    /// Record a board for another person or a test: identity, variables, images of the DPRAM, bus accesses of pmacd. Only
    /// reads; role engineer
    Capture(Capture),
    /// Explain which registers an absolute-position setting makes the board read (needs no daemon)
    Absolute(Absolute),
}

/// The definition of the command line, without the old spellings in its help.
pub fn command() -> clap::Command {
    let hidden = |command: clap::Command, old: &clap::Command| {
        command.mut_subcommand(old.get_name(), |old| old.hide(true))
    };
    let rare = Rare::augment_subcommands(clap::Command::new("board"));
    rare.get_subcommands().fold(Args::command(), hidden)
}

/// Reads a command line.
///
/// # Errors
/// Those of clap.
pub fn parse(line: impl IntoIterator<Item = OsString>) -> Result<Args, clap::Error> {
    let mut command = command();
    let matches = command.try_get_matches_from_mut(line)?;
    Args::from_arg_matches(&matches).map_err(|error| error.format(&mut command))
}

/// Words that users of other programs type, and what they mean here: commands of PEWIN, of EPICS, of shells, of old
/// clients.
const HABITS: &[(&str, &str)] = &[
    ("stop halt brake", "abort, or for one motor pmacctl jog MOTOR stop"),
    ("home-all homeall homing search find-home", "home MOTOR…"),
    ("zero setpos set-pos set-zero setposition define-position preset", "set-position MOTOR =VALUE"),
    ("start go execute exec", "run C.S."),
    ("feedhold feed-hold pause suspend", "hold C.S."),
    ("continue cont unhold unpause", "resume C.S."),
    ("single-step singlestep next", "step C.S."),
    ("move moveto move-to goto mv", "jog MOTOR =POSITION"),
    ("jog+ jog- jog-stop jogstop", "jog MOTOR +, - or stop"),
    ("pre-jog feed override feedrate", "panel"),
    ("position positions pos where axis axes velocity", "motors"),
    ("systems coordinate cs", "coordinates"),
    ("monitor live follow", "watch"),
    ("info health state ping", "status"),
    ("version ver", "--version, and of the board pmacctl status"),
    ("boards check diagnose", "doctor"),
    ("describe meaning bits", "explain"),
    ("get peek dump", "read, or for a variable pmacctl send P1"),
    ("set poke", "write, or for a variable pmacctl send P1=5"),
    ("command cmd ask query", "send"),
    ("console shell talk connect", "terminal"),
    ("encode stream", "rotary"),
    ("load", "download"),
    ("save", "backup, and for the board's own memory pmacctl send SAVE"),
    ("export upload", "backup"),
    ("import", "restore"),
    ("reset reboot reinit restart", "send '$$$', which stops everything and loads what was saved"),
    (
        "enable servo servo-on close-loop closeloop on",
        "send '#1J/', which closes the loop of motor 1 where it stands",
    ),
    (
        "disable servo-off open-loop off",
        "send '#1K' for motor 1, for every motor kill, for a PLC send 'DISABLE PLC 1'",
    ),
    ("estop e-stop emergency", "abort, which brakes everything, or pmacctl kill"),
    ("record trace", "log"),
    ("sample scope", "gather"),
    ("draw", "plot"),
    ("registers addresses", "board map"),
    ("isa vme", "setup"),
    ("sim simulate", "demo"),
    ("help", "--help"),
];

/// Text that names the wrong verb in `error` and the right one, if users are known to confuse the two.
pub fn right_verb(error: &clap::Error) -> Option<String> {
    let Some(ContextValue::String(typed)) = error.get(ContextKind::InvalidSubcommand) else { return None };
    let is_habit = |(words, _): &&(&str, &str)| words.split(' ').any(|word| word == typed);
    let right = match HABITS.iter().find(is_habit) {
        Some((_, right)) => right,
        // `panel run`, `board backup`.
        None => Args::command().find_subcommand(typed).map(|_| typed.as_str())?,
    };
    Some(format!("there is no command {typed} here; it is pmacctl {right}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tree_is_sound() {
        command().debug_assert();
    }

    #[test]
    fn the_help_fits_a_screen_and_names_every_verb_once() {
        let help = command().render_help().to_string();
        assert!(help.lines().count() <= 40 && help.lines().all(|line| line.chars().count() <= 100), "{help}");
        let rows = help.lines().skip(4).take_while(|line| !line.is_empty());
        let cells = rows.map(|row| row.chars().skip(10).take(29).collect::<String>());
        let mut told: Vec<String> =
            cells.flat_map(|cell| cell.split(" · ").map(first_word).collect::<Vec<_>>()).collect();
        let command = command();
        let mut verbs: Vec<String> = command
            .get_subcommands()
            .filter(|verb| !verb.is_hide_set())
            .map(|verb| verb.get_name().to_owned())
            .collect();
        told.sort();
        verbs.sort();
        assert_eq!(told, verbs);
    }

    fn first_word(text: &str) -> String {
        text.split_whitespace().next().unwrap_or_default().to_owned()
    }

    #[test]
    fn old_spellings_do_the_same() {
        for line in
            ["map --family turbo2", "decode x.bin --motors 2", "capture x", "absolute --ix10 0x8D0010"]
        {
            let of = |start: &str| {
                let line = format!("{start} {line}");
                format!("{:?}", parse(line.split(' ').map(OsString::from)).unwrap().command)
            };
            let (old, new) = (of("pmacctl"), of("pmacctl board"));
            assert_eq!(
                new,
                old.replacen("Rare(", "Board { command: ", 1).trim_end_matches(')').to_owned() + ") }"
            );
        }
    }

    #[test]
    fn a_wrong_verb_is_told_the_right_one() {
        let told = |verb: &str| right_verb(&parse(["pmacctl", verb].map(OsString::from)).unwrap_err());
        assert_eq!(
            told("feedhold").as_deref(),
            Some("there is no command feedhold here; it is pmacctl hold C.S.")
        );
        assert_eq!(told("frobnicate"), None);
        let nested = right_verb(&parse(["pmacctl", "panel", "run", "1"].map(OsString::from)).unwrap_err());
        assert_eq!(nested.as_deref(), Some("there is no command run here; it is pmacctl run"));
    }

    #[test]
    fn every_habit_is_told_once_and_leads_to_a_command() {
        let command = command();
        let words: Vec<&str> = HABITS.iter().flat_map(|(words, _)| words.split(' ')).collect();
        for (index, word) in words.iter().enumerate() {
            assert!(!words[..index].contains(word) && command.find_subcommand(word).is_none(), "{word}");
        }
        for (_, right) in HABITS {
            let verb = right.split([' ', ',']).next().unwrap();
            assert!(verb.starts_with("--") || command.find_subcommand(verb).is_some(), "{right}");
        }
    }

    #[test]
    fn global_options_stand_before_or_after_the_command() {
        for line in ["pmacctl --name rig --json motors", "pmacctl motors --json --name rig"] {
            let args = parse(line.split(' ').map(OsString::from)).unwrap();
            assert_eq!((args.global.name.as_deref(), args.global.json), (Some("rig"), true));
        }
    }

    #[test]
    fn the_options_of_every_command_stand_apart_in_its_help() {
        let mut command = command();
        command.build();
        for name in ["gather", "watch", "backup"] {
            let help = command.find_subcommand_mut(name).unwrap().render_help().to_string();
            let (own, global) = help.split_once(&format!("{GLOBAL}:\n")).unwrap();
            for option in ["--name", "--socket", "--json", "--quiet"] {
                assert!(!own.contains(option) && global.contains(option), "{help}");
            }
            assert!(own.contains("--help") && !global.contains("--seconds"), "{help}");
        }
    }
}
