//! What grows: one kind of load, started.

use super::running::Running;
use super::{clients, readers, variables};
use crate::rig::Rig;

/// One kind of load, and how much of it.
#[derive(Clone, Copy)]
pub enum Load {
    Readers(usize),
    WokenReaders(usize),
    Clients(usize),
    Variables(usize),
    /// Nothing beside the board's own motors.
    Motors(usize),
}

impl Load {
    pub fn count(&self) -> usize {
        let (Self::Readers(count)
        | Self::WokenReaders(count)
        | Self::Clients(count)
        | Self::Variables(count)
        | Self::Motors(count)) = *self;
        count
    }

    pub fn start(&self, rig: &Rig) -> Running {
        match *self {
            Self::Readers(count) => readers::look(rig, count),
            Self::WokenReaders(count) => readers::follow(rig, count),
            Self::Clients(count) => clients::send(rig, count),
            Self::Variables(count) => variables::watch(rig, count),
            Self::Motors(_) => Running::new(0),
        }
    }
}
