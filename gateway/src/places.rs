//! A fixed number of places for clients. A newcomer may take the place of a client who has long been silent.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// A client's place.
#[derive(Debug)]
struct Place<T> {
    tenant: T,
    /// The client's last request, or his arrival.
    since: Instant,
    /// After this silence the client makes room; `None`: never.
    gives_way: Option<Duration>,
}

/// Places for clients, each under a `K`. A `T` is the way to reach the client.
#[derive(Debug)]
pub struct Places<K, T> {
    taken: Mutex<BTreeMap<K, Place<T>>>,
    most: usize,
}

/// The result of a newcomer's request for a place.
#[derive(Debug)]
pub enum Taken<T> {
    /// The newcomer has a free place.
    Free,
    /// The newcomer has the place of this client, who was silent for so long.
    InsteadOf(T, Duration),
    /// All places are taken.
    Full,
}

impl<K: Ord + Clone, T> Places<K, T> {
    /// A set of `most` places.
    #[must_use]
    pub const fn new(most: usize) -> Self {
        Self { taken: Mutex::new(BTreeMap::new()), most }
    }

    fn taken(&self) -> MutexGuard<'_, BTreeMap<K, Place<T>>> {
        self.taken.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Gives the client `key` a place. Another client may take it after `gives_way` without a request from `key`.
    pub fn take(&self, key: K, tenant: T, gives_way: Duration, now: Instant) -> Taken<T> {
        let mut taken = self.taken();
        let mut found = Taken::Free;
        if taken.len() >= self.most {
            let silence = |place: &Place<T>| now.saturating_duration_since(place.since);
            let is_silent = |place: &Place<T>| place.gives_way.is_some_and(|limit| silence(place) >= limit);
            let silent = taken.iter().filter(|(_, place)| is_silent(place));
            let Some(key) = silent.max_by_key(|(_, place)| silence(place)).map(|(key, _)| key.clone()) else {
                return Taken::Full;
            };
            if let Some(place) = taken.remove(&key) {
                let silence = silence(&place);
                found = Taken::InsteadOf(place.tenant, silence);
            }
        }
        taken.insert(key, Place { tenant, since: now, gives_way: Some(gives_way) });
        found
    }

    /// The client `key` sent a request at `now`; another client may take the place after the silence `gives_way`.
    pub fn asks(&self, key: &K, gives_way: Option<Duration>, now: Instant) {
        if let Some(place) = self.taken().get_mut(key) {
            (place.since, place.gives_way) = (now, gives_way);
        }
    }

    /// Changes the silence after which another client may take the place of `key`; counts as no request.
    pub fn keeps(&self, key: &K, gives_way: Option<Duration>) {
        if let Some(place) = self.taken().get_mut(key) {
            place.gives_way = gives_way;
        }
    }

    /// The client `key` leaves.
    pub fn leave(&self, key: &K) {
        self.taken().remove(key);
    }

    /// Applies `look` to the client `key`; `None` if `key` has no place.
    pub fn with<R>(&self, key: &K, look: impl FnOnce(&T) -> R) -> Option<R> {
        self.taken().get(key).map(|place| look(&place.tenant))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_is_silent_the_longest_makes_room_and_who_holds_something_never() {
        const SHORT: Duration = Duration::from_secs(5);
        const LONG: Duration = Duration::from_secs(60);
        let (places, start) = (Places::new(3), Instant::now());
        for key in [1, 2, 3] {
            assert!(matches!(places.take(key, key, SHORT, start), Taken::Free));
        }
        places.asks(&1, None, start);
        places.asks(&2, Some(LONG), start);
        places.asks(&3, Some(LONG), start + SHORT);
        assert!(matches!(places.take(4, 4, SHORT, start + LONG - SHORT), Taken::Full));
        let told = places.take(4, 4, SHORT, start + 2 * LONG);
        assert!(matches!(told, Taken::InsteadOf(2, silence) if silence == 2 * LONG), "{told:?}");
        let told = places.take(5, 5, SHORT, start + 2 * LONG);
        assert!(matches!(told, Taken::InsteadOf(3, _)), "{told:?}");
        // A client without any request makes room before the first minute is over.
        assert!(matches!(places.take(6, 6, SHORT, start + 2 * LONG), Taken::Full));
        assert!(matches!(places.take(6, 6, SHORT, start + 2 * LONG + SHORT), Taken::InsteadOf(4 | 5, _)));
        for key in 1..7 {
            places.asks(&key, None, start + 3 * LONG);
        }
        assert!(matches!(places.take(7, 7, SHORT, start + 1000 * LONG), Taken::Full), "all hold something");
        assert_eq!(places.with(&1, |tenant| *tenant), Some(1));
        places.leave(&1);
        assert!(matches!(places.take(7, 7, SHORT, start + 1000 * LONG), Taken::Free));
    }
}
