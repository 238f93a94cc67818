//! What attacks on the command socket must not touch, watched while they last: the servo data, an honest client, the daemon's size.

use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use pmac_dpram::client::Connection;
use pmac_dpram::map::Family;
use pmac_dpram::segment::{Counter, RegionId, Sample, monotonic_ns};

use crate::board_words::time_index;
use crate::drawn_board::DrawnBoard;
use crate::hostile::flooders;
use crate::support::{PATIENCE, Site, Weight, wait_until};

/// How long an honest client may have to wait for an answer. A line behind ten thousand others would take longer.
const FAIR: Duration = Duration::from_secs(5);
/// What the daemon may grow by, whatever comes; 5 MiB were measured with 40 connections that flood it.
const GROWTH_KIB: u64 = 16 * 1024;
/// With more of them, each may keep a call and replies of 64 KiB each, in buffers that grow twofold.
const GROWTH_A_FLOODER_KIB: u64 = 192;

/// 48 bits of nanoseconds, as the simulator writes them.
const STAMP_MASK: u64 = (1 << 48) - 1;

/// Processor time of the daemon's thread called `name`.
pub fn processor_time(pid: u32, name: &str) -> Duration {
    for task in std::fs::read_dir(format!("/proc/{pid}/task")).unwrap() {
        let stat = std::fs::read_to_string(task.unwrap().path().join("stat")).unwrap_or_default();
        let Some((_, rest)) = stat.split_once(&format!("({name}) ")) else { continue };
        let ticks = |field: usize| rest.split(' ').nth(field).unwrap().parse::<u64>().unwrap();
        // utime and stime are fields 14 and 15 of the line; `rest` begins with the third. A tick is 10 ms.
        return Duration::from_millis(10 * (ticks(11) + ticks(12)));
    }
    panic!("no thread {name}");
}

/// Somebody who asks now and then, and waits for each answer.
pub struct Honest {
    thread: JoinHandle<Vec<Duration>>,
}

impl Honest {
    fn start(socket: &Path, done: &'static AtomicBool) -> Self {
        let mut connection = Connection::open(socket).unwrap();
        wait_until("the honest client's first answer", || connection.send("P77=7", PATIENCE).is_ok());
        let thread = std::thread::spawn(move || {
            let mut times = Vec::new();
            while !done.load(Ordering::Relaxed) {
                let asked = Instant::now();
                assert_eq!(connection.send("P77", PATIENCE).unwrap(), ["7"]);
                times.push(asked.elapsed());
                std::thread::sleep(Duration::from_millis(5));
            }
            times
        });
        Self { thread }
    }
}

/// What came of a time under attack, or of one without.
#[derive(Debug)]
pub struct Verdict {
    what: String,
    seen: u64,
    missed: u64,
    late: u64,
    /// From the board's update to the daemon's copy.
    delay_us: [f64; 3],
    answers: Vec<Duration>,
    grown_kib: u64,
}

impl Verdict {
    pub fn print(&self) {
        let at =
            |share: f64| self.answers[((self.answers.len() - 1) as f64 * share) as usize].as_secs_f64() * 1e3;
        let [median, p99, p999] = self.delay_us;
        println!(
            "{:<34} servo seen {:>5} missed {:>4} (board late {:>3}) delay us {median:>5.0} {p99:>6.0} {p999:>6.0} | answers \
             {:>4}: ms {:>5.1} {:>6.1} {:>6.1} | grown {:>5} KiB",
            self.what,
            self.seen,
            self.missed,
            self.late,
            self.answers.len(),
            at(0.5),
            at(0.99),
            at(1.0),
            self.grown_kib
        );
    }
}

pub fn print_head() {
    println!(
        "delays: median, 99 %, 99.9 %, from the board's update to the daemon's copy; answers: median, 99 %, longest"
    );
}

/// Watches all of it while `attack` lasts, and asserts that it was left alone and afterwards is as before.
pub fn watch(site: &Site, what: &str, attack: impl FnOnce()) -> Verdict {
    // Threads that outlive a failed test only read this.
    let done: &'static AtomicBool = Box::leak(Box::new(AtomicBool::new(false)));
    let pid = site.daemon_pid();
    let before = Weight::of(pid);
    let subscriber = site.attach();
    let counts = || [Counter::Updates, Counter::Missed].map(|counter| subscriber.counter(counter));
    let late = || site.status()["late"].as_u64().unwrap();
    let (counts_before, late_before) = (counts(), late());
    let honest = Honest::start(&site.socket(), done);
    let largest: &'static AtomicU64 = Box::leak(Box::new(AtomicU64::new(0)));
    let follower = {
        let subscriber = site.attach();
        let family = site.connection().info().unwrap().family;
        let stamp = time_index(Family::by_name(&family).unwrap());
        std::thread::spawn(move || {
            let first = subscriber.published(RegionId::Servo).unwrap() + 1;
            let mut cursor = subscriber.cursor(RegionId::Servo, first).unwrap();
            let (mut sample, mut delays) = (Sample::new(), Vec::new());
            let (mut timer, mut last_ns) = (0, 0);
            while !done.load(Ordering::Relaxed) {
                std::thread::sleep(Duration::from_millis(10));
                largest.fetch_max(Weight::of(pid).resident_kib, Ordering::Relaxed);
                while subscriber.next(&mut cursor, &mut sample).unwrap() {
                    assert!(sample.stamp().valid && sample.stamp().servo_timer > timer, "servo time goes on");
                    (timer, last_ns) = (sample.stamp().servo_timer, sample.stamp().time_ns);
                    let words = &sample.words()[stamp..];
                    let half =
                        |index: usize| u64::from(words[index]) | u64::from(words[index + 1] & 0xFF) << 16;
                    let delay = sample.stamp().time_ns.wrapping_sub(half(0) | half(2) << 24) & STAMP_MASK;
                    delays.push(if delay > STAMP_MASK / 2 { 0.0 } else { delay as f64 / 1e3 });
                }
            }
            assert_eq!(cursor.lost(), 0, "a reader was overrun");
            assert!(monotonic_ns() - last_ns < 5_000_000_000, "the mirror has stopped");
            delays.sort_by(f64::total_cmp);
            delays
        })
    };

    attack();
    // However short it was, servo data and an honest client's answers are to be seen beside it.
    let seen = subscriber.published(RegionId::Servo).unwrap();
    wait_until("the mirror to go on", || subscriber.published(RegionId::Servo).unwrap() > seen + 20);

    done.store(true, Ordering::Relaxed);
    let mut answers = honest.thread.join().expect("the honest client was served");
    answers.sort();
    let delays = follower.join().expect("the mirror did not notice");
    assert!(answers.last().unwrap() < &FAIR, "{what}: somebody waited {:?} for an answer", answers.last());
    assert!(delays.len() > 10, "{what}: the mirror goes on");
    let mut now = Weight::of(pid);
    let deadline = Instant::now() + PATIENCE;
    while now.descriptors > before.descriptors || now.threads > before.threads {
        assert!(Instant::now() < deadline, "{what}: {before:?} before, {now:?} after");
        std::thread::sleep(Duration::from_millis(20));
        now = Weight::of(pid);
    }
    let grown_kib = largest.load(Ordering::Relaxed).saturating_sub(before.resident_kib);
    let most_kib = GROWTH_KIB.max(GROWTH_A_FLOODER_KIB * flooders() as u64);
    assert!(grown_kib < most_kib, "{what}: the daemon grew by {grown_kib} KiB");
    let counts = counts();
    let [seen, missed] = std::array::from_fn(|index| counts[index] - counts_before[index]);
    let at = |share: f64| delays[((delays.len() - 1) as f64 * share) as usize];
    let delay_us = [at(0.5), at(0.99), at(0.999)];
    let verdict = Verdict {
        what: what.to_owned(),
        seen,
        missed,
        late: late() - late_before,
        delay_us,
        answers,
        grown_kib,
    };
    verdict.print();
    verdict
}

/// The board of `family` that is attacked.
pub fn attacked(family: &'static Family) -> DrawnBoard {
    DrawnBoard::asked_by("PMAC_HOSTILE_BOARD", 15, family)
}

/// A board of `family` and its daemon that live, with the board's own time in each report.
pub fn site(family: &'static Family) -> Site {
    let site = attacked(family).site(&["--servo-hz", "1000"]);
    site.wait_for_live_servo();
    site.control("time on");
    let mut connection = site.connection();
    wait_until("the board's identity", || connection.info().unwrap().firmware.is_some());
    site
}
