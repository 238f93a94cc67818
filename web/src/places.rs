//! The connections that the server serves at a time. When every place is taken, the connection that has been idle the
//! longest makes room for a new one.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::Notify;
use tokio::time::Instant;

/// How often a waiting connection looks for another that has been idle for long enough.
const LOOK: Duration = Duration::from_millis(100);

#[derive(Debug)]
struct Connection {
    /// Since when the client has asked nothing; `None` while the server answers.
    idle_since: Option<Instant>,
    ends: Arc<Notify>,
}

#[derive(Debug, Default)]
struct Connections {
    held: HashMap<u64, Connection>,
    next: u64,
}

/// The places, and the connections that have them.
#[derive(Debug)]
pub struct Places {
    most: usize,
    /// How long a connection may be idle when all places are taken.
    idle: Duration,
    connections: Mutex<Connections>,
    is_left: Notify,
}

/// A place, until it is dropped.
#[derive(Debug)]
pub struct Place {
    number: u64,
    ends: Arc<Notify>,
    places: Arc<Places>,
}

impl Places {
    /// `most` places. When all are taken, a connection that has been idle for `idle` may lose its place.
    #[must_use]
    pub fn new(most: usize, idle: Duration) -> Arc<Self> {
        Arc::new(Self { most, idle, connections: Mutex::default(), is_left: Notify::new() })
    }

    /// A place, as soon as one is free.
    pub async fn take(self: &Arc<Self>) -> Place {
        loop {
            if let Some(place) = self.try_take() {
                return place;
            }
            // Looks again when a connection has left its place, or after a while.
            let _ = tokio::time::timeout(LOOK, self.is_left.notified()).await;
        }
    }

    fn try_take(self: &Arc<Self>) -> Option<Place> {
        let mut connections = self.connections();
        if connections.held.len() >= self.most {
            let idle =
                connections.held.iter().filter_map(|(number, other)| Some((other.idle_since?, *number)));
            let (_, number) = idle.min().filter(|(since, _)| since.elapsed() >= self.idle)?;
            connections.held.remove(&number)?.ends.notify_one();
        }
        connections.next += 1;
        let (number, ends) = (connections.next, Arc::<Notify>::default());
        let connection = Connection { idle_since: Some(Instant::now()), ends: Arc::clone(&ends) };
        connections.held.insert(number, connection);
        Some(Place { number, ends, places: Arc::clone(self) })
    }

    fn connections(&self) -> MutexGuard<'_, Connections> {
        self.connections.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Place {
    /// The client asks.
    pub fn asks(&self) {
        self.idle_since(None);
    }

    /// The server has answered.
    pub fn is_answered(&self) {
        self.idle_since(Some(Instant::now()));
    }

    fn idle_since(&self, idle_since: Option<Instant>) {
        if let Some(own) = self.places.connections().held.get_mut(&self.number) {
            own.idle_since = idle_since;
        }
    }

    /// Returns when another connection has taken the place.
    pub async fn is_lost(&self) {
        self.ends.notified().await;
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        if self.places.connections().held.remove(&self.number).is_some() {
            self.places.is_left.notify_one();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn in_time<F: Future>(what: F) -> F::Output {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
        runtime.block_on(async { tokio::time::timeout(Duration::from_secs(10), what).await.unwrap() })
    }

    #[test]
    fn who_has_been_idle_the_longest_makes_room_and_who_asks_does_not() {
        in_time(async {
            let places = Places::new(3, Duration::ZERO);
            let [first, second, third] = [places.take().await, places.take().await, places.take().await];
            first.asks();
            third.asks();
            third.is_answered();
            let fourth = places.take().await;
            second.is_lost().await;
            fourth.asks();
            let fifth = places.take().await;
            third.is_lost().await;
            fifth.asks();
            assert!(places.try_take().is_none(), "each of them is answered");
            drop((second, third));
            assert!(places.try_take().is_none(), "these had lost theirs before");
            drop(first);
            let sixth = places.take().await;
            // A late answer on a connection that has lost its place does not count.
            let seventh = places.take().await;
            sixth.is_lost().await;
            sixth.is_answered();
            seventh.asks();
            assert!(places.try_take().is_none());
        });
    }

    #[test]
    fn who_has_just_come_keeps_his_place_for_a_while() {
        let places = Places::new(1, Duration::from_secs(3600));
        let place = places.try_take();
        assert!(place.is_some() && places.try_take().is_none());
        drop(place);
        assert!(places.try_take().is_some());
    }
}
