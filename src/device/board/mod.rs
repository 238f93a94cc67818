//! The kinds of boards, one file each, and the `--board` specification.

pub mod byte;
pub mod byte_spec;
mod exclusive_lock;
pub mod file;
mod mapped;
pub mod memory;
pub mod open;
pub mod pci;
pub mod replay;
pub mod spec;
pub mod vme;
pub mod vme_card;
pub mod window;
