//! What a line does to the program buffers: opens one, closes what is open, or enters what is open.

use std::ops::Range;

use super::line::{command_bytes, resets};
use super::tokens::{self, Kind};
use crate::format::Text;

/// The longest name of a buffer: `PROG 32767`.
pub const NAME_MAX: usize = 16;
const OPEN: &str = "OPEN";
const CLOSES: [&str; 2] = ["CLOSE", "CLS"];
const CLEARS: [&str; 2] = ["CLEAR", "CLR"];
const BUFFERS: [&str; 9] = ["PROG", "PLCC", "PLC", "BINARY", "BIN", "ROTARY", "ROT", "FORWARD", "INVERSE"];
/// What stands between `OPEN` and `ROTARY`.
const BINARY: [&str; 2] = ["BINARY", "BIN"];

/// What a line does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effect {
    /// It opens the buffer of this name: `PROG 77`.
    Opens(Text<NAME_MAX>),
    /// It opens the rotary buffers for binary lines, and so for no text (Software Reference p. 271).
    OpensBinary,
    /// It closes what is open.
    Closes,
}

/// Whether `line` is `CLOSE`, or `CLOSE ALL` (Turbo Software Reference p. 381), and nothing else.
#[must_use]
pub fn is_close(line: &[u8]) -> bool {
    let is_closes = |line: &[u8]| CLOSES.iter().any(|word| line.eq_ignore_ascii_case(word.as_bytes()));
    let line = line.trim_ascii();
    let before_all =
        line.split_last_chunk().filter(|(_, all): &(_, &[u8; 3])| all.eq_ignore_ascii_case(b"ALL"));
    is_closes(line) || before_all.is_some_and(|(before, _)| is_closes(before.trim_ascii_end()))
}

/// What a line comes to while a program buffer is open. `J+` and its like are on-line only, and "cannot be entered into a program buffer"
/// (User Manual p. 29): the board carries them out at once, as it does `&1R` (Software Reference p. 273).
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct WhileOpen {
    /// A part of it is a statement of a program, or nobody knows that it is none.
    pub enters: bool,
    /// It opens, closes, empties or adds to program buffers.
    pub changes: bool,
    /// The board carries a command of it out at once.
    pub acts: bool,
    /// It may do so: no manual says of the command what becomes of it.
    pub may_act: bool,
}

impl WhileOpen {
    /// Of `line`. Asks for no memory.
    #[must_use]
    pub fn of(line: &[u8]) -> Self {
        let mut all = Self::default();
        let mut statement_goes_to = 0;
        tokens::each_known(line, |line, token| {
            let Range { start, end } = token.span;
            if start < statement_goes_to {
                return;
            }
            match place(line, start, end, token.kind) {
                Place::Tells => {}
                Place::Acts => all.acts = true,
                Place::MayAct => all.may_act = true,
                Place::Changes => all.changes = true,
                Place::Enters => all.enters = true,
                Place::Word => {
                    all.enters = true;
                    let next = line[end..].iter().position(|byte| b"#&".contains(byte));
                    statement_goes_to = next.map_or(line.len(), |at| end + at);
                }
            }
        });
        all
    }

    /// Whether nothing of the line touches what is open.
    #[must_use]
    pub const fn passes(self) -> bool {
        !self.enters && !self.changes
    }
}

/// What becomes of a command while a program buffer is open.
enum Place {
    /// It only addresses or asks.
    Tells,
    /// It is carried out.
    Acts,
    /// It may be.
    MayAct,
    /// It changes which buffer is open, or empties that.
    Changes,
    /// It is a statement.
    Enters,
    /// It begins a word that is a statement, as does what follows.
    Word,
}

/// The words of programs that begin as on-line commands of one letter do.
const STATEMENTS: [&str; 14] = [
    "ABS", "ADDRESS", "ADIS", "ADR", "AND", "AROT", "FRAX", "PVT", "RAPID", "READ", "RET", "RPD", "SPLINE",
    "STOP",
];
/// On-line commands that are words alone, and of which [`tokens`] does not say more.
const ACTING_WORDS: [&[u8]; 4] = [b"GAT", b"ENDG", b"MFLUSH", b"Z"];
const AXES: &[u8] = b"ABCUVWXYZ";

/// Of the command from `start` to `end` in `line`, which is in capitals.
fn place(line: &[u8], start: usize, end: usize, kind: Kind) -> Place {
    let (said, behind) = (line[start..end].trim_ascii_end(), &line[end..]);
    let begins = |words: &[&str]| words.iter().any(|word| line[start..].starts_with(word.as_bytes()));
    let [first, second] = [0, 1].map(|at| said.get(at).copied().unwrap_or(b' '));
    let next = behind.trim_ascii_start().first().copied().unwrap_or(b' ');
    // `R5`, `HM1`: a letter or word of a program has a number behind it, that of an on-line command has none.
    let has_number = first.is_ascii_alphabetic() && (next.is_ascii_digit() || b".($-+".contains(&next));
    let is_variable = b"IPQM".contains(&first) && said.len() > 1 && !second.is_ascii_alphabetic();
    match kind {
        Kind::Motor(_) | Kind::System(_) | Kind::AxisOf(_) | Kind::Version => Place::Tells,
        Kind::Variables(..) | Kind::SetsI(..) | Kind::Sets(..) => Place::Enters,
        _ if begins(&STATEMENTS) => Place::Word,
        _ if begins(&CLOSES) => Place::Changes,
        // `M1->`, too: `M1` alone is a statement, and no manual says of the arrow behind it what becomes of it.
        Kind::Asks(_) if is_variable => Place::Enters,
        Kind::Asks(_) if has_number && said.len() <= 2 => Place::Enters,
        Kind::Asks(_) => Place::Tells,
        Kind::Changes if b"#&".contains(&first) => Place::Tells,
        Kind::Changes => Place::MayAct,
        Kind::Moves(_) => match first {
            b'J' if is_jog(said, next) => Place::Acts,
            b'J' | b'B' => Place::Enters,
            b'$' if behind.first().is_some_and(u8::is_ascii_hexdigit) => Place::Enters,
            letter if has_number && letter != b'O' => Place::Enters,
            b'R' => Place::Acts,
            _ => Place::MayAct,
        },
        Kind::WritesMemory | Kind::Unknown => place_of_unknown(said),
    }
}

/// Whether `said` is `J` with a sign, before the byte `next`; with a number alone, which may be negative, it is a vector.
fn is_jog(said: &[u8], next: u8) -> bool {
    let sign = said[1..].trim_ascii_start();
    match sign.split_first() {
        Some((b'+' | b'-', rest)) => {
            let number = rest.trim_ascii_start().first().copied().unwrap_or(next);
            !(number.is_ascii_digit() || b".$(".contains(&number))
        }
        Some((sign, _)) => b"/=:^!".contains(sign),
        None => false,
    }
}

/// Of a command that [`tokens`] does not know.
fn place_of_unknown(said: &[u8]) -> Place {
    let letters = |text: &[u8]| text.iter().take_while(|byte| byte.is_ascii_alphabetic()).count();
    let (word, rest) = said.split_at(letters(said));
    let begins = |words: &[&str]| words.iter().any(|begin| word.starts_with(begin.as_bytes()));
    let only =
        |text: &[u8], bytes: &[u8]| text.iter().all(|byte| byte.is_ascii_digit() || bytes.contains(byte));
    let acts = match word {
        _ if word.starts_with(OPEN.as_bytes()) || begins(&CLEARS) || begins(&["LEARN"]) => {
            return Place::Changes;
        }
        b"" if said.strip_prefix(b"@").is_some_and(|card| only(card, b"")) => return Place::Tells,
        b"WX" | b"WY" | b"WL" | b"WP" => only(rest, b"$ABCDEF,:.- "),
        b"PASSWORD" => true,
        [axis] if AXES.contains(axis) && rest.starts_with(b"=") => only(&rest[1..], b"+-.$ "),
        b"M" => arrow(rest).is_some_and(|(number, place)| only(number, b". ") && is_m_place(place)),
        b"" => arrow(said).is_some_and(|(motor, axes)| only(motor, b"# ") && is_axis_definition(axes)),
        _ if begins(&["DEF", "DEL", "UNDEF"]) => is_buffer_definition(said),
        _ => rest.is_empty() && ACTING_WORDS.contains(&word),
    };
    if acts { Place::MayAct } else { Place::Enters }
}

/// What stands before the arrow of a definition, and behind it.
fn arrow(said: &[u8]) -> Option<(&[u8], &[u8])> {
    let at = said.windows(2).position(|two| two == b"->")?;
    Some((&said[..at], said[at + 2..].trim_ascii()))
}

/// Whether `place` is where an M-variable points, and nothing more: `*`, `X:$C000,0,24,S`, `DP:$D800`.
fn is_m_place(place: &[u8]) -> bool {
    let digits = |text: &[u8]| match text.strip_prefix(b"$") {
        Some(digits) => !digits.is_empty() && digits.iter().all(u8::is_ascii_hexdigit),
        None => !text.is_empty() && text.iter().all(u8::is_ascii_digit),
    };
    let Some(colon) = place.iter().position(|byte| *byte == b':') else { return place == b"*" };
    let (kind, address) = (&place[..colon], &place[colon + 1..]);
    let is_field = |field: &[u8]| digits(field) || matches!(field, [b'S' | b'U' | b'C']);
    (1..=4).contains(&kind.len())
        && kind.iter().all(u8::is_ascii_uppercase)
        && address.split(|byte| *byte == b',').enumerate().all(|(at, field)| match at {
            0 => digits(field.trim_ascii()),
            _ => is_field(field.trim_ascii()),
        })
}

/// Whether `axes` defines a motor's axis, and nothing more: `0`, `I`, `100X`, `70.7X-70.7Y+5`.
fn is_axis_definition(axes: &[u8]) -> bool {
    let mut rest = axes;
    let mut letters = 0;
    while !rest.is_empty() {
        let signed = rest.strip_prefix(b"+").or(rest.strip_prefix(b"-"));
        // Each term but the first begins with a sign; only the last one may have no letter.
        let begins = rest.len() == axes.len() || signed.is_some();
        let term = signed.unwrap_or(rest).trim_ascii_start();
        let number = term.iter().take_while(|byte| byte.is_ascii_digit() || **byte == b'.').count();
        let behind = term[number..].trim_ascii_start();
        rest = match behind.split_first() {
            Some((letter, behind)) if begins && (AXES.contains(letter) || *letter == b'I') => {
                letters += 1;
                behind.trim_ascii_start()
            }
            None => return begins && number > 0,
            _ => return false,
        };
    }
    letters > 0
}

/// Whether `said`, a word and numbers, defines or deletes a buffer, and does nothing more.
fn is_buffer_definition(said: &[u8]) -> bool {
    const DOING: [&str; 6] = ["UNDEFINE", "UNDEF", "DEFINE", "DEF", "DELETE", "DEL"];
    const BUFFERS: [&str; 21] = [
        "",
        "ALL",
        "BLCOMP",
        "CCBUF",
        "CCUBUF",
        "COMP",
        "GAT",
        "GATHER",
        "LOOK",
        "LOOKAHEAD",
        "PLCC",
        "ROT",
        "ROTARY",
        "TBUF",
        "TBUFFER",
        "TCOMP",
        "TEMPS",
        "TRACE",
        "TRANS",
        "UBUF",
        "UBUFFER",
    ];
    let numbers =
        said.iter().position(|byte| !byte.is_ascii_alphabetic() && *byte != b' ').unwrap_or(said.len());
    let (words, numbers) = said.split_at(numbers);
    let known = DOING.iter().any(|doing| BUFFERS.iter().any(|buffer| is_both(words, doing, buffer)));
    known && numbers.iter().all(|byte| byte.is_ascii_digit() || b"$,.*- ".contains(byte))
}

/// Whether `words` are these two, with or without blanks.
fn is_both(words: &[u8], one: &str, other: &str) -> bool {
    words.iter().filter(|byte| **byte != b' ').eq(one.as_bytes().iter().chain(other.as_bytes()))
}

/// What `line` does to the buffers in the end; `None` when it leaves them as they are.
#[must_use]
pub fn effect(line: &[u8]) -> Option<Effect> {
    let mut effect = None;
    for part in command_bytes(line) {
        let mut rest = part;
        while let Some(start) = rest.iter().position(u8::is_ascii_alphabetic) {
            rest = &rest[start..];
            let end = rest.iter().position(|byte| !byte.is_ascii_alphabetic()).unwrap_or(rest.len());
            let (word, behind) = rest.split_at(end);
            if CLOSES.iter().any(|close| word.eq_ignore_ascii_case(close.as_bytes())) {
                effect = Some(Effect::Closes);
            } else if let Some(name) = opened_by(word, behind) {
                effect =
                    Some(if BINARY.contains(&&*name) { Effect::OpensBinary } else { Effect::Opens(name) });
            }
            rest = behind;
        }
        // No buffer is open after a reset.
        if resets(part) {
            effect = Some(Effect::Closes);
        }
    }
    effect
}

/// The buffer that `word` opens, or `word` together with what stands `behind` it; `None` when it opens none. Letters before
/// `OPEN` are commands of their own: `#8KOPENPROG3`.
fn opened_by(word: &[u8], behind: &[u8]) -> Option<Text<NAME_MAX>> {
    let at = word.windows(OPEN.len()).rposition(|part| part.eq_ignore_ascii_case(OPEN.as_bytes()))?;
    let kind = &word[at + OPEN.len()..];
    let known =
        |kind: &[u8]| BUFFERS.iter().find(|known| kind.eq_ignore_ascii_case(known.as_bytes())).copied();
    let spaces = |text: &[u8]| text.iter().take_while(|byte| **byte == b' ').count();
    let (name, number) = if kind.is_empty() {
        let behind = &behind[spaces(behind)..];
        let end = behind.iter().position(|byte| !byte.is_ascii_alphabetic()).unwrap_or(behind.len());
        (known(&behind[..end]).unwrap_or(""), &behind[end..])
    } else {
        (known(kind)?, behind)
    };
    let number = &number[spaces(number)..];
    let digits = number.iter().take_while(|byte| byte.is_ascii_digit()).count();
    let mut text = [b' '; NAME_MAX];
    let letters = name.len().min(NAME_MAX);
    text[..letters].copy_from_slice(&name.as_bytes()[..letters]);
    let room = digits.min(NAME_MAX - letters - 1);
    text[letters + 1..letters + 1 + room].copy_from_slice(&number[..room]);
    Some(Text::from_bytes(text.trim_ascii()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn b1_2_a_buffer_is_opened_behind_other_letters_too() {
        for line in ["OPEN PROG 3", "#8KOPENPROG3", "LISTLINKOPENPROG3", "k open prog 3", "#1J/OPEN PROG3"] {
            let Some(Effect::Opens(name)) = effect(line.as_bytes()) else { panic!("{line}") };
            assert_eq!(name.as_bytes(), b"PROG 3", "{line}");
        }
    }

    fn while_open(line: &str) -> WhileOpen {
        WhileOpen::of(line.as_bytes())
    }

    #[test]
    fn what_is_on_line_only_enters_no_buffer() {
        for line in [
            "#1J+",
            "#2J=3000",
            "#2j = -5^10",
            "#1J/#3J/#2",
            "J^-100",
            "&1R",
            "&1 R &2 R",
            "#1J+ #2J-",
            "#1J+R",
        ] {
            let acts = WhileOpen { acts: true, ..WhileOpen::default() };
            assert_eq!(while_open(line), acts, "{line}");
        }
        for line in [
            "#3HM",
            "#3homez",
            "&2%50",
            "#1K",
            "&1A",
            "&2A&1",
            "&1Q",
            "&1H",
            "&1S",
            "&1\\",
            "&1<",
            "#1O10",
            "#1$",
            "#1$*",
            "$$$",
            "$$$***",
            "SAVE",
            "GATHER",
            "ENDG",
            "DEFINE GATHER 100",
            "&2DELETE ROT",
            "DEL GAT",
            "UNDEFINE ALL",
            "WY:$700,5,-3",
            "M1->X:$700,0,24,S",
            "M1->*",
            "#1->5000X+10Y",
            "#1->-.5U - 3V + 10",
            "#1->0",
            "#1->I",
            "M161->D:$000088",
            "DELROT",
            "UNDEFINE",
            "&1X=5",
            "&1Z",
            "PASSWORD=ABC",
            "PMATCH",
        ] {
            let may_act = WhileOpen { may_act: true, ..WhileOpen::default() };
            assert_eq!(while_open(line), may_act, "{line}");
        }
        for line in [
            "#1P",
            "#3 P V F",
            "#1?PVF",
            "&2?",
            "???",
            " #1 #2 p ",
            "#",
            "&",
            "#1",
            "&1&2",
            "&1%",
            "##1",
            "LIST",
            "LIST PROG 3",
            "SIZE",
            "TYPE",
            "&1PC",
            "&1PR",
            "RHX:$700,5",
            "#1->",
            "",
        ] {
            assert_eq!(while_open(line), WhileOpen::default(), "{line}");
        }
    }

    #[test]
    fn statements_enter_and_on_line_commands_beside_them_are_told_apart() {
        for line in [
            "X1",
            "X100Y5",
            "P20=77",
            "M1->",
            "I57",
            "I57=0",
            "P1",
            "Q5",
            "M1=1",
            "P=1",
            "A10",
            "F100",
            "K5",
            "J5",
            "I5 J-5",
            "J-.5",
            "R10",
            "S5",
            "B1",
            "HM1,2",
            "HOMEZ3",
            "RAPID",
            "LINEAR",
            "SPLINE1",
            "STOP",
            "ABS",
            "INC(X)",
            "FRAX(X,Y)",
            "RETURN",
            "READ(A)",
            "AND(P1>5)",
            "PVT10",
            "PSET X0",
            "DELAY100",
            "DWELL5",
            "ENABLE PLC 1",
            "CMD\"#1J+\"",
            "SEND\"&1R\"",
            "IF(P1=5)",
            "ADDRESS#1&2",
            "$FF",
            "H(P1)",
            "P,5",
            "PR1",
            "DEFINE ROT 5X10",
            "M0..5=1",
            "FOO",
            "J",
            "N10",
            "G01X5",
            "@0Y7",
            "@SAVE",
            "M1->G1",
            "M1->SAVE",
            "M1->NORMAL",
            "M1->Y:0,0,1M3",
            "M1->X:0,0,1C5",
            "#1->P1=5",
            "#1->I5=2",
            "#1->X5",
            "UNDEFINEDEL ROTINC",
        ] {
            let told = while_open(line);
            assert!(told.enters && !told.acts && !told.may_act && !told.passes(), "{line}: {told:?}");
        }
        for (line, acts, may_act) in [
            ("X100 #1J+", true, false),
            ("#1J+X100", true, false),
            ("P1=5 #1J+ #3HM", true, true),
            ("I130=5 #3HM", false, true),
            ("&1RX10", true, false),
        ] {
            let told = while_open(line);
            assert_eq!((told.enters, told.acts, told.may_act), (true, acts, may_act), "{line}");
        }
        for line in
            ["OPEN PROG 3 CLEAR", "CLOSE", "close all", " clear ", "CLR", "#8KOPENPROG3", "LEARN", "CLEAR"]
        {
            assert!(while_open(line).changes && !while_open(line).passes(), "{line}");
        }
        assert!(while_open(&"#1J+".repeat(100)).enters, "longer than a line of a board");
    }
}
