//! Who watches which registers: equal requests of many clients share one entry of PMAC's table of 128.
//!
//! Users who may only look leave a quarter of it to the others, and no one of them gets more than half.

use std::collections::{BTreeMap, HashSet};

use nix::unistd::Uid;

use super::queue::Ticket;
use crate::function::variable_read::VariableEntry;
use crate::map::classic::VARIABLE_READ_ENTRIES;

/// Entries that observers can take, one of them and all together.
const OF_OBSERVER: usize = VARIABLE_READ_ENTRIES / 2;
const OF_OBSERVERS: usize = VARIABLE_READ_ENTRIES / 4 * 3;

/// No entry is left.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(super) enum NoneLeft {
    /// For anybody.
    #[error(
        "PMAC reads {VARIABLE_READ_ENTRIES} registers at most; {used} are in use, {wanted} more are wanted: close a watch, or \
         watch fewer"
    )]
    Full { used: usize, wanted: usize },
    /// For one who may only look.
    #[error(
        "of PMAC's {VARIABLE_READ_ENTRIES} registers, users who only observe get {OF_OBSERVER} each and {OF_OBSERVERS} together: \
         close a watch, or watch fewer"
    )]
    Observers,
}

/// What one client watches.
#[derive(Debug)]
struct Watch {
    entries: Vec<VariableEntry>,
    /// Whose it is, if he may only look.
    observer: Option<Uid>,
}

/// Every client's registers.
#[derive(Debug, Default)]
pub(super) struct Subscriptions {
    clients: BTreeMap<u64, Watch>,
    /// The table as it should be on the board; the bus thread starts with an empty one.
    table: Vec<VariableEntry>,
    /// The bus thread has another one.
    is_news: bool,
    /// What the bus thread was told last, until it has heard it: tables that change faster than that do not fill its queue.
    telling: Option<Ticket>,
}

impl Subscriptions {
    /// `client` watches `entries`, instead of what it watched before; `observer` is its user if he may only look.
    ///
    /// # Errors
    /// When there are not enough entries left; nothing is changed then.
    pub(super) fn watch(
        &mut self,
        client: u64,
        entries: Vec<VariableEntry>,
        observer: Option<Uid>,
    ) -> Result<(), NoneLeft> {
        let before = self.clients.insert(client, Watch { entries, observer });
        let table = self.merged();
        let refused = if table.len() > VARIABLE_READ_ENTRIES {
            Some(table.len())
        } else if observer.is_some()
            && (self.count(|other| other == observer) > OF_OBSERVER
                || self.count(|other| other.is_some()) > OF_OBSERVERS)
        {
            Some(0)
        } else {
            None
        };
        let Some(needed) = refused else {
            self.adopt(table);
            return Ok(());
        };
        match before {
            Some(before) => self.clients.insert(client, before),
            None => self.clients.remove(&client),
        };
        let used = self.merged().len();
        Err(match needed.checked_sub(used) {
            Some(wanted) => NoneLeft::Full { used, wanted },
            None => NoneLeft::Observers,
        })
    }

    /// Different registers that the clients of `those` watch.
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

    /// Registers that are watched.
    pub(super) fn watched(&self) -> usize {
        self.table.len()
    }

    /// The table to tell the bus thread, if it has changed since it was told.
    pub(super) fn news(&self) -> Option<Vec<VariableEntry>> {
        (self.is_news && self.telling.is_none()).then(|| self.table.clone())
    }

    /// The bus thread has been told, under `ticket`.
    pub(super) fn told(&mut self, ticket: Ticket) {
        self.is_news = false;
        self.telling = Some(ticket);
    }

    /// The bus thread has answered what it was told under `ticket`.
    pub(super) fn heard(&mut self, ticket: Ticket) {
        self.telling = self.telling.filter(|telling| *telling != ticket);
    }

    /// Every register somebody watches, once. Those that stay keep their order, so that a change moves little.
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
            self.is_news = true;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::function::variable_read::VariableKind;

    fn entries(addresses: std::ops::Range<u16>) -> Vec<VariableEntry> {
        addresses.map(|address| VariableEntry { address, kind: VariableKind::X }).collect()
    }

    #[test]
    fn equal_requests_share_and_are_freed_with_the_last() {
        let mut subscriptions = Subscriptions::default();
        assert_eq!(subscriptions.news(), None);
        subscriptions.watch(1, entries(0..100), None).unwrap();
        subscriptions.watch(2, entries(50..128), None).unwrap();
        assert_eq!(subscriptions.news().unwrap().len(), 128);
        subscriptions.told(Ticket(1));
        subscriptions.heard(Ticket(1));
        let error = subscriptions.watch(3, entries(120..130), None).unwrap_err();
        assert_eq!(error, NoneLeft::Full { used: 128, wanted: 2 });
        subscriptions.watch(3, entries(0..128), None).unwrap();
        assert_eq!(subscriptions.news(), None, "nothing new for the board");
        subscriptions.forget(3);
        subscriptions.forget(1);
        assert_eq!(subscriptions.news(), Some(entries(50..128)));
        subscriptions.told(Ticket(2));
        subscriptions.forget(2);
        assert_eq!(subscriptions.news(), None, "the bus thread is still at the table before");
        subscriptions.heard(Ticket(1));
        assert_eq!(subscriptions.news(), None);
        subscriptions.heard(Ticket(2));
        assert_eq!(subscriptions.news(), Some(Vec::new()));
    }

    #[test]
    fn observers_leave_entries_to_each_other_and_to_operators() {
        let observer = |number| Some(Uid::from_raw(number));
        let mut subscriptions = Subscriptions::default();
        subscriptions.watch(1, entries(0..64), observer(1)).unwrap();
        assert_eq!(subscriptions.watch(2, entries(64..65), observer(1)), Err(NoneLeft::Observers));
        subscriptions.watch(2, entries(0..64), observer(2)).unwrap();
        subscriptions.watch(3, entries(64..96), observer(3)).unwrap();
        assert_eq!(subscriptions.watch(4, entries(96..97), observer(4)), Err(NoneLeft::Observers));
        assert_eq!(subscriptions.watch(3, entries(64..97), observer(3)), Err(NoneLeft::Observers));
        subscriptions.watch(4, entries(0..4), observer(4)).unwrap();
        subscriptions.watch(5, entries(96..128), None).unwrap();
        let full = NoneLeft::Full { used: 128, wanted: 1 };
        assert_eq!(subscriptions.watch(5, entries(96..129), None), Err(full));
        assert_eq!(subscriptions.news().unwrap(), entries(0..128));
    }
}
