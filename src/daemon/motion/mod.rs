//! Motion: which client has set which motors in motion, which motors a stop stops, and which lines a start would run.
//! This module sends nothing; the command socket sends.
//!
//! | place | what is in it |
//! |---|---|
//! | [`ledger`], [`hold_end`] | a row for each command that motors obey: its client, its end, its motors seen moving; why a hold is over |
//! | [`stops`], [`target`] | a row for each stop under way, with its step; the stop's target, and its command line |
//! | [`effect`] | a command's effect on motion |
//! | [`sent_stops`] | the last commands that have ended programs, motions or a gather, for the clients concerned |
//! | [`leftovers`] | a row for each coordinate system: lines left in its rotary buffer |
//! | [`resets`] | how often the board was reset |
//! | [`timing`] | the limits in time of motions and stops |
//!
//! [`sent_stops`] is history, not state: the daemon decides nothing by it. [`leftovers`] is about buffers, which
//! outlast all motion. [`resets`] is about the board as a whole; a reset ends motions and buffers. So these modules
//! stand beside the ledger.

pub mod effect;
pub mod hold_end;
pub mod ledger;
pub mod leftovers;
pub mod resets;
pub mod sent_stops;
pub mod stops;
pub mod target;
pub mod timing;
