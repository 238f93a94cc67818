//! Every connection, and the order in which the server serves them.

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
    /// No clients yet, with `patience` for each that comes.
    pub(super) fn new(patience: Duration) -> Self {
        Self { clients: BTreeMap::new(), next: 0, quotas: TimeQuotas::default(), patience }
    }

    /// Adds a client.
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

    /// Notes that client `id` gets this `reply`, which is no refusal.
    pub(super) fn served(&mut self, id: u64, reply: Reply) -> Reply {
        if let Some(client) = self.get_mut(id) {
            client.was_served();
        }
        reply
    }

    /// Client `by` or the daemon stops all motion, for this `reason`: no call that other clients have sent up to now
    /// begins anything.
    pub(super) fn outdate(&mut self, reason: Text<REASON_MAX>, by: u64) {
        let others = self.clients.iter_mut().filter(|(id, _)| **id != by);
        others.for_each(|(_, client)| client.outdate(reason));
    }

    /// All clients.
    pub(super) fn iter(&self) -> impl Iterator<Item = (u64, &Client)> {
        self.clients.iter().map(|(&id, client)| (id, client))
    }

    /// How many clients are connected.
    pub(super) fn count(&self) -> usize {
        self.clients.len()
    }

    /// How many connections one user has.
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

    /// Reads the data of the `ready` clients, and sorts them for this round: first clients that stop the machine, then
    /// the users that have waited longest. Within a user, the clients served before the user's time ran out come later.
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

    /// Whether the user of client `id` has time left in this round; if not, the next round begins with that client.
    pub(super) fn has_time(&mut self, id: u64) -> bool {
        let Some(client) = self.clients.get(&id) else { return false };
        self.quotas.has_time(client.peer().uid, id, client.is_urgent())
    }

    /// Books the `time` that the server spent on client `id`.
    pub(super) fn used(&mut self, id: u64, time: Duration) {
        if let Some(client) = self.clients.get(&id) {
            self.quotas.used(client.peer().uid, time);
        }
    }

    /// Whether any client has calls left over.
    pub(super) fn has_more(&self) -> bool {
        self.clients.values().any(Client::has_more)
    }

    /// Passes an unsolicited text on to the clients that stream them.
    pub(super) fn pass_on(&mut self, text: &Unsolicited, now: Instant) {
        for client in self.clients.values_mut() {
            client.pass_on(text, now);
        }
    }

    /// Sends a `reply` to every client that waits and is not `deaf`. The reply depends on whether the client waits for
    /// the board.
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

    /// Removes a connection in favour of user `newcomer`. If another user's place helps (`of_others`), removes a
    /// connection that has made no call since its arrival, of a user with more connections. Otherwise removes an idle
    /// connection of the newcomer's own that `holds` nothing: first one that has never made a call, then the one whose
    /// last call is the oldest.
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

    /// Drops the clients that have stopped half-way for too long, and returns their peers.
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

    /// Removes the finished clients, and returns their numbers.
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

    /// When the server drops the first client if nothing happens.
    pub(super) fn next_deadline(&self) -> Option<Instant> {
        self.clients.values().filter_map(|client| client.patience_ends(self.patience)).min()
    }
}
