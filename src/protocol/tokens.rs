//! The commands of a command line: which only ask, which move something, and whom each addresses.
//!
//! PMAC needs no blanks between commands (GRAMMAR 1). Only what is known for certain to ask counts as asking. A command that is not
//! known takes the rest of the line with it.

use std::ops::Range;

use super::line;

/// What a command needs to be addressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Needs {
    /// Nothing.
    Nothing,
    /// A motor.
    Motor,
    /// A coordinate system.
    System,
}

/// What a command is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// `#3`: this motor is addressed.
    Motor(u32),
    /// `&2`: this coordinate system is addressed.
    System(u32),
    /// `#3->`: this motor is addressed, and its axis in the coordinate system asked for.
    AxisOf(u32),
    /// It reports something, and does nothing else.
    Asks(Needs),
    /// It asks for I-variables: the first, the last, and the step between them.
    Variables(u32, u32, u32),
    /// It asks for the firmware's version.
    Version,
    /// It sets I-variables.
    SetsI(SetsI),
    /// It sets other variables, which or whose values need this.
    Sets(Needs),
    /// It writes values to consecutive addresses of the board's memory: `WX`, `WY`, `WL`.
    WritesMemory,
    /// It moves or stops something.
    Moves(Needs),
    /// It changes something else.
    Changes,
    /// Nobody here knows.
    Unknown,
}

/// I-variables that are set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SetsI {
    /// The first.
    pub first: u32,
    /// The last.
    pub last: u32,
    /// From each to the next.
    pub step: u32,
    /// To what, where it is one variable and a plain number.
    pub value: Option<u32>,
    /// What the value needs.
    pub needs: Needs,
}

/// A command, and where it stands in its line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Token {
    /// Its bytes.
    pub span: Range<usize>,
    /// What it is.
    pub kind: Kind,
}

impl Token {
    /// Whether the command changes nothing.
    #[must_use]
    pub fn only_asks(&self) -> bool {
        matches!(
            self.kind,
            Kind::Motor(_)
                | Kind::System(_)
                | Kind::AxisOf(_)
                | Kind::Asks(_)
                | Kind::Variables(..)
                | Kind::Version
        )
    }

    /// Whether what stands behind the command means the same in a line of its own, told whom it addresses.
    #[must_use]
    pub fn ends_its_line(&self) -> bool {
        self.only_asks() || matches!(self.kind, Kind::SetsI(_) | Kind::Sets(_) | Kind::WritesMemory)
    }
}

/// Commands that are words, and those that begin as others do. The longest that fits is it.
const WORDS: [(&str, Kind); 35] = [
    ("ABR", Kind::Moves(Needs::System)),
    ("ABS", Kind::Changes),
    ("CHECKSUM", Kind::Asks(Needs::Nothing)),
    ("CHKS", Kind::Asks(Needs::Nothing)),
    ("CID", Kind::Asks(Needs::Nothing)),
    ("CLOSE", Kind::Changes),
    ("CLS", Kind::Changes),
    ("CPU", Kind::Asks(Needs::Nothing)),
    ("DATE", Kind::Asks(Needs::Nothing)),
    ("ENDGATHER", Kind::Changes),
    ("GATHER", Kind::Changes),
    ("HM", Kind::Moves(Needs::Motor)),
    ("HMZ", Kind::Moves(Needs::Motor)),
    ("HOME", Kind::Moves(Needs::Motor)),
    ("HOMEZ", Kind::Moves(Needs::Motor)),
    ("PASSWORD", Kind::Unknown),
    ("PAUSE", Kind::Unknown),
    ("PC", Kind::Asks(Needs::System)),
    ("PE", Kind::Asks(Needs::System)),
    ("PMATCH", Kind::Changes),
    ("PR", Kind::Asks(Needs::System)),
    ("PSET", Kind::Unknown),
    ("RESUME", Kind::Unknown),
    ("SAVE", Kind::Changes),
    ("SEND", Kind::Unknown),
    ("SETPHASE", Kind::Unknown),
    ("SID", Kind::Asks(Needs::Nothing)),
    ("SIZE", Kind::Asks(Needs::Nothing)),
    ("STN", Kind::Unknown),
    ("TIME", Kind::Asks(Needs::Nothing)),
    ("TODAY", Kind::Asks(Needs::Nothing)),
    ("TYPE", Kind::Asks(Needs::Nothing)),
    ("VER", Kind::Version),
    ("VERSION", Kind::Version),
    ("VID", Kind::Asks(Needs::Nothing)),
];

/// What `LIST` lists, without its number (GRAMMAR 4), and what that needs. No word stands before a longer one that begins with it.
const LISTED: [(&str, Needs); 16] = [
    ("PROGRAM", Needs::Nothing),
    ("PROG", Needs::Nothing),
    ("PLCC", Needs::Nothing),
    ("PLC", Needs::Nothing),
    ("ROTARY", Needs::System),
    ("ROT", Needs::System),
    ("GATHER", Needs::Nothing),
    ("BLCOMP", Needs::Motor),
    ("TCOMP", Needs::Motor),
    ("COMP", Needs::Motor),
    ("LINK", Needs::Nothing),
    ("LDS", Needs::Nothing),
    ("FORWARD", Needs::System),
    ("INVERSE", Needs::System),
    ("PC", Needs::System),
    ("PE", Needs::System),
];
/// The digits of the longest hexadecimal address, `$07FFFF` on Turbo boards.
const ADDRESS_DIGITS: usize = 6;
/// The longest line that a board takes.
const LONGEST_LINE: usize = 255;

/// The commands of `line`, in their order. Blanks between them belong to none.
#[must_use]
pub fn of(line: &str) -> Vec<Token> {
    read(line, |_| line.len())
}

/// As [`of`], of a line that the board may know better: behind a command that is not known they go on at the next address.
#[must_use]
pub fn of_known(line: &str) -> Vec<Token> {
    let bytes = line.as_bytes();
    read(line, |start| next_address(bytes, start))
}

/// As [`of_known`], given one by one to `told`, with the text in capitals in which they stand. Asks for no memory. What stands in quotes
/// is no command, and what is longer than a board's line is not known.
pub fn each_known(line: &[u8], mut told: impl FnMut(&[u8], &Token)) {
    for part in line::command_bytes(line) {
        let mut upper = [b' '; LONGEST_LINE];
        let length = part.len().min(LONGEST_LINE);
        upper[..length].copy_from_slice(&part[..length]);
        upper.make_ascii_uppercase();
        let upper = &upper[..length];
        let mut reader = Reader { line: upper, at: 0 };
        while let Some(token) = reader.token(|start| next_address(upper, start)) {
            told(upper, &token);
        }
        if length < part.len() {
            told(upper, &Token { span: length..length, kind: Kind::Unknown });
        }
    }
}

/// Whether a command of `line` stops something.
#[must_use]
pub fn stops(line: &[u8]) -> bool {
    let mut stops = false;
    each_known(line, |line, token| {
        let said = &line[token.span.clone()];
        let letters = [&b"A"[..], b"H", b"J/", b"K", b"Q", b"/", b"\\"];
        stops |= matches!(token.kind, Kind::Moves(_)) && letters.contains(&said.trim_ascii_end());
    });
    stops
}

/// Where the next address begins behind the byte at `start`, or the line ends.
fn next_address(line: &[u8], start: usize) -> usize {
    let mut behind = line.iter().skip(start + 1);
    behind.position(|byte| b"#&".contains(byte)).map_or(line.len(), |at| start + 1 + at)
}

/// The commands of `line`; one that begins at a byte and is not known goes as far as `unknown_end` says.
fn read(line: &str, unknown_end: impl Fn(usize) -> usize) -> Vec<Token> {
    let upper = line.to_ascii_uppercase();
    let mut reader = Reader { line: upper.as_bytes(), at: 0 };
    std::iter::from_fn(|| reader.token(&unknown_end)).collect()
}

struct Reader<'a> {
    line: &'a [u8],
    at: usize,
}

impl Reader<'_> {
    /// The next byte that is no blank; it stands at `at` then.
    fn peek(&mut self) -> Option<u8> {
        while self.line.get(self.at) == Some(&b' ') {
            self.at += 1;
        }
        self.line.get(self.at).copied()
    }

    /// The next command; one that is not known goes as far as `unknown_end` says of its first byte.
    fn token(&mut self, unknown_end: impl Fn(usize) -> usize) -> Option<Token> {
        self.peek()?;
        let start = self.at;
        let kind = self.command();
        if kind == Kind::Unknown || self.at == start {
            self.at = unknown_end(start);
            return Some(Token { span: start..self.at, kind: Kind::Unknown });
        }
        Some(Token { span: start..self.at, kind })
    }

    /// The byte behind, blanks and all.
    fn next_is(&self, wanted: impl Fn(u8) -> bool) -> bool {
        self.line.get(self.at).is_some_and(|byte| wanted(*byte))
    }

    /// Takes `text` if it comes next, blanks before it.
    fn takes(&mut self, text: &str) -> bool {
        let start = self.at;
        self.peek();
        let comes = self.line[self.at..].starts_with(text.as_bytes());
        self.at = if comes { self.at + text.len() } else { start };
        comes
    }

    fn skip_while(&mut self, wanted: impl Fn(u8) -> bool) {
        while self.next_is(&wanted) {
            self.at += 1;
        }
    }

    /// A whole number, blanks before it and in it.
    fn number(&mut self) -> Option<u32> {
        let (mut number, mut end) = (None, self.at);
        while let Some(digit @ b'0'..=b'9') = self.peek() {
            self.at += 1;
            end = self.at;
            number = Some(number.unwrap_or(0_u32).saturating_mul(10).saturating_add(u32::from(digit - b'0')));
        }
        self.at = end;
        number
    }

    fn command(&mut self) -> Kind {
        let Some(first) = self.peek() else { return Kind::Unknown };
        let rest = &self.line[self.at..];
        if rest.starts_with(b"LIST") {
            return self.list();
        }
        if rest.starts_with(b"MS") {
            return self.station();
        }
        let word = WORDS.iter().filter(|(word, _)| rest.starts_with(word.as_bytes()));
        if let Some((word, kind)) = word.max_by_key(|(word, _)| word.len()) {
            self.at += word.len();
            // A longer word is another command.
            let goes_on = kind != &Kind::Version && kind != &Kind::Asks(Needs::System);
            return if goes_on && self.next_is(|byte| byte.is_ascii_alphabetic()) {
                Kind::Unknown
            } else {
                *kind
            };
        }
        self.at += 1;
        match first {
            b'#' => self.address(first, Needs::Motor, Kind::Motor),
            b'&' => self.address(first, Needs::System, Kind::System),
            b'?' => self.status(),
            b'I' | b'M' => self.variable(first),
            b'P' | b'Q' if matches!(self.peek(), Some(b'0'..=b'9' | b'(' | b'=' | b',')) => {
                self.variable(first)
            }
            b'P' => Kind::Asks(Needs::Motor),
            b'V' | b'F' if matches!(self.peek(), Some(b'0'..=b'9' | b'(' | b'=' | b'.' | b'-' | b'$')) => {
                Kind::Unknown
            }
            b'V' | b'F' => Kind::Asks(Needs::Motor),
            b'%' if matches!(self.peek(), Some(b'0'..=b'9' | b'.')) => {
                self.skip_while(|byte| byte.is_ascii_digit() || byte == b'.');
                Kind::Moves(Needs::System)
            }
            b'%' => Kind::Asks(Needs::System),
            b'J' => {
                self.skip_while(|byte| b"=:^!*+-/.$ ".contains(&byte) || byte.is_ascii_digit());
                Kind::Moves(Needs::Motor)
            }
            b'$' => {
                self.skip_while(|byte| byte == b'$' || byte == b'*');
                Kind::Moves(Needs::Motor)
            }
            b'O' if matches!(self.peek(), Some(b'0'..=b'9' | b'-' | b'.')) => {
                self.skip_while(|byte| b"-.".contains(&byte) || byte.is_ascii_digit());
                Kind::Moves(Needs::Motor)
            }
            b'K' => Kind::Moves(Needs::Motor),
            b'R' if self.reads_memory() => Kind::Asks(Needs::Nothing),
            b'W' if self.writes_memory() => Kind::WritesMemory,
            b'B' => {
                self.skip_while(|byte| b". ".contains(&byte) || byte.is_ascii_digit());
                Kind::Moves(Needs::System)
            }
            b'A' | b'H' | b'Q' | b'R' | b'S' | b'\\' | b'/' | b'<' | b'>' => Kind::Moves(Needs::System),
            _ => Kind::Unknown,
        }
    }

    /// Behind a `#` or an `&`.
    fn address(&mut self, sign: u8, needs: Needs, kind: impl Fn(u32) -> Kind) -> Kind {
        if self.next_is(|byte| byte == sign) {
            // `##`, `##1`: which motors ^B, ^F, ^P and ^V report, of everybody.
            self.at += 1;
            return if self.number().is_some() { Kind::Changes } else { Kind::Asks(Needs::Nothing) };
        }
        let Some(number) = self.number() else { return Kind::Asks(needs) };
        if !self.takes("->") {
            return kind(number);
        }
        // A definition is asked for, unless one follows: then nothing more is known of the line.
        match self.peek() {
            None | Some(b'#' | b'&' | b',') if needs == Needs::Motor => {
                self.takes(",");
                Kind::AxisOf(number)
            }
            _ => Kind::Unknown,
        }
    }

    fn status(&mut self) -> Kind {
        let first = self.at;
        self.skip_while(|byte| byte == b'?');
        match self.at - first {
            0 => Kind::Asks(Needs::Motor),
            1 => Kind::Asks(Needs::System),
            2 => Kind::Asks(Needs::Nothing),
            _ => Kind::Unknown,
        }
    }

    /// A variable behind its letter: a question, or an assignment with its value.
    fn variable(&mut self, letter: u8) -> Kind {
        let Some(first) = self.number() else { return Kind::Unknown };
        let (mut last, mut step) = (first, 1);
        if self.takes("..") {
            let Some(number) = self.number() else { return Kind::Unknown };
            last = number;
        } else if self.takes(",") {
            let Some(count) = self.number() else { return Kind::Unknown };
            if self.takes(",") {
                let Some(number) = self.number() else { return Kind::Unknown };
                step = number.max(1);
            }
            last = first.saturating_add(count.saturating_sub(1).saturating_mul(step));
        }
        if letter == b'M' && self.takes("->") {
            let asks = matches!(self.peek(), None | Some(b'M' | b'#' | b'&' | b'I' | b'P' | b'Q'));
            return if asks { Kind::Asks(Needs::Nothing) } else { Kind::Unknown };
        }
        if self.takes("==") {
            return Kind::Unknown;
        }
        if self.takes("=") {
            let start = self.at;
            let plain = self.number();
            let is_plain = !matches!(
                self.peek(),
                Some(b'+' | b'-' | b'*' | b'/' | b'%' | b'&' | b'|' | b'^' | b'.' | b'(')
            );
            self.at = start;
            if !self.expression() {
                return Kind::Unknown;
            }
            let needs = if letter == b'Q' || self.names_q(start) { Needs::System } else { Needs::Nothing };
            let value = plain.filter(|_| is_plain && first == last);
            let sets = SetsI { first, last, step, value, needs };
            return if letter == b'I' { Kind::SetsI(sets) } else { Kind::Sets(needs) };
        }
        match letter {
            b'I' => Kind::Variables(first, last, step),
            b'Q' => Kind::Asks(Needs::System),
            _ => Kind::Asks(Needs::Nothing),
        }
    }

    /// Goes to the end of an expression; `false` where it is none that is understood here.
    fn expression(&mut self) -> bool {
        loop {
            while matches!(self.peek(), Some(b'+' | b'-')) {
                self.at += 1;
            }
            match self.peek() {
                Some(b'(') => {
                    if !self.parenthesis() {
                        return false;
                    }
                }
                Some(b'$') => {
                    self.at += 1;
                    self.skip_while(|byte| byte.is_ascii_hexdigit());
                }
                Some(b'*') => self.at += 1,
                Some(b'0'..=b'9' | b'.') => self.skip_while(|byte| byte.is_ascii_digit() || byte == b'.'),
                Some(b'A'..=b'Z') => {
                    self.skip_while(|byte| byte.is_ascii_uppercase());
                    match self.peek() {
                        Some(b'(') if !self.parenthesis() => return false,
                        Some(b'0'..=b'9') => {
                            self.number();
                        }
                        Some(b'(') => {}
                        _ => return false,
                    }
                }
                _ => return false,
            }
            let end = self.at;
            if !matches!(self.peek(), Some(b'+' | b'-' | b'*' | b'/' | b'%' | b'&' | b'|' | b'^')) {
                self.at = end;
                return true;
            }
            self.at += 1;
        }
    }

    /// Whether an expression that begins at `start` and ends here has a Q-variable in it, one of a coordinate system's own.
    fn names_q(&self, start: usize) -> bool {
        let letters = self.line[start..self.at].split(|byte| !byte.is_ascii_uppercase());
        letters.into_iter().any(|word| word == b"Q")
    }

    /// Goes behind the parenthesis that begins here; `false` if it does not end.
    fn parenthesis(&mut self) -> bool {
        let mut depth = 0;
        while let Some(byte) = self.line.get(self.at) {
            self.at += 1;
            match byte {
                b'(' => depth += 1,
                b')' => depth -= 1,
                _ => {}
            }
            if depth == 0 {
                return true;
            }
        }
        false
    }

    /// `LIST`, what is listed, and of it which part. What stands behind it is another command: `LIST LINK HM`.
    fn list(&mut self) -> Kind {
        self.at += "LIST".len();
        let listed = LISTED.iter().find(|(word, _)| self.takes(word));
        if listed.is_some() {
            self.takes("DEF");
        }
        let mut end = self.at;
        loop {
            // `,S,80`: what tools ask for the next lines by. An S elsewhere is a step.
            let taken = match self.peek() {
                Some(b'0'..=b'9' | b'.') => 1,
                Some(b',') if self.line[self.at..].starts_with(b",S,") => 3,
                Some(b',') => 1,
                _ => break,
            };
            self.at += taken;
            end = self.at;
        }
        self.at = end;
        Kind::Asks(listed.map_or(Needs::System, |(_, needs)| *needs))
    }

    /// `MS0,I910`: a variable of a MACRO station.
    fn station(&mut self) -> Kind {
        self.at += "MS".len();
        let is_variable = self.number().is_some() && self.takes(",");
        let letter = self.peek().filter(u8::is_ascii_alphabetic);
        self.at += 1;
        if !is_variable || letter.is_none() || self.number().is_none() || self.peek() == Some(b'=') {
            self.at = self.at.min(self.line.len());
            return Kind::Unknown;
        }
        Kind::Asks(Needs::Nothing)
    }

    /// Behind an R: whether `X$700`, `HY:$700` or the like follows. Goes behind it then. Anything else is R, which runs a program, and
    /// another command: `RF100`, `RP1`.
    fn reads_memory(&mut self) -> bool {
        let start = self.at;
        self.takes("H");
        let has_space = ["DP", "D", "F", "L", "X", "Y"].iter().any(|space| self.takes(space));
        let has_colon = self.takes(":");
        let next = self.peek();
        let is_read = has_space && (next == Some(b'$') || has_colon && matches!(next, Some(b'0'..=b'9')));
        let is_read = is_read && self.register() && (!self.takes(",") || self.number().is_some());
        if !is_read {
            self.at = start;
        }
        is_read
    }

    /// Behind a W: whether a memory space, an address and its values follow. Goes behind them then.
    fn writes_memory(&mut self) -> bool {
        let start = self.at;
        let has_space = ["X", "Y", "L"].iter().any(|space| self.takes(space));
        self.takes(":");
        let mut is_write = has_space && self.register() && self.takes(",") && self.value();
        while is_write && self.takes(",") {
            is_write = self.value();
        }
        if !is_write {
            self.at = start;
        }
        is_write
    }

    /// A constant, with its sign.
    fn value(&mut self) -> bool {
        if !self.takes("-") {
            self.takes("+");
        }
        let is_hexadecimal = self.takes("$");
        self.peek();
        let start = self.at;
        self.skip_while(|byte| {
            byte.is_ascii_digit() || if is_hexadecimal { byte.is_ascii_hexdigit() } else { byte == b'.' }
        });
        self.at > start
    }

    /// An address, `$` and at most as many hexadecimal digits as the longest has, or decimal; goes behind it.
    fn register(&mut self) -> bool {
        if !self.takes("$") {
            return self.number().is_some();
        }
        let start = self.at;
        self.skip_while(|byte| byte.is_ascii_hexdigit());
        (1..=ADDRESS_DIGITS).contains(&(self.at - start))
    }
}

/// Whether `number` is among `first`, `first + step` … `last`.
#[must_use]
pub fn covers(first: u32, last: u32, step: u32, number: u32) -> bool {
    first <= number && number <= last && (number - first).is_multiple_of(step.max(1))
}

#[cfg(test)]
#[path = "tokens_tests.rs"]
mod tests;
