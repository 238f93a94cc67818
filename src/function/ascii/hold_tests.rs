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
