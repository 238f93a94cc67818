//! Starts and stops the daemon: the whole order in one place.
//!
//! settings → a look at the board → board → privileges given up → segment → socket → bus thread → wait for a signal →
//! the same backwards. If the board needs no special right, the daemon takes the name before it opens the board, so
//! that a second daemon learns which daemon has the name.

use std::ffi::OsString;
use std::io::Write;
use std::process::{ExitCode, ExitStatus};
use std::sync::Arc;
use std::time::Duration;

use clap::Parser;
use log::{Level, info, warn};

use super::config::settings::Settings;
use super::exit::{self, Failure};
use super::machine::Machine;
use super::options::Options;
use super::parts::{Parts, segment_options};
use super::recognise;
use super::service::journal;
use super::service::privilege::{self, Account, Holdings};
use super::service::simulator::Simulator;
use super::service::socket_directory;
use super::service::state_file::StateFile;
use super::service::supervisor::{Manager, Signals, until_asked_to_end};
use super::shared::definition_blocks::DefinitionBlocks;
use super::shared::trouble::Trouble;
use super::socket::options::ServeOptions;
use super::socket::server::serve;
use crate::clock::{Clock, ManualTime};
use crate::device::system::cpu_latency::NODE;
use crate::device::system::descriptors::{allow_descriptors, descriptors_left};
use crate::device::system::scheduling::scheduling;
use crate::device::{BoardSpec, CpuLatency, Inherited, System};
use crate::format::Visible;
use crate::process::log_sink::{LogSink, LogWriter};
use crate::process::survive_file_size_limit;
use crate::protocol::socket_place::socket_places;
use crate::segment::{Publisher, end_on_bus_error};
use crate::usage::usage_with;

/// How long ago a replay in virtual time begins. A longer recording goes on in real time.
const LONGEST_RECORDING: Duration = Duration::from_secs(24 * 3600);

/// Files that pmacd opens: 15 to 20 of its own, 16 that it keeps back, and two for each of a few clients.
const FEWEST_DESCRIPTORS: usize = 48;

/// The message when mapped memory is gone.
const MEMORY_GONE: &str = "pmacd: SIGBUS, memory that was mapped is gone: perhaps somebody has truncated the segment in /dev/shm or the file \
    of the board's window, or the board has gone; pmacd ends, and its next start makes the segment again\n";

/// The whole program. It exits with a status of [`exit`].
#[must_use]
pub fn main() -> ExitCode {
    main_with(std::env::args_os())
}

/// As [`main`], with these arguments, the program's name first. Needs a process with one thread, or a test.
#[must_use]
pub fn main_with(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    // Without this, a full file ends the program without a word.
    let _ = survive_file_size_limit();
    let _ = end_on_bus_error(MEMORY_GONE, exit::UNAVAILABLE);
    let in_journal = journal::is_journal(&std::io::stderr());
    let (log, mut log_writer) =
        LogSink::new(std::io::stderr(), if in_journal { journal::prefix(Level::Warn) } else { "[WARN ] " });
    let mut logger = env_logger::Builder::from_env(env_logger::Env::default().default_filter_or("info"));
    if in_journal {
        logger.format(journal::write);
    } else {
        logger.format(journal::write_words);
    }
    logger.target(env_logger::Target::Pipe(Box::new(log.clone()))).init();
    let options = match Options::try_parse_from(arguments) {
        Ok(options) => options,
        Err(error) => return usage_with("pmacd", &error, exit::USAGE),
    };
    let ended = Settings::decide(&options)
        .map_err(|error| {
            Failure::new(if error.is_typed() { exit::USAGE } else { exit::CONFIGURATION }, error)
        })
        .and_then(|settings| if options.check { Ok(()) } else { run(&settings, &options, &mut log_writer) });
    // The thread may not have started yet: writes the log so far.
    let _ = log_writer.start();
    log.finish();
    match ended {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            // `eprintln!` would panic if stderr is closed.
            let prefix = if in_journal { journal::prefix(Level::Error) } else { "pmacd: " };
            let _ = writeln!(std::io::stderr(), "{prefix}{}", Visible(&failure));
            ExitCode::from(failure.status)
        }
    }
}

fn run(settings: &Settings, options: &Options, log: &mut LogWriter) -> Result<(), Failure> {
    // First of all: from now on the daemon queues signals.
    let mut signals = Signals::take().map_err(|error| Failure::system("signals", error))?;
    let mut manager = Manager::from_environment();
    let account = options.user.as_deref().map(Account::named).transpose()?;
    let stays_root = account.is_none() && nix::unistd::geteuid().is_root();
    if stays_root {
        warn!("running as root; the unit file, or --user, is safer");
    }
    privilege::allow_locking();
    allow_descriptors();
    enough_descriptors()?;
    let inherited = Inherited::take_all();
    let settings = &recognise::settled_now(settings.clone(), options, &inherited)?;
    let _cpu_latency = settings.cpu_latency_us.and_then(|latency_us| cpu_latency(latency_us, &inherited));
    let virtual_time = matches!(settings.board, BoardSpec::Replay { at_once: true, .. })
        .then(|| ManualTime::ago(LONGEST_RECORDING));
    let clock = virtual_time.as_ref().map_or_else(Clock::real, ManualTime::clock);
    let early =
        needs_rights(&settings.board).then(|| Machine::open(settings, &inherited, &clock)).transpose()?;
    let usual = socket_places(settings.name.as_str());
    let socket = socket_directory::prepare(settings.socket.as_deref(), &usual, account.as_ref())?;
    if !stays_root {
        privilege::give_up(account.as_ref())?;
    }
    if let Some(parent) = options.with_parent {
        // This comes after the change of user, which would undo it.
        crate::process::end_with_parent(parent).map_err(|error| Failure::new(exit::SYSTEM, error))?;
    }
    // A long recording takes seconds to read. A daemon that reads must not look like one that hangs.
    let early = match early {
        None if matches!(settings.board, BoardSpec::Replay { .. }) => {
            Some(Machine::open(settings, &inherited, &clock)?)
        }
        early => early,
    };
    let publisher = Publisher::create(&segment_options(settings, &clock)?)?;
    let (mut keeper, mut trouble) = (publisher.keeper()?, Trouble::default());
    let machine = match early {
        Some(machine) => machine,
        None => Machine::open(settings, &inherited, &clock)?,
    };
    // Closes the inherited descriptors: /dev/mem would give access to all of physical memory.
    drop(inherited);
    let state = StateFile::of(settings.name.as_str());
    let blocks = Arc::new(DefinitionBlocks::new(state.blocks()));
    let parts = Parts::new(settings, machine, publisher, clock, Arc::clone(&blocks))?;
    let Parts { board_loop, backend, stop, mut simulator } = parts;
    let pulse = backend.info.pulse();
    let serve_options = ServeOptions {
        mode: settings.socket_mode,
        group: settings.socket_group.clone(),
        roles: settings.roles.clone(),
        stop_all_after: settings.stop_all_after,
        ..ServeOptions::new(socket.clone())
    };
    let listener = serve_options.listen()?;
    if stays_root {
        // The steps above need root's right to other users' directories. Give it up now.
        privilege::give_up(None)?;
    }
    // Start threads only now: a thread keeps the rights that it starts with.
    log.start().map_err(|error| Failure::system("the log's thread", error))?;
    let server = serve(&serve_options, listener, backend)?;

    let bus_thread = std::thread::Builder::new()
        .name("bus".to_owned())
        .spawn(move || match &virtual_time {
            Some(time) => board_loop.run_in(time),
            None => board_loop.run(),
        })
        .map_err(|error| Failure::system("the bus thread", error))?;
    info!(
        "pmacd {} serves board {} as {} on {}",
        env!("CARGO_PKG_VERSION"),
        settings.board_text,
        settings.name.as_str(),
        socket.display()
    );

    info!("runs as {}, {}, scheduling {}", Holdings::read(), privilege::lock_memory(), scheduling());
    manager.ready(&pulse);

    let mut simulator_ended = None;
    let asked = until_asked_to_end(&mut signals, &mut manager, &pulse, || {
        if let Some(found) = blocks.take_changed() {
            state.keep(found);
        }
        trouble.note(keeper.tend());
        simulator_ended = simulator.as_mut().and_then(Simulator::ended);
        simulator_ended.is_some() || bus_thread.is_finished()
    });
    manager.stopping();
    // End the socket first: it then makes the bus thread stop held jogs.
    let may_move = server.stop();
    let _ = stop.write(1);
    let bus_thread_ended = bus_thread.join().is_err() || asked.is_none();
    how_it_ended(simulator_ended, bus_thread_ended, !may_move.is_empty())
}

/// Fails if the process may open too few files for its clients.
fn enough_descriptors() -> Result<(), Failure> {
    let left = descriptors_left();
    if left >= FEWEST_DESCRIPTORS {
        return Ok(());
    }
    let cure = "raise the limit (LimitNOFILE= of the unit, ulimit -n)";
    let reason = format!("{left} more files may be opened, and pmacd needs {FEWEST_DESCRIPTORS}: {cure}");
    Err(Failure::new(exit::SYSTEM, reason))
}

/// The daemon's exit status, and its reason unless that is "as asked".
fn how_it_ended(
    simulator_ended: Option<ExitStatus>,
    bus_thread_ended: bool,
    may_move: bool,
) -> Result<(), Failure> {
    let (status, reason) = if let Some(status) = simulator_ended {
        let reason =
            format!("the simulator ended by itself ({status}), and with it the board; start pmacd again");
        (exit::UNAVAILABLE, reason)
    } else if bus_thread_ended {
        (exit::SOFTWARE, "the bus thread ended by itself, which is a defect; see the log".to_owned())
    } else if may_move {
        (exit::MAY_MOVE, "ended though a motor whose jog was held may still move; see the log".to_owned())
    } else {
        return Ok(());
    };
    Err(Failure::new(status, reason))
}

/// Asks the kernel for processors that wake up fast. Without them the daemon works, but later, so it logs a refusal.
fn cpu_latency(latency_us: u32, inherited: &Inherited) -> Option<CpuLatency> {
    match CpuLatency::hold(latency_us, &System::here(), inherited) {
        Ok(held) => {
            info!("the machine's processors wake up within {latency_us} us");
            Some(held)
        }
        Err(error) => {
            warn!(
                "cpu_latency_us = {latency_us} has no effect: {NODE}: {error}; start as root, or see the drop-in wake-up.conf"
            );
            None
        }
    }
}

/// Whether only a privileged process can open this board.
fn needs_rights(board: &BoardSpec) -> bool {
    matches!(board, BoardSpec::Window(_))
}
