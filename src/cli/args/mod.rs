//! The arguments of `pmacctl`.

pub mod values;

use std::path::PathBuf;

use clap::{Args as ClapArgs, Parser, Subcommand};

use crate::cli::act::jog::Jog;
use crate::cli::act::panel::Panel;
use crate::cli::act::registers::Variable;
use crate::cli::act::send::Send;
use crate::cli::act::stop::Abort;
use crate::cli::act::terminal::Terminal;
use crate::cli::act::write::Write;
use crate::cli::capture::Capture;
use crate::cli::doctor::Doctor;
use crate::cli::files::backup::{Backup, Diff, Restore};
use crate::cli::files::download::Download;
use crate::cli::gather::Gather;
use crate::cli::log::Log;
use crate::cli::plot::Plot;
use crate::cli::rotary::Rotary;
use crate::cli::setup::absolute::Absolute;
use crate::cli::setup::send::Setup;
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
#[command(
    after_help = "Exit status: 0 done; 1 the answer is no, or the board or the daemon refused; 2 the request could not be made."
)]
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
    /// Run a simulated board, its daemon and a live view in a private directory. Needs nothing and leaves nothing behind
    Demo(Demo),
    /// Show the state of the daemon, its board and its data
    Status,
    /// Check everything between this user and live data, and say what to do. Find boards in this machine
    Doctor(Doctor),
    /// Record a board for somebody else to look at, or for a test: identity, variables, images of the DPRAM, what pmacd reads and
    /// writes. Only reads; role engineer
    Capture(Capture),
    /// Show positions, velocities and status of the motors that are activated (Ix00=1)
    Motors,
    /// Show the coordinate systems' targets and status
    Coordinates,
    /// Show the motors or coordinate systems live: repainted on a terminal, one line a print in a pipe
    Watch(Watch),
    /// Show motors, coordinate systems, health and watched values on one screen; jog with keys that are armed first
    Top(Top),
    /// List the registers of the DPRAM with their addresses (needs no daemon)
    Map(Map),
    /// Read DPRAM addresses, written as in the manual
    Read(Read),
    /// Write words or bits of the DPRAM's free area; with --engineer any word
    Write(Write),
    /// Move one motor by hand: to a position or in a direction (role operate), or to a stop (role stop)
    Jog(Jog),
    /// Jog, home, run, stop and override the feed rate through the control panel (I2=3). Role operate; to
    /// stop and hold, role stop
    Panel(Panel),
    /// Send a command line (role engineer), or a control character as '^K', and print the reply
    Send(Send),
    /// Decode a raw image of the DPRAM from a file
    Decode(Decode),
    /// Compile motion programs to binary rotary commands, decode them, or stream them to the board
    Rotary(Rotary),
    /// Have PMAC copy or write registers in its background (I55=1)
    Variable(Variable),
    /// Sample registers at servo rate into a .csv or .npy file (I20 to I45, DEFINE GATHER, GATHER, ENDGATHER)
    Gather(Gather),
    /// Write every servo update to a .csv or .npy file, with exact counts of what is missing. Only reads
    Log(Log),
    /// Draw a file that gather or log wrote, as SVG (needs no daemon)
    Plot(Plot),
    /// Move a motor, gather its answer and tell rise time, overshoot, settling time and following error. Role engineer. It
    /// moves the machine, after asking
    Tune(Tune),
    /// Abort all motion at once by ^A, or that of some coordinate systems. Exit status 0: the board took it
    Abort(Abort),
    /// Kill every motor at once by ^K: every loop opens, no output; a vertical axis without a brake falls. Exit status 0: the board took it
    Kill,
    /// Talk to the board line by line, with editing, history and the messages of its programs. Works in a pipe too
    Terminal(Terminal),
    /// Send a program or command file line by line. Removes comments and resolves #include and #define
    Download(Download),
    /// Save the board's variables as sorted lines that can be sent again
    Backup(Backup),
    /// Show the differences between a file of variables and the board or another file
    Diff(Diff),
    /// Send the lines of a file of variables that differ from the board's values, after asking
    Restore(Restore),
    /// Show and explain the lines that set up a board; --send sends them
    Setup(Setup),
    /// Explain what an absolute-position setting makes PMAC read (needs no daemon)
    Absolute(Absolute),
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
            assert_eq!((args.global.name.as_deref(), args.global.json), (Some("rig"), true));
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
}
