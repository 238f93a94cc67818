//! From the command line to a running daemon, and back: the whole order in one place.
//!
//! settings → simulator (if any) → board → segment → socket → bus thread → wait for a signal → the same backwards.

use std::io::Write;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

use clap::Parser;
use log::{error, info, warn};
use nix::sys::eventfd::{EfdFlags, EventFd};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

use super::ascii_desk::AsciiDesk;
use super::board::{self, Board};
use super::board_loop::{BoardLoop, Told};
use super::host_link::HostPortLink;
use super::identify::{Identifier, servo_period_ps};
use super::info::SharedInfo;
use super::interrupt_link::InterruptLink;
use super::job_desk::JobDesk;
use super::log_sink::LogSink;
use super::mailbox_link::MailboxLink;
use super::options::Options;
use super::queue::queue;
use super::response_port::ResponsePort;
use super::serve::{Backend, ServeOptions, serve};
use super::settings::Settings;
use crate::device::{Counted, Inherited, System};
use crate::function::background::BACKGROUND_WORDS;
use crate::function::servo::SERVO_WORDS;
use crate::map::classic;
use crate::mirror::{BackgroundMirror, ServoMirror, gather, variable};
use crate::protocol::{BoardInfo, HostPortInfo};
use crate::segment::identity;
use crate::segment::{CreateOptions, Identity, Publisher, RegionId, RegionSpec, monotonic_ns};
use crate::usage::usage;

/// Slots of each region: servo, some seconds; background, some reports; the board, a few changes.
const SERVO_SLOTS: u32 = 4096;
const BACKGROUND_SLOTS: u32 = 16;
const BOARD_SLOTS: u32 = 4;
/// Commands and events that may lie between the threads.
const QUEUE: usize = 256;

/// The request was not understood or cannot be: nothing has been done.
const EXIT_USAGE: u8 = 2;
/// The daemon could not start, or could not go on.
const EXIT_FAILURE: u8 = 1;

/// The whole program.
#[must_use]
pub fn main() -> ExitCode {
    let log = match LogSink::start(std::io::stderr()) {
        Ok(log) => log,
        Err(error) => return say(EXIT_FAILURE, &format!("the log's thread: {error}")),
    };
    env_logger::Builder::from_env(env_logger::Env::default().default_filter_or("info"))
        .format_timestamp(None)
        .format_target(false)
        .target(env_logger::Target::Pipe(Box::new(log.clone())))
        .init();
    let options = match Options::try_parse() {
        Ok(options) => options,
        Err(error) => return usage("pmacd", &error),
    };
    let settings = match Settings::decide(&options) {
        Ok(settings) => settings,
        Err(error) => return say(EXIT_USAGE, &error.to_string()),
    };
    if options.check {
        return ExitCode::SUCCESS;
    }
    let ended = run(&settings, options.with_parent);
    log.finish();
    match ended {
        Ok(()) => ExitCode::SUCCESS,
        Err(reason) => say(EXIT_FAILURE, &reason),
    }
}

/// Says why the program ends. Not by `eprintln!`, which would panic when stderr is closed.
fn say(status: u8, reason: &str) -> ExitCode {
    let _ = writeln!(std::io::stderr(), "pmacd: {reason}");
    ExitCode::from(status)
}

fn run(settings: &Settings, parent: Option<u32>) -> Result<(), String> {
    // Before anything else: a signal from now on is kept until it is waited for.
    let mut signals = Signals::new([SIGTERM, SIGINT, SIGHUP]).map_err(|error| format!("signals: {error}"))?;
    if let Some(parent) = parent {
        crate::process::end_with_parent(parent).map_err(|error| error.to_string())?;
    }
    if nix::unistd::geteuid().is_root() {
        warn!("running as root; the unit file or a user of its own is safer");
    }
    let options = segment_options(settings);
    let publisher = Publisher::create(&options).map_err(|error| error.to_string())?;
    let (system, inherited) = (System::here(), Inherited::take_all());
    let Board { simulator: _simulator, bus, open, interrupt } = board::open(settings, &system, &inherited)?;
    let mailbox = settings.mailbox.clone().map(|config| MailboxLink::open(config, &system, &inherited));
    let mailbox = mailbox.transpose().map_err(|error| format!("mailboxes: {error}"))?;
    let host_port = settings.host_port.clone().map(|config| HostPortLink::open(config, &system, &inherited));
    let host_port = host_port.transpose().map_err(|error| format!("host port: {error}"))?;
    // The board is open: what opens more of the machine is not kept.
    drop(inherited);

    let response =
        settings.mailbox.as_ref().and_then(|mailbox| mailbox.dpram.clone()).map(InterruptLink::new);

    let (commands, command_queue) = queue(QUEUE).map_err(|error| format!("queue: {error}"))?;
    let (events, event_queue) = queue(QUEUE).map_err(|error| format!("queue: {error}"))?;
    let info =
        Arc::new(SharedInfo::new(board_info(settings, &publisher), settings.uncertain.settings().clone()));
    let serve_options = ServeOptions {
        mode: settings.socket_mode,
        group: settings.socket_group.clone(),
        roles: settings.roles.clone(),
        ..ServeOptions::new(settings.socket.clone())
    };
    let listener = serve_options.listen().map_err(|error| error.to_string())?;
    let backend = Backend { commands, events: event_queue, info: Arc::clone(&info) };
    let server = serve(&serve_options, listener, backend).map_err(|error| error.to_string())?;

    let flags = EfdFlags::EFD_NONBLOCK | EfdFlags::EFD_CLOEXEC;
    let stop =
        Arc::new(EventFd::from_value_and_flags(0, flags).map_err(|error| format!("eventfd: {error}"))?);
    let identifier = Identifier::new(configured_identity(settings), settings.ask_board, Instant::now());
    let board = BoardLoop {
        bus: Counted::new(bus),
        open,
        servo: ServoMirror::new(settings.servo_reading),
        background: BackgroundMirror::new(settings.background_period_ns),
        desk: AsciiDesk::new(ResponsePort::new(settings.text_order, mailbox, Instant::now()), identifier),
        jobs: JobDesk::new(settings.uncertain.plan(), settings.uncertain.variable_mode()),
        interrupt: response.or(interrupt),
        host_port,
        uncertain: settings.uncertain.clone(),
        publisher,
        commands: command_queue,
        events,
        info,
        stop: Arc::clone(&stop),
        default_motors: settings.motors.map_or(classic::MOTORS, |motors| motors as usize),
        answer: None,
        began_ns: monotonic_ns(),
        rounds_for_servo: 0,
        told: Told::default(),
    };
    let bus_thread = std::thread::Builder::new()
        .name("bus".to_owned())
        .spawn(move || board.run())
        .map_err(|error| format!("the bus thread: {error}"))?;
    info!(
        "pmacd {} serves board {} as {} on {}",
        env!("CARGO_PKG_VERSION"),
        settings.board_text,
        options.name.as_str(),
        settings.socket.display()
    );

    for signal in signals.forever() {
        if signal == SIGHUP {
            warn!("SIGHUP changes nothing: restart the daemon to have it read its configuration again");
        } else {
            info!("signal {signal}: stopping");
            break;
        }
    }
    // First the socket: at its end it has the bus thread stop what is held.
    server.stop();
    let _ = stop.write(1);
    let ended = bus_thread.join();
    if ended.is_err() {
        error!("the bus thread ended with a panic");
        return Err("the bus thread failed".to_owned());
    }
    Ok(())
}

/// The regions this version publishes.
fn segment_options(settings: &Settings) -> CreateOptions {
    let servo = RegionSpec {
        id: RegionId::Servo,
        slots: SERVO_SLOTS,
        payload_bytes: 2 * SERVO_WORDS as u32,
        first_host_offset: classic::SERVO_HOST_STATUS.bytes(),
        period_hint_ns: 0,
        stale_after_ns: 100_000_000,
    };
    let background = RegionSpec {
        id: RegionId::Background,
        slots: BACKGROUND_SLOTS,
        payload_bytes: 2 * BACKGROUND_WORDS as u32,
        first_host_offset: classic::BACKGROUND_DATA_READY.bytes(),
        period_hint_ns: settings.background_period_ns,
        stale_after_ns: 1_000_000_000.max(10 * settings.background_period_ns),
    };
    let board = RegionSpec {
        id: RegionId::Board,
        slots: BOARD_SLOTS,
        payload_bytes: identity::BYTES as u32,
        first_host_offset: 0,
        period_hint_ns: 0,
        stale_after_ns: u64::MAX,
    };
    let variable = RegionSpec {
        id: RegionId::Variable,
        slots: BACKGROUND_SLOTS,
        payload_bytes: 2 * variable::PAYLOAD_WORDS as u32,
        first_host_offset: 0,
        period_hint_ns: 0,
        stale_after_ns: 1_000_000_000,
    };
    let gather = RegionSpec {
        id: RegionId::Gather,
        slots: gather::SLOTS,
        payload_bytes: 2 * gather::PAYLOAD_WORDS as u32,
        first_host_offset: 0,
        period_hint_ns: 0,
        stale_after_ns: 0,
    };
    CreateOptions {
        mode: settings.segment_mode,
        ..CreateOptions::new(settings.name.clone(), vec![servo, background, board, variable, gather])
    }
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
        firmware: settings.firmware.clone(),
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
