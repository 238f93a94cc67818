//! The loop in steps of the test's own time, on a board that the test plays.

use std::sync::Arc;
use std::time::Duration;

use super::*;
use crate::clock::ManualTime;
use crate::daemon::options::Options;
use crate::daemon::shared::open_buffer::{Account, Writer};
use crate::daemon::shared::queue::{Command, Event, Line, Origin, Outcome, Ticket};
use crate::device::{Bus, FileBoard, Inherited};
use crate::map::HostOffset;
use crate::map::PMAC;
use crate::map::pmac::{ASCII_CONTROL_CHARACTER, ASCII_OUTPUT_CONTROL, SERVO_HOST_STATUS, SERVO_PMAC_STATUS};
use crate::protocol::{CommandPort, State};

const SECOND: u64 = 1_000_000_000;
const BEGIN_NS: u64 = 1_000 * SECOND;

struct World {
    time: ManualTime,
    board_loop: BoardLoop,
    backend: Backend,
    /// The board's side of the memory.
    memory: FileBoard,
    due_ns: u64,
    _directory: tempfile::TempDir,
}

impl World {
    fn new() -> Self {
        let directory = tempfile::tempdir_in("/dev/shm").unwrap();
        let path = directory.path().join("dpram");
        let file = std::fs::File::options().read(true).write(true).create_new(true).open(&path).unwrap();
        file.set_len(0x4000).unwrap();
        let board = Some(format!("file:{}", path.display()));
        let settings = Settings::decide(&Options { board, ..Options::default() }).unwrap();
        let time = ManualTime::at(BEGIN_NS);
        let mut options = segment_options(&settings, &time.clock()).unwrap();
        directory.path().clone_into(&mut options.directory);
        let machine = Machine::open(&settings, &Inherited::default(), &Clock::real()).unwrap();
        let publisher = Publisher::create(&options).unwrap();
        let Parts { board_loop, backend, .. } =
            Parts::new(&settings, machine, publisher, time.clock(), Arc::default()).unwrap();
        let memory = FileBoard::from_file(&file, 0x4000).unwrap();
        Self { time, board_loop, backend, memory, due_ns: 0, _directory: directory }
    }

    /// Steps the loop from due time to due time for so long, and calls `board` before each step.
    fn run(&mut self, time: Duration, mut board: impl FnMut(&mut FileBoard, u64)) {
        let end = self.time.ns() + time.as_nanos() as u64;
        loop {
            board(&mut self.memory, self.time.ns());
            self.due_ns = self.board_loop.poll();
            if self.due_ns >= end {
                break;
            }
            self.time.move_to(self.due_ns);
        }
        self.time.move_to(end);
    }

    fn word(&mut self, offset: HostOffset) -> u16 {
        self.memory.read16(offset).unwrap()
    }

    fn send(&mut self, ticket: u64, line: &str, patience: Duration) {
        let deadline = self.time.clock().now() + patience;
        let line = Line::of(line);
        let writer = Writer::Hand(Account { uid: 0, pid: 1 });
        let origin = Origin::default();
        let command = Command::Send { ticket: Ticket(ticket), line, origin, deadline, writer };
        self.backend.commands.try_send(command).unwrap();
    }

    /// The first end of a command that no earlier call has returned.
    fn ended(&mut self) -> Option<(u64, Outcome)> {
        let Backend { events, info, .. } = &mut self.backend;
        std::iter::from_fn(|| events.try_receive()).find_map(|event| match event {
            Event::Done(ticket, outcome) => Some((ticket.0, outcome)),
            Event::Info(status) => {
                info.take(status);
                None
            }
            _ => None,
        })
    }

    /// The state that `GetInfo` would tell.
    fn state(&mut self) -> State {
        assert_eq!(self.ended(), None);
        self.backend.info.board().state
    }
}

/// A servo report every millisecond.
fn reports(memory: &mut FileBoard, ns: u64) {
    memory.write16(SERVO_PMAC_STATUS, (ns / 1_000_000) as u16 & 0x7FFF).unwrap();
}

#[test]
fn servo_data_are_live_within_two_reports_and_stale_after_ten_that_did_not_come() {
    let mut world = World::new();
    world.run(Duration::from_millis(20), reports);
    assert_eq!(world.state(), State::Live);
    world.run(Duration::from_millis(90), |_, _| {});
    assert_eq!(world.state(), State::Live, "its last report is not 100 ms old");
    world.run(Duration::from_millis(70), |_, _| {});
    assert_eq!(world.state(), State::Stale);
    world.run(Duration::from_millis(10), reports);
    assert_eq!(world.state(), State::Live);
}

#[test]
fn what_is_begun_and_when_it_is_given_up_goes_by_the_injected_time() {
    let mut world = World::new();
    world.run(Duration::from_millis(10), |_, _| {});
    assert_eq!(world.word(ASCII_OUTPUT_CONTROL), 0, "nothing is sent while another host's reply may come");
    // The daemon first gives up the identifier's question.
    world.run(Duration::from_secs(8), |_, _| {});
    world.send(1, "#1J+", Duration::from_secs(5));
    // A board that came back in the last half second could not answer in time.
    world.run(Duration::from_millis(4_199), |_, _| {});
    assert_eq!(world.ended(), None);
    assert_ne!(world.word(ASCII_OUTPUT_CONTROL), 0, "it waits for the board");
    world.run(Duration::from_secs(2), |_, _| {});
    assert_eq!(world.ended(), Some((1, Outcome::Unavailable { port: CommandPort::Dpram, page: None })));
    let lies = world.word(PMAC.ascii.command).to_le_bytes();
    assert_eq!(lies, *b"SI", "it never lay there: the daemon's own question does");
}

#[test]
fn a_stop_stands_back_for_a_few_updates_where_the_next_one_is_always_near() {
    let period = 100_000;
    let report = |memory: &mut FileBoard, ns: u64| {
        memory.write16(SERVO_PMAC_STATUS, (ns / period) as u16 & 0x7FFF).unwrap();
    };
    // Each time at another moment of the other work.
    for moment in 0..20 {
        let mut world = World::new();
        // The daemon gives up the identifier's question.
        world.run(Duration::from_secs(8), |_, _| {});
        world.board_loop.learn(period, 1_000);
        world.run(Duration::from_millis(300) + moment * Duration::from_micros(2_300), report);
        assert_eq!(world.state(), State::Live);
        // On ISA a piece takes 140 us: it would always delay the next update.
        world.board_loop.learn(period, 1_000);
        let deadline = world.time.clock().now() + Duration::from_secs(1);
        let (ticket, character) = (Ticket(1), 1);
        let abort = Command::Control { ticket, uid: 0, drops_lines: false, character, deadline };
        world.backend.commands.try_send(abort).unwrap();
        let sent = world.time.ns();
        while world.word(ASCII_CONTROL_CHARACTER) != 1 {
            world.run(Duration::from_nanos(period / 4), report);
            let updates = (world.time.ns() - sent) / period;
            assert!(updates <= 9, "{updates} updates went before the stop at moment {moment}");
        }
    }
}

#[test]
fn an_end_leaves_the_board_and_is_an_end() {
    let mut world = World::new();
    world.run(Duration::from_millis(10), reports);
    world.memory.write16(SERVO_HOST_STATUS, 1).unwrap();
    world.board_loop.stop();
    assert_eq!(world.board_loop.poll(), u64::MAX);
    assert_eq!(world.state(), State::Dead);
    assert_eq!(world.word(SERVO_HOST_STATUS), 0);
    assert_eq!(world.board_loop.poll(), u64::MAX);
}

#[test]
fn an_idle_loop_is_due_at_its_heartbeat_at_the_latest() {
    let mut world = World::new();
    for _ in 0..1_000 {
        let before = world.time.ns();
        let due = world.board_loop.poll();
        assert!(due > before && due <= before + SECOND / 20, "{due} at {before}");
        world.time.move_to(due);
    }
}
