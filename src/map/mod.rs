//! What lies where (layer 1): addresses, register tables per board family, status bits.
//!
//! Only this module knows an address. [`classic`] names every one of PMAC(1) and PMAC2; [`Family`] is all that
//! distinguishes a board family, [`Layout`] its register table as a board with a given firmware has it, and
//! [`Location`] an address as a person types it.

pub mod address;
pub mod classic;
mod classic_table;
pub mod errors;
pub mod family;
pub mod field;
pub mod firmware;
pub mod layout;
pub mod mailbox;
pub mod plan;
pub mod region;
pub mod register;
pub mod selection;
pub mod status;
pub mod typed;

/// The axes in the order in which the fixed buffers hold them.
pub const AXES: [&str; 9] = ["A", "B", "C", "U", "V", "W", "X", "Y", "Z"];

pub use address::{HostOffset, PmacAddress, Space};
pub use classic_table::PANEL_REQUEST_BITS;
pub use family::{FAMILIES, Family, GatherPlace, PMAC, PMAC2, UnknownFamily};
pub use field::{BitField, Field, FieldError};
pub use firmware::{BadFirmware, Firmware};
pub use layout::{Entry, GatherPosition, GatherSizeWord, Layout, MapRecord, Place, records};
pub use plan::{NotOpen, Owner, Plan, PlanError, PlanSettings};
pub use region::Region;
pub use register::{Bits, Block, Format, NumberKind, Register, Source, SourceAt, Width, Writer};
pub use selection::{BlockField, Selection, block_fields};
pub use status::{MotionMode, StatusTable, StatusTables, TargetSource};
pub use typed::{AddressError, Location};
