//! Data gathering, as far as it needs no board (layer 1): what can be gathered, the lines that make a board gather it, and
//! what the samples say (DPRAM manual p. 25-26).
//!
//! A sample is the chosen sources' values in the order of I21 to I44, each one long (`Y:`, `X:`) or two (`D:`, `L:`,
//! Y half first). [`Source`] names one, [`plan()`] makes the columns, [`gather_lines`] the lines, [`Column`] turns longs into numbers,
//! [`fields`] is the table of them. Reading the samples from the DPRAM is [`crate::function`]'s part.

pub mod column;
pub mod plan;
pub mod reading;
pub mod source;

pub use column::{Column, SampleClock, fields};
pub use plan::{GatherMode, GatherPlan, GatherRequest, MOST_PERIOD, PlanError, gather_lines, plan};
pub use reading::Reading;
pub use source::{Source, SourceError};
