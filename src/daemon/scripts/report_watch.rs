//! Whether the servo report runs, seen by its timer: a word that changes with every update, and that only the board
//! writes.

use std::time::Duration;

use super::Request;
use super::script::Io;
use crate::map::Family;

/// How often to look.
const REPORT_LOOK: Duration = Duration::from_millis(5);

/// Looks at the timer until it has changed, for at most `patience`. A board that is slow with a command may pause its
/// report: only a timer that never changes shows that the report does not run.
pub(super) async fn report_runs(io: &Io, family: &Family, patience: Duration) -> bool {
    let until = io.now() + patience;
    let mut first = None;
    loop {
        let looked = io.request(Request::Read { first: family.servo.timer.low, count: 1 }).await;
        if looked.words.first().is_some_and(|word| first.get_or_insert(*word) != word) {
            return true;
        }
        if io.now() >= until {
            return false;
        }
        io.rest(REPORT_LOOK).await;
    }
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::super::script::Script;
    use super::super::{Done, Resource, Step};
    use super::*;
    use crate::daemon::shared::queue::Outcome;
    use crate::map::PMAC;
    use crate::protocol::{CallError, Reply};

    /// Whether a report runs whose timer is `word` after so many milliseconds.
    fn runs(word: impl Fn(u128) -> u16) -> bool {
        let mut script = Script::new(Resource::Gather, "gather", |io| async move {
            match report_runs(&io, &PMAC, Duration::from_secs(1)).await {
                true => Ok(Reply::done()),
                false => Err(CallError::Busy),
            }
        });
        let (began, mut done) = (Instant::now(), None);
        let mut now = began;
        loop {
            match script.next(done.take(), now) {
                Step::Board(..) => {
                    done = Some(Done {
                        outcome: Outcome::Done,
                        result: Ok(Vec::new()),
                        resets: 0,
                        doubts: 0,
                        rotary: None,
                        words: vec![word((now - began).as_millis())],
                        gathers: None,
                        programs_run: None,
                        ended_by: None,
                    });
                }
                Step::Wait(moment) => now = moment,
                Step::Over(reply) => return reply.is_ok(),
                step => panic!("{step:?}"),
            }
        }
    }

    #[test]
    fn a_report_that_pauses_runs() {
        assert!(runs(|ms| if ms < 255 { 7 } else { 600 }), "the pause of a slow board");
        assert!(!runs(|_| 7));
    }
}
