//! Texts and numbers that a board sends, or a person types at it: replies on a serial line, answers to the daemon's questions,
//! status words, firmware versions, addresses, the board's number formats.

use std::time::{Duration, Instant};

use pmac_dpram::client::serial_reply::{self, Handshake};
use pmac_dpram::daemon::bus::identify::Identifier;
use pmac_dpram::daemon::bus::scale_doubts::ScaleDoubts;
use pmac_dpram::daemon::shared::open_buffer::{Account, OpenBuffer, Writer};
use pmac_dpram::format::{Float48Layout, TextOrder, fixed48, float32, float48, int24, write48};
use pmac_dpram::gather::Source;
use pmac_dpram::language::{Meaning, deadlines};
use pmac_dpram::map::PmacRegister;
use pmac_dpram::map::number;
use pmac_dpram::map::{Family, Firmware, Layout, PMAC, TURBO2, errors};
use pmac_dpram::protocol::{LINE_MAX, check_line, control};
use pmac_dpram::rotary::Constant;
use pmac_dpram::segment::Identity;
use pmac_dpram::setup::{absolute::AbsoluteFormat, position::Word};

use super::tape::Tape;

/// First byte: what the rest is.
pub fn body(data: &[u8]) {
    let Some((&way, rest)) = data.split_first() else { return };
    match way % 8 {
        0 => serial(rest),
        1 => identify(rest),
        2 => numbers(&mut Tape::new(rest)),
        3 => absolute(&mut Tape::new(rest)),
        4 => identity(rest),
        5 => lines(rest),
        _ => texts(&String::from_utf8_lossy(rest)),
    }
}

/// Bytes of a serial line, as they come in: an answer that was complete stays what it was, whatever comes behind it.
fn serial(bytes: &[u8]) {
    let Some((&bits, bytes)) = bytes.split_first() else { return };
    let handshake =
        Handshake { line_feeds: bits & 1 != 0, acknowledge: bits & 2 != 0, checksum: bits & 4 != 0 };
    let whole = serial_reply::parse(handshake, bytes);
    let half = serial_reply::parse(handshake, &bytes[..bytes.len() / 2]);
    if let serial_reply::SerialAnswer::Complete(reply) = &half {
        assert!(reply.lines.len() <= bytes.len());
        assert_eq!(half, whole);
    }
    if let Some(told) = serial_reply::recognise(bytes) {
        assert_ne!(serial_reply::parse(told, bytes), serial_reply::SerialAnswer::Unfinished);
    }
}

/// The daemon's own questions, and what comes back.
fn identify(bytes: &[u8]) {
    let mut now = Instant::now();
    let family = if bytes.len().is_multiple_of(2) { &PMAC } else { &TURBO2 };
    let mut identifier = Identifier::new(family, Identity::default(), true, now);
    let mut questions = 0;
    for reply in bytes.split(|&byte| byte == 0x06).take(64) {
        now += Duration::from_millis(300);
        let Some((line, patience)) = identifier.next_line(reply.len() as u16, now) else {
            identifier.ask_again(now);
            continue;
        };
        questions += 1;
        assert!(check_line(std::str::from_utf8(line.as_bytes()).unwrap()).is_ok() && patience.as_secs() < 10);
        identifier.sent();
        match reply.first() {
            Some(0x15) => identifier.failed(now),
            Some(0x16) => identifier.not_sent(),
            _ => {
                reply.split(|&byte| byte == b'\r').for_each(|line| identifier.line(line));
                identifier.done();
            }
        }
        if let Some(news) = identifier.take_update() {
            // What the daemon publishes is what a client reads, but for what does not fit.
            let read = Identity::decode(&news.encode()).expect("what was encoded is an identity");
            assert_eq!((read.i10, read.servo_report_cycles), (news.i10, news.servo_report_cycles));
            assert_eq!(read.motor_mask, news.motor_mask);
            assert_eq!((&read.ix07, &read.ix08), (&news.ix07, &news.ix08));
            assert_eq!((&read.ix09, &read.ix60), (&news.ix09, &news.ix60));
            if let Some(text) = &read.firmware {
                let said = news.firmware.as_deref().unwrap_or_default();
                assert!(said.starts_with(&text[..]), "{said:?} {text:?}");
            }
        }
    }
    assert!(questions <= 64);
}

fn identity(bytes: &[u8]) {
    let Some(identity) = Identity::decode(bytes) else { return };
    let again = Identity::decode(&identity.encode()).expect("what was encoded is an identity");
    assert_eq!(identity, again);
    let scales = pmac_dpram::client::identity::scales(&identity);
    if let Some(family) = pmac_dpram::client::identity::family(&identity) {
        assert!(pmac_dpram::client::identity::reported(&identity, family) <= family.motors);
    }
    let _ = scales.servo_period_ns();
}

fn numbers(tape: &mut Tape<'_>) {
    let (y, x) = (tape.u32(), tape.u32());
    let value = float48::decode(y, x);
    assert!(!value.is_nan());
    assert!(!Float48Layout::Printed.decode(y, x).is_nan());
    // Both ways once more: the second time nothing is rounded any more.
    let [y, x] = float48::encode(value);
    if value.is_finite() {
        assert_eq!(float48::decode(y, x), value);
    }
    let any = f64::from_bits(tape.u64());
    let [y, x] = float48::encode(any);
    let back = float48::decode(y, x);
    if any.is_nan() {
        assert_eq!(back, 0.0);
    } else if any.is_normal() && any.abs() < f64::MAX / 2.0 {
        assert!((back - any).abs() <= any.abs() * 2f64.powi(-34), "{any} {back}");
    }
    let whole = any.to_bits() as i64;
    let [y, x] = fixed48::encode(whole);
    assert_eq!(fixed48::decode(y, x), whole << 16 >> 16);
    let unpacked = write48::unpack(write48::pack([y, x])).map(int24::unsigned);
    assert_eq!(unpacked, [y, x].map(int24::unsigned));
    let words = float32::encode(f32::from_bits(y ^ x));
    assert_eq!(float32::decode(words[0], words[1]).to_bits(), y ^ x);
    let word = tape.u16();
    for order in [TextOrder::LowFirst, TextOrder::HighFirst] {
        let [first, second] = order.unpack(word);
        assert_eq!(order.pack(first, second), word);
    }
    let _ = errors::meaning(word);
}

/// Ix10, or Ixx10 and Ixx95, and the words that would be read by it.
fn absolute(tape: &mut Tape<'_>) {
    let (one, two, which) = (tape.u32(), tape.u32(), tape.u8());
    let format = if which & 1 == 0 { AbsoluteFormat::pmac(one) } else { AbsoluteFormat::turbo(one, two) };
    let Ok(format) = format else { return };
    assert!(
        format.registers.len() <= 6 && format.registers.iter().all(|part| part.from_bit + part.bits <= 24)
    );
    let text = String::from_utf8_lossy(tape.rest());
    let words: Vec<Word> = text.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    if let Ok(position) = format.position(&words) {
        let bits = format.bits.unwrap_or(63);
        assert!(position.unsigned_abs() <= 1 << bits, "{position} in {bits} bits");
    }
    assert!(serde_json::to_string(&format).is_ok());
}

/// Command lines, and what the daemon takes them for.
fn lines(bytes: &[u8]) {
    let mut buffer = OpenBuffer::default();
    let now = Instant::now();
    for line in bytes.split(|&byte| byte == b'\r') {
        let meaning = Meaning::of(line);
        let _ = ScaleDoubts::of(&meaning);
        match line {
            // Control characters are no lines; those that open and close a buffer go as `OPEN ROT` and `CLOSE`.
            &[byte] if byte < 32 => {}
            _ => {
                buffer.begin(&meaning, Writer::Hand(Account { uid: 0, pid: 1 }), now);
                if let Some(barred) = buffer.bars(&meaning, Writer::Question) {
                    assert!(!barred.reason(now).is_empty());
                }
                buffer.done(&meaning);
            }
        }
        if let Ok(text) = std::str::from_utf8(line)
            && check_line(text).is_ok()
        {
            assert!((1..=LINE_MAX).contains(&line.len()) && line.iter().all(|byte| (32..127).contains(byte)));
            assert!(meaning.deadline(Duration::ZERO) <= deadlines::LONGEST);
        }
    }
    buffer.done(&Meaning::of("CLOSE"));
    assert!(!buffer.is_open());
}

fn texts(text: &str) {
    if let Ok(firmware) = text.parse::<Firmware>() {
        assert_eq!(firmware.to_string().parse(), Ok(firmware));
        let _ = Layout::new(Family::by_name("pmac").unwrap(), Some(firmware));
    }
    if let Ok(source) = text.parse::<PmacRegister>() {
        assert_eq!(source.to_string().parse::<PmacRegister>().ok(), Some(source));
    }
    let layout = Layout::new(Family::by_name("pmac2").unwrap(), None);
    if let Ok(source) = Source::parse(text, &layout) {
        assert!(source.longs() <= 7);
    }
    if let Some(byte) = control::parse(text) {
        assert_eq!(control::parse(&control::name(byte)), Some(byte));
    }
    let _ = (number::parse(text), text.parse::<Word>(), Family::by_name(text));
    let constant = Constant::decimal(text.as_bytes());
    assert!(!constant.value().is_nan());
    let _ = constant.integer();
}
