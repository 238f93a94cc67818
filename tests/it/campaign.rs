//! The fault campaign: a board that misbehaves, while a function is used, while the daemon or a client dies. Every
//! combination is drawn from a seed, so that a run that fails can be repeated alone.
//!
//! Ten thousand: `PMAC_CAMPAIGN_RUNS=10000 cargo test --release --test it campaign:: -- --nocapture`
//! (`PMAC_CAMPAIGN_FIRST=n` begins with run n). Among the other tests it is short.
//!
//! After each run the fault is taken away, and within a bound everything works again. No call takes longer than it
//! may, no snapshot is mixed, no command is done twice or not at all without its sender being told so, nobody
//! gets another's reply, and the host has no bit of its own set once it has gone; no descriptor, memory object or file is left.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;
use pmac_dpram::client::{Board, CommandError, Connection, RotaryPlace};
use pmac_dpram::map::HostOffset;
use pmac_dpram::protocol::CallError;
use pmac_dpram::protocol::board::VariableRecord;
use pmac_dpram::segment::{RegionId, Sample, SegmentName, Subscriber};

use crate::bystander::{self, Bystander, JOGGED};
use crate::misbehaviour::{MISBEHAVIOURS, Misbehaviour, disturb, garbles};
use crate::mixing::tagged_longs;
use crate::site::{Site, is_live, wait_until};
use crate::soak::weight;

/// What a sender gives the board.
const TIMEOUT: Duration = Duration::from_millis(250);
/// Nothing takes longer: a gather is several calls, each bounded by what the daemon gives the board and a margin.
const BOUND: Duration = Duration::from_secs(20);
/// What takes longer than this is worth a look.
const LONG: Duration = Duration::from_secs(2);
/// Runs on one pair of processes, before both are ended and what they leave is looked at.
const RUNS_A_SITE: u64 = 100;

/// What the daemon may have in memory after them; it begins with about 6 MiB, in part the segment's pages.
const RESIDENT_KIB: u64 = 20_000;

/// Words of the host that a board would wait on for ever: Host-Busy, the command's flag and character, the enable masks of
/// the panel, the counts of the variable tables.
const HOST_WORDS: [(u64, u16); 5] =
    [(0x0024, 1), (0x062C, 1), (0x062E, 0xFF), (0x07D0, 0xFFFF), (0x07D4, 0xFFFF)];

fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

/// Evenly spread numbers from a seed (splitmix64).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (self.0 ^ self.0 >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^ mixed >> 31
    }

    fn below(&mut self, limit: u64) -> u64 {
        self.next() % limit
    }

    fn one_of<T: Copy>(&mut self, among: &[T]) -> T {
        among[self.below(among.len() as u64) as usize]
    }
}

/// What the host is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Use {
    Count,
    Ask,
    Control,
    Panel,
    Feed,
    Variables,
    SetVariable,
    Words,
    Rotary,
    Gather,
}

const USES: &[Use] = &[
    Use::Count,
    Use::Ask,
    Use::Control,
    Use::Panel,
    Use::Feed,
    Use::Variables,
    Use::SetVariable,
    Use::Words,
    Use::Rotary,
    Use::Gather,
];

/// What happens meanwhile to those who use it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Event {
    Nothing,
    DaemonKilled,
    DaemonStopped,
    DaemonEnded,
}

fn event(random: &mut Random) -> Event {
    match random.below(10) {
        0 => Event::DaemonKilled,
        1 => Event::DaemonEnded,
        2 => Event::DaemonStopped,
        _ => Event::Nothing,
    }
}

/// Somebody else, who dies while they use it.
fn bystander(random: &mut Random, used: Use) -> Option<Bystander> {
    let bystander = (random.below(5) < 2).then(|| random.one_of(Bystander::ALL))?;
    // A line sent while somebody's rotary buffer is open belongs into it.
    let to_be_executed = matches!(used, Use::Count | Use::Ask);
    Some(if to_be_executed && bystander == Bystander::Streaming { Bystander::Subscribed } else { bystander })
}

/// How often a variable of the board was asked to go up by one, and was told to have done so.
#[derive(Default)]
struct Count {
    asked: u64,
    done: u64,
}

impl Count {
    fn ask(&mut self, connection: &mut Connection) -> Result<(), CommandError> {
        self.asked += 1;
        connection.send("P100=P100+1", TIMEOUT)?;
        self.done += 1;
        Ok(())
    }

    fn begin(&mut self, connection: &mut Connection) {
        wait_until("P100 to be set", || connection.send("P100=0", Duration::from_secs(2)).is_ok());
        *self = Self::default();
    }
}

struct Campaign<'a> {
    site: Site,
    /// Every servo sample from now on carries its update's number in every field.
    tagged: &'a AtomicBool,
    dpram: File,
    count: Count,
    longest: Duration,
    longest_recovery: Duration,
    results: BTreeMap<(Use, bool), u64>,
}

impl<'a> Campaign<'a> {
    fn new(tagged: &'a AtomicBool) -> Self {
        let site = Site::running(&[], &[]);
        bystander::prepare(&site);
        let dpram = File::open(site.path("dpram")).unwrap();
        let mut campaign = Self {
            site,
            tagged,
            dpram,
            count: Count::default(),
            longest: Duration::ZERO,
            longest_recovery: Duration::ZERO,
            results: BTreeMap::new(),
        };
        campaign.board_is_new();
        campaign
    }

    /// After power-on or a reset: what the runs need that the start-up lines do not set.
    fn board_is_new(&mut self) {
        self.site.control("tag on");
        self.site.wait_for_live_servo();
        self.wait_for_updates();
        self.tagged.store(true, Ordering::SeqCst);
        let mut connection = self.site.connection();
        for line in ["I2=3", "I55=1", "&1 #1->X #2->Y"] {
            wait_until("a board that takes commands", || connection.send(line, TIMEOUT).is_ok());
        }
        self.count.begin(&mut connection);
    }

    fn run(&mut self, run: u64) {
        let mut random = Random(run);
        let misbehaviour = random.one_of(MISBEHAVIOURS);
        let used = random.one_of(USES);
        let event = event(&mut random);
        let delay = Duration::from_micros(random.below(15_000));
        let is_first = random.below(2) == 0;
        let bystander = bystander(&mut random, used);
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
            let user = scope.spawn(move || use_it(site, used, count, run, garbles(misbehaviour)));
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
                disturb(site, misbehaviour);
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
        if undisturbed && bystander == Some(Bystander::Jogging) {
            self.assert_stopped();
        }
        let recovery = started.elapsed();
        if recovery > LONG {
            println!("    recovered after {recovery:?}");
        }
        self.longest_recovery = self.longest_recovery.max(recovery);
    }

    fn begin(&mut self, misbehaviour: Misbehaviour) {
        if misbehaviour == Misbehaviour::Power {
            self.tagged.store(false, Ordering::SeqCst);
            self.site.kill_simulator();
            self.site.start_simulator(&["--dpram-startup"]);
        } else {
            disturb(&self.site, misbehaviour);
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
                    || misbehaviour == Misbehaviour::Poke("0024", "0001");
                if !spoilt {
                    self.assert_released();
                }
            }
            Event::DaemonStopped | Event::Nothing => return,
        }
        self.site.start_daemon(&[]);
    }

    /// Everything works again.
    fn recover(&mut self, misbehaviour: Misbehaviour) {
        let site = &self.site;
        wait_until("live data", || {
            Subscriber::attach(&site.segment())
                .is_ok_and(|subscriber| is_live(&subscriber, RegionId::Background))
        });
        let mut connection = site.connection();
        // A gather that was left running goes first, then the servo report, which is started again.
        wait_until("a reply", || {
            let closed = connection.send("CLOSE", TIMEOUT).is_ok();
            closed && connection.send("ENDGATHER ENDGATHER GATHER I57=0", TIMEOUT).is_ok()
        });
        if garbles(misbehaviour) {
            // A gather that was told a wrong I19 sets it again at its end.
            wait_until("the report's period", || connection.send("I19=1 I48=1", TIMEOUT).is_ok());
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
        assert_eq!(connection.send("I59 I58", Duration::from_secs(2)).unwrap(), ["8", "1"]);
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
        for (offset, bits) in HOST_WORDS {
            let mut word = [0; 2];
            self.dpram.read_exact_at(&mut word, offset).unwrap();
            assert_eq!(u16::from_le_bytes(word) & bits, 0, "a bit of the host's is left in 0x{offset:04X}");
        }
    }
}

/// Looks at every servo sample it can get, of whichever daemon there is, while they are `tagged`.
fn check_samples(segment: &SegmentName, tagged: &AtomicBool, done: &AtomicBool) -> (u64, Vec<String>) {
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
        let numbers: BTreeSet<u32> = tagged_longs(sample.words()).filter(|&long| long != 0).collect();
        if numbers.len() > 1 {
            let found = format!("sample {sequence}, servo timer {}: {numbers:x?}", sample.stamp.servo_timer);
            println!("    mixed: {found}");
            mixed.push(found);
        }
    }
    (checked, mixed)
}

fn use_it(site: &Site, used: Use, count: &mut Count, run: u64, garbled: bool) -> Result<(), CommandError> {
    let mut connection = Connection::open(&site.socket())?;
    match used {
        Use::Count => (0..3).try_for_each(|_| count.ask(&mut connection)),
        Use::Ask => {
            // Another's reply would not have this number in it.
            let number = run % 1_000_000;
            let reply = connection.send(&format!("P101={number} P101"), TIMEOUT)?;
            assert!(garbled || reply == [number.to_string()], "{reply:?}");
            Ok(())
        }
        Use::Control => connection.control(0x04).map(drop),
        Use::Panel => {
            connection.panel("jog+", &[1, 3])?;
            connection.panel("jog-stop", &[1, 3])
        }
        Use::Feed => {
            connection.feed_override(1, Some(7253))?;
            connection.feed_override(1, None).map(drop)
        }
        Use::Variables => {
            let mut board = board(site)?;
            let registers = ["X:$0000", "D:$0028", "Y:$0700"].map(|text| text.parse().unwrap());
            let mut watch = board.watch_variables(&registers)?;
            let _ = board.wait_variables(0, TIMEOUT);
            watch.check()
        }
        Use::SetVariable => {
            let record = |register: &str, value| VariableRecord {
                register: register.to_owned(),
                offset: None,
                width: None,
                value,
            };
            let records: Vec<VariableRecord> =
                (0..40).map(|index| record(&format!("Y:${:04X}", 0x700 + index), index as f64)).collect();
            connection.write_variables(&records, TIMEOUT)
        }
        Use::Words => {
            let first = HostOffset::new(0x2000);
            let words: Vec<(u16, u16)> = (0..16).map(|word| (run as u16 ^ word, 0xFFFF)).collect();
            connection.write(first, &words, false)?;
            connection.read(first, 16).map(drop)
        }
        Use::Rotary => {
            for line in ["CLOSE", "I57=0", "DELETE GATHER", "&1DELETE ROT", "&1DEFINE ROT 100", "&1B0"] {
                match connection.send(line, TIMEOUT) {
                    // The first time there is none to delete.
                    Err(CommandError::Refused(CallError::Board { .. })) if line.contains("DELETE ROT") => {}
                    result => drop(result?),
                }
            }
            connection.rotary_open(RotaryPlace {
                buffer: 1,
                start: None,
                size_longs: None,
                coordinate_system: 1,
                coordinate_system_base: 1,
            })?;
            connection.send("I57=1", TIMEOUT)?;
            connection.rotary_state(1)?;
            connection.send("I57=0", TIMEOUT).map(drop)
        }
        Use::Gather => {
            let (status, _, error) =
                site.pmacctl(&["gather", "--source", "servo_timer", "--seconds", "0.05", "-o", "-"]);
            if status == 0 { Ok(()) } else { Err(CallError::Protocol(error).into()) }
        }
    }
}

fn board(site: &Site) -> Result<Board, CommandError> {
    let gone = |_| CallError::Protocol("no segment".to_owned()).into();
    Board::attach(&site.name).map(|board| board.with_socket(&site.socket())).map_err(gone)
}

/// Shared-memory objects of the daemon of that name.
fn objects(name: &str) -> Vec<String> {
    let names = std::fs::read_dir("/dev/shm").unwrap().flatten();
    let names = names.map(|entry| entry.file_name().to_string_lossy().into_owned());
    names.filter(|found| found.contains(name) && !found.ends_with(".lock")).collect()
}

#[test]
fn whatever_the_board_does_everything_works_again() {
    let first = number("PMAC_CAMPAIGN_FIRST", 1);
    let runs = number("PMAC_CAMPAIGN_RUNS", 12);
    let (mut done, mut results) = (0, BTreeMap::new());
    let (mut longest, mut recovery, mut checked) = (Duration::ZERO, Duration::ZERO, 0);
    while done < runs {
        let tagged = AtomicBool::new(false);
        let mut campaign = Campaign::new(&tagged);
        let segment = campaign.site.segment();
        let over = AtomicBool::new(false);
        let (samples, mixed) = std::thread::scope(|scope| {
            let checker = scope.spawn(|| check_samples(&segment, &tagged, &over));
            // Ended also when a run fails, or the scope would wait for ever.
            let _ended = Ended(&over);
            for run in done..runs.min(done + RUNS_A_SITE) {
                campaign.run(first + run);
            }
            over.store(true, Ordering::Relaxed);
            checker.join().unwrap()
        });
        assert!(mixed.is_empty(), "of {samples} samples: {mixed:#?}");
        checked += samples;
        done = runs.min(done + RUNS_A_SITE);
        longest = longest.max(campaign.longest);
        recovery = recovery.max(campaign.longest_recovery);
        for (key, times) in &campaign.results {
            *results.entry(*key).or_default() += times;
        }
        let descriptors =
            std::fs::read_dir(format!("/proc/{}/fd", campaign.site.daemon_pid())).unwrap().count();
        assert!(descriptors < 40, "the daemon has {descriptors} descriptors open");
        let (resident_kib, _) = weight(campaign.site.daemon_pid());
        assert!(resident_kib < RESIDENT_KIB, "the daemon uses {resident_kib} KiB");
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
            "{done} runs: {checked} samples checked, none mixed; longest call {longest:?}, recovery {recovery:?}; {}",
            text.join(", ")
        );
    }
}

struct Ended<'a>(&'a AtomicBool);

impl Drop for Ended<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}
