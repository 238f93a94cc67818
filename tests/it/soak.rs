//! Everything at once, for long: every function in use, twenty readers, eight command clients.
//!
//! An hour: `PMAC_SOAK_SECONDS=3600 cargo test --release --test it soak:: -- --nocapture`. Among the other tests it is short.
//!
//! What is asserted: no ring lost a sample to any reader, no reply went to somebody else, the simulator saw no broken
//! handshake, memory and descriptors of both processes did not grow, and the daemon's log has nothing but what was asked of it.
//! What the machine's other work made the simulator or the mirror miss is counted and printed.

use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use pmac_dpram::client::Board;
use pmac_dpram::segment::{Counter, RegionId, Sample, Subscriber, WaitOutcome};
use pmac_dpram::setup::gather_source::GatherSource;

use crate::site::{PATIENCE, Site, counter, wait_until};

/// Readers that sleep as long as they like and then take everything that has come meanwhile.
const SLEEPING_READERS: usize = 16;
/// Readers that are woken at each update.
const WAITING_READERS: usize = 4;
const COMMAND_CLIENTS: usize = 8;
/// Lines of the rotary program that the board executes in a second.
const LINES_A_SECOND: u64 = 10;
/// The motors the command clients ask about stand still, each in a place of its own; 1 and 2 belong to the program.
const STANDING_MOTORS: [u32; 6] = [3, 4, 5, 6, 7, 8];
/// What a process may grow by after it has settled.
const GROWTH_KIB: u64 = 1024;

fn seconds() -> u64 {
    std::env::var("PMAC_SOAK_SECONDS").ok().and_then(|text| text.parse().ok()).unwrap_or(6)
}

fn place(motor: u32) -> f64 {
    f64::from(motor) * 1000.0
}

/// Resident memory of a process, in KiB, and how many descriptors it has open.
pub fn weight(pid: u32) -> (u64, usize) {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
    let resident = line.trim().trim_end_matches(" kB").trim().parse().unwrap();
    (resident, std::fs::read_dir(format!("/proc/{pid}/fd")).unwrap().count())
}

fn pmacctl(site: &Site, arguments: &[&str]) -> Child {
    Command::new(env!("CARGO_BIN_EXE_pmacctl"))
        .args(["--name", &site.name])
        .arg("--socket")
        .arg(site.socket())
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// The number after `name=` in what a program printed last.
fn number(output: &Output, name: &str) -> u64 {
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{text}{}", String::from_utf8_lossy(&output.stderr));
    let (_, rest) = text.split_once(&format!("{name}=")).unwrap();
    rest.split_whitespace().next().unwrap().parse().unwrap()
}

/// What the threads of one run share.
struct Run<'a> {
    site: &'a Site,
    done: AtomicBool,
    servo_samples: AtomicU64,
    variable_samples: AtomicU64,
    commands: AtomicU64,
}

impl Run<'_> {
    fn goes_on(&self) -> bool {
        !self.done.load(Ordering::Relaxed)
    }

    /// Takes every servo sample; their servo timers must tell the same gaps as the daemon counts.
    fn read_servo(&self, sleep: Option<Duration>) {
        let subscriber = self.site.attach();
        let first = subscriber.published(RegionId::Servo).unwrap() + 1;
        let mut cursor = subscriber.cursor(RegionId::Servo, first).unwrap();
        let mut sample = Sample::new();
        let mut timer = 0;
        let mut samples = 0;
        while self.goes_on() {
            match sleep {
                Some(time) => std::thread::sleep(time),
                None => {
                    let seen = cursor.position() - 1;
                    let outcome = subscriber.wait_newer(RegionId::Servo, seen, PATIENCE).unwrap();
                    assert_eq!(outcome, WaitOutcome::Newer);
                }
            }
            while cursor.next(&subscriber, &mut sample).unwrap() {
                assert!(sample.stamp.servo_timer > timer, "servo time does not go back");
                timer = sample.stamp.servo_timer;
                samples += 1;
            }
        }
        assert_eq!(cursor.lost(), 0, "of {samples} servo samples");
        self.servo_samples.fetch_add(samples, Ordering::Relaxed);
    }

    /// Asks where a motor is that stands still: somebody else's answer would be another place.
    fn send(&self, client: usize) {
        let mut connection = self.site.connection();
        let motor = STANDING_MOTORS[client % STANDING_MOTORS.len()];
        let line = format!("#{motor}P");
        let mut commands = 0;
        while self.goes_on() {
            let reply = connection.send(&line, PATIENCE).unwrap();
            let position: f64 = reply[0].trim().parse().unwrap();
            assert!((position - place(motor)).abs() < 2.0, "{line}: {reply:?}");
            commands += 1;
            std::thread::sleep(Duration::from_millis(20));
        }
        self.commands.fetch_add(commands, Ordering::Relaxed);
    }

    /// Watches registers and takes every table that is published; the watched counter goes up in each.
    fn watch_variables(&self, registers: &[&str]) {
        let registers: Vec<GatherSource> = registers.iter().map(|text| text.parse().unwrap()).collect();
        let mut board = Board::attach(&self.site.name).unwrap().with_socket(&self.site.socket());
        let mut watch = board.watch_variables(&registers).unwrap();
        let first = board.subscriber().published(RegionId::Variable).unwrap() + 1;
        let mut cursor = board.subscriber().cursor(RegionId::Variable, first).unwrap();
        let (mut sample, mut samples) = (Sample::new(), 0);
        while self.goes_on() {
            std::thread::sleep(Duration::from_millis(10));
            while cursor.next(board.subscriber(), &mut sample).unwrap() {
                samples += 1;
            }
            watch.check().unwrap();
        }
        assert_eq!(cursor.lost(), 0);
        let table = board.variables().unwrap().unwrap();
        for register in registers {
            assert!(table.data.value_of(register).is_some(), "{register} has no value");
        }
        self.variable_samples.fetch_add(samples, Ordering::Relaxed);
    }

    /// Says every ten seconds how it goes, until the end or until one of the programs at work has given up.
    fn report(&self, subscriber: &Subscriber, end: Instant, programs: &mut [&mut Child]) {
        let (daemon, simulator) = (self.site.daemon_pid(), self.site.simulator_pid());
        let started = Instant::now();
        let mut settled = None;
        let mut said = Instant::now();
        while Instant::now() < end {
            std::thread::sleep(Duration::from_millis(200));
            if programs
                .iter_mut()
                .any(|program| program.try_wait().unwrap().is_some_and(|status| !status.success()))
            {
                println!("after {} s: a program has given up", started.elapsed().as_secs());
                return;
            }
            // Settled once everything has been used for a while.
            if settled.is_none() && (end - Instant::now()) < (end - started) * 3 / 4 {
                settled = Some((weight(daemon), weight(simulator)));
            }
            if said.elapsed() > Duration::from_secs(10) {
                said = Instant::now();
                println!(
                    "{:5} s: updates={} missed={} skipped={} retries={} daemon {:?} simulator {:?}",
                    started.elapsed().as_secs(),
                    counter(subscriber, Counter::Updates),
                    counter(subscriber, Counter::Missed),
                    counter(subscriber, Counter::Skipped),
                    counter(subscriber, Counter::Retries),
                    weight(daemon),
                    weight(simulator),
                );
            }
        }
        let (was, now) = (settled.unwrap(), (weight(daemon), weight(simulator)));
        for (what, was, now) in [("daemon", was.0, now.0), ("simulator", was.1, now.1)] {
            assert!(now.0 <= was.0 + GROWTH_KIB, "the {what} grew from {} to {} KiB", was.0, now.0);
            assert!(now.1 <= was.1, "the {what} had {} descriptors and has {}", was.1, now.1);
        }
    }
}

#[test]
fn everything_at_once_loses_nothing_and_stays_as_small_as_it_was() {
    let site = Site::running(&[], &[]);
    site.wait_for_live_servo();
    let ready = "&1 #1->X #2->Y I55=1";
    wait_until("a board that takes commands", || site.pmacctl(&["send", ready]).0 == 0);
    for motor in STANDING_MOTORS {
        assert_eq!(site.pmacctl(&["send", &format!("#{motor}J={}", place(motor))]).0, 0);
    }
    let mut connection = site.connection();
    for motor in STANDING_MOTORS {
        wait_until("the motors in their places", || {
            let reply = connection.send(&format!("#{motor}P"), PATIENCE).unwrap();
            (reply[0].trim().parse::<f64>().unwrap() - place(motor)).abs() < 1.0
        });
    }
    let program = site.path("program.pmc");
    let lines = seconds() * LINES_A_SECOND;
    let mut text = format!("ABS LINEAR TA10 TS0 TM{}\n", 1000 / LINES_A_SECOND);
    for line in 0..lines {
        text += &format!("X{} Y{}\n", line % 1000, line * 7 % 500);
    }
    std::fs::write(&program, text).unwrap();

    let run = Run {
        site: &site,
        done: AtomicBool::new(false),
        servo_samples: AtomicU64::new(0),
        variable_samples: AtomicU64::new(0),
        commands: AtomicU64::new(0),
    };
    // A gather is begun before the rotary buffer is opened and ended after it is closed: its lines are no program lines.
    let (gather_seconds, file) = ((seconds() + 4).to_string(), site.path("gathered.npy"));
    let mut gather_arguments = vec!["gather", "--period", "1", "--seconds", &gather_seconds, "-o"];
    gather_arguments.push(file.to_str().unwrap());
    for source in ["servo_timer", "1.actual_position", "2.actual_position", "D:$0028"] {
        gather_arguments.extend(["--source", source]);
    }
    let mut gather = pmacctl(&site, &gather_arguments);
    wait_until("the gather to run", || std::fs::metadata(&file).is_ok_and(|there| there.len() > 4096));
    let mut stream =
        pmacctl(&site, &["rotary", "stream", program.to_str().unwrap(), "--define", "1000", "--run"]);
    let subscriber = site.attach();
    let before = counter(&subscriber, Counter::Updates);
    let end = Instant::now() + Duration::from_secs(seconds());
    std::thread::scope(|scope| {
        let run = &run;
        for reader in 0..SLEEPING_READERS {
            scope.spawn(move || run.read_servo(Some(Duration::from_millis(5 + 7 * reader as u64))));
        }
        for _ in 0..WAITING_READERS {
            scope.spawn(move || run.read_servo(None));
        }
        for client in 0..COMMAND_CLIENTS {
            scope.spawn(move || run.send(client));
        }
        scope.spawn(move || run.watch_variables(&["X:$0000", "D:$0028", "Y:$0700", "L:$0720"]));
        scope.spawn(move || run.watch_variables(&["X:$0000", "X:$0701", "D:$002B"]));
        run.report(&subscriber, end, &mut [&mut gather, &mut stream]);
        run.done.store(true, Ordering::Relaxed);
    });
    let stream = stream.wait_with_output().unwrap();
    let gather = gather.wait_with_output().unwrap();
    println!(
        "{} s: updates={} missed={} skipped={} retries={}; read by {} readers {}; tables {}; commands {}; rotary lines {} \
         underruns {}; gathered {} lost {}",
        seconds(),
        counter(&subscriber, Counter::Updates) - before,
        counter(&subscriber, Counter::Missed),
        counter(&subscriber, Counter::Skipped),
        counter(&subscriber, Counter::Retries),
        SLEEPING_READERS + WAITING_READERS,
        run.servo_samples.load(Ordering::Relaxed),
        run.variable_samples.load(Ordering::Relaxed),
        run.commands.load(Ordering::Relaxed),
        number(&stream, "lines"),
        number(&stream, "underruns"),
        number(&gather, "samples"),
        number(&gather, "lost"),
    );
    println!("simulator: {}", site.status());
    assert_eq!(number(&stream, "lines"), lines + 1);
    assert_eq!(counter(&subscriber, Counter::Lost), 0);
    assert!(run.commands.load(Ordering::Relaxed) > 0 && run.variable_samples.load(Ordering::Relaxed) > 0);
    assert_quiet(&site.log());
    site.assert_no_violations();
    assert!(Path::new(&file).exists());
}

/// Nothing above "info", and of that only what people asked for and how the daemon began.
fn assert_quiet(log: &str) {
    // Said once where the tests themselves run as root.
    let lines: Vec<&str> = log.lines().filter(|line| !line.contains("running as root")).collect();
    let is_loud = |line: &&&str| line.contains("WARN") || line.contains("ERROR");
    let loud: Vec<&&str> = lines.iter().filter(is_loud).collect();
    assert!(loud.is_empty(), "{loud:#?}");
    let unasked = lines.iter().filter(|line| !line.contains(" uid ")).count();
    assert!(unasked < 60, "{unasked} lines that nobody asked for: {lines:#?}");
}
