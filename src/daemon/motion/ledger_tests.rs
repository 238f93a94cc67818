//! Tests of the ledger of motion.

use super::*;
use crate::protocol::control;

const HOLDER: Account = Account { uid: 1000, pid: 5 };

fn motors(bits: u32) -> Motors {
    Motors::from_bits(bits)
}

fn motion(moving: u32, standing: u32) -> Motion {
    Motion { moving: motors(moving), standing: motors(standing) }
}

fn ms(count: u64) -> Duration {
    Duration::from_millis(count)
}

/// The board has carried out a line that jogs the motors of these `bits`.
fn jogs(ledger: &mut Ledger, client: u64, bits: u32, silence: Option<Duration>, now: Instant) {
    ledger.commanded(motors(bits));
    ledger.jog_by_line(client, motors(bits), silence, now);
}

/// The motors whose stop the daemon has to request.
fn ended(ledger: &mut Ledger, now: Instant, is_there: impl Fn(u64) -> bool) -> u32 {
    ledger.lapse(is_there, now).0.bits()
}

#[test]
fn silence_and_absence_end_a_hold_and_renewal_does_not() {
    let now = Instant::now();
    let mut ledger = Ledger::default();
    for (client, motor) in [(7, 1), (7, 3), (8, 2)] {
        ledger.hold(client, HOLDER, Motors::of(motor), now + HOLD_LEASE);
    }
    assert_eq!((ledger.renew(7, now + HOLD_LEASE / 2), ledger.renew(9, now)), (Ok(()), Err(None)));
    assert_eq!(ledger.next_moment(), Some(now + HOLD_LEASE));
    assert_eq!(ended(&mut ledger, now + HOLD_LEASE, |_| true), 0b10);
    assert_eq!(ended(&mut ledger, now + HOLD_LEASE, |_| true), 0);
    assert_eq!(ledger.renew(8, now), Err(Some(HoldEnd::Silent)));
    assert_eq!(ledger.lapse(|client| client != 7, now + HOLD_LEASE), (motors(0b101), vec![7]));
    assert_eq!(ledger.next_moment(), None);
    ledger.hold(7, HOLDER, motors(0b101), now + HOLD_LEASE);
    ledger.stopped(7, HOLDER, motors(0b001), now);
    assert_eq!(ledger.renew(7, now), Ok(()), "motor 3 is still held");
    ledger.stopped(7, HOLDER, motors(0b100), now);
    assert_eq!(ledger.renew(7, now), Err(None));
}

#[test]
fn a_kill_ends_holds_without_a_stop_unless_the_board_does_not_take_it() {
    let now = Instant::now();
    let end = HoldEnd::Control(control::KILL);
    for taken in [true, false] {
        let mut ledger = Ledger::default();
        ledger.hold(7, HOLDER, motors(0b1), now + HOLD_LEASE);
        ledger.stop_all_begins(control::KILL, now);
        assert_eq!(ledger.renew(7, now), Err(Some(end)));
        assert_eq!(ledger.all_stopped().len(), 1);
        assert_eq!(ledger.holds(), 0);
        ledger.hold(8, HOLDER, motors(0b10), now);
        ledger.stop_all_begins(control::KILL, now);
        if taken {
            assert_eq!(ledger.all_stopped(), [8]);
            assert_eq!(ended(&mut ledger, now + HOLD_LEASE, |_| false), 0);
        } else {
            assert_eq!(ended(&mut ledger, now + HOLD_LEASE / 2, |_| true), 0);
            assert_eq!(ended(&mut ledger, now + HOLD_LEASE, |_| true), 0b10);
        }
        assert_eq!(ledger.renew(8, now), Err(Some(end)));
        assert_eq!(ledger.stop_for(8, motors(0b10), now), Err(end), "its stop would close the loop");
        assert_eq!(ledger.stop_for(8, motors(0b10), now), Ok(false), "it has been told");
    }
}

#[test]
fn an_opened_loop_ends_the_hold_on_its_motor() {
    let now = Instant::now();
    let mut ledger = Ledger::default();
    ledger.hold(7, HOLDER, motors(0b11), now + HOLD_LEASE);
    ledger.hold(8, HOLDER, motors(0b100), now + HOLD_LEASE);
    assert_eq!(ledger.stop_for(8, motors(0b100), now), Ok(true));
    assert_eq!(ledger.stop_for(8, motors(0b101), now), Ok(false), "it holds only one of them");
    ledger.see(Motion::default(), motors(0b10), now);
    assert_eq!(ledger.renew(8, now), Ok(()));
    assert_eq!(ended(&mut ledger, now, |_| true), 0b11, "the other motor may be moving");
    let end = HoldEnd::OpenLoop(motors(0b10));
    assert_eq!(ledger.renew(7, now), Err(Some(end)));
    assert!(end.to_string().contains("the loop of motor 2 is open"), "{end}");
    ledger.forget(7);
    assert_eq!(ledger.renew(7, now), Err(None));
}

#[test]
fn another_ones_stop_ends_a_hold_and_the_holder_is_told() {
    let now = Instant::now();
    let mut ledger = Ledger::default();
    ledger.hold(7, HOLDER, motors(0b11), now + HOLD_LEASE);
    ledger.hold(8, HOLDER, motors(0b100), now + HOLD_LEASE);
    assert_eq!(ledger.held_by_another(9, motors(0b10)), Some((HOLDER, motors(0b10))));
    assert_eq!(ledger.held_by_another(7, motors(0b11)), None);
    assert_eq!(ledger.held_by_another(9, motors(0b1000)), None);
    let by = Account { uid: 1001, pid: 6 };
    ledger.stopped(9, by, motors(0b1), now);
    let end = HoldEnd::Stopped(by, motors(0b1));
    assert_eq!((ledger.renew(7, now), ledger.renew(8, now)), (Err(Some(end)), Ok(())));
    assert!(end.to_string().ends_with("uid 1001 (pid 6) stopped motor 1"), "{end}");
    assert_eq!(ended(&mut ledger, now, |_| true), 0b11, "the other motor may be moving");
    assert_eq!(ledger.renew(7, now), Err(Some(end)));
}

#[test]
fn a_held_motor_that_stands_is_held_no_more() {
    let now = Instant::now();
    let at = |count| now + ms(count);
    let (moving, standing) = (motion(1, 0), motion(0, 1));
    let mut ledger = Ledger::default();
    ledger.hold(7, HOLDER, motors(1), at(10_000));
    ledger.see(standing, Motors::NONE, at(0));
    assert_eq!(ended(&mut ledger, at(500), |_| true), 0, "it has not begun to move");
    ledger.see(moving, Motors::NONE, at(600));
    ledger.see(standing, Motors::NONE, at(700));
    ledger.see(moving, Motors::NONE, at(750));
    assert_eq!(ended(&mut ledger, at(900), |_| true), 0, "it turned round");
    ledger.see(standing, Motors::NONE, at(1000));
    assert_eq!(ledger.next_moment(), Some(at(1100)));
    assert_eq!(ended(&mut ledger, at(1099), |_| true), 0);
    assert_eq!(ended(&mut ledger, at(1100), |_| true), 1);
    let told = ledger.renew(7, at(1100)).unwrap_err().unwrap().to_string();
    assert!(told.contains("motor 1 stands") && told.contains("every motor of the hold"), "{told}");
}

#[test]
fn two_held_motors_that_turn_round_one_after_the_other_are_held() {
    let now = Instant::now();
    let at = |count| now + ms(count);
    let mut ledger = Ledger::default();
    ledger.hold(7, HOLDER, motors(0b11), at(10_000));
    for (count, standing) in [(0, 0), (10, 0b01), (80, 0b11), (90, 0b10)] {
        ledger.see(motion(0b11 & !standing, standing), Motors::NONE, at(count));
    }
    assert_eq!(ended(&mut ledger, at(150), |_| true), 0, "neither has stood for long enough");
    ledger.see(motion(0, 0b11), Motors::NONE, at(160));
    assert_eq!(ended(&mut ledger, at(190), |_| true), 0b11, "both are stopped");
    assert_eq!(ledger.renew(7, at(190)), Err(Some(HoldEnd::Stands(motors(0b10)))));
}

#[test]
fn a_jog_by_line_ends_with_its_client_unless_it_is_over_or_anothers() {
    let now = Instant::now();
    let at = |count| now + ms(count);
    let mut ledger = Ledger::default();
    jogs(&mut ledger, 7, 0b111, None, now);
    jogs(&mut ledger, 8, 0b010, None, now);
    ledger.commanded(motors(0b001));
    assert_eq!(ledger.held_by_another(9, Motors::ALL), None, "anybody may command them");
    assert_eq!(ended(&mut ledger, now, |client| client != 7), 0b100);
    assert_eq!(ended(&mut ledger, now, |client| client != 7), 0);
    assert_eq!(ended(&mut ledger, now, |_| false), 0b010);
    let see = |ledger: &mut Ledger, moving: u32, count| {
        ledger.see(motion(moving, !moving), Motors::NONE, at(count));
    };
    jogs(&mut ledger, 7, 0b11, None, now);
    see(&mut ledger, 0b00, 0);
    see(&mut ledger, 0b01, 200);
    see(&mut ledger, 0b00, 300);
    see(&mut ledger, 0b01, 350);
    see(&mut ledger, 0b00, 400);
    // Another client moves the first motor again.
    see(&mut ledger, 0b11, 600);
    assert_eq!(ended(&mut ledger, at(600), |_| false), 0b10, "the second one had not begun to move");
}

#[test]
fn a_line_that_may_have_done_nothing_takes_nobodys_jog_away() {
    let now = Instant::now();
    let mut ledger = Ledger::default();
    jogs(&mut ledger, 7, 1, None, now);
    ledger.jog_by_line(8, motors(1), None, now);
    assert_eq!(ended(&mut ledger, now, |client| client != 7), 1);
    jogs(&mut ledger, 7, 1, None, now);
    ledger.jog_by_line(8, motors(1), None, now);
    assert_eq!(ended(&mut ledger, now, |client| client != 8), 1, "or it may have");
    assert!(!ledger.jogs_by_line(7, now).is_empty());
    jogs(&mut ledger, 9, 1, None, now);
    assert_eq!(ended(&mut ledger, now, |client| client == 9), 0);
}

#[test]
fn a_jog_by_line_ends_when_its_client_is_silent_for_as_long_as_he_said() {
    let now = Instant::now();
    let at = |count| now + ms(count);
    let mut ledger = Ledger::default();
    jogs(&mut ledger, 7, 0b01, Some(ms(1000)), now);
    jogs(&mut ledger, 8, 0b10, None, now);
    assert_eq!((ledger.next_moment(), ended(&mut ledger, at(999), |_| true)), (Some(at(1000)), 0));
    ledger.hear(|client| client == 7, at(999));
    assert!(ended(&mut ledger, at(1998), |_| true) == 0 && !ledger.jogs_by_line(7, at(1998)).is_empty());
    assert_eq!(ended(&mut ledger, at(1999), |_| true), 0b01);
    assert!(ledger.jogs_by_line(7, at(1999)).is_empty() && !ledger.jogs_by_line(8, at(1999)).is_empty());
    assert_eq!((ledger.next_moment(), ended(&mut ledger, at(9999), |_| true)), (None, 0));
}

#[test]
fn the_daemons_end_ends_holds_and_jogs_by_line_and_holders_hear_of_it() {
    let now = Instant::now();
    let mut ledger = Ledger::default();
    ledger.hold(7, HOLDER, motors(0b001), now + HOLD_LEASE);
    jogs(&mut ledger, 8, 0b010, Some(ms(1000)), now);
    ledger.jog_by_panel(motors(0b100));
    ledger.daemon_ends(now);
    ledger.hear(|_| true, now);
    assert_eq!(ended(&mut ledger, now, |_| true), 0b011, "nobody was to hold motor 3");
    assert!(ledger.has_untold() && ledger.holds() == 0);
    ledger.forget(7);
    assert!(!ledger.has_untold());
}

#[test]
fn a_motor_jogged_by_the_panel_is_told_once_until_it_stands() {
    let now = Instant::now();
    let at = |count| now + ms(count);
    let mut ledger = Ledger::default();
    let (moving, standing) = (motion(1, 0b10), motion(0, 0b11));
    let going = |ledger: &Ledger, motion| ledger.going_by_panel(motion).bits();
    ledger.jog_by_panel(motors(0b11));
    ledger.see(standing, Motors::NONE, at(0));
    assert_eq!(going(&ledger, standing), 0, "a report from just before it");
    ledger.see(moving, Motors::NONE, at(200));
    assert_eq!((ledger.newly_alone(moving).bits(), ledger.newly_alone(moving).bits()), (1, 0));
    assert_eq!(going(&ledger, Motion::default()), 0b11, "no report tells");
    for count in [300, 400] {
        ledger.see(standing, Motors::NONE, at(count));
    }
    assert_eq!(going(&ledger, Motion::default()), 0b10, "motor 1 has come to its end");
    ledger.commanded(motors(0b10));
    assert_eq!(going(&ledger, motion(0b11, 0)), 0, "something else moves them");
}
