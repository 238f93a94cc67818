//! The payload of each region: one file each, with offsets, encoder and decoder.
//!
//! | region | file | payload |
//! |---|---|---|
//! | servo, background, panel | [`blocks`] | the board's 16-bit words unchanged; the place of each block |
//! | board | [`identity`] | the board's identity |
//! | variable | [`variable`] | registers of the users' choice |
//! | gather | [`gather`] | gathered samples |
//! | user, user table | [`user`] | the site's own words, and their names |

pub mod blocks;
pub mod gather;
pub mod identity;
pub mod user;
pub mod variable;
