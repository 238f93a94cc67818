//! Converts a line's tokens to commands.
//!
//! An error in a command's number ends the command. A syntax error ends the line, because the parser cannot interpret
//! the rest.

use super::codes::{self, Code, Operator, Role, Shape};
use super::constant::Constant;
use super::float::{Float, Loss, Width};
use super::item::{ALL_AXES, Argument, Item, VECTORS, axis_bit};
use super::program::{Command, Line, START_OF_LINE};
use super::reason::{Reason, Report, Warning};
use super::refused::Why;
use super::scan::{Kind, Token};
use super::settings::Settings;

/// A parsed line.
pub struct Parsed {
    /// Its commands; `None` without any. Incomplete after an error.
    pub line: Option<Line>,
    /// The parts that the format cannot hold.
    pub errors: Report<Reason>,
    /// How the sent line would differ from the text.
    pub warnings: Report<Warning>,
}

/// ABS, INC and FRAX that go as on-line lines, because the settings do not say where their code stands.
#[derive(Debug, Default)]
pub struct Modes {
    /// Their texts, in order.
    pub lines: Vec<String>,
    /// A command has come that separates the modes before it from those behind it: no more of them can go as on-line
    /// lines.
    pub are_over: bool,
}

/// Parses the `tokens` of line `number`.
pub fn parse(source: &[u8], tokens: &[Token], number: u32, settings: &Settings, modes: &mut Modes) -> Parsed {
    let mut parser = Parser {
        source,
        tokens,
        number,
        settings,
        modes,
        at: 0,
        commands: Vec::new(),
        errors: Report::default(),
        warnings: Report::default(),
    };
    while let Some(token) = parser.peek() {
        if parser.command(token).is_err() {
            break;
        }
    }
    parser.finish()
}

/// The parser cannot read the rest of the line, and has reported the reason.
struct Abandon;

/// A parsed constant: its first token and its value.
struct Number {
    first: usize,
    constant: Constant,
}

struct Parser<'a> {
    source: &'a [u8],
    tokens: &'a [Token],
    number: u32,
    settings: &'a Settings,
    modes: &'a mut Modes,
    at: usize,
    commands: Vec<Command>,
    errors: Report<Reason>,
    warnings: Report<Warning>,
}

impl Parser<'_> {
    fn finish(mut self) -> Parsed {
        let most = self.settings.most_commands_a_line();
        let column = self.commands.first().map_or(1, |command| command.column);
        if self.commands.len() > most {
            let (commands, words) = (self.commands.len(), self.settings.buffer_words);
            self.errors.add(self.number, column, Reason::LongLine { commands, words, most });
        }
        let line = Line { line: self.number, column, commands: self.commands };
        Parsed {
            line: (!line.commands.is_empty()).then_some(line),
            errors: self.errors,
            warnings: self.warnings,
        }
    }

    fn peek(&self) -> Option<Token> {
        self.tokens.get(self.at).copied()
    }

    fn peek_kind(&self) -> Option<Kind> {
        self.peek().map(|token| token.kind)
    }

    fn take_symbol(&mut self, symbol: u8) -> bool {
        let is_there = self.peek_kind() == Some(Kind::Symbol(symbol));
        self.at += usize::from(is_there);
        is_there
    }

    /// The text from token `first` to the last token taken.
    fn text(&self, first: usize) -> String {
        let place = |at: usize| self.tokens.get(at);
        let (start, end) = (place(first), place(self.at.saturating_sub(1)));
        let bytes = start.zip(end).and_then(|(start, end)| self.source.get(start.start..end.end));
        String::from_utf8_lossy(bytes.unwrap_or_default()).into_owned()
    }

    /// The column of token `at`, or the column behind the last token.
    fn column(&self, at: usize) -> u32 {
        match (self.tokens.get(at), self.tokens.last()) {
            (Some(token), _) => token.column,
            (None, Some(last)) => last.column + (last.end - last.start) as u32,
            (None, None) => 1,
        }
    }

    /// Reports an error at token `at`.
    fn error(&mut self, at: usize, reason: Reason) {
        self.errors.add(self.number, self.column(at), reason);
    }

    fn abandon<T>(&mut self, at: usize, reason: Reason) -> Result<T, Abandon> {
        self.error(at, reason);
        Err(Abandon)
    }

    fn emit(&mut self, first: usize, item: &Item) {
        let Some((word1, word2)) = item.words(self.settings) else {
            if self.modes.are_over {
                self.error(first, Reason::Untold(item.code.name));
            } else {
                let text = self.text(first).to_ascii_uppercase();
                self.modes.lines.push(text.split_whitespace().collect());
            }
            return;
        };
        self.modes.are_over |= item.code.moves();
        let start = if self.commands.is_empty() { START_OF_LINE } else { 0 };
        let (column, text) = (self.column(first), self.text(first));
        self.commands.push(Command { column, text, word1: word1 | start, word2 });
    }

    fn command(&mut self, token: Token) -> Result<(), Abandon> {
        let first = self.at;
        self.at += 1;
        match token.kind {
            Kind::Command(code) => self.coded(first, code),
            Kind::Refused(word) => {
                self.error(first, word.reason());
                // After these words the parser can still read the rest of the line.
                match word.why {
                    Why::Text if matches!(self.peek_kind(), Some(Kind::Quoted)) => self.at += 1,
                    Why::Label if matches!(self.peek_kind(), Some(Kind::Number(..))) => self.at += 1,
                    Why::Wait => {}
                    _ => return Err(Abandon),
                }
                Ok(())
            }
            Kind::Plc => self.abandon(first, Reason::Unexpected("PLC".to_owned())),
            Kind::Number(..) | Kind::LongHex => self.abandon(first, Reason::LoneNumber(self.text(first))),
            Kind::Symbol(b':') => self.abandon(first, Reason::Mark(":")),
            Kind::Symbol(b'^') => self.abandon(first, Reason::Mark("^")),
            Kind::Symbol(symbol) if b"#&%?@\\<>/!$".contains(&symbol) => {
                self.abandon(first, Reason::OnLine(char::from(symbol).to_string()))
            }
            Kind::Foreign(byte) => {
                let text = self.text(first);
                let printable = byte >= 0xC0 && !text.contains(char::REPLACEMENT_CHARACTER);
                let shown = if printable { text } else { format!("0x{byte:02X}") };
                self.abandon(first, Reason::Character(shown))
            }
            Kind::Symbol(_) | Kind::Assign(_) | Kind::Range | Kind::Arrow | Kind::Quoted => {
                self.abandon(first, Reason::Unexpected(self.text(first)))
            }
        }
    }

    fn coded(&mut self, first: usize, code: &'static Code) -> Result<(), Abandon> {
        let argument = match code.shape {
            Shape::Letter { .. } => return self.letter(first, code),
            Shape::Data { .. } => {
                let Some(number) = self.constant(code)? else { return Ok(()) };
                self.float(code, &number, Width::Short).map(Argument::Number)
            }
            Shape::Count { .. } => {
                let Some(number) = self.constant(code)? else { return Ok(()) };
                self.whole(code, &number).map(Argument::Count)
            }
            Shape::Bare { .. } => {
                self.operands(first, code);
                Some(Argument::None)
            }
            Shape::Axes { vectors, .. } => Some(Argument::Axes(self.axes(code, vectors)?)),
            Shape::Motors { .. } => {
                if !matches!(self.peek_kind(), Some(Kind::Number(..) | Kind::Symbol(b'(' | b'+' | b'-'))) {
                    return self.abandon(first, Reason::NeedsMotors(code.name));
                }
                let motors = self.list(code)?;
                motors.map(|motors| Argument::Motors(motors >> 1))
            }
            Shape::Plcs { .. } => {
                match self.peek_kind() {
                    Some(Kind::Plc) => self.at += 1,
                    Some(Kind::Refused(word)) if word.name == "PLCC" => {
                        return self.abandon(self.at, word.reason());
                    }
                    _ => return self.abandon(first, Reason::NeedsPlc(code.name)),
                }
                self.list(code)?.map(Argument::Plcs)
            }
            // No spelling leads here.
            Shape::Mark { .. } | Shape::Assignment { .. } => return Ok(()),
        };
        if let Some(argument) = argument {
            self.emit(first, &Item { code, argument });
        }
        Ok(())
    }

    /// NORMAL and PSET carry no data: their vectors or axes follow as commands of their own.
    fn operands(&mut self, first: usize, code: &Code) {
        let (role, reason) = match code.name {
            "NORMAL" => (Role::Vector, Reason::NeedsVector),
            "PSET" => (Role::Axis, Reason::NeedsAxis),
            _ => return,
        };
        if !matches!(self.peek_kind(), Some(Kind::Command(next)) if next.role() == role) {
            self.error(first, reason);
        }
    }

    fn letter(&mut self, first: usize, code: &'static Code) -> Result<(), Abandon> {
        if let (b"I" | b"M" | b"P" | b"Q", Some(Kind::Number(number, _))) =
            (code.name.as_bytes(), self.peek_kind())
        {
            match self.tokens.get(self.at + 1).map(|token| token.kind) {
                Some(Kind::Assign(operator)) => return self.assignment(first, code, &number, operator),
                Some(Kind::Range) => return self.abandon(first, Reason::VariableRange),
                Some(Kind::Arrow) => return self.abandon(first, Reason::OnLine(format!("{}->", code.name))),
                _ => {}
            }
        }
        let Some(number) = self.constant(code)? else { return Ok(()) };
        if let Some(float) = self.float(code, &number, Width::Long) {
            self.emit(first, &Item { code, argument: Argument::Number(float) });
        }
        if code.role() == Role::Axis
            && let Some(Kind::Symbol(symbol @ (b':' | b'^'))) = self.peek_kind()
        {
            return self.mark(if symbol == b':' { ":" } else { "^" });
        }
        Ok(())
    }

    /// `:` or `^` behind an axis and its position.
    fn mark(&mut self, name: &'static str) -> Result<(), Abandon> {
        let first = self.at;
        self.at += 1;
        let Some(code) = codes::find(name) else { return Ok(()) };
        let Some(number) = self.constant(code)? else { return Ok(()) };
        if let Some(float) = self.float(code, &number, Width::Short) {
            self.emit(first, &Item { code, argument: Argument::Number(float) });
        }
        Ok(())
    }

    fn assignment(
        &mut self,
        first: usize,
        letter: &'static Code,
        number: &Constant,
        operator: Operator,
    ) -> Result<(), Abandon> {
        self.at += 1;
        let variable = number.integer().and_then(|n| u16::try_from(n).ok()).filter(|&n| n <= 1023);
        if variable.is_none() {
            let text = self.text(first);
            self.error(first, Reason::VariableNumber(text));
        }
        let code = codes::find_assignment(letter.name.as_bytes()[0], operator);
        if code.is_none() {
            let is_m = letter.name == "M";
            let reason = if is_m { Reason::BitCode } else { Reason::Operator };
            self.error(self.at, reason(operator.text()));
        }
        self.at += 1;
        if self.peek_kind() == Some(Kind::Symbol(b'*')) {
            return self.abandon(self.at, Reason::Default);
        }
        let Some(value) = self.constant(code.unwrap_or(letter))? else { return Ok(()) };
        if self.peek_kind() == Some(Kind::Symbol(b'^')) {
            return self.abandon(self.at, Reason::Expression);
        }
        let (Some(variable), Some(code)) = (variable, code) else { return Ok(()) };
        if let Some(float) = self.float(code, &value, Width::Short) {
            self.emit(first, &Item { code, argument: Argument::Assignment(variable, float) });
        }
        Ok(())
    }

    /// A constant with its sign. `None` after a reported error that does not prevent parsing the rest.
    fn constant(&mut self, code: &Code) -> Result<Option<Number>, Abandon> {
        let first = self.at;
        let negative = self.take_symbol(b'-');
        if !negative {
            self.take_symbol(b'+');
        }
        let number_at = self.at;
        match self.peek_kind() {
            Some(Kind::Number(constant, decimal)) => {
                self.at += 1;
                if decimal {
                    self.warn_of_exponent(number_at);
                }
                let constant = if negative { constant.negated() } else { constant };
                self.no_operator()?;
                Ok(Some(Number { first, constant }))
            }
            Some(Kind::LongHex) => {
                self.error(number_at, Reason::LongHex);
                self.at += 1;
                self.no_operator()?;
                Ok(None)
            }
            Some(Kind::Symbol(b'(')) => {
                self.error(number_at, Reason::Expression);
                self.skip_parentheses();
                self.end_of_expression()
            }
            Some(Kind::Command(variable)) if self.is_variable(variable) => {
                self.error(number_at, Reason::Variable);
                self.at += 1;
                if self.peek_kind() == Some(Kind::Symbol(b'(')) {
                    self.skip_parentheses();
                } else {
                    self.at += 1;
                }
                self.end_of_expression()
            }
            Some(Kind::Refused(word)) if word.why == Why::Function => {
                self.abandon(number_at, Reason::Expression)
            }
            // The next command stands in place of the number: X Y5.
            None | Some(Kind::Command(_)) => {
                self.error(first.saturating_sub(1), Reason::NeedsNumber(code.name));
                Ok(None)
            }
            Some(_) => self.abandon(first.saturating_sub(1), Reason::NeedsNumber(code.name)),
        }
    }

    /// Whether the next word is a variable in place of a number: P1 or P(...).
    fn is_variable(&self, code: &Code) -> bool {
        matches!(code.name, "I" | "M" | "P" | "Q")
            && matches!(
                self.tokens.get(self.at + 1).map(|token| token.kind),
                Some(Kind::Number(..) | Kind::Symbol(b'('))
            )
            // X P1=5 is an axis without its number, and an assignment.
            && !matches!(self.tokens.get(self.at + 2).map(|token| token.kind), Some(Kind::Assign(_)))
    }

    /// After an expression, which the parser has reported: abandons the line unless the expression ends here.
    fn end_of_expression(&mut self) -> Result<Option<Number>, Abandon> {
        if self.is_operator() || matches!(self.peek_kind(), Some(Kind::Symbol(b'^' | b':') | Kind::Assign(_)))
        {
            Err(Abandon)
        } else {
            Ok(None)
        }
    }

    fn is_operator(&self) -> bool {
        matches!(self.peek_kind(), Some(Kind::Symbol(symbol)) if b"+-*/%|&(".contains(&symbol))
    }

    /// A constant ends a command; reports an operator behind it, which would make an expression.
    fn no_operator(&mut self) -> Result<(), Abandon> {
        if self.is_operator() { self.abandon(self.at, Reason::Expression) } else { Ok(()) }
    }

    fn skip_parentheses(&mut self) {
        let mut depth = 0usize;
        while let Some(kind) = self.peek_kind() {
            self.at += 1;
            match kind {
                Kind::Symbol(b'(') => depth += 1,
                Kind::Symbol(b')') => depth = depth.saturating_sub(1),
                _ => {}
            }
            if depth == 0 {
                break;
            }
        }
    }

    /// PMAC has no exponents: it reads 1E3 as 1, then the letter E with 3. The author surely meant 1000.
    fn warn_of_exponent(&mut self, number_at: usize) {
        if let Some([number, letter, digits]) = self.tokens.get(number_at..number_at + 3)
            && let Kind::Command(code) = letter.kind
            && code.name == "E"
            && number.end == letter.start
            && letter.end == digits.start
        {
            self.warnings.add(self.number, letter.column, Warning::NoExponent);
        }
    }

    /// The number, checked against the command's range and rounded to its mantissa.
    fn float(&mut self, code: &'static Code, number: &Number, width: Width) -> Option<Float> {
        let text = self.text(number.first);
        if !code.range.contains(number.constant.value()) {
            self.error(number.first, Reason::Range { name: code.name, text, range: code.range });
            return None;
        }
        match Float::encode(&number.constant, width, self.settings) {
            Err(cause) => {
                self.error(number.first, Reason::TooLarge { text, cause });
                None
            }
            // In range as written but not as rounded: a feed rate becomes 0, a routine the next one.
            Ok((float, _)) if !code.range.contains(float.value(self.settings)) => {
                self.error(number.first, Reason::Range { name: code.name, text, range: code.range });
                None
            }
            Ok((float, loss)) => {
                let warning = match (loss, width) {
                    // PMAC itself keeps a program's numbers in 36 bits.
                    (Loss::None, _) | (Loss::Digits, Width::Long) => None,
                    (Loss::Digits, Width::Short) => {
                        Some(Warning::Precision { name: code.name, text, sent: float.value(self.settings) })
                    }
                    (Loss::Vanished, _) => Some(Warning::Vanished { text }),
                };
                if let Some(warning) = warning {
                    self.warnings.add(self.number, self.column(number.first), warning);
                }
                Some(float)
            }
        }
    }

    /// The number as an integer in the command's range.
    fn whole(&mut self, code: &'static Code, number: &Number) -> Option<u16> {
        let is_home = matches!(code.shape, Shape::Motors { .. });
        let most = if is_home { self.settings.home_motors } else { u16::MAX };
        let whole = number.constant.integer().and_then(|whole| u16::try_from(whole).ok());
        let whole = whole.filter(|&whole| code.range.contains(whole.into()) && whole <= most);
        if whole.is_none() {
            let (name, text) = (code.name, self.text(number.first));
            let reason = if is_home {
                Reason::NoHomeBit { name, text, most }
            } else {
                Reason::Range { name, text, range: code.range }
            };
            self.error(number.first, reason);
        }
        whole
    }

    /// `n[,n..]` with `n..m` for any `n`, as bits. `None` after reporting a number out of range.
    fn list(&mut self, code: &'static Code) -> Result<Option<u32>, Abandon> {
        let mut bits = Some(0u32);
        loop {
            let first_at = self.at;
            let first = self.list_number(code)?;
            let last = if self.peek_kind() == Some(Kind::Range) {
                self.at += 1;
                self.list_number(code)?
            } else {
                first
            };
            let range = first.zip(last).and_then(|(first, last)| {
                if first > last {
                    self.error(first_at, Reason::Backwards { first, last });
                    return None;
                }
                Some((first..=last).map(|n| 1u32 << n).sum::<u32>())
            });
            bits = bits.zip(range).map(|(bits, range)| bits | range);
            if !self.take_symbol(b',') {
                return Ok(bits);
            }
        }
    }

    fn list_number(&mut self, code: &'static Code) -> Result<Option<u16>, Abandon> {
        let number = self.constant(code)?;
        Ok(number.and_then(|number| self.whole(code, &number)))
    }

    /// `(axis,axis..)`, or nothing for all nine axes.
    fn axes(&mut self, code: &'static Code, vectors: bool) -> Result<u16, Abandon> {
        if !self.take_symbol(b'(') {
            return Ok(ALL_AXES);
        }
        let with_vectors = if vectors { ", R for the circle vectors" } else { "" };
        let wrong = Reason::AxisList(code.name, with_vectors);
        let mut axes = 0;
        loop {
            let Some(Kind::Command(letter)) = self.peek_kind() else {
                return self.abandon(self.at, wrong);
            };
            match axis_bit(letter) {
                Some(bit) if vectors || bit != VECTORS => axes |= bit,
                _ => return self.abandon(self.at, wrong),
            }
            self.at += 1;
            if self.take_symbol(b')') {
                return Ok(axes);
            }
            if !self.take_symbol(b',') {
                return self.abandon(self.at, wrong);
            }
        }
    }
}
