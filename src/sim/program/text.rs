//! Program lines as `LIST` shows them: short keywords while I9 is even, long ones while it is odd.

use std::fmt::Write as _;

use crate::sim::board::axes::AxisMode;
use crate::sim::board::number::decimal;
use crate::sim::program::item::{AXES, Data, Item, Line, Mark, Mode, Operator, Time, Transform};

/// Most digits behind the point in a listing.
const DECIMALS: usize = 9;

/// The line as `LIST` shows it.
#[must_use]
pub fn line(line: &Line, long: bool) -> String {
    let items: Vec<String> = line.items.iter().map(|item| text(item, long)).collect();
    items.join(" ")
}

fn text(item: &Item, long: bool) -> String {
    let word = |full: &str, short: &str| if long { full.to_owned() } else { short.to_owned() };
    match item {
        Item::Mode(mode) => match mode {
            Mode::Linear => word("LINEAR", "LIN"),
            Mode::Rapid => word("RAPID", "RPD"),
            Mode::Circle1 => word("CIRCLE1", "CIR1"),
            Mode::Circle2 => word("CIRCLE2", "CIR2"),
            Mode::Spline1 => "SPLINE1".into(),
            Mode::Spline2 => "SPLINE2".into(),
            Mode::Pvt => "PVT".into(),
        },
        Item::Pvt(time) => format!("PVT{}", data(time)),
        Item::Axis(axis, position, mark) => {
            let letter = char::from(AXES.get(*axis).copied().unwrap_or(b'?'));
            let mut text = format!("{letter}{}", data(position));
            if let Some((mark, value)) = mark {
                let sign = if *mark == Mark::Velocity { ':' } else { '^' };
                let _ = write!(text, "{sign}{}", data(value));
            }
            text
        }
        Item::Vector(index, value) => {
            format!("{}{}", ["I", "J", "K"].get(*index).unwrap_or(&"?"), data(value))
        }
        Item::Letter(letter, value) | Item::Code(letter, value) => {
            format!("{}{}", char::from(*letter), data(value))
        }
        Item::Feedrate(value) => format!("F{}", data(value)),
        Item::Time(time, value) => {
            let name = match time {
                Time::Acceleration => "TA",
                Time::SCurve => "TS",
                Time::Move => "TM",
            };
            format!("{name}{}", data(value))
        }
        Item::Dwell(time) => word("DWELL", "DWE") + &data(time),
        Item::Delay(time) => word("DELAY", "DLY") + &data(time),
        Item::Call(value) => format!("CALL{}", data(value)),
        Item::Goto(value) => format!("GOTO{}", data(value)),
        Item::Gosub(value) => format!("GOSUB{}", data(value)),
        Item::Label(label) => format!("N{label}"),
        Item::Return => word("RETURN", "RET"),
        Item::Normal => word("NORMAL", "NRM"),
        Item::Pset => "PSET".into(),
        Item::Axes(mode, list) => {
            let name = match mode {
                AxisMode::Absolute => "ABS",
                AxisMode::Incremental => "INC",
                AxisMode::Feedrate => "FRAX",
            };
            match list {
                Some(list) => {
                    let letters: Vec<String> = list.iter().map(char::to_string).collect();
                    format!("{name}({})", letters.join(","))
                }
                None => name.into(),
            }
        }
        Item::Home { zero, motors } => {
            let name = if *zero { word("HOMEZ", "HMZ") } else { word("HOME", "HM") };
            name + &list(u64::from(*motors) << 1)
        }
        Item::Plc(switch, plcs) => {
            let (long, short) = switch.words();
            format!("{} PLC{}", word(long, short), list((*plcs).into()))
        }
        Item::Compiled(switch, plcs) => {
            let (long, short) = switch.words();
            format!("{} PLCC{}", word(long, short), list((*plcs).into()))
        }
        Item::Lock(lock) => lock.text(),
        Item::Stop => "STOP".into(),
        Item::BlockStart => word("BLOCKSTART", "BSTART"),
        Item::BlockStop => word("BLOCKSTOP", "BSTOP"),
        Item::Wait => "WAIT".into(),
        Item::CutterCompensation(side) => format!("CC{side}"),
        Item::CutterRadius(value) => format!("CCR{}", data(value)),
        Item::Select(value) => word("TSELECT", "TSEL") + &data(value),
        Item::Identity => "TINIT".into(),
        Item::Transform(transform, value) => {
            let name = match transform {
                Transform::AbsoluteDisplacement => "ADIS",
                Transform::AbsoluteRotation => "AROT",
                Transform::IncrementalDisplacement => "IDIS",
                Transform::IncrementalRotation => "IROT",
            };
            format!("{name}{}", data(value))
        }
        Item::Assign(kind, number, operator, value) => {
            let letter = kind.letter();
            let sign = match operator {
                Operator::Assign => "=",
                Operator::AssignLater => "==",
                Operator::Or => "|=",
                Operator::Xor => "^=",
                Operator::And => "&=",
            };
            let value = match value {
                Data::Constant(value) => decimal(*value, DECIMALS),
                Data::Expression(text) => text.to_string(),
            };
            format!("{letter}{}{sign}{value}", data(number))
        }
        Item::If(condition) => format!("IF({condition})"),
        Item::Also(joint, condition) => format!("{}({condition})", joint.word()),
        Item::Else => "ELSE".into(),
        Item::EndIf => word("ENDIF", "ENDI"),
        Item::While(condition) => format!("WHILE({condition})"),
        Item::EndWhile => word("ENDWHILE", "ENDW"),
        Item::Read(letters) => {
            let letters: Vec<String> = letters.iter().map(|&c| char::from(c).to_string()).collect();
            format!("READ({})", letters.join(","))
        }
        Item::Command(port, text) => word("COMMAND", "CMD") + &quoted(*port, text),
        Item::CommandCharacter(port, code) => word("COMMAND", "CMD") + &character(*port, *code),
        Item::Send(port, text) => format!("SEND{}", quoted(*port, text)),
        Item::SendCharacter(port, code) => format!("SEND{}", character(*port, *code)),
        Item::Display(text) => word("DISPLAY", "DISP") + text,
        Item::Address(motor, cs) => {
            let mut text = word("ADDRESS", "ADR");
            if let Some(motor) = motor {
                let _ = write!(text, "#{}", motor + 1);
            }
            if let Some(cs) = cs {
                let _ = write!(text, "&{}", cs + 1);
            }
            text
        }
        Item::Station(transfer) => transfer.text(),
        Item::SetPhase(motors) => format!("SETPHASE{}", list(u64::from(*motors) << 1)),
    }
}

/// A text behind the letter of its port.
fn quoted(port: Option<u8>, text: &str) -> String {
    format!("{}\"{text}\"", port_letter(port))
}

/// A control character behind the letter of its port.
fn character(port: Option<u8>, code: u8) -> String {
    format!("{}^{}", port_letter(port), char::from(code | 0x40))
}

fn port_letter(port: Option<u8>) -> String {
    port.map_or(String::new(), |letter| char::from(letter).to_string())
}

fn data(data: &Data) -> String {
    match data {
        Data::Constant(value) => decimal(*value, DECIMALS),
        Data::Expression(text) => format!("({text})"),
    }
}

/// The numbers of the set bits; three or more in a row become a range.
fn list(bits: u64) -> String {
    let mut parts = Vec::new();
    let mut at = 0;
    while at < 64 {
        if bits >> at & 1 == 0 {
            at += 1;
            continue;
        }
        let length = (bits >> at).trailing_ones() as usize;
        match length {
            1 => parts.push(at.to_string()),
            2 => parts.push(format!("{at},{}", at + 1)),
            _ => parts.push(format!("{at}..{}", at + length - 1)),
        }
        at += length;
    }
    parts.join(",")
}
