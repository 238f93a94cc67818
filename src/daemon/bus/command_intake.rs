//! The queues of commands from the socket's thread, and of answers to it.

use std::os::fd::BorrowedFd;

use crate::daemon::shared::queue::{Command, Event, Receive, Sender};

/// The bus thread's ends of the queues.
pub struct CommandIntake {
    commands: Receive<Command>,
    events: Sender<Event>,
    /// An answer for which the queue to the socket had no room. Until it is gone the bus thread takes no command.
    unsent: Option<Event>,
}

impl CommandIntake {
    /// Takes commands from `commands`, and answers to `events`.
    #[must_use]
    pub const fn new(commands: Receive<Command>, events: Sender<Event>) -> Self {
        Self { commands, events, unsent: None }
    }

    /// The queue of events to the socket.
    #[must_use]
    pub const fn events(&self) -> &Sender<Event> {
        &self.events
    }

    /// Whether an answer waits for room in the queue to the socket.
    #[must_use]
    pub const fn is_held_up(&self) -> bool {
        self.unsent.is_some()
    }

    /// Readable while commands may wait; `None` while the bus thread takes no command.
    #[must_use]
    pub fn descriptor(&self) -> Option<BorrowedFd<'_>> {
        (!self.is_held_up()).then(|| self.commands.descriptor())
    }

    /// Whether commands wait.
    #[must_use]
    pub fn has_waiting(&self) -> bool {
        self.commands.has_values()
    }

    /// Answers the socket, or keeps the answer until there is room.
    pub fn answer(&mut self, event: Event) {
        self.unsent = self.events.try_send(event).err();
    }

    /// Tries to send the answer that had no room.
    pub fn retry(&mut self) {
        if let Some(event) = self.unsent.take() {
            self.answer(event);
        }
    }

    /// Forgets that there was a command to read. Call this before the first [`Self::take`].
    pub fn clear(&self) {
        self.commands.clear();
    }

    /// Keeps the descriptor readable: the queue may still have commands.
    pub fn keep_awake(&self) {
        self.commands.keep_awake();
    }

    /// The next command; `None` if no command waits, or while the bus thread takes none.
    #[must_use]
    pub fn take(&self) -> Option<Command> {
        if self.is_held_up() { None } else { self.commands.try_receive() }
    }

    /// At the end: the next command, even if an answer waits for room.
    #[must_use]
    pub fn drain(&self) -> Option<Command> {
        self.commands.try_receive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::shared::queue::{Outcome, Ticket, queue};

    #[test]
    fn no_command_is_taken_while_an_answer_has_no_room() {
        let (sender, commands) = queue(4).unwrap();
        let (events, told) = queue(1).unwrap();
        let mut intake = CommandIntake::new(commands, events);
        assert!(!intake.has_waiting());
        let control = |number| Command::Control {
            ticket: Ticket(number),
            uid: 0,
            drops_lines: false,
            character: 1,
            deadline: std::time::Instant::now(),
        };
        assert!(sender.try_send(control(1)).is_ok() && intake.has_waiting());
        for number in 1..=2 {
            intake.answer(Event::Done(Ticket(number), Outcome::Done));
        }
        assert!(intake.is_held_up() && intake.descriptor().is_none() && intake.take().is_none());
        intake.retry();
        assert!(intake.is_held_up(), "there is still no room");
        assert!(matches!(told.try_receive(), Some(Event::Done(Ticket(1), _))));
        intake.retry();
        assert!(!intake.is_held_up() && intake.take().is_some());
        assert!(matches!(told.try_receive(), Some(Event::Done(Ticket(2), _))), "no answer is lost");
    }
}
