//! When a port that was held is free.

use super::*;

#[test]
fn b2_1_a_reply_whose_lines_come_slowly_is_waited_for_to_its_end() {
    const GAP: Duration = Duration::from_millis(60);
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin("P1..10"));
        rig.take();
        for line in 0..10 {
            rig.be_silent(GAP);
            rig.respond(response::LINE, "7");
            let event = rig.poll().unwrap();
            assert_eq!(matches!(event, AsciiEvent::Line(_)), line < 3, "{event:?}");
            if line == 2 {
                rig.give_up();
                assert_eq!(rig.poll(), None);
                rig.write(family.ascii.control_character, 0);
            }
            assert!(!rig.begin("P2"));
        }
        rig.be_silent(2 * GAP - Duration::from_millis(1));
        assert!(!rig.begin("P2"));
        rig.be_silent(Duration::from_millis(1));
        assert!(rig.begin("P2"));
    }
}

/// With I6=1 a board reports the errors of a program's `CMD`, too (Software Reference, I6).
#[test]
fn b2_1_errors_that_come_for_ever_do_not_hold_the_port_for_ever() {
    for family in FAMILIES {
        let mut rig = Rig::new(family);
        assert!(rig.begin("P1 P2 P3"));
        rig.take();
        for _ in 0..2 {
            rig.be_silent(Duration::from_millis(600));
            rig.respond(response::LINE, "7");
            assert!(matches!(rig.poll(), Some(AsciiEvent::Line(_))));
        }
        rig.give_up();
        assert_eq!(rig.poll(), None);
        rig.write(family.ascii.control_character, 0);
        let begun = (0..100).position(|_| {
            rig.respond(response::ERROR | 3, "");
            rig.poll();
            rig.be_silent(Duration::from_millis(500));
            rig.begin("P2")
        });
        assert!(matches!(begun, Some(55..65)), "{begun:?} halves of a second");
    }
}
