//! Commands of the addressed coordinate system: run, stop, override, axis positions and modes, status words.

use super::axis::{AxisMode, parse_list, with_mode};
use super::interpreter::Line;
use super::motor::{is_activated, is_running};
use super::number::decimal;
use super::{Board, CommandError, Outcome};

/// The largest value of the time base register, in units of I10.
const LARGEST_TIME_BASE: f64 = ((1 << 23) - 1) as f64;

impl Line<'_, '_> {
    /// An axis letter: `X=5` renames the position, `X5` is a move and needs a buffer; A, V and Z alone are commands.
    pub(super) fn axis(&mut self, axis: u8) -> Outcome {
        if self.scanner.take(b'=') {
            let position = self.scanner.constant()?;
            self.not_running(self.interpreter.cs)?;
            return self.board.rename_axis(self.interpreter.cs, char::from(axis), position);
        }
        self.letter(|line| match axis {
            b'A' => {
                line.board.abort(line.interpreter.cs);
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

    pub(super) fn quit(&mut self) -> Outcome {
        self.board.quit(self.interpreter.cs);
        Ok(())
    }

    pub(super) fn feed_hold(&mut self) -> Outcome {
        self.board.feed_hold(self.interpreter.cs);
        Ok(())
    }

    pub(super) fn stop_after_move(&mut self) -> Outcome {
        self.board.stop_after_move(self.interpreter.cs);
        Ok(())
    }

    pub(super) fn program_hold(&mut self) -> Outcome {
        self.board.program_hold(self.interpreter.cs);
        Ok(())
    }

    pub(super) fn run_program(&mut self) -> Outcome {
        self.board.run(self.interpreter.cs)
    }

    pub(super) fn step_program(&mut self) -> Outcome {
        self.board.step(self.interpreter.cs)
    }

    /// `B{c}` points to a program; `B={c}` renames the B axis.
    pub(super) fn point_to_program(&mut self) -> Outcome {
        if self.scanner.peek() == Some(b'=') {
            return self.axis(b'B');
        }
        let number = self.scanner.unsigned()?;
        let cs = self.interpreter.cs;
        self.not_running(cs)?;
        self.board.begin(cs, number)
    }

    /// `%` reports, `%{c}` commands the feedrate override; the time base register limits it (Software Reference p. 185).
    pub(super) fn feedrate_override(&mut self) -> Outcome {
        let cs = self.interpreter.cs;
        if !self.scanner.at_constant() {
            let decimals = self.board.variables.family().decimals;
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

    /// `?`, `??`, `???`: two 24-bit words, six hex digits each.
    pub(super) fn status(&mut self, which: u8) -> Outcome {
        let words = match which {
            1 => self.board.motor_status(self.interpreter.motor),
            2 => self.board.coordinate_status(self.interpreter.cs),
            _ => self.board.global_status(),
        };
        self.answer(status_text(words))
    }

    /// `ABS`, `INC`, `FRAX`, with or without a list of axes in parentheses.
    pub(super) fn axis_mode(&mut self, mode: AxisMode) -> Outcome {
        let list = parse_list(&mut self.scanner)?;
        let cs = self.interpreter.cs;
        let status = with_mode(self.board.coordinate_status(cs)[0], mode, list.as_deref())?;
        let address = self.board.variables.family().coordinate_status_address(cs);
        self.board.memory.write_x(address, status);
        Ok(())
    }

    /// `UNDEFINE`: the axis definitions of the coordinate system; `UNDEFINE ALL`: of all.
    pub(super) fn undefine(&mut self) -> Outcome {
        let all = 0..self.board.variables.family().coordinate_systems;
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
        if is_running(self.board, cs) { Err(CommandError::RUNNING) } else { Ok(()) }
    }
}

/// Two status words as reports show them.
pub(super) fn status_text([first, second]: [u32; 2]) -> String {
    format!("{:06X}{:06X}", first & 0xFF_FFFF, second & 0xFF_FFFF)
}

/// What stops a program from starting, in the order in which a board looks (Software Reference p. 25; the order itself
/// is not printed). `pointed`: the coordinate system points to a program.
///
/// # Errors
/// ERR015, ERR014, ERR013, ERR012, ERR010, ERR011.
pub(in crate::sim) fn check_start(board: &Board, cs: usize, pointed: bool) -> Outcome {
    let motors: Vec<usize> = board.axes.motors_in(cs).collect();
    let status = |motor: usize| board.motor_status(motor)[0];
    let bits_set = |motor: &usize, mask: u32| status(*motor) & mask == mask;
    if !pointed {
        return Err(CommandError::NO_PROGRAM);
    }
    if motors.is_empty() {
        return Err(CommandError::NO_MOTOR);
    }
    if motors.iter().any(|&motor| !is_activated(board, motor)) {
        return Err(CommandError::NOT_ACTIVATED);
    }
    if motors.iter().any(|motor| bits_set(motor, 1 << 18)) {
        return Err(CommandError::OPEN_LOOP);
    }
    if motors.iter().any(|motor| bits_set(motor, 1 << 22 | 1 << 21)) {
        return Err(CommandError::BOTH_LIMITS);
    }
    if motors.iter().any(|motor| !bits_set(motor, 1 << 13)) {
        return Err(CommandError::MOVE_IN_PROGRESS);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::{Interpreter, testing};
    use super::*;

    #[test]
    fn what_stops_a_program_from_starting_in_order() {
        let mut board = testing::board();
        let mut interpreter = Interpreter::new();
        let mut send = |board: &mut Board, line: &str| {
            assert_eq!(interpreter.execute(board, line.as_bytes()).error, None, "{line}");
        };
        assert_eq!(check_start(&board, 0, false), Err(CommandError::NO_PROGRAM));
        assert_eq!(check_start(&board, 0, true), Err(CommandError::NO_MOTOR));
        send(&mut board, "#2->X");
        assert_eq!(check_start(&board, 0, true), Err(CommandError::NOT_ACTIVATED));
        // The first status word of motor 2 is X:$0079.
        send(&mut board, "I200=1 WX$79,$640000");
        assert_eq!(check_start(&board, 0, true), Err(CommandError::OPEN_LOOP));
        send(&mut board, "WX$79,$600000");
        assert_eq!(check_start(&board, 0, true), Err(CommandError::BOTH_LIMITS));
        send(&mut board, "WX$79,$400000");
        assert_eq!(check_start(&board, 0, true), Err(CommandError::MOVE_IN_PROGRESS));
        send(&mut board, "WX$79,$002000");
        assert_eq!(check_start(&board, 0, true), Ok(()));
    }
}
