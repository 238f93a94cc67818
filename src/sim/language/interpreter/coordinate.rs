//! Commands of the addressed coordinate system: run, stop, override, axis positions and modes, status words.

use crate::sim::board::axes::{AxisMode, with_mode};
use crate::sim::board::error::CommandError;
use crate::sim::board::number::decimal;
use crate::sim::language::axis::parse_list;
use crate::sim::language::interpreter::Line;
use crate::sim::language::reply::{Outcome, status_text};

/// The largest value of the time base register, in units of I10.
const LARGEST_TIME_BASE: f64 = ((1 << 23) - 1) as f64;

impl Line<'_, '_> {
    /// An axis letter: `X=5` redefines the position, `X5` is a move and needs a buffer; A, V and Z alone are commands.
    pub(super) fn axis(&mut self, axis: u8) -> Outcome {
        if self.scanner.take(b'=') {
            let position = self.scanner.constant()?;
            self.not_running(self.interpreter.cs)?;
            return self.board.rename_axis(self.interpreter.cs, char::from(axis), position);
        }
        self.letter(|line| match axis {
            b'A' => {
                line.programs.abort(line.board, line.interpreter.cs);
                Ok(())
            }
            b'V' => line.report_velocity(),
            b'Z' => {
                line.not_running(line.interpreter.cs)?;
                line.board.zero_axes(line.interpreter.cs)
            }
            _ => Err(CommandError::SYNTAX),
        })
    }

    /// `B{c}` points to a program; `B={c}` redefines the position of the B axis.
    pub(super) fn point_to_program(&mut self) -> Outcome {
        if self.scanner.peek() == Some(b'=') {
            return self.axis(b'B');
        }
        let number = self.scanner.unsigned()?;
        let cs = self.interpreter.cs;
        self.not_running(cs)?;
        self.programs.begin(self.board, cs, number)
    }

    /// `%` reports, `%{c}` sets the feedrate override; the time base register limits it (Software Reference p. 185).
    pub(super) fn feedrate_override(&mut self) -> Outcome {
        let cs = self.interpreter.cs;
        if !self.scanner.at_constant() {
            let decimals = self.board.variables.tables().decimals;
            let percent = self.board.override_percent(cs);
            return self.answer(decimal(percent, decimals));
        }
        let percent = self.scanner.constant()?;
        if percent < 0.0 {
            return Err(CommandError::SYNTAX);
        }
        let servo_time = self.board.variables.i(10).max(1.0);
        self.board.set_override(cs, percent.min(LARGEST_TIME_BASE / servo_time * 100.0));
        Ok(())
    }

    /// `?`, `??`, `???`: 24-bit words, six hex digits each.
    pub(super) fn status(&mut self, which: u8) -> Outcome {
        self.answer(match which {
            1 => status_text(&self.board.motor_status(self.interpreter.motor)),
            2 => status_text(&self.board.coordinate_report(self.interpreter.cs)),
            _ => status_text(&self.board.global_status()),
        })
    }

    /// `ABS`, `INC`, `FRAX`, with or without a list of axes in parentheses.
    pub(super) fn axis_mode(&mut self, mode: AxisMode) -> Outcome {
        let list = parse_list(&mut self.scanner)?;
        let cs = self.interpreter.cs;
        let status = with_mode(self.board.coordinate_status(cs)[0], mode, list.as_deref())?;
        let register = self.board.memory.registers().coordinate_status.of(cs);
        self.board.memory.write(register, status);
        Ok(())
    }

    /// `UNDEFINE` clears the axis definitions of the coordinate system, `UNDEFINE ALL` those of all coordinate systems.
    pub(super) fn undefine(&mut self) -> Outcome {
        let all = 0..self.board.family().coordinate_systems;
        let own = self.interpreter.cs..self.interpreter.cs + 1;
        let range = if self.scanner.take_text(b"ALL") { all } else { own };
        for cs in range.clone() {
            self.not_running(cs)?;
        }
        for cs in range {
            self.board.axes.undefine(cs);
        }
        Ok(())
    }

    fn not_running(&self, cs: usize) -> Outcome {
        if self.board.runs_program(cs) { Err(CommandError::RUNNING) } else { Ok(()) }
    }
}
