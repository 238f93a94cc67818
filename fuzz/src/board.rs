//! The host's half of each function, against memory that changes in any way at any access: each writes only its own words,
//! needs no more accesses than a step may, and believes nothing that cannot be.

use std::time::{Duration, Instant};

use pmac_dpram::format::TextOrder;
use pmac_dpram::function::ascii::DpramPort;
use pmac_dpram::function::background::{BackgroundPoll, BackgroundReader};
use pmac_dpram::function::gather::{
    GatherBuffer, GatherPoll, GatherReader, GatherStart, chunk_longs, report_cycles,
};
use pmac_dpram::function::line_port::{AsciiEvent, LinePort, PortError};
use pmac_dpram::function::mailbox::{MailboxPort, MailboxSettings, MailboxSignal};
use pmac_dpram::function::panel::{FeedOverride, Panel, PanelAction, PanelRequest};
use pmac_dpram::function::rotary::{RotaryError, RotarySetup, RotaryStream};
use pmac_dpram::function::servo::{ServoPoll, ServoReader, ServoReading};
use pmac_dpram::function::servo_timer::ServoTimer;
use pmac_dpram::function::variable_read::{
    POLL_WORDS, VariableEntry, VariableMode, VariablePoll, VariableReader,
};
use pmac_dpram::function::variable_write::{POLL_RECORDS, VariableWriter, WriteRecord};
use pmac_dpram::gather::GatherMode;
use pmac_dpram::map::functions::VARIABLE_READ_ENTRIES;
use pmac_dpram::map::{
    BufferLayout, BufferSettings, BusyRule, Family, HostOffset, Layout, Motors, PMAC, Region, Space,
    TURBO2_8K, VariableKind,
};
use pmac_dpram::protocol::check_line;

use super::bus::{RamBus, RamBytes, register};
use super::tape::Tape;

/// Most steps of one input.
const STEPS: usize = 400;

struct Functions {
    family: &'static Family,
    servo: ServoReader,
    background: BackgroundReader,
    ascii: DpramPort,
    /// Where the family has one.
    panel: Option<Panel>,
    reader: VariableReader,
    writer: VariableWriter,
    gather: Option<(GatherReader, ServoTimer)>,
    rotary: Vec<(RotaryStream, Option<RotarySetup>)>,
    mailbox: MailboxPort,
    registers: RamBytes,
    plan: BufferLayout,
    now: Instant,
}

/// First byte: what the memory is full of, how the servo data are read, and the board's family. Then steps: what the memory does, or a function.
pub fn body(data: &[u8]) {
    let mut tape = Tape::new(data);
    let way = tape.u8();
    let family = if way & 16 == 0 { &PMAC } else { &TURBO2_8K };
    let mut bus = RamBus::of(family, [0, 0, 0xFFFF, 0x8000][usize::from(way & 3)]);
    let layout = Layout::new(family, None);
    let plan = BufferSettings::default().of(family);
    let plan = BufferLayout::new(&layout, &plan).expect("the default plan fits");
    let now = Instant::now();
    let order = if way & 4 == 0 { TextOrder::LowFirst } else { TextOrder::HighFirst };
    let reading = if way & 8 == 0 { ServoReading::Optimistic } else { ServoReading::Handshake };
    let mut functions = Functions {
        family,
        servo: ServoReader::new(&family.servo, reading, pmac_dpram::map::Selection::ALL),
        background: BackgroundReader::new(&family.background, pmac_dpram::map::Selection::ALL),
        ascii: DpramPort::new(&family.ascii, order),
        panel: family.panel.as_ref().map(Panel::new),
        reader: VariableReader::new(&family.variable_read, family.start, plan.variable_read()),
        writer: VariableWriter::new(family, plan.variable_write()),
        gather: None,
        rotary: RotaryStream::of_family(family).into_iter().map(|stream| (stream, None)).collect(),
        mailbox: MailboxPort::new(MailboxSettings::default(), family.ascii.line_limit),
        registers: RamBytes { bytes: [0; 0x200], accesses: 0 },
        plan,
        now,
    };
    for _ in 0..STEPS {
        if tape.is_over() {
            break;
        }
        let what = tape.u8();
        match what & 15 {
            0..=4 => bus.change(what >> 4, &mut tape),
            5 => functions.now += Duration::from_millis(u64::from(what >> 4) * 20),
            _ => functions
                .step(&mut bus, what & 15, what >> 4, &mut tape)
                .expect("no access leaves the memory"),
        }
    }
}

impl Functions {
    fn step(
        &mut self,
        bus: &mut RamBus,
        function: u8,
        how: u8,
        tape: &mut Tape<'_>,
    ) -> Result<(), PortError> {
        bus.take_accesses();
        match function {
            6 => self.servo(bus, how),
            7 => self.background(bus, how),
            8 | 9 => self.ascii(bus, how, tape),
            10 => self.panel(bus, how, tape),
            11 => self.variable_read(bus, how, tape),
            12 => self.variable_write(bus, how, tape),
            13 => self.gather(bus, how, tape),
            14 => self.rotary(bus, how, tape),
            _ => {
                self.mailbox(how, tape);
                Ok(())
            }
        }
    }

    fn servo(&mut self, bus: &mut RamBus, how: u8) -> Result<(), PortError> {
        let block = &self.family.servo;
        match how {
            0 => self.servo.set_motors(Motors::NONE),
            1 => self.servo.set_motors(Motors::first(8)),
            2 => self.servo.set_motors(Motors::ALL),
            3 => self.servo.reset(),
            4 => ServoReader::release(block, bus)?,
            _ => {
                let look = self.servo.poll(bus)?;
                if let ServoPoll::Update(timer) | ServoPoll::First(timer) = look {
                    assert!(timer < 1 << block.timer.bits());
                }
                let _ = self.servo.whole_board();
            }
        }
        assert!(self.servo.image().len() <= block.words());
        assert!(bus.take_accesses() <= block.words() as u32 + 9);
        let mask = block.mask.map(|mask| [mask, mask.plus_words(1)]);
        // Where the host takes PMAC's flag away, it writes that word, too.
        let taken = (block.busy == BusyRule::ClearWhileWriting).then_some(block.pmac_status.word);
        let own = [Some(block.host_busy.word), taken];
        bus.assert_written("servo", |offset| {
            own.into_iter().flatten().chain(mask.into_iter().flatten()).any(|word| word.bytes() == offset)
        });
        Ok(())
    }

    fn background(&mut self, bus: &mut RamBus, how: u8) -> Result<(), PortError> {
        let block = &self.family.background;
        match how {
            0 => self.background.set_numbers(3),
            1 => self.background.set_numbers(1000),
            2 => self.background.reset(),
            3 => BackgroundReader::release(block, bus)?,
            _ => {
                if let BackgroundPoll::Report(_) = self.background.poll(bus)? {
                    assert!(!self.background.image().is_empty());
                }
            }
        }
        assert!(self.background.image().len() <= block.words());
        assert!(bus.take_accesses() <= block.words() as u32 + 8);
        let own = [Some(block.ready.word), block.host_busy.map(|flag| flag.word), block.count];
        bus.assert_written("background", |offset| {
            own.into_iter().flatten().any(|word| word.bytes() == offset)
        });
        Ok(())
    }

    fn ascii(&mut self, bus: &mut RamBus, how: u8, tape: &mut Tape<'_>) -> Result<(), PortError> {
        let now = self.now;
        match how {
            0 => {
                let line = tape.piece();
                if std::str::from_utf8(line).is_ok_and(|line| check_line(line).is_ok()) {
                    self.ascii.begin(bus, line)?;
                }
            }
            1 => {
                self.ascii.control(bus, tape.u8() % 31 + 1, true, now)?;
            }
            2 => {
                self.ascii.control(bus, tape.u8() % 31 + 1, false, now)?;
            }
            3 => {
                self.ascii.give_up(bus, now)?;
            }
            4 => {
                self.ascii.take_back(bus, now)?;
            }
            5 => self.ascii.withdraw_control(bus)?,
            6 => self.ascii.rest(now),
            7 => self.ascii.release(bus)?,
            _ => {
                if let Some(
                    AsciiEvent::Line(text)
                    | AsciiEvent::ProgramResponse(text)
                    | AsciiEvent::ProgramMessage(text),
                ) = self.ascii.poll(bus, now)?
                {
                    assert!(text.as_bytes().len() <= 255 && !text.as_bytes().contains(&0));
                }
            }
        }
        let ascii = &self.family.ascii;
        assert!(bus.take_accesses() <= 256);
        bus.assert_written("ascii", |offset| {
            let cleared = [ascii.response_control, ascii.response];
            let line = ascii.command.bytes()..ascii.command.bytes() + ascii.command_bytes as u32;
            let flags = [ascii.command_loaded.word, ascii.control_character];
            line.contains(&offset) || cleared.iter().chain(&flags).any(|word| word.bytes() == offset)
        });
        Ok(())
    }

    fn panel(&mut self, bus: &mut RamBus, how: u8, tape: &mut Tape<'_>) -> Result<(), PortError> {
        let (Some(panel), Some(block)) = (&mut self.panel, &self.family.panel) else { return Ok(()) };
        let number = usize::from(tape.u8() & 15);
        match how {
            0 => drop(panel.acquire(bus)?),
            1 => panel.withdraw(bus)?,
            2 => drop(panel.taken(bus)?),
            3 | 4 => {
                if let Ok(raw) = FeedOverride::from_raw(tape.u32() >> (tape.u8() & 31)) {
                    let _ = panel.set_override(bus, number, raw);
                }
            }
            5 => drop(panel.release_override(bus, number)),
            _ => {
                let action = PanelAction::ALL[usize::from(how) % PanelAction::ALL.len()];
                if let Ok(request) = PanelRequest::of(block, action, &[number]) {
                    assert!((1..=8).contains(&number));
                    let _ = panel.begin(bus, &request)?;
                }
            }
        }
        assert!(bus.take_accesses() <= 40);
        bus.assert_written("panel", |offset| within(&block.region, offset));
        Ok(())
    }

    fn variable_read(&mut self, bus: &mut RamBus, how: u8, tape: &mut Tape<'_>) -> Result<(), PortError> {
        match how {
            0 => self.reader.release(bus)?,
            1..=3 => {
                let kinds = [VariableKind::Y, VariableKind::Long, VariableKind::X];
                let entry = |tape: &mut Tape<'_>| {
                    let kind = kinds[usize::from(tape.u8()) % kinds.len()];
                    VariableEntry { address: tape.u16().into(), kind }
                };
                let count = usize::from(tape.u8()) % if how == 3 { 200 } else { 4 };
                let entries: Vec<VariableEntry> = (0..count).map(|_| entry(tape)).collect();
                let mode = if how == 1 { VariableMode::SingleUser } else { VariableMode::MultiUser };
                let fits = self.reader.check(&entries).is_ok();
                assert_eq!(self.reader.begin(bus, &entries, mode, self.now).is_ok(), fits);
            }
            _ => {
                let look = self.reader.poll(bus, self.now)?;
                let count = self.reader.entries().len() as u32;
                if let VariablePoll::Values(new) = look {
                    assert!(new != 0 && 128 - new.leading_zeros() <= count);
                }
            }
        }
        assert_eq!(self.reader.values().len(), self.reader.entries().len());
        assert!(self.reader.entries().len() <= VARIABLE_READ_ENTRIES);
        let accesses = bus.take_accesses();
        assert!(accesses <= 2 * POLL_WORDS as u32 + 128 + 4, "{accesses}");
        let place = self.plan.variable_read();
        let read = &self.family.variable_read;
        let controls = [read.ready.word, read.count, read.start];
        bus.assert_written("variable_read", |offset| {
            within(&place, offset) || controls.iter().any(|control| control.bytes() == offset)
        });
        Ok(())
    }

    fn variable_write(&mut self, bus: &mut RamBus, how: u8, tape: &mut Tape<'_>) -> Result<(), PortError> {
        match how {
            0 => self.writer.release(bus)?,
            1 => {
                let given_up = self.writer.give_up(bus, self.now)?;
                assert!(given_up.uncertain <= self.writer.records_per_cycle());
            }
            2 => drop(self.writer.acquire(self.now)),
            3..=6 => {
                let count = usize::from(tape.u8()) % if how == 3 { 200 } else { 3 };
                let record = |tape: &mut Tape<'_>| {
                    let (address, value) = (tape.u16(), tape.u64());
                    match tape.u8() & 3 {
                        0 => WriteRecord::fixed48(register(Space::D, address), value as i64),
                        1 => WriteRecord::float48(register(Space::L, address), f64::from_bits(value)),
                        2 => {
                            WriteRecord::long(register(Space::L, address), value as u32, (value >> 32) as u32)
                        }
                        _ => {
                            WriteRecord::word(register(Space::Y, address), tape.u8(), tape.u8(), value as i64)
                        }
                    }
                };
                let records: Vec<WriteRecord> = (0..count).filter_map(|_| record(tape).ok()).collect();
                let idle = self.writer.is_idle();
                if self.writer.begin(bus, records)?.is_ok() {
                    assert!(idle);
                }
            }
            _ => drop(self.writer.poll(bus, self.now)?),
        }
        assert!(bus.take_accesses() <= 6 * POLL_RECORDS as u32 + 3);
        let place = self.plan.variable_write();
        let write = &self.family.variable_write;
        let controls = [write.count, write.start];
        bus.assert_written("variable_write", |offset| {
            within(&place, offset) || controls.iter().any(|control| control.bytes() == offset)
        });
        Ok(())
    }

    fn gather(&mut self, bus: &mut RamBus, how: u8, tape: &mut Tape<'_>) -> Result<(), PortError> {
        if how < 3 || self.gather.is_none() {
            let mode = if how == 0 { GatherMode::Stop } else { GatherMode::Wrap };
            let buffer = GatherBuffer {
                place: self.family.gather,
                room_longs: (self.family.length - self.family.gather.buffer.bytes()) / 4,
                size_longs: u32::from(tape.u16()),
                sample_longs: u32::from(tape.u8()) % 50,
                longest_sample: 48,
                mode,
                period: u32::from(tape.u8()),
            };
            let start = if how == 2 { GatherStart::Running } else { GatherStart::Defined };
            self.gather = GatherReader::new(buffer, start)
                .ok()
                .map(|reader| (reader, ServoTimer::new(self.family.servo.timer.bits())));
            return Ok(());
        }
        let family = self.family;
        let Some((reader, timer)) = &mut self.gather else { return Ok(()) };
        let before = (reader.written(), reader.lost());
        match how {
            3 => reader.stopped(),
            4 => reader.doubt_clock(),
            5 => {
                reader.restart(GatherStart::Running);
                return Ok(());
            }
            _ => {
                let look = reader.poll(bus, |bus: &mut RamBus| report_cycles(bus, &family.servo, timer))?;
                match look {
                    GatherPoll::Samples { count, .. } => {
                        assert!(count > 0 && reader.longs().len() == count * reader.sample_longs());
                    }
                    _ => assert!(reader.longs().is_empty()),
                }
            }
        }
        assert!(reader.longs().len() <= chunk_longs(48));
        assert!(reader.written() >= before.0 && reader.lost() >= before.1);
        assert!(reader.lost() + reader.waiting() <= reader.written());
        assert!(bus.take_accesses() <= 2 * chunk_longs(48) as u32 + 6);
        bus.assert_written("gather", |_| false);
        Ok(())
    }

    fn rotary(&mut self, bus: &mut RamBus, how: u8, tape: &mut Tape<'_>) -> Result<(), PortError> {
        // Of the 16 of a Turbo board, two.
        let which = usize::from(how & 1) * (self.rotary.len() - 1);
        let (stream, set_up) = &mut self.rotary[which];
        if how < 4 || set_up.is_none() {
            let setup = RotarySetup {
                start: HostOffset::checked(u32::from(tape.u16()) << 1).unwrap_or(self.family.user_area.start),
                size_longs: u32::from(tape.u16()),
                coordinate_system: tape.u8() & 15,
                coordinate_system_base: tape.u8() & 3,
            };
            match stream.set_up(bus, &setup) {
                Ok(()) => *set_up = Some(setup),
                Err(RotaryError::Bus(error)) => return Err(error.into()),
                Err(_) => {
                    bus.assert_written("a rotary buffer refused", |_| false);
                    return Ok(());
                }
            }
        }
        let Some(setup) = set_up else { return Ok(()) };
        bus.take_accesses();
        let result = match how {
            0..=3 => Ok(()),
            4 | 5 => {
                stream.finish();
                Ok(())
            }
            6 | 7 => stream.state(bus).map(|state| {
                assert!(state.ahead_longs < stream.size_longs() && state.ahead_lines <= state.sent_lines);
            }),
            _ => {
                let count = usize::from(tape.u8()) % 9;
                let line: Vec<(u32, u32)> = (0..count)
                    .map(|n| {
                        let (word1, word2) = (tape.u32() >> 8, tape.u32() >> 8);
                        (if n == 0 { word1 | 1 << 11 } else { word1 & !(1 << 11) }, word2)
                    })
                    .collect();
                stream.offer(bus, &line).map(drop)
            }
        };
        if let Err(RotaryError::Bus(error)) = result {
            return Err(error.into());
        }
        assert!(bus.take_accesses() <= 3 + 9 + 4 * 9);
        let ring = setup.start.bytes()..setup.start.bytes() + 4 * setup.size_longs;
        let header = self.family.rotary.headers[which].bytes();
        let header = header..header + 12;
        bus.assert_written("rotary", |offset| ring.contains(&offset) || header.contains(&offset));
        Ok(())
    }

    fn mailbox(&mut self, how: u8, tape: &mut Tape<'_>) {
        let (port, bus) = (&mut self.mailbox, &mut self.registers);
        bus.accesses = 0;
        match how {
            0 => port.start(bus, self.now).unwrap(),
            1 => {
                let line = tape.piece();
                if std::str::from_utf8(line).is_ok_and(|line| check_line(line).is_ok()) {
                    port.begin(bus, line).map(drop).unwrap();
                }
            }
            2 => port.control(bus, tape.u8() % 31 + 1, true, self.now).map(drop).unwrap(),
            3 => port.control(bus, tape.u8() % 31 + 1, false, self.now).map(drop).unwrap(),
            4 => port.give_up(bus, self.now).map(drop).unwrap(),
            5 | 6 => {
                // A group of a reply.
                for (byte, at) in tape.piece().iter().zip(1usize..) {
                    if let Some(register) = bus.bytes.get_mut(at * 2 - 1) {
                        *register = *byte;
                    }
                }
                port.signal(MailboxSignal::ReplyReady);
            }
            7 => port.signal(MailboxSignal::GroupTaken),
            8 => {
                let (at, value) = (tape.u16(), tape.u8());
                bus.bytes[usize::from(at) % 0x200] = value;
            }
            _ => {
                if let Some(AsciiEvent::Line(text) | AsciiEvent::ProgramMessage(text)) =
                    port.poll(bus, self.now).unwrap()
                {
                    assert!(text.as_bytes().len() <= 255);
                }
            }
        }
        assert!(bus.accesses <= 64, "{}", bus.accesses);
    }
}

fn within(region: &Region, offset: u32) -> bool {
    (region.start.bytes()..region.end.bytes()).contains(&offset)
}
