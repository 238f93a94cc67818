//! Commands on variables: reports, assignments, M-variable definitions, each for one number or for several.

use crate::sim::board::Board;
use crate::sim::board::error::CommandError;
use crate::sim::board::firmware::NumberRule;
use crate::sim::board::number::decimal;
use crate::sim::board::variables::VariableKind;
use crate::sim::language::expression::{evaluate, variable_number};
use crate::sim::language::interpreter::Line;
use crate::sim::language::m_definition::definition;
use crate::sim::language::reply::Outcome;

/// The numbers that a command is for.
struct Numbers {
    first: usize,
    count: usize,
    step: usize,
}

impl Numbers {
    fn iter(&self) -> impl Iterator<Item = usize> + use<> {
        (self.first..).step_by(self.step).take(self.count)
    }
}

impl Line<'_, '_> {
    /// I, P, Q or M with a number; P and Q alone are other commands.
    pub(super) fn variable(&mut self, letter: u8) -> Outcome {
        let numbered = self.scanner.peek().is_some_and(|c| c.is_ascii_digit() || c == b'(');
        if !numbered {
            return match letter {
                b'P' => self.report_position(),
                b'Q' => {
                    self.programs.quit(self.board, self.interpreter.cs);
                    Ok(())
                }
                _ => Err(CommandError::SYNTAX),
            };
        }
        let kind = VariableKind::from_letter(letter).ok_or(CommandError::SYNTAX)?;
        let numbers = self.numbers()?;
        if kind == VariableKind::M {
            if self.scanner.take_tight(b"->") {
                return self.m_definitions(numbers);
            }
            if self.at_synchronous_assignment() {
                return Err(CommandError::NO_OPEN_BUFFER);
            }
        }
        if self.scanner.take(b'=') { self.assign(kind, numbers) } else { self.report(kind, numbers) }
    }

    /// `5`, `(expression)` or `1..8`; on Turbo also `130,4,100`: four from 130 on, a hundred apart (Turbo Software Reference
    /// p. 328).
    fn numbers(&mut self) -> Result<Numbers, CommandError> {
        let cs = self.interpreter.cs;
        let tables = self.board.identity.tables;
        let first = variable_number(&mut self.scanner, self.board, cs)?;
        if self.scanner.take_text(b"..") {
            let last = variable_number(&mut self.scanner, self.board, cs)?;
            let count = (last + 1).checked_sub(first).filter(|&count| count > 0);
            return Ok(Numbers { first, count: count.ok_or(CommandError::SYNTAX)?, step: 1 });
        }
        if !(tables.numbers == NumberRule::Wrapped && self.scanner.take(b',')) {
            return Ok(Numbers { first, count: 1, step: 1 });
        }
        let count = self.scanner.integer()?;
        self.scanner.expect(b',')?;
        let step = self.scanner.integer()?;
        let end = count.saturating_sub(1).saturating_mul(step).saturating_add(first);
        if count == 0 || step == 0 || end >= tables.variables {
            return Err(CommandError::SYNTAX);
        }
        Ok(Numbers { first, count, step })
    }

    fn assign(&mut self, kind: VariableKind, numbers: Numbers) -> Outcome {
        if kind == VariableKind::I && self.scanner.take(b'*') {
            for number in numbers.iter() {
                let default = self.board.variables.default_i(number);
                self.board.assign(kind, 0, number, default);
            }
            return Ok(());
        }
        let cs = self.interpreter.cs;
        let value = evaluate(&mut self.scanner, self.board, cs)?;
        for number in numbers.iter() {
            self.board.assign(kind, cs, number, value);
        }
        Ok(())
    }

    fn report(&mut self, kind: VariableKind, numbers: Numbers) -> Outcome {
        let variables = &self.board.variables;
        for number in numbers.iter() {
            let text = match kind {
                VariableKind::I if variables.long_listing() => {
                    format!("I{number}={}", variables.i_text(number))
                }
                VariableKind::I => variables.i_text(number),
                _ => {
                    let value = self.board.value(kind, self.interpreter.cs, number);
                    decimal(value, variables.tables().decimals)
                }
            };
            self.lines.push(text);
        }
        Ok(())
    }

    fn m_definitions(&mut self, numbers: Numbers) -> Outcome {
        let definition = definition(&mut self.scanner, self.board.family())?;
        for number in numbers.iter() {
            if let Some(definition) = &definition {
                let Board { variables, memory, .. } = &mut *self.board;
                if !variables.define_m(memory, number, definition) {
                    return Err(CommandError::SYNTAX);
                }
                continue;
            }
            let text = self.board.variables.m_definition(&self.board.memory, number).text();
            let long = self.board.variables.long_listing();
            self.lines.push(if long { format!("M{number}->{text}") } else { text });
        }
        Ok(())
    }

    /// `M1==`, `M1&=`, `M1|=`, `M1^=`: statements that a program executes at the start of its next move.
    fn at_synchronous_assignment(&mut self) -> bool {
        [b"==", b"&=", b"|=", b"^="].into_iter().any(|text| self.scanner.clone().take_text(text))
    }
}
