//! Other clients' stops that end the awaited motion. The daemon reports them; the board's reports name no client.

use std::time::{Duration, Instant};

use crate::client::{Connection, Snapshot};
use crate::protocol::board::SentStop;

/// The wait asks the daemon this often.
const ASK_STOPS_EVERY: Duration = Duration::from_millis(100);

/// The stops from other connections than this one.
pub struct Stops {
    /// The last stop before the request; `None` if the daemon does not report stops (any more).
    last: Option<u64>,
    due: Instant,
    since: Vec<SentStop>,
}

impl Stops {
    /// Begins before the request, which uses the same connection.
    pub fn begin(connection: &mut Connection) -> Self {
        let told = connection.info().ok();
        let last = told.map(|info| info.stops.last().map_or(0, |stop| stop.number));
        Self { last, due: Instant::now(), since: Vec::new() }
    }

    /// Asks the daemon, if that is due.
    pub fn look(&mut self, connection: &mut Connection) {
        if Instant::now() >= self.due {
            self.ask(connection);
        }
    }

    /// Asks the daemon.
    pub fn ask(&mut self, connection: &mut Connection) {
        let Some(last) = self.last else { return };
        self.due = Instant::now() + ASK_STOPS_EVERY;
        let told = connection.info().ok();
        // Do not ask a silent daemon again: the question would go over a new connection, and our own request would
        // count as another client's.
        self.last = told.as_ref().map(|info| info.stops.last().map_or(last, |stop| stop.number.max(last)));
        let new = told.into_iter().flat_map(|info| info.stops).filter(|stop| stop.number > last);
        self.since.extend(new);
    }

    /// The last stop that `concerns` the awaited motion.
    pub fn last(&self, concerns: impl Fn(&SentStop) -> bool) -> Option<&SentStop> {
        self.since.iter().rev().find(|stop| concerns(stop))
    }
}

/// Whether `stop` stops motor `number`, by itself or through its coordinate system, or sends the motor elsewhere.
pub fn stops_motor(number: u8, stop: &SentStop, snapshot: &Snapshot) -> bool {
    let system = system_of(number.into(), snapshot);
    stop.motors.contains(&number.into())
        || stop.coordinate_systems.iter().any(|stopped| Some(*stopped as usize) == system)
}

/// Whether `stop` ends the program of coordinate system `number`.
pub fn ends_program(number: u8, stop: &SentStop, _: &Snapshot) -> bool {
    stop.coordinate_systems.contains(&number.into())
}

/// The coordinate system that a motor belongs to, as the background report tells.
pub fn system_of(motor: usize, snapshot: &Snapshot) -> Option<usize> {
    let background = snapshot.background.as_ref()?;
    background
        .data
        .motors
        .iter()
        .find(|other| other.motor == motor)?
        .coordinate_system
        .map(|system| system as usize)
}
