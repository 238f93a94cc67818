//! A program that the board has taken whole.

use pmac_dpram::client::Streamed as Program;
use pyo3::prelude::*;

/// A program that the board has taken whole.
#[pyclass(frozen, module = "pmac_dpram")]
pub struct Streamed(pub Program);

#[pymethods]
impl Streamed {
    /// Lines.
    #[getter]
    fn lines(&self) -> usize {
        self.0.lines
    }

    /// Commands in them.
    #[getter]
    fn commands(&self) -> usize {
        self.0.commands
    }

    /// How often the daemon found the buffer empty though more lines were to follow.
    #[getter]
    fn underruns(&self) -> u64 {
        self.0.underruns
    }

    /// Lines that an earlier program had left in the board's rotary buffer.
    #[getter]
    fn found_lines(&self) -> u64 {
        self.0.found_lines
    }

    /// How the board's program differs from the text, one sentence each.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.0.warnings.clone()
    }

    fn __repr__(&self) -> String {
        format!("<Streamed {} lines, {} underruns>", self.0.lines, self.0.underruns)
    }
}
