//! `commands`: what the daemon adds to a command's round trip, what commands do to the servo mirror, and how fast rotary programs go in.

use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use pmac_dpram::map::PMAC;
use pmac_dpram::segment::Counter;

use crate::bare_board::{BareBoard, Pauses};
use crate::clock::{Figures, Series};
use crate::process::{Child, Shared};
use crate::rig::{Rig, Setup, program};
use crate::table::{Bar, Table};
use crate::{daemon, machine};

const LINE: &str = "I122";
const ANSWER: &str = "32";
/// Bytes of that question and of its answer on the socket.
const CALL_BYTES: usize = 98;
const REPLY_BYTES: usize = 32;

/// All three, `rounds` times in turn.
pub fn run(rounds: usize) {
    machine::introduce("commands");
    let mut table = Table::default();
    for round in 0..rounds {
        let start = Instant::now();
        for (row, only_ascii, awake) in
            [("4a", false, false), ("4aw", false, true), ("4ao", true, false), ("4aow", true, true)]
        {
            // At 9 kHz the board answers in less time than at the usual rate, so that what the daemon adds is seen the better.
            let setup = Setup { servo_hz: 9000.0, awake, only_ascii, ..Setup::default() };
            round_trips(&mut table, row, &setup);
        }
        echo(&mut table);
        servo_beside_commands(&mut table);
        rotary(&mut table);
        println!("round {round}: {:.1} s", start.elapsed().as_secs_f64());
    }
    println!("\n{}", table.text());
    println!(
        "4a: beside the servo mirror; 4ao: without it (functions = [\"ascii\"]); w: with processors kept awake (cpu_latency_us = 0)"
    );
}

/// The same question to the same board: directly on the DPRAM by the library, and through socket and daemon.
fn round_trips(table: &mut Table, row: &'static str, setup: &Setup) {
    const QUESTIONS: usize = 1500;
    let mut rig = Rig::simulator_alone(setup);
    let request = setup.awake.then(machine::keep_awake);
    if matches!(request, Some(None)) {
        return println!("{row}: not measured, only root may keep processors awake");
    }
    let direct = direct(&rig, QUESTIONS);
    // From here on the daemon's own holds.
    drop(request);
    rig.start_daemon(setup);
    // Not while the daemon still asks the board who it is, which takes the port for some ms at a time.
    std::thread::sleep(Duration::from_millis(2500));
    let mut connection = rig.connection();
    let mut pauses = Pauses::default();
    let through: Series = (0..QUESTIONS)
        .map(|_| {
            pauses.pause();
            let start = Instant::now();
            let lines = connection.send(LINE, Duration::from_secs(2)).expect("an answer");
            let ns = start.elapsed().as_nanos() as f64;
            assert_eq!(lines, [ANSWER]);
            crate::clock::ticks(ns)
        })
        .collect();
    let through = through.figures();
    let us = |through: f64, direct: f64| [through / 1e3, direct / 1e3];
    let share = (through.median - direct.median) / 1e3;
    let rows = [
        (
            "ASCII round trip, socket and daemon / directly, median",
            Bar::None,
            us(through.median, direct.median),
        ),
        ("- p99", Bar::None, us(through.p99, direct.p99)),
        ("- the daemon's share of the median / 50 us", Bar::AtMost(1.0), [share, 50.0]),
    ];
    for (what, bar, figures) in rows {
        table.add(row, what, "us", bar, figures);
    }
}

/// The handshake alone.
fn direct(rig: &Rig, questions: usize) -> Figures {
    let mut board = BareBoard::open(rig, &PMAC);
    let mut pauses = Pauses::default();
    let asked = (0..questions).map(|_| {
        pauses.pause();
        let start = Instant::now();
        assert_eq!(board.ask(LINE), [ANSWER]);
        crate::clock::ticks(start.elapsed().as_nanos() as f64)
    });
    let series: Series = asked.collect();
    series.figures()
}

/// The floor: such a line to another process by a socket, and such a reply back, with nothing between.
fn echo(table: &mut Table) {
    const QUESTIONS: usize = 1500;
    let (mut own, mut other) = UnixStream::pair().expect("sockets");
    let child = Child::run(|| {
        let mut line = [0; 128];
        while other.read_exact(&mut line[..CALL_BYTES]).is_ok() && line[0] != 0 {
            other.write_all(&line[..REPLY_BYTES]).expect("sent");
        }
    });
    let (mut pauses, mut reply) = (Pauses::default(), [0; REPLY_BYTES]);
    let times: Series = (0..QUESTIONS)
        .map(|_| {
            pauses.pause();
            let start = Instant::now();
            own.write_all(&[1; CALL_BYTES]).expect("sent");
            own.read_exact(&mut reply).expect("an answer");
            crate::clock::ticks(start.elapsed().as_nanos() as f64)
        })
        .collect();
    own.write_all(&[0; CALL_BYTES]).expect("sent");
    child.join();
    let figures = times.figures();
    let row = "a line to a process that does nothing but answer, median / p99";
    table.add("4e", row, "us", Bar::None, [figures.median / 1e3, figures.p99 / 1e3]);
}

/// How late the daemon reads servo updates while four clients send as fast as they can, and while none does.
fn servo_beside_commands(table: &mut Table) {
    const BLOCK: Duration = Duration::from_millis(1500);
    let rig = Rig::start(&Setup::default());
    let subscriber = rig.subscriber();
    std::thread::sleep(Duration::from_millis(700));
    let shared = Shared::cells(3);
    let clients: Vec<Child> = (0..4)
        .map(|_| {
            Child::run(|| {
                let mut connection = rig.connection();
                while shared.value(0) < 2 {
                    if shared.value(0) == 0 {
                        std::thread::sleep(Duration::from_millis(2));
                        continue;
                    }
                    connection.send(LINE, Duration::from_secs(5)).expect("an answer");
                    shared.cell(1).fetch_add(1, std::sync::atomic::Ordering::Relaxed);
                }
            })
        })
        .collect();
    // Half of the blocks with and half without, in an order that favours neither where the machine's mood drifts.
    let (mut beside, mut alone) = (Block::default(), Block::default());
    for active in [0, 1, 1, 0, 0, 1, 1, 0] {
        shared.set(0, active);
        // What was under way is over, and what begins has begun.
        std::thread::sleep(Duration::from_millis(100));
        let counts = || [Counter::Missed, Counter::Skipped].map(|counter| subscriber.counter(counter));
        let (commands, [missed, skipped], start) = (shared.value(1), counts(), Instant::now());
        let watched = daemon::watch(&subscriber, BLOCK);
        let block = if active == 0 { &mut alone } else { &mut beside };
        let [missed_now, skipped_now] = counts();
        block.watched.append(watched);
        block.commands += shared.value(1) - commands;
        block.missed += missed_now - missed;
        block.skipped += skipped_now - skipped;
        block.seconds += start.elapsed().as_secs_f64();
    }
    shared.set(0, 2);
    clients.into_iter().for_each(Child::join);
    assert!(beside.commands > 0 && alone.commands == 0, "{} {}", beside.commands, alone.commands);
    let ([beside_delay, _], [alone_delay, _]) = (beside.watched.figures(), alone.watched.figures());
    let us = |beside: f64, alone: f64| [beside / 1e3, alone / 1e3];
    table.add(
        "4b",
        "servo delay p99.9, 4 clients sending / none",
        "us",
        Bar::AtMost(1.2),
        us(beside_delay.p999, alone_delay.p999),
    );
    table.add("4b", "- p99", "us", Bar::None, us(beside_delay.p99, alone_delay.p99));
    table.add("4b", "- median", "us", Bar::None, us(beside_delay.median, alone_delay.median));
    let rate = beside.commands as f64 / beside.seconds;
    table.add("4b", "- command lines a second meanwhile", "1/s", Bar::None, [rate, 1.0]);
    for (what, block) in [("4 clients", beside), ("none", alone)] {
        println!(
            "4b, {what}: {} updates followed, missed {}, skipped {}, lost {}",
            block.watched.samples, block.missed, block.skipped, block.watched.lost
        );
    }
}

/// What was seen in the blocks of one kind.
#[derive(Default)]
struct Block {
    watched: daemon::Watched,
    commands: u64,
    missed: u64,
    skipped: u64,
    seconds: f64,
}

/// A program of two commands a line through `pmacctl rotary stream`, into a board whose own buffer has room for all of it.
fn rotary(table: &mut Table) {
    let rig = Rig::start(&Setup::default());
    std::thread::sleep(Duration::from_millis(300));
    rig.connection().send("&1 #1->X #2->Y", Duration::from_secs(5)).expect("axes");
    let file = rig.memory().with_file_name("program.pmc");
    let text: String = (0..9000).map(|line| format!("X{} Y{}\n", line % 1000, line * 7 % 500)).collect();
    std::fs::write(&file, text).expect("written");
    let output = std::process::Command::new(program("pmacctl"))
        .args(["--name", &rig.name, "--socket"])
        .arg(rig.socket())
        .args(["rotary", "stream"])
        .arg(file)
        .args(["--define", "37000"])
        .output()
        .expect("pmacctl");
    let text = String::from_utf8_lossy(&output.stdout);
    let value = |key: &str| {
        let part = text.split_whitespace().find_map(|part| part.strip_prefix(key));
        part.and_then(|value| value.parse::<f64>().ok()).unwrap_or_else(|| panic!("{output:?}"))
    };
    let rate = value("commands=") / value("seconds=");
    table.add(
        "4c",
        "rotary streaming, commands a second / 20000",
        "1/s",
        Bar::AtLeast(1.0),
        [rate, 20_000.0],
    );
}
