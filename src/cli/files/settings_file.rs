//! A board's settings as sorted lines that can be sent again: variables (`I100=1`, `M1->Y:$FFC2,0`), also of MACRO
//! stations (`MS0,MI910=7`), axis definitions (`#1->100X`), and programs, each from its `OPEN` to its `CLOSE`.
//!
//! Q-variables, axis definitions and kinematic programs belong to a coordinate system. A line `&2` addresses a system
//! for the following lines; the default is `&1`. All text stays as the board lists it (I9 chooses hex for addresses,
//! and short or long words); the comparison goes by the meaning. A listing has fewer digits than the register, so equal
//! listings count as equal values.

use std::collections::BTreeMap;
use std::fmt;

use crate::cli::context::Failure;
use crate::cli::files::meaning::{same_axis, same_number, same_program};
use crate::cli::files::sequence::ask;
use crate::client::command::lines::LineSequence;
use crate::language::{LINE_MAX, Meaning};
use crate::map::m_definition::MDefinition;
use crate::preprocess::{Mistake, Place};
use crate::protocol::answer;
use crate::protocol::check_line;

/// The most answers to one line. The board answers no other client meanwhile.
const ANSWERS_MAX: usize = 100;

/// How many MACRO nodes a Turbo board has.
pub const NODES: u8 = 64;

/// An item that a line can set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Item {
    /// An I-variable.
    I(u16),
    /// A P-variable.
    P(u16),
    /// A Q-variable of a coordinate system.
    Q {
        /// The coordinate system.
        system: u8,
        /// The variable.
        number: u16,
    },
    /// The definition of an M-variable.
    Definition(u16),
    /// The value of an M-variable.
    M(u16),
    /// A variable of the MACRO station at a node.
    OfStation {
        /// The node.
        node: u8,
        /// The variable.
        number: u16,
    },
    /// The axis of a motor in a coordinate system: `#1->100X`.
    Axis {
        /// The coordinate system.
        system: u8,
        /// The motor.
        motor: u8,
    },
    /// A kinematic program of a coordinate system.
    Kinematics {
        /// The coordinate system.
        system: u8,
        /// `INVERSE`, else `FORWARD`.
        inverse: bool,
    },
    /// A motion program.
    Program(u16),
    /// A PLC program.
    Plc(u8),
}

impl Item {
    /// The number of a variable.
    const fn number(self) -> u16 {
        match self {
            Self::I(n) | Self::P(n) | Self::Definition(n) | Self::M(n) | Self::Q { number: n, .. } => n,
            _ => 0,
        }
    }

    /// The item's coordinate system.
    pub const fn system(self) -> Option<u8> {
        match self {
            Self::Q { system, .. } | Self::Axis { system, .. } | Self::Kinematics { system, .. } => {
                Some(system)
            }
            _ => None,
        }
    }

    /// Whether the item is an axis definition.
    pub const fn is_axis(self) -> bool {
        matches!(self, Self::Axis { .. })
    }

    /// Whether the item is a variable of a MACRO station.
    pub const fn is_of_station(self) -> bool {
        matches!(self, Self::OfStation { .. })
    }

    /// Whether the item is a program, of several lines.
    pub const fn is_program(self) -> bool {
        matches!(self, Self::Kinematics { .. } | Self::Program(_) | Self::Plc(_))
    }

    /// The same kind of variable with another `number`.
    const fn at(self, number: u16) -> Self {
        match self {
            Self::I(_) => Self::I(number),
            Self::P(_) => Self::P(number),
            Self::Q { system, .. } => Self::Q { system, number },
            Self::Definition(_) => Self::Definition(number),
            Self::M(_) => Self::M(number),
            _ => self,
        }
    }

    /// Its name without the coordinate system: `Q5`.
    pub fn short(self) -> String {
        match self {
            Self::I(n) => format!("I{n}"),
            Self::P(n) => format!("P{n}"),
            Self::Q { number: n, .. } => format!("Q{n}"),
            Self::Definition(n) | Self::M(n) => format!("M{n}"),
            Self::OfStation { node, number } => format!("MS{node},MI{number}"),
            Self::Axis { motor, .. } => format!("#{motor}"),
            Self::Kinematics { inverse: false, .. } => "FORWARD".to_owned(),
            Self::Kinematics { inverse: true, .. } => "INVERSE".to_owned(),
            Self::Program(n) => format!("PROG {n}"),
            Self::Plc(n) => format!("PLC {n}"),
        }
    }

    /// The item's text in the board's listing. A long listing (odd I9) starts with the item's name.
    pub fn told(self, line: &str) -> String {
        let name = format!("{}{}", self.short(), self.sign());
        line.strip_prefix(&name).unwrap_or(line).trim().to_owned()
    }

    /// The sign between name and text.
    pub const fn sign(self) -> &'static str {
        if matches!(self, Self::Definition(_) | Self::Axis { .. }) { "->" } else { "=" }
    }

    /// The lines that set the item to `text`, the first with its coordinate system.
    pub fn lines(self, text: &str) -> Vec<String> {
        let system = self.system().map_or(String::new(), |system| format!("&{system}"));
        let lines = self.lines_there(text);
        lines
            .into_iter()
            .enumerate()
            .map(|(at, line)| if at == 0 { format!("{system}{line}") } else { line })
            .collect()
    }

    /// As [`Self::lines`], while its coordinate system is addressed.
    pub fn lines_there(self, text: &str) -> Vec<String> {
        if !self.is_program() {
            return vec![format!("{}{}{text}", self.short(), self.sign())];
        }
        let open = format!("OPEN {} CLEAR", self.short());
        let program = text.lines().map(str::to_owned);
        std::iter::once(open).chain(program).chain(["CLOSE".to_owned()]).collect()
    }

    /// The question for an item that not every board has: a station's variable or a program.
    pub fn own_question(self) -> String {
        if self.is_of_station() {
            return self.short();
        }
        let system = self.system().map_or(String::new(), |system| format!("&{system}"));
        format!("{system}LIST {}", self.short())
    }

    /// The question for this item and the next `count - 1`.
    fn question(self, count: usize) -> String {
        let last = usize::from(self.number()) + count - 1;
        let range = if count == 1 { String::new() } else { format!("..{last}") };
        let arrow = if matches!(self, Self::Definition(_)) { "->" } else { "" };
        format!("{self}{range}{arrow}")
    }

    /// Whether two texts set the same, whatever their spelling.
    pub fn same(self, one: &str, other: &str) -> bool {
        one == other
            || match self {
                Self::Definition(_) => {
                    MDefinition::parse(one).is_some_and(|one| MDefinition::parse(other) == Some(one))
                }
                Self::Axis { .. } => same_axis(one, other),
                Self::Kinematics { .. } | Self::Program(_) | Self::Plc(_) => same_program(one, other),
                Self::I(_) | Self::P(_) | Self::Q { .. } | Self::M(_) | Self::OfStation { .. } => {
                    same_number(one, other)
                }
            }
    }
}

impl fmt::Display for Item {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(system) = self.system() {
            write!(f, "&{system}")?;
        }
        f.write_str(&self.short())
    }
}

/// One line of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Entry {
    /// The item.
    pub item: Item,
    /// The item's new text.
    pub text: String,
    /// The line's number.
    pub line: usize,
}

/// Parses a file.
///
/// # Errors
/// Every line that cannot be parsed, and every item set twice.
pub fn parse(file: &str, text: &str) -> Result<Vec<Entry>, Vec<Mistake>> {
    let mut entries: Vec<Entry> = Vec::new();
    let mut mistakes = Vec::new();
    let mut seen = BTreeMap::new();
    let mut system = 1;
    // The program whose lines follow.
    let mut open: Option<Entry> = None;
    for (line, number) in text.lines().zip(1..) {
        let line = line.replace('\t', " ");
        let code = code(&line);
        if code.is_empty() {
            continue;
        }
        let mut mistake = |line: usize, what: String| {
            mistakes.push(Mistake { place: Place { file: file.to_owned(), line }, what });
        };
        if let Some(program) = open.as_mut().filter(|_| !Meaning::of(code).is_close) {
            if let Err(what) = check_line(code) {
                mistake(number, what);
            }
            let separate = if program.text.is_empty() { "" } else { "\n" };
            program.text += separate;
            program.text += code;
            continue;
        }
        // A program's place is its first line.
        let (entry, at) = match open.take() {
            Some(program) => (Ok(Line::Entry(program.item, program.text)), program.line),
            None => (entry(code, system), number),
        };
        match entry {
            Ok(Line::System(next)) => system = next,
            Ok(Line::Open(item)) => open = Some(Entry { item, text: String::new(), line: number }),
            Ok(Line::Entry(item, text)) => match seen.insert(item, at) {
                Some(first) => mistake(at, format!("{item} is set in line {first} already")),
                None => entries.push(Entry { item, text, line: at }),
            },
            Err(what) => mistake(number, what),
        }
    }
    if let Some(program) = open {
        let what = format!("{} has no CLOSE", program.item);
        mistakes.push(Mistake { place: Place { file: file.to_owned(), line: program.line }, what });
    }
    if mistakes.is_empty() { Ok(entries) } else { Err(mistakes) }
}

enum Line {
    System(u8),
    Open(Item),
    Entry(Item, String),
}

/// `line` without the comment after it. Text in quotes is no comment.
fn code(line: &str) -> &str {
    let mut is_text = false;
    let comment = line.find(|letter| {
        is_text ^= letter == '"';
        letter == ';' && !is_text
    });
    line[..comment.unwrap_or(line.len())].trim()
}

/// The program that a line like `OPEN PLC 3 CLEAR` begins.
fn opened(code: &str, system: u8) -> Option<Item> {
    let upper = code.to_ascii_uppercase();
    let name = upper.strip_prefix("OPEN ")?.strip_suffix(" CLEAR")?.trim();
    let number = |kind: &str| name.strip_prefix(kind)?.trim().parse::<u16>().ok();
    match name {
        "FORWARD" => Some(Item::Kinematics { system, inverse: false }),
        "INVERSE" => Some(Item::Kinematics { system, inverse: true }),
        _ => {
            let plc = number("PLC").and_then(|number| u8::try_from(number).ok()).map(Item::Plc);
            plc.or_else(|| number("PROG").map(Item::Program))
        }
    }
}

fn entry(code: &str, system: u8) -> Result<Line, String> {
    let wrong = || {
        format!(
            "{code:?} is not a line like I100=1, P1=2.5, Q1=3, M1->Y:$FFC2,0, M1=0, MS0,MI910=7, #1->100X or OPEN PLC 3 CLEAR"
        )
    };
    let (system, code) = match code.strip_prefix('&') {
        Some(rest) => {
            let end = rest.find(|c: char| !c.is_ascii_digit()).unwrap_or(rest.len());
            let number =
                rest[..end].parse().ok().filter(|number| (1..=16).contains(number)).ok_or_else(wrong)?;
            if end == rest.len() {
                return Ok(Line::System(number));
            }
            (number, rest[end..].trim_start())
        }
        None => (system, code),
    };
    if let Some(item) = opened(code, system) {
        return Ok(Line::Open(item));
    }
    let to_number = |item: Item, text: &str| match answer::number(text) {
        Some(_) => Ok(Line::Entry(item, text.to_owned())),
        None => Err(format!("{text:?} is not a number")),
    };
    if let Some((item, text)) = of_station(code) {
        return to_number(item, text);
    }
    let letter = code.chars().next().map(|letter| letter.to_ascii_uppercase());
    let rest = code.get(1..).ok_or_else(wrong)?;
    let end = rest.find(|c: char| !c.is_ascii_digit()).ok_or_else(wrong)?;
    let n: u16 = rest[..end].parse().ok().filter(|&n| n < 8192).ok_or_else(wrong)?;
    let tail = rest[end..].trim_start();
    if let Some(text) = tail.strip_prefix("->").map(str::trim) {
        let plain = text.bytes().all(|byte| byte.is_ascii_graphic() || byte == b' ');
        return match letter {
            Some('M') if !text.is_empty() && plain => Ok(Line::Entry(Item::Definition(n), text.to_owned())),
            Some('#') if !text.is_empty() && plain && (1..=32).contains(&n) => {
                Ok(Line::Entry(Item::Axis { system, motor: n as u8 }, text.to_owned()))
            }
            _ => Err(wrong()),
        };
    }
    let text = tail.strip_prefix('=').map(str::trim).ok_or_else(wrong)?;
    let item = match letter {
        Some('I') => Item::I(n),
        Some('P') => Item::P(n),
        Some('Q') => Item::Q { system, number: n },
        Some('M') => Item::M(n),
        _ => return Err(wrong()),
    };
    to_number(item, text)
}

/// The station's variable that a line like `MS0,MI910=7` sets, and its value. `I910` is another name of `MI910`, and
/// `MACROSLV` of `MS`.
fn of_station(code: &str) -> Option<(Item, &str)> {
    let (name, text) = code.split_once('=')?;
    let name = name.to_ascii_uppercase().replace(' ', "");
    let name = name.strip_prefix("MS").or_else(|| name.strip_prefix("MACROSLV"))?;
    let (node, number) = name.split_once(',')?;
    let number = number.strip_prefix('M').unwrap_or(number).strip_prefix('I')?.parse().ok()?;
    let node = node.parse().ok().filter(|&node| node < NODES)?;
    Some((Item::OfStation { node, number }, text.trim()))
}

/// All clients share the addressed motor and coordinate system: the daemon restores both at the end if `items` need
/// others. The board's answer becomes part of a line then, so the answer must be a plain number.
///
/// # Errors
/// As `ask`.
pub fn keep_address(
    sequence: &mut LineSequence<'_>,
    mut items: impl Iterator<Item = Item>,
) -> Result<(), Failure> {
    if !sequence.has_end() && items.any(|item| item.system().is_some()) {
        let said = ask(sequence, &["&", "#"])?;
        let number = |line: usize| addressed(said.get(line)?.first()?);
        let [Some(system), Some(motor)] = [0, 1].map(number) else {
            let why = "the board does not say which coordinate system and motor are addressed, so that they could not be \
                       addressed again";
            return Err(Failure::Refused(why.to_owned()));
        };
        sequence.at_end(vec![format!("&{system}#{motor}")]);
    }
    Ok(())
}

/// The motor or coordinate system that a reply names; `None` for any other reply.
fn addressed(reply: &str) -> Option<&str> {
    let text = reply.trim();
    let is_number = (1..=2).contains(&text.len()) && text.bytes().all(|byte| byte.is_ascii_digit());
    is_number.then_some(text)
}

/// Reads `items` from the board, in a sequence that goes on after a line that the board refuses.
///
/// # Errors
/// The board refuses a question or gives an unexpected answer.
pub fn read_variables(
    sequence: &mut LineSequence<'_>,
    items: &[Item],
) -> Result<BTreeMap<Item, String>, Failure> {
    let mut held = BTreeMap::new();
    let questions = questions(items);
    let lines: Vec<&str> = questions.iter().map(|(question, _)| question.as_str()).collect();
    let replies = ask(sequence, &lines)?;
    for ((question, asked), lines) in questions.iter().zip(&replies) {
        if lines.len() != asked.len() {
            let (wanted, got) = (asked.len(), lines.len());
            return Err(Failure::Refused(format!(
                "{question}: the board answered {got} lines instead of {wanted}"
            )));
        }
        for (&item, line) in asked.iter().zip(lines) {
            held.insert(item, item.told(line));
        }
    }
    Ok(held)
}

/// The questions for all of `items`, which are sorted. Neighbours become ranges, several a line.
fn questions(items: &[Item]) -> Vec<(String, &[Item])> {
    let mut questions: Vec<(String, &[Item])> = Vec::new();
    let mut line = String::new();
    let (mut start, mut at) = (0, 0);
    while at < items.len() {
        let first = items[at];
        let room = ANSWERS_MAX - (at - start);
        let run = (0..room.min(items.len() - at))
            .take_while(|&ahead| {
                let number = usize::from(first.number()) + ahead;
                u16::try_from(number).is_ok_and(|number| items[at + ahead] == first.at(number))
            })
            .count();
        let question = first.question(run);
        let separate = usize::from(!line.is_empty());
        // The & must come first: later in a line it could be the operator.
        let apart = line.is_empty() || first.system() == items[start].system();
        if run == 0 || !apart || line.len() + separate + question.len() > LINE_MAX {
            questions.push((std::mem::take(&mut line), &items[start..at]));
            start = at;
            continue;
        }
        if separate > 0 {
            line.push(' ');
        }
        line.push_str(&question);
        at += run;
    }
    if !line.is_empty() {
        questions.push((line, &items[start..]));
    }
    questions
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_board_answers_becomes_an_address_only_if_it_is_a_number() {
        assert_eq!(["1", " 16 ", "32"].map(addressed), [Some("1"), Some("16"), Some("32")]);
        for reply in ["1B1R", "1J+", "", "+1", "1 2", "100", "\u{1b}[2J", "-1"] {
            assert_eq!(addressed(reply), None, "{reply:?}");
        }
    }

    #[test]
    fn files_are_read_and_what_is_wrong_is_told() {
        let text = "; title\n\ni100 = 1 ; on\nP5=-2.5\nQ1=0\n&2\nQ1=$1F\n&3Q1=7\nM1->Y:$FFC2,0\nM1=1\n\
                    ms 0,i910 = $7\nMACROSLV16,MI912=1\n";
        let entries = parse("f", text).unwrap();
        let found: Vec<_> = entries.iter().map(|entry| entry.item.lines(&entry.text).join("\n")).collect();
        let expected = [
            "I100=1",
            "P5=-2.5",
            "&1Q1=0",
            "&2Q1=$1F",
            "&3Q1=7",
            "M1->Y:$FFC2,0",
            "M1=1",
            "MS0,MI910=$7",
            "MS16,MI912=1",
        ];
        assert_eq!(found, expected);
        assert_eq!(entries[1].line, 4);

        let wrong = "I100\nX1=1\nI=1\nI1=one\nP1->*\nI9999=1\n&99\nI1=1 I2=2\nM1->\nI5=1E3\nI7=1\nI7=2\n\u{fc}=1\n#1J+\n\
                     MS64,MI1=0\nMS0,P1=0\nMS0,I1";
        let mistakes = parse("f", wrong).unwrap_err();
        assert_eq!(mistakes.len(), 16, "{mistakes:?}");
        assert_eq!(mistakes[10].to_string(), "f:12: I7 is set in line 11 already");
        assert_eq!(mistakes[3].to_string(), "f:4: \"one\" is not a number");
    }

    #[test]
    fn programs_are_read_as_they_are_written() {
        let text = "&2\n#1->100X ; an axis\n#32->I\nOPEN INVERSE CLEAR\nP1=Q7*2\nCLOSE\nopen plc 31 clear ; waits\n\n  SEND\"a;b\" ; c\n\
                    IF(P1=1)\nENDI\nclose\nOPEN PROG 1000 CLEAR\nCLOSE\n&3OPEN FORWARD CLEAR\nQ1=1\nCLOSE\n";
        let entries = parse("f", text).unwrap();
        let found: Vec<_> =
            entries.iter().map(|entry| (entry.item, entry.text.as_str(), entry.line)).collect();
        let expected = [
            (Item::Axis { system: 2, motor: 1 }, "100X", 2),
            (Item::Axis { system: 2, motor: 32 }, "I", 3),
            (Item::Kinematics { system: 2, inverse: true }, "P1=Q7*2", 4),
            (Item::Plc(31), "SEND\"a;b\"\nIF(P1=1)\nENDI", 7),
            (Item::Program(1000), "", 13),
            (Item::Kinematics { system: 3, inverse: false }, "Q1=1", 15),
        ];
        assert_eq!(found, expected);
        let written: Vec<String> = entries.iter().flat_map(|entry| entry.item.lines(&entry.text)).collect();
        let again = parse("f", &written.join("\n")).unwrap();
        assert!(
            again.iter().zip(&entries).all(|(one, other)| one.item == other.item && one.text == other.text)
        );
        assert_eq!(again.len(), entries.len());
        for (wrong, line) in [
            ("OPEN PLC 3 CLEAR\nP1=1", 1),
            ("OPEN PLC 3\nCLOSE", 1),
            ("P1=1\nCLOSE", 2),
            ("OPEN PLC 3 CLEAR\n\u{fc}\nCLOSE", 2),
            ("OPEN PLC 3 CLEAR\nCLOSE\nOPEN PLC 3 CLEAR\nCLOSE", 3),
            ("#33->X", 1),
        ] {
            let mistakes = parse("f", wrong).unwrap_err();
            assert_eq!(mistakes[0].place.line, line, "{wrong}: {mistakes:?}");
        }
    }

    #[test]
    fn values_and_definitions_are_compared_by_what_they_mean() {
        let i = Item::I(125);
        assert!(i.same("$C000", "49152") && i.same("1", "1.0") && i.same("-0.5", "-.5") && i.same("0", "-0"));
        assert!(!i.same("1", "2") && !i.same("$1", "x") && !i.same("", "0") && !i.same("1E3", "1000"));
        let m = Item::Definition(1);
        assert!(m.same("y:$ffc2, 0", "Y:$FFC2,0") && !m.same("Y:$FFC2,0", "Y:$FFC2,1"));
        assert!(
            m.same("MI7", "MI7") && !m.same("MI7", "MI8"),
            "what nobody here knows is compared as it stands"
        );
    }

    #[test]
    fn questions_are_few_and_every_answer_has_its_item() {
        let items: Vec<Item> = (0..250).map(Item::I).chain([Item::P(3), Item::P(5), Item::P(6)]).collect();
        let asked = questions(&items);
        let lines: Vec<&str> = asked.iter().map(|(line, _)| line.as_str()).collect();
        assert_eq!(lines, ["I0..99", "I100..199", "I200..249 P3 P5..6"]);
        let items = [
            Item::Q { system: 1, number: 9 },
            Item::Q { system: 2, number: 10 },
            Item::Definition(4),
            Item::M(5),
        ];
        let lines: Vec<String> = questions(&items).into_iter().map(|(line, _)| line).collect();
        assert_eq!(lines, ["&1Q9", "&2Q10", "M4-> M5"]);
        assert_eq!(questions(&[]), []);
        let scattered: Vec<Item> = (0..300).map(|n| Item::P(3 * n)).collect();
        let asked = questions(&scattered);
        assert!(asked.iter().all(|(line, items)| line.len() <= LINE_MAX && items.len() <= ANSWERS_MAX));
        assert_eq!(asked.iter().flat_map(|(_, items)| items.iter().copied()).collect::<Vec<_>>(), scattered);
    }
}
