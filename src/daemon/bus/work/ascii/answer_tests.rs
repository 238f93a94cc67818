//! Whose an answer is that came out of turn.

use super::*;

/// FACTS-TURBO 6: "a stale acknowledge in front of the next reply".
#[test]
fn b2_1_a_question_that_was_only_acknowledged_is_asked_again_and_no_reply_goes_to_the_line_after() {
    let mut rig = Rig::new();
    for (ticket, line) in [(1, "P1"), (2, "P2")] {
        rig.send(ticket, line, Duration::from_secs(60));
    }
    rig.poll();
    assert_eq!(rig.take(), "P1");
    rig.poll();
    rig.respond(response::ACKNOWLEDGE);
    assert_eq!(rig.ended(), []);
    // The reply comes behind it, and then that to our own line.
    let answer_check = |rig: &mut Rig, late: &[&str]| {
        let mut lines = Vec::new();
        for _ in 0..20 {
            rig.now += SETTLE;
            rig.poll();
            if !rig.loaded() {
                continue;
            }
            let line = rig.take();
            let count = line.split(' ').count();
            match line.split(' ').next().unwrap() {
                "I3" => {
                    rig.answer(late);
                    let period = vec!["3713707"; count - 2];
                    rig.answer(&[&["2"], &period[..], &["2"]].concat());
                }
                "SIZE" => rig.answer(&vec!["31000"; count]),
                _ => return (lines, line),
            }
            lines.push(line);
        }
        panic!("{lines:?}");
    };
    let (own, first) = answer_check(&mut rig, &["25"]);
    assert!(!own.is_empty() && first == "P1", "{own:?} {first}");
    rig.answer(&["25"]);
    assert_eq!(rig.ended(), [(1, Outcome::Done)]);
    assert_eq!(rig.take(), "P2");
    // A board that has no more to say is believed.
    rig.poll();
    rig.respond(response::ACKNOWLEDGE);
    let (_, again) = answer_check(&mut rig, &[]);
    assert_eq!(again, "P2");
    rig.poll();
    rig.respond(response::ACKNOWLEDGE);
    assert_eq!(rig.ended(), [(2, Outcome::Done)]);
}
