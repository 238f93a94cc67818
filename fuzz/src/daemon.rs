//! The daemon's queues and mirrors against memory that changes in any way: what clients asked for is answered once and only
//! once whatever the board does, in bounded time, and nothing is written where the board writes.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use pmac_dpram::clock::{Clock, ManualTime};
use pmac_dpram::daemon::bus::board_function::Context;
use pmac_dpram::daemon::bus::command_intake::CommandIntake;
use pmac_dpram::daemon::bus::function_table::{FunctionTable, Mirrors, Work};
use pmac_dpram::daemon::bus::identify::Identifier;
use pmac_dpram::daemon::bus::memory_scan::MemoryScan;
use pmac_dpram::daemon::bus::ports::command_port::CommandPorts;
use pmac_dpram::daemon::bus::work::ascii::AsciiQueue;
use pmac_dpram::daemon::bus::work::command_lines::CommandLines;
use pmac_dpram::daemon::shared::job::{Job, MaskedWord};
use pmac_dpram::daemon::shared::open_buffer::{Account, Writer};
use pmac_dpram::daemon::shared::queue::{Command, Event, Line, Origin, Receive, Ticket, queue};
use pmac_dpram::format::TextOrder;
use pmac_dpram::function::gather::GatherBuffer;
use pmac_dpram::function::panel::{FeedOverride, PanelAction, PanelRequest};
use pmac_dpram::function::servo::ServoReading;
use pmac_dpram::function::variable_read::{VariableEntry, VariableMode};
use pmac_dpram::function::variable_write::WriteRecord;
use pmac_dpram::gather::GatherMode;
use pmac_dpram::map::{
    BufferLayout, BufferSettings, BusyRule, Family, HostOffset, Layout, Motors, PMAC, Space, TURBO2_8K,
    VariableKind,
};
use pmac_dpram::mirror::{
    BackgroundMirror, GatherClock, ServoMirror, UserMirror, UserRate, VariableMirror, gather, variable,
};
use pmac_dpram::protocol::{BoardSettings, Function};
use pmac_dpram::segment::{CreateOptions, Identity, Publisher, RegionId, RegionSpec, SegmentName};

use super::bus::{RamBus, register};
use super::tape::Tape;

/// The number of a report after all those that are not believed yet.
const LATE_REPORT: u64 = 1 << 60;
/// The families whose boards are played.
const FAMILIES: [&Family; 2] = [&PMAC, &TURBO2_8K];
/// When it begins, in nanoseconds.
const BEGIN_NS: u64 = 1_000_000_000_000;
/// Most steps of one input.
const STEPS: usize = 300;
/// How often servo data that were torn are copied in one piece of work, and most accesses of one besides.
const COPIES: usize = 3;
const BESIDES: u32 = 500;
/// Passes that must be enough to answer everything once the board does nothing more and time goes on.
const LAST_PASSES: usize = 400;

struct Shared {
    _directory: tempfile::TempDir,
    publisher: Publisher,
    intake: CommandIntake,
    receiver: Receive<Event>,
}

thread_local!(static SHARED: RefCell<Option<Shared>> = const { RefCell::new(None) });

fn shared() -> Shared {
    let directory = tempfile::tempdir_in("/dev/shm").unwrap();
    // One segment for boards of both families.
    let longest = |words: fn(&Family) -> usize| FAMILIES.into_iter().map(words).max().unwrap_or_default();
    let regions = [
        (RegionId::Servo, longest(|family| family.servo.words())),
        (RegionId::Background, longest(|family| family.background.words())),
        (RegionId::Board, 264),
        (RegionId::Variable, variable::PAYLOAD_WORDS),
        (RegionId::Gather, longest(gather::longest_payload)),
    ];
    let regions = regions.map(|(id, words)| RegionSpec {
        id,
        slots: 4,
        payload_bytes: 2 * words as u32,
        first_host_offset: 0,
        blocks: pmac_dpram::segment::BlockPlace::NONE,
        period_hint_ns: 442_673,
        stale_after_ns: 100_000_000,
    });
    let mut options = CreateOptions::new(SegmentName::new("pmac0").unwrap(), regions.to_vec());
    options.directory = directory.path().to_owned();
    let (sender, receiver) = queue(8).unwrap();
    let intake = CommandIntake::new(queue(1).unwrap().1, sender);
    Shared { publisher: Publisher::create(&options).unwrap(), _directory: directory, intake, receiver }
}

struct Bench<'a> {
    shared: &'a mut Shared,
    family: &'static Family,
    bus: RamBus,
    functions: FunctionTable,
    time: ManualTime,
    clock: Clock,
    /// What was asked, and how often it was answered.
    asked: BTreeMap<u64, u32>,
    /// Somebody may write anywhere, and did.
    wrote_anywhere: bool,
}

/// First byte: what the memory is full of, settings, and the board's family. Then steps: what the memory does, what clients ask for, passes.
pub fn body(data: &[u8]) {
    SHARED.with_borrow_mut(|place| {
        let shared = place.get_or_insert_with(shared);
        while shared.receiver.try_receive().is_some() {}
        let mut tape = Tape::new(data);
        let way = tape.u8();
        let family = FAMILIES[usize::from(way >> 7)];
        let layout = Layout::new(family, None);
        let plan = BufferSettings::default().of(family);
        let plan = BufferLayout::new(&layout, &plan).expect("the default plan fits");
        let time = ManualTime::at(BEGIN_NS);
        let (clock, now) = (time.clock(), time.clock().now());
        let order = if way & 4 == 0 { TextOrder::LowFirst } else { TextOrder::HighFirst };
        let mode = if way & 16 == 0 { VariableMode::SingleUser } else { VariableMode::MultiUser };
        let port = CommandPorts::new(family, order, None);
        let identifier = Identifier::new(family, Identity::default(), way & 32 != 0, now);
        let scan = MemoryScan::new(family, way & 64 != 0, Arc::default(), now);
        let user = UserMirror::new(&[], UserRate::Servo, &mut shared.publisher, clock.ns());
        let mut bench = Bench {
            shared,
            family,
            bus: RamBus::of(family, [0, 0, 0xFFFF, 0x8000][usize::from(way & 3)]),
            functions: FunctionTable::new(
                Mirrors {
                    servo: ServoMirror::new(
                        &family.servo,
                        if way & 8 == 0 { ServoReading::Optimistic } else { ServoReading::Handshake },
                        pmac_dpram::map::Selection::ALL,
                        clock.clone(),
                    ),
                    background: BackgroundMirror::new(
                        &family.background,
                        50_000_000,
                        pmac_dpram::map::Selection::ALL,
                    ),
                    variables: VariableMirror::new(&plan, mode, clock.clone()),
                    user,
                },
                CommandLines::new(AsciiQueue::new(port, identifier, scan, clock.clone()), None, None),
                plan,
                &BoardSettings::default(),
                clock.clone(),
            ),
            time,
            clock,
            asked: BTreeMap::new(),
            wrote_anywhere: false,
        };
        for _ in 0..STEPS {
            if tape.is_over() {
                break;
            }
            let what = tape.u8();
            bench.step(what & 15, what >> 4, &mut tape);
        }
        bench.settle();
    });
}

impl Bench<'_> {
    fn step(&mut self, what: u8, how: u8, tape: &mut Tape<'_>) {
        match what {
            0..=4 => self.bus.change(how, tape),
            5 => self.time.advance(Duration::from_millis(u64::from(how) * 20)),
            6 | 7 => self.ask_ascii(how, tape),
            8 | 9 => self.ask_job(how, tape),
            10 => self.hear(),
            11 => {
                self.turn(how, tape);
                self.bounded(one_go(self.family));
            }
            _ => self.pass(how),
        }
    }

    /// What the thread that owns the board does when something happened to it.
    fn turn(&mut self, how: u8, tape: &mut Tape<'_>) {
        match how {
            0 => self.functions.ascii.queue.reset(&mut self.bus, self.clock.now()).unwrap(),
            1 => self.functions.ascii.queue.doubt(self.clock.now()),
            2 => self.functions.ascii.queue.see_buffer(Some((true, LATE_REPORT))),
            3 => self.functions.ascii.queue.see_buffer(Some((false, LATE_REPORT))),
            4 => self.functions.ascii.queue.set_interrupt(true),
            5 => self.in_context(|functions, context| functions.reset(context).unwrap()),
            6 => {
                self.functions.ascii.queue.reset(&mut self.bus, self.clock.now()).unwrap();
                self.in_context(|functions, context| functions.acquire(context).unwrap());
            }
            7 => self.functions.servo.configure(
                Motors::first(tape.u8().into()),
                Some(u64::from(tape.u32())),
                Some(tape.u32()),
            ),
            8 => self.functions.background.configure(usize::from(tape.u8())),
            9 => self.functions.servo.reset(),
            10 => self.functions.background.reset(),
            _ => self.functions.background.ask(&mut self.bus, self.clock.ns()).unwrap(),
        }
    }

    fn ticket(&mut self) -> Ticket {
        let number = self.asked.len() as u64;
        self.asked.insert(number, 0);
        Ticket(number)
    }

    fn ask_ascii(&mut self, how: u8, tape: &mut Tape<'_>) {
        let ticket = self.ticket();
        let deadline = self.clock.now() + Duration::from_millis(u64::from(how & 7) * 100);
        let command = if how & 8 == 0 {
            let line: Vec<u8> = tape.piece().iter().take(200).map(|byte| byte % 95 + 32).collect();
            let line = Line::of(&line);
            let writer = if how & 1 != 0 {
                Writer::Question
            } else {
                Writer::Hand(Account { uid: how.into(), pid: 1 })
            };
            Command::Send { ticket, line, origin: Origin::default(), deadline, writer }
        } else {
            Command::Control {
                ticket,
                uid: 0,
                drops_lines: how & 1 != 0,
                character: tape.u8() % 31 + 1,
                deadline,
            }
        };
        self.functions.ascii.queue.submit(&command, self.clock.now());
    }

    fn ask_job(&mut self, how: u8, tape: &mut Tape<'_>) {
        let ticket = self.ticket();
        let deadline = self.clock.now() + Duration::from_millis(u64::from(tape.u8()) * 10);
        let job = self.job(how, tape);
        let answer = self.in_context(|functions, context| functions.submit(context, ticket, job, deadline));
        let answer = answer.expect("no job leaves the memory");
        if let Some(event) = answer {
            self.take(event);
        }
        self.bounded(one_go(self.family));
    }

    /// A job as the command socket lets one through.
    fn job(&mut self, how: u8, tape: &mut Tape<'_>) -> Job {
        let buffer = usize::from(how & 1);
        match how {
            0 | 1 => {
                let action = PanelAction::ALL[usize::from(tape.u8()) % PanelAction::ALL.len()];
                // Of a board without a panel the socket lets none through; it may have known the family by then only.
                let panel = self.family.panel.as_ref().or(PMAC.panel.as_ref()).expect("a PMAC has a panel");
                Job::Panel(PanelRequest::of(panel, action, &[usize::from(tape.u8() & 7) + 1]).unwrap())
            }
            2 => {
                let raw = FeedOverride::from_raw(u32::from(tape.u16() & 0x7FFF)).ok();
                Job::Override {
                    coordinate_system: usize::from(tape.u8()),
                    value: raw.filter(|_| how & 1 == 0),
                }
            }
            3 => {
                let anywhere = tape.u8() & 1 != 0;
                self.wrote_anywhere |= anywhere;
                let count = usize::from(tape.u8() & 7) + 1;
                let first = u32::from(tape.u16() & 0x3FFE).min(self.family.length - 2 * count as u32);
                let words = (0..count).map(|_| MaskedWord { value: tape.u16(), mask: tape.u16() });
                Job::Write { first: HostOffset::checked(first).unwrap(), words: words.collect(), anywhere }
            }
            4 | 5 => {
                let kinds = [VariableKind::Y, VariableKind::Long, VariableKind::X];
                let count = usize::from(tape.u8()) % 140;
                let entry = |at: usize| VariableEntry { address: at as u32, kind: kinds[at % 3] };
                Job::WatchVariables((0..count).map(entry).collect())
            }
            6 | 7 => {
                let count = usize::from(tape.u8()) + 1;
                let record =
                    WriteRecord::word(register(Space::Y, tape.u16() | 1), 24, 0, tape.u16().into()).unwrap();
                Job::WriteVariables(vec![record; count])
            }
            8 => {
                let size_longs = u32::from(tape.u16());
                let buffer = GatherBuffer {
                    place: self.family.gather,
                    room_longs: (self.family.length - self.family.gather.buffer.bytes()) / 4,
                    size_longs,
                    sample_longs: u32::from(tape.u8()),
                    longest_sample: 48,
                    mode: if tape.u8() & 1 == 0 { GatherMode::Wrap } else { GatherMode::Stop },
                    period: u32::from(tape.u8()),
                };
                let clock = GatherClock::host(tape.u64() >> 20).unwrap_or(GatherClock::Report);
                Job::GatherBegin { buffer, clock }
            }
            9 => Job::GatherEnd,
            10 | 11 => {
                let start = HostOffset::checked(u32::from(tape.u16())).filter(|_| how & 1 == 0);
                let size_longs = Some(u32::from(tape.u16())).filter(|size| size & 1 == 0);
                let (coordinate_system, base) = (tape.u8() & 15, tape.u8() & 3);
                Job::RotaryOpen { buffer, start, size_longs, coordinate_system, coordinate_system_base: base }
            }
            12 | 13 => {
                let first = Some(u64::from(tape.u8())).filter(|first| *first < 0x80);
                let count = usize::from(tape.u8() & 31);
                let line = |tape: &mut Tape<'_>| {
                    let word1 = tape.u32() >> 8;
                    vec![(word1 | 1 << 11, tape.u32() >> 8); usize::from(word1 & 0xF != 0)]
                };
                Job::RotarySend { buffer, first, lines: (0..count).map(|_| line(tape)).collect() }
            }
            14 => Job::RotaryFinish(buffer),
            _ => Job::RotaryState(buffer),
        }
    }

    fn pass(&mut self, how: u8) {
        let now_ns = self.clock.ns();
        let function = match how & 3 {
            0 => Some(Function::Ascii),
            1 => {
                let next = self.functions.next::<RamBus>(false);
                match next.filter(|(due_ns, _)| *due_ns <= now_ns) {
                    Some((_, Work::Function(function))) => Some(function),
                    _ => None,
                }
            }
            2 => Some(Function::Servo),
            _ => Some(Function::Background),
        };
        let Some(function) = function else { return };
        if self.shared.intake.is_held_up() {
            // As the loop: nothing that may answer goes on before the last answer found room.
            self.hear();
        }
        let polled = self.in_context(|functions, context| functions.poll(function, context));
        polled.expect("everything lies in the memory");
        self.bounded(one_go(self.family));
    }

    fn in_context<T>(&mut self, act: impl FnOnce(&mut FunctionTable, &mut Context<'_, RamBus>) -> T) -> T {
        let Shared { publisher, intake, .. } = &mut *self.shared;
        let mut context = Context { bus: &mut self.bus, publisher, intake, clock: &self.clock };
        act(&mut self.functions, &mut context)
    }

    /// Whatever the board does, one piece of work costs so many accesses at most, and touches the host's words alone.
    fn bounded(&mut self, most: u32) {
        let accesses = self.bus.take_accesses();
        assert!(accesses <= most, "{accesses} accesses in one go");
        let (anywhere, family) = (self.wrote_anywhere, self.family);
        self.bus.assert_written("the daemon", |offset| anywhere || is_hosts(family, offset));
    }

    fn hear(&mut self) {
        loop {
            while let Some(event) = self.shared.receiver.try_receive() {
                self.take(event);
            }
            if !self.shared.intake.is_held_up() {
                return;
            }
            self.shared.intake.retry();
        }
    }

    fn take(&mut self, event: Event) {
        match event {
            Event::Line(ticket, _) => {
                assert_eq!(self.asked.get(&ticket.0), Some(&0), "a line after the end of its command");
            }
            Event::Done(ticket, _)
            | Event::Words { ticket, .. }
            | Event::Rotary(ticket, _)
            | Event::Watching(ticket, _) => self.answered(ticket),
            Event::Info(_) | Event::Unsolicited(_) => {}
        }
    }

    fn answered(&mut self, ticket: Ticket) {
        let times = self.asked.get_mut(&ticket.0).expect("somebody asked for what is answered");
        *times += 1;
        assert_eq!(*times, 1, "{ticket:?} was answered twice");
    }

    /// The board does nothing more, and time goes on: everything that was asked has its answer soon.
    fn settle(&mut self) {
        for _ in 0..LAST_PASSES {
            if self.asked.values().all(|times| *times == 1) {
                return;
            }
            self.time.advance(Duration::from_millis(100));
            self.hear();
            self.pass(0);
            self.pass(1);
        }
        self.hear();
        let open: Vec<&u64> =
            self.asked.iter().filter(|(_, times)| **times == 0).map(|(number, _)| number).collect();
        assert!(open.is_empty(), "never answered: {open:?}");
    }
}

/// Most accesses of one piece of work with a board of `family`.
fn one_go(family: &Family) -> u32 {
    (COPIES * family.servo.words()) as u32 + BESIDES
}

/// Whether the host may write to the word at `offset` of a board of `family`.
fn is_hosts(family: &Family, offset: u32) -> bool {
    let Family { servo, background, ascii, .. } = family;
    // Where the host takes PMAC's flag away, it writes that word, too.
    let taken = (servo.busy == BusyRule::ClearWhileWriting).then_some(servo.pmac_status.word);
    let mask = servo.mask.into_iter().flat_map(|mask| [mask, mask.plus_words(1)]);
    let busy = background.host_busy.map(|flag| flag.word);
    let words = [Some(servo.host_busy.word), taken, busy, background.count].into_iter().flatten().chain(mask);
    let mut words = words.chain([background.ready.word, ascii.response_control, ascii.response]);
    let whole = |name: &str| match name {
        "panel" => family.panel.is_some(),
        name => ["ascii_output", "pointers", "user"].contains(&name),
    };
    let mut regions = family.regions.iter().filter(|region| whole(region.name));
    words.any(|word| word.bytes() == offset)
        || regions.any(|region| (region.start.bytes()..region.end.bytes()).contains(&offset))
}
