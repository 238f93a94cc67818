//! Data gathering without a board (layer 1): the sources, the lines that make a board gather, and the meaning of the
//! samples (DPRAM manual p. 25-26).
//!
//! A sample is the values of the chosen sources in the order of I21 to I44, each one long (`Y:`, `X:`) or two (`D:`,
//! `L:`, Y half first). [`Source`] names one, [`plan()`] makes the columns, [`gather_lines`] the lines, [`Column`]
//! turns longs into numbers, [`fields`] is their table. [`crate::function`] reads the samples from the DPRAM.

pub mod column;
pub mod plan;
pub mod reading;
pub mod source;

pub use column::{Column, SampleClock, fields};
pub use plan::{GatherMode, GatherPlan, GatherRequest, MOST_PERIOD, PlanError, gather_lines, plan};
pub use reading::Reading;
pub use source::{Source, SourceError};
