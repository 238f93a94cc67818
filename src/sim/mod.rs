//! (under construction)

/// placeholder
pub const STARTUP: &str = "";
