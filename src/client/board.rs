//! One board, as a user sees it.
//!
//! A board is attached to the daemon's segment read-only. When the daemon restarts, the board attaches to the new
//! segment; meanwhile the last data stay readable and say that they are old.

pub mod gather;
pub mod user;
pub mod variables;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use self::user::UserData;
use super::command::{CommandError, Connection};
use super::decoder::Decoder;
use super::own_buffer::OwnBuffer;
use super::view::{Moment, Reading, Staleness, View};
use crate::decode::{BackgroundData, ServoData, TooShort};
use crate::map::user_word::UserWord;
use crate::protocol::socket_place;
use crate::segment::{
    Condition, Cursor, DIRECTORY, Identity, RegionId, RegionInfo, Sample, SegmentError, SegmentName,
    Subscriber, WaitOutcome,
};

/// How long a wait sleeps before it looks for a new daemon.
const REATTACH: Duration = Duration::from_millis(100);

/// The board's data are not available.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ClientError {
    /// This process cannot attach to the segment, or cannot read it.
    #[error(transparent)]
    Segment(#[from] SegmentError),
    /// The segment's data belong to another board than the named one.
    #[error("the segment's data cannot be decoded: {0}; use programs of one release")]
    Decode(#[from] TooShort),
    /// The daemon does not say which board it has.
    #[error(transparent)]
    Socket(#[from] CommandError),
    /// A gather has ended early, or not as asked.
    #[error("{0}")]
    Gather(String),
    /// This version does not know the layout of the board's data.
    #[error("the board's family (number {0}) is not known to this program; use a newer one")]
    Family(u32),
}

/// The default path of the socket of the daemon `name`: in `/run/pmacd`, or, without that directory, in
/// `$XDG_RUNTIME_DIR/pmacd`.
#[must_use]
pub fn socket_path(name: &SegmentName) -> PathBuf {
    socket_place::socket_path(name.as_str())
}

/// All data of the segment at one moment.
#[derive(Debug, Clone, PartialEq)]
pub struct Snapshot {
    /// The board's identity, as far as the segment has it.
    pub identity: Identity,
    /// Servo data; `None` before the first.
    pub servo: Option<View<ServoData>>,
    /// Background data; `None` before the first.
    pub background: Option<View<BackgroundData>>,
    /// The site's own words; `None` before the first, and where the configuration names none.
    pub user: Option<View<UserData>>,
    /// Why no data here are live, whatever the regions say.
    pub stale: Option<Staleness>,
}

impl Snapshot {
    /// The first report with old data, and why its data are old. A report that the board does not make counts as no
    /// fault.
    #[must_use]
    pub fn old(&self) -> Option<(&'static str, Staleness)> {
        let servo = self.servo.as_ref().and_then(|view| Some(("servo", view.stale?)));
        let background = self.background.as_ref().and_then(|view| Some(("background", view.stale?)));
        servo.into_iter().chain(background).find(|(_, stale)| *stale != Staleness::Off)
    }
}

/// A stretch of past data.
#[derive(Debug, Clone, PartialEq)]
pub struct History<T = ServoData> {
    /// The samples that the segment still had, oldest first.
    pub samples: Vec<View<T>>,
    /// How many samples of the requested stretch the daemon had overwritten already. Exact.
    pub lost: u64,
    /// The number to continue with.
    pub next: u64,
}

/// A board with a daemon.
pub struct Board {
    name: SegmentName,
    directory: PathBuf,
    socket: PathBuf,
    subscriber: Subscriber,
    sample: Sample,
    identified: Option<Identified>,
    /// The names of the site's own words, and the generation of their segment.
    user_words: Option<(u64, Vec<UserWord>)>,
    connection: Option<Connection>,
    own_buffer: OwnBuffer,
}

impl Board {
    /// Attaches to the board called `name`, as in `--name`: `pmac0`.
    ///
    /// # Errors
    /// [`ClientError::Segment`] without such a segment, or with a segment that this process must not trust.
    pub fn attach(name: &str) -> Result<Self, ClientError> {
        Self::attach_in(Path::new(DIRECTORY), name)
    }

    /// As [`Board::attach`], with segments in another directory.
    ///
    /// # Errors
    /// As [`Board::attach`].
    pub fn attach_in(directory: &Path, name: &str) -> Result<Self, ClientError> {
        let name = SegmentName::new(name)?;
        let subscriber = Subscriber::attach_in(directory, &name)?;
        Ok(Self {
            socket: socket_path(&name),
            name,
            directory: directory.to_owned(),
            subscriber,
            sample: Sample::new(),
            identified: None,
            user_words: None,
            connection: None,
            own_buffer: OwnBuffer::default(),
        })
    }

    /// Attaches to the board of the daemon whose socket is `path`, whatever the board's name.
    ///
    /// # Errors
    /// [`ClientError::Socket`] if no daemon answers there, else as [`Board::attach`].
    pub fn at_socket(path: &Path) -> Result<Self, ClientError> {
        let mut connection = Connection::open(path)?;
        let name = connection.info()?.segment;
        let mut board = Self::attach(&name)?.with_socket(path);
        board.connection = Some(connection);
        Ok(board)
    }

    /// The same board with its socket at `path`.
    #[must_use]
    pub fn with_socket(mut self, path: &Path) -> Self {
        path.clone_into(&mut self.socket);
        self.connection = None;
        self
    }

    /// The board's name.
    #[must_use]
    pub fn name(&self) -> &SegmentName {
        &self.name
    }

    /// The daemon's socket.
    #[must_use]
    pub fn socket(&self) -> &Path {
        &self.socket
    }

    /// The segment, for data without a method here. After a restart of the daemon another segment takes its place.
    #[must_use]
    pub fn subscriber(&self) -> &Subscriber {
        &self.subscriber
    }

    /// Attaches to the segment under the board's name if that segment is another one and gives more: a new daemon's, or
    /// the same daemon's after a new publication. Every other method that reads does this first. A copy or a directory
    /// under the name takes no reader away from a living segment.
    ///
    /// # Errors
    /// [`ClientError::Segment`] if this process cannot attach to a new daemon's segment.
    pub fn refresh(&mut self) -> Result<Condition, ClientError> {
        let condition = self.subscriber.condition();
        if !condition.is_over() {
            return Ok(condition);
        }
        let own = self.subscriber.own_condition();
        match Subscriber::attach_in(&self.directory, &self.name) {
            Ok(found) => {
                let condition = found.condition();
                let is_another = found.generation() != self.subscriber.generation();
                if condition.is_over() && !(is_another && own.is_over()) {
                    return Ok(own);
                }
                self.subscriber = found;
                Ok(condition)
            }
            Err(_) if !own.is_over() => Ok(own),
            Err(
                SegmentError::NotFound { .. }
                | SegmentError::Malformed { .. }
                | SegmentError::ForeignOwner { .. },
            ) => Ok(own),
            Err(error) => Err(error.into()),
        }
    }

    /// The board's identity, as far as the segment has it.
    ///
    /// # Errors
    /// [`ClientError::Segment`] for a corrupt segment.
    pub fn identity(&mut self) -> Result<Identity, ClientError> {
        Ok(self.identified()?.identity.clone())
    }

    /// The board's identity and the decoder of its data: read once for each identity that the segment publishes.
    fn identified(&mut self) -> Result<&Identified, ClientError> {
        let generation = self.subscriber.generation();
        let current =
            |known: &Identified, sequence| (known.generation, known.sequence) == (generation, sequence);
        let sequence = self.subscriber.published(RegionId::Board).unwrap_or(0);
        let known = match self.identified.take().filter(|known| current(known, sequence)) {
            Some(known) => known,
            None => {
                let sequence = self.latest(RegionId::Board)?;
                let identity =
                    sequence.and_then(|_| Identity::decode(self.sample.bytes())).unwrap_or_default();
                let decoder = Decoder::new(&identity);
                Identified { generation, sequence: sequence.unwrap_or(0), identity, decoder }
            }
        };
        Ok(self.identified.insert(known))
    }

    /// All data of the segment now, in a fixed number of system calls.
    ///
    /// # Errors
    /// [`ClientError`] if the segment is corrupt or its board's family unknown here. Old data are no error.
    pub fn snapshot(&mut self) -> Result<Snapshot, ClientError> {
        let condition = self.refresh()?;
        let identified = self.identified()?;
        let (identity, decoder) = (identified.identity.clone(), identified.decoder()?.clone());
        let servo = self.read(RegionId::Servo, |region, words| Ok(decoder.servo(region, words)?))?;
        let background =
            self.read(RegionId::Background, |region, words| Ok(decoder.background(region, words)?))?;
        let user = self.read_user()?;
        let moment = Moment::now(&self.subscriber, condition);
        Ok(Snapshot {
            identity,
            servo: self.judged(&moment, RegionId::Servo, servo)?,
            background: self.judged(&moment, RegionId::Background, background)?,
            user: self.judged(&moment, RegionId::User, user)?,
            stale: moment.stale,
        })
    }

    /// The number of the latest servo sample; 0 before the first.
    ///
    /// # Errors
    /// [`ClientError::Segment`] for a segment without servo data.
    pub fn servo_sequence(&self) -> Result<u64, ClientError> {
        Ok(self.subscriber.published(RegionId::Servo)?)
    }

    /// Sleeps until the segment has a servo sample newer than number `after`, at most `timeout`; false without one.
    /// After a restart of the daemon its first sample is newer, because its numbers begin again.
    ///
    /// # Errors
    /// [`ClientError::Segment`].
    pub fn wait(&mut self, after: u64, timeout: Duration) -> Result<bool, ClientError> {
        self.wait_for(RegionId::Servo, after, timeout)
    }

    /// As [`Board::wait`], for a sample of `region`.
    ///
    /// # Errors
    /// [`ClientError::Segment`].
    pub fn wait_for(&mut self, region: RegionId, after: u64, timeout: Duration) -> Result<bool, ClientError> {
        let now = Instant::now();
        let deadline = now.checked_add(timeout);
        let generation = self.subscriber.generation();
        loop {
            let left = deadline.map_or(REATTACH, |end| end.saturating_duration_since(Instant::now()));
            self.refresh()?;
            let after = if self.subscriber.generation() == generation { after } else { 0 };
            match self.subscriber.wait_newer(region, after, left)? {
                WaitOutcome::Newer => return Ok(true),
                WaitOutcome::TimedOut if deadline.is_some() => return Ok(false),
                WaitOutcome::TimedOut => {}
                WaitOutcome::Dead if left.is_zero() => return Ok(false),
                WaitOutcome::Dead if self.refresh()?.is_over() => std::thread::sleep(REATTACH.min(left)),
                WaitOutcome::Dead => {}
            }
        }
    }

    /// Servo samples from number `since` on, at most `most`, and the exact number of lost ones among them. The number
    /// of system calls does not depend on the number of samples.
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn history(&mut self, since: u64, most: usize) -> Result<History, ClientError> {
        let condition = self.refresh()?;
        let decoder = self.identified()?.decoder()?.clone();
        let cursor = self.subscriber.cursor(RegionId::Servo, since)?;
        self.follow(cursor, most, condition, |region, words| Ok(decoder.servo(region, words)?))
    }

    /// The samples from `cursor` on, at most `most`, each decoded by `decode`.
    fn follow<T>(
        &mut self,
        mut cursor: Cursor,
        most: usize,
        condition: Condition,
        decode: impl Fn(&RegionInfo, &[u16]) -> Result<T, ClientError>,
    ) -> Result<History<T>, ClientError> {
        let Self { subscriber, sample, .. } = self;
        let region = subscriber.region(cursor.region())?;
        let mut readings = Vec::new();
        while readings.len() < most && subscriber.next(&mut cursor, sample)? {
            readings.push(Reading::new(sample, decode(&region, sample.words())?));
        }
        let moment = Moment::now(subscriber, condition);
        let region = subscriber.region(cursor.region())?;
        let samples = readings.into_iter().map(|reading| moment.view(&region, reading)).collect();
        Ok(History { samples, lost: cursor.lost(), next: cursor.position() })
    }

    /// The connection to the daemon. The first call makes it; a forked child makes its own.
    ///
    /// # Errors
    /// [`CommandError::Connect`]; [`CommandError::OtherBoard`] if the daemon there has another board.
    pub fn connection(&mut self) -> Result<&mut Connection, CommandError> {
        let connection = match self.connection.take() {
            Some(connection) if connection.check_process().is_ok() => connection,
            _ => Connection::open(&self.socket)?.of_board(&self.name)?,
        };
        Ok(self.connection.insert(connection))
    }

    /// Sends one command line through the daemon; see [`Connection::send`]. The line enters a program buffer only if
    /// this process has opened the buffer by this method; see [`OwnBuffer`].
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn send(&mut self, line: &str, timeout: Duration) -> Result<Vec<String>, CommandError> {
        let mut own_buffer = self.own_buffer;
        let sent = own_buffer.send(self.connection()?, line, timeout);
        self.own_buffer = own_buffer;
        sent
    }

    /// The latest sample of `region`, decoded by `decode`, with its age; `None` before the first, or if the daemon does
    /// not mirror the region.
    pub(super) fn latest_view<T>(
        &mut self,
        region: RegionId,
        decode: impl FnOnce(&RegionInfo, &[u16]) -> Result<T, ClientError>,
    ) -> Result<Option<View<T>>, ClientError> {
        let condition = self.refresh()?;
        let reading = self.read(region, decode)?;
        self.judged(&Moment::now(&self.subscriber, condition), region, reading)
    }

    /// Copies and decodes the latest sample of `region`.
    fn read<T>(
        &mut self,
        region: RegionId,
        decode: impl FnOnce(&RegionInfo, &[u16]) -> Result<T, ClientError>,
    ) -> Result<Option<Reading<T>>, ClientError> {
        if self.latest(region)?.is_none() {
            return Ok(None);
        }
        let region = self.subscriber.region(region)?;
        let data = decode(&region, self.sample.words())?;
        Ok(Some(Reading::new(&self.sample, data)))
    }

    fn judged<T>(
        &self,
        moment: &Moment,
        region: RegionId,
        reading: Option<Reading<T>>,
    ) -> Result<Option<View<T>>, ClientError> {
        let Some(reading) = reading else { return Ok(None) };
        Ok(Some(moment.view(&self.subscriber.region(region)?, reading)))
    }

    /// Copies the latest sample of `region` and returns its number; `None` before the first, or if the daemon does not
    /// mirror the region.
    fn latest(&mut self, region: RegionId) -> Result<Option<u64>, ClientError> {
        match self.subscriber.latest(region, &mut self.sample) {
            Ok(found) => Ok(found),
            Err(SegmentError::NoSuchRegion(_)) => Ok(None),
            Err(error) => Err(error.into()),
        }
    }
}

/// The content of one sample of the board region.
struct Identified {
    /// The generation of its segment, and the sample's number there; 0 before the first.
    generation: u64,
    sequence: u64,
    identity: Identity,
    /// `None`: this version does not know the board's family.
    decoder: Option<Decoder>,
}

impl Identified {
    fn decoder(&self) -> Result<&Decoder, ClientError> {
        self.decoder.as_ref().ok_or_else(|| ClientError::Family(self.identity.family.unwrap_or_default()))
    }
}

#[cfg(test)]
mod tests;
