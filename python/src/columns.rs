//! Updates as one buffer for NumPy, without an object for each.

use pmac_dpram::client::View;
use pmac_dpram::decode::{Quantity, ServoData, ServoMotor};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::errors::refused;

/// The content of a column: 8 bytes of each update.
enum Column {
    /// A whole number of the update itself.
    Whole(fn(&View<ServoData>) -> i64),
    /// A number of the motor; NaN if the board does not report it, or its scale is not known.
    Motor(usize, fn(&ServoMotor) -> Option<Quantity>),
}

impl Column {
    /// The column called `name`: `servo_timer`, `1.position`.
    fn parse(name: &str) -> Option<Self> {
        let whole: fn(&View<ServoData>) -> i64 = match name {
            "sequence" => |update| update.sequence as i64,
            "time_ns" => |update| update.time_ns as i64,
            "realtime_ns" => |update| update.realtime_ns,
            "servo_timer" => |update| update.servo_timer as i64,
            _ => return Self::of_motor(name),
        };
        Some(Self::Whole(whole))
    }

    fn of_motor(name: &str) -> Option<Self> {
        let (number, quantity) = name.split_once('.')?;
        let quantity: fn(&ServoMotor) -> Option<Quantity> = match quantity {
            "position" => |motor| motor.actual_position,
            "commanded_position" => |motor| motor.commanded_position,
            "following_error" => |motor| motor.following_error,
            "velocity" => |motor| motor.velocity,
            "master_position" => |motor| motor.master_position,
            _ => return None,
        };
        Some(Self::Motor(number.parse().ok().filter(|number| *number > 0)?, quantity))
    }

    /// Its type, as NumPy writes it.
    const fn kind(&self) -> &'static str {
        match self {
            Self::Whole(_) => "=i8",
            Self::Motor(..) => "=f8",
        }
    }

    fn bytes(&self, update: &View<ServoData>) -> [u8; 8] {
        match self {
            Self::Whole(of) => of(update).to_ne_bytes(),
            Self::Motor(number, of) => {
                let motor = update.data.motors.iter().find(|motor| motor.motor == *number);
                motor.and_then(of).and_then(|found| found.value).unwrap_or(f64::NAN).to_ne_bytes()
            }
        }
    }
}

/// Updates as rows of columns, for `numpy.frombuffer(data, dtype)`.
#[pyclass(frozen, module = "pmac_dpram")]
pub struct Columns {
    names: Vec<String>,
    columns: Vec<Column>,
    rows: usize,
    data: Vec<u8>,
    lost: u64,
}

impl Columns {
    /// No rows yet. The columns have the names of the attributes of an update and of a motor.
    pub fn new(names: Vec<String>) -> PyResult<Self> {
        let parse = |name: &String| {
            let why = || {
                refused(&format!(
                    "there is no column {name:?}; there are sequence, time_ns, realtime_ns and servo_timer, and of motor 1 \
                     1.position, 1.commanded_position, 1.following_error, 1.velocity and 1.master_position"
                ))
            };
            Column::parse(name).ok_or_else(why)
        };
        let columns = names.iter().map(parse).collect::<PyResult<_>>()?;
        Ok(Self { names, columns, rows: 0, data: Vec::new(), lost: 0 })
    }

    /// One more row.
    pub fn push(&mut self, update: &View<ServoData>) {
        self.rows += 1;
        self.data.extend(self.columns.iter().flat_map(|column| column.bytes(update)));
    }

    /// Counts `lost` more updates that the daemon overwrote before this program took them.
    pub fn lose(&mut self, lost: u64) {
        self.lost += lost;
    }
}

#[pymethods]
impl Columns {
    /// Name and type of each column.
    #[getter]
    fn dtype(&self) -> Vec<(String, &'static str)> {
        self.names.iter().cloned().zip(self.columns.iter().map(Column::kind)).collect()
    }

    /// The rows, one behind the other.
    #[getter]
    fn data<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.data)
    }

    /// Updates that the daemon overwrote before this program took them: between the rows, and before the first. Exact.
    #[getter]
    fn lost(&self) -> u64 {
        self.lost
    }

    fn __len__(&self) -> usize {
        self.rows
    }

    fn __repr__(&self) -> String {
        format!("<Columns {} updates of {}>", self.rows, self.names.join(", "))
    }
}
