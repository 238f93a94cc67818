//! `growth`: what more readers, command clients, variables and motors cost, and how long daemon and client take to start.
//!
//! One thing grows at a time. Every line has a simulator and a daemon of its own and, beside what grows, one client that sleeps and
//! follows every servo update: its delays are the table's. Results are written beside those of the other benchmarks, as text and
//! as a picture.

mod clients;
mod load;
mod picture;
mod plot;
mod readers;
mod running;
mod start;
mod variables;

use std::path::Path;
use std::time::{Duration, Instant};

use nix::sys::resource::{Resource, getrlimit};
use pmac_dpram::segment::{Counter, Subscriber};

use crate::clock::Figures;
use crate::daemon::watch;
use crate::machine;
use crate::rig::{Rig, Setup};
use load::Load;

/// How long a load runs before it is measured.
const SETTLE: Duration = Duration::from_millis(1000);
const READERS: [usize; 4] = [1, 10, 100, 1000];
/// On two processors more than these are a stampede and nothing else.
const WOKEN_READERS: [usize; 3] = [1, 10, 100];
const CLIENTS: [usize; 6] = [1, 2, 4, 10, 30, 100];
const VARIABLES: [usize; 8] = [1, 2, 4, 8, 16, 32, 64, 128];
const MOTORS: [u8; 4] = [1, 2, 4, 8];

/// What was measured of one number of one thing.
pub struct Line {
    /// How many there were.
    pub count: usize,
    /// The daemon's share of one processor, in per cent.
    pub cpu: f64,
    /// Servo updates made, as far as the daemon knows, and missed by it.
    updates: u64,
    missed: u64,
    /// Samples that any reader lost.
    lost: u64,
    /// Servo update to the daemon's first read of it, and to the woken client with its copy.
    pub mirrored: Figures,
    pub woken: Figures,
    /// The daemon's memory: resident, of that private, of that locked.
    pub memory_mib: [f64; 3],
    /// What the load did a second: reads, command lines, tables; for motors, bus accesses an update.
    pub rate: f64,
    /// How long a reply took, or one table after the other came.
    pub took: Figures,
}

/// Everything measured.
pub struct Results {
    pub readers: Vec<Line>,
    pub woken_readers: Vec<Line>,
    pub clients: Vec<Line>,
    pub variables: Vec<Line>,
    pub motors: Vec<Line>,
}

/// Measures everything, `seconds` a line, and writes the results.
pub fn run(seconds: u64) {
    let mut report = Report::default();
    report.say(machine::introduction("growth").trim_end());
    report.say(&format!(
        "{seconds} s a line, servo {:.0} Hz, one client that sleeps and follows every update; its delays are given",
        Setup::default().servo_hz
    ));
    report.say("cpu: the daemon, of one processor; delays in us from the board's update to the daemon's first read of it (mirrored) and to");
    report.say(
        "the woken client with its copy (woken); memory of the daemon in MiB: resident, private, locked",
    );
    let time = Duration::from_secs(seconds);
    let default = Setup::default;
    let group = |report: &mut Report, title: &str, rate: &str, took: &str, lines: Vec<(Setup, Load)>| {
        report.head(title, rate, took);
        let mut measured = Vec::new();
        for (setup, load) in lines {
            let line = measure(&setup, &load, time);
            report.line(&line);
            measured.push(line);
        }
        measured
    };
    let loads = |counts: &[usize], load: fn(usize) -> Load| -> Vec<(Setup, Load)> {
        counts.iter().map(|count| (default(), load(*count))).collect()
    };
    let readers = group(
        &mut report,
        "readers that take the latest sample 10 times a second (up to 8 processes, each reader attached by itself)",
        "reads/s",
        "",
        [loads(&[0], Load::Readers), loads(&READERS, Load::Readers)].concat(),
    );
    let woken_readers = group(
        &mut report,
        "readers that sleep and are woken by every update (up to 10 processes, a thread and an attachment each)",
        "samples/s",
        "",
        loads(&WOKEN_READERS, Load::WokenReaders),
    );
    let clients = group(
        &mut report,
        "command clients, each a process that sends I122 as fast as it is answered",
        "lines/s",
        "reply 50/99",
        loads(&CLIENTS, Load::Clients),
    );
    let variables = group(
        &mut report,
        "variables that the board copies in its background, watched by one client",
        "tables/s",
        "between 50/99",
        loads(&VARIABLES, Load::Variables),
    );
    let motors = MOTORS.map(|motors| (Setup { motors, ..default() }, Load::Motors(motors.into())));
    let motors = group(&mut report, "motors reported", "accesses/upd", "", motors.into());
    let is_locked = |lines: &[Line]| lines.iter().any(|line| line.memory_mib[2] > 0.0);
    if !is_locked(&readers) {
        let limit = getrlimit(Resource::RLIMIT_MEMLOCK).map_or(0, |(_, hard)| hard / 1024);
        report.say("");
        report.say(&format!(
            "memory is not locked: the limit of locked memory is {limit} KiB here, and this user may not raise it; the unit does"
        ));
    }
    start::measure(&mut report);
    let results = Results { readers, woken_readers, clients, variables, motors };
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("results");
    std::fs::write(directory.join("growth.txt"), &report.0).expect("results/growth.txt");
    std::fs::write(directory.join("growth.svg"), picture::of(&results)).expect("results/growth.svg");
}

fn measure(setup: &Setup, load: &Load, time: Duration) -> Line {
    let rig = Rig::start(setup);
    let subscriber = rig.subscriber();
    let running = load.start(&rig);
    std::thread::sleep(SETTLE);
    running.begin();
    let counts = || Counts::of(&subscriber);
    let (start, before, cpu) = (Instant::now(), counts(), rig.daemon().processor_seconds());
    let watched = watch(&subscriber, time);
    let (after, cpu_after) = (counts(), rig.daemon().processor_seconds());
    let wall = start.elapsed().as_secs_f64();
    let [resident, private] = rig.daemon().memory_mib();
    let memory_mib = [resident, private, rig.daemon().locked_mib()];
    let outcome = running.end();
    let [mirrored, woken] = watched.figures();
    let updates = after.updates - before.updates;
    let accesses = after.accesses - before.accesses;
    Line {
        count: load.count(),
        cpu: (cpu_after - cpu) / wall * 100.0,
        updates,
        missed: after.missed - before.missed,
        lost: watched.lost + outcome.lost,
        mirrored,
        woken,
        memory_mib,
        rate: if matches!(load, Load::Motors(_)) {
            accesses as f64 / updates as f64
        } else {
            outcome.done as f64 / wall
        },
        took: outcome.took,
    }
}

/// Counters of the daemon.
struct Counts {
    updates: u64,
    missed: u64,
    accesses: u64,
}

impl Counts {
    fn of(subscriber: &Subscriber) -> Self {
        let [updates, missed, accesses] = [Counter::Updates, Counter::Missed, Counter::ServoAccesses]
            .map(|counter| subscriber.counter(counter));
        Self { updates, missed, accesses }
    }
}

/// What is printed, kept for the file.
#[derive(Default)]
pub struct Report(String);

impl Report {
    pub fn say(&mut self, line: &str) {
        println!("{line}");
        self.0 += line;
        self.0 += "\n";
    }

    fn head(&mut self, title: &str, rate: &str, took: &str) {
        self.say("");
        self.say(title);
        self.say(&format!(
            "{:>6} {:>7} {:>8} {:>7} {:>5} {:>15} {:>15} {:>17} {:>12} {:>15}",
            "number",
            "cpu %",
            "updates",
            "missed",
            "lost",
            "mirrored 50/99",
            "woken 50/99",
            "memory",
            rate,
            took
        ));
    }

    fn line(&mut self, line: &Line) {
        let us = |figures: &Figures| format!("{:.0}/{:.0}", figures.median / 1e3, figures.p99 / 1e3);
        let [resident, private, locked] = line.memory_mib;
        self.say(&format!(
            "{:>6} {:>7.2} {:>8} {:>7} {:>5} {:>15} {:>15} {:>17} {:>12.1} {:>15}",
            line.count,
            line.cpu,
            line.updates,
            line.missed,
            line.lost,
            us(&line.mirrored),
            us(&line.woken),
            format!("{resident:.1}/{private:.1}/{locked:.1}"),
            line.rate,
            if line.took.count == 0 { String::new() } else { us(&line.took) }
        ));
    }
}
