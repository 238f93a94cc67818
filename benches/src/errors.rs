//! `errors`: what an error costs beside a value, and a whole backup, comparison and restore beside the board's own pace.
//!
//! A backup asks for programs that are not there, a thousand errors. The board's own pace is that of the same lines, asked one after
//! the other by the library's handshake, without a daemon.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use pmac_dpram::map::{Family, PMAC, TURBO2};
use serde_json::Value;

use crate::bare_board::{BareBoard, Pauses};
use crate::clock::Series;
use crate::machine;
use crate::rig::{Rig, Setup, program};
use crate::table::{Bar, Table};

/// A program that the board does not have.
const REFUSED: &str = "LIST PROG 999";
const VALUE: &str = "I122";
const MOST: Bar = Bar::AtMost(1.3);

/// All of it, `rounds` times in turn.
pub fn run(rounds: usize) {
    machine::introduce("errors");
    let mut table = Table::default();
    for round in 0..rounds {
        let start = Instant::now();
        family(&mut table, &PMAC, ["15", "15b", "15d", "15r"]);
        family(&mut table, &TURBO2, ["16", "16b", "16d", "16r"]);
        println!("round {round}: {:.1} s", start.elapsed().as_secs_f64());
    }
    println!("\n{}", table.text());
    println!("15: PMAC; 16: Turbo PMAC2 with 8192 variables of each kind");
}

fn family(table: &mut Table, family: &'static Family, [errors, backup, diff, restore]: [&'static str; 4]) {
    let setup = Setup { family: family.name, ..Setup::default() };
    let mut rig = Rig::start(&setup);
    thread::sleep(Duration::from_secs(1));
    let [error, value] = [REFUSED, VALUE].map(|line| round_trip(&rig, line));
    let what = "error round trip, socket and daemon / a value's, median";
    table.add(errors, what, "us", Bar::AtMost(1.5), [error / 1e3, value / 1e3]);
    let file = rig.memory().with_file_name("saved");
    let file = file.to_str().expect("a path");
    let recorder = Recorder::start(&rig);
    let tasks = [
        (backup, "whole backup / the same lines without a daemon", vec!["backup", "-o", file]),
        (diff, "diff with a whole backup / the same", vec!["diff", file]),
        (restore, "restore of a whole backup / the same", vec!["restore", file, "--yes"]),
    ]
    .map(|(row, what, arguments)| {
        let begun = Instant::now();
        let mut command = Command::new(program("pmacctl"));
        command.arg("--socket").arg(&recorder.socket).args(&arguments);
        let status = command.stdout(Stdio::null()).status().expect("pmacctl");
        assert!(status.success(), "{arguments:?}");
        (row, what, begun.elapsed(), recorder.take())
    });
    rig.stop_daemon();
    let mut board = BareBoard::open(&rig, family);
    for (row, what, taken, lines) in tasks {
        let begun = Instant::now();
        for line in &lines {
            let _ = board.exchange(line);
        }
        println!("{row}: {} lines", lines.len());
        table.add(row, what, "s", MOST, [taken.as_secs_f64(), begun.elapsed().as_secs_f64()]);
    }
}

/// The median time of a line by socket and daemon, in ns.
fn round_trip(rig: &Rig, line: &str) -> f64 {
    let (mut connection, mut pauses) = (rig.connection(), Pauses::default());
    let times: Series = (0..500)
        .map(|_| {
            pauses.pause();
            let start = Instant::now();
            let _ = connection.send(line, Duration::from_secs(2));
            crate::clock::ticks(start.elapsed().as_nanos() as f64)
        })
        .collect();
    times.figures().median
}

/// A socket before the daemon's, which writes down the command lines that go through.
struct Recorder {
    socket: PathBuf,
    lines: Arc<Mutex<Vec<String>>>,
}

impl Recorder {
    fn start(rig: &Rig) -> Self {
        let socket = rig.memory().with_file_name("recorder");
        let listener = UnixListener::bind(&socket).expect("a socket");
        let (lines, daemon) = (Arc::<Mutex<Vec<String>>>::default(), rig.socket());
        let recorded = Arc::clone(&lines);
        thread::spawn(move || {
            for client in listener.incoming() {
                pass_on(client.expect("a client"), &daemon, &recorded);
            }
        });
        Self { socket, lines }
    }

    /// The lines since the last call.
    fn take(&self) -> Vec<String> {
        std::mem::take(&mut self.lines.lock().expect("the lines"))
    }
}

fn pass_on(client: UnixStream, daemon: &Path, recorded: &Arc<Mutex<Vec<String>>>) {
    let daemon = UnixStream::connect(daemon).expect("the daemon");
    let (mut replies, mut to_client) =
        (daemon.try_clone().expect("a copy"), client.try_clone().expect("a copy"));
    thread::spawn(move || std::io::copy(&mut replies, &mut to_client));
    let recorded = Arc::clone(recorded);
    thread::spawn(move || {
        let (mut calls, mut daemon, mut call) = (BufReader::new(client), daemon, Vec::new());
        while calls.read_until(0, &mut call).is_ok_and(|count| count > 0) {
            if daemon.write_all(&call).is_err() {
                return;
            }
            let message: Value =
                serde_json::from_slice(call.strip_suffix(&[0]).unwrap_or(&call)).unwrap_or_default();
            let parameters = &message["parameters"];
            let lines = parameters["lines"].as_array().into_iter().flatten().chain([&parameters["line"]]);
            let lines = lines.filter_map(|line| line.as_str().map(str::to_owned));
            recorded.lock().expect("the lines").extend(lines);
            call.clear();
        }
        let _ = daemon.shutdown(std::net::Shutdown::Both);
    });
}
