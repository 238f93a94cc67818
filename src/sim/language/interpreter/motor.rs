//! Commands of the addressed motor: jog, home, kill, open loop, reports (Software Reference, on-line commands).

use crate::map::Generation;
use crate::sim::board::error::CommandError;
use crate::sim::board::jog::Jog;
use crate::sim::board::number::tenths;
use crate::sim::language::axis::definition;
use crate::sim::language::interpreter::Line;
use crate::sim::language::reply::Outcome;

impl Line<'_, '_> {
    pub(super) fn jog(&mut self) -> Outcome {
        if self.at_argument() && !matches!(self.scanner.peek(), Some(b'+' | b'-')) {
            // `J5` is a circle vector.
            return Err(CommandError::NO_OPEN_BUFFER);
        }
        let mut until_trigger = None;
        let jog = match self.scanner.next_character() {
            Some(b'+') => Jog::Plus,
            Some(b'-') => Jog::Minus,
            Some(b'/') if self.board.faults.jog_stop_refused => return Err(CommandError::SYNTAX),
            Some(b'/') => Jog::Stop,
            Some(b'!') => Jog::RoundCommanded,
            Some(b'=') if self.scanner.take(b'=') => Jog::ToAsPreJog(self.scanner.constant()?),
            Some(b'=') if !self.scanner.at_constant() && self.scanner.peek() != Some(b'*') => Jog::PreJog,
            Some(b'=') => self.distance(Jog::ToVariable, Jog::To, &mut until_trigger)?,
            Some(b':') => self.distance(Jog::ByCommandedVariable, Jog::ByCommanded, &mut until_trigger)?,
            Some(b'^') => self.distance(Jog::ByActualVariable, Jog::ByActual, &mut until_trigger)?,
            _ => return Err(CommandError::SYNTAX),
        };
        self.board.jog(self.interpreter.motor, jog, until_trigger)
    }

    /// `{c}` or `*`, with an optional `^{c2}`: the move ends that far from the trigger.
    fn distance(
        &mut self,
        variable: Jog,
        constant: impl FnOnce(f64) -> Jog,
        until_trigger: &mut Option<f64>,
    ) -> Result<Jog, CommandError> {
        let jog = if self.scanner.take(b'*') { variable } else { constant(self.scanner.constant()?) };
        if self.scanner.take(b'^') {
            *until_trigger = Some(self.scanner.constant()?);
        }
        Ok(jog)
    }

    pub(super) fn open_loop(&mut self) -> Outcome {
        let percent = self.scanner.constant()?;
        self.board.open_loop(self.interpreter.motor, percent)
    }

    pub(super) fn report_position(&mut self) -> Outcome {
        let position = self.board.position(self.interpreter.motor);
        self.answer(self.board.identity.tables.positions.text(position))
    }

    pub(super) fn report_velocity(&mut self) -> Outcome {
        let velocity = self.board.velocity(self.interpreter.motor);
        self.answer(tenths(velocity))
    }

    pub(super) fn report_following_error(&mut self) -> Outcome {
        let error = self.board.following_error(self.interpreter.motor);
        self.answer(tenths(error))
    }

    /// `#n->` lists, `#n->{definition}` defines in the addressed coordinate system (Software Reference p. 179). A motor
    /// of another coordinate system lists as `0`, and the board refuses to redefine it. `#n->0` does not clear the
    /// definition of such a motor, but is no error: the manual only says to address the motor's own coordinate system,
    /// and a tool in use (dls-pmacanalyse) writes `#n->0` for every coordinate system into files for a board. An error
    /// would end a download at the first of these lines.
    pub(super) fn axis_definition(&mut self, motor: usize) -> Outcome {
        let cs = self.interpreter.cs;
        let decimals = self.board.variables.tables().decimals;
        let generation = self.board.family().generation;
        let kinematic = {
            // `#1->I` defines; `#1-> I5` lists, and reports I5.
            let mut ahead = self.scanner.clone();
            generation == Generation::Turbo
                && ahead.take(b'I')
                && !ahead.peek().is_some_and(|c| c.is_ascii_digit() || c == b'(')
        };
        let given = kinematic
            || self.scanner.at_constant()
            || self
                .scanner
                .peek()
                .is_some_and(|c| matches!(c, b'+' | b'-') || crate::sim::board::axes::is_axis(c));
        let axes = &self.board.axes;
        if !given {
            // The EPICS driver asks `&1#1->,` of every motor, and takes the one line of the reply for the answer
            // (`pmacController.cpp` of DiamondLightSource/pmac). If the board refused the comma, that driver would have no axes.
            let _ = generation == Generation::Turbo && self.scanner.take(b',');
            let own = axes.definition(motor).filter(|definition| definition.coordinate_system == cs);
            let text = own.map_or_else(|| "0".to_owned(), |definition| definition.text(decimals));
            return self.answer(text);
        }
        let definition = definition(&mut self.scanner, cs, generation)?;
        if axes.coordinate_system(motor).is_some_and(|other| other != cs) {
            // A site's backup sends `#n->0` in each coordinate system that does not own the motor. The definition in
            // its own stays.
            return if definition.is_none() { Ok(()) } else { Err(CommandError::SYNTAX) };
        }
        if self.board.runs_program(cs) {
            return Err(CommandError::RUNNING);
        }
        self.board.axes.set(motor, definition);
        Ok(())
    }
}
