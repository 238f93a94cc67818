//! Commands of the whole board: identity, reset, save, password, data gathering.

use crate::sim::board::calendar;
use crate::sim::board::error::CommandError;
use crate::sim::language::interpreter::Line;
use crate::sim::language::interpreter::buffers::Buffer;
use crate::sim::language::reply::Outcome;
use crate::sim::language::words::Word;

/// The time of a `SAVE` and of a reset. No manual gives it; users of boards with flash memory see some seconds.
const SAVE_MS: f64 = 2000.0;
/// The time to make or take away a buffer, by the same experience.
const BUFFER_MS: f64 = 20.0;

impl Line<'_, '_> {
    pub(super) fn identity(&mut self, what: Word) -> Outcome {
        let identity = &self.board.identity;
        let text = match what {
            Word::Type => identity.tables.type_text.to_owned(),
            Word::Date => identity.date_text.to_owned(),
            Word::Checksum => format!("{:X}", self.board.checksum()),
            Word::Size => self.programs.size(self.board).to_string(),
            _ => identity.firmware.clone(),
        };
        self.answer(text)
    }

    /// `CID`, `VID`, `CPU`.
    pub(super) fn card(&mut self, what: Word) -> Outcome {
        let identity = &self.board.identity;
        let card = identity.tables.card.ok_or(CommandError::SYNTAX)?;
        self.answer(match what {
            Word::Part => card.part,
            Word::Vendor => card.vendor,
            _ => identity.processor.text,
        })
    }

    /// `TODAY` and `TIME` report; `TIME=17:45:24`, the seconds optional (Turbo Software Reference p. 398), and
    /// `TODAY=12/31/2026` set. The page with the form of that date was not seen: the simulator assumes the form that
    /// `TODAY` reports.
    pub(super) fn clock(&mut self, what: Word) -> Outcome {
        let up = self.board.seconds_up();
        let clock = self.board.clock;
        let is_date = what == Word::Today;
        if !self.scanner.take(b'=') {
            let now = clock.now(up);
            return self.answer(if is_date { calendar::date(now) } else { calendar::time(now) });
        }
        let mark = if is_date { b'/' } else { b':' };
        let mut parts = [self.scanner.integer()? as u64, 0, 0];
        for (index, part) in parts.iter_mut().enumerate().skip(1) {
            if self.scanner.take(mark) {
                *part = self.scanner.integer()? as u64;
            } else if is_date || index == 1 {
                return Err(CommandError::SYNTAX);
            }
        }
        let clock = &mut self.board.clock;
        if is_date {
            clock.set_date(up, calendar::day(parts).ok_or(CommandError::SYNTAX)?);
        } else {
            clock.set_time(up, calendar::second(parts).ok_or(CommandError::SYNTAX)?);
        }
        Ok(())
    }

    /// `$$$` and `$$$***`. The reset discards the rest of the line and the addressing.
    pub(super) fn reset_board(&mut self, factory: bool) -> Outcome {
        self.board.reset(factory);
        self.programs.reset(factory);
        self.interpreter.reset();
        self.scanner.rest();
        self.board.take_time(SAVE_MS);
        Ok(())
    }

    /// `SAVE`; an error while a program runs.
    pub(super) fn save(&mut self) -> Outcome {
        if (0..self.board.family().coordinate_systems).any(|cs| self.board.runs_program(cs)) {
            return Err(CommandError::RUNNING);
        }
        self.board.save();
        self.programs.save();
        self.board.take_time(SAVE_MS);
        Ok(())
    }

    /// `PASSWORD={text}` sets or enters the password; the text is the rest of the line. `PASSWORD` reports it.
    pub(super) fn password(&mut self) -> Outcome {
        if !self.scanner.take(b'=') {
            let password = self.board.variables.password.text().ok_or(CommandError::PASSWORD)?;
            let password = String::from_utf8_lossy(password).into_owned();
            return self.answer(password);
        }
        let text = self.scanner.rest().trim_ascii_end();
        if self.board.variables.password.set_or_give(text) { Ok(()) } else { Err(CommandError::PASSWORD) }
    }

    /// `DEFINE GATHER [n]`, or another buffer.
    pub(super) fn define(&mut self) -> Outcome {
        self.board.take_time(BUFFER_MS);
        match self.buffer().ok_or(CommandError::SYNTAX)? {
            Buffer::Gather => {
                // Some hosts send a size with decimals, as `47.0`.
                let is_sized = self.scanner.at_unsigned();
                let longs = if is_sized { Some(self.scanner.unsigned()? as u32) } else { None };
                self.board.define_gather(longs, self.programs.free_memory(self.board))
            }
            buffer => {
                self.define_buffer(buffer)?;
                self.programs.note_end_of_memory(self.board);
                Ok(())
            }
        }
    }

    /// `DELETE GATHER`, `DELETE ALL`, or another buffer.
    pub(super) fn delete(&mut self) -> Outcome {
        self.board.take_time(BUFFER_MS);
        match self.buffer().ok_or(CommandError::SYNTAX)? {
            Buffer::Gather => self.board.delete_gather(),
            Buffer::All => self.delete_all(),
            buffer => self.delete_buffer(buffer),
        }?;
        self.programs.note_end_of_memory(self.board);
        Ok(())
    }

    /// `GATHER`, at once or from a trigger on.
    pub(super) fn gather(&mut self) -> Outcome {
        let triggered = self.scanner.take_text(b"TRIGGER");
        self.board.gather(triggered)
    }
}
