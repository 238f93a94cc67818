//! Everything at once, for long: every function in use, twenty readers, eight command clients.
//!
//! An hour: `PMAC_SOAK_SECONDS=3600 cargo test --release --test realtime soak:: -- --nocapture`. Among the other tests it is short.
//! `soak::c6` has a Turbo board alone. `PMAC_SOAK_BOARD=n` draws another board: how it reads the manual, how slow it is, what it powers up with.
//!
//! What is asserted: no ring lost a sample to any reader, no reply went to somebody else, the simulator saw no broken
//! handshake, memory and descriptors of both processes did not grow, and the daemon's log has nothing but what was asked of it.
//! What the machine's other work made the simulator or the mirror miss is counted and printed.

use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::ScopedJoinHandle;
use std::time::{Duration, Instant};

use pmac_dpram::client::Board;
use pmac_dpram::map::{Family, Function, PMAC, TURBO2, VariableName};
use pmac_dpram::segment::{Counter, RegionId, Sample, Subscriber, WaitOutcome};

use crate::drawn_board::DrawnBoard;
use crate::support::{Ended, PATIENCE, Site, Weight, counter, output_within, wait_until};

/// Readers that sleep as long as they like and then take everything that has come meanwhile.
const SLEEPING_READERS: usize = 16;
/// Readers that are woken at each update.
const WAITING_READERS: usize = 4;
const COMMAND_CLIENTS: usize = 8;
/// Lines of the rotary program that the board executes in a second.
const LINES_A_SECOND: u64 = 10;
/// The motors the command clients ask about stand still, each in a place of its own; 1 and 2 belong to the program.
const STANDING_MOTORS: [u32; 6] = [3, 4, 5, 6, 7, 8];
/// What two clients watch, one register in both.
const WATCHED: [&[&str]; 2] =
    [&["X:$0000", "D:$0028", "Y:$0770", "L:$0720"], &["X:$0000", "X:$0771", "D:$002B"]];
/// What a process may grow by after it has settled.
const GROWTH_KIB: u64 = 1024;

fn seconds() -> u64 {
    std::env::var("PMAC_SOAK_SECONDS").ok().and_then(|text| text.parse().ok()).unwrap_or(6).max(1)
}

fn place(motor: u32) -> f64 {
    f64::from(motor) * 1000.0
}

/// One of the programs at work. Dropped, it is dead.
struct Program {
    what: &'static str,
    process: Child,
}

impl Program {
    /// How it ended and what it printed. At its end it may be a while behind the clock.
    fn output(&mut self) -> Output {
        output_within(&mut self.process, PATIENCE + Duration::from_secs(seconds() / 10))
    }

    fn assert_has_not_given_up(&mut self) {
        if self.process.try_wait().unwrap().is_some_and(|status| !status.success()) {
            let output = self.output();
            let stderr = String::from_utf8_lossy(&output.stderr);
            panic!("{} has given up: {} {stderr}", self.what, output.status);
        }
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn pmacctl(site: &Site, what: &'static str, arguments: &[&str]) -> Program {
    let process = Command::new(env!("CARGO_BIN_EXE_pmacctl"))
        .args(["--name", &site.name])
        .arg("--socket")
        .arg(site.socket())
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    Program { what, process }
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
            while subscriber.next(&mut cursor, &mut sample).unwrap() {
                assert!(sample.stamp().servo_timer > timer, "servo time does not go back");
                timer = sample.stamp().servo_timer;
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
        let registers: Vec<VariableName> = registers.iter().map(|text| text.parse().unwrap()).collect();
        let mut board = Board::attach(&self.site.name).unwrap().with_socket(&self.site.socket());
        let mut watch = board.watch_variables(&registers).unwrap();
        let first = board.subscriber().published(RegionId::Variable).unwrap() + 1;
        let mut cursor = board.subscriber().cursor(RegionId::Variable, first).unwrap();
        let (mut sample, mut samples) = (Sample::new(), 0);
        while self.goes_on() {
            std::thread::sleep(Duration::from_millis(10));
            while board.subscriber().next(&mut cursor, &mut sample).unwrap() {
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

    /// Says every ten seconds how it goes, until the end.
    ///
    /// # Panics
    /// When one of the programs or threads at work has given up, or a process has grown: nothing else is waited for then.
    fn report(
        &self,
        subscriber: &Subscriber,
        end: Instant,
        mut programs: Vec<&mut Program>,
        threads: &[ScopedJoinHandle<()>],
    ) {
        let weigh = || [self.site.daemon_pid(), self.site.simulator_pid()].map(Weight::of);
        let started = Instant::now();
        let mut settled = None;
        let mut said = Instant::now();
        while settled.is_none() || Instant::now() < end {
            std::thread::sleep(Duration::from_millis(200));
            for program in &mut programs {
                program.assert_has_not_given_up();
            }
            assert!(!threads.iter().any(ScopedJoinHandle::is_finished), "a thread has given up");
            // Settled once everything has been used for a while.
            if settled.is_none() && (end - Instant::now()) < (end - started) * 3 / 4 {
                settled = Some(weigh());
            }
            if said.elapsed() > Duration::from_secs(10) {
                said = Instant::now();
                let [daemon, simulator] = weigh();
                println!(
                    "{:5} s: updates={} missed={} skipped={} retries={} resets={} daemon {daemon} simulator {simulator}",
                    started.elapsed().as_secs(),
                    counter(subscriber, Counter::Updates),
                    counter(subscriber, Counter::Missed),
                    counter(subscriber, Counter::Skipped),
                    counter(subscriber, Counter::Retries),
                    counter(subscriber, Counter::Resets),
                );
            }
        }
        for ((what, was), now) in ["daemon", "simulator"].iter().zip(settled.unwrap()).zip(weigh()) {
            assert!(now.resident_kib <= was.resident_kib + GROWTH_KIB, "the {what} was {was} and is {now}");
            assert!(now.descriptors <= was.descriptors, "the {what} had {was} and has {now}");
        }
    }
}

#[test]
fn everything_at_once_loses_nothing_and_stays_as_small_as_it_was() {
    everything_at_once_on(&PMAC);
}

#[test]
fn everything_at_once_loses_nothing_on_a_turbo_board() {
    everything_at_once_on(&TURBO2);
}

fn everything_at_once_on(family: &'static Family) {
    let site = DrawnBoard::asked_by("PMAC_SOAK_BOARD", 1, family).site(&[]);
    site.wait_for_live_servo();
    site.wait_for_its_functions();
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
    let mut gather = pmacctl(&site, "the gather", &gather_arguments);
    wait_until("the gather to run", || std::fs::metadata(&file).is_ok_and(|there| there.len() > 4096));
    let streams = family.functions.contains(&Function::Rotary);
    let stream_arguments = ["rotary", "stream", program.to_str().unwrap(), "--define", "1000", "--run"];
    let mut stream = streams.then(|| pmacctl(&site, "the rotary stream", &stream_arguments));
    let subscriber = site.attach();
    let before = counter(&subscriber, Counter::Updates);
    let end = Instant::now() + Duration::from_secs(seconds());
    std::thread::scope(|scope| {
        let run = &run;
        // Also when something fails, or the scope would wait for ever.
        let _ended = Ended(&run.done);
        let mut threads = Vec::new();
        for reader in 0..SLEEPING_READERS {
            let sleep = Duration::from_millis(5 + 7 * reader as u64);
            threads.push(scope.spawn(move || run.read_servo(Some(sleep))));
        }
        for _ in 0..WAITING_READERS {
            threads.push(scope.spawn(move || run.read_servo(None)));
        }
        for client in 0..COMMAND_CLIENTS {
            threads.push(scope.spawn(move || run.send(client)));
        }
        for registers in WATCHED {
            threads.push(scope.spawn(move || run.watch_variables(registers)));
        }
        let programs = [Some(&mut gather), stream.as_mut()].into_iter().flatten().collect();
        run.report(&subscriber, end, programs, &threads);
    });
    let (stream, gather) = (stream.map(|mut stream| stream.output()), gather.output());
    let [streamed, underruns] =
        ["lines", "underruns"].map(|name| stream.as_ref().map(|stream| number(stream, name)));
    println!(
        "{} s: updates={} missed={} skipped={} retries={}; read by {} readers {}; tables {}; commands {}; rotary lines {streamed:?} \
         underruns {underruns:?}; gathered {} lost {}",
        seconds(),
        counter(&subscriber, Counter::Updates) - before,
        counter(&subscriber, Counter::Missed),
        counter(&subscriber, Counter::Skipped),
        counter(&subscriber, Counter::Retries),
        SLEEPING_READERS + WAITING_READERS,
        run.servo_samples.load(Ordering::Relaxed),
        run.variable_samples.load(Ordering::Relaxed),
        run.commands.load(Ordering::Relaxed),
        number(&gather, "samples"),
        number(&gather, "lost"),
    );
    println!("simulator: {}", site.status());
    assert_eq!(streamed, streams.then_some(lines + 1));
    assert_eq!(counter(&subscriber, Counter::Lost), 0);
    assert!(run.commands.load(Ordering::Relaxed) > 0 && run.variable_samples.load(Ordering::Relaxed) > 0);
    let late = site.status()["late"].as_u64().unwrap();
    assert_quiet(&site.log(), late + counter(&subscriber, Counter::Missed));
    site.assert_no_violations();
    assert!(Path::new(&file).exists());
}

/// Servo cycles without an update after which the data are called stale, 100 ms.
const STALE_CYCLES: u64 = 225;

/// Nothing above "info", and of that only what people asked for and how the daemon began. That no data came for a tenth of a
/// second may be said as often as the machine, whose simulator or mirror was `late` by so many cycles, can have been to blame.
fn assert_quiet(log: &str, late: u64) {
    // Said once where the tests themselves run as root.
    let lines: Vec<&str> = log.lines().filter(|line| !line.contains("running as root")).collect();
    let is_stale = |line: &str| line.contains("servo data: stale");
    let stale = lines.iter().filter(|line| is_stale(line)).count() as u64;
    println!("stale {stale} times, late {late} cycles");
    assert!(stale * STALE_CYCLES <= late, "stale {stale} times, but late by {late} cycles only");
    // A board whose replies have no end is told of once.
    let is_reading = |line: &str| line.contains("the board does not mark the end of a reply");
    assert!(lines.iter().filter(|line| is_reading(line)).count() <= 1, "{lines:#?}");
    let is_expected = |line: &str| is_stale(line) || is_reading(line);
    let is_loud = |line: &&&str| (line.contains("WARN") || line.contains("ERROR")) && !is_expected(line);
    let loud: Vec<&&str> = lines.iter().filter(is_loud).collect();
    assert!(loud.is_empty(), "{loud:#?}");
    let unasked = lines.iter().filter(|line| !line.contains(" uid ")).count();
    assert!(unasked < 60, "{unasked} lines that nobody asked for: {lines:#?}");
}
