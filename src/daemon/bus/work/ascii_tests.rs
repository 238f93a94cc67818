//! Command lines for a hand-driven board: which line waits for which, and which lines the daemon never begins.

use std::sync::Arc;

use super::*;
use crate::daemon::bus::memory_scan::MemoryScan;
use crate::daemon::shared::open_buffer::{Account, Barred};
use crate::daemon::shared::queue::{Receive, queue};
use crate::daemon::shared::status::LinesStatus;
use crate::device::FileBoard;
use crate::format::TextOrder;
use crate::function::ascii::PORT_REST;
use crate::function::line_port::AsciiEvent;
use crate::map::PMAC;
use crate::map::functions::response;
use crate::protocol::control::CANCEL;
use crate::segment::{CreateOptions, Identity, SegmentName};

#[path = "ascii/buffer_tests.rs"]
mod buffer;
#[path = "ascii/character_tests.rs"]
mod character;
#[path = "ascii/error_tests.rs"]
mod error;
#[path = "ascii/stop_tests.rs"]
mod stop;
#[path = "ascii/wait_tests.rs"]
mod wait;

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
    /// The queue's present knowledge.
    fn status(&self) -> LinesStatus {
        let mut status = LinesStatus::default();
        self.queue.tell(&mut status, true, self.now);
        status
    }

    /// The events that the socket got, with the lines of replies and the texts of programs.
    fn told(&self) -> Vec<String> {
        let shown = |event| match event {
            Event::Line(ticket, text) => Some(format!("{} {}", ticket.0, text.to_latin1())),
            Event::Done(ticket, outcome) => Some(format!("{} {outcome:?}", ticket.0)),
            Event::Unsolicited(message) => Some(format!("{:?} {}", message.kind, message.text.to_latin1())),
            _ => None,
        };
        std::iter::from_fn(|| self.told.try_receive()).filter_map(shown).collect()
    }

    /// Servo reports come, and say that no program buffer is open.
    fn new() -> Self {
        let mut rig = Self::without_reports();
        rig.queue.see_buffer(Some((false, 1)));
        rig
    }

    fn without_reports() -> Self {
        let file = tempfile::tempfile().unwrap();
        file.set_len(0x4000).unwrap();
        let directory = tempfile::tempdir().unwrap();
        let options = CreateOptions {
            directory: directory.path().to_owned(),
            ..CreateOptions::new(SegmentName::new("queue").unwrap(), Vec::new())
        };
        let clock = Clock::real();
        let now = clock.now();
        let mut port = CommandPorts::new(&PMAC, TextOrder::LowFirst, None);
        let mut bus = FileBoard::from_file(&file, 0x4000).unwrap();
        // The board has taken a control character before.
        assert!(port.current_mut().control(&mut bus, b'F' - 64, true, now).unwrap());
        bus.write16(PMAC.ascii.control_character, 0).unwrap();
        assert_eq!(port.poll(&mut bus, now).unwrap(), Some(AsciiEvent::Taken));
        port.current_mut().settled(now);
        let (events, told) = queue(16).unwrap();
        Self {
            bus,
            queue: AsciiQueue::new(
                port,
                Identifier::new(&PMAC, Identity::default(), false, now),
                MemoryScan::new(&PMAC, false, Arc::default(), now),
                clock,
            ),
            events,
            told,
            publisher: Publisher::create(&options).unwrap(),
            _directory: directory,
            now,
        }
    }

    fn send(&mut self, ticket: u64, line: &str, patience: Duration) {
        let line = Line::of(line);
        let deadline = self.now + patience;
        let origin = Origin::of(1000, &line, false);
        let writer = Writer::Hand(Account { uid: 0, pid: 1 });
        let command = Command::Send { ticket: Ticket(ticket), line, origin, deadline, writer };
        self.queue.submit(&command, self.now);
    }

    fn control(&mut self, ticket: u64, character: u8) {
        let deadline = self.now + Duration::from_secs(5);
        let command =
            Command::Control { ticket: Ticket(ticket), uid: 7, drops_lines: false, character, deadline };
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

    /// The board takes the line in its buffer.
    fn take(&mut self) -> String {
        assert!(self.loaded());
        let mut words = [0; 100];
        self.bus.read_block(PMAC.ascii.command, &mut words[..80]).unwrap();
        self.bus.write16(PMAC.ascii.command_loaded.word, 0).unwrap();
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        String::from_utf8(bytes.split(|byte| *byte == 0).next().unwrap().to_vec()).unwrap()
    }

    /// The board puts a response out, and the daemon takes it. An acknowledgement leaves the earlier text in place.
    fn respond(&mut self, control: u16) {
        self.bus.write16(PMAC.ascii.response_control, control).unwrap();
        self.poll();
        assert_eq!(self.bus.read16(PMAC.ascii.response_control).unwrap(), 0);
    }

    /// The board puts out a line of a reply.
    fn say(&mut self, text: &str) {
        let bytes: Vec<u8> = text.bytes().chain([0, 0]).collect();
        for (index, pair) in bytes.chunks_exact(2).enumerate() {
            let word = u16::from_le_bytes([pair[0], pair[1]]);
            self.bus.write16(PMAC.ascii.response.plus_words(index), word).unwrap();
        }
        self.bus.write16(PMAC.ascii.response_count, text.len() as u16 + 1).unwrap();
        self.respond(response::LINE);
    }

    /// The port has rested.
    fn rest(&mut self) {
        self.now += PORT_REST;
        self.poll();
        self.poll();
    }

    /// The board answers the line in its buffer.
    fn answer(&mut self, lines: &[&str]) {
        for line in lines {
            self.say(line);
        }
        self.respond(response::ACKNOWLEDGE);
        self.poll();
    }

    /// The board takes the daemon's own line, and answers it.
    fn answer_check(&mut self) {
        let line = self.take();
        let values = line.split(' ').map(|variable| if variable == "I3" { "2" } else { "3713707" });
        values.for_each(|value| self.say(value));
        self.respond(response::ACKNOWLEDGE);
    }

    fn loaded(&mut self) -> bool {
        self.bus.read16(PMAC.ascii.command_loaded.word).unwrap() & PMAC.ascii.command_loaded.mask != 0
    }
}

#[test]
fn who_waits_for_a_line_given_up_is_told_so_within_his_own_deadline() {
    let mut rig = Rig::new();
    rig.send(1, "SLOW", Duration::from_secs(1));
    rig.poll();
    rig.now += Duration::from_secs(1);
    rig.send(2, "P5=7", Duration::from_secs(3));
    rig.control(3, b'F' - 64);
    rig.poll();
    assert_eq!(rig.ended(), [(1, Outcome::TimedOut)]);
    rig.now += Duration::from_secs(3);
    rig.poll();
    let reason = "the board still works on \"SLOW\" of uid 1000, sent 4 s ago, or no longer listens; nothing was sent; \
                  ^X by an engineer cancels it";
    assert_eq!(rig.ended(), [(2, Outcome::Refused(Text::of(&reason)))]);
    rig.now += Duration::from_secs(2);
    rig.poll();
    let reason = reason.replace("4 s", "6 s");
    assert_eq!(rig.ended(), [(3, Outcome::Refused(Text::of(&reason)))]);
}

#[test]
fn the_first_line_after_one_given_up_is_our_own() {
    let mut rig = Rig::new();
    rig.send(1, "SLOW", Duration::from_secs(1));
    rig.poll();
    assert_eq!(rig.take(), "SLOW");
    rig.now += Duration::from_secs(1);
    rig.send(2, "P5=7", Duration::from_secs(60));
    rig.poll();
    rig.rest();
    // The board looks at its words while it works on a line: the first response is the reply to SLOW.
    assert_eq!(rig.take(), "I3 I10 I3");
    rig.now += Duration::from_millis(700);
    rig.say("1");
    rig.respond(response::ACKNOWLEDGE);
    rig.now += Duration::from_millis(700);
    rig.poll();
    assert!(!rig.loaded(), "our own reply is still to come");
    rig.answer(&["2", "3713707", "2"]);
    assert_eq!(rig.take(), "P5=7");
    rig.respond(response::ACKNOWLEDGE);
    assert_eq!(rig.ended(), [(1, Outcome::TimedOut), (2, Outcome::Done)]);
}

/// The board does not answer the line that it has taken in time; the daemon's next line.
fn next_check(rig: &mut Rig) -> String {
    rig.now += Duration::from_secs(1);
    rig.poll();
    rig.rest();
    if !rig.loaded() {
        rig.now += Duration::from_secs(1);
        rig.poll();
    }
    rig.take()
}

#[test]
fn a_late_reply_to_a_line_of_our_own_is_not_the_next_ones() {
    let mut rig = Rig::new();
    rig.send(1, "SLOW", Duration::from_secs(1));
    rig.poll();
    assert_eq!(rig.take(), "SLOW");
    rig.send(2, "P5=7", Duration::from_secs(60));
    assert_eq!(next_check(&mut rig), "I3 I10 I3");
    assert_eq!(next_check(&mut rig), "I3 I10 I10 I3");
    assert_eq!(next_check(&mut rig), "I3 I10 I10 I10 I3");
    // More unexpected answers than the daemon accepts.
    rig.answer(&["7"]);
    rig.answer(&["2", "3713707", "2"]);
    rig.answer(&["2", "3713707", "3713707", "2"]);
    assert!(!rig.loaded(), "the reply to the last one is still to come");
    rig.answer(&["2", "3713707", "3713707", "3713707", "2"]);
    assert_eq!(rig.take(), "P5=7");
    rig.respond(response::ACKNOWLEDGE);
    assert_eq!(rig.ended(), [(1, Outcome::TimedOut), (2, Outcome::Done)]);
}

#[test]
fn a_new_daemons_line_is_not_the_old_ones() {
    let mut rig = Rig::new();
    rig.send(1, "SLOW", Duration::from_secs(1));
    rig.poll();
    assert_eq!(rig.take(), "SLOW");
    assert_eq!(next_check(&mut rig), "I3 I10 I3");
    let ports = CommandPorts::new(&PMAC, TextOrder::LowFirst, None).after_another_host(rig.now);
    let identifier = Identifier::new(&PMAC, Identity::default(), false, rig.now);
    let scan = MemoryScan::new(&PMAC, false, Arc::default(), rig.now);
    rig.queue = AsciiQueue::new(ports, identifier, scan, Clock::real());
    rig.queue.see_buffer(Some((false, 1)));
    rig.queue.take_over(&mut rig.bus).unwrap();
    rig.poll();
    rig.rest();
    assert_eq!(rig.take(), "I3 I10 I10 I3");
}

#[test]
fn the_next_doubt_begins_with_another_line() {
    let mut rig = Rig::new();
    for expected in ["I3 I10 I3", "I3 I10 I10 I3", "I3 I10 I10 I10 I3", "I3 I10 I10 I10 I10 I3", "I3 I10 I3"]
    {
        rig.send(1, "SLOW", Duration::from_secs(1));
        rig.poll();
        rig.poll();
        assert_eq!(rig.take(), "SLOW");
        rig.now += Duration::from_secs(1);
        rig.poll();
        rig.rest();
        assert_eq!(rig.take(), expected);
        let values = vec!["2"; 1].into_iter().chain(vec!["3713707"; expected.len() / 4 - 1]).chain(["2"]);
        rig.answer(&values.collect::<Vec<_>>());
    }
}

#[test]
fn no_line_of_our_own_goes_into_an_open_program_buffer() {
    let mut rig = Rig::new();
    rig.send(1, "OPEN PROG 1", Duration::from_secs(1));
    rig.poll();
    assert_eq!(rig.take(), "OPEN PROG 1");
    rig.now += Duration::from_secs(1);
    rig.send(2, "CLOSE", Duration::from_secs(60));
    rig.poll();
    rig.rest();
    // The board answers it at once, and stores nothing.
    assert_eq!(rig.take(), "SIZE SIZE");
    rig.answer(&["-41301", "-41301"]);
    assert_eq!(rig.take(), "CLOSE");
    rig.respond(response::ACKNOWLEDGE);
    assert_eq!(rig.ended(), [(1, Outcome::TimedOut), (2, Outcome::Done)]);
}

#[test]
fn where_nobody_knows_of_a_buffer_the_board_is_asked_before_it_is_asked_for_i3() {
    let mut rig = Rig::without_reports();
    rig.send(1, "#1P", Duration::from_secs(1));
    rig.poll();
    assert_eq!(rig.take(), "#1P", "it stores nothing, so it does not wait");
    rig.now += Duration::from_secs(1);
    rig.send(2, "P5=7", Duration::from_secs(60));
    rig.poll();
    rig.rest();
    assert_eq!(rig.take(), "SIZE SIZE");
    rig.say("7");
    rig.respond(response::ACKNOWLEDGE);
    assert!(!rig.loaded());
    rig.answer(&["41301", "41301"]);
    assert_eq!(rig.take(), "I3 I10 I10 I3");
    rig.answer(&["2", "3713707", "3713707", "2"]);
    assert_eq!(rig.take(), "P5=7");
}

#[test]
fn a_cancel_ends_the_line_under_way_at_once() {
    let mut rig = Rig::new();
    rig.send(1, "SLOW", Duration::from_secs(60));
    rig.poll();
    assert_eq!(rig.take(), "SLOW");
    rig.poll();
    rig.control(2, CANCEL);
    rig.poll();
    rig.bus.write16(PMAC.ascii.control_character, 0).unwrap();
    rig.poll();
    let reason = Text::of(&"cancelled by ^X of uid 7");
    assert_eq!(rig.ended(), [(2, Outcome::Done), (1, Outcome::Interrupted(reason))]);
    rig.send(3, "P1=1", Duration::from_secs(1));
    rig.poll();
    rig.rest();
    assert_eq!(rig.take(), "I3 I10 I3");
}

#[test]
fn what_stops_all_motion_drops_the_lines_that_wait() {
    for (character, how) in [(b'A' - 64, "aborted"), (b'K' - 64, "killed")] {
        let mut rig = Rig::new();
        rig.send(1, "#1J+", Duration::from_secs(60));
        rig.poll();
        assert_eq!(rig.take(), "#1J+");
        rig.poll();
        rig.send(2, "#2J+", Duration::from_secs(60));
        rig.send(3, "#3J+", Duration::from_secs(60));
        let (uid, deadline) = (7, rig.now + Duration::from_secs(5));
        let command = Command::Control { ticket: Ticket(4), uid, drops_lines: true, character, deadline };
        rig.queue.submit(&command, rig.now);
        rig.send(5, "#1P", Duration::from_secs(60));
        rig.poll();
        let dropped = Outcome::Dropped(Text::of(&format!("not sent: {how} by uid 7")));
        assert_eq!(rig.ended(), [(2, dropped), (3, dropped)]);
        rig.bus.write16(PMAC.ascii.control_character, 0).unwrap();
        rig.respond(response::ACKNOWLEDGE);
        rig.poll();
        rig.poll();
        let again = rig.bus.read16(PMAC.ascii.control_character).unwrap();
        assert_eq!(again, u16::from(character), "the board may have carried out #1J+ behind it");
        rig.bus.write16(PMAC.ascii.control_character, 0).unwrap();
        for _ in 0..3 {
            rig.poll();
            rig.now += PORT_REST;
        }
        assert_eq!(rig.take(), "#1P", "what was sent after it is not dropped");
    }
}

#[test]
fn a_board_that_marks_no_end_is_named_and_does_not_hold_up_the_line_that_mends_it() {
    let mut rig = Rig::new();
    rig.send(1, "VERSION", Duration::from_secs(1));
    rig.poll();
    assert_eq!(rig.take(), "VERSION");
    rig.now += Duration::from_secs(1);
    rig.poll();
    rig.rest();
    assert_eq!(rig.take(), "I3 I10 I3");
    for text in ["0", "3713707", "0"] {
        rig.say(text);
    }
    rig.now += Duration::from_secs(1);
    rig.poll();
    rig.rest();
    assert!(rig.queue.state() == CommandState::Answers && rig.status().info.reply_end_missing);
    rig.send(2, "I3=2", Duration::from_secs(1));
    rig.poll();
    rig.poll();
    assert_eq!(rig.take(), "I3=2");
    rig.poll();
    rig.respond(response::ACKNOWLEDGE);
    assert_eq!(rig.ended(), [(1, Outcome::TimedOut), (2, Outcome::Done)]);
}

#[test]
fn a_line_that_waits_for_another_says_nothing_of_the_board() {
    let mut rig = Rig::new();
    rig.send(1, "LIST", Duration::from_secs(60));
    rig.send(2, "P2=1", Duration::from_secs(1));
    rig.poll();
    rig.bus.write16(PMAC.ascii.command_loaded.word, 0).unwrap();
    rig.queue.state = CommandState::Answers;
    rig.now += Duration::from_secs(1);
    rig.poll();
    let reason = "the board still works on \"LIST\" of uid 1000, sent 1 s ago, or no longer listens; nothing was sent; \
                  ^X by an engineer cancels it";
    assert_eq!(rig.ended(), [(2, Outcome::Refused(Text::of(&reason)))]);
    assert_eq!(rig.queue.state(), CommandState::Answers);
}

#[test]
fn a_new_board_does_nothing_of_what_the_old_one_was_told() {
    const ABORT: u8 = 0x01;
    const ONES: u16 = u16::MAX;
    // The words of the flag and of the control character when the daemon notices the reset, and the outcome that it may
    // tell.
    for (flag, character, outcome) in [
        (
            PMAC.ascii.command_loaded.mask,
            u16::from(ABORT),
            Outcome::Unavailable { port: CommandPort::Dpram, page: None },
        ),
        (0, 0, Outcome::TimedOut),
        (ONES, ONES, Outcome::TimedOut),
    ] {
        let mut rig = Rig::new();
        rig.send(1, "P1", Duration::from_secs(600));
        rig.poll();
        rig.control(2, ABORT);
        rig.poll();
        rig.bus.write16(PMAC.ascii.command_loaded.word, flag).unwrap();
        rig.bus.write16(PMAC.ascii.control_character, character).unwrap();
        rig.queue.reset(&mut rig.bus, rig.now).unwrap();
        assert!(!rig.loaded());
        assert_ne!(rig.bus.read16(PMAC.ascii.control_character).unwrap(), u16::from(ABORT));
        rig.bus.write16(PMAC.ascii.control_character, 0).unwrap();
        for _ in 0..3 {
            rig.poll();
            rig.now += PORT_REST;
        }
        let mut ended = rig.ended();
        ended.sort_by_key(|(ticket, _)| *ticket);
        // A board may clear a flag only when the line is done.
        let stopped = Outcome::Interrupted(Text::of(&"aborted by uid 7"));
        assert_eq!(ended, [(1, stopped), (2, outcome)], "{flag:#x}");
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
        rig.now += PORT_REST;
    }
    assert!(rig.take().starts_with("SIZE"), "our own line, and no second half");
    assert_eq!(rig.ended(), [(1, Outcome::TimedOut)]);
}

#[test]
fn our_own_line_that_lay_before_a_reset_holds_nothing_up() {
    let mut rig = Rig::new();
    rig.send(1, "SLOW", Duration::from_secs(1));
    rig.poll();
    assert_eq!(rig.take(), "SLOW");
    rig.now += Duration::from_secs(1);
    rig.poll();
    rig.rest();
    assert!(rig.loaded(), "our own line");
    rig.queue.reset(&mut rig.bus, rig.now).unwrap();
    rig.queue.see_buffer(Some((false, 2)));
    rig.poll();
    rig.rest();
    rig.now += Duration::from_secs(1);
    rig.poll();
    assert!(rig.loaded(), "it goes once more");
}

#[test]
fn what_stops_the_machine_does_not_wait_behind_a_report() {
    const POSITIONS: u8 = 0x10;
    const KILL_ALL: u8 = 0x0B;
    let mut rig = Rig::new();
    rig.send(1, "P1=1", Duration::from_secs(60));
    rig.poll();
    rig.take();
    rig.poll();
    rig.control(2, POSITIONS);
    rig.control(3, KILL_ALL);
    rig.poll();
    assert_eq!(rig.bus.read16(PMAC.ascii.control_character).unwrap(), u16::from(KILL_ALL));
    rig.bus.write16(PMAC.ascii.control_character, 0).unwrap();
    rig.poll();
    assert_eq!(rig.ended(), [(3, Outcome::Done)]);
    // The report comes when the line is done.
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
        rig.send(ticket, "P1=1", Duration::from_secs(60));
    }
    rig.poll();
    // A stop would take back a line that the board has not taken.
    rig.take();
    rig.poll();
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
        assert_eq!(rig.loaded(), is_line && expected != 1, "{expected}");
        rig.bus.write16(word, 0).unwrap();
        rig.poll();
        if is_line {
            rig.bus.write16(PMAC.ascii.command_loaded.word, 0).unwrap();
            rig.respond(response::ACKNOWLEDGE);
        } else {
            rig.answer_check();
        }
        rig.now += Duration::from_millis(1);
        let ended: Vec<_> = rig.ended().into_iter().filter(|(ticket, _)| *ticket != 20).collect();
        assert_eq!(ended, [(expected, Outcome::Done)]);
    }
}

#[test]
fn a_character_that_stops_nothing_waits_for_the_line_that_lies_there() {
    let mut rig = Rig::new();
    rig.send(1, "P5=7", Duration::from_secs(60));
    rig.poll();
    let character = |rig: &mut Rig| rig.bus.read16(PMAC.ascii.control_character).unwrap();
    rig.control(2, b'T' - 64);
    rig.poll();
    assert_eq!(character(&mut rig), 0, "the line goes first");
    assert_eq!(rig.take(), "P5=7");
    rig.poll();
    rig.poll();
    assert_eq!(character(&mut rig), u16::from(b'T' - 64));
}
