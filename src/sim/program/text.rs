//! Program lines as `LIST` shows them: short keywords while I9 is even, long ones while it is odd.

use std::fmt::Write as _;

use crate::sim::board::number::decimal;
use crate::sim::program::item::{AXES, Data, Item, Joint, Line, Mark, Message, Mode, Operator, PlcSwitch};
use crate::sim::program::words::{Keyword, name, name_of};

/// Most digits behind the point in a listing.
const DECIMALS: usize = 9;

/// The line as `LIST` shows it.
#[must_use]
pub fn line(line: &Line, long: bool) -> String {
    let items: Vec<String> = line.items.iter().map(|item| text(item, long)).collect();
    items.join(" ")
}

fn text(item: &Item, long: bool) -> String {
    match item {
        Item::Mode(Mode::Circle1) => format!("{}1", name(long, |word| matches!(word, Keyword::Circle))),
        Item::Mode(Mode::Circle2) => format!("{}2", name(long, |word| matches!(word, Keyword::Circle))),
        Item::Mode(Mode::Spline1) => "SPLINE1".into(),
        Item::Mode(Mode::Spline2) => "SPLINE2".into(),
        Item::Axis(axis, position, mark) => {
            let letter = char::from(AXES.get(*axis).copied().unwrap_or(b'?'));
            let mut text = format!("{letter}{}", data(position));
            if let Some((mark, value)) = mark {
                let sign = if *mark == Mark::Velocity { ':' } else { '^' };
                let _ = write!(text, "{sign}{}", data(value));
            }
            text
        }
        Item::Letter(letter, value) => format!("{}{}", char::from(*letter), data(value)),
        Item::Label(label) => format!("N{label}"),
        Item::Axes(mode, list) => {
            let word = name(long, |word| matches!(word, Keyword::Axes(own) if own == mode));
            match list {
                Some(list) => format!("{word}({})", comma_separated(list.iter().copied())),
                None => word.into(),
            }
        }
        Item::Home { zero, motors } => {
            let word = name(long, |word| matches!(word, Keyword::Home(own) if own == zero));
            format!("{word}{}", list(u64::from(*motors) << 1))
        }
        Item::Plc(switch, plcs) => format!("{} PLC{}", plc_switch(*switch, long), list((*plcs).into())),
        Item::Compiled(switch, plcs) => {
            format!("{} PLCC{}", plc_switch(*switch, long), list((*plcs).into()))
        }
        Item::Lock(lock) => lock.text(),
        Item::CutterCompensation(side) => format!("CC{side}"),
        Item::Assign(kind, number, operator, value) => {
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
            format!("{}{}{sign}{value}", kind.letter(), data(number))
        }
        Item::If(condition) => format!("IF({condition})"),
        Item::Also(Joint::And, condition) => format!("AND({condition})"),
        Item::Also(Joint::Or, condition) => format!("OR({condition})"),
        Item::While(condition) => format!("WHILE({condition})"),
        Item::Read(letters) => format!("READ({})", comma_separated(letters.iter().map(|&c| c.into()))),
        Item::Command(port, text) => {
            message(name(long, |word| matches!(word, Keyword::Command)), *port, text)
        }
        Item::Send(port, text) => message("SEND", *port, text),
        Item::Display(text) => name(long, |word| matches!(word, Keyword::Display)).to_owned() + text,
        Item::Address(motor, cs) => {
            let mut text = name(long, |word| matches!(word, Keyword::Address)).to_owned();
            for (mark, number) in [('#', motor), ('&', cs)] {
                if let Some(number) = number {
                    let _ = write!(text, "{mark}{}", number + 1);
                }
            }
            text
        }
        Item::Station(transfer) => transfer.text(),
        Item::SetPhase(motors) => format!("SETPHASE{}", list(u64::from(*motors) << 1)),
        _ => format!("{}{}", name_of(item, long), item.number().map_or_else(String::new, data)),
    }
}

fn plc_switch(switch: PlcSwitch, long: bool) -> &'static str {
    name(long, |word| matches!(word, Keyword::Plc(own) if *own == switch))
}

fn comma_separated(letters: impl Iterator<Item = char>) -> String {
    letters.map(String::from).collect::<Vec<_>>().join(",")
}

/// `word`, the letter of a port, and a text or a control character.
fn message(word: &str, port: Option<u8>, message: &Message) -> String {
    let port = port.map_or_else(String::new, |letter| char::from(letter).to_string());
    match message {
        Message::Text(text) => format!("{word}{port}\"{text}\""),
        Message::Character(code) => format!("{word}{port}^{}", char::from(code | 0x40)),
    }
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
