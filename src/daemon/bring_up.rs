//! From the command line to a running daemon, and back: the whole order in one place.
//!
//! settings → board → privileges given up → segment → socket → bus thread → wait for a signal → the same backwards. (A
//! board that needs no right to be opened is opened when the name is taken: a second daemon is then told whose it is.)

use std::ffi::OsString;
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

use clap::Parser;
use log::{Level, info, warn};
use nix::sys::eventfd::{EfdFlags, EventFd};

use super::ascii_desk::AsciiDesk;
use super::board::{self, Board};
use super::board_loop::BoardLoop;
use super::exit::{self, Failure};
use super::host_link::HostPortLink;
use super::identify::{Identifier, servo_period_ps};
use super::info::SharedInfo;
use super::job_desk::JobDesk;
use super::journal;
use super::log_sink::{LogSink, LogWriter};
use super::mailbox_link::MailboxLink;
use super::options::Options;
use super::policy::group_id;
use super::presence::Condition;
use super::privilege::{self, Account, Holdings};
use super::queue::{at_once, queue};
use super::response_port::ResponsePort;
use super::room::Room;
use super::serve::{Backend, ServeOptions, serve};
use super::settings::Settings;
use super::telling::Told;
use super::watch::{Manager, Signals, until_asked_to_end};
use crate::device::cpu_latency::NODE;
use crate::device::scheduling::scheduling;
use crate::device::{BoardSpec, Counted, CpuLatency, Inherited, System};
use crate::function::background::BACKGROUND_WORDS;
use crate::function::servo::SERVO_WORDS;
use crate::map::classic;
use crate::mirror::{BackgroundMirror, ServoMirror, background, gather, servo, variable};
use crate::protocol::{BoardInfo, Function, HostPortInfo};
use crate::segment::freshness::limit_ns;
use crate::segment::identity;
use crate::segment::{CreateOptions, Identity, Publisher, RegionId, RegionSpec, monotonic_ns};
use crate::usage::usage_with;

/// Slots of each region, for readers that sleep: servo, two seconds at the default rate; variables, a second at the rate of a PMAC's
/// background; background, a second (see [`background_slots`]); the board, a few changes.
const SERVO_SLOTS: u32 = 4096;
const VARIABLE_SLOTS: u32 = 1024;
const BOARD_SLOTS: u32 = 4;
/// Events that may wait for the socket's thread.
const EVENTS: usize = 256;

/// The whole program. Its exit statuses are those of [`exit`].
#[must_use]
pub fn main() -> ExitCode {
    main_with(std::env::args_os())
}

/// As [`main`], with these arguments, the program's name first. For a process with one thread, or a test.
#[must_use]
pub fn main_with(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let in_journal = journal::is_journal(&std::io::stderr());
    let (log, mut log_writer) =
        LogSink::new(std::io::stderr(), if in_journal { journal::prefix(Level::Warn) } else { "[WARN ] " });
    let mut logger = env_logger::Builder::from_env(env_logger::Env::default().default_filter_or("info"));
    logger.format_timestamp(None).format_target(false);
    if in_journal {
        logger.format(journal::write);
    }
    logger.target(env_logger::Target::Pipe(Box::new(log.clone()))).init();
    let options = match Options::try_parse_from(arguments) {
        Ok(options) => options,
        Err(error) => return usage_with("pmacd", &error, exit::USAGE),
    };
    let ended = Settings::decide(&options)
        .map_err(|error| {
            let status = if options.config.is_some() { exit::CONFIGURATION } else { exit::USAGE };
            Failure::new(status, error)
        })
        .and_then(|settings| if options.check { Ok(()) } else { run(&settings, &options, &mut log_writer) });
    // What was logged before the thread was to start is not lost.
    let _ = log_writer.start();
    log.finish();
    match ended {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            // Not by `eprintln!`, which would panic when stderr is closed.
            let prefix = if in_journal { journal::prefix(Level::Error) } else { "pmacd: " };
            let _ = writeln!(std::io::stderr(), "{prefix}{failure}");
            ExitCode::from(failure.status)
        }
    }
}

fn run(settings: &Settings, options: &Options, log: &mut LogWriter) -> Result<(), Failure> {
    // Before anything else: a signal from now on is kept until it is waited for.
    let mut signals = Signals::take().map_err(|error| Failure::system("signals", error))?;
    let mut manager = Manager::from_environment();
    let account = options.user.as_deref().map(Account::named).transpose()?;
    let stays_root = account.is_none() && nix::unistd::geteuid().is_root();
    if stays_root {
        warn!("running as root; the unit file, or --user, is safer");
    }
    privilege::allow_locking();
    let inherited = Inherited::take_all();
    let _cpu_latency = settings.cpu_latency_us.and_then(|latency_us| cpu_latency(latency_us, &inherited));
    let early = needs_rights(&settings.board).then(|| Machine::open(settings, &inherited)).transpose()?;
    if let Some(account) = &account {
        make_socket_directory(&settings.socket, account)?;
    }
    if !stays_root {
        privilege::give_up(account.as_ref())?;
    }
    if let Some(parent) = options.with_parent {
        // A change of user undoes this, so it comes after.
        crate::process::end_with_parent(parent).map_err(|error| Failure::new(exit::SYSTEM, error))?;
    }
    let publisher = Publisher::create(&segment_options(settings)?)?;
    let Machine { board, mailbox, host_port } = match early {
        Some(machine) => machine,
        None => Machine::open(settings, &inherited)?,
    };
    let Board { simulator: _simulator, bus, open, interrupt } = board;
    // The board is open: what opens more of the machine is not kept.
    drop(inherited);

    let (commands, command_queue) = queue(at_once::ALL).map_err(|error| Failure::system("queue", error))?;
    let (events, event_queue) = queue(EVENTS).map_err(|error| Failure::system("queue", error))?;
    let info =
        Arc::new(SharedInfo::new(board_info(settings, &publisher), settings.uncertain.settings().clone()));
    let serve_options = ServeOptions {
        mode: settings.socket_mode,
        group: settings.socket_group.clone(),
        roles: settings.roles.clone(),
        ..ServeOptions::new(settings.socket.clone())
    };
    let listener = serve_options.listen()?;
    if stays_root {
        // Root's own right to everything is not needed any more; until here it was, in places that belong to others.
        privilege::give_up(None)?;
    }
    // Threads begin here: each would have kept the rights it was started with.
    log.start().map_err(|error| Failure::system("the log's thread", error))?;
    let backend = Backend { commands, events: event_queue, info: Arc::clone(&info) };
    let server = serve(&serve_options, listener, backend)?;

    let flags = EfdFlags::EFD_NONBLOCK | EfdFlags::EFD_CLOEXEC;
    let stop =
        Arc::new(EventFd::from_value_and_flags(0, flags).map_err(|error| Failure::system("eventfd", error))?);
    let reading = settings.uncertain.settings();
    let asks = settings.ask_board && reading.functions.has(Function::Ascii);
    let identifier = Identifier::new(configured_identity(settings), asks, Instant::now());
    let now = Instant::now();
    let port = ResponsePort::new(settings.text_order, mailbox, now).after_another_host(now);
    let board = BoardLoop {
        bus: Counted::new(bus),
        open,
        servo: ServoMirror::selecting(settings.servo_reading, reading.servo.selection()),
        background: BackgroundMirror::selecting(
            settings.background_period_ns,
            reading.background.selection(),
        ),
        desk: AsciiDesk::new(port, identifier),
        jobs: JobDesk::new(settings.uncertain.plan(), settings.uncertain.variable_mode())
            .using(reading.functions.clone()),
        functions: reading.functions.clone(),
        interrupt,
        host_port,
        uncertain: settings.uncertain.clone(),
        publisher,
        commands: command_queue,
        events,
        info: Arc::clone(&info),
        stop: Arc::clone(&stop),
        default_motors: settings.motors.map_or(classic::MOTORS, |motors| motors as usize),
        answer: None,
        began_ns: monotonic_ns(),
        rounds_for_servo: 0,
        room: Room::default(),
        condition: Condition::default(),
        told: Told::default(),
    };
    let bus_thread = std::thread::Builder::new()
        .name("bus".to_owned())
        .spawn(move || board.run())
        .map_err(|error| Failure::system("the bus thread", error))?;
    info!(
        "pmacd {} serves board {} as {} on {}",
        env!("CARGO_PKG_VERSION"),
        settings.board_text,
        settings.name.as_str(),
        settings.socket.display()
    );

    info!("runs as {}, {}, scheduling {}", Holdings::read(), privilege::lock_memory(), scheduling());
    manager.ready(&info);

    let asked = until_asked_to_end(&mut signals, &mut manager, &info, || bus_thread.is_finished());
    manager.stopping();
    // First the socket: at its end it has the bus thread stop what is held.
    server.stop();
    let _ = stop.write(1);
    if bus_thread.join().is_err() || asked.is_none() {
        return Err(Failure::new(
            exit::SOFTWARE,
            "the bus thread ended by itself, which is a defect; see the log",
        ));
    }
    Ok(())
}

/// Asks for processors that wake fast. Without them everything works, only later: a refusal is told.
fn cpu_latency(latency_us: u32, inherited: &Inherited) -> Option<CpuLatency> {
    match CpuLatency::hold(latency_us, &System::here(), inherited) {
        Ok(held) => {
            info!("the machine's processors are asked to wake up within {latency_us} us");
            Some(held)
        }
        Err(error) => {
            warn!(
                "cpu_latency_us = {latency_us} is not held: {NODE}: {error}; start as root, or see the drop-in wake-up.conf"
            );
            None
        }
    }
}

/// A second of background reports, and no fewer than 16.
fn background_slots(period_ns: u64) -> u32 {
    let reports = 1_000_000_000 / period_ns.max(1);
    u32::try_from(reports).unwrap_or(u32::MAX).clamp(16, 1024).next_power_of_two()
}

/// The regions this version publishes.
fn segment_options(settings: &Settings) -> Result<CreateOptions, Failure> {
    let servo = RegionSpec {
        id: RegionId::Servo,
        slots: SERVO_SLOTS,
        payload_bytes: 2 * SERVO_WORDS as u32,
        first_host_offset: classic::SERVO_HOST_STATUS.bytes(),
        period_hint_ns: 0,
        stale_after_ns: servo::STALE_NS,
    };
    let background = RegionSpec {
        id: RegionId::Background,
        slots: background_slots(settings.background_period_ns),
        payload_bytes: 2 * BACKGROUND_WORDS as u32,
        first_host_offset: classic::BACKGROUND_DATA_READY.bytes(),
        period_hint_ns: settings.background_period_ns,
        stale_after_ns: limit_ns(background::STALE_NS, settings.background_period_ns),
    };
    let board = RegionSpec {
        id: RegionId::Board,
        slots: BOARD_SLOTS,
        payload_bytes: identity::BYTES as u32,
        first_host_offset: 0,
        period_hint_ns: 0,
        stale_after_ns: 0,
    };
    let variable = RegionSpec {
        id: RegionId::Variable,
        slots: VARIABLE_SLOTS,
        payload_bytes: 2 * variable::PAYLOAD_WORDS as u32,
        first_host_offset: 0,
        period_hint_ns: 0,
        stale_after_ns: variable::STALE_NS,
    };
    let gather = RegionSpec {
        id: RegionId::Gather,
        slots: gather::SLOTS,
        payload_bytes: 2 * gather::PAYLOAD_WORDS as u32,
        first_host_offset: 0,
        period_hint_ns: 0,
        stale_after_ns: 0,
    };
    let group = settings.segment_group.as_deref().map(group_id).transpose();
    let reading = settings.uncertain.settings();
    let selections = vec![
        (RegionId::Servo, reading.servo.selection()),
        (RegionId::Background, reading.background.selection()),
    ];
    Ok(CreateOptions {
        selections,
        mode: settings.segment_mode,
        group: group.map_err(|error| Failure::new(exit::CONFIGURATION, error))?.map(nix::unistd::Gid::as_raw),
        ..CreateOptions::new(settings.name.clone(), vec![servo, background, board, variable, gather])
    })
}

fn configured_identity(settings: &Settings) -> Identity {
    Identity {
        family: Some(settings.family.number()),
        motors: Some(classic::MOTORS as u32),
        coordinate_systems: Some(classic::MOTORS as u32),
        servo_period_ps: settings.i10.map(servo_period_ps),
        i10: settings.i10,
        i19: settings.i19,
        i59: settings.motors,
        firmware: settings.firmware.as_deref().map(Into::into),
        ..Identity::default()
    }
}

fn board_info(settings: &Settings, publisher: &Publisher) -> BoardInfo {
    BoardInfo {
        name: settings.name.as_str().to_owned(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        board: settings.board_text.clone(),
        family: settings.family.name().to_owned(),
        firmware: settings.firmware.clone(),
        motors: settings.motors.unwrap_or(classic::MOTORS as u32),
        generation: publisher.generation(),
        pid: std::process::id(),
        segment: format!("/{}", settings.name.as_str()),
        host_port: settings.host_port.as_ref().map(|config| HostPortInfo {
            controller: HostPortLink::name(&config.port).to_owned(),
            line: config.port.line.into(),
            ..HostPortInfo::default()
        }),
        ..BoardInfo::default()
    }
}

/// Whether this board cannot be opened any more when privileges are given up.
fn needs_rights(board: &BoardSpec) -> bool {
    matches!(board, BoardSpec::Window(_))
}

/// The directory of the sockets, for a daemon that root starts by hand: the user it becomes could not make it.
fn make_socket_directory(socket: &Path, account: &Account) -> Result<(), Failure> {
    let Some(directory) = socket.parent().filter(|directory| !directory.as_os_str().is_empty()) else {
        return Ok(());
    };
    if directory.exists() || !nix::unistd::geteuid().is_root() {
        return Ok(());
    }
    std::fs::create_dir(directory)
        .and_then(|()| {
            std::os::unix::fs::chown(directory, Some(account.uid.as_raw()), Some(account.gid.as_raw()))
        })
        .map_err(|error| Failure::system(&directory.display().to_string(), error))
}

/// Everything of the machine that the daemon works with.
struct Machine {
    board: Board,
    mailbox: Option<MailboxLink>,
    host_port: Option<HostPortLink>,
}

impl Machine {
    fn open(settings: &Settings, inherited: &Inherited) -> Result<Self, Failure> {
        let system = &System::here();
        let failed = |what: &str, error: &(dyn std::error::Error + 'static)| {
            let Failure { status, reason } = Failure::board(error);
            Failure { status, reason: format!("{what}{reason}") }
        };
        let mut board =
            board::open(settings, system, inherited).map_err(|error| failed("", error.as_ref()))?;
        let mailbox = settings.mailbox.clone();
        // Where a board has a vector for it, a response in the DPRAM is announced there.
        if let Some(source) = mailbox.as_ref().and_then(|mailbox| mailbox.dpram.clone()) {
            let link = board::link(source, system, inherited);
            board.interrupt = Some(link.map_err(|error| failed("mailboxes: ", error.as_ref()))?);
        }
        let mailbox = mailbox.map(|config| MailboxLink::open(config, system, inherited)).transpose();
        let host_port = settings.host_port.clone();
        let host_port = host_port.map(|config| HostPortLink::open(config, system, inherited)).transpose();
        Ok(Self {
            board,
            mailbox: mailbox.map_err(|error| failed("mailboxes: ", error.as_ref()))?,
            host_port: host_port.map_err(|error| failed("host port: ", &error))?,
        })
    }
}
