//! The one thread that reads the board: its state five times a second, and every servo update for clients with a
//! scope.

use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use log::{info, warn};
use pmac_dpram::client::{Board, ClientError, Staleness, View, identity};
use pmac_dpram::decode::ServoData;
use tokio::sync::{broadcast, watch};

use crate::board::Place;
use crate::state;
use crate::watch::Watched;

/// How often the thread hands updates on.
const PAUSE: Duration = Duration::from_millis(40);
/// How often the thread hands the state on.
const STATE: Duration = Duration::from_millis(200);
/// How long the thread waits before it looks for an absent board again.
const ABSENT: Duration = Duration::from_secs(1);
/// The most updates that the thread hands on at once: more than a board makes in a pause.
const BATCH: usize = 2048;
/// Batches that a client may be behind before it loses the oldest: two seconds.
const BEHIND: usize = 50;

/// Servo updates in a row.
#[derive(Debug)]
pub struct Batch {
    /// Another number means another daemon: the updates' numbers and times begin anew.
    pub generation: u64,
    /// A servo cycle in seconds, if the board has told it.
    pub cycle_s: Option<f64>,
    /// The updates.
    pub updates: Vec<View<ServoData>>,
    /// Updates before these that this program did not take in time.
    pub lost: u64,
    /// Why no updates follow these, if none follow.
    pub stale: Option<Staleness>,
}

/// Hands the thread's data to the network's side.
#[derive(Debug, Clone)]
pub struct Feed {
    /// The state as JSON.
    pub state: watch::Receiver<Arc<str>>,
    batches: broadcast::Sender<Arc<Batch>>,
}

impl Feed {
    /// Starts the thread.
    ///
    /// # Errors
    /// The system starts no thread.
    pub fn start(place: Place, watched: watch::Receiver<Watched>) -> std::io::Result<Self> {
        let first = state::absent(&place.label(), "pmac-web has not looked yet");
        let (sender, state) = watch::channel(first);
        let (batches, _) = broadcast::channel(BEHIND);
        let feed = Self { state, batches: batches.clone() };
        let out = Out { state: sender, batches, watched };
        thread::Builder::new().name("feed".to_owned()).spawn(move || follow(&place, &out))?;
        Ok(feed)
    }

    /// Every batch from now on.
    #[must_use]
    pub fn batches(&self) -> broadcast::Receiver<Arc<Batch>> {
        self.batches.subscribe()
    }
}

/// The thread's side of the feed.
struct Out {
    state: watch::Sender<Arc<str>>,
    batches: broadcast::Sender<Arc<Batch>>,
    watched: watch::Receiver<Watched>,
}

fn follow(place: &Place, out: &Out) {
    let mut told = None;
    while !out.state.is_closed() {
        let ended = place.attach().and_then(|mut board| {
            info!("board {}", board.name().as_str());
            told = None;
            read(&mut board, out)
        });
        let Err(why) = ended else { return };
        let why = why.to_string();
        out.state.send_replace(state::absent(&place.label(), &why));
        // Warn once: the board may be absent for days.
        if told.as_ref() != Some(&why) {
            warn!("{why}");
            told = Some(why);
        }
        thread::sleep(ABSENT);
    }
}

/// Reads `board` until no client listens any more, or until reading fails.
fn read(board: &mut Board, out: &Out) -> Result<(), ClientError> {
    let mut state_due = Instant::now();
    let mut next = None;
    while !out.state.is_closed() {
        let now = Instant::now();
        if now >= state_due {
            state_due = now + STATE;
            out.state.send_replace(state::of(board, &out.watched.borrow())?);
        }
        // Decodes every update only for clients with a scope.
        next = if out.batches.receiver_count() > 0 {
            let (batch, after) = batch(board, next)?;
            let _ = out.batches.send(Arc::new(batch));
            Some(after)
        } else {
            None
        };
        thread::sleep(PAUSE);
    }
    Ok(())
}

/// The updates since `next`, a generation and a number; without `next` the updates from now on.
fn batch(board: &mut Board, next: Option<(u64, u64)>) -> Result<(Batch, (u64, u64)), ClientError> {
    board.refresh()?;
    let generation = board.subscriber().generation();
    let from = match next {
        Some((was, number)) if was == generation => number,
        Some(_) => 1,
        None => board.servo_sequence()? + 1,
    };
    let history = board.history(from, BATCH)?;
    let scales = identity::scales(&board.identity()?);
    let stale = board.snapshot()?.servo.and_then(|servo| servo.stale);
    let batch = Batch {
        generation,
        cycle_s: scales.servo_period_ns().map(|period| period / 1e9),
        updates: history.samples,
        lost: history.lost,
        stale,
    };
    Ok((batch, (generation, history.next)))
}
