//! The fault campaign: a board that misbehaves, while a function is used, while the daemon or a client dies. Every
//! combination is drawn from the run's number, and the board of each hundred runs from theirs: its family, how it reads the
//! manual, how slow it is, what it powers up with. A run that fails says how to repeat it.
//!
//! Ten thousand: `PMAC_CAMPAIGN_RUNS=10000 cargo test --release --test realtime campaign:: -- --nocapture`
//! (`PMAC_CAMPAIGN_FIRST=n` begins with run n, `PMAC_CAMPAIGN_FAMILY=turbo2` has boards of that family alone). Among the
//! other tests it is short.
//!
//! After each run the fault is taken away, and within a bound everything works again. No call takes longer than it
//! may, no snapshot is mixed, no command is done twice or not at all without its sender being told so, nobody
//! gets another's reply, and the host has no bit of its own set once it has gone. What was written is what is read back,
//! unless the misbehaviour itself may have hidden it. After each run both processes have no more descriptors and threads than
//! before the first, and hardly more memory; in the end no memory object or file is left.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;
use pmac_dpram::language::Meaning;
use pmac_dpram::map::{Family, Generation, PMAC, TURBO2};
use pmac_dpram::segment::{RegionId, Sample, SegmentName, Subscriber};

use crate::board_words::{Word, host_bits, tagged_longs};
use crate::bystander::{self, Bystander, JOGGED};
use crate::campaign_uses::{Count, TIMEOUT, Use, use_it, uses};
use crate::drawn_board::{DrawnBoard, Random};
use crate::misbehaviour::{Misbehaviour, disturb, garbles, misbehaviours};
use crate::support::{Ended, PATIENCE, Site, Weight, is_live, own_kib, wait_until};

/// Nothing takes longer: a gather is several calls, each bounded by what the daemon gives the board and a margin.
const BOUND: Duration = Duration::from_secs(20);
/// What takes longer than this is worth a look.
const LONG: Duration = Duration::from_secs(2);
/// Runs on one pair of processes, before both are ended and what they leave is looked at.
const RUNS_A_SITE: u64 = 100;
/// Runs among the other tests.
const SHORT: u64 = 12;
/// The variable of the environment that names the family of all boards.
const FAMILY: &str = "PMAC_CAMPAIGN_FAMILY";
/// What a process may grow by as long as it lives, in memory of its own; 100 KiB were measured in a hundred runs.
const GROWTH_KIB: u64 = 256;
/// What the simulator may grow by: at a reset it makes a new board beside the old one, and of the memory of a Turbo board's
/// 32768 variables it gives back some at every second reset only; up to 824 KiB were measured, and forty resets in a row took no more.
const SIMULATOR_GROWTH_KIB: u64 = 1024;
/// What it takes besides when each function is used for the first time, the lines of a rotary buffer above all.
const WARM_UP_KIB: u64 = 1024;

fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

/// What happens meanwhile to those who use it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Event {
    Nothing,
    DaemonKilled,
    DaemonStopped,
    DaemonEnded,
}

/// The hundred that a run is of: these share a board.
fn hundred(run: u64) -> u64 {
    (run.max(1) - 1) / RUNS_A_SITE
}

/// Every other hundred runs the daemon lives through all of them, so that what it grows by adds up.
fn lives_on(run: u64) -> bool {
    hundred(run) % 2 == 1
}

fn event(random: &mut Random, run: u64) -> Event {
    match random.below(10) {
        0 | 1 if lives_on(run) => Event::Nothing,
        0 => Event::DaemonKilled,
        1 => Event::DaemonEnded,
        2 => Event::DaemonStopped,
        _ => Event::Nothing,
    }
}

/// Somebody else, who dies while they use it on a board of `family`.
fn bystander(random: &mut Random, used: Use, family: &Family) -> Option<Bystander> {
    let bystander = (random.below(5) < 2).then(|| random.one_of(&Bystander::on(family)))?;
    // A line sent while somebody's rotary buffer is open belongs into it.
    let to_be_executed = matches!(used, Use::Count | Use::Ask);
    Some(if to_be_executed && bystander == Bystander::Streaming { Bystander::Subscribed } else { bystander })
}

/// What a process holds in quiet moments: after every run as much as before.
struct Scales {
    what: &'static str,
    /// With nobody connected. Whichever process takes the place of the first one has as much.
    empty: Weight,
    pid: u32,
    /// Memory of its own when it was weighed first, with what it had yet to take.
    own_kib: u64,
    /// What it may grow by.
    limit_kib: u64,
    /// The most that one grew by.
    grown_kib: u64,
}

impl Scales {
    /// `pid` has been used for everything.
    fn new(what: &'static str, pid: u32, limit_kib: u64) -> Self {
        // The last client may not be forgotten yet.
        let looks = (0..50).map(|_| {
            std::thread::sleep(Duration::from_millis(2));
            Weight::of(pid)
        });
        let empty = looks.min_by_key(|weight| (weight.descriptors, weight.threads)).unwrap();
        Self { what, empty, pid, own_kib: own_kib(pid), limit_kib, grown_kib: 0 }
    }

    /// After a run: what it opened is closed, what it needed is given back.
    fn weigh(&mut self, pid: u32) {
        let (what, empty) = (self.what, self.empty);
        let deadline = Instant::now() + PATIENCE;
        loop {
            let now = Weight::of(pid);
            if now.descriptors <= empty.descriptors && now.threads <= empty.threads {
                break;
            }
            assert!(Instant::now() < deadline, "the {what} had {empty} and after a run has {now}");
            std::thread::sleep(Duration::from_millis(2));
        }
        let now_kib = own_kib(pid);
        if self.pid != pid {
            (self.pid, self.own_kib) = (pid, now_kib + WARM_UP_KIB);
        }
        let grown_kib = now_kib.saturating_sub(self.own_kib);
        assert!(
            grown_kib <= self.limit_kib,
            "the {what} has grown by {grown_kib} KiB to {now_kib} KiB of its own"
        );
        self.grown_kib = self.grown_kib.max(grown_kib);
    }
}

struct Campaign<'a> {
    board: DrawnBoard,
    /// The family that was asked for.
    asked: Option<&'static Family>,
    uses: Vec<Use>,
    misbehaviours: Vec<Misbehaviour>,
    site: Site,
    scales: Vec<Scales>,
    /// Every servo sample from now on carries its update's number in every field.
    tagged: &'a AtomicBool,
    dpram: File,
    count: Count,
    longest: Duration,
    longest_recovery: Duration,
    results: BTreeMap<(Use, bool), u64>,
}

impl<'a> Campaign<'a> {
    fn new(board: DrawnBoard, asked: Option<&'static Family>, tagged: &'a AtomicBool) -> Self {
        let site = board.site(&[]);
        bystander::prepare(&site);
        let dpram = File::open(site.path("dpram")).unwrap();
        let mut campaign = Self {
            uses: uses(board.family()),
            misbehaviours: misbehaviours(board.family()),
            board,
            asked,
            site,
            scales: Vec::new(),
            tagged,
            dpram,
            count: Count::default(),
            longest: Duration::ZERO,
            longest_recovery: Duration::ZERO,
            results: BTreeMap::new(),
        };
        campaign.board_is_new();
        campaign.use_everything();
        let processes = [
            ("daemon", campaign.site.daemon_pid(), GROWTH_KIB),
            ("simulator", campaign.site.simulator_pid(), SIMULATOR_GROWTH_KIB),
        ];
        campaign.scales = processes.map(|(what, pid, limit_kib)| Scales::new(what, pid, limit_kib)).into();
        campaign
    }

    /// After power-on or a reset: what the runs need that the start-up lines do not set.
    fn board_is_new(&mut self) {
        self.site.control("tag on");
        self.site.wait_for_live_servo();
        self.wait_for_updates();
        self.tagged.store(true, Ordering::SeqCst);
        let mut connection = self.site.connection();
        let panel: &[&str] = if self.board.family().panel.is_some() { &["I2=3"] } else { &[] };
        for &line in panel.iter().chain(&["I55=1", "&1 #1->X #2->Y"]) {
            wait_until("a board that takes commands", || connection.send(line, TIMEOUT).is_ok());
        }
        self.count.begin(&mut connection);
    }

    /// Each function once, by us and by others, so that what it needs for good is there.
    fn use_everything(&mut self) {
        let family = self.board.family();
        for used in self.uses.clone() {
            let (site, count) = (&self.site, &mut self.count);
            wait_until(&format!("{used:?}"), || {
                use_it(site, family, used, count, 0, Misbehaviour::Nothing).is_ok()
            });
            self.recover(Misbehaviour::Nothing);
        }
        let bystanders = Bystander::on(family);
        for &other in &bystanders {
            let running = other.start(&self.site);
            std::thread::sleep(Duration::from_millis(100));
            drop(running);
            self.recover(Misbehaviour::Nothing);
        }
        // Whole, to its last line: nothing that is received is longer.
        if bystanders.contains(&Bystander::Streaming) {
            let program = self.site.path("bystander.pmc");
            let stream = ["rotary", "stream", program.to_str().unwrap(), "--define", "37000"];
            wait_until("a program that is streamed", || self.site.pmacctl(&stream).0 == 0);
            self.recover(Misbehaviour::Nothing);
        }
    }

    fn run(&mut self, run: u64) {
        let _repeat = Repeat { run, family: self.asked };
        let mut random = Random(run);
        let family = self.board.family();
        let misbehaviour = random.one_of(&self.misbehaviours);
        let used = random.one_of(&self.uses);
        let event = event(&mut random, run);
        let delay = Duration::from_micros(random.below(15_000));
        let is_first = random.below(2) == 0;
        let bystander = bystander(&mut random, used, family);
        let life = Duration::from_millis(random.below(60));
        println!(
            "run {run}: {misbehaviour:?} while {used:?}, {event:?} after {delay:?}; {bystander:?} for {life:?} before"
        );
        let dying = bystander.map(|bystander| bystander.start(&self.site));
        if dying.is_some() {
            std::thread::sleep(life);
        }

        // Two updates of the same number, one after the other, cannot be told apart in optimistic reading.
        if misbehaviour == Misbehaviour::Timer("-1") {
            self.tagged.store(false, Ordering::SeqCst);
        }
        if is_first {
            self.begin(misbehaviour);
        }
        let started = Instant::now();
        let (site, count) = (&self.site, &mut self.count);
        let outcome = std::thread::scope(|scope| {
            let user = scope.spawn(move || use_it(site, family, used, count, run, misbehaviour));
            std::thread::sleep(delay);
            match event {
                Event::DaemonKilled => site.signal_daemon(Signal::SIGKILL),
                Event::DaemonEnded => site.signal_daemon(Signal::SIGTERM),
                Event::DaemonStopped => {
                    site.signal_daemon(Signal::SIGSTOP);
                    std::thread::sleep(Duration::from_millis(120));
                    site.signal_daemon(Signal::SIGCONT);
                }
                Event::Nothing => {}
            }
            drop(dying);
            if !is_first && misbehaviour != Misbehaviour::Power {
                disturb(site, family, misbehaviour);
            }
            user.join().unwrap()
        });
        let took = started.elapsed();
        if took > LONG {
            println!("    took {took:?}");
        }
        assert!(took < BOUND, "{used:?} took {took:?}");
        self.longest = self.longest.max(took);
        *self.results.entry((used, outcome.is_ok())).or_default() += 1;
        let undisturbed = misbehaviour == Misbehaviour::Nothing && event == Event::Nothing;
        if undisturbed && bystander.is_none_or(Bystander::leaves_room) {
            outcome.unwrap_or_else(|error| panic!("{used:?} on a board in order: {error}"));
        } else if let Err(error) = outcome {
            println!("    {error}");
        }

        if !is_first && misbehaviour == Misbehaviour::Power {
            self.begin(misbehaviour);
        }
        let started = Instant::now();
        self.mend(misbehaviour, event);
        self.recover(misbehaviour);
        self.tagged.store(true, Ordering::SeqCst);
        if bystander == Some(Bystander::Jogging) {
            // A killed daemon stops nobody (docs/operations.md, "When pmacd dies").
            if event == Event::DaemonKilled {
                self.stop_jogged();
            }
            if undisturbed || event == Event::DaemonKilled {
                self.assert_stopped();
            }
        }
        let recovery = started.elapsed();
        if recovery > LONG {
            println!("    recovered after {recovery:?}");
        }
        self.longest_recovery = self.longest_recovery.max(recovery);
        let pids = [self.site.daemon_pid(), self.site.simulator_pid()];
        self.scales.iter_mut().zip(pids).for_each(|(scales, pid)| scales.weigh(pid));
    }

    fn begin(&mut self, misbehaviour: Misbehaviour) {
        if misbehaviour == Misbehaviour::Power {
            self.tagged.store(false, Ordering::SeqCst);
            self.site.kill_simulator();
            self.board.power_up(&mut self.site, &[]);
        } else {
            disturb(&self.site, self.board.family(), misbehaviour);
        }
    }

    /// Takes the fault away and starts what was ended.
    fn mend(&mut self, misbehaviour: Misbehaviour, event: Event) {
        if let Misbehaviour::Fault(name, _) = misbehaviour {
            self.site.control(&format!("fault {name} off"));
        }
        match event {
            Event::DaemonKilled => self.site.kill_daemon(),
            Event::DaemonEnded => {
                self.site.stop_daemon();
                // Memory that nobody could reach could not be put in order either, nor a bit that came afterwards.
                let spoilt = matches!(misbehaviour, Misbehaviour::Fault("all_ones" | "all_zeros", _))
                    || matches!(misbehaviour, Misbehaviour::Poke(Word::ServoBusy | Word::BackgroundBusy, _));
                if !spoilt {
                    self.assert_released();
                }
            }
            Event::DaemonStopped | Event::Nothing => return,
        }
        self.board.start_daemon(&mut self.site, "");
    }

    /// Everything works again.
    fn recover(&mut self, misbehaviour: Misbehaviour) {
        let site = &self.site;
        let lines = recovery_lines(self.board.family());
        wait_until("live data", || {
            Subscriber::attach(&site.segment())
                .is_ok_and(|subscriber| is_live(&subscriber, RegionId::Background))
        });
        let mut connection = site.connection();
        // A slow board takes long to tell where its M-variables point; as long as it tells more of them all is well.
        let look = || {
            let info = site.connection().info();
            info.map(|info| (info.waiting.is_empty(), info.lines.definitions.read))
        };
        while let Ok((false, read)) = look() {
            wait_until("more definitions", || look().is_ok_and(|(is_over, now)| is_over || now != read));
        }
        // A gather that was left running goes first, then the servo report, which is started again.
        wait_until("a reply", || {
            let closed = connection.send("CLOSE", TIMEOUT).is_ok();
            let deletes = "ENDGATHER ENDGATHER DELETE GATHER";
            let ended = closed && connection.send(deletes, Meaning::of(deletes).deadline(TIMEOUT)).is_ok();
            // What the next one defines must not be refused; there may be nothing to delete.
            let deletes = "&1DELETE ROT";
            let _ = connection.send(deletes, Meaning::of(deletes).deadline(TIMEOUT));
            ended && connection.send(lines.report, TIMEOUT).is_ok()
        });
        if garbles(misbehaviour) {
            // A gather that was told a wrong period sets it again at its end.
            wait_until("the report's period", || connection.send(lines.period, TIMEOUT).is_ok());
        }
        // Live because its time is not over yet does not count: a new update has to come.
        self.wait_for_updates();
        let forgets = matches!(misbehaviour, Misbehaviour::Reset | Misbehaviour::Power);
        if forgets {
            self.board_is_new();
        } else {
            let reply = connection.send("P100", Duration::from_secs(2)).unwrap();
            let found: u64 = reply[0].trim().parse().unwrap();
            let Count { asked, done } = self.count;
            assert!(
                (done..=asked).contains(&found),
                "P100 is {found}: asked {asked} times, done {done} times"
            );
            self.count = Count { asked: found, done: found };
        }
        let (settings, values) = lines.settings;
        assert_eq!(connection.send(settings, Duration::from_secs(2)).unwrap(), values);
    }

    fn stop_jogged(&self) {
        let mut connection = self.site.connection();
        wait_until("a stop", || connection.send(&format!("#{JOGGED}J/"), TIMEOUT).is_ok());
    }

    /// A button that was held down is let go when its holder dies.
    fn assert_stopped(&self) {
        let mut connection = self.site.connection();
        wait_until("the jogged motor to stand", || {
            let reply = connection.send(&format!("#{JOGGED}V"), Duration::from_secs(2)).unwrap();
            reply[0].trim().parse::<f64>().unwrap().abs() < 0.5
        });
    }

    fn wait_for_updates(&self) {
        let subscriber = self.site.attach();
        let published = subscriber.published(RegionId::Servo).unwrap();
        wait_until("servo data", || subscriber.published(RegionId::Servo).unwrap() > published + 2);
    }

    /// No bit of the host's is set.
    fn assert_released(&self) {
        for (offset, bits) in host_bits(self.board.family()) {
            let (mut word, offset) = ([0; 2], offset.bytes());
            self.dpram.read_exact_at(&mut word, offset.into()).unwrap();
            assert_eq!(u16::from_le_bytes(word) & bits, 0, "a bit of the host's is left in 0x{offset:04X}");
        }
    }
}

/// Lines that have a board report again as it did before a run, and ask whether it does.
struct RecoveryLines {
    /// Starts the servo report again.
    report: &'static str,
    period: &'static str,
    /// What is as the start-up lines set it, and as what it is answered.
    settings: (&'static str, [&'static str; 2]),
}

fn recovery_lines(family: &Family) -> RecoveryLines {
    match family.generation {
        Generation::Pmac => {
            RecoveryLines { report: "GATHER I57=0", period: "I19=1 I48=1", settings: ("I59 I58", ["8", "1"]) }
        }
        Generation::Turbo => {
            RecoveryLines { report: "I48=1", period: "I47=1", settings: ("I47 I58", ["1", "1"]) }
        }
    }
}

/// Says how to repeat the run when it fails.
struct Repeat {
    run: u64,
    family: Option<&'static Family>,
}

impl Drop for Repeat {
    fn drop(&mut self) {
        if std::thread::panicking() {
            let first = hundred(self.run) * RUNS_A_SITE + 1;
            let command = |first: u64| {
                let runs = self.run - first + 1;
                let family = self.family.map_or(String::new(), |family| format!("{FAMILY}={} ", family.name));
                format!(
                    "{family}PMAC_CAMPAIGN_FIRST={first} PMAC_CAMPAIGN_RUNS={runs} cargo test --test realtime campaign::"
                )
            };
            println!(
                "repeat this run on its board: {}\nwith all that came before it there: {}",
                command(self.run),
                command(first)
            );
        }
    }
}

/// Looks at every servo sample it can get, of whichever daemon there is, while they are `tagged`.
fn check_samples(
    segment: &SegmentName,
    family: &Family,
    tagged: &AtomicBool,
    done: &AtomicBool,
) -> (u64, Vec<String>) {
    let (mut checked, mut mixed, mut last) = (0, Vec::new(), (0, 0));
    let mut sample = Sample::new();
    let mut subscriber: Option<Subscriber> = None;
    while !done.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_micros(300));
        if subscriber.as_ref().is_none_or(|subscriber| subscriber.condition().is_over()) {
            subscriber = Subscriber::attach(segment).ok();
        }
        let Some(attached) = &subscriber else { continue };
        let was_tagged = tagged.load(Ordering::SeqCst);
        let Ok(Some(sequence)) = attached.latest(RegionId::Servo, &mut sample) else { continue };
        let is_news = last != (attached.generation(), sequence);
        if !was_tagged || !tagged.load(Ordering::SeqCst) || !is_news {
            continue;
        }
        last = (attached.generation(), sequence);
        checked += 1;
        // Zeros are the one thing that a memory which loses its content word by word can mix in.
        let numbers: BTreeSet<u32> = tagged_longs(family, sample.words()).filter(|&long| long != 0).collect();
        if numbers.len() > 1 {
            let found =
                format!("sample {sequence}, servo timer {}: {numbers:x?}", sample.stamp().servo_timer);
            println!("    mixed: {found}");
            mixed.push(found);
        }
    }
    (checked, mixed)
}

/// Shared-memory objects of the daemon of that name.
fn objects(name: &str) -> Vec<String> {
    let names = std::fs::read_dir("/dev/shm").unwrap().flatten();
    let names = names.map(|entry| entry.file_name().to_string_lossy().into_owned());
    names.filter(|found| found.contains(name) && !found.ends_with(".lock")).collect()
}

#[test]
fn whatever_the_board_does_everything_works_again() {
    let asked = std::env::var(FAMILY).ok().map(|name| Family::by_name(&name).unwrap());
    // Boards of all families only if there is time for more than one.
    let is_short = std::env::var_os("PMAC_CAMPAIGN_RUNS").is_none();
    let family = asked.or(is_short.then_some(&PMAC));
    campaign(family, number("PMAC_CAMPAIGN_FIRST", 1), number("PMAC_CAMPAIGN_RUNS", SHORT));
}

#[test]
fn whatever_a_turbo_board_does_everything_works_again() {
    campaign(Some(&TURBO2), 1, SHORT);
}

fn campaign(asked: Option<&'static Family>, first: u64, runs: u64) {
    let (mut done, mut results) = (0, BTreeMap::new());
    let (mut longest, mut recovery, mut checked) = (Duration::ZERO, Duration::ZERO, 0);
    let mut grown_kib = [0; 2];
    while done < runs {
        let tagged = AtomicBool::new(false);
        let board = hundred(first + done);
        let mut campaign = Campaign::new(DrawnBoard::new(board, asked), asked, &tagged);
        let family = campaign.board.family();
        let until = runs.min((board + 1) * RUNS_A_SITE + 1 - first);
        let segment = campaign.site.segment();
        let over = AtomicBool::new(false);
        let (samples, mixed) = std::thread::scope(|scope| {
            let checker = scope.spawn(|| check_samples(&segment, family, &tagged, &over));
            // Ended also when a run fails, or the scope would wait for ever.
            let _ended = Ended(&over);
            for run in done..until {
                campaign.run(first + run);
            }
            over.store(true, Ordering::Relaxed);
            checker.join().unwrap()
        });
        assert!(mixed.is_empty(), "of {samples} samples: {mixed:#?}");
        checked += samples;
        done = until;
        longest = longest.max(campaign.longest);
        recovery = recovery.max(campaign.longest_recovery);
        for (most, scales) in grown_kib.iter_mut().zip(&campaign.scales) {
            *most = scales.grown_kib.max(*most);
        }
        for (key, times) in &campaign.results {
            *results.entry(*key).or_default() += times;
        }
        assert_eq!(campaign.site.stop_daemon(), 0);
        campaign.assert_released();
        assert_eq!(objects(&campaign.site.name), Vec::<String>::new(), "objects are left");
        let text: Vec<String> = results
            .iter()
            .map(|((used, ok), times): (&(Use, bool), &u64)| {
                format!("{used:?} {} {times}", if *ok { "done" } else { "refused" })
            })
            .collect();
        println!(
            "{done} runs: {checked} samples checked, none mixed; longest call {longest:?}, recovery {recovery:?}; \
             daemon and simulator grew by at most {grown_kib:?} KiB; {}",
            text.join(", ")
        );
    }
}
