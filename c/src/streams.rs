//! What a connection of its own does: the texts of the board's programs, and held jogs.

use std::time::Duration;

use driver::client::{CommandError, HeldJog, Messages as Stream};
use driver::protocol::{Message as Told, MessageKind};

use crate::board::Board;
use crate::failure::{Failure, Status};
use crate::per_process::Owned;
use crate::types::{Message, chars};

/// The texts that the board's programs send.
pub struct Messages(Owned<Stream>);

impl Messages {
    /// The texts from now on.
    pub fn new(board: &Board) -> Result<Self, Failure> {
        Ok(Self(Owned::new(board.connect()?.messages()?)))
    }

    /// The next text; `None` after `timeout`.
    pub fn next(&self, timeout: Duration) -> Result<Option<Message>, Failure> {
        let mut stream = self.0.lock()?;
        if stream.ended() {
            return Err(Failure::new(Status::Gone, "the stream of messages has ended; open another one"));
        }
        let message = |told: Told| Message {
            time_ns: told.time_ns,
            lost: told.lost,
            kind: match told.kind {
                MessageKind::Cmd => 1,
                MessageKind::Send => 2,
                MessageKind::Error => 3,
            },
            reserved: 0,
            text: chars(&told.text),
        };
        Ok(stream.next_within(timeout)?.map(message))
    }
}

/// A jog that lasts as long as its handle.
pub struct Jog {
    motor: u8,
    held: Owned<Option<HeldJog>>,
}

impl Jog {
    /// Jogs `motor`; `direction` is positive or negative.
    pub fn new(board: &Board, motor: u8, direction: i32) -> Result<Self, Failure> {
        let action = match direction.signum() {
            1 => "jog+",
            -1 => "jog-",
            _ => return Err(Failure::argument("direction 0 is none; pass 1 or -1")),
        };
        let held = HeldJog::begin(board.connect()?, action, &[motor])?;
        Ok(Self { motor, held: Owned::new(Some(held)) })
    }

    /// Whether the motor is still held; false when the daemon has stopped it.
    pub fn is_held(&self) -> Result<bool, Failure> {
        Ok(self.held.lock()?.as_ref().is_some_and(HeldJog::is_held))
    }

    /// Stops the motor, and returns when the board has taken the stop.
    pub fn stop(&self) -> Result<(), Failure> {
        let held = self.held.lock()?.take();
        let Some(held) = held else { return Ok(()) };
        held.stop().map(drop).map_err(|error| self.not_stopped(error))
    }

    /// Without `pmacd` nobody stops the motor: the error must say so, and not only that the stop failed.
    fn not_stopped(&self, error: CommandError) -> Failure {
        match HeldJog::may_be_moving(self.motor, &error) {
            Some(text) => Failure { status: Status::StopFailed, ..Failure::from(error).saying(text) },
            None => error.into(),
        }
    }
}
