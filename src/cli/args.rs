//! What can be typed after `pmacctl`.

use std::path::PathBuf;
use std::time::Duration;

use clap::{Args as ClapArgs, Parser, Subcommand, ValueEnum};

use super::absolute::Absolute;
use super::backup::{Backup, Diff, Restore};
use super::download::Download;
use super::gather::Gather;
use super::panel::Panel;
use super::rotary::Rotary;
use super::set_up::Setup;
use super::stop::Abort;
use super::terminal::Terminal;
use super::variable::Variable;
use super::write::Write;
use crate::format::{Float48Layout, WordOrder};
use crate::map::{Family, Firmware, GatherSizeWord, UnknownFamily};

/// Looks at and talks to a PMAC through its daemon pmacd.
#[derive(Debug, Parser)]
#[command(name = "pmacctl", version, arg_required_else_help = true, disable_help_subcommand = true)]
#[command(
    after_help = "Exit status: 0 done; 1 the answer is no, or the board or the daemon refused; 2 the request could not be made."
)]
pub struct Args {
    #[command(flatten)]
    pub global: Global,
    #[command(subcommand)]
    pub command: Command,
}

/// What these stand below among a command's own options.
const GLOBAL: &str = "Options of every command";

#[derive(Debug, ClapArgs)]
pub struct Global {
    /// Which board: the segment /dev/shm/NAME and the socket /run/pmacd/NAME.sock
    #[arg(long, global = true, help_heading = GLOBAL, value_name = "NAME", default_value = "pmac0")]
    pub name: String,
    /// The daemon's socket, when it lies elsewhere
    #[arg(long, global = true, help_heading = GLOBAL, value_name = "PATH")]
    pub socket: Option<PathBuf>,
    /// Print JSON
    #[arg(long, global = true, help_heading = GLOBAL)]
    pub json: bool,
    /// Print no results, only errors; the exit status tells
    #[arg(long, short, global = true, help_heading = GLOBAL)]
    pub quiet: bool,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// A simulated board, its daemon and a live view, all in a private place: nothing needed, nothing left behind
    Demo(Demo),
    /// How the daemon, its board and its data stand
    Status,
    /// Check everything between this user and live data, and say what to do; find boards in this machine
    Doctor(Doctor),
    /// The motors' positions, velocities and status, live
    Motors,
    /// The coordinate systems' targets and status, live
    Coordinates,
    /// The motors, again and again: repainted on a terminal, a line each time in a pipe
    Watch(Watch),
    /// What lies where in the DPRAM (needs no daemon)
    Map(Map),
    /// Read the DPRAM at addresses as the manual prints them
    Read(Read),
    /// Write open words of the DPRAM, whole or some bits; with --engineer any
    Write(Write),
    /// Jog, home, run, stop and override the feed rate through the control panel (I2=3); needs the role operate
    Panel(Panel),
    /// Send a command line (role engineer), or a control character as '^K' (role operate), and print the reply
    Send(Send),
    /// Decode a raw image of the DPRAM from a file
    Decode(Decode),
    /// Motion programs as binary rotary commands: compiled, turned back, or streamed to the board
    Rotary(Rotary),
    /// Registers of any kind, copied and written by PMAC in the background (I55=1)
    Variable(Variable),
    /// Sample registers at servo rate into a .csv or .npy file (I20 to I45, DEFINE GATHER, GATHER, ENDGATHER)
    Gather(Gather),
    /// Stop every motion at once, by ^A, or that of some coordinate systems; the exit status tells whether the board took it
    Abort(Abort),
    /// Kill every motor at once, by ^K: open loops, no output; the exit status tells whether the board took it
    Kill,
    /// A conversation with the board: line editing, history, and the texts its programs send; works in a pipe too
    Terminal(Terminal),
    /// Send a program or command file line by line, with its comments, #include and #define resolved
    Download(Download),
    /// The board's variables as lines that it would take again, one a line, sorted
    Backup(Backup),
    /// What differs between a file of variables and the board, or another file
    Diff(Diff),
    /// Send those lines of a file of variables that differ from what the board holds, after asking
    Restore(Restore),
    /// The lines that set a board up, explained, and sent when told to
    Setup(Setup),
    /// What an absolute-position setting makes PMAC read (needs no daemon)
    Absolute(Absolute),
}

#[derive(Debug, ClapArgs)]
pub struct Doctor {
    /// Look for boards in this machine, opening nothing, and say how each would be written after --board
    #[arg(long)]
    pub boards: bool,
    /// Open this board, read its window without writing to it, and say what seems to live there
    #[arg(long, value_name = "SPEC")]
    pub probe: Option<String>,
    /// Where /dev, /proc and /sys of the machine lie
    #[arg(long, value_name = "DIRECTORY", hide = true)]
    pub root: Option<PathBuf>,
}

#[derive(Debug, ClapArgs)]
pub struct Demo {
    /// Stop after so long; without it, on q or ^C
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub seconds: Option<Duration>,
    /// Views a second, at most
    #[arg(long, value_name = "HZ", default_value = "5", value_parser = rate)]
    pub rate: Duration,
}

#[derive(Debug, ClapArgs)]
pub struct Watch {
    /// Stop after so many prints; without it and --seconds, on q or ^C
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub count: Option<u64>,
    /// Stop after so long
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub seconds: Option<Duration>,
    /// Prints a second, at most
    #[arg(long, value_name = "HZ", default_value = "5", value_parser = rate)]
    pub rate: Duration,
}

#[derive(Debug, ClapArgs)]
pub struct Map {
    /// The board's family
    #[arg(long, value_name = "FAMILY", default_value = "pmac", value_parser = family)]
    pub family: &'static Family,
    /// The board's firmware, as VERSION answers; without it, the map as printed
    #[arg(long, value_name = "VERSION")]
    pub firmware: Option<Firmware>,
    /// Where firmware that moves the gather buffer keeps its size word
    #[arg(long, value_name = "WHERE", default_value = "with-index")]
    pub gather_size: GatherSize,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum GatherSize {
    WithIndex,
    AsPrinted,
}

impl From<GatherSize> for GatherSizeWord {
    fn from(choice: GatherSize) -> Self {
        match choice {
            GatherSize::WithIndex => Self::WithIndex,
            GatherSize::AsPrinted => Self::AsPrinted,
        }
    }
}

#[derive(Debug, ClapArgs)]
pub struct Read {
    /// Y:$D001, X:$D009, DP:$D200, D:$D014, L:$D09A, F:$D210, a host offset 0x0024, or bits as Y:$D001,8,4
    #[arg(required = true, value_name = "ADDR")]
    pub addresses: Vec<String>,
    /// The board's family, instead of the one the daemon says
    #[arg(long, value_name = "FAMILY", value_parser = family)]
    pub family: Option<&'static Family>,
    /// How L: values are laid out
    #[arg(long, value_name = "LAYOUT", default_value = "register")]
    pub float48: Float48,
}

#[derive(Debug, ClapArgs)]
pub struct Send {
    /// The line, or one control character as '^K'
    #[arg(value_name = "LINE", allow_hyphen_values = true)]
    pub line: String,
    /// How long the board may take, in seconds
    #[arg(long, value_name = "S", default_value = "5", value_parser = seconds)]
    pub timeout: Duration,
}

#[derive(Debug, ClapArgs)]
pub struct Decode {
    /// The image, as long as the family's DPRAM (16 KiB); - is stdin
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// The board's family
    #[arg(long, value_name = "FAMILY", default_value = "pmac", value_parser = family)]
    pub family: &'static Family,
    /// How many motors and coordinate systems it reported; all the family has when not given
    #[arg(long, value_name = "N")]
    pub motors: Option<usize>,
    /// Order of the bytes in each 16-bit word of the image
    #[arg(long, value_name = "ORDER", default_value = "little")]
    pub word_order: Order,
    /// How L: values are laid out
    #[arg(long, value_name = "LAYOUT", default_value = "register")]
    pub float48: Float48,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum Float48 {
    Register,
    Printed,
}

impl From<Float48> for Float48Layout {
    fn from(choice: Float48) -> Self {
        match choice {
            Float48::Register => Self::Register,
            Float48::Printed => Self::Printed,
        }
    }
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum Order {
    Little,
    Swapped,
}

impl From<Order> for WordOrder {
    fn from(choice: Order) -> Self {
        match choice {
            Order::Little => Self::Little,
            Order::Swapped => Self::Swapped,
        }
    }
}

fn family(name: &str) -> Result<&'static Family, UnknownFamily> {
    Family::by_name(name)
}

/// Some thirty years.
const LONGEST_S: f64 = 1e9;

pub fn seconds(text: &str) -> Result<Duration, String> {
    let seconds: f64 = text.parse().map_err(|_| "not a number of seconds".to_owned())?;
    if seconds > 0.0 && seconds <= LONGEST_S {
        Ok(Duration::from_secs_f64(seconds))
    } else {
        Err(format!("has to be above 0 and at most {LONGEST_S} seconds"))
    }
}

/// The time between two prints.
pub fn rate(text: &str) -> Result<Duration, String> {
    let hz: f64 = text.parse().map_err(|_| "not a number of prints a second".to_owned())?;
    if (0.001..=1000.0).contains(&hz) {
        Ok(Duration::from_secs_f64(1.0 / hz))
    } else {
        Err("not between 0.001 and 1000 a second".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_tree_is_sound() {
        Args::command().debug_assert();
    }

    #[test]
    fn global_options_stand_before_or_after_the_command() {
        for line in ["pmacctl --name rig --json motors", "pmacctl motors --json --name rig"] {
            let args = Args::try_parse_from(line.split(' ')).unwrap();
            assert_eq!((args.global.name.as_str(), args.global.json), ("rig", true));
        }
    }

    #[test]
    fn the_options_of_every_command_stand_apart_in_its_help() {
        let mut command = Args::command();
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

    #[test]
    fn numbers_out_of_reason_are_refused() {
        for text in ["0", "-1", "nan", "inf", "1e10", "x", ""] {
            assert!(seconds(text).is_err(), "{text}");
            assert!(rate(text).is_err(), "{text}");
        }
        for text in ["0", "1e99"] {
            assert_eq!(seconds(text), Err("has to be above 0 and at most 1000000000 seconds".to_owned()));
        }
        assert_eq!(seconds("0.5"), Ok(Duration::from_millis(500)));
        assert_eq!(rate("4"), Ok(Duration::from_millis(250)));
    }
}
