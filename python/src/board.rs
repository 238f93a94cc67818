//! One board: live data from the segment, commands through the socket.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use pmac_dpram::client::{
    Board as Client, ClientError, CommandError, Connection, HeldJog, OwnBuffer, Staleness, StreamError,
    StreamOptions, gather_all, stream_all,
};
use pmac_dpram::protocol::calls::LeftLines;
use pmac_dpram::protocol::control::parse;
use pmac_dpram::segment::{SegmentName, UserUnit};
use pyo3::prelude::*;

use crate::columns::Columns;
use crate::data::Snapshot;
use crate::errors::{of_client, of_command, of_command_saying, refused, stale};
use crate::gather::Gathered;
use crate::identity::Identity;
use crate::per_process::{PerProcess, lock};
use crate::rotary::Streamed;
use crate::updates::Updates;

/// How long one wait lasts before Python may handle a signal.
pub const SLICE: Duration = Duration::from_millis(100);

/// The duration of `seconds`, which must not be negative.
pub fn duration(seconds: f64) -> PyResult<Duration> {
    Duration::try_from_secs_f64(seconds).map_err(|_| refused(&format!("{seconds} is no time in seconds")))
}

/// Does `action`, which asks often whether it shall go on, while other Python threads go on. A signal whose handler
/// raises ends it; if that end fails, the failure, which `of` makes an exception, is the cause of the handler's one.
fn until_signal<R: Send, E: Send>(
    py: Python<'_>,
    of: impl FnOnce(E) -> PyErr,
    action: impl FnOnce(&mut dyn FnMut() -> bool) -> Result<Option<R>, E> + Send,
) -> PyResult<R> {
    let (done, raised) = py.detach(|| {
        let mut raised = None;
        let done = action(&mut || {
            raised = Python::attach(|py| py.check_signals()).err();
            raised.is_none()
        });
        (done, raised)
    });
    match (done.transpose(), raised) {
        (Some(Err(error)), Some(raised)) => {
            raised.set_cause(py, Some(of(error)));
            Err(raised)
        }
        (_, Some(raised)) => Err(raised),
        (Some(done), None) => done.map_err(of),
        (None, None) => Err(refused("it was ended")),
    }
}

/// A board of a running `pmacd`.
#[pyclass(frozen, subclass, module = "pmac_dpram")]
pub struct Board {
    name: SegmentName,
    socket: PathBuf,
    client: PerProcess<Client>,
    /// Apart from the client, so that a reading thread does not wait for a command.
    connection: PerProcess<Commands>,
}

/// The way of a board's command lines.
#[derive(Default)]
struct Commands {
    connection: Option<Connection>,
    own_buffer: OwnBuffer,
}

/// Attaches as the command line does with `--name` and `--socket`: the socket tells its segment, and both must agree.
fn attach(name: Option<&str>, socket: Option<&Path>) -> PyResult<Client> {
    let found = match (name, socket) {
        (None, Some(socket)) => Client::at_socket(socket).map_err(of_client)?,
        (name, None) => Client::attach(name.unwrap_or("pmac0")).map_err(of_client)?,
        (Some(name), Some(socket)) => {
            let mut board = Client::attach(name).map_err(of_client)?.with_socket(socket);
            board.connection().map_err(of_command)?;
            board
        }
    };
    Ok(found)
}

impl Board {
    /// Reads from the segment, while other Python threads go on.
    fn read<R: Send>(
        &self,
        py: Python<'_>,
        action: impl FnOnce(&mut Client) -> Result<R, ClientError> + Send,
    ) -> PyResult<R> {
        let client = self.client.get(|| Client::attach(self.name.as_str()).map_err(of_client))?;
        py.detach(|| action(&mut lock(&client))).map_err(of_client)
    }

    /// Does `action` with the connection, while other Python threads go on. Makes a new connection if the old one
    /// broke, or belongs to the parent of a forked child. If the daemon at its other end had gone before, repeats the
    /// call with the present daemon.
    fn send<R: Send>(
        &self,
        py: Python<'_>,
        action: impl Fn(&mut Connection) -> Result<R, CommandError> + Send + Sync,
    ) -> PyResult<R> {
        self.send_line(py, false, |connection, _| action(connection))
    }

    /// As [`Self::send`], for lines that may open a program buffer; if `confirmed`, also for lines that end command
    /// lines for everybody.
    fn send_line<R: Send>(
        &self,
        py: Python<'_>,
        confirmed: bool,
        action: impl Fn(&mut Connection, &mut OwnBuffer) -> Result<R, CommandError> + Send + Sync,
    ) -> PyResult<R> {
        let commands = self.connection.get(|| Ok(Commands::default()))?;
        let result = py.detach(|| {
            let mut kept = lock(&commands);
            let Commands { connection, own_buffer } = &mut *kept;
            let (found, is_old) = match connection.take().filter(|kept| kept.check_process().is_ok()) {
                Some(connection) => (connection, true),
                None => (self.connect()?, false),
            };
            let mut found = found.confirming(confirmed);
            let mut result = action(&mut found, own_buffer);
            if is_old && matches!(result, Err(CommandError::NotTaken { .. })) {
                found = self.connect()?.confirming(confirmed);
                result = action(&mut found, own_buffer);
            }
            if matches!(result, Ok(_) | Err(CommandError::Refused(_))) {
                *connection = Some(found);
            }
            result
        });
        result.map_err(of_command)
    }

    fn connect(&self) -> Result<Connection, CommandError> {
        Connection::open(&self.socket)?.of_board(&self.name)
    }
}

#[pymethods]
impl Board {
    #[new]
    #[pyo3(signature = (name = None, socket = None))]
    fn new(py: Python<'_>, name: Option<String>, socket: Option<PathBuf>) -> PyResult<Self> {
        let client = py.detach(|| attach(name.as_deref(), socket.as_deref()))?;
        let (name, socket) = (client.name().clone(), client.socket().to_owned());
        let (client, connection) = (PerProcess::new(client), PerProcess::new(Commands::default()));
        Ok(Self { name, socket, client, connection })
    }

    /// The board's name.
    #[getter]
    fn name(&self) -> String {
        self.name.as_str().to_owned()
    }

    /// The daemon's socket.
    #[getter]
    fn socket(&self) -> PathBuf {
        self.socket.clone()
    }

    /// Everything that the segment has now. Data that are not live raise `StaleData` or `DaemonGone`, unless
    /// `stale_ok`. If only the background data are not live, the snapshot leaves them out.
    #[pyo3(signature = (*, stale_ok = false))]
    fn snapshot(&self, py: Python<'_>, stale_ok: bool) -> PyResult<Snapshot> {
        let found = self.read(py, |client| client.snapshot())?;
        let none = found.stale.unwrap_or(Staleness::Off);
        let snapshot = Snapshot::of(found, stale_ok).ok_or_else(|| stale(none))?;
        match snapshot.servo_staleness() {
            Some(why) if !stale_ok => Err(stale(why)),
            _ => Ok(snapshot),
        }
    }

    /// Sleeps until there is a servo update newer than number `after` (0: any; None: than the latest), at most
    /// `timeout` seconds; false when none came.
    #[pyo3(signature = (timeout = 1.0, *, after = None))]
    fn wait(&self, py: Python<'_>, timeout: f64, after: Option<u64>) -> PyResult<bool> {
        let end = Instant::now() + duration(timeout)?;
        let after = match after {
            Some(after) => after,
            None => self.read(py, |client| client.servo_sequence())?,
        };
        loop {
            let left = end.saturating_duration_since(Instant::now());
            if self.read(py, |client| client.wait(after, left.min(SLICE)))? {
                return Ok(true);
            }
            if left.is_zero() {
                return Ok(false);
            }
            py.check_signals()?;
        }
    }

    /// Servo updates from number `since` on, at most `most`, and how many of that stretch are lost.
    #[pyo3(signature = (since = 1, most = 65536))]
    fn history(&self, py: Python<'_>, since: u64, most: usize) -> PyResult<(Vec<Snapshot>, u64)> {
        let history = self.read(py, |client| client.history(since, most))?;
        let samples = history.samples.into_iter().map(|update| Snapshot::of_update(update, None));
        Ok((samples.collect(), history.lost))
    }

    /// As [`Self::history`], as columns.
    #[pyo3(signature = (columns, since = 1, most = 65536))]
    fn history_columns(
        &self,
        py: Python<'_>,
        columns: Vec<String>,
        since: u64,
        most: usize,
    ) -> PyResult<Columns> {
        let mut taken = Columns::new(columns)?;
        let history = self.read(py, |client| client.history(since, most))?;
        taken.lose(history.lost);
        history.samples.iter().for_each(|update| taken.push(update));
        Ok(taken)
    }

    /// The name of each motor that `pmacd`'s configuration gives one.
    fn names(&self, py: Python<'_>) -> PyResult<BTreeMap<usize, String>> {
        let found = self.read(py, |client| client.identity())?;
        let named = found.names.iter().zip(1..);
        Ok(named.filter_map(|(name, motor)| Some((motor, name.as_ref()?.to_string()))).collect())
    }

    /// The unit of each motor that `pmacd`'s configuration gives one, and how many counts the unit has.
    fn units(&self, py: Python<'_>) -> PyResult<BTreeMap<usize, (String, f64)>> {
        let found = self.read(py, |client| client.identity())?;
        let units = found.units.iter().zip(1..);
        let told = |unit: &UserUnit| (unit.name.to_string(), unit.counts_per_unit);
        Ok(units.filter_map(|(unit, motor)| Some((motor, told(unit.as_ref()?)))).collect())
    }

    /// The unit of each of the site's own words, by name, and how many values it has.
    fn words(&self, py: Python<'_>) -> PyResult<BTreeMap<String, (String, usize)>> {
        let words = self.read(py, |client| client.user_words())?;
        Ok(words.iter().map(|word| (word.name.to_string(), (word.unit.to_string(), word.count))).collect())
    }

    /// The board's identity, as the board has told `pmacd`.
    fn identity(&self, py: Python<'_>) -> PyResult<Identity> {
        let told = self.read(py, |client| client.identity())?;
        Ok(Identity::of(&told))
    }

    /// Every servo update from now on; see [`Updates`].
    fn _updates(&self, py: Python<'_>, timeout: f64) -> PyResult<Updates> {
        let client = py.detach(|| Client::attach(self.name.as_str())).map_err(of_client)?;
        Updates::begin(client, duration(timeout)?)
    }

    /// Sends a command line and returns the lines of its reply. The line enters no program buffer but one that this
    /// process's lines have opened. `confirmed`: also sends lines that end command lines for everybody.
    #[pyo3(signature = (line, timeout = 5.0, *, confirmed = false))]
    fn command(&self, py: Python<'_>, line: &str, timeout: f64, confirmed: bool) -> PyResult<Vec<String>> {
        let timeout = duration(timeout)?;
        self.send_line(py, confirmed, |connection, own| own.send(connection, line, timeout))
    }

    /// Asks for values of variables by a line that enters no program buffer.
    fn _question(&self, py: Python<'_>, line: &str, timeout: f64) -> PyResult<Vec<String>> {
        let timeout = duration(timeout)?;
        self.send(py, |connection| connection.question(line, timeout))
    }

    /// Sends a control character (`^K`, or the character itself), as `pmacctl send` does, and returns the lines of its
    /// reply. `pmacd` decides by your role which ones you may send. `confirmed`: also `^Z`, which ends command lines
    /// for everybody, and `^R` and `^S` where they run lines that a rotary stream has left.
    #[pyo3(signature = (character, *, confirmed = false))]
    fn control(&self, py: Python<'_>, character: &str, confirmed: bool) -> PyResult<Vec<String>> {
        let character = parse(character)
            .ok_or_else(|| refused(&format!("{character:?} is no control character; write ^A to ^Z")))?;
        self.send_line(py, confirmed, |connection, own| own.control(connection, character))
    }

    /// A request to the control panel: `jog+`, `jog-`, `jog-stop`, `pre-jog`, `home`, `start`, `step`, `stop` or
    /// `hold`.
    fn panel(&self, py: Python<'_>, action: &str, numbers: Vec<u8>) -> PyResult<()> {
        self.send(py, |connection| connection.panel(action, &numbers))
    }

    /// Moves a motor to a position in counts. Returns when the board has taken the command, not when the motor is
    /// there.
    fn jog_to(&self, py: Python<'_>, motor: u8, position: f64) -> PyResult<()> {
        self.send(py, |connection| connection.jog_to(motor, position))
    }

    /// Makes the board gather `sources` (`1.actual_position`, `servo_timer`, `Y:$C003`) each `period` servo cycles for
    /// `seconds`. A gather that ends early raises `PmacError`.
    #[pyo3(signature = (sources, seconds, *, period = 1))]
    fn gather(&self, py: Python<'_>, sources: Vec<String>, seconds: f64, period: u32) -> PyResult<Gathered> {
        let time = duration(seconds)?;
        let mut client = py.detach(|| Client::attach(self.name.as_str())).map_err(of_client)?;
        let connection = py.detach(|| self.connect()).map_err(of_command)?;
        let gathered = until_signal(py, of_client, |goes_on| {
            gather_all(&mut client, connection, &sources, (period, time), goes_on)
        })?;
        Ok(Gathered(gathered))
    }

    /// Streams the program `text` to a rotary buffer; see `Board.rotary` of the package.
    #[pyo3(signature = (name, text, *, cs, define, run, clear, continue_, timeout))]
    #[expect(clippy::too_many_arguments, reason = "they are the options of the call")]
    fn _rotary(
        &self,
        py: Python<'_>,
        name: &str,
        text: &[u8],
        cs: u8,
        define: Option<u32>,
        run: bool,
        clear: bool,
        continue_: bool,
        timeout: f64,
    ) -> PyResult<Streamed> {
        let left = match (clear, continue_) {
            (true, true) => return Err(refused("clear and continue_ exclude one another")),
            (true, false) => Some(LeftLines::Clear),
            (false, true) => Some(LeftLines::Continue),
            (false, false) => None,
        };
        let timeout = duration(timeout)?;
        let options = StreamOptions { coordinate_system: cs, define_longs: define, run, left, timeout };
        let connections = py.detach(|| Ok((self.connect()?, self.connect()?))).map_err(of_command)?;
        let of = |error: StreamError| of_command_saying(error.cause, &error.said);
        let streamed =
            until_signal(py, of, |goes_on| stream_all(connections, (name, text), &options, goes_on))?;
        Ok(Streamed(streamed))
    }

    /// A jog that lasts as long as its `with` block; the daemon stops it if this process dies or hangs. The daemon
    /// jogs by the control panel, or by command line if it does not use the panel.
    fn jog(&self, py: Python<'_>, motor: u8, direction: &str) -> PyResult<Jog> {
        let action = match direction {
            "+" => "jog+",
            "-" => "jog-",
            _ => return Err(refused(&format!("{direction:?} is no direction; write + or -"))),
        };
        let connection = py.detach(|| self.connect()).map_err(of_command)?;
        Ok(Jog { connection: Mutex::new(Some(connection)), action, motor, held: Mutex::new(None) })
    }

    fn __repr__(&self) -> String {
        format!("<Board {}>", self.name.as_str())
    }
}

/// A jog that a `with` block holds.
#[pyclass(frozen, module = "pmac_dpram")]
pub struct Jog {
    connection: Mutex<Option<Connection>>,
    action: &'static str,
    motor: u8,
    held: Mutex<Option<HeldJog>>,
}

impl Jog {
    /// Without `pmacd` nobody stops the motor: the error must say so, and not only that the stop failed.
    fn not_stopped(&self, error: CommandError) -> PyErr {
        match HeldJog::may_be_moving(self.motor, &error) {
            Some(message) => of_command_saying(error, &message),
            None => of_command(error),
        }
    }
}

#[pymethods]
impl Jog {
    fn __enter__<'py>(jog: Bound<'py, Self>, py: Python<'py>) -> PyResult<Bound<'py, Self>> {
        let this = jog.get();
        let connection = lock(&this.connection).take();
        let connection = connection.ok_or_else(|| refused("this jog is over; ask for another one"))?;
        let held =
            py.detach(|| HeldJog::begin(connection, this.action, &[this.motor])).map_err(of_command)?;
        *lock(&this.held) = Some(held);
        Ok(jog)
    }

    /// Whether the motor is still held; false when the daemon has stopped it.
    #[getter]
    fn is_held(&self) -> bool {
        lock(&self.held).as_ref().is_some_and(HeldJog::is_held)
    }

    #[pyo3(signature = (*_error))]
    fn __exit__(&self, py: Python<'_>, _error: Bound<'_, pyo3::types::PyTuple>) -> PyResult<bool> {
        let held = lock(&self.held).take();
        match held {
            Some(held) => py.detach(|| held.stop()).map(|_| false).map_err(|error| self.not_stopped(error)),
            None => Ok(false),
        }
    }
}
