//! `LIST`: one program line per reply line, with short keywords while I9 is even. With a start or a length, and for the
//! lines in calculation and execution, the line's offset precedes the line.

use std::sync::Arc;

use crate::map::Generation;
use crate::sim::board::error::CommandError;
use crate::sim::board::number::decimal;
use crate::sim::language::interpreter::Line;
use crate::sim::language::interpreter::buffers::Buffer;
use crate::sim::language::reply::Outcome;
use crate::sim::program::store::{Open, PLCS, PROTECTED, Program, TableKind};
use crate::sim::program::{item, text};

/// Most values in one `LIST GATHER` line.
const GATHERED_A_LINE: usize = 8;

/// How long a board takes to put a line into text. No page says; some milliseconds a line are seen.
const LINE_MS: f64 = 1.0;

type Lines = Vec<Arc<item::Line>>;

impl Line<'_, '_> {
    pub(super) fn list(&mut self) -> Outcome {
        let Some(buffer) = self.buffer() else { return self.list_open() };
        let cs = self.interpreter.cs;
        match buffer {
            Buffer::Program => {
                let number = self.scanner.integer()?;
                self.accessible(number >= PROTECTED)?;
                let number = u32::try_from(number).map_err(|_| CommandError::SYNTAX)?;
                let lines = self.programs.store.program(number).map(Program::listed);
                self.list_range(lines.ok_or(CommandError::SYNTAX)?)
            }
            Buffer::Plc => {
                let number = self.scanner.integer()?;
                if number >= PLCS {
                    return Err(CommandError::SYNTAX);
                }
                self.accessible(true)?;
                self.list_existing(self.programs.store.plc(number).map(Program::listed))
            }
            Buffer::Kinematics(inverse) => {
                self.list_existing(self.programs.store.kinematics(cs, inverse).map(Program::listed))
            }
            Buffer::Rotary => {
                let lines = self.programs.store.rotary(cs).ok_or(CommandError::SYNTAX)?.lines().cloned();
                self.list_range(lines.collect())
            }
            Buffer::Calculated => {
                let cursor = self.programs.systems.get(cs).and_then(|system| system.cursor);
                let cursor = cursor.ok_or(CommandError::SYNTAX)?;
                self.list_from(cursor.program, cursor.line)
            }
            Buffer::Executed => {
                let (program, line, _) = self.executed().ok_or(CommandError::SYNTAX)?;
                self.list_from(program, line)
            }
            Buffer::Table(kind) => self.list_table(kind),
            Buffer::Gather => self.list_gather(),
            Buffer::Empty => Ok(()),
            Buffer::Binary | Buffer::All | Buffer::Nothing => Err(CommandError::SYNTAX),
        }
    }

    /// A program that the board lists only if it exists.
    fn list_existing(&mut self, lines: Option<Lines>) -> Outcome {
        self.list_range(lines.filter(|lines| !lines.is_empty()).ok_or(CommandError::SYNTAX)?)
    }

    fn list_open(&mut self) -> Outcome {
        let store = &self.programs.store;
        let lines: Lines = match store.open().ok_or(CommandError::NO_OPEN_BUFFER)? {
            Open::Rotary | Open::BinaryRotary => {
                let rotary = store.rotary(self.interpreter.cs).ok_or(CommandError::NO_OPEN_BUFFER)?;
                rotary.lines().cloned().collect()
            }
            _ => store.open_program().map(Program::all).unwrap_or_default(),
        };
        self.list_range(lines)
    }

    /// `[,[start][,length]]` in long words; if given, each line shows its offset.
    ///
    /// No manual seen gives the answer beyond a program's end. dls-pmacanalyse lists part by part until the board
    /// reports an error, and takes an empty answer for a fault of the board.
    fn list_range(&mut self, lines: Lines) -> Outcome {
        let (mut start, mut end, mut offsets) = (0, usize::MAX, false);
        if self.scanner.take(b',') {
            offsets = true;
            if self.scanner.at_unsigned() {
                start = self.scanner.integer()?;
            }
            if self.scanner.take(b',') {
                end = start.saturating_add(self.scanner.integer()?);
            }
        }
        let last = lines.iter().map(|line| line.offset).max();
        if start > 0 && last.is_none_or(|last| last < start) {
            return Err(CommandError::SYNTAX);
        }
        for line in lines.iter().filter(|line| (start..end).contains(&line.offset)) {
            let text = self.line_text(line);
            self.lines.push(if offsets { format!("{}:{text}", line.offset) } else { text });
        }
        self.board.take_time(LINE_MS * self.lines.len() as f64);
        Ok(())
    }

    /// `LIST PC` and `LIST PE`: `P1:22:X10 Y20`, or with `,[n]` that many lines in the form `22:X10 Y20`.
    fn list_from(&mut self, program: u32, first: u64) -> Outcome {
        let count = if self.scanner.take(b',') {
            let count = if self.scanner.at_unsigned() { self.scanner.integer()? } else { 1 };
            // With a second number, that is the count, and the first is the lines to skip.
            if self.scanner.take(b',') { Some(self.scanner.integer()?) } else { Some(count) }
        } else {
            None
        };
        let store = &self.programs.store;
        let line = |number: u64| match program {
            0 => store.rotary(self.interpreter.cs)?.line(number).cloned(),
            program => store.program(program)?.line(number).cloned(),
        };
        let lines: Lines = (first..).map_while(line).take(count.unwrap_or(1)).collect();
        for line in lines {
            let text = self.line_text(&line);
            let place = if count.is_none() { format!("P{program}:") } else { String::new() };
            self.lines.push(format!("{place}{}:{text}", line.offset));
        }
        Ok(())
    }

    fn line_text(&self, line: &item::Line) -> String {
        text::line(line, self.board.variables.long_listing())
    }

    fn list_table(&mut self, kind: TableKind) -> Outcome {
        let definition = self.scanner.take_text(b"DEF");
        let decimals = self.board.variables.tables().decimals;
        let table = self.table(kind).ok_or(CommandError::SYNTAX)?;
        let texts = if definition {
            vec![format!("{},{}", table.size, decimal(table.span, decimals))]
        } else {
            table.entries.iter().map(|entry| decimal(*entry, decimals)).collect()
        };
        self.lines.extend(texts);
        Ok(())
    }

    /// `LIST GATHER [start][,count]`: the contents of PMAC's own gather memory in hex. PMAC lists words of 24 bits. Turbo lists
    /// words of 48 bits, 12 digits each: the first source of two is the low half, a source of 48 bits is whole, and each
    /// sample begins a word (so a tool in use, dls-pmac-control, takes the answer apart).
    fn list_gather(&mut self) -> Outcome {
        let start = if self.scanner.at_unsigned() { self.scanner.integer()? } else { 0 };
        let count = if self.scanner.take(b',') { self.scanner.integer()? } else { usize::MAX };
        if !self.board.gather_is_defined() {
            return Err(CommandError::SYNTAX);
        }
        let words = self.board.gathered();
        let texts: Vec<String> = match self.board.family().generation {
            Generation::Pmac => words.iter().map(|word| format!("{word:06X}")).collect(),
            Generation::Turbo => {
                let sample = self.board.gather_sources().into_iter().flatten().count().max(1);
                let pairs = words.chunks(sample).flat_map(|sample| sample.chunks(2));
                pairs.map(|pair| format!("{:06X}{:06X}", pair.get(1).unwrap_or(&0), pair[0])).collect()
            }
        };
        let texts: Vec<String> = texts.into_iter().skip(start).take(count).collect();
        self.lines.extend(texts.chunks(GATHERED_A_LINE).map(|line| line.join(" ")));
        Ok(())
    }

    /// The line in execution: program, line number, offset. Before the first line, the next line to be calculated.
    pub(super) fn executed(&self) -> Option<(u32, u64, usize)> {
        let cs = self.interpreter.cs;
        let system = self.programs.systems.get(cs)?;
        let cursor = system.cursor?;
        let offset = self.programs.offset(cs, cursor);
        let at_cursor = (cursor.program, cursor.line, offset);
        // Without moves, execution is where calculation is.
        let executing = system.executing.filter(|_| !system.trajectory.is_idle());
        Some(executing.unwrap_or(at_cursor))
    }

    /// `P1:22`, and its callers, as in `>2.10`.
    pub(super) fn calculated_text(&self) -> Option<String> {
        let cs = self.interpreter.cs;
        let system = self.programs.systems.get(cs)?;
        let programs = &self.programs;
        let cursor = system.cursor?;
        let mut text = format!("P{}:{}", cursor.program, programs.offset(cs, cursor));
        for frame in system.frames.iter().rev() {
            text += &format!(">{}.{}", frame.back.program, programs.offset(cs, frame.back));
        }
        Some(text)
    }
}
