//! One board, as a user of it sees it.
//!
//! Attached to the daemon's segment read-only. When the daemon is restarted the board attaches to the new segment by
//! itself; while there is none, the last data stay readable and say that they are old.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::command::{CommandError, Connection};
use super::identity;
use super::view::{Staleness, View};
use crate::decode::{BackgroundData, ServoData, TooShort, background_selected, servo_selected};
use crate::format::Float48Layout;
use crate::map::Selection;
use crate::segment::{
    Condition, DIRECTORY, Identity, RegionId, Sample, SegmentError, SegmentName, Subscriber, WaitOutcome,
};

/// How long a wait sleeps before it looks whether a new daemon has appeared.
const REATTACH: Duration = Duration::from_millis(100);

/// The board's data cannot be had.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ClientError {
    /// The segment cannot be attached to or read.
    #[error(transparent)]
    Segment(#[from] SegmentError),
    /// The segment's data are not those of the board it names.
    #[error("the segment's data cannot be decoded: {0}; use programs of one release")]
    Decode(#[from] TooShort),
    /// The board's data are laid out in a way that is not known here.
    #[error("the board's family (number {0}) is not known to this program; use a newer one")]
    Family(u32),
}

/// Where the socket of the daemon of `name` lies unless it was told otherwise.
#[must_use]
pub fn socket_path(name: &SegmentName) -> PathBuf {
    Path::new("/run/pmacd").join(format!("{}.sock", name.as_str()))
}

/// Everything the segment has, at one moment.
#[derive(Debug, Clone, PartialEq)]
pub struct Snapshot {
    /// Who the board is, as far as it is known.
    pub identity: Identity,
    /// Servo data; `None` before the first.
    pub servo: Option<View<ServoData>>,
    /// Background data; `None` before the first.
    pub background: Option<View<BackgroundData>>,
    /// Why nothing here is live, whatever the regions say.
    pub stale: Option<Staleness>,
}

/// A stretch of past servo data.
#[derive(Debug, Clone, PartialEq)]
pub struct History {
    /// What is still there, oldest first.
    pub samples: Vec<View<ServoData>>,
    /// How many samples of the stretch asked for were overwritten already. Exact.
    pub lost: u64,
    /// The number to ask for next.
    pub next: u64,
}

/// A board with a daemon.
pub struct Board {
    name: SegmentName,
    directory: PathBuf,
    socket: PathBuf,
    subscriber: Subscriber,
    sample: Sample,
    connection: Option<Connection>,
}

impl Board {
    /// Attaches to the board called `name`, as in `--name`: `pmac0`.
    ///
    /// # Errors
    /// [`ClientError::Segment`] when there is no such segment or it is not to be trusted.
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
            connection: None,
        })
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

    /// The segment, for what has no method here. Another one after the daemon was restarted.
    #[must_use]
    pub fn subscriber(&self) -> &Subscriber {
        &self.subscriber
    }

    /// Attaches to the segment of a new daemon if the old one is over and there is a new one. Done by every other
    /// method that reads.
    ///
    /// # Errors
    /// [`ClientError::Segment`] when there is a new one that cannot be attached to.
    pub fn refresh(&mut self) -> Result<Condition, ClientError> {
        let condition = self.subscriber.condition();
        if !condition.is_over() {
            return Ok(condition);
        }
        match Subscriber::attach_in(&self.directory, &self.name) {
            Ok(found) if found.generation() == self.subscriber.generation() => Ok(condition),
            Ok(found) => {
                self.subscriber = found;
                Ok(self.subscriber.condition())
            }
            Err(SegmentError::NotFound { .. }) => Ok(condition),
            Err(error) => Err(error.into()),
        }
    }

    /// Who the board is, as far as it is known.
    ///
    /// # Errors
    /// [`ClientError::Segment`] when the segment is corrupt.
    pub fn identity(&mut self) -> Result<Identity, ClientError> {
        Ok(self
            .latest(RegionId::Board)?
            .and_then(|()| Identity::decode(self.sample.bytes()))
            .unwrap_or_default())
    }

    /// Everything the segment has now.
    ///
    /// # Errors
    /// [`ClientError`] when the segment is corrupt or of a board that is not known here. Old data are no error.
    pub fn snapshot(&mut self) -> Result<Snapshot, ClientError> {
        self.refresh()?;
        let identity = self.identity()?;
        let decoder = Decoder::new(&identity)?;
        let servo = match self.latest(RegionId::Servo)? {
            Some(()) => Some(self.view(RegionId::Servo, |words, selection| decoder.servo(words, selection))?),
            None => None,
        };
        let background = match self.latest(RegionId::Background)? {
            Some(()) => Some(
                self.view(RegionId::Background, |words, selection| decoder.background(words, selection))?,
            ),
            None => None,
        };
        let stale = self.staleness(self.subscriber.now_ns());
        Ok(Snapshot { identity, servo, background, stale })
    }

    /// The number of the latest servo sample; 0 when there is none.
    ///
    /// # Errors
    /// [`ClientError::Segment`] when the segment has no servo data.
    pub fn servo_sequence(&self) -> Result<u64, ClientError> {
        Ok(self.subscriber.published(RegionId::Servo)?)
    }

    /// Sleeps until there is a servo sample newer than number `after`, at most `timeout`; false when there is none.
    /// When the daemon is restarted meanwhile, the first sample of the new one is newer: its numbers start again.
    ///
    /// # Errors
    /// [`ClientError::Segment`].
    pub fn wait(&mut self, after: u64, timeout: Duration) -> Result<bool, ClientError> {
        let now = Instant::now();
        let deadline = now.checked_add(timeout);
        let generation = self.subscriber.generation();
        loop {
            let left = deadline.map_or(REATTACH, |end| end.saturating_duration_since(Instant::now()));
            self.refresh()?;
            let after = if self.subscriber.generation() == generation { after } else { 0 };
            match self.subscriber.wait_newer(RegionId::Servo, after, left)? {
                WaitOutcome::Newer => return Ok(true),
                WaitOutcome::TimedOut if deadline.is_some() => return Ok(false),
                WaitOutcome::TimedOut => {}
                WaitOutcome::Dead if left.is_zero() => return Ok(false),
                WaitOutcome::Dead => std::thread::sleep(REATTACH.min(left)),
            }
        }
    }

    /// Servo samples from number `since` on, at most `most` of them, and exactly how many of that stretch are lost.
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn history(&mut self, since: u64, most: usize) -> Result<History, ClientError> {
        self.refresh()?;
        let identity = self.identity()?;
        let decoder = Decoder::new(&identity)?;
        let mut cursor = self.subscriber.cursor(RegionId::Servo, since)?;
        let mut samples = Vec::new();
        while samples.len() < most && cursor.next(&self.subscriber, &mut self.sample)? {
            samples.push(self.view(RegionId::Servo, |words, selection| decoder.servo(words, selection))?);
        }
        Ok(History { samples, lost: cursor.lost(), next: cursor.position() })
    }

    /// The connection to the daemon, made when it is first asked for.
    ///
    /// # Errors
    /// [`CommandError::Connect`].
    pub fn connection(&mut self) -> Result<&mut Connection, CommandError> {
        let connection = match self.connection.take() {
            Some(connection) => connection,
            None => Connection::open(&self.socket)?,
        };
        Ok(self.connection.insert(connection))
    }

    /// Sends one command line through the daemon; see [`Connection::send`].
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn send(&mut self, line: &str, timeout: Duration) -> Result<Vec<String>, CommandError> {
        self.connection()?.send(line, timeout)
    }

    /// Copies the latest sample of `region`; `None` when there is none, or the daemon does not mirror it at all.
    pub(super) fn latest(&mut self, region: RegionId) -> Result<Option<()>, ClientError> {
        match self.subscriber.latest(region, &mut self.sample) {
            Ok(found) => Ok(found.map(|_| ())),
            Err(SegmentError::NoSuchRegion(_)) => Ok(None),
            Err(error) => Err(error.into()),
        }
    }

    /// Why nothing in the segment is live at `now_ns`.
    fn staleness(&self, now_ns: u64) -> Option<Staleness> {
        Staleness::of_segment(self.subscriber.condition(), &self.subscriber.header(), now_ns)
    }

    pub(super) fn view<T>(
        &self,
        region: RegionId,
        decode: impl FnOnce(&[u16], Selection) -> Result<T, TooShort>,
    ) -> Result<View<T>, ClientError> {
        let region = self.subscriber.region(region)?;
        let data = decode(self.sample.words(), region.selection)?;
        // After the data were copied: what was live a moment ago and is not now is not shown as live.
        let now_ns = self.subscriber.now_ns();
        let stamp = self.sample.stamp();
        let stale = self.staleness(now_ns).or_else(|| Staleness::of_sample(&region, &stamp, now_ns));
        let time_ns = stamp.time_ns;
        let offset = self.subscriber.header().realtime_offset_ns;
        Ok(View {
            sequence: self.sample.sequence(),
            time_ns,
            realtime_ns: i64::try_from(time_ns).unwrap_or(i64::MAX).saturating_add(offset),
            age_ns: now_ns.saturating_sub(time_ns),
            servo_timer: stamp.servo_timer,
            stale,
            data,
        })
    }
}

/// What is needed to decode a board's words.
struct Decoder {
    count: usize,
    scales: crate::decode::Scales,
}

impl Decoder {
    fn new(identity: &Identity) -> Result<Self, ClientError> {
        let family = identity::family(identity)
            .ok_or_else(|| ClientError::Family(identity.family.unwrap_or_default()))?;
        Ok(Self { count: identity::reported(identity, family), scales: identity::scales(identity) })
    }

    fn servo(&self, words: &[u16], selection: Selection) -> Result<ServoData, TooShort> {
        self.as_many_as_there_are(|count| servo_selected(words, count, &self.scales, selection))
    }

    fn background(&self, words: &[u16], selection: Selection) -> Result<BackgroundData, TooShort> {
        let layout = Float48Layout::default();
        self.as_many_as_there_are(|count| background_selected(words, count, &self.scales, layout, selection))
    }

    /// Decodes fewer motors when a sample is from before the board was told to report more.
    fn as_many_as_there_are<T>(&self, decode: impl Fn(usize) -> Result<T, TooShort>) -> Result<T, TooShort> {
        let fewer = || (0..self.count).rev().find_map(|count| decode(count).ok());
        decode(self.count).or_else(|error| fewer().ok_or(error))
    }
}
