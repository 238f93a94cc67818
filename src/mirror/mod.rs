//! When to read which words, and their way into the segment (layer 4).
//!
//! Each region has its own file: it knows when its next poll is due, does one bounded poll at a time, and tells when
//! its data begin to come and when they stop. The mirror keeps the board's words unchanged and decodes nothing.

pub mod background;
pub mod clock;
pub mod continuity;
pub mod freshness;
pub mod gaps;
pub mod gather;
pub mod servo;
pub mod user_words;
pub mod variable;

pub use background::BackgroundMirror;
pub use freshness::Transition;
pub use gather::{GatherClock, GatherMirror, NotFollowed};
pub use servo::ServoMirror;
pub use user_words::{UserMirror, UserRate};
pub use variable::VariableMirror;
