//! Data of one moment: a snapshot or an update, with motors and coordinate systems by their numbers.

use std::sync::Arc;

use pmac_dpram::client::{Gap, Snapshot as Found, UserData, UserValues, View};
use pmac_dpram::decode::{
    BackgroundData, BackgroundMotor, CoordinateSystem, Flags, Quantity, ServoData, ServoMotor, Value,
};
use pmac_dpram::map::FAMILIES;
use pmac_dpram::map::status::StatusTable;
use pyo3::IntoPyObjectExt;
use pyo3::exceptions::{PyAttributeError, PyKeyError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// The board's reports at one moment. The servo report is always there; the values of a missing background report are
/// `None`.
#[derive(Debug)]
struct Moment {
    servo: View<ServoData>,
    background: Option<View<BackgroundData>>,
    user: Option<View<UserData>>,
    /// The missing updates between the one before and this one.
    gap: Option<Gap>,
}

impl Moment {
    fn motor(&self, number: usize) -> Option<&ServoMotor> {
        self.servo.data.motors.iter().find(|motor| motor.motor == number)
    }

    /// The numbers of the motors that are activated.
    fn activated(&self) -> impl Iterator<Item = usize> {
        self.servo.data.motors.iter().filter(|motor| motor.is_activated()).map(|motor| motor.motor)
    }

    fn system(&self, number: usize) -> Option<&CoordinateSystem> {
        let data = &self.background.as_ref()?.data;
        data.coordinate_systems.iter().find(|system| system.coordinate_system == number)
    }
}

/// The board's data at one moment.
#[pyclass(frozen, module = "pmac_dpram")]
#[derive(Debug)]
pub struct Snapshot(Arc<Moment>);

impl Snapshot {
    /// The data in `found`; `None` before the first servo update. Leaves out old background data, unless `stale_ok`.
    pub fn of(found: Found, stale_ok: bool) -> Option<Self> {
        let Found { servo, background, user, .. } = found;
        let background = background.filter(|view| stale_ok || view.stale.is_none());
        let user = user.filter(|view| stale_ok || view.stale.is_none());
        Some(Self(Arc::new(Moment { servo: servo?, background, user, gap: None })))
    }

    /// One servo update, behind `gap`.
    pub fn of_update(servo: View<ServoData>, gap: Option<Gap>) -> Self {
        Self(Arc::new(Moment { servo, background: None, user: None, gap }))
    }

    /// The servo report, and how many updates are lost before it.
    pub fn servo(&self) -> (&View<ServoData>, u64) {
        (&self.0.servo, self.0.gap.map_or(0, |gap| gap.lost))
    }

    /// Why the servo data are not live.
    pub fn servo_staleness(&self) -> Option<pmac_dpram::client::Staleness> {
        self.0.servo.stale
    }
}

#[pymethods]
impl Snapshot {
    /// The number of the servo update, from 1; it begins anew with each daemon.
    #[getter]
    fn sequence(&self) -> u64 {
        self.0.servo.sequence
    }

    /// When the daemon read the update: nanoseconds of `time.monotonic_ns()`.
    #[getter]
    fn time_ns(&self) -> u64 {
        self.0.servo.time_ns
    }

    /// The same in nanoseconds since 1970.
    #[getter]
    fn realtime_ns(&self) -> i64 {
        self.0.servo.realtime_ns
    }

    /// The board's servo counter at that update, in servo cycles.
    #[getter]
    fn servo_timer(&self) -> u64 {
        self.0.servo.servo_timer
    }

    /// In an update: how many updates are missing between the one before and this one, as (missed, lost), or `None`.
    /// (0, 0) is a pause: the board made no updates, or `pmacd` was started again.
    #[getter]
    fn gap(&self) -> Option<(u64, u64)> {
        self.0.gap.map(|gap| (gap.missed, gap.lost))
    }

    /// Why the data are not live, or `None`.
    #[getter]
    fn stale(&self) -> Option<String> {
        self.0.servo.stale.map(|why| why.to_string())
    }

    /// Why the background data are not live, or `None`.
    #[getter]
    fn background_stale(&self) -> Option<String> {
        self.0.background.as_ref()?.stale.map(|why| why.to_string())
    }

    /// The activated motors, by number; you can ask for any reported one.
    #[getter]
    fn motor(&self) -> Motors {
        Motors(Arc::clone(&self.0))
    }

    /// The reported coordinate systems, by number; none in an update.
    #[getter]
    fn system(&self) -> Systems {
        Systems(Arc::clone(&self.0))
    }

    /// The words of the site's own programs by name, each a number, or a list of numbers; `None` if a word was not
    /// whole. Empty if the configuration names none, or if they are old.
    #[getter]
    fn user<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let words = PyDict::new(py);
        for UserValues { word, values } in self.0.user.iter().flat_map(|view| &view.data.words) {
            let number = |value: &Value| match *value {
                Value::Word(value) => i64::from(value).into_bound_py_any(py),
                Value::Long(value) => i64::from(value).into_bound_py_any(py),
                Value::Fixed(value) => value.into_bound_py_any(py),
                Value::Float(value) => value.into_bound_py_any(py),
            };
            let values = values.as_ref().map(|all| all.iter().map(number).collect::<PyResult<Vec<_>>>());
            match values.transpose()? {
                Some(mut all) if word.count == 1 => words.set_item(&word.name[..], all.pop())?,
                values => words.set_item(&word.name[..], values)?,
            }
        }
        Ok(words)
    }

    fn __repr__(&self) -> String {
        let servo = &self.0.servo;
        let state = servo.stale.map_or("live".to_owned(), |why| format!("stale: {why}"));
        format!("<Snapshot {} of {} motors, {state}>", servo.sequence, self.0.activated().count())
    }
}

/// The activated motors of a snapshot, by number; you can ask for any reported one.
#[pyclass(frozen, module = "pmac_dpram")]
#[derive(Debug)]
pub struct Motors(Arc<Moment>);

#[pymethods]
impl Motors {
    fn __getitem__(&self, number: isize) -> PyResult<Motor> {
        match usize::try_from(number).ok().filter(|number| self.0.motor(*number).is_some()) {
            Some(number) => Ok(Motor { moment: Arc::clone(&self.0), number }),
            None => Err(PyKeyError::new_err(format!("motor {number} is not reported"))),
        }
    }

    fn __len__(&self) -> usize {
        self.keys().len()
    }

    fn __iter__(&self) -> Numbers {
        Numbers(self.keys().into_iter())
    }

    /// The numbers.
    fn keys(&self) -> Vec<usize> {
        self.0.activated().collect()
    }
}

/// The coordinate systems of a snapshot, by number.
#[pyclass(frozen, module = "pmac_dpram")]
#[derive(Debug)]
pub struct Systems(Arc<Moment>);

#[pymethods]
impl Systems {
    fn __getitem__(&self, number: isize) -> PyResult<System> {
        match usize::try_from(number).ok().filter(|number| self.0.system(*number).is_some()) {
            Some(number) => Ok(System { moment: Arc::clone(&self.0), number }),
            None => Err(PyKeyError::new_err(format!("coordinate system {number} is not reported"))),
        }
    }

    fn __len__(&self) -> usize {
        self.keys().len()
    }

    fn __iter__(&self) -> Numbers {
        Numbers(self.keys().into_iter())
    }

    /// The numbers.
    fn keys(&self) -> Vec<usize> {
        let systems = self.0.background.iter().flat_map(|view| &view.data.coordinate_systems);
        systems.map(|system| system.coordinate_system).collect()
    }
}

/// Numbers of motors or coordinate systems.
#[pyclass(module = "pmac_dpram")]
pub struct Numbers(std::vec::IntoIter<usize>);

#[pymethods]
impl Numbers {
    fn __iter__(numbers: PyRef<'_, Self>) -> PyRef<'_, Self> {
        numbers
    }

    fn __next__(&mut self) -> Option<usize> {
        self.0.next()
    }
}

/// One motor. Positions are in counts, velocities in counts a second; `None` if the board does not report the value,
/// or its scale is not known (yet).
#[pyclass(frozen, module = "pmac_dpram")]
#[derive(Debug)]
pub struct Motor {
    moment: Arc<Moment>,
    number: usize,
}

impl Motor {
    fn quantity(&self, of: fn(&ServoMotor) -> Option<Quantity>) -> Option<Quantity> {
        self.moment.motor(self.number).and_then(of)
    }

    fn value(&self, of: fn(&ServoMotor) -> Option<Quantity>) -> Option<f64> {
        self.quantity(of)?.value
    }

    fn background(&self) -> Option<&BackgroundMotor> {
        let data = &self.moment.background.as_ref()?.data;
        data.motors.iter().find(|motor| motor.motor == self.number)
    }
}

#[pymethods]
impl Motor {
    /// Its number, from 1.
    #[getter]
    fn number(&self) -> usize {
        self.number
    }

    /// Actual position, in counts.
    #[getter]
    fn position(&self) -> Option<f64> {
        self.value(|motor| motor.actual_position)
    }

    /// Actual position as the board holds it, an integer of 1/(Ix08*32) counts.
    #[getter]
    fn raw_position(&self) -> Option<i64> {
        Some(self.quantity(|motor| motor.actual_position)?.raw)
    }

    /// Commanded position, in counts.
    #[getter]
    fn commanded_position(&self) -> Option<f64> {
        self.value(|motor| motor.commanded_position)
    }

    /// Following error, in counts.
    #[getter]
    fn following_error(&self) -> Option<f64> {
        self.value(|motor| motor.following_error)
    }

    /// Velocity, in counts a second.
    #[getter]
    fn velocity(&self) -> Option<f64> {
        self.value(|motor| motor.velocity)
    }

    /// Position of the master that it follows, in counts.
    #[getter]
    fn master_position(&self) -> Option<f64> {
        self.value(|motor| motor.master_position)
    }

    /// Where its present move ends, in counts (from the background report).
    #[getter]
    fn target_position(&self) -> Option<f64> {
        self.background()?.target_position?.value
    }

    /// The flags of its status words.
    #[getter]
    fn status(&self) -> Status {
        let servo = self.moment.motor(self.number).and_then(|motor| motor.status);
        Status([servo, self.background().and_then(|motor| motor.status)])
    }

    /// The number of the motor's coordinate system; `None` also if the board does not report it.
    #[getter]
    fn coordinate_system(&self) -> Option<u32> {
        self.background()?.coordinate_system
    }

    fn __repr__(&self) -> String {
        format!("<Motor {} at {:?} counts>", self.number, self.position())
    }
}

/// One coordinate system of the background report.
#[pyclass(frozen, module = "pmac_dpram")]
#[derive(Debug)]
pub struct System {
    moment: Arc<Moment>,
    number: usize,
}

#[pymethods]
impl System {
    /// Its number, from 1.
    #[getter]
    fn number(&self) -> usize {
        self.number
    }

    /// The flags of its status and program status words.
    #[getter]
    fn status(&self) -> Status {
        let system = self.moment.system(self.number);
        Status([system.and_then(|system| system.status), system.and_then(|system| system.program_status)])
    }

    /// Program lines that the board has still to execute, as `PR`.
    #[getter]
    fn lines_remaining(&self) -> Option<i32> {
        self.moment.system(self.number)?.lines_remaining
    }

    /// The axis targets in user units, by the axis' letter.
    #[getter]
    fn targets<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let targets = PyDict::new(py);
        for axis in ["A", "B", "C", "U", "V", "W", "X", "Y", "Z"] {
            let target = self.moment.system(self.number).and_then(|system| system.axis_targets.axis(axis));
            targets.set_item(axis, target)?;
        }
        Ok(targets)
    }

    fn __repr__(&self) -> String {
        format!("<System {}>", self.number)
    }
}

/// Flags by name, as `pmacctl motors --json` has them. A flag of a word that the board does not report is `None`.
#[pyclass(frozen, module = "pmac_dpram")]
#[derive(Debug)]
pub struct Status([Option<Flags>; 2]);

/// Whether boards have a flag of this name.
fn is_flag(name: &str) -> bool {
    let of = |table: &StatusTable| table.flags.iter().any(|(_, flag)| *flag == name);
    FAMILIES.iter().any(|family| family.status.motor.iter().chain(family.status.coordinate_system).any(of))
}

#[pymethods]
impl Status {
    fn __getattr__(&self, name: &str) -> PyResult<Option<bool>> {
        for flags in self.0.iter().flatten() {
            if flags.table.flags.iter().any(|(_, flag)| *flag == name) {
                return Ok(Some(flags.has(name)));
            }
        }
        if self.0.iter().any(Option::is_none) && is_flag(name) {
            return Ok(None);
        }
        Err(PyAttributeError::new_err(format!("there is no flag {name}; names() tells those that are set")))
    }

    /// The flags that are set.
    fn names(&self) -> Vec<&'static str> {
        self.0.iter().flatten().flat_map(Flags::names).collect()
    }

    fn __repr__(&self) -> String {
        format!("<Status {}>", self.names().join(" "))
    }
}
