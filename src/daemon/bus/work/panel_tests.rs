//! Panel requests: which request waits for which event, and for how long.

use super::*;
use crate::device::FileBoard;
use crate::function::panel::PanelAction;
use crate::map::{PMAC, pmac};

const PANEL: &crate::map::PanelBlock = &pmac::PANEL_BLOCK;

fn memory() -> FileBoard {
    let file = tempfile::tempfile().unwrap();
    file.set_len(PMAC.length.into()).unwrap();
    FileBoard::from_file(&file, PMAC.length as usize).unwrap()
}

#[test]
fn one_after_the_other_and_none_by_surprise() {
    let mut bus = memory();
    let now = Instant::now();
    let mut queue = PanelQueue::new(&PMAC, now).unwrap();
    let request = |number| PanelRequest::of(PANEL, PanelAction::JogPlus, &[number]).unwrap();
    for number in 1..=3 {
        queue.submit(Ticket(number as u64), request(number), now + PANEL_POLL * 10, now);
    }
    let first = |bus: &mut FileBoard| [PANEL.request_enable, PANEL.request].map(|at| bus.read16(at).unwrap());
    assert!(queue.poll(&mut bus, now).unwrap().is_none());
    assert_eq!(first(&mut bus), [1, PanelAction::JogPlus.bits()]);
    assert!(queue.poll(&mut bus, now).unwrap().is_none(), "the board has not taken it");
    bus.write16(PANEL.request_enable, 0).unwrap();
    assert!(matches!(queue.poll(&mut bus, now).unwrap(), Some(Event::Done(Ticket(1), Outcome::Done))));
    assert!(queue.poll(&mut bus, now).unwrap().is_none());
    assert_eq!(bus.read16(PANEL.request_enable).unwrap(), 2);
    let late = now + PANEL_POLL * 10;
    for ticket in [2, 3] {
        let event = queue.poll(&mut bus, late).unwrap();
        let Some(Event::Done(Ticket(of), outcome)) = event else { panic!("{event:?}") };
        assert_eq!((of, outcome.is_unsent()), (ticket, ticket == 3), "{outcome:?}");
        let told = if ticket == 2 { "It has been withdrawn" } else { "It was not carried out" };
        assert!(format!("{outcome:?}").contains(told), "{outcome:?}");
        assert_eq!(bus.read16(PANEL.request_enable).unwrap(), 0, "withdrawn, or never written");
    }
    assert!(queue.due().is_none());
}

#[test]
fn after_a_withdrawal_what_moves_waits_and_a_stop_goes_at_once_and_twice() {
    let mut bus = memory();
    let begun = Instant::now();
    let mut queue = PanelQueue::new(&PMAC, begun).unwrap();
    queue.acquire(&mut bus, begun).unwrap();
    let request = |action, number| PanelRequest::of(PANEL, action, &[number]).unwrap();
    let (jog, stop) = (request(PanelAction::JogPlus, 1), request(PanelAction::JogStop, 2));
    let deadline = begun + PANEL_REST * 10;
    let mask = |bus: &mut FileBoard| bus.read16(PANEL.request_enable).unwrap();
    queue.submit(Ticket(1), jog, deadline, begun);
    assert!(queue.poll(&mut bus, begun).unwrap().is_none());
    assert_eq!(mask(&mut bus), 0, "the jog waits");
    queue.submit(Ticket(2), stop, deadline, begun);
    for _ in 0..2 {
        assert!(queue.poll(&mut bus, begun).unwrap().is_none());
        assert_eq!(mask(&mut bus), 0b10, "the first clearing may be that of what was withdrawn");
        bus.write16(PANEL.request_enable, 0).unwrap();
    }
    let told = told(&mut queue, &mut bus, begun);
    let [(2, Outcome::Done), (1, Outcome::Refused(why))] = told[..] else { panic!("{told:?}") };
    assert!(why.contains("a stop came before the panel was free for it"), "{why:?}");
    queue.submit(Ticket(3), jog, begun + PANEL_POLL, begun);
    queue.submit(Ticket(4), jog, deadline, begun);
    let told = self::told(&mut queue, &mut bus, begun + PANEL_POLL);
    assert!(matches!(told[..], [(3, Outcome::Refused(_))]), "in its time: {told:?}");
    assert!(queue.poll(&mut bus, begun + PANEL_REST).unwrap().is_none());
    assert_eq!(mask(&mut bus), 0b01, "the panel has rested");
    bus.write16(PANEL.request_enable, 0).unwrap();
    let told = self::told(&mut queue, &mut bus, begun + PANEL_REST);
    assert_eq!(told, [(4, Outcome::Done)]);
}

#[test]
fn at_the_end_every_stop_has_its_place() {
    let mut bus = memory();
    let now = Instant::now();
    let mut queue = PanelQueue::new(&PMAC, now).unwrap();
    let deadline = now + PANEL_POLL * 50;
    let jog = PanelRequest::of(PANEL, PanelAction::JogPlus, &[1]).unwrap();
    let stop = |number| PanelRequest::of(PANEL, PanelAction::JogStop, &[number]).unwrap();
    for ticket in 0..16 {
        queue.submit(Ticket(ticket), jog, deadline, now);
    }
    queue.submit(Ticket(98), stop(2), deadline, now);
    queue.keep_stops();
    for number in 1..=8 {
        queue.submit(Ticket(100), stop(number), deadline, now);
    }
    queue.keep_stops();
    assert!(queue.poll(&mut bus, now).unwrap().is_none());
    assert_eq!(bus.read16(PANEL.request_enable).unwrap(), 0xFF, "one request for all");
    bus.write16(PANEL.request_enable, 0).unwrap();
    assert!(queue.poll(&mut bus, now).unwrap().is_some());
    assert_eq!(queue.due(), None, "no jog is left");
}

#[test]
fn the_stop_of_a_held_jog_leaves_a_killed_motor_alone() {
    let mut bus = memory();
    let now = Instant::now();
    let mut queue = PanelQueue::new(&PMAC, now).unwrap();
    let deadline = now + PANEL_POLL * 50;
    let mask = |bus: &mut FileBoard| bus.read16(PANEL.request_enable).unwrap();
    queue.loops_mut().see_servo(Motors::from_bits(0b010), 10);
    queue.end_hold(Ticket(1), Motors::from_bits(0b111), deadline, now);
    assert!(queue.poll(&mut bus, now).unwrap().is_none());
    assert_eq!(mask(&mut bus), 0b101);
    bus.write16(PANEL.request_enable, 0).unwrap();
    assert!(matches!(queue.poll(&mut bus, now).unwrap(), Some(Event::Done(Ticket(1), Outcome::Done))));
    queue.end_hold(Ticket(2), Motors::from_bits(0b010), deadline, now);
    assert!(matches!(queue.poll(&mut bus, now).unwrap(), Some(Event::Done(Ticket(2), Outcome::Done))));
    assert_eq!((mask(&mut bus), queue.due()), (0, None), "nothing was to be done");
    // A jog has just closed the loop, and the report does not show that yet.
    let jog = PanelRequest::of(PANEL, PanelAction::JogPlus, &[2]).unwrap();
    queue.submit(Ticket(3), jog, deadline, now);
    queue.end_hold(Ticket(4), Motors::from_bits(0b010), deadline, now);
    assert_eq!(queue.open_loops(), Motors::of(2));
    assert!(queue.poll(&mut bus, now).unwrap().is_none());
    assert_eq!(queue.open_loops(), Motors::NONE, "the jog lies in the panel");
    assert!(queue.poll(&mut bus, now).unwrap().is_none());
    queue.loops_mut().see_servo(Motors::from_bits(0b010), 11);
    queue.loops_mut().see_servo(Motors::from_bits(0b010), 20);
    assert_eq!(queue.open_loops(), Motors::NONE, "still, however many reports come");
    bus.write16(PANEL.request_enable, 0).unwrap();
    assert!(queue.poll(&mut bus, now).unwrap().is_some());
    queue.loops_mut().see_servo(Motors::from_bits(0b010), 21);
    assert!(queue.poll(&mut bus, now).unwrap().is_none());
    assert_eq!(mask(&mut bus), 0b010, "it may be moving");
    bus.write16(PANEL.request_enable, 0).unwrap();
    assert!(queue.poll(&mut bus, now).unwrap().is_some());
    // The panel carries out a client's own stop, also at the end.
    queue.loops_mut().see_servo(Motors::from_bits(0b011), 30);
    let stop = PanelRequest::of(PANEL, PanelAction::JogStop, &[1]).unwrap();
    queue.end_hold(Ticket(5), Motors::from_bits(0b010), deadline, now);
    queue.submit(Ticket(6), stop, deadline, now);
    queue.keep_stops();
    assert!(queue.poll(&mut bus, now).unwrap().is_none());
    assert_eq!(mask(&mut bus), 0b001);
}

/// Polls until the queue tells nothing more; returns all that it told.
fn told(queue: &mut PanelQueue, bus: &mut FileBoard, now: Instant) -> Vec<(u64, Outcome)> {
    let events = (0..10).filter_map(|_| queue.poll(bus, now).unwrap());
    let told = events.map(|event| match event {
        Event::Done(Ticket(ticket), outcome) => (ticket, outcome),
        other => panic!("{other:?}"),
    });
    told.collect()
}

#[test]
fn a_stop_in_the_panel_never_closes_the_loop_that_a_kill_opens() {
    for is_taken in [true, false] {
        let mut bus = memory();
        let now = Instant::now();
        let mut queue = PanelQueue::new(&PMAC, now).unwrap();
        let mask = |bus: &mut FileBoard| bus.read16(PANEL.request_enable).unwrap();
        queue.end_hold(Ticket(1), Motors::from_bits(0b1), now + PANEL_POLL * 50, now);
        let stop = PanelRequest::of(PANEL, PanelAction::JogStop, &[2]).unwrap();
        queue.submit(Ticket(2), stop, now + PANEL_POLL * 50, now);
        assert!(queue.poll(&mut bus, now).unwrap().is_none());
        assert_eq!(mask(&mut bus), 0b1);
        queue.make_way(&mut bus, 7, control::KILL, now).unwrap();
        queue.make_way(&mut bus, 7, control::ABORT, now).unwrap();
        assert_eq!(mask(&mut bus), 0, "withdrawn before ^K is written");
        queue.see_kill(Kill { is_under_way: true, taken: 0 });
        assert_eq!((told(&mut queue, &mut bus, now), mask(&mut bus)), (vec![], 0));
        queue.see_kill(Kill { is_under_way: false, taken: is_taken.into() });
        if is_taken {
            let done = vec![(1, Outcome::Done), (2, Outcome::Done)];
            assert_eq!((told(&mut queue, &mut bus, now), mask(&mut bus)), (done, 0));
            assert_eq!(queue.due(), None);
        } else {
            assert_eq!((told(&mut queue, &mut bus, now), mask(&mut bus)), (vec![], 0b1), "it goes on");
        }
    }
}

#[test]
fn nothing_that_moves_goes_after_an_abort() {
    for character in [control::ABORT, control::KILL] {
        let mut bus = memory();
        let now = Instant::now();
        let mut queue = PanelQueue::new(&PMAC, now).unwrap();
        let jog = |number| PanelRequest::of(PANEL, PanelAction::JogPlus, &[number]).unwrap();
        for number in 1..=2 {
            queue.submit(Ticket(number as u64), jog(number), now + PANEL_POLL * 50, now);
        }
        assert!(queue.poll(&mut bus, now).unwrap().is_none());
        queue.make_way(&mut bus, 7, character, now).unwrap();
        assert_eq!(bus.read16(PANEL.request_enable).unwrap(), 0);
        let told = told(&mut queue, &mut bus, now);
        let [(1, Outcome::Interrupted(first)), (2, second)] = told[..] else { panic!("{told:?}") };
        assert!(first.contains("it may have been carried out before"), "{first:?}");
        assert_eq!(second, Outcome::Dropped(dropped_by(7, character)));
        assert_eq!((queue.due(), bus.read16(PANEL.request_enable).unwrap()), (None, 0));
    }
}

#[test]
fn a_request_under_way_is_answered_however_often_the_board_is_taken_over() {
    let mut bus = memory();
    let begun = Instant::now();
    let mut queue = PanelQueue::new(&PMAC, begun).unwrap();
    let request = PanelRequest::of(PANEL, PanelAction::JogPlus, &[1]).unwrap();
    // The mask when the daemon takes the board over: whatever the mask, the board may have seen the request.
    for (ticket, mask) in (7..).zip([1, 0, 0xFFFF]) {
        let now = begun + (ticket as u32) * PANEL_REST;
        queue.submit(Ticket(ticket), request, now + PANEL_POLL, now);
        assert!(queue.poll(&mut bus, now).unwrap().is_none());
        assert_eq!(bus.read16(PANEL.request_enable).unwrap(), 1, "it lies in the panel");
        bus.write16(PANEL.request_enable, mask).unwrap();
        queue.leave(&mut bus).unwrap();
        queue.acquire(&mut bus, now).unwrap();
        queue.acquire(&mut bus, now).unwrap();
        let event = queue.poll(&mut bus, now).unwrap();
        assert!(matches!(event, Some(Event::Done(Ticket(t), Outcome::TimedOut)) if t == ticket), "{event:?}");
        assert_eq!((queue.due(), bus.read16(PANEL.request_enable).unwrap()), (None, 0));
    }
}

#[test]
fn a_stop_waits_its_own_time_and_not_that_of_a_request_which_the_board_does_not_take() {
    let mut bus = memory();
    let begun = Instant::now();
    let mut queue = PanelQueue::new(&PMAC, begun).unwrap();
    queue.acquire(&mut bus, begun).unwrap();
    let request = |action, number| PanelRequest::of(PANEL, action, &[number]).unwrap();
    let now = begun + PANEL_REST;
    queue.submit(Ticket(1), request(PanelAction::JogPlus, 1), now + PANEL_REST * 20, now);
    assert!(queue.poll(&mut bus, now).unwrap().is_none());
    queue.submit(Ticket(2), request(PanelAction::JogStop, 2), now + PANEL_REST * 2, now);
    assert!(queue.poll(&mut bus, now + PANEL_REST).unwrap().is_none());
    let told = told(&mut queue, &mut bus, now + PANEL_REST * 2);
    assert!(matches!(told[..], [(2, Outcome::Refused(_))]), "the daemon sends a line then: {told:?}");
}
