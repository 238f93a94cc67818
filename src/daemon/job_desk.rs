//! The desks of the functions other than ASCII, as one: who gets a job, and when each is due.

use std::time::Instant;

use super::panel_desk::PanelDesk;
use super::rotary_desk::RotaryDesk;
use super::shared::job::{Job, MaskedWord};
use super::shared::queue::{Event, Outcome, Text, Ticket};
use super::write_desk::WriteDesk;
use crate::clock::Clock;
use crate::device::{Bus, BusError};
use crate::function::rotary::RotarySetup;
use crate::function::variable_read::{VariableMode, VariableReadBusError, VariableReader};
use crate::function::variable_write::VariableWriter;
use crate::map::{HostOffset, Plan};
use crate::mirror::{GatherMirror, VariableMirror};
use crate::protocol::{Function, Functions};
use crate::segment::Publisher;

/// The desks.
pub struct JobDesk {
    clock: Clock,
    plan: Plan,
    functions: Functions,
    panel: PanelDesk,
    rotary: RotaryDesk,
    variables: VariableMirror,
    gather: GatherMirror,
    write: WriteDesk,
}

impl JobDesk {
    /// Desks whose buffers lie where `plan` says.
    #[must_use]
    pub fn new(plan: Plan, mode: VariableMode, clock: Clock) -> Self {
        let now = clock.now();
        Self {
            panel: PanelDesk::new(now),
            rotary: RotaryDesk::new(now),
            variables: VariableMirror::new(plan.variable_read(), mode, clock.clone()),
            gather: GatherMirror::new(&plan.family().servo, clock.clone()),
            write: WriteDesk::new(plan.variable_write(), now),
            clock,
            functions: Functions::default(),
            plan,
        }
    }

    /// The same desks, of which only those of `functions` touch the board by themselves.
    #[must_use]
    pub fn using(mut self, functions: Functions) -> Self {
        self.functions = functions;
        self
    }

    /// The board's firmware has become known, and with it where gathering lies; the other buffers stay where they are.
    pub fn set_plan(&mut self, plan: Plan) {
        self.plan = plan;
    }

    /// Puts the board's host words in order at the start, or after a reset.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn take_over(&mut self, bus: &mut impl Bus, publisher: &Publisher) -> Result<(), BusError> {
        let now = self.clock.now();
        self.rotary.forget();
        self.gather.forget(publisher);
        if self.functions.has(Function::Variables) {
            self.write.take_over(bus, now)?;
            VariableReader::release(bus)?;
            self.variables.begin_again(bus, publisher, now)?;
        }
        if self.functions.has(Function::Panel) { self.panel.take_over(bus, now) } else { Ok(()) }
    }

    /// Leaves nothing requested on the way out. Overrides stay: a machine's speed must not change because its
    /// daemon stops.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn leave(&mut self, bus: &mut impl Bus) -> Result<(), BusError> {
        if self.functions.has(Function::Variables) {
            VariableWriter::release(bus)?;
            VariableReader::release(bus)?;
        }
        if self.functions.has(Function::Panel) { self.panel.leave(bus) } else { Ok(()) }
    }

    /// Takes a job in; tells its end if it has one at once.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn submit(
        &mut self,
        bus: &mut impl Bus,
        publisher: &Publisher,
        ticket: Ticket,
        job: Job,
        deadline: Instant,
    ) -> Result<Option<Event>, BusError> {
        let now = self.clock.now();
        let outcome = match job {
            Job::Panel(request) => {
                self.panel.submit(ticket, request, deadline, now);
                return Ok(None);
            }
            Job::RotarySend { buffer, first, lines } => {
                return Ok(self.rotary.submit(ticket, buffer, first, lines, deadline, now));
            }
            Job::WriteVariables(records) => {
                self.write.submit(ticket, records, deadline, now);
                return Ok(None);
            }
            Job::RotaryState(buffer) => return self.rotary.state(bus, ticket, buffer).map(Some),
            Job::Override { coordinate_system, value } => {
                self.panel.set_override(bus, coordinate_system, value)?
            }
            Job::Write { first, words, anywhere } => {
                match if anywhere { Ok(()) } else { self.plan.check_open(first, words.len()) } {
                    Ok(()) => write(bus, first, &words)?,
                    Err(reason) => Outcome::Refused(Text::of(&reason)),
                }
            }
            Job::WatchVariables(entries) => match self.variables.begin(bus, &entries, publisher, now) {
                Ok(()) => return Ok(Some(Event::Watching(ticket, self.variables.table()))),
                Err(VariableReadBusError::Refused(reason)) => Outcome::Refused(Text::of(&reason)),
                Err(VariableReadBusError::Bus(error)) => return Err(error),
            },
            Job::GatherBegin { buffer, clock } => {
                match self.plan.check_gather(buffer.place.buffer, buffer.size_longs, buffer.sample_longs) {
                    Err(reason) => Outcome::Refused(Text::of(&reason)),
                    Ok(()) => match self.gather.begin(bus, buffer, clock, publisher, now)? {
                        Ok(()) => Outcome::Done,
                        Err(reason) => Outcome::Refused(Text::of(&reason)),
                    },
                }
            }
            Job::GatherEnd => {
                self.gather.end(now);
                Outcome::Done
            }
            Job::RotaryOpen { buffer, start, size_longs, coordinate_system, coordinate_system_base } => {
                let kept = self.plan.rotary()[buffer as usize];
                let setup = RotarySetup {
                    buffer,
                    start: start.unwrap_or(kept.start),
                    size_longs: size_longs.unwrap_or(kept.words() as u32 / 2),
                    coordinate_system,
                    coordinate_system_base,
                };
                match self.plan.check_rotary(buffer as usize, setup.start, setup.size_longs) {
                    Ok(()) => self.rotary.open(bus, &setup)?,
                    Err(reason) => Outcome::Refused(Text::of(&reason)),
                }
            }
            Job::RotaryFinish(buffer) => self.rotary.finish(buffer),
        };
        Ok(Some(Event::Done(ticket, outcome)))
    }

    /// At the end: of the panel requests that wait, keeps only the stops.
    pub fn keep_stops(&mut self) {
        self.panel.keep_stops();
    }

    /// At the end: hands over the next of the panel requests that are left, if it is due. When to do so again; `None` when
    /// none is left.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn finish_stops(&mut self, bus: &mut impl Bus) -> Result<Option<Instant>, BusError> {
        let now = self.clock.now();
        if self.panel.due().is_some_and(|due| due <= now) {
            self.panel.pass(bus, now)?;
        }
        Ok(self.panel.due())
    }

    /// When to pass next; `None` while nothing is to be done.
    #[must_use]
    pub fn due(&self) -> Option<Instant> {
        let dues =
            [self.panel.due(), self.gather.due(), self.rotary.due(), self.write.due(), self.variables.due()];
        dues.into_iter().flatten().min()
    }

    /// Does one bounded piece of what is due, what was due first first.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn pass(
        &mut self,
        bus: &mut impl Bus,
        publisher: &mut Publisher,
        now: Instant,
    ) -> Result<Option<Event>, BusError> {
        let Some(first) = self.due().filter(|due| *due <= now) else { return Ok(None) };
        if self.panel.due() == Some(first) {
            self.panel.pass(bus, now)
        } else if self.gather.due() == Some(first) {
            self.gather.pass(bus, publisher, now).map(|()| None)
        } else if self.write.due() == Some(first) {
            self.write.pass(bus, now)
        } else if self.rotary.due() == Some(first) {
            self.rotary.pass(bus, now)
        } else {
            self.variables.pass(bus, publisher, now).map(|()| None)
        }
    }
}

/// Writes words, ascending, of each only the bits of its mask.
fn write(bus: &mut impl Bus, first: HostOffset, words: &[MaskedWord]) -> Result<Outcome, BusError> {
    // Nothing is written unless all of it can be.
    let end = first.plus_words(words.len()).bytes() as usize;
    if end > bus.length() {
        return Ok(Outcome::OutOfRange);
    }
    for (index, word) in words.iter().enumerate() {
        // A word of which nothing is to change is not touched: it may be PMAC's.
        if word.mask == 0 {
            continue;
        }
        let offset = first.plus_words(index);
        let value = if word.mask == u16::MAX {
            word.value
        } else {
            bus.read16(offset)? & !word.mask | word.value & word.mask
        };
        bus.write16(offset, value)?;
    }
    bus.order_writes();
    Ok(Outcome::Done)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::{Counted, FileBoard};

    /// The rows of [`crate::function`]'s table of costs about open words.
    #[test]
    fn open_words_cost_what_the_table_says() {
        for n in [1, 8, 100] {
            for (mask, cost) in [(u16::MAX, (0, n)), (0x00F0, (n, n)), (0, (0, 0))] {
                let file = tempfile::tempfile().unwrap();
                file.set_len(0x4000).unwrap();
                let mut bus = Counted::new(FileBoard::from_file(&file, 0x4000).unwrap());
                let words = vec![MaskedWord { value: 0xABCD, mask }; n as usize];
                assert_eq!(write(&mut bus, HostOffset::new(0x3000), &words).unwrap(), Outcome::Done);
                assert_eq!((bus.reads(), bus.writes()), cost, "{n} {mask:04x}");
                assert_eq!(bus.read16(HostOffset::new(0x3000)).unwrap(), 0xABCD & mask);
            }
        }
    }
}
