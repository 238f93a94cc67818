//! What lies where (layer 1): addresses, register tables per board family, status bits.

pub mod address;

pub use address::{HostOffset, PmacAddress, Space};
