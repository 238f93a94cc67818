//! The steps of a call that waits for the board. Each step owns the values that the call needs to go on.

use std::time::Instant;

use super::first_start::FirstStart;
use super::jobs::{JobAt, JobCall};
use super::order::{ADDRESS_MAX, Order};
use crate::daemon::motion::effect::LineEffect;
use crate::daemon::shared::job::Job;
use crate::format::Text;
use crate::function::variable_read::VariableEntry;
use crate::protocol::CallError;

/// The event that a call waits for.
#[derive(Debug)]
pub(super) enum CallStep {
    /// The lines of the board's reply, for the caller. A command line has this effect.
    Reply(LineEffect),
    /// A job, or the board's answer to a question about it.
    Job(Box<JobCall>),
    /// The board's answer to the question before an order's line. `is_old`: another line has changed the address since.
    Order { order: Order, is_old: bool },
    /// The line of an order, with this effect; `back` puts the address back if the board refuses the line.
    Ordered { effect: LineEffect, back: Text<ADDRESS_MAX> },
    /// The line that puts the address back, after the board has refused an order's line with this error.
    PutBack(Box<CallError>),
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
            Self::Reply(_) | Self::Ordered { .. } => CommandPart::Deed,
            Self::PutBack(_) => CommandPart::Behind,
            Self::Job(call) => match call.at {
                JobAt::Wanted(_) => CommandPart::Before,
                JobAt::UnderWay if call.lease.is_some() => CommandPart::Hold,
                JobAt::UnderWay => CommandPart::Deed,
                JobAt::Done | JobAt::Failed(_) => CommandPart::Behind,
            },
            Self::Order { .. } | Self::Start(_) => CommandPart::Before,
            Self::Watch(_) | Self::Resets(_) => CommandPart::Look,
        }
    }

    /// Whether the call may start a motion, and the command for that is not under way yet, or still waits here.
    pub(super) const fn starts(&self, is_handed: bool) -> bool {
        match self {
            Self::Order { .. } | Self::Start(_) => true,
            Self::Job(call) => !call.stops && matches!(call.at, JobAt::Wanted(Job::Panel(_))),
            Self::Ordered { .. } => !is_handed,
            _ => false,
        }
    }
}
