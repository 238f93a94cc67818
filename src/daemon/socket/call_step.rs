//! The steps of a call that waits for the board. Each step owns the values that the call needs to go on.

use std::time::Instant;

use super::first_start::FirstStart;
use super::jobs::{JobAt, JobCall};
use super::order::Order;
use crate::daemon::motion::effect::LineEffect;
use crate::function::variable_read::VariableEntry;

/// The event that a call waits for.
#[derive(Debug)]
pub(super) enum CallStep {
    /// The lines of the board's reply, for the caller. A command line has this effect.
    Reply(LineEffect),
    /// A job, or the board's answer to a question about it.
    Job(Box<JobCall>),
    /// The board's answer to the question before an order's line.
    Order(Order),
    /// The line of an order, with this effect.
    Ordered(LineEffect),
    /// The board's answer about the lines in a rotary buffer that this start would run.
    Start(Box<FirstStart>),
    /// The board's answer whether it copies registers, before a client watches these.
    Watch(Vec<VariableEntry>),
    /// The board's servo counter, which the daemon asked for at this moment: the caller hears how many resets the
    /// daemon has found.
    Resets(Instant),
}

/// A command's part in its call.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CommandPart {
    /// The caller's request.
    Deed,
    /// The jog that the caller holds.
    Hold,
    /// The daemon's own question, before the call begins anything.
    Before,
    /// The daemon's own question, after the daemon has done or refused the request.
    Behind,
    /// The daemon's own question, in a call that begins nothing.
    Look,
}

impl CommandPart {
    /// Whether the daemon asks the board by itself, for the call's sake.
    pub(super) const fn is_own_question(self) -> bool {
        matches!(self, Self::Before | Self::Behind | Self::Look)
    }
}

impl CallStep {
    /// The part of the command under way in its call.
    pub(super) const fn part(&self) -> CommandPart {
        match self {
            Self::Reply(_) | Self::Ordered(_) => CommandPart::Deed,
            Self::Job(call) => match call.at {
                JobAt::Wanted(_) => CommandPart::Before,
                JobAt::UnderWay if call.lease.is_some() => CommandPart::Hold,
                JobAt::UnderWay => CommandPart::Deed,
                JobAt::Done | JobAt::Failed(_) => CommandPart::Behind,
            },
            Self::Order(_) | Self::Start(_) => CommandPart::Before,
            Self::Watch(_) | Self::Resets(_) => CommandPart::Look,
        }
    }
}
