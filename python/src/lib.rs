//! `pmac_dpram._native`: the Rust client for Python. Users import `python/pmac_dpram`.

mod board;
mod columns;
mod data;
mod errors;
mod gather;
mod identity;
mod per_process;
mod rotary;
mod updates;

use pyo3::prelude::*;

/// The native part of `pmac_dpram`.
#[pymodule(gil_used = false)]
mod _native {
    #[pymodule_export]
    use crate::board::{Board, Jog};
    #[pymodule_export]
    use crate::columns::Columns;
    #[pymodule_export]
    use crate::data::{Motor, Motors, Snapshot, Status, System, Systems};
    #[pymodule_export]
    use crate::gather::Gathered;
    #[pymodule_export]
    use crate::identity::Identity;
    #[pymodule_export]
    use crate::rotary::Streamed;
    #[pymodule_export]
    use crate::updates::Updates;
}
