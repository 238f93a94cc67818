//! A user's access to a board (layer 5): live data from the shared memory, commands through the socket.
//!
//! ```no_run
//! use std::time::Duration;
//! use pmac_dpram::client::Board;
//!
//! let mut board = Board::attach("pmac0")?;
//! let servo = board.snapshot()?.servo.ok_or("the board has sent no servo data yet")?;
//! for motor in &servo.data.motors {
//!     println!("#{} {:?} fresh: {}", motor.motor, motor.actual_position, servo.is_fresh());
//! }
//! println!("{:?}", board.send("#1P", Duration::from_secs(1))?);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Reading needs no exchange with the daemon and cannot disturb it. Old data say that they are old: see [`Staleness`].

pub mod board;
pub mod circles;
pub mod command;
mod decoder;
pub mod follow;
pub mod gather_all;
pub mod hold;
pub mod identity;
pub mod motor;
pub mod number;
pub mod own_buffer;
pub mod rotary_feed;
#[cfg(feature = "serial")]
pub mod serial;
#[cfg(feature = "serial")]
pub mod serial_reply;
pub mod shown_flags;
pub mod stream_all;
pub mod updates;
pub mod view;

pub use board::gather::{GatherChunk, GatherFollower, GatherPhase, GatherRun, Taken};
pub use board::user::{UserData, UserValues};
pub use board::variables::{Variable, VariableTable};
pub use board::{Board, ClientError, History, Snapshot, socket_path};
pub use command::rotary::{RotaryLine, RotaryPlace};
pub use command::variables::VariableWatch;
pub use command::{CommandError, Connection, Messages};
pub use follow::{Follower, Gap, Step};
pub use gather_all::{Gathered, gather_all};
pub use hold::HeldJog;
pub use motor::Motor;
pub use own_buffer::OwnBuffer;
pub use rotary_feed::RotaryFeed;
#[cfg(feature = "serial")]
pub use serial::{SerialError, SerialLine};
pub use stream_all::{StreamError, StreamOptions, Streamed, stream_all};
pub use updates::{Update, Updates};
pub use view::{Staleness, View};
