//! Binary rotary buffers: a program streams its motion program line by line, over the daemon's stream.
//!
//! The stream begins with the program's first line. The daemon opens the board's rotary buffers and starts the program by
//! itself, so the lines by which a program for PComm32 does that succeed and wait for that first line.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, Weak};
use std::thread;
use std::time::Duration;

use pmac_dpram::client::{CommandError, Connection, RotaryLine, RotaryPlace};
use pmac_dpram::protocol::CallError;
use pmac_dpram::rotary::{Reason, Settings, compile, compile_stream};

use crate::device::{Device, lock};
use crate::fault::Fault;
use crate::process::{spawn, with};
use crate::variables::family;

/// The vendor's return codes.
pub(crate) const OK: i16 = 0;
/// The board has no room yet: the line waits, and goes in before the next.
pub(crate) const BUSY: i16 = 1;
const NO_MEMORY: i16 = -59;
const FLOAT: i16 = -60;
const CONVERSION: i16 = -61;
const ILLEGAL: i16 = -62;
const RANGE: i16 = -63;
/// A syntax error, and every failure without a code of its own: programs end on it.
pub(crate) const SYNTAX: i16 = -70;

/// How long a line may wait for room before the program hears that the buffer is busy.
const ROOM: Duration = Duration::from_millis(50);
/// The daemon ends a stream after 5 s without a call.
const RENEW: Duration = Duration::from_secs(1);
/// Lines that wait for room. A program that goes on after BUSY does not fill the memory.
const WAITING_MAX: usize = 1000;

/// The buffers of a device, by the program's numbers.
pub(crate) type Buffers = BTreeMap<u16, Arc<Mutex<Buffer>>>;

/// A buffer, from its announcement on.
pub(crate) struct Buffer {
    /// The daemon's number.
    number: u8,
    system: u8,
    settings: Settings,
    /// The program has started the rotary program; `R` goes with its first lines.
    run: bool,
    modes: Vec<String>,
    stream: Option<Connection>,
    sent: u64,
    waiting: VecDeque<RotaryLine>,
    /// The stream has failed: no line follows a missing one.
    failed: Option<Fault>,
}

/// A failure and its code.
type Failed = (i16, Fault);

/// The outcome as the vendor's code; keeps the failure for `PmacGetError`.
fn coded(number: u32, work: impl FnOnce(&Device) -> Result<i16, Failed>) -> i16 {
    let mut code = SYNTAX;
    let done = with(number, |device| {
        work(device).map_err(|(failed, fault)| {
            code = failed;
            fault
        })
    });
    done.unwrap_or(code)
}

fn plain(fault: impl Into<Fault>) -> Failed {
    (SYNTAX, fault.into())
}

impl Buffer {
    /// The buffer that feeds the coordinate system after `index`, in the daemon's room.
    fn new(device: &Device, index: u16) -> Result<Self, Failed> {
        let family = family(device).map_err(plain)?;
        let system = usize::from(index) + 1;
        if system > family.coordinate_systems {
            let why = format!(
                "buffer {index}: the board has coordinate systems 1 to {}",
                family.coordinate_systems
            );
            return Err(plain(Fault::argument(why)));
        }
        let of_the_daemon = device.ask(Connection::settings).map_err(plain)?;
        let mut settings = of_the_daemon.rotary_format().of(family);
        let place = family.rotary.index_for(system);
        let kept = of_the_daemon.plan.rotary_longs(family).get(place).copied().unwrap_or_default();
        if kept == 0 {
            let why = "pmacd reserves no room for this rotary buffer; set rotary_longs in its configuration";
            return Err((NO_MEMORY, Fault::refused(why)));
        }
        settings.buffer_words = kept.min(settings.buffer_words);
        settings.check().map_err(|error| plain(Fault::refused(error.to_string())))?;
        // A family has 32 systems at most.
        let (number, system) = (place as u8 + 1, system as u8);
        Ok(Self {
            number,
            system,
            settings,
            run: false,
            modes: Vec::new(),
            stream: None,
            sent: 0,
            waiting: VecDeque::new(),
            failed: None,
        })
    }

    /// Converts a line, and keeps its commands for the stream.
    fn take(&mut self, text: &[u8]) -> Result<(), Failed> {
        let refused = |refused: pmac_dpram::rotary::Refused| match refused.errors.listed.first() {
            Some(first) => {
                (code(&first.what), Fault::refused(format!("column {}: {}", first.column, first.what)))
            }
            None => plain(Fault::refused(refused.to_string())),
        };
        let is_first = self.stream.is_none() && self.waiting.is_empty();
        let program = if is_first {
            let (compiled, modes) = compile_stream(text, &self.settings).map_err(refused)?;
            self.modes.extend(modes);
            compiled.program
        } else {
            compile(text, &self.settings).map_err(refused)?.program
        };
        if self.waiting.len() >= WAITING_MAX {
            return Err((
                NO_MEMORY,
                Fault::refused(format!("{WAITING_MAX} lines wait for room: repeat the call with \"\"")),
            ));
        }
        let words = |line: &pmac_dpram::rotary::Line| {
            line.commands.iter().map(|command| (command.word1, command.word2)).collect()
        };
        self.waiting.extend(program.lines.iter().map(words));
        Ok(())
    }

    /// Begins the stream, unless it has begun.
    fn begin(&mut self, device: &Device) -> Result<(), Failed> {
        if self.stream.is_some() {
            return Ok(());
        }
        let mut stream = device.connect().map_err(plain)?;
        let place = RotaryPlace {
            buffer: self.number,
            coordinate_system: self.system,
            coordinate_system_base: self.settings.coordinate_system_base,
            run: self.run,
            // Only the program knows how it goes on.
            may_stand: true,
            modes: std::mem::take(&mut self.modes),
            ..RotaryPlace::default()
        };
        stream.rotary_start(place).map_err(|error| plain(Fault::from(error)))?;
        self.sent = 0;
        self.stream = Some(stream);
        Ok(())
    }

    /// Sends the lines that wait, as far as the board has room.
    fn send(&mut self) -> Result<i16, Failed> {
        let Some(stream) = &mut self.stream else { return Ok(OK) };
        while let Some(line) = self.waiting.front() {
            match stream.rotary_send(self.number, self.sent, std::slice::from_ref(line), ROOM) {
                Ok(()) => {}
                Err(CommandError::Refused(CallError::TimedOut { .. })) => {
                    let state =
                        stream.rotary_state(self.number).map_err(|error| plain(Fault::from(error)))?;
                    if state.sent_lines <= self.sent {
                        return Ok(BUSY);
                    }
                }
                Err(error) => {
                    let told = stream.rotary_stop(self.number).ok().and_then(|stop| stop.reason);
                    let fault = Fault::from(error);
                    return Err(plain(told.map_or(fault, Fault::refused)));
                }
            }
            self.sent += 1;
            self.waiting.pop_front();
        }
        Ok(OK)
    }

    /// Ends the stream. A program that the board has whole goes on; any other ends.
    fn end(&mut self) -> Result<(), Fault> {
        self.waiting.clear();
        let Some(mut stream) = self.stream.take() else { return Ok(()) };
        // Refused for a stream that has ended already; the stop tells how.
        let _ = stream.rotary_finish(self.number);
        let stop = stream.rotary_stop(self.number)?;
        // The program's own `A` or `CLOSE` may have ended the stream before.
        match stop.ahead_lines {
            lines @ 1.. if stop.reason.is_none() => Err(Fault::refused(format!(
                "the board had not taken the last {lines} lines, and takes them no more"
            ))),
            _ => Ok(()),
        }
    }
}

/// The code of a command that the format cannot hold.
fn code(reason: &Reason) -> i16 {
    match reason {
        Reason::TooLarge { .. } => FLOAT,
        Reason::Range { .. } | Reason::VariableNumber(_) | Reason::LongHex => RANGE,
        Reason::Expression | Reason::Variable | Reason::Default => CONVERSION,
        Reason::Branch(_)
        | Reason::Text(_)
        | Reason::OnLine(_)
        | Reason::NoCode(_)
        | Reason::Wait
        | Reason::Label(_)
        | Reason::VariableRange
        | Reason::Untold(_)
        | Reason::BitCode(_) => ILLEGAL,
        Reason::LongLine { .. } => NO_MEMORY,
        _ => SYNTAX,
    }
}

/// Keeps the stream alive between two lines, as long as the buffer exists.
fn keep_alive(buffer: &Arc<Mutex<Buffer>>) {
    let weak: Weak<Mutex<Buffer>> = Arc::downgrade(buffer);
    let renew = move || {
        while let Some(buffer) = weak.upgrade() {
            if let Some(stream) = &mut lock(&buffer).stream {
                // The program's next call tells a failure.
                let _ = stream.sequence_renew();
            }
            drop(buffer);
            thread::sleep(RENEW);
        }
    };
    // Without a thread the stream ends when the program is silent for 5 s, and says so.
    let _ = spawn("pcomm32-rotary", renew);
}

/// `PmacDPRRotBufChange`, `PmacDPRRotBufInit`: announces a buffer. The daemon's configuration gives its size.
pub(crate) fn announce(number: u32, index: u16) -> i16 {
    coded(number, |device| {
        let buffer = Arc::new(Mutex::new(Buffer::new(device, index)?));
        keep_alive(&buffer);
        let before = lock(&device.buffers).insert(index, buffer);
        if let Some(before) = before {
            lock(&before).end().map_err(plain)?;
        }
        Ok(OK)
    })
}

/// `PmacDPRRotBufRemove`: ends the stream, and forgets the buffer.
pub(crate) fn remove(number: u32, index: u16) -> i16 {
    coded(number, |device| {
        let buffer = lock(&device.buffers).remove(&index).ok_or_else(|| plain(unknown(index)))?;
        lock(&buffer).end().map(|()| OK).map_err(plain)
    })
}

/// `PmacDPRRotBufClr`: ends the stream; the next line begins another.
pub(crate) fn clear(number: u32, index: u16) -> i16 {
    coded(number, |device| {
        let buffer = found(device, index)?;
        let mut buffer = lock(&buffer);
        let ended = buffer.end();
        *buffer = Buffer::new(device, index)?;
        ended.map(|()| OK).map_err(plain)
    })
}

/// `PmacDPRBufLast`: how many buffers there are, by the highest number.
pub(crate) fn last(number: u32) -> Result<i32, Fault> {
    with(number, |device| Ok(lock(&device.buffers).keys().next_back().map_or(0, |last| i32::from(*last) + 1)))
}

fn unknown(index: u16) -> Fault {
    Fault::argument(format!("there is no rotary buffer {index}: call PmacDPRRotBufChange first"))
}

fn found(device: &Device, index: u16) -> Result<Arc<Mutex<Buffer>>, Failed> {
    lock(&device.buffers).get(&index).cloned().ok_or_else(|| plain(unknown(index)))
}

/// `PmacDPRAsciiStrToRotA`: a line of the program; an empty line sends what waits.
pub(crate) fn line(number: u32, index: u16, text: Option<&[u8]>) -> i16 {
    put(number, index, |buffer| match text {
        Some(text) => buffer.take(text),
        None => Err(plain(Fault::argument("the line is NULL"))),
    })
}

/// `PmacDPRrotput`: commands as a program has converted them itself.
pub(crate) fn words(number: u32, index: u16, longs: Option<Vec<u32>>) -> i16 {
    let code = put(number, index, |buffer| match longs {
        Some(longs) if longs.len().is_multiple_of(2) => {
            buffer
                .waiting
                .push_back(longs.as_chunks().0.iter().map(|[first, second]| (*first, *second)).collect());
            Ok(())
        }
        _ => Err(plain(Fault::argument("two longs a command"))),
    });
    code.max(-1)
}

fn put(number: u32, index: u16, take: impl FnOnce(&mut Buffer) -> Result<(), Failed>) -> i16 {
    coded(number, |device| {
        let buffer = found(device, index)?;
        let mut buffer = lock(&buffer);
        if let Some(fault) = &buffer.failed {
            return Err(plain(fault.clone()));
        }
        take(&mut buffer)?;
        if buffer.waiting.is_empty() {
            return Ok(OK);
        }
        let sent = buffer.begin(device).and_then(|()| buffer.send());
        if let Err((_, fault)) = &sent {
            buffer.failed = Some(fault.clone());
            buffer.stream = None;
        }
        sent
    })
}

/// Takes a command line that opens the binary rotary buffers or starts the rotary program, if the program has announced
/// a buffer and its stream has not begun. The stream does both.
pub(crate) fn takes(device: &Device, line: &str) -> bool {
    // A buffer may be busy for long: the others stay free meanwhile.
    let buffers: Vec<_> = lock(&device.buffers).values().cloned().collect();
    if buffers.is_empty() {
        return false;
    }
    let text: String = line.chars().filter(|c| !c.is_whitespace()).map(|c| c.to_ascii_uppercase()).collect();
    if matches!(text.as_str(), "OPENBINROT" | "OPENBINARYROT" | "OPENBINROTARY" | "OPENBINARYROTARY") {
        return true;
    }
    let Some(system) = text.strip_suffix("B0R").and_then(|address| match address {
        "" => Some(None),
        address => Some(Some(address.strip_prefix('&')?.parse::<u8>().ok()?)),
    }) else {
        return false;
    };
    let mut waits = false;
    for buffer in &buffers {
        let mut buffer = lock(buffer);
        if system.is_none_or(|system| system == buffer.system) && buffer.stream.is_none() {
            buffer.run = true;
            waits = true;
        }
    }
    waits
}

#[cfg(test)]
mod tests {
    use super::*;

    fn first_code(text: &str) -> i16 {
        let refused = compile(text.as_bytes(), &Settings::default()).unwrap_err();
        code(&refused.errors.listed[0].what)
    }

    #[test]
    fn a_line_that_the_format_cannot_hold_has_the_vendors_code() {
        for (text, code) in [
            ("WHILE(1)", ILLEGAL),
            ("WAIT", ILLEGAL),
            ("SEND\"x\"", ILLEGAL),
            ("X(P1)", CONVERSION),
            ("~", SYNTAX),
            ("HELLO", SYNTAX),
        ] {
            assert_eq!(first_code(text), code, "{text}");
        }
    }
}
