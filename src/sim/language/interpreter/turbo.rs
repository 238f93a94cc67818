//! Commands that Turbo boards alone have: `E`, `LOCK`, `MOVETIME`, `MX`.

use crate::sim::board::error::CommandError;
use crate::sim::board::number::decimal;
use crate::sim::language::expression::variable_number;
use crate::sim::language::interpreter::Line;
use crate::sim::language::lock;
use crate::sim::language::reply::Outcome;
use crate::sim::language::scanner::HEX_48;

impl Line<'_, '_> {
    /// `E`: the killed motors of the coordinate system close their loops at their present positions. No manual seen has
    /// the command. A driver in use (DiamondLightSource/pmac) sends it before each scan and awaits its acknowledgement,
    /// and another program in use (pgpmac) calls `<CTRL-E>` "enable disabled motors".
    pub(super) fn enable_motors(&mut self) -> Outcome {
        for motor in self.board.motors_of(self.interpreter.cs) {
            self.board.enable_motor(motor);
        }
        Ok(())
    }

    /// `LOCK2,P10` and `UNLOCK2`.
    pub(super) fn lock(&mut self, lock: bool) -> Outcome {
        lock::operands(&mut self.scanner, self.board, lock)?.carry_out(self.board);
        Ok(())
    }

    /// `MOVETIME`: the time left in the move in execution, in milliseconds at 100 %. No manual seen gives the form of
    /// the answer.
    pub(super) fn move_time(&mut self) -> Outcome {
        let system = self.programs.systems.get(self.interpreter.cs);
        let left = system.and_then(|system| system.trajectory.time_left()).map_or(0.0, |(left, _)| left);
        self.answer(decimal(left.round(), 0))
    }

    /// `MX0,4` and `MX0,4=5`: no station of this ring speaks protocol type 0, so the exchange fails.
    pub(super) fn auxiliary(&mut self) -> Outcome {
        self.auxiliary_operands()?;
        if self.scanner.take(b'=') {
            self.scanner.register(HEX_48)?;
        }
        Err(CommandError::MACRO)
    }

    /// `MXR0,4,P1` and `MXW0,4,P1`, likewise.
    pub(super) fn auxiliary_transfer(&mut self) -> Outcome {
        self.auxiliary_operands()?;
        self.scanner.expect(b',')?;
        if !matches!(self.scanner.next_character(), Some(b'I' | b'P' | b'Q' | b'M')) {
            return Err(CommandError::SYNTAX);
        }
        variable_number(&mut self.scanner, self.board, self.interpreter.cs)?;
        Err(CommandError::MACRO)
    }

    fn auxiliary_operands(&mut self) -> Outcome {
        self.scanner.integer()?;
        self.scanner.expect(b',')?;
        self.scanner.integer().map(|_| ())
    }
}
