//! Motion: who has set what in motion, what a stop stops, and what programs would run. It sends nothing: the command socket does.
//!
//! | place | what is in it |
//! |---|---|
//! | [`ledger`], [`hold_end`] | a row for each command that motors obey: whose it is, until when, seen moving or not; why a hold is over |
//! | [`stops`], [`target`] | a row for each stop under way, and how far it is; what it stops, and its command line |
//! | [`effect`] | what a command does to motion |
//! | [`sent_stops`] | the last commands that have ended something, for those whom that concerns |
//! | [`leftovers`] | a row for each coordinate system: lines left in its rotary buffer |
//! | [`resets`] | how often the board was reset |
//! | [`timing`] | how long all of this may take |
//!
//! [`sent_stops`] is history, not state: nothing is decided by it. [`leftovers`] is about buffers, which stay when every motor
//! stands. [`resets`] is about the board as a whole; a reset ends both. So they stand beside the ledger.

pub mod effect;
pub mod hold_end;
pub mod ledger;
pub mod leftovers;
pub mod resets;
pub mod sent_stops;
pub mod stops;
pub mod target;
pub mod timing;
