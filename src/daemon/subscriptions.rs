//! Who watches which registers: equal requests of many clients share one entry of PMAC's table of 128.

use std::collections::{BTreeMap, HashSet};

use super::queue::Ticket;
use crate::function::variable_read::VariableEntry;
use crate::map::classic::VARIABLE_READ_ENTRIES;

/// No entry is left.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "PMAC reads {VARIABLE_READ_ENTRIES} registers at most; {used} are in use, {wanted} more are wanted: close a watch, or \
     watch fewer"
)]
pub(super) struct NoneLeft {
    used: usize,
    wanted: usize,
}

/// Every client's registers.
#[derive(Debug, Default)]
pub(super) struct Subscriptions {
    clients: BTreeMap<u64, Vec<VariableEntry>>,
    /// The table as it should be on the board; the bus thread starts with an empty one.
    table: Vec<VariableEntry>,
    /// The bus thread has another one.
    is_news: bool,
    /// What the bus thread was told last, until it has heard it: tables that change faster than that do not fill its queue.
    telling: Option<Ticket>,
}

impl Subscriptions {
    /// `client` watches `entries`, instead of what it watched before.
    ///
    /// # Errors
    /// When there are not enough entries left; nothing is changed then.
    pub(super) fn watch(&mut self, client: u64, entries: Vec<VariableEntry>) -> Result<(), NoneLeft> {
        let before = self.clients.insert(client, entries);
        let table = self.merged();
        if table.len() > VARIABLE_READ_ENTRIES {
            match before {
                Some(before) => self.clients.insert(client, before),
                None => self.clients.remove(&client),
            };
            let used = self.merged().len();
            return Err(NoneLeft { used, wanted: table.len() - used });
        }
        self.adopt(table);
        Ok(())
    }

    /// `client` is gone.
    pub(super) fn forget(&mut self, client: u64) {
        if self.clients.remove(&client).is_some() {
            let table = self.merged();
            self.adopt(table);
        }
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
        let mut missing: HashSet<VariableEntry> = self.clients.values().flatten().copied().collect();
        let mut table = self.table.clone();
        table.retain(|entry| missing.remove(entry));
        table.extend(self.clients.values().flatten().filter(|entry| missing.remove(*entry)));
        table
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
        subscriptions.watch(1, entries(0..100)).unwrap();
        subscriptions.watch(2, entries(50..128)).unwrap();
        assert_eq!(subscriptions.news().unwrap().len(), 128);
        subscriptions.told(Ticket(1));
        subscriptions.heard(Ticket(1));
        let error = subscriptions.watch(3, entries(120..130)).unwrap_err();
        assert_eq!(error, NoneLeft { used: 128, wanted: 2 });
        subscriptions.watch(3, entries(0..128)).unwrap();
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
}
