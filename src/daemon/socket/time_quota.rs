//! How long each user is served in a round, so that one user's many connections do not make the others wait.
//!
//! A round serves every user's connections in turn, each user's for a share of time at most; where it left off, the
//! next round goes on.

use std::collections::HashMap;
use std::time::Duration;

use nix::unistd::Uid;

/// A user's time in a round. The last call may run over it.
const SHARE: Duration = Duration::from_millis(4);

#[derive(Debug, Default)]
struct Share {
    used: Duration,
    /// The first connection that was not served because the time was over.
    resume: Option<u64>,
}

/// Every user's share of the present round.
#[derive(Debug, Default)]
pub(super) struct TimeQuotas {
    users: HashMap<Uid, Share>,
    resumed: HashMap<Uid, u64>,
}

impl TimeQuotas {
    /// A new round begins.
    pub(super) fn begin_round(&mut self) {
        self.resumed.clear();
        self.resumed.extend(self.users.drain().filter_map(|(user, share)| Some((user, share.resume?))));
    }

    /// Whether `connection` was served in the last round before the time of `user` was over. It comes later in this one.
    pub(super) fn comes_later(&self, user: Uid, connection: u64) -> bool {
        self.resumed.get(&user).is_some_and(|resume| connection < *resume)
    }

    /// Whether `user` has time left for `connection`; if not, the next round begins with it.
    pub(super) fn has_time(&mut self, user: Uid, connection: u64) -> bool {
        let share = self.users.entry(user).or_default();
        let has_time = share.used < SHARE;
        if !has_time {
            share.resume.get_or_insert(connection);
        }
        has_time
    }

    /// `user` was served for so long.
    pub(super) fn used(&mut self, user: Uid, time: Duration) {
        self.users.entry(user).or_default().used += time;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Serves the connections as the server does, `time` each; returns who was.
    fn round(shares: &mut TimeQuotas, mut connections: Vec<(Uid, u64)>, time: Duration) -> Vec<u64> {
        shares.begin_round();
        connections.sort_by_key(|(user, id)| shares.comes_later(*user, *id));
        let mut served = Vec::new();
        for (user, id) in connections {
            if shares.has_time(user, id) {
                shares.used(user, time);
                served.push(id);
            }
        }
        served
    }

    #[test]
    fn who_asks_much_waits_for_his_next_share_and_all_his_connections_have_their_turn() {
        let (many, few) = (Uid::from_raw(1), Uid::from_raw(2));
        let connections: Vec<_> = (0..10).map(|id| (many, id)).chain([(few, 10)]).collect();
        let mut shares = TimeQuotas::default();
        let mut rounds = (0..3).map(|_| round(&mut shares, connections.clone(), SHARE / 4));
        assert_eq!(rounds.next().unwrap(), [0, 1, 2, 3, 10]);
        assert_eq!(rounds.next().unwrap(), [4, 5, 6, 7, 10]);
        assert_eq!(rounds.next().unwrap(), [8, 9, 10, 0, 1]);
        let served = round(&mut shares, connections, Duration::ZERO);
        assert_eq!(served.len(), 11, "there is time for all who ask little");
    }
}
