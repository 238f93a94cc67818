//! One board: live data from the segment, commands through the socket. Threads share it; none waits for another one's
//! call.

use std::ffi::CString;
use std::path::{Path, PathBuf};
use std::time::Duration;

use driver::client::command::SendAs;
use driver::client::command::variables::board_variable;
use driver::client::{Board as Client, ClientError, CommandError, Connection, OwnBuffer};
use driver::map::Family;
use driver::map::user_word::UserWord;
use driver::protocol::answer;
use driver::protocol::control::parse;
use driver::segment::{Identity as Told, SegmentName};

use crate::failure::{Failure, Status};
use crate::per_process::{PerProcess, Pool};
use crate::snapshot::Snapshot;
use crate::types::{Identity, MotorLabel, Word, chars};

/// A board of a running `pmacd`. Threads may share the handle.
pub struct Board {
    name: SegmentName,
    socket: PathBuf,
    /// The two as C has them.
    texts: [CString; 2],
    readers: Pool<Client>,
    connections: Pool<Connection>,
    /// Whether this process's command lines have a program buffer open.
    own_buffer: PerProcess<OwnBuffer>,
}

/// Attaches as the command line does with `--name` and `--socket`: the socket tells its segment, and both must agree.
fn attach(name: Option<&str>, socket: Option<&Path>) -> Result<Client, Failure> {
    Ok(match (name, socket) {
        (None, Some(socket)) => Client::at_socket(socket)?,
        (name, None) => Client::attach(name.unwrap_or("pmac0"))?,
        (Some(name), Some(socket)) => {
            let mut board = Client::attach(name)?.with_socket(socket);
            board.connection()?;
            board
        }
    })
}

impl Board {
    /// The board called `name` (`pmac0` without a name), or the one of the daemon at `socket`.
    pub fn open(name: Option<&str>, socket: Option<&str>) -> Result<Self, Failure> {
        let client = attach(name, socket.map(Path::new))?;
        let (name, socket) = (client.name().clone(), client.socket().to_owned());
        let text = |text: String| CString::new(text).unwrap_or_default();
        let texts = [text(name.as_str().to_owned()), text(socket.to_string_lossy().into_owned())];
        let (readers, connections, own_buffer) = (Pool::default(), Pool::default(), PerProcess::default());
        let board = Self { name, socket, texts, readers, connections, own_buffer };
        board.readers.put(client)?;
        Ok(board)
    }

    /// The board's name.
    pub fn name(&self) -> &CString {
        &self.texts[0]
    }

    /// The daemon's socket.
    pub fn socket(&self) -> &CString {
        &self.texts[1]
    }

    /// The name of its segment.
    pub const fn segment(&self) -> &SegmentName {
        &self.name
    }

    /// A reader of the segment for the caller alone.
    pub fn reader(&self) -> Result<Client, ClientError> {
        Client::attach(self.name.as_str())
    }

    /// Reads from the segment.
    pub fn read<R>(&self, action: impl FnOnce(&mut Client) -> Result<R, ClientError>) -> Result<R, Failure> {
        let mut client = match self.readers.take()? {
            Some(client) => client,
            None => self.reader()?,
        };
        let result = action(&mut client);
        self.readers.put(client)?;
        Ok(result?)
    }

    /// The site's own words: name, unit and count of each.
    pub fn words(&self) -> Result<Vec<Word>, Failure> {
        let words = self.read(Client::user_words)?;
        let told = |word: &UserWord| Word {
            name: chars(&word.name),
            unit: chars(&word.unit),
            count: u32::try_from(word.count).unwrap_or(u32::MAX),
            reserved: 0,
        };
        Ok(words.iter().map(told).collect())
    }

    /// The board's answers for the variables `names`, as `P1`, `Q2`, `I122`.
    pub fn variables(&self, names: &[&str], timeout: Duration) -> Result<Vec<f64>, Failure> {
        let named = |name: &&str| {
            let why = || Failure::argument(format!("{name:?} is no variable; write P1, Q2, I122 or M5"));
            board_variable(name).ok_or_else(why)
        };
        let names = names.iter().map(named).collect::<Result<Vec<_>, _>>()?;
        let told = self.send(false, |connection| connection.ask_variables(&names, timeout))?;
        let value = |(name, told): (&String, &String)| {
            let why = || {
                Failure::new(Status::Refused, format!("{name}: the board answers {told}, which is no number"))
            };
            answer::number(answer::text(told)).ok_or_else(why)
        };
        names.iter().zip(&told).map(value).collect()
    }

    /// Has the board set the variable `name`. The line enters no program buffer.
    pub fn set_variable(&self, name: &str, value: f64, timeout: Duration) -> Result<(), Failure> {
        let why = || Failure::argument(format!("{name:?} is no variable; write P1, Q2, I122 or M5"));
        let name = board_variable(name).ok_or_else(why)?;
        if !value.is_finite() {
            return Err(Failure::argument(format!("{name}={value}: the board has no such number")));
        }
        let send_as = SendAs { into_buffer: Some(false), ..SendAs::default() };
        self.send(false, |connection| connection.send_as(&format!("{name}={value}"), timeout, send_as))?;
        Ok(())
    }

    /// A connection for the caller alone.
    pub fn connect(&self) -> Result<Connection, CommandError> {
        Connection::open(&self.socket)?.of_board(&self.name)
    }

    /// Does `action` with a connection of its own. If the daemon at the end of a spare one had gone before, repeats the
    /// call with the present daemon. If `confirmed`, the daemon also sends lines that end command lines for everybody.
    pub fn send<R>(
        &self,
        confirmed: bool,
        mut action: impl FnMut(&mut Connection) -> Result<R, CommandError>,
    ) -> Result<R, Failure> {
        let spare = self.connections.take()?;
        let is_spare = spare.is_some();
        let mut connection = spare.map_or_else(|| self.connect(), Ok)?.confirming(confirmed);
        let mut result = action(&mut connection);
        if is_spare && matches!(result, Err(CommandError::NotTaken { .. })) {
            connection = self.connect()?.confirming(confirmed);
            result = action(&mut connection);
        }
        if matches!(result, Ok(_) | Err(CommandError::Refused(_))) {
            self.connections.put(connection)?;
        }
        Ok(result?)
    }

    /// As [`Self::send`], for lines that may open or close a program buffer.
    pub fn send_line<R>(
        &self,
        confirmed: bool,
        action: impl Fn(&mut Connection, &mut OwnBuffer) -> Result<R, CommandError>,
    ) -> Result<R, Failure> {
        let before = *self.own_buffer.lock()?;
        let mut after = before;
        let result = self.send(confirmed, |connection| action(connection, &mut after));
        // A line of another thread may have opened or closed the buffer meanwhile.
        if after.is_open() != before.is_open() {
            *self.own_buffer.lock()? = after;
        }
        result
    }

    /// Sends a command line, and returns the lines of its reply.
    pub fn command(&self, line: &str, timeout: Duration, confirmed: bool) -> Result<Vec<String>, Failure> {
        self.send_line(confirmed, |connection, own| own.send(connection, line, timeout))
    }

    /// Asks by a line that enters no program buffer.
    pub fn question(&self, line: &str, timeout: Duration) -> Result<Vec<String>, Failure> {
        self.send(false, |connection| connection.question(line, timeout))
    }

    /// Sends the control character that `text` names.
    pub fn control(&self, text: &str, confirmed: bool) -> Result<Vec<String>, Failure> {
        let why = || Failure::argument(format!("{text:?} is no control character; write ^A to ^Z"));
        let character = parse(text).ok_or_else(why)?;
        self.send_line(confirmed, |connection, own| own.control(connection, character))
    }

    /// A request to the control panel.
    pub fn panel(&self, action: &str, numbers: &[u8]) -> Result<(), Failure> {
        self.send(false, |connection| connection.panel(action, numbers))
    }

    /// Moves `motor` to `position`, in counts.
    pub fn jog_to(&self, motor: u8, position: f64) -> Result<(), Failure> {
        self.send(false, |connection| connection.jog_to(motor, position))
    }

    /// Everything that the segment has now; old data only if `stale_ok`.
    pub fn snapshot(&self, stale_ok: bool) -> Result<Snapshot, Failure> {
        Snapshot::of(self.read(Client::snapshot)?, stale_ok)
    }

    /// The number of the latest servo update; 0 before the first.
    pub fn sequence(&self) -> Result<u64, Failure> {
        self.read(|client| {
            client.refresh()?;
            client.servo_sequence()
        })
    }

    /// Sleeps until there is a servo update newer than number `after` (`None`: than the latest); false without one.
    pub fn wait(&self, after: Option<u64>, timeout: Duration) -> Result<bool, Failure> {
        self.read(|client| {
            client.refresh()?;
            let after = after.map_or_else(|| client.servo_sequence(), Ok)?;
            client.wait(after, timeout)
        })
    }

    fn told(&self) -> Result<Told, Failure> {
        self.read(|client| {
            client.refresh()?;
            client.identity()
        })
    }

    /// The board's identity.
    pub fn identity(&self) -> Result<Identity, Failure> {
        let told = self.told()?;
        let family = told.family.and_then(Family::by_number);
        Ok(Identity {
            family: chars(family.map_or("", |family| family.name)),
            board_type: chars(told.board_type.as_deref().unwrap_or_default()),
            firmware: chars(told.firmware.as_deref().unwrap_or_default()),
            servo_period_ns: told.servo_period_ps.map_or(f64::NAN, |picoseconds| picoseconds as f64 / 1e3),
            servo_report_cycles: told.servo_report_cycles.unwrap_or_default(),
            motors: told.motors.unwrap_or_default(),
            coordinate_systems: told.coordinate_systems.unwrap_or_default(),
            replay: told.replay.into(),
        })
    }

    /// Name and unit of motor `number`.
    pub fn motor_label(&self, number: u32) -> Result<MotorLabel, Failure> {
        let told = self.told()?;
        let index = usize::try_from(number).ok().and_then(|number| number.checked_sub(1));
        let Some((name, unit)) = index.and_then(|index| told.names.get(index).zip(told.units.get(index)))
        else {
            return Err(Failure::argument(format!(
                "there is no motor {number}; motors are 1 to {}",
                told.names.len()
            )));
        };
        Ok(MotorLabel {
            name: chars(name.as_deref().unwrap_or_default()),
            unit: chars(unit.as_ref().map_or("", |unit| &unit.name)),
            counts_per_unit: unit.map_or(0.0, |unit| unit.counts_per_unit),
        })
    }
}
