//! The one thread that reads the board: its state five times a second, and every servo update for those who look at a scope.

use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use log::{info, warn};
use pmac_dpram::client::{Board, ClientError, Staleness, View, identity};
use pmac_dpram::decode::ServoData;
use tokio::sync::{broadcast, watch};

use crate::board::Place;
use crate::state;

/// How often updates are handed on.
const PAUSE: Duration = Duration::from_millis(40);
/// How often the state is.
const STATE: Duration = Duration::from_millis(200);
/// How long to wait before a board that is not there is looked for again.
const ABSENT: Duration = Duration::from_secs(1);
/// The most updates to hand on at once: more than a board makes in a pause.
const BATCH: usize = 2048;
/// Batches that a client may be behind before it loses the oldest: two seconds.
const BEHIND: usize = 50;

/// Servo updates in a row.
#[derive(Debug)]
pub struct Batch {
    /// Another number is another daemon: the updates' numbers and times begin anew.
    pub generation: u64,
    /// A servo cycle in seconds, where the board has told.
    pub cycle_s: Option<f64>,
    /// The updates.
    pub updates: Vec<View<ServoData>>,
    /// Updates before these that this program did not take in time.
    pub lost: u64,
    /// Why nothing comes after these, if so.
    pub stale: Option<Staleness>,
}

/// Where the network's side takes what is read.
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
    /// The system starts none.
    pub fn start(place: Place) -> std::io::Result<Self> {
        let first = state::absent(&place.label(), "pmac-web has not looked yet");
        let (sender, state) = watch::channel(first);
        let (batches, _) = broadcast::channel(BEHIND);
        let feed = Self { state, batches: batches.clone() };
        thread::Builder::new().name("feed".to_owned()).spawn(move || follow(&place, &sender, &batches))?;
        Ok(feed)
    }

    /// Every batch from now on.
    #[must_use]
    pub fn batches(&self) -> broadcast::Receiver<Arc<Batch>> {
        self.batches.subscribe()
    }
}

fn follow(place: &Place, state: &watch::Sender<Arc<str>>, batches: &broadcast::Sender<Arc<Batch>>) {
    let mut told = None;
    while !state.is_closed() {
        let ended = place.attach().and_then(|mut board| {
            info!("board {}", board.name().as_str());
            told = None;
            read(&mut board, state, batches)
        });
        let Err(why) = ended else { return };
        let why = why.to_string();
        state.send_replace(state::absent(&place.label(), &why));
        // Once: it may stay so for days.
        if told.as_ref() != Some(&why) {
            warn!("{why}");
            told = Some(why);
        }
        thread::sleep(ABSENT);
    }
}

/// Reads `board` until nobody listens any more, or it can't be read.
fn read(
    board: &mut Board,
    state: &watch::Sender<Arc<str>>,
    batches: &broadcast::Sender<Arc<Batch>>,
) -> Result<(), ClientError> {
    let mut state_due = Instant::now();
    let mut next = None;
    while !state.is_closed() {
        let now = Instant::now();
        if now >= state_due {
            state_due = now + STATE;
            state.send_replace(state::of(board)?);
        }
        // Decoding every update is for those who look.
        next = if batches.receiver_count() > 0 {
            let (batch, after) = batch(board, next)?;
            let _ = batches.send(Arc::new(batch));
            Some(after)
        } else {
            None
        };
        thread::sleep(PAUSE);
    }
    Ok(())
}

/// The updates since `next`, a generation and a number; without one, from now on.
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
