//! Samples that the board gathers at servo rate.

use pmac_dpram::client::Gathered as Samples;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::errors::refused;

/// The samples of a gather.
#[pyclass(frozen, module = "pmac_dpram")]
pub struct Gathered(pub Samples);

#[pymethods]
impl Gathered {
    /// The columns' titles: the source, and its unit in brackets.
    #[getter]
    fn columns(&self) -> Vec<String> {
        self.0.columns.clone()
    }

    /// The samples as 64-bit floats of this machine, row by row: `np.frombuffer(data).reshape(-1, len(columns))`.
    #[getter]
    fn data<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        let bytes: Vec<u8> = self.0.values.iter().flat_map(|value| value.to_ne_bytes()).collect();
        PyBytes::new(py, &bytes)
    }

    /// One column's values.
    fn column(&self, index: usize) -> PyResult<Vec<f64>> {
        let Samples { columns, values, .. } = &self.0;
        if index >= columns.len() {
            return Err(refused(&format!("there is no column {index}; there are {}", columns.len())));
        }
        Ok(values.iter().skip(index).step_by(columns.len()).copied().collect())
    }

    /// When the board made each sample: seconds since the first.
    #[getter]
    fn times(&self) -> Vec<f64> {
        self.0.times()
    }

    /// Samples that the board or the daemon overwrote before this program read them. Exact.
    #[getter]
    fn lost(&self) -> u64 {
        self.0.lost()
    }

    fn __len__(&self) -> usize {
        self.0.numbers.len()
    }

    fn __repr__(&self) -> String {
        format!("<Gathered {} samples of {}>", self.0.numbers.len(), self.0.columns.join(", "))
    }
}
