//! What lies where (layer 1): addresses, register tables per board family, status bits.

pub mod address;
pub mod classic;
pub mod region;

pub use address::{HostOffset, PmacAddress, Space};
pub use region::Region;
