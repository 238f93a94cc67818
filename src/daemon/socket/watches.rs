//! Which client watches which registers. Clients that watch the same register share one entry of PMAC's table.
//!
//! Observers together get three quarters of the table, and no observer more than half.

use std::collections::{BTreeMap, HashSet};
use std::time::{Duration, Instant};

use log::error;
use nix::unistd::Uid;

use crate::daemon::shared::queue::{Outcome, Ticket};
use crate::function::variable_read::VariableEntry;

/// How long the daemon waits before it sends a table again that the board did not take.
const TABLE_AGAIN: Duration = Duration::from_secs(1);

/// Entries that one observer can take.
const fn of_observer(room: usize) -> usize {
    room / 2
}

/// Entries that observers can take together.
const fn of_observers(room: usize) -> usize {
    room / 4 * 3
}

/// The table has no entry left.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(super) enum NoneLeft {
    /// For any client.
    #[error(
        "PMAC's table has room for {room} registers ([plan] variable_read_entries, at most 128); {used} are in use, {wanted} more are \
         wanted: close a watch, or watch fewer"
    )]
    Full { room: usize, used: usize, wanted: usize },
    /// For a user who may only observe.
    #[error(
        "of the {room} registers that PMAC's table has room for, users who only observe get {} each and {} together: close a \
         watch, or watch fewer",
        of_observer(*room),
        of_observers(*room)
    )]
    Observers { room: usize },
}

/// How far a watch is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Progress {
    /// The client's registers are not in the table that the bus thread has.
    Wanted,
    /// The registers are in the table that the bus thread is writing.
    UnderWay,
    /// The registers are in the board's table, and the daemon has told the client.
    Told,
}

/// One client's registers.
#[derive(Debug)]
struct Watch {
    entries: Vec<VariableEntry>,
    /// The client's user, if that user may only observe.
    observer: Option<Uid>,
    progress: Progress,
}

/// Every client's registers.
#[derive(Debug)]
pub(super) struct Watches {
    /// Entries that the plan keeps.
    room: usize,
    clients: BTreeMap<u64, Watch>,
    /// The table as it should be on the board; the bus thread starts with an empty one.
    table: Vec<VariableEntry>,
    /// The bus thread has an older table.
    is_dirty: bool,
    /// The number of the table that the board took last.
    number: Option<u32>,
    /// The table that the bus thread is writing. The next one waits for it, so that fast changes do not fill the queue.
    under_way: Option<Ticket>,
    /// When to send the table again, if the board did not take the last one.
    again: Option<Instant>,
    /// The log has an entry on the failure.
    is_logged: bool,
}

impl Watches {
    /// No registers yet, in a table of `room` entries.
    pub(super) fn new(room: usize) -> Self {
        Self {
            room,
            clients: BTreeMap::new(),
            table: Vec::new(),
            is_dirty: false,
            number: None,
            under_way: None,
            again: None,
            is_logged: false,
        }
    }

    /// `client` watches `entries` in place of its earlier registers; `observer` is the client's user if that user may
    /// only observe. Returns the number of the board's table if the table has all entries already. Otherwise
    /// [`Self::taken`] or [`Self::failed`] names the client later.
    ///
    /// # Errors
    /// The table has too few entries left; this changes nothing then.
    pub(super) fn watch(
        &mut self,
        client: u64,
        entries: Vec<VariableEntry>,
        observer: Option<Uid>,
    ) -> Result<Option<u32>, NoneLeft> {
        let before = self.clients.insert(client, Watch { entries, observer, progress: Progress::Wanted });
        let table = self.merged();
        let room = self.room;
        let is_full = table.len() > room;
        let is_beyond_share = observer.is_some()
            && (self.count(|other| other == observer) > of_observer(room)
                || self.count(|other| other.is_some()) > of_observers(room));
        if is_full || is_beyond_share {
            match before {
                Some(before) => self.clients.insert(client, before),
                None => self.clients.remove(&client),
            };
            let used = self.merged().len();
            return Err(if is_full {
                NoneLeft::Full { room, used, wanted: table.len().saturating_sub(used) }
            } else {
                NoneLeft::Observers { room }
            });
        }
        self.adopt(table);
        let (progress, number) = match (self.is_dirty, self.under_way, self.number) {
            (true, ..) => (Progress::Wanted, None),
            (false, None, Some(number)) => (Progress::Told, Some(number)),
            (false, ..) => (Progress::UnderWay, None),
        };
        if let Some(watch) = self.clients.get_mut(&client) {
            watch.progress = progress;
        }
        Ok(number)
    }

    /// How many registers `client` watches.
    pub(super) fn count_of(&self, client: u64) -> usize {
        self.clients.get(&client).map_or(0, |watch| watch.entries.len())
    }

    /// How many different registers the clients watch whose observer is one of `those`.
    fn count(&self, those: impl Fn(Option<Uid>) -> bool) -> usize {
        let watches = self.clients.values().filter(|watch| those(watch.observer));
        watches.flat_map(|watch| &watch.entries).collect::<HashSet<_>>().len()
    }

    /// `client` is gone.
    pub(super) fn forget(&mut self, client: u64) {
        if self.clients.remove(&client).is_some() {
            let table = self.merged();
            self.adopt(table);
        }
    }

    /// How many registers the clients watch.
    pub(super) fn watched(&self) -> usize {
        self.table.len()
    }

    /// The table for the bus thread, if it has changed since the bus thread got the last one.
    pub(super) fn update(&self, now: Instant) -> Option<Vec<VariableEntry>> {
        let may_send = self.under_way.is_none() && self.again.is_none_or(|again| again <= now);
        (self.is_dirty && may_send).then(|| self.table.clone())
    }

    /// When the daemon sends a table again that the board did not take.
    pub(super) fn next_try(&self) -> Option<Instant> {
        self.again
    }

    /// The bus thread has got the table, under `ticket`.
    pub(super) fn sent(&mut self, ticket: Ticket) {
        self.is_dirty = false;
        self.again = None;
        self.under_way = Some(ticket);
        for watch in self.clients.values_mut().filter(|watch| watch.progress == Progress::Wanted) {
            watch.progress = Progress::UnderWay;
        }
    }

    /// The board has taken the table of `ticket`, as number `table`. Returns the clients to tell.
    pub(super) fn taken(&mut self, ticket: Ticket, table: u32) -> Vec<u64> {
        if self.under_way != Some(ticket) {
            return Vec::new();
        }
        self.under_way = None;
        self.number = Some(table);
        self.is_logged = false;
        let under_way = |(_, watch): &(&u64, &mut Watch)| watch.progress == Progress::UnderWay;
        self.clients
            .iter_mut()
            .filter(under_way)
            .map(|(client, watch)| {
                watch.progress = Progress::Told;
                *client
            })
            .collect()
    }

    /// If `ticket` is a table's, the board did not take that table. Returns the clients that waited for it; these watch
    /// nothing any more.
    pub(super) fn failed(&mut self, ticket: Ticket, outcome: Outcome, now: Instant) -> Vec<u64> {
        if self.under_way != Some(ticket) {
            return Vec::new();
        }
        self.under_way = None;
        self.number = None;
        if !std::mem::replace(&mut self.is_logged, true) {
            let count = self.table.len();
            error!("the table of {count} watched registers was not taken, trying again: {outcome:?}");
        }
        let waiting = self.clients.iter().filter(|(_, watch)| watch.progress == Progress::UnderWay);
        let waiting: Vec<u64> = waiting.map(|(client, _)| *client).collect();
        for client in &waiting {
            self.clients.remove(client);
        }
        let was_dirty = std::mem::replace(&mut self.is_dirty, true);
        self.table = self.merged();
        // The daemon may send a newer table at once.
        self.again = (!was_dirty).then_some(now + TABLE_AGAIN);
        waiting
    }

    /// Every watched register once. Registers that stay keep their place, so that a change rewrites few entries.
    fn merged(&self) -> Vec<VariableEntry> {
        let mut missing: HashSet<VariableEntry> = self.entries().copied().collect();
        let mut table = self.table.clone();
        table.retain(|entry| missing.remove(entry));
        table.extend(self.entries().filter(|entry| missing.remove(*entry)));
        table
    }

    fn entries(&self) -> impl Iterator<Item = &VariableEntry> {
        self.clients.values().flat_map(|watch| &watch.entries)
    }

    fn adopt(&mut self, table: Vec<VariableEntry>) {
        if table != self.table {
            self.table = table;
            self.is_dirty = true;
            self.again = None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::VariableKind;

    fn entries(addresses: std::ops::Range<u32>) -> Vec<VariableEntry> {
        addresses.map(|address| VariableEntry { address, kind: VariableKind::X }).collect()
    }

    #[test]
    fn equal_requests_share_and_are_freed_with_the_last() {
        let now = Instant::now();
        let mut watches = Watches::new(128);
        assert_eq!(watches.update(now), None);
        watches.watch(1, entries(0..100), None).unwrap();
        watches.watch(2, entries(50..128), None).unwrap();
        assert_eq!(watches.update(now).unwrap().len(), 128);
        watches.sent(Ticket(1));
        watches.taken(Ticket(1), 1);
        let error = watches.watch(3, entries(120..130), None).unwrap_err();
        assert_eq!(error, NoneLeft::Full { room: 128, used: 128, wanted: 2 });
        watches.watch(3, entries(0..128), None).unwrap();
        assert_eq!(watches.update(now), None, "nothing new for the board");
        watches.forget(3);
        watches.forget(1);
        assert_eq!(watches.update(now), Some(entries(50..128)));
        watches.sent(Ticket(2));
        watches.forget(2);
        assert_eq!(watches.update(now), None, "the bus thread is still at the table before");
        watches.taken(Ticket(1), 1);
        assert_eq!(watches.update(now), None);
        watches.taken(Ticket(2), 2);
        assert_eq!(watches.update(now), Some(Vec::new()));
    }

    #[test]
    fn observers_leave_entries_to_each_other_and_to_operators() {
        let (now, none_left) = (Instant::now(), NoneLeft::Observers { room: 128 });
        let observer = |number| Some(Uid::from_raw(number));
        let mut watches = Watches::new(128);
        watches.watch(1, entries(0..64), observer(1)).unwrap();
        assert_eq!(watches.watch(2, entries(64..65), observer(1)), Err(none_left));
        watches.watch(2, entries(0..64), observer(2)).unwrap();
        watches.watch(3, entries(64..96), observer(3)).unwrap();
        assert_eq!(watches.watch(4, entries(96..97), observer(4)), Err(none_left));
        assert_eq!(watches.watch(3, entries(64..97), observer(3)), Err(none_left));
        watches.watch(4, entries(0..4), observer(4)).unwrap();
        watches.watch(5, entries(96..128), None).unwrap();
        let full = NoneLeft::Full { room: 128, used: 128, wanted: 1 };
        assert_eq!(watches.watch(5, entries(96..129), None), Err(full));
        assert_eq!(watches.update(now).unwrap(), entries(0..128));
    }

    #[test]
    fn no_more_than_the_plan_keeps_can_be_watched() {
        let mut watches = Watches::new(64);
        watches.watch(1, entries(0..64), None).unwrap();
        let full = NoneLeft::Full { room: 64, used: 64, wanted: 1 };
        assert_eq!(watches.watch(1, entries(0..65), None), Err(full));
        assert!(full.to_string().contains("room for 64 registers"), "{full}");
        let observer = Some(Uid::from_raw(1));
        let error = Watches::new(64).watch(1, entries(0..33), observer).unwrap_err();
        assert!(error.to_string().contains("get 32 each and 48 together"), "{error}");
        assert!(Watches::new(0).watch(1, entries(0..1), None).is_err());
    }

    #[test]
    fn a_table_that_is_not_taken_is_sent_again() {
        let now = Instant::now();
        let refused = Outcome::Unavailable { port: crate::protocol::CommandPort::Dpram, page: None };
        let mut watches = Watches::new(128);
        watches.watch(1, entries(0..2), None).unwrap();
        watches.sent(Ticket(1));
        assert_eq!(watches.taken(Ticket(1), 7), [1]);
        watches.watch(2, entries(0..4), None).unwrap();
        watches.sent(Ticket(2));
        assert_eq!(watches.failed(Ticket(2), refused, now), [2], "who waits for it hears so");
        assert!(watches.is_logged);
        assert_eq!((watches.update(now), watches.next_try()), (None, Some(now + TABLE_AGAIN)), "not at once");
        assert_eq!(watches.update(now + TABLE_AGAIN), Some(entries(0..2)));
        watches.sent(Ticket(3));
        assert_eq!(watches.next_try(), None);
        // The failure of the earlier table does not delay a newer one.
        watches.watch(1, entries(0..3), None).unwrap();
        assert!(watches.failed(Ticket(3), refused, now).is_empty());
        assert_eq!(watches.update(now), Some(entries(0..3)));
        watches.sent(Ticket(4));
        assert_eq!(watches.taken(Ticket(4), 8), [1]);
        assert!(!watches.is_logged && watches.update(now + TABLE_AGAIN).is_none());
    }

    #[test]
    fn a_watch_is_told_when_its_registers_are_in_the_boards_table() {
        let now = Instant::now();
        let mut watches = Watches::new(128);
        assert_eq!(watches.watch(1, entries(0..2), None), Ok(None));
        watches.sent(Ticket(1));
        assert_eq!(watches.watch(2, entries(0..1), None), Ok(None), "in the table under way");
        assert_eq!(watches.watch(3, entries(2..3), None), Ok(None), "in the next one");
        assert_eq!(watches.taken(Ticket(1), 4), [1, 2]);
        assert_eq!(watches.update(now), Some(entries(0..3)));
        watches.sent(Ticket(2));
        assert_eq!(watches.taken(Ticket(2), 5), [3]);
        assert_eq!(watches.watch(4, entries(1..3), None), Ok(Some(5)), "at once");
        assert!(watches.taken(Ticket(77), 6).is_empty());
    }
}
