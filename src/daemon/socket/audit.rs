//! Limits how many refusals the log gets: each user's first refusals, then a count.
//!
//! Otherwise any user who may connect could fill the log, or have the journal drop other users' lines.

use std::collections::HashMap;
use std::fmt::{self, Write as _};
use std::time::{Duration, Instant};

use log::{debug, info};
use nix::unistd::Uid;

use super::policy::{Peer, Role};
use crate::daemon::shared::log_quota::LogQuota;

/// How many refusals of one user the log gets in one [`PERIOD`].
const TOLD: u32 = 20;
/// How many refusals of all users together the log gets in that time.
const TOLD_ALL: u32 = 100;
const PERIOD: Duration = Duration::from_secs(10);
/// How many commands of one user of the role stop the log gets in that time.
const TOLD_DONE: u32 = 100;
/// The most characters of a line of the log. A client's text can be as long as a message.
const LENGTH: usize = 240;

/// The entry for the log once the daemon carries out `sends` for `peer`. The log gets a question at once, at level
/// debug: a client that polls would fill the log.
pub(super) fn entry(peer: Peer, sends: String, is_question: bool) -> Option<String> {
    if is_question {
        debug!(target: "audit", "{} {sends}", peer.account());
    }
    (!is_question).then_some(sends)
}

/// The quota of `user`. A new quota begins at `now`.
fn quota_of(quotas: &mut HashMap<Uid, LogQuota>, user: Uid, now: Instant) -> &mut LogQuota {
    quotas.entry(user).or_insert(LogQuota::until(now + PERIOD))
}

/// Every user's quota.
#[derive(Debug, Default)]
pub(super) struct AuditLimit {
    users: HashMap<Uid, LogQuota>,
    /// The commands carried out for users of the role stop: otherwise such a user could fill the log.
    done: HashMap<Uid, LogQuota>,
}

impl AuditLimit {
    /// Logs a refusal to `user`, or counts it.
    pub(super) fn tell(&mut self, user: Uid, what: fmt::Arguments<'_>, now: Instant) {
        if self.may_tell(user, now) {
            info!(target: "audit", "{}", one_line(what));
        }
    }

    fn may_tell(&mut self, user: Uid, now: Instant) -> bool {
        let told_all: u32 = self.users.values().map(LogQuota::told).sum();
        quota_of(&mut self.users, user, now).may_tell(if told_all < TOLD_ALL { TOLD } else { 0 })
    }

    /// Logs a command carried out for `peer`. For a user of the role stop, [`TOLD_DONE`] limits the entries.
    pub(super) fn tell_done(&mut self, peer: Peer, role: Option<Role>, what: &str, now: Instant) {
        let Peer { uid, pid, .. } = peer;
        if role != Some(Role::Stop) || quota_of(&mut self.done, uid, now).may_tell(TOLD_DONE) {
            info!(target: "audit", "uid {uid} pid {pid} {what}");
        }
    }

    /// Ends the quotas whose time is over, and logs how many refusals each held back.
    pub(super) fn sum_up(&mut self, now: Instant) {
        self.close(|quota| quota.end() <= now);
    }

    /// Ends all quotas: nothing more will be logged.
    pub(super) fn end(&mut self) {
        self.close(|_| true);
    }

    fn close(&mut self, is_over: impl Fn(&LogQuota) -> bool) {
        for (user, quota) in self.users.extract_if(|_, quota| is_over(quota)) {
            let untold = quota.untold();
            if untold > 0 {
                info!(target: "audit", "refused {untold} more of uid {user} within {PERIOD:?}");
            }
        }
        for (user, quota) in self.done.extract_if(|_, quota| is_over(quota)) {
            let untold = quota.untold();
            if untold > 0 {
                info!(target: "audit", "did {untold} more commands of uid {user}, who may only stop, within {PERIOD:?}");
            }
        }
    }

    /// When the next quota ends.
    pub(super) fn next_end(&self) -> Option<Instant> {
        self.users.values().chain(self.done.values()).map(LogQuota::end).min()
    }
}

/// `text` as one line of bounded length: a client's text must not look like a line of the log.
fn one_line(text: fmt::Arguments<'_>) -> String {
    struct Line(String, usize);
    impl fmt::Write for Line {
        fn write_str(&mut self, text: &str) -> fmt::Result {
            for character in text.chars() {
                if self.1 == LENGTH {
                    self.0.push('…');
                    return Err(fmt::Error);
                }
                self.1 += 1;
                if character.is_control() {
                    self.0.extend(character.escape_default());
                } else {
                    self.0.push(character);
                }
            }
            Ok(())
        }
    }
    let mut line = Line(String::new(), 0);
    // An error says only that the line was cut.
    let _ = line.write_fmt(text);
    line.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_users_together_fill_no_log_either() {
        let now = Instant::now();
        let mut refusals = AuditLimit::default();
        let told = |refusals: &mut AuditLimit, now| {
            (0..1000).filter(|user| refusals.may_tell(Uid::from_raw(*user), now)).count()
        };
        assert_eq!(told(&mut refusals, now), TOLD_ALL as usize);
        refusals.sum_up(now + PERIOD);
        assert_eq!(told(&mut refusals, now + PERIOD), TOLD_ALL as usize);
    }

    #[test]
    fn a_flood_is_counted_and_others_are_heard() {
        let (loud, quiet) = (Uid::from_raw(1), Uid::from_raw(2));
        let now = Instant::now();
        let mut refusals = AuditLimit::default();
        let told = (0..1000).filter(|_| refusals.may_tell(loud, now)).count();
        assert_eq!(told, TOLD as usize);
        assert!(refusals.may_tell(quiet, now));
        assert_eq!(refusals.users[&loud].untold(), 1000 - u64::from(TOLD));
        assert_eq!(refusals.next_end(), Some(now + PERIOD));
        refusals.sum_up(now + PERIOD);
        assert_eq!(refusals.next_end(), None);
        assert!(refusals.may_tell(loud, now + PERIOD));
        refusals.end();
        assert_eq!(refusals.next_end(), None);
    }

    #[test]
    fn who_may_only_stop_fills_no_log_and_all_is_counted() {
        let now = Instant::now();
        let mut audit = AuditLimit::default();
        let peer = Peer { uid: Uid::from_raw(1), gid: nix::unistd::Gid::from_raw(1), pid: 7 };
        for _ in 0..5000 {
            audit.tell_done(peer, Some(Role::Stop), "sends ^A", now);
            // The log gets every command of a user who may move the machine.
            audit.tell_done(peer, Some(Role::Operate), "panel jog+ [1]", now);
        }
        let quota = &audit.done[&peer.uid];
        assert_eq!((quota.told(), quota.untold()), (TOLD_DONE, 5000 - u64::from(TOLD_DONE)));
        assert_eq!(audit.next_end(), Some(now + PERIOD));
        audit.sum_up(now + PERIOD);
        assert!(audit.done.is_empty());
    }

    #[test]
    fn no_words_of_a_client_make_a_line_of_their_own() {
        let words = format!("x\n[INFO ] uid 0 sends {}\u{1b}[2J", "y".repeat(100_000));
        let line = one_line(format_args!("refused {words}"));
        assert!(line.starts_with("refused x\\n[INFO ] uid 0") && line.ends_with('…'));
        assert!(line.chars().count() <= LENGTH + 10 && !line.contains(char::is_control));
        assert_eq!(one_line(format_args!("a\u{1b}b{}", 7)), "a\\u{1b}b7");
    }
}
