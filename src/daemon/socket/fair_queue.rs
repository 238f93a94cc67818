//! Chooses the next command: the users take turns, and so do each user's connections.
//!
//! The bus thread gets few commands at a time. The others wait here, in a fair order: a user with sixty connections
//! delays another user's command by the few that the bus thread has and by one more, not by sixty. A connection has at
//! most one command here, which bounds the queue.

use std::collections::{HashMap, VecDeque};

use nix::unistd::Uid;

use crate::daemon::shared::job::Job;
use crate::daemon::shared::queue::{Command, Ticket, at_once};
use crate::function::ascii::control::control_has_reply;

/// Kinds of commands. A command does not wait for commands of another kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum CommandKind {
    /// Lines for the board, which takes one line after the other.
    Line,
    /// Control characters without an answer, such as the ones that stop a machine: they overtake all other commands.
    Control,
    /// Control characters with an answer, which wait for the line under way.
    Query,
    /// Control panel requests.
    Panel,
    /// Writes of variables.
    Variables,
    /// Lines for a rotary buffer, which may wait long for room.
    Rotary,
    /// Commands that the bus thread carries out at once.
    Short,
}

impl CommandKind {
    const ALL: [Self; 7] =
        [Self::Control, Self::Panel, Self::Query, Self::Line, Self::Short, Self::Variables, Self::Rotary];

    fn of(command: &Command) -> Self {
        match command {
            Command::Send { .. } | Command::First { .. } => Self::Line,
            Command::Control { character, .. } if control_has_reply(*character) => Self::Query,
            Command::Control { .. } => Self::Control,
            Command::ReadWords { .. } => Self::Short,
            Command::Job { job, .. } => match **job {
                Job::Panel(_) | Job::EndHold(_) => Self::Panel,
                Job::WriteVariables(_) => Self::Variables,
                Job::RotarySend { .. } => Self::Rotary,
                _ => Self::Short,
            },
        }
    }

    /// How many commands of this kind the bus thread has at a time: enough to keep it busy.
    fn at_once(self) -> usize {
        match self {
            Self::Line => at_once::LINES,
            Self::Control => at_once::CONTROLS,
            Self::Query => at_once::QUERIES,
            Self::Panel => at_once::PANEL,
            Self::Variables => at_once::WRITES,
            Self::Rotary => at_once::ROTARY,
            Self::Short => at_once::SHORT,
        }
    }
}

/// A command that waits for its turn.
#[derive(Debug)]
pub(super) struct Turn {
    pub(super) ticket: Ticket,
    pub(super) command: Command,
    /// The entry for the audit log, once the bus thread has got the command.
    pub(super) audit: Option<String>,
}

impl Turn {
    /// Whether the command waits while a given-up command holds the port.
    pub(super) fn is_for_port(&self) -> bool {
        matches!(CommandKind::of(&self.command), CommandKind::Line | CommandKind::Query)
    }
}

/// The commands of one kind.
#[derive(Debug, Default)]
struct Lane {
    /// Users with queued commands, in the order of their turns, each with its commands, oldest first; no empty queues.
    users: VecDeque<(Uid, VecDeque<Turn>)>,
    handed: usize,
}

/// Every command that the bus thread has not answered.
#[derive(Debug, Default)]
pub(super) struct FairQueue {
    lanes: [Lane; CommandKind::ALL.len()],
    /// The commands that the bus thread has.
    handed: HashMap<Ticket, CommandKind>,
}

impl FairQueue {
    /// Puts `turn` of `user` into the queue.
    pub(super) fn wait(&mut self, user: Uid, turn: Turn) {
        let users = &mut self.lanes[CommandKind::of(&turn.command) as usize].users;
        match users.iter_mut().find(|(other, _)| *other == user) {
            Some((_, turns)) => turns.push_back(turn),
            None => users.push_back((user, VecDeque::from([turn]))),
        }
    }

    /// Whether [`Self::next`] has a command.
    pub(super) fn has_next(&self) -> bool {
        CommandKind::ALL.into_iter().any(|kind| self.may_go(kind))
    }

    fn may_go(&self, kind: CommandKind) -> bool {
        let lane = &self.lanes[kind as usize];
        !lane.users.is_empty() && lane.handed < kind.at_once()
    }

    /// The next command for the bus thread. The command counts as the bus thread's until [`Self::over`].
    pub(super) fn next(&mut self) -> Option<Turn> {
        let kind = CommandKind::ALL.into_iter().find(|kind| self.may_go(*kind))?;
        let lane = &mut self.lanes[kind as usize];
        let (user, mut turns) = lane.users.pop_front()?;
        let turn = turns.pop_front()?;
        if !turns.is_empty() {
            lane.users.push_back((user, turns));
        }
        lane.handed += 1;
        self.handed.insert(turn.ticket, kind);
        Some(turn)
    }

    /// The bus thread has answered the command, or did not get it. Until then the command counts, even if the server
    /// has told the caller that the answer is late: so the bus thread never has more commands than it has room for.
    pub(super) fn over(&mut self, ticket: Ticket) {
        if let Some(kind) = self.handed.remove(&ticket) {
            self.lanes[kind as usize].handed -= 1;
        }
    }

    /// Commands that wait, and those that the bus thread has.
    pub(super) fn count(&self) -> usize {
        let waiting = self.lanes.iter().flat_map(|lane| &lane.users).map(|(_, turns)| turns.len());
        waiting.sum::<usize>() + self.handed.len()
    }

    /// Every waiting line that does not end a sequence, and every waiting request of the panel.
    pub(super) fn droppable(&self) -> Vec<Ticket> {
        let users = [CommandKind::Line, CommandKind::Panel]
            .into_iter()
            .flat_map(|kind| &self.lanes[kind as usize].users);
        let goes = |turn: &&Turn| match &turn.command {
            Command::Send { origin, .. } => !origin.stays,
            Command::Job { job, .. } => matches!(**job, Job::Panel(_)),
            _ => true,
        };
        users.flat_map(|(_, turns)| turns).filter(goes).map(|turn| turn.ticket).collect()
    }

    /// Whether a command waits, so that the daemon has sent nothing of it.
    pub(super) fn waits(&self, ticket: Ticket) -> bool {
        let users = self.lanes.iter().flat_map(|lane| &lane.users);
        users.flat_map(|(_, turns)| turns).any(|turn| turn.ticket == ticket)
    }

    /// Takes a command back; nothing if it does not wait (any more).
    pub(super) fn take_back(&mut self, ticket: Ticket) -> Option<Turn> {
        let mut found = None;
        for lane in &mut self.lanes {
            lane.users.retain_mut(|(_, turns)| {
                if let Some(index) = turns.iter().position(|turn| turn.ticket == ticket) {
                    found = turns.remove(index);
                }
                !turns.is_empty()
            });
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::HostOffset;
    use std::time::Instant;

    fn control(ticket: u64, letter: u8) -> Turn {
        let ticket = Ticket(ticket);
        let command = Command::Control {
            ticket,
            uid: 0,
            drops_lines: false,
            character: letter - 64,
            deadline: Instant::now(),
        };
        Turn { ticket, command, audit: None }
    }

    fn read(ticket: u64) -> Turn {
        let ticket = Ticket(ticket);
        let command = Command::ReadWords { ticket, first: HostOffset::new(0), count: 1 };
        Turn { ticket, command, audit: None }
    }

    fn next(turns: &mut FairQueue) -> Option<u64> {
        assert_eq!(turns.has_next(), CommandKind::ALL.into_iter().any(|kind| turns.may_go(kind)));
        turns.next().map(|turn| turn.ticket.0)
    }

    #[test]
    fn users_take_turns_and_each_ones_commands_keep_their_order() {
        let (many, few) = (Uid::from_raw(1), Uid::from_raw(2));
        let mut turns = FairQueue::default();
        for ticket in 0..60 {
            turns.wait(many, read(ticket));
        }
        for ticket in [100, 101] {
            turns.wait(few, read(ticket));
        }
        let at_once: Vec<u64> = std::iter::from_fn(|| next(&mut turns)).collect();
        assert_eq!(at_once, [0, 100, 1, 101, 2, 3, 4, 5]);
        assert!(!turns.has_next());
        turns.wait(few, read(102));
        turns.over(Ticket(0));
        turns.over(Ticket(0));
        turns.over(Ticket(77));
        assert_eq!(next(&mut turns), Some(6), "only one has room");
        assert_eq!(next(&mut turns), None);
        turns.over(Ticket(3));
        assert_eq!(next(&mut turns), Some(102));
    }

    #[test]
    fn one_kind_does_not_wait_for_another() {
        let user = Uid::from_raw(1);
        let mut turns = FairQueue::default();
        for ticket in 0..20 {
            turns.wait(user, read(ticket));
        }
        while next(&mut turns).is_some() {}
        turns.wait(user, control(99, b'K'));
        assert_eq!(next(&mut turns), Some(99));
    }

    #[test]
    fn what_stops_a_machine_does_not_wait_behind_a_character_with_an_answer() {
        let user = Uid::from_raw(1);
        let mut turns = FairQueue::default();
        for ticket in 0..20 {
            turns.wait(user, control(ticket, b'F'));
        }
        while next(&mut turns).is_some() {}
        turns.wait(user, control(98, b'A'));
        turns.wait(user, control(99, b'K'));
        assert_eq!((next(&mut turns), next(&mut turns)), (Some(98), Some(99)));
    }

    #[test]
    fn what_is_taken_back_is_not_handed_over() {
        let user = Uid::from_raw(1);
        let mut turns = FairQueue::default();
        turns.wait(user, read(1));
        turns.wait(user, read(2));
        assert!(turns.take_back(Ticket(1)).is_some() && turns.take_back(Ticket(1)).is_none());
        assert_eq!(next(&mut turns), Some(2));
        assert!(turns.take_back(Ticket(2)).is_none(), "the bus thread has it");
        assert_eq!(next(&mut turns), None);
    }
}
