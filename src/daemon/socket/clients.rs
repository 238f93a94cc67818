//! Every connection, and whose turn it is to be served.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use nix::poll::PollFlags;
use nix::unistd::Uid;

use super::connection::Client;
use super::policy::Peer;
use super::time_quota::TimeQuotas;
use crate::daemon::shared::queue::{REASON_MAX, Text, Unsolicited};
use crate::protocol::Reply;

/// Every connection, by a number that is never used again.
#[derive(Debug)]
pub(super) struct Clients {
    clients: BTreeMap<u64, Client>,
    next: u64,
    quotas: TimeQuotas,
    /// How long a client may leave a message half sent, or its output unfetched.
    patience: Duration,
}

impl Clients {
    /// Nobody, with `patience` for those who come.
    pub(super) fn new(patience: Duration) -> Self {
        Self { clients: BTreeMap::new(), next: 0, quotas: TimeQuotas::default(), patience }
    }

    /// Takes one more in.
    pub(super) fn add(&mut self, client: Client) {
        self.clients.insert(self.next, client);
        self.next += 1;
    }

    /// Client `id`, if it is still there.
    pub(super) fn get(&self, id: u64) -> Option<&Client> {
        self.clients.get(&id)
    }

    /// Client `id`, if it is still there.
    pub(super) fn get_mut(&mut self, id: u64) -> Option<&mut Client> {
        self.clients.get_mut(&id)
    }

    /// Client `id` gets this `reply`, which is no refusal.
    pub(super) fn served(&mut self, id: u64, reply: Reply) -> Reply {
        if let Some(client) = self.get_mut(id) {
            client.was_served();
        }
        reply
    }

    /// All motion is stopped, for this `reason`, by client `by` or by the daemon: what others have sent up to now begins nothing any more.
    pub(super) fn outdate(&mut self, reason: Text<REASON_MAX>, by: u64) {
        let others = self.clients.iter_mut().filter(|(id, _)| **id != by);
        others.for_each(|(_, client)| client.outdate(reason));
    }

    /// All of them.
    pub(super) fn iter(&self) -> impl Iterator<Item = (u64, &Client)> {
        self.clients.iter().map(|(&id, client)| (id, client))
    }

    /// How many there are.
    pub(super) fn count(&self) -> usize {
        self.clients.len()
    }

    /// How many there are of one user.
    pub(super) fn held_by(&self, uid: Uid) -> usize {
        self.clients.values().filter(|client| client.peer().uid == uid).count()
    }

    /// Whether a reply would reach client `id`.
    pub(super) fn hears(&self, id: u64) -> bool {
        self.get(id).is_some_and(Client::hears)
    }

    /// Sends client `id` a reply, if it is still there.
    pub(super) fn reply(&mut self, id: u64, reply: &Reply, now: Instant) {
        if let Some(client) = self.clients.get_mut(&id) {
            client.reply(reply, now);
        }
    }

    /// Takes in what those who are `ready` have sent, and puts them into the order in which they are served: first who stops
    /// the machine, then the users who have waited longest; of each, whoever was served last, when his user's time was over, comes later.
    pub(super) fn begin_round(&mut self, ready: &mut [(u64, PollFlags)], now: Instant) {
        self.quotas.begin_round();
        for (id, _) in &*ready {
            if let Some(client) = self.clients.get_mut(id) {
                client.receive(now);
            }
        }
        ready.sort_by_cached_key(|(id, _)| {
            self.get(*id).map(|client| {
                let uid = client.peer().uid;
                (!client.is_urgent(), self.quotas.last_served(uid), self.quotas.comes_later(uid, *id))
            })
        });
    }

    /// Whether the user of client `id` has time left in this round; if not, the next one begins with that client.
    pub(super) fn has_time(&mut self, id: u64) -> bool {
        let Some(client) = self.clients.get(&id) else { return false };
        self.quotas.has_time(client.peer().uid, id, client.is_urgent())
    }

    /// Client `id` was served for so long.
    pub(super) fn used(&mut self, id: u64, time: Duration) {
        if let Some(client) = self.clients.get(&id) {
            self.quotas.used(client.peer().uid, time);
        }
    }

    /// Whether somebody did not come to the end of his calls.
    pub(super) fn has_more(&self) -> bool {
        self.clients.values().any(Client::has_more)
    }

    /// Passes an unsolicited text on to those who stream them.
    pub(super) fn pass_on(&mut self, text: &Unsolicited, now: Instant) {
        for client in self.clients.values_mut() {
            client.pass_on(text, now);
        }
    }

    /// Sends his `reply`, which depends on whether he waits for the board, to everybody who waits for something and is not `deaf`.
    pub(super) fn farewell<'a>(
        &mut self,
        reply: impl Fn(u64, bool) -> &'a Reply,
        deaf: impl Fn(u64) -> bool,
        now: Instant,
    ) {
        for (&id, client) in &mut self.clients {
            if client.waits() && !deaf(id) {
                client.reply(reply(id, client.waits_for_board()), now);
            }
        }
    }

    /// Removes a connection, for one of user `newcomer`: if that helps (`of_others`), one that has asked nothing since it came, of a
    /// user who holds more; else one of his own that is idle and `holds` nothing. Of these, one that has never asked anything goes
    /// first, then the one that has asked nothing for the longest time.
    pub(super) fn make_room(
        &mut self,
        newcomer: Uid,
        of_others: bool,
        holds: impl Fn(u64) -> bool,
        now: Instant,
    ) -> Option<Peer> {
        let held = self.held_by(newcomer);
        let silent = || {
            self.clients.iter().find(|(_, client)| {
                client.is_silent(now, self.patience) && self.held_by(client.peer().uid) > held
            })
        };
        let own = || {
            let mut own: Vec<_> =
                self.clients.iter().filter(|(_, client)| client.peer().uid == newcomer).collect();
            own.sort_by_key(|(_, client)| client.last_heard());
            own.into_iter().find(|(id, client)| client.is_idle() && !holds(**id))
        };
        let id = *of_others.then(silent).flatten().or_else(own)?.0;
        self.clients.remove(&id).map(|client| client.peer())
    }

    /// Gives those up who have stopped half-way for too long. Who they are.
    pub(super) fn drop_stalled(&mut self, now: Instant) -> Vec<Peer> {
        let patience = self.patience;
        let stalled = self.clients.values_mut().filter_map(|client| {
            client.patience_ends(patience).filter(|end| *end <= now)?;
            client.hang_up();
            client.close();
            Some(client.peer())
        });
        stalled.collect()
    }

    /// Removes those for whom nothing is left to be done. Their numbers.
    pub(super) fn remove_finished(&mut self) -> Vec<u64> {
        let mut finished = Vec::new();
        self.clients.retain(|&id, client| {
            let stays = !client.is_finished();
            if !stays {
                finished.push(id);
            }
            stays
        });
        finished
    }

    /// When the first of them is given up if nothing happens.
    pub(super) fn next_deadline(&self) -> Option<Instant> {
        self.clients.values().filter_map(|client| client.patience_ends(self.patience)).min()
    }
}
