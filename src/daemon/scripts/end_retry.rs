//! How long the end of a sequence repeats steps that the daemon has certainly not sent.

use std::time::{Duration, Instant};

use super::Ending;
use super::script::Io;
use crate::daemon::shared::queue::Outcome;
use crate::protocol::{CallError, Reply};

const TRY_AGAIN: Duration = Duration::from_millis(250);
/// The pause between tries once an open program buffer keeps the end back. The daemon then tries until the buffer is
/// closed.
const TRY_AGAIN_LATER: Duration = Duration::from_secs(1);
/// When the daemon tells the owner that a buffer keeps the end back: before another sequence of the same owner lapses
/// because the owner waits for this end.
const KEPT_BACK_AFTER: Duration = Duration::from_secs(2);

/// The attempts of one end.
#[derive(Debug)]
pub(super) struct EndRetry {
    patience: Duration,
    may_last: bool,
    begun: Option<Instant>,
    is_kept_back: bool,
    is_told: bool,
}

impl EndRetry {
    /// The retries of an end, with this `patience`. `may_last`: the end waits longer for an open program buffer.
    pub(super) const fn new(patience: Duration, may_last: bool) -> Self {
        Self { patience, may_last, begun: None, is_kept_back: false, is_told: false }
    }

    /// Rests until the next try of the step that had this `outcome`. Returns false at once if the end does not try the
    /// step again. If a buffer keeps the end back, the owner hears the `result` so far; `unfinished` names the rest of
    /// the end.
    pub(super) async fn rests(
        &mut self,
        io: &Io,
        outcome: Outcome,
        unfinished: Option<String>,
        result: impl FnOnce() -> Result<Reply, CallError>,
    ) -> bool {
        let again = self.again(outcome, io.now());
        let Some(again) = again.filter(|_| io.ending() != Some(Ending::Stopping)) else { return false };
        if self.is_kept_back {
            io.set_unfinished(unfinished);
        }
        if self.tells_now() {
            io.answer_end(result()).await;
        }
        io.rest_until(again).await;
        true
    }

    /// When to try the step with this `outcome` again; `None` if the end gives it up.
    fn again(&mut self, outcome: Outcome, now: Instant) -> Option<Instant> {
        let may_last = self.may_last && matches!(outcome, Outcome::Barred(_));
        let patience = if may_last { self.patience.min(KEPT_BACK_AFTER) } else { self.patience };
        let is_patient = now < *self.begun.get_or_insert(now) + patience;
        let is_kept_back = !is_patient && may_last;
        self.is_kept_back |= is_kept_back;
        let pause = if is_kept_back { TRY_AGAIN_LATER } else { TRY_AGAIN };
        (is_patient || is_kept_back).then(|| now + pause)
    }

    /// Whether an open program buffer keeps the end back.
    pub(super) const fn is_kept_back(&self) -> bool {
        self.is_kept_back
    }

    /// Whether to tell the owner now that a buffer keeps the end back: the owner must not wait for an end that may take
    /// long.
    fn tells_now(&mut self) -> bool {
        self.is_kept_back && !std::mem::replace(&mut self.is_told, true)
    }
}

/// The note on a variable that the end does not put back, because another sender has set it to the value `found`.
pub(super) fn was_set_meanwhile(name: &str, found: &str) -> String {
    format!("somebody else has set {name} to {found} meanwhile; it stays {found}")
}

/// The note on a variable whose end waits for an open program buffer: the variable still has the value that a sequence
/// of this `kind` has set.
pub(super) fn is_kept_back(name: &str, ours: &str, old: &str, kind: &str) -> String {
    format!(
        "{name} is {ours} by a {kind} that has ended; pmacd sets it to {old} again when the open program buffer is closed"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::shared::open_buffer::Barred;

    #[test]
    fn an_owner_hears_what_a_buffer_keeps_back_before_his_other_sequences_lapse() {
        let begun = Instant::now();
        let mut retry = EndRetry::new(Duration::from_secs(10), true);
        let barred = Outcome::Barred(Barred::Open(None));
        assert_eq!(retry.again(barred, begun), Some(begun + TRY_AGAIN));
        let told = begun + KEPT_BACK_AFTER;
        assert!(KEPT_BACK_AFTER < crate::daemon::shared::leases::SEQUENCE_LEASE / 2);
        assert_eq!(retry.again(Outcome::Busy, told), Some(told + TRY_AGAIN));
        assert!(!retry.tells_now());
        assert_eq!(retry.again(barred, told), Some(told + TRY_AGAIN_LATER));
        assert!(retry.tells_now());
    }

    #[test]
    fn what_a_buffer_keeps_back_is_tried_on_and_nothing_else() {
        let begun = Instant::now();
        let mut retry = EndRetry::new(Duration::from_secs(1), true);
        let barred = Outcome::Barred(Barred::Open(None));
        assert_eq!(retry.again(Outcome::Busy, begun), Some(begun + TRY_AGAIN));
        assert_eq!(retry.again(barred, begun), Some(begun + TRY_AGAIN));
        assert!(!retry.tells_now());
        let late = begun + Duration::from_secs(1);
        assert_eq!(retry.again(Outcome::Busy, late), None);
        assert_eq!(retry.again(barred, late), Some(late + TRY_AGAIN_LATER));
        assert!(retry.is_kept_back() && retry.tells_now() && !retry.tells_now());
        let mut retry = EndRetry::new(Duration::from_secs(1), false);
        assert_eq!(retry.again(barred, begun), Some(begun + TRY_AGAIN));
        assert_eq!(retry.again(barred, late), None);
    }
}
