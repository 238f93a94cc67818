//! Command lines for a hand-driven board: who waits for whom, and what is never begun.

use super::*;
use crate::daemon::shared::open_buffer::Account;
use crate::daemon::shared::queue::{Receive, queue};
use crate::device::FileBoard;
use crate::format::TextOrder;
use crate::function::ascii::SETTLE;
use crate::map::PMAC;
use crate::map::functions::response;
use crate::segment::{CreateOptions, Identity, SegmentName};

struct Rig {
    bus: FileBoard,
    queue: AsciiQueue,
    events: Sender<Event>,
    told: Receive<Event>,
    publisher: Publisher,
    _directory: tempfile::TempDir,
    now: Instant,
}

impl Rig {
    fn new() -> Self {
        let file = tempfile::tempfile().unwrap();
        file.set_len(0x4000).unwrap();
        let directory = tempfile::tempdir().unwrap();
        let options = CreateOptions {
            directory: directory.path().to_owned(),
            ..CreateOptions::new(SegmentName::new("queue").unwrap(), Vec::new())
        };
        let clock = Clock::real();
        let now = clock.now();
        let port = CommandPorts::new(&PMAC, TextOrder::LowFirst, None, now);
        let (events, told) = queue(16).unwrap();
        Self {
            bus: FileBoard::from_file(&file, 0x4000).unwrap(),
            queue: AsciiQueue::new(port, Identifier::new(&PMAC, Identity::default(), false, now), clock),
            events,
            told,
            publisher: Publisher::create(&options).unwrap(),
            _directory: directory,
            now,
        }
    }

    fn send(&mut self, ticket: u64, line: &str, patience: Duration) {
        let line = Text::new(line.as_bytes()).unwrap();
        let deadline = self.now + patience;
        let writer = Writer::Hand(Account { uid: 0, pid: 1 });
        let command = Command::Send { ticket: Ticket(ticket), line, deadline, writer };
        self.queue.submit(&command, self.now);
    }

    fn control(&mut self, ticket: u64, character: u8) {
        let deadline = self.now + Duration::from_secs(5);
        let command = Command::Control { ticket: Ticket(ticket), uid: 0, character, deadline };
        self.queue.submit(&command, self.now);
    }

    fn poll(&mut self) {
        self.queue.poll(&mut self.bus, &self.events, &self.publisher, self.now).unwrap();
    }

    fn ended(&self) -> Vec<(u64, Outcome)> {
        std::iter::from_fn(|| self.told.try_receive())
            .filter_map(|event| match event {
                Event::Done(ticket, outcome) => Some((ticket.0, outcome)),
                _ => None,
            })
            .collect()
    }

    fn loaded(&mut self) -> bool {
        self.bus.read16(PMAC.ascii.command_loaded.word).unwrap() & PMAC.ascii.command_loaded.mask != 0
    }
}

#[test]
fn a_line_whose_time_is_over_is_never_begun() {
    let mut rig = Rig::new();
    rig.send(1, "P1", Duration::from_secs(60));
    rig.poll();
    assert!(rig.loaded());
    rig.bus.write16(PMAC.ascii.command_loaded.word, 0).unwrap();
    for ticket in [2, 3, 4] {
        rig.send(ticket, "#1J+", Duration::from_millis(100));
    }
    // The daemon stands still for a second; meanwhile the board answers.
    rig.bus.write16(PMAC.ascii.response_control, response::ACKNOWLEDGE).unwrap();
    rig.now += Duration::from_secs(1);
    for _ in 0..6 {
        rig.poll();
        assert!(!rig.loaded(), "its caller has been told that it was not done");
    }
    let unavailable = |ticket| (ticket, Outcome::Unavailable);
    assert_eq!(rig.ended(), [(1, Outcome::Done), unavailable(2), unavailable(3), unavailable(4)]);
}

#[test]
fn a_line_that_lay_before_a_board_that_answered_so_far_may_have_been_carried_out() {
    for (state, outcome) in [
        (CommandState::Answers, Outcome::TimedOut),
        (CommandState::Unknown, Outcome::TimedOut),
        (CommandState::Silent, Outcome::Unavailable),
    ] {
        let mut rig = Rig::new();
        rig.queue.state = state;
        rig.send(1, "SAVE", Duration::from_millis(1));
        rig.poll();
        assert!(rig.loaded());
        rig.now += Duration::from_millis(1);
        rig.poll();
        assert!(!rig.loaded(), "withdrawn");
        rig.now += SETTLE;
        rig.poll();
        assert_eq!(rig.ended(), [(1, outcome)], "{state:?}");
    }
}

#[test]
fn that_a_line_was_not_taken_is_said_after_a_silence_only() {
    for (answers, outcome) in [(false, Outcome::Unavailable), (true, Outcome::TimedOut)] {
        let mut rig = Rig::new();
        rig.queue.state = CommandState::Silent;
        rig.send(1, "#1J:100", Duration::from_millis(1));
        rig.send(2, "P2", Duration::from_secs(5));
        rig.poll();
        assert!(rig.loaded());
        rig.now += Duration::from_millis(1);
        rig.poll();
        assert!(!rig.loaded(), "withdrawn");
        assert_eq!(rig.ended(), [], "a board may clear the flag only when it has done the line");
        if answers {
            rig.now += SETTLE / 2;
            rig.bus.write16(PMAC.ascii.response_control, response::ACKNOWLEDGE).unwrap();
            rig.poll();
            assert_eq!(rig.ended(), [(1, outcome)], "who sends it again would jog twice");
        }
        rig.now += SETTLE;
        rig.poll();
        assert!(answers || rig.ended() == [(1, outcome)]);
        rig.poll();
        assert!(rig.loaded(), "the next line goes out");
    }
}

#[test]
fn a_line_that_waits_for_another_says_nothing_of_the_board() {
    let mut rig = Rig::new();
    rig.send(1, "LIST", Duration::from_secs(60));
    rig.send(2, "P2", Duration::from_secs(1));
    rig.poll();
    rig.bus.write16(PMAC.ascii.command_loaded.word, 0).unwrap();
    rig.queue.state = CommandState::Answers;
    rig.now += Duration::from_secs(1);
    rig.poll();
    assert_eq!(rig.ended(), [(2, Outcome::Busy)]);
    assert_eq!(rig.queue.state(), CommandState::Answers);
}

#[test]
fn a_new_board_does_nothing_of_what_the_old_one_was_told() {
    const ABORT: u8 = 0x01;
    const ONES: u16 = u16::MAX;
    // What the words of the flag and of the control character hold when the reset is noticed, and what may be said then.
    for (flag, character, outcome) in [
        (PMAC.ascii.command_loaded.mask, u16::from(ABORT), Outcome::Unavailable),
        (0, 0, Outcome::TimedOut),
        (ONES, ONES, Outcome::TimedOut),
    ] {
        let mut rig = Rig::new();
        rig.send(1, "P1", Duration::from_secs(600));
        rig.control(2, ABORT);
        rig.poll();
        rig.poll();
        assert!(rig.loaded());
        rig.bus.write16(PMAC.ascii.command_loaded.word, flag).unwrap();
        rig.bus.write16(PMAC.ascii.control_character, character).unwrap();
        rig.queue.reset(&mut rig.bus, rig.now).unwrap();
        assert!(!rig.loaded());
        assert_ne!(rig.bus.read16(PMAC.ascii.control_character).unwrap(), u16::from(ABORT));
        rig.bus.write16(PMAC.ascii.control_character, 0).unwrap();
        for _ in 0..3 {
            rig.poll();
            rig.now += SETTLE;
        }
        let mut ended = rig.ended();
        ended.sort_by_key(|(ticket, _)| *ticket);
        assert_eq!(ended, [(1, outcome), (2, outcome)], "{flag:#x}");
    }
}

#[test]
fn the_second_half_of_a_line_is_no_line_for_a_new_board() {
    let mut rig = Rig::new();
    rig.send(1, &format!("{}#1J+", " ".repeat(180)), Duration::from_secs(600));
    rig.poll();
    assert!(rig.loaded());
    rig.bus.write16(PMAC.ascii.command_loaded.word, 0).unwrap();
    rig.queue.reset(&mut rig.bus, rig.now).unwrap();
    rig.bus.write16(PMAC.ascii.control_character, 0).unwrap();
    for _ in 0..3 {
        rig.poll();
        assert!(!rig.loaded());
        rig.now += SETTLE;
    }
    assert_eq!(rig.ended(), [(1, Outcome::Unavailable)]);
}

#[test]
fn what_stops_the_machine_does_not_wait_behind_a_report() {
    const POSITIONS: u8 = 0x10;
    const KILL_ALL: u8 = 0x0B;
    let mut rig = Rig::new();
    rig.send(1, "P1", Duration::from_secs(60));
    rig.poll();
    assert!(rig.loaded(), "the board does not answer yet");
    rig.control(2, POSITIONS);
    rig.control(3, KILL_ALL);
    rig.poll();
    assert_eq!(rig.bus.read16(PMAC.ascii.control_character).unwrap(), u16::from(KILL_ALL));
    rig.bus.write16(PMAC.ascii.control_character, 0).unwrap();
    rig.poll();
    assert_eq!(rig.ended(), [(3, Outcome::Done)]);
    // The report comes when the line is done.
    rig.bus.write16(PMAC.ascii.command_loaded.word, 0).unwrap();
    rig.bus.write16(PMAC.ascii.response_control, response::ACKNOWLEDGE).unwrap();
    rig.poll();
    rig.poll();
    assert_eq!(rig.bus.read16(PMAC.ascii.control_character).unwrap(), u16::from(POSITIONS));
}

#[test]
fn characters_go_in_time_while_lines_always_wait() {
    let (abort, query) = (b'A' - 64, b'F' - 64);
    let mut rig = Rig::new();
    for ticket in 1..=3 {
        rig.send(ticket, "P1", Duration::from_secs(60));
    }
    rig.poll();
    assert!(rig.loaded());
    for ticket in 11..=18 {
        rig.control(ticket, query);
    }
    rig.control(20, abort);
    rig.poll();
    let word = PMAC.ascii.control_character;
    assert_eq!(rig.bus.read16(word).unwrap(), u16::from(abort), "it waits for nobody");
    rig.bus.write16(word, 0).unwrap();
    // The line under way, then a character, then a line again: neither kind holds up the other.
    for expected in [1, 11, 2, 12, 3, 13, 14] {
        let is_line = expected < 10;
        for _ in 0..2 {
            rig.poll();
        }
        assert_eq!(rig.loaded(), is_line, "{expected}");
        rig.bus.write16(PMAC.ascii.command_loaded.word, 0).unwrap();
        rig.bus.write16(word, 0).unwrap();
        rig.bus.write16(PMAC.ascii.response_control, response::ACKNOWLEDGE).unwrap();
        rig.poll();
        rig.now += Duration::from_millis(1);
        let ended: Vec<_> = rig.ended().into_iter().filter(|(ticket, _)| *ticket != 20).collect();
        assert_eq!(ended, [(expected, Outcome::Done)]);
    }
}

#[test]
fn a_character_that_only_waited_for_a_line_says_nothing_of_the_board() {
    let mut rig = Rig::new();
    rig.send(1, "P1", Duration::from_secs(60));
    rig.poll();
    rig.control(2, b'F' - 64);
    rig.now += Duration::from_secs(5);
    rig.poll();
    assert_eq!(rig.ended(), [(2, Outcome::Busy)]);
}
