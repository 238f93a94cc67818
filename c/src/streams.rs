//! What a connection of its own does: the texts of the board's programs, and held jogs.

use std::mem;
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
    state: Owned<State>,
}

/// How a jog stands.
enum State {
    /// The library renews the jog.
    Held(HeldJog),
    /// How its stop ended. Every later stop tells the same.
    Over(Result<(), Failure>),
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
        Ok(Self { motor, state: Owned::new(State::Held(held)) })
    }

    /// Whether the motor is still held; false when the daemon has stopped it.
    pub fn is_held(&self) -> Result<bool, Failure> {
        Ok(matches!(&*self.state.lock()?, State::Held(held) if held.is_held()))
    }

    /// Stops the motor, and returns when the board has taken the stop.
    pub fn stop(&self) -> Result<(), Failure> {
        // The lock lasts through the stop: another thread that stops this jog waits, and hears how the stop ended.
        let mut state = self.state.lock()?;
        let fault = format!("motor {} may be moving: this library has a fault in its stop", self.motor);
        let if_it_panics = State::Over(Err(Failure::new(Status::StopFailed, fault)));
        let ended = match mem::replace(&mut *state, if_it_panics) {
            State::Held(held) => held.stop().map(drop).map_err(|error| self.not_stopped(error)),
            State::Over(ended) => ended,
        };
        *state = State::Over(ended.clone());
        ended
    }

    /// Without `pmacd` nobody stops the motor: the error must say so, and not only that the stop failed.
    fn not_stopped(&self, error: CommandError) -> Failure {
        match HeldJog::may_be_moving(self.motor, &error) {
            Some(text) => Failure { status: Status::StopFailed, ..Failure::from(error).saying(text) },
            None => error.into(),
        }
    }
}
