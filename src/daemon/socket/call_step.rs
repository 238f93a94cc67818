//! The steps of a call that waits for the board. Each step owns the values that the call needs to go on.

use std::time::Instant;

use super::first_start::FirstStart;
use super::jobs::{JobAt, JobCall};
use super::jog_to::JogTo;
use crate::daemon::motion::effect::LineEffect;
use crate::function::variable_read::VariableEntry;

/// The event that a call waits for.
#[derive(Debug)]
pub(super) enum CallStep {
    /// The lines of the board's reply, for the caller. A command line has this effect.
    Reply(LineEffect),
    /// A job, or the board's answer to a question about it.
    Job(Box<JobCall>),
    /// The board's answer which motor is addressed, or the line that jogs.
    JogTo(JogTo),
    /// The board's answer about the lines in a rotary buffer that this start would run.
    Start(Box<FirstStart>),
    /// The board's answer whether it copies registers, before a watch of these.
    Watch(Vec<VariableEntry>),
    /// The board's servo counter, for which it was asked at this moment: the caller hears how many resets were found.
    Resets(Instant),
}

/// What a command is to the call for whose sake it is sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CommandPart {
    /// What the caller asked for.
    Deed,
    /// The jog that the caller holds.
    Hold,
    /// A question of the daemon's own, before something begins.
    Before,
    /// A question of the daemon's own about what is done, or refused, already.
    Behind,
    /// A question of the daemon's own with which nothing begins.
    Look,
}

impl CommandPart {
    /// Whether the daemon asks the board by itself, for the call's sake.
    pub(super) const fn is_own_question(self) -> bool {
        matches!(self, Self::Before | Self::Behind | Self::Look)
    }
}

impl CallStep {
    /// What the command under way is to the call.
    pub(super) const fn part(&self) -> CommandPart {
        match self {
            Self::Reply(_) => CommandPart::Deed,
            Self::Job(call) => match call.at {
                JobAt::Wanted(_) => CommandPart::Before,
                JobAt::UnderWay if call.lease.is_some() => CommandPart::Hold,
                JobAt::UnderWay => CommandPart::Deed,
                JobAt::Done | JobAt::Failed(_) => CommandPart::Behind,
            },
            Self::JogTo(jog) if jog.addressed.is_some() => CommandPart::Deed,
            Self::JogTo(_) | Self::Start(_) => CommandPart::Before,
            Self::Watch(_) | Self::Resets(_) => CommandPart::Look,
        }
    }
}
