//! What a sample of each region carries: one file a region, with its offsets, its encoder and its decoder.
//!
//! | region | file | payload |
//! |---|---|---|
//! | servo, background, panel | [`blocks`] | the board's 16-bit words as they were; where each number's block lies |
//! | board | [`identity`] | who the board is |
//! | variable | [`variable`] | registers of the user's choice |
//! | gather | [`gather`] | gathered samples |

pub mod blocks;
pub mod gather;
pub mod identity;
pub mod variable;
