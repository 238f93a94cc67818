//! The daemon without its process: the bus thread's loop and the socket's server, joined by their queues.
//!
//! `bring_up` adds rights, signals and threads. A test runs both in one thread, with its own clock.

use std::sync::Arc;

use log::warn;
use nix::sys::eventfd::{EfdFlags, EventFd};

use super::config::family::FamilyKnown;
use super::config::settings::Settings;
use super::exit::{self, Failure};
use super::machine::Machine;
use super::service::simulator::Simulator;
use super::shared::definition_blocks::DefinitionBlocks;
use super::shared::info::Info;
use super::shared::queue::{at_once, queue};
use super::socket::policy::group_id;
use super::socket::server::Backend;
use crate::clock::Clock;
use crate::daemon::bus::board::Board;
use crate::daemon::bus::board_loop::{BoardLoop, Configured, Connections};
use crate::daemon::bus::command_intake::CommandIntake;
use crate::daemon::bus::function_table::{FunctionTable, Mirrors};
use crate::daemon::bus::identify::{Identifier, servo_period_ps};
use crate::daemon::bus::memory_scan::MemoryScan;
use crate::daemon::bus::ports::command_port::CommandPorts;
use crate::daemon::bus::ports::host_port::HostPortDriver;
use crate::daemon::bus::presence::BoardPresence;
use crate::daemon::bus::work::ascii::AsciiQueue;
use crate::daemon::bus::work::command_lines::CommandLines;
use crate::device::{BoardSpec, Counted, Trace, Traced};
use crate::map::word_use::m_variables;
use crate::mirror::{self, BackgroundMirror, ServoMirror, UserMirror, VariableMirror};
use crate::protocol::function::NO_FAMILY;
use crate::protocol::{BoardInfo, Function, HostPortInfo};
use crate::segment::identity::{self, first_motors};
use crate::segment::{BlockPlace, ClockKind, CreateOptions, Identity, Publisher, RegionId, RegionSpec};

/// The length of the queue of events for the socket thread.
const EVENTS: usize = 256;
/// The number of accesses that the trace has room for: about half a second's.
const TRACED: usize = 1 << 18;

/// The daemon's parts.
pub struct Parts {
    /// The bus thread's loop.
    pub board_loop: BoardLoop,
    /// The server of the command socket.
    pub backend: Backend,
    /// A write to this descriptor ends the loop.
    pub stop: Arc<EventFd>,
    /// The daemon's own simulator. It ends on drop.
    pub simulator: Option<Simulator>,
}

impl Parts {
    /// Puts the parts together. Nothing touches the board before the first poll of the loop. The daemon first asks for
    /// the definitions of the M-variables in `blocks`.
    ///
    /// # Errors
    /// The kernel gives no event descriptor.
    pub fn new(
        settings: &Settings,
        machine: Machine,
        mut publisher: Publisher,
        clock: Clock,
        blocks: Arc<DefinitionBlocks>,
    ) -> Result<Self, Failure> {
        let Machine { board, mailbox, host_port } = machine;
        let Board { simulator, bus, open, interrupt, replies } = board;
        let (commands, command_queue) =
            queue(at_once::ALL).map_err(|error| Failure::system("queue", error))?;
        let (events, event_queue) = queue(EVENTS).map_err(|error| Failure::system("queue", error))?;
        let info = Info::new(
            settings.family,
            board_info(settings, &publisher),
            settings.board_settings.settings().clone(),
        );
        let info = match &replies {
            Some(replies) => info.of_replay(Arc::clone(replies)),
            None => info,
        };
        let flags = EfdFlags::EFD_NONBLOCK | EfdFlags::EFD_CLOEXEC;
        let stop =
            EventFd::from_value_and_flags(0, flags).map_err(|error| Failure::system("eventfd", error))?;
        let stop = Arc::new(stop);
        let reading = settings.board_settings.settings();
        let asks = settings.ask_board && reading.functions.has(Function::Ascii);
        let now = clock.now();
        let mut identifier = Identifier::new(settings.family, configured_identity(settings), asks, now);
        if ![Function::Servo, Function::Background].iter().any(|function| reading.functions.has(*function)) {
            identifier = identifier.without_reports();
        }
        let tells = replies.as_ref().is_none_or(|all| all.has_definitions(m_variables(settings.family)));
        let uses_more =
            Function::ALL.iter().any(|one| *one != Function::Ascii && reading.functions.has(*one));
        if settings.ask_m_variables && !asks && uses_more && replies.is_none() {
            warn!(
                "the board is not asked where its M-variables point: the configuration leaves out \"ascii\", or has ask_board = false. \
                 If its programs keep data in the DPRAM, ask it by another way first: docs/operations.md, Programs that use the DPRAM too"
            );
        }
        let scan = MemoryScan::new(settings.family, asks && settings.ask_m_variables && tells, blocks, now);
        let ports = CommandPorts::new(settings.family, settings.text_order, mailbox);
        let ports = match (&replies, asks) {
            // A replay has had no other host before.
            (Some(_), _) => ports,
            (None, true) => ports.after_another_host(now),
            (None, false) => ports.silent_until_used(),
        };
        let queue = AsciiQueue::new(ports, identifier, scan, clock.clone());
        let queue = if replies.is_some() { queue.of_replay() } else { queue };
        let (layout, mode) = (settings.board_settings.layout(), settings.board_settings.variable_mode());
        let mirrors = Mirrors {
            servo: ServoMirror::new(
                &settings.family.servo,
                settings.servo_reading,
                reading.servo.selection(settings.family),
                clock.clone(),
            ),
            background: BackgroundMirror::new(
                &settings.family.background,
                settings.background_period_ns,
                reading.background.selection(settings.family),
            ),
            variables: VariableMirror::new(&layout, mode, clock.clone()),
            user: UserMirror::new(&settings.user.words, settings.user.rate, &mut publisher, clock.ns()),
        };
        let lines = CommandLines::new(queue, interrupt, host_port);
        let functions = FunctionTable::new(mirrors, lines, layout, reading, clock.clone());
        let configured = Configured {
            settings: settings.board_settings.clone(),
            motors: settings.motors.map_or(settings.family.motors, |motors| motors as usize),
        };
        let connections = Connections {
            publisher,
            intake: CommandIntake::new(command_queue, events),
            pulse: info.pulse(),
            stop: Arc::clone(&stop),
        };
        let trace = Trace::new(TRACED);
        let board_loop = BoardLoop::new(
            Counted::new(Traced::new(bus, Arc::clone(&trace), clock)),
            BoardPresence::new(open),
            functions,
            configured,
            connections,
        );
        Ok(Self {
            board_loop,
            backend: Backend { commands, events: event_queue, info, trace },
            stop,
            simulator,
        })
    }
}

/// The segment of `settings`: its name, its readers, and the regions that this version publishes. Its times are those
/// of `clock`.
///
/// # Errors
/// A group does not exist.
pub fn segment_options(settings: &Settings, clock: &Clock) -> Result<CreateOptions, Failure> {
    let mut regions = vec![
        mirror::servo::region(&settings.family.servo),
        mirror::background::region(&settings.family.background, settings.background_period_ns),
        identity_region(),
        mirror::variable::region(),
        mirror::gather::region(settings.family),
    ];
    regions.extend(mirror::user_words::regions(&settings.user.words, settings.user.rate));
    let group = settings.segment_group.as_deref().map(group_id).transpose();
    let reading = settings.board_settings.settings();
    let selections = vec![
        (RegionId::Servo, reading.servo.selection(settings.family)),
        (RegionId::Background, reading.background.selection(settings.family)),
    ];
    let group =
        group.map_err(|error| Failure::new(exit::CONFIGURATION, error))?.map(nix::unistd::Gid::as_raw);
    Ok(CreateOptions {
        selections,
        mode: settings.segment_mode,
        group,
        clock: if clock.is_manual() { ClockKind::Own } else { ClockKind::Monotonic },
        ..CreateOptions::new(settings.name.clone(), regions)
    })
}

/// The board's identity, which seldom changes.
fn identity_region() -> RegionSpec {
    RegionSpec {
        id: RegionId::Board,
        slots: 4,
        payload_bytes: identity::BYTES as u32,
        first_host_offset: 0,
        blocks: BlockPlace::NONE,
        period_hint_ns: 0,
        stale_after_ns: 0,
    }
}

fn configured_identity(settings: &Settings) -> Identity {
    let known = (settings.family_known != FamilyKnown::Unknown).then_some(settings.family);
    let mut identity = Identity {
        family: known.map(|family| family.number),
        motors: known.map(|family| family.motors as u32),
        coordinate_systems: known.map(|family| family.coordinate_systems as u32),
        servo_period_ps: settings.i10.map(servo_period_ps),
        i10: settings.i10,
        servo_report_cycles: settings.i19,
        motor_mask: motor_mask(settings),
        firmware: settings.firmware.as_deref().map(Into::into),
        replay: matches!(settings.board, BoardSpec::Replay { .. }),
        ..Identity::default()
    };
    settings.motor_names.iter().for_each(|motor| motor.tell(&mut identity));
    identity
}

/// The motors that the board reports, as far as the daemon knows them without a question: if the host chooses the
/// motors, those that the daemon reads.
fn motor_mask(settings: &Settings) -> Option<u32> {
    let Settings { family, motors, .. } = settings;
    if family.servo.mask.is_none() {
        return motors.map(first_motors);
    }
    let read = settings.board_settings.settings().servo.selection(family);
    Some(read.mask(motors.map_or(family.motors, |motors| motors as usize)))
}

fn board_info(settings: &Settings, publisher: &Publisher) -> BoardInfo {
    BoardInfo {
        name: settings.name.as_str().to_owned(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        board: settings.board_text.clone(),
        family: match settings.family_known {
            FamilyKnown::Unknown => NO_FAMILY.to_owned(),
            _ => settings.family.name.to_owned(),
        },
        firmware: settings.firmware.clone(),
        dpram_bytes: (settings.family_known != FamilyKnown::Unknown).then_some(settings.family.length),
        motors: settings.motors.unwrap_or(settings.family.motors as u32),
        generation: publisher.generation(),
        pid: std::process::id(),
        segment: format!("/{}", settings.name.as_str()),
        host_port: settings.host_port.as_ref().map(|config| HostPortInfo {
            controller: HostPortDriver::name(&config.port).to_owned(),
            line: config.port.line.into(),
            ..HostPortInfo::default()
        }),
        ..BoardInfo::default()
    }
}

#[cfg(test)]
#[path = "parts_tests.rs"]
mod tests;
