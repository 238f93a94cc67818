//! How long the server serves each user in a round, so that one user's many connections do not make other users wait.
//!
//! A round serves every user's connections in turn, each user's for a share of time at most. The next round goes on at
//! the connection where the share ran out. A round is short, however many users there are: the next round first serves
//! the users for whom this one had no time.

use std::collections::HashMap;
use std::time::Duration;

use nix::unistd::Uid;

/// A user's time in a round. The last call may run over it.
const SHARE: Duration = Duration::from_millis(4);
/// After this time a round serves only clients that may stop the machine, so that such a client waits little longer for
/// the next round. The last call may run over this time.
const ROUND: Duration = Duration::from_millis(8);
/// For how many users the server remembers the last round.
const REMEMBERED: usize = 1024;

#[derive(Debug, Default)]
struct Share {
    used: Duration,
    /// The first connection that the server did not serve because the time was over.
    resume: Option<u64>,
}

/// Every user's share of the present round.
#[derive(Debug, Default)]
pub(super) struct TimeQuotas {
    users: HashMap<Uid, Share>,
    resumed: HashMap<Uid, u64>,
    /// The time used in this round, and its number.
    spent: Duration,
    round: u64,
    /// The last round in which the server served each user.
    served: HashMap<Uid, u64>,
}

impl TimeQuotas {
    /// A new round begins.
    pub(super) fn begin_round(&mut self) {
        self.spent = Duration::ZERO;
        self.round += 1;
        if self.served.len() > REMEMBERED {
            self.served.clear();
        }
        self.resumed.clear();
        self.resumed.extend(self.users.drain().filter_map(|(user, share)| Some((user, share.resume?))));
    }

    /// Whether the last round served `connection` before the time of `user` was over. This round then serves it later.
    pub(super) fn comes_later(&self, user: Uid, connection: u64) -> bool {
        self.resumed.get(&user).is_some_and(|resume| connection < *resume)
    }

    /// The last round that served `user`; 0 if the server does not remember it.
    pub(super) fn last_served(&self, user: Uid) -> u64 {
        self.served.get(&user).copied().unwrap_or(0)
    }

    /// Whether `user` has time left for `connection`. An `is_urgent` connection gets time even after the end of the
    /// round. If no time is left, the user's next round begins with `connection`.
    pub(super) fn has_time(&mut self, user: Uid, connection: u64, is_urgent: bool) -> bool {
        let share = self.users.entry(user).or_default();
        let has_time = share.used < SHARE && (is_urgent || self.spent < ROUND);
        if !has_time {
            share.resume.get_or_insert(connection);
        }
        has_time
    }

    /// The server has served `user` for this `time`.
    pub(super) fn used(&mut self, user: Uid, time: Duration) {
        self.users.entry(user).or_default().used += time;
        self.spent += time;
        self.served.insert(user, self.round);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Serves the connections as the server does, `time` each; returns the connections served.
    fn round(shares: &mut TimeQuotas, mut connections: Vec<(Uid, u64)>, time: Duration) -> Vec<u64> {
        shares.begin_round();
        connections.sort_by_key(|(user, id)| (shares.last_served(*user), shares.comes_later(*user, *id)));
        let mut served = Vec::new();
        for (user, id) in connections {
            if shares.has_time(user, id, false) {
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

    #[test]
    fn many_users_do_not_make_a_round_long_and_each_has_its_turn() {
        let connections: Vec<_> = (0..20).map(|user| (Uid::from_raw(user), u64::from(user))).collect();
        let mut shares = TimeQuotas::default();
        let mut all = Vec::new();
        for _ in 0..10 {
            let served = round(&mut shares, connections.clone(), SHARE);
            assert_eq!(served.len(), 2, "two shares are a round");
            assert!(
                !shares.has_time(Uid::from_raw(99), 99, false)
                    && shares.has_time(Uid::from_raw(99), 99, true)
            );
            all.extend(served);
        }
        all.sort_unstable();
        assert_eq!(all, (0..20).collect::<Vec<_>>());
    }
}
