//! The commands of a command line.
//!
//! A board takes the longest word that fits, needs no blank behind it, and goes on with the next command (Software
//! Reference p. 17; User Manual p. 29). The lexer takes an unknown command as a statement of a program, word by word,
//! so that it finds a command behind it. Only a command that certainly asks counts as asking.

use super::command::Kind::{Asks, Changes, Moves, Statement};
use super::command::Needs::{Motor, Nothing, System};
pub use super::command::{Does, Effect, Kind, Needs, Token};
use super::number::{self, Numbers};
use super::reader::Reader;
use super::words::Word::Is;
use super::words::{LISTED, MEMORIES, OPENED, PROGRAM_WORDS, TABLES, WORDS, Word};
use crate::format::Text;

/// The digits of the longest hexadecimal address: `$07FFFF` on Turbo boards.
const ADDRESS_DIGITS: usize = 6;
const AXES: &[u8] = b"ABCUVWXYZ";

/// The commands of `line`, in their order. Blanks between commands belong to no command.
pub fn tokens(line: &[u8]) -> impl Iterator<Item = Token> {
    let mut reader = Reader { line, at: 0 };
    std::iter::from_fn(move || {
        reader.peek()?;
        let start = reader.at;
        let kind = command(&mut reader);
        if kind == Kind::Unknown {
            reader.at = start;
            unknown(&mut reader);
        }
        Some(Token { span: start..reader.at, kind })
    })
}

/// The next command. [`unknown`] takes an unknown one.
fn command(reader: &mut Reader<'_>) -> Kind {
    match reader.word(&WORDS).map(|(what, _)| what) {
        Some(Is(Kind::Password)) => return password(reader),
        Some(Is(kind @ Kind::Buffer(Effect::Closes))) => {
            reader.takes("ALL");
            return kind;
        }
        Some(Is(kind)) => return kind,
        Some(Word::List) => return list(reader),
        Some(Word::Open) => return open(reader),
        Some(Word::Define) => return Kind::Buffers(table(reader).needs()),
        Some(Word::Delete) => return table(reader),
        Some(Word::Station) => return station(reader),
        None => {}
    }
    let Some(first) = reader.byte() else { return Kind::Unknown };
    reader.at += 1;
    match first {
        b'"' => quoted(reader),
        b'#' => address(reader, first, Motor, Kind::Motor),
        b'&' => address(reader, first, System, Kind::System),
        b'@' => reader.number().map_or(Asks(Nothing), |card| Kind::Group(Nothing, card)),
        b'?' => match reader.skip_while(|byte| byte == b'?') {
            0 => Asks(Motor),
            1 => Asks(System),
            2 => Asks(Nothing),
            _ => Kind::Unknown,
        },
        axis if AXES.contains(&axis) && reader.takes("=") => {
            if constant(reader) {
                Changes(System)
            } else {
                Kind::Unknown
            }
        }
        b'I' | b'M' => variables(reader, first),
        b'P' | b'Q' if reader.is_next(b"0123456789(=,") => variables(reader, first),
        b'P' => Asks(Motor),
        b'V' | b'F' if reader.is_next(b"0123456789(=.-$") => Kind::Unknown,
        b'V' | b'F' => Asks(Motor),
        b'%' if reader.is_next(b"0123456789.") => {
            constant(reader);
            Moves(System, first)
        }
        b'%' => Asks(System),
        b'J' => jog(reader),
        b'$' => {
            let more = reader.skip_while(|byte| byte == b'$');
            reader.skip_while(|byte| byte == b'*');
            if more < 2 { Moves(Motor, first) } else { Kind::Resets }
        }
        b'O' if reader.is_next(b"0123456789-.$(") => {
            constant(reader);
            Moves(Motor, first)
        }
        b'K' => Moves(Motor, first),
        b'R' if reads_memory(reader) => Asks(Nothing),
        b'W' if writes_memory(reader) => Kind::WritesMemory,
        b'B' => {
            constant(reader);
            Moves(System, first)
        }
        b'Z' if !reader.is_next(b"0123456789(.-+$") => Changes(System),
        b'A' | b'H' | b'Q' | b'R' | b'S' | b'\\' | b'/' | b'<' | b'>' => Moves(System, first),
        _ => Kind::Unknown,
    }
}

/// Reads on behind a quotation mark.
fn quoted(reader: &mut Reader<'_>) -> Kind {
    reader.skip_while(|byte| byte != b'"');
    reader.at = reader.line.len().min(reader.at + 1);
    Kind::Quoted
}

/// Reads on behind `PASSWORD`: a password, with quotation marks or without.
fn password(reader: &mut Reader<'_>) -> Kind {
    reader.takes("=");
    if reader.takes("\"") {
        quoted(reader);
    } else {
        reader.skip_while(|byte| !b" #&".contains(&byte));
    }
    Kind::Password
}

/// Takes a statement of a program, or a letter and the letters behind it up to a command that moves a motor, or
/// another byte; then the numbers and signs behind it.
fn unknown(reader: &mut Reader<'_>) {
    let start = reader.at;
    if reader.word(&PROGRAM_WORDS).is_none() {
        while reader.byte().is_some_and(|byte| byte.is_ascii_alphabetic())
            && (reader.at == start || !begins_move(reader))
        {
            reader.at += 1;
        }
    }
    let letters = reader.at - start;
    let word = &reader.line[start..reader.at];
    // `MS$$$0` resets a station of a MACRO ring.
    if [&b"MS"[..], b"MACROSLV"].iter().any(|of_station| word.eq_ignore_ascii_case(of_station)) {
        reader.peek();
        reader.skip_while(|byte| b"$*".contains(&byte));
    }
    if letters == 0 && !reader.parenthesis_here() && !reader.takes("->") {
        reader.at += 1;
    }
    loop {
        let end = reader.at;
        let goes_on = match reader.peek() {
            Some(b'(') => reader.parenthesis_here(),
            Some(b'-') if reader.takes("->") => true,
            Some(b'$') if reader.is_hexadecimal() => {
                reader.at += 1;
                reader.hexadecimal().is_some()
            }
            Some(byte) if byte.is_ascii_digit() || b".,=:+-*^|!".contains(&byte) => {
                reader.at += 1;
                true
            }
            _ => false,
        };
        if !goes_on {
            reader.at = end;
            return;
        }
    }
}

/// Whether a jog or a homing begins here.
fn begins_move(reader: &Reader<'_>) -> bool {
    let mut behind = reader.clone();
    behind.takes("J") && behind.is_next(b"+-=:^/")
        || ["HM", "HOME"].iter().any(|word| reader.clone().takes(word))
}

/// Reads on behind a `#` or an `&`.
fn address(reader: &mut Reader<'_>, sign: u8, needs: Needs, kind: fn(u32) -> Kind) -> Kind {
    if reader.byte() == Some(sign) {
        reader.at += 1;
        return reader.number().map_or(Asks(Nothing), |number| Kind::Group(needs, number));
    }
    let Some(number) = reader.number() else { return Asks(needs) };
    if !reader.takes("->") {
        return kind(number);
    }
    match reader.peek() {
        _ if needs != Motor => Kind::Unknown,
        None | Some(b'#' | b'&') => Kind::AxisOf(number),
        _ if reader.takes(",") => Kind::AxisOf(number),
        _ if axes(reader) => Kind::DefinesAxis(number),
        _ => Kind::Unknown,
    }
}

/// The definition of a motor's axis: `0`, `I`, `100X`, `70.7X-70.7Y+5`. Each term but the first begins with a sign;
/// only the last may have no letter.
fn axes(reader: &mut Reader<'_>) -> bool {
    let mut has_term = false;
    loop {
        let before = reader.at;
        let is_signed = reader.takes("+") || reader.takes("-");
        if has_term && !is_signed {
            return true;
        }
        reader.peek();
        let has_number = reader.skip_while(|byte| byte.is_ascii_digit() || byte == b'.') > 0;
        if !reader.is_next(b"ABCUVWXYZI") {
            if !has_number {
                reader.at = before;
            }
            return has_term || has_number;
        }
        reader.peek();
        reader.at += 1;
        has_term = true;
    }
}

/// Reads on behind a variable's letter.
fn variables(reader: &mut Reader<'_>, letter: u8) -> Kind {
    let Some(numbers) = Numbers::read(reader) else { return Kind::Unknown };
    if letter == b'M' && reader.takes("->") {
        // Text that cannot be a definition's place is a command of its own.
        return match reader.peek() {
            None | Some(b'M' | b'#' | b'&' | b'I' | b'P' | b'Q') => {
                Kind::Variables(letter, numbers, Does::AsksPlace)
            }
            _ if m_place(reader) => Kind::Variables(letter, numbers, Does::Defines),
            _ => Kind::Unknown,
        };
    }
    if reader.takes("==") {
        return Kind::Unknown;
    }
    if !reader.takes("=") {
        return Kind::Variables(letter, numbers, Does::Asks);
    }
    let start = reader.at;
    let value = number::value(reader);
    let is_word = reader.peek().is_some_and(|byte| byte.is_ascii_alphabetic());
    if value.is_none() && is_word && !begins_move(reader) {
        unknown(reader);
    }
    let is_whole = |value: &f64| value.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(value);
    let mut words = reader.line[start..reader.at].split(|byte| !byte.is_ascii_alphabetic());
    let of_system = letter == b'Q' || words.any(|word| word.eq_ignore_ascii_case(b"Q"));
    let value = value.filter(is_whole).map(|value| value as u32);
    Kind::Variables(letter, numbers, Does::Sets { value, of_system })
}

/// Where an M-variable points: `*`, `X:$C000,0,24,S`, `DP:$D800`.
fn m_place(reader: &mut Reader<'_>) -> bool {
    if reader.takes("*") {
        return true;
    }
    let letters = reader.skip_while(|byte| byte.is_ascii_alphabetic());
    let mut is_place = (1..=4).contains(&letters) && reader.takes(":") && register(reader);
    while is_place && reader.takes(",") {
        is_place = register(reader) || ["S", "U", "C"].iter().any(|field| reader.takes(field));
    }
    is_place
}

/// Reads on behind a J. A J with a number is a vector of a program.
fn jog(reader: &mut Reader<'_>) -> Kind {
    let Some(sign @ (b'+' | b'-' | b'/' | b'!' | b'=' | b':' | b'^')) = reader.peek() else {
        return Kind::Unknown;
    };
    reader.at += 1;
    if b"=:^".contains(&sign) {
        reader.takes("=");
        let _ = reader.takes("*") || constant(reader);
        let _ = reader.takes("^") && constant(reader);
    }
    Moves(Motor, sign)
}

/// Reads on behind `LIST`: the listed program or table, and the part of it. The text behind that is another command:
/// `LIST LINK HM`.
fn list(reader: &mut Reader<'_>) -> Kind {
    let listed = reader.word(&LISTED).map(|(needs, _)| needs);
    if listed.is_some() {
        reader.takes("DEF");
    }
    // `,S,80`: tools ask for the next lines by this. An S elsewhere is a step.
    while reader.takes(",S,") || reader.takes(",") || reader.takes(".") || reader.number().is_some() {}
    Kind::Lists(listed.unwrap_or(System))
}

/// Reads on behind `OPEN`: a buffer's name and number.
fn open(reader: &mut Reader<'_>) -> Kind {
    let (is_binary, name) = reader.word(&OPENED).unwrap_or_default();
    if is_binary {
        return Kind::Buffer(Effect::OpensBinary);
    }
    let start = reader.at;
    reader.peek();
    let number = reader.line[reader.at..].iter().take_while(|byte| byte.is_ascii_digit()).count();
    reader.at = if number == 0 { start } else { reader.at + number };
    let number = reader.line[reader.at - number..reader.at].utf8_chunks().next();
    let number = number.map_or("", |digits| digits.valid());
    let blank = if name.is_empty() || number.is_empty() { "" } else { " " };
    Kind::Buffer(Effect::Opens(Text::of(&format_args!("{name}{blank}{number}"))))
}

/// Reads on behind `DEFINE` or `DELETE`: a table or buffer, and numbers. Returns the kind of the deletion.
fn table(reader: &mut Reader<'_>) -> Kind {
    let table = reader.word(&TABLES).map_or(Kind::Buffers(Nothing), |(table, _)| table);
    while constant(reader) || [",", "*"].iter().any(|sign| reader.takes(sign)) {}
    table
}

/// Reads on behind `MS`: `0,I910`, a variable of a MACRO station.
fn station(reader: &mut Reader<'_>) -> Kind {
    let is_letter = |reader: &mut Reader<'_>| reader.peek().is_some_and(|byte| byte.is_ascii_alphabetic());
    if reader.number().is_none() || !reader.takes(",") || !is_letter(reader) {
        return Kind::Unknown;
    }
    reader.at += 1;
    match reader.number() {
        None => Kind::Unknown,
        Some(_) if reader.takes("=") => {
            number::value(reader);
            Statement(Nothing)
        }
        Some(_) => Asks(Nothing),
    }
}

/// Behind an R: takes `X$770`, `HY:$770` or the like, and returns whether it follows. Otherwise the R runs a program,
/// and another command follows: `RF100`, `RP1`.
fn reads_memory(reader: &mut Reader<'_>) -> bool {
    let start = reader.at;
    reader.takes("H");
    let has_space = reader.word(&MEMORIES).is_some();
    let has_colon = reader.takes(":");
    let is_address = has_space && (reader.is_next(b"$") || has_colon && reader.is_next(b"0123456789"));
    let is_read = is_address && register(reader) && (!reader.takes(",") || reader.number().is_some());
    if !is_read {
        reader.at = start;
    }
    is_read
}

/// Behind a W: takes a memory space, an address and its values, and returns whether they follow.
fn writes_memory(reader: &mut Reader<'_>) -> bool {
    let has_space = ["X", "Y", "L", "P"].iter().any(|space| reader.takes(space));
    reader.takes(":");
    let mut is_write = has_space && register(reader) && reader.takes(",") && constant(reader);
    while is_write && reader.takes(",") {
        is_write = constant(reader);
    }
    is_write
}

/// Takes a constant with its sign; returns whether one follows.
fn constant(reader: &mut Reader<'_>) -> bool {
    let start = reader.at;
    let _ = reader.takes("-") || reader.takes("+");
    let is_hexadecimal = reader.takes("$");
    reader.peek();
    let digits = reader.skip_while(|byte| {
        byte.is_ascii_digit() || if is_hexadecimal { byte.is_ascii_hexdigit() } else { byte == b'.' }
    });
    if digits == 0 {
        reader.at = start;
    }
    digits > 0
}

/// Takes an address: decimal, or `$` and at most [`ADDRESS_DIGITS`] hexadecimal digits; returns whether one follows.
fn register(reader: &mut Reader<'_>) -> bool {
    if !reader.takes("$") {
        return reader.number().is_some();
    }
    let digits = reader.skip_while(|byte| byte.is_ascii_hexdigit());
    (1..=ADDRESS_DIGITS).contains(&digits)
}
