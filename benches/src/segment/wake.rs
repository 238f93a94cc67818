//! Rows 7 and 8: readers that sleep. From just before the publication to the moment the sleeping process has the whole copy.
//!
//! The sleeper's processor is kept from halting (see [`keep_awake`]).

use std::hint::black_box;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use pmac_dpram::segment::{Sample, WaitOutcome};

use super::ours::{self, SERVO, WORDS};
use super::peer::{Sleeper, Waker};
use crate::clock::{self, Figures, Series};
use crate::process::{Child, Shared, bind, keep_awake};
use crate::table::{Bar, Table};

const WAKES: u64 = 1500;
const PERIOD_NS: f64 = 442_708.0;
const LONG: Duration = Duration::from_secs(5);

/// All rows of this page, once.
pub fn round(table: &mut Table, directory: &Path) {
    let awake = keep_awake(1);
    let ours = waked(1, |_| Ours::new(directory), |shared, reader| follow(directory, shared, reader));
    let bare = waked(1, Bare, bare_sleeper);
    let peer = waked(1, |_| Peer(Waker::new()), peer_sleeper);
    table.add(
        "7",
        "blocked wake and copy / bare futex, mean",
        "us",
        Bar::AtMost(1.05),
        [ours.delay.mean / 1e3, bare.delay.mean / 1e3],
    );
    table.add("7", "- median", "us", Bar::None, [ours.delay.median / 1e3, bare.delay.median / 1e3]);
    table.add(
        "7",
        "blocked wake and copy / iceoryx2 event + pub/sub, mean",
        "us",
        Bar::AtMost(0.9),
        [ours.delay.mean / 1e3, peer.delay.mean / 1e3],
    );
    table.add("7", "- p99", "us", Bar::None, [ours.delay.p99 / 1e3, peer.delay.p99 / 1e3]);
    let ours = waked(4, |_| Ours::new(directory), |shared, reader| follow(directory, shared, reader));
    let peer = waked(4, |_| Peer(Waker::new()), peer_sleeper);
    table.add(
        "8",
        "waking 4 blocked readers: waker's cost / iceoryx2",
        "us",
        Bar::AtMost(0.5),
        [ours.cost.median / 1e3, peer.cost.median / 1e3],
    );
    table.add(
        "8",
        "- delay over all readers, median",
        "us",
        Bar::None,
        [ours.delay.median / 1e3, peer.delay.median / 1e3],
    );
    drop(awake);
}

/// What the waker paid and how long the sleepers waited.
struct Waked {
    cost: Figures,
    delay: Figures,
}

/// A way to wake, handed the counter's reading to pass on.
trait Wake {
    fn wake(&mut self, stamp: u64);
    /// After the last: sleepers that sleep once more shall find that it is over.
    fn finish(&mut self) {}
}

/// Cell 0 counts the readers that are ready, cell 1 tells them that it is over, the words after them take the delays.
const READY: usize = 0;
const OVER: usize = 1;
const FIRST_DELAY: usize = 1024;

fn delay(shared: &Shared, reader: u64, number: u64) -> &AtomicU64 {
    shared.word(FIRST_DELAY + (reader * WAKES + number) as usize)
}

/// Wakes `readers` sleeping processes [`WAKES`] times.
fn waked<'a, W: Wake>(
    readers: u64,
    waker: impl FnOnce(&'a Shared) -> W,
    sleeper: impl Fn(&Shared, u64) + 'a,
) -> Waked {
    // Lives as long as the process: a few hundred kilobytes a measurement.
    let shared: &'a Shared = Box::leak(Box::new(Shared::words(FIRST_DELAY + (readers * WAKES) as usize)));
    bind(0);
    let mut waker = waker(shared);
    let mut children: Vec<Child> =
        (0..readers).map(|reader| Child::on(1, || sleeper(shared, reader))).collect();
    shared.wait(READY, readers);
    std::thread::sleep(Duration::from_millis(20));
    let mut cost = Series::with_room(WAKES as usize);
    let period = clock::ticks(PERIOD_NS);
    let mut next = clock::before();
    for _ in 0..WAKES {
        next += period;
        clock::spin_until(next);
        let start = clock::before();
        waker.wake(start);
        cost.push(clock::between(start, clock::after()));
    }
    std::thread::sleep(Duration::from_millis(20));
    shared.set(OVER, 1);
    // Again and again: a nudge that comes between a sleeper's look and its sleep may be lost.
    while children.iter_mut().any(|child| !child.is_over()) {
        waker.finish();
        std::thread::sleep(Duration::from_millis(2));
    }
    let delays = (0..readers).flat_map(|reader| (0..WAKES).map(move |number| (reader, number)));
    let delays = delays.map(|(reader, number)| delay(shared, reader, number).load(Ordering::Acquire));
    Waked { cost: cost.figures(), delay: delays.filter(|ticks| *ticks > 0).collect::<Series>().figures() }
}

struct Ours(pmac_dpram::segment::Publisher, [u16; WORDS]);

impl Ours {
    fn new(directory: &Path) -> Self {
        Self(ours::publisher(directory, "wake"), [0; WORDS])
    }
}

impl Wake for Ours {
    fn wake(&mut self, stamp: u64) {
        self.0.publish(SERVO, ours::stamp(stamp), &self.1);
    }
}

fn follow(directory: &Path, shared: &Shared, reader: u64) {
    let (subscriber, mut sample) = (ours::subscriber(directory, "wake"), Sample::new());
    shared.cell(READY).fetch_add(1, Ordering::AcqRel);
    let mut last = 0;
    while last < WAKES {
        let waited = subscriber.wait_newer(SERVO, last, LONG).expect("the region");
        assert_eq!(waited, WaitOutcome::Newer);
        last = subscriber.latest(SERVO, &mut sample).expect("a sample").expect("one");
        let ticks = clock::after() - black_box(&sample).stamp().time_ns;
        delay(shared, reader, last - 1).store(ticks, Ordering::Release);
    }
}

/// A word to sleep on, and one that tells when it was changed: the least that any mechanism does.
struct Bare<'a>(&'a Shared);

const FUTEX: usize = 128;
const STAMP: usize = 256;

impl Wake for Bare<'_> {
    fn wake(&mut self, stamp: u64) {
        self.0.word(STAMP).store(stamp, Ordering::Relaxed);
        let word = self.0.word(FUTEX);
        word.store(word.load(Ordering::Relaxed) + 1, Ordering::Release);
        // SAFETY: the word outlives the call, which reads and writes no memory.
        unsafe { libc::syscall(libc::SYS_futex, word.as_ptr(), libc::FUTEX_WAKE, i32::MAX) };
    }
}

fn bare_sleeper(shared: &Shared, reader: u64) {
    shared.cell(READY).fetch_add(1, Ordering::AcqRel);
    let (word, mut last) = (shared.word(FUTEX), 0);
    while last < WAKES {
        while word.load(Ordering::Acquire) == last {
            let patience = libc::timespec { tv_sec: 5, tv_nsec: 0 };
            // SAFETY: word and time-out outlive the call.
            unsafe {
                libc::syscall(
                    libc::SYS_futex,
                    word.as_ptr(),
                    libc::FUTEX_WAIT,
                    last as u32,
                    &raw const patience,
                );
            }
        }
        last = word.load(Ordering::Acquire);
        let ticks = clock::after() - shared.word(STAMP).load(Ordering::Relaxed);
        delay(shared, reader, last - 1).store(ticks, Ordering::Release);
    }
}

struct Peer(Waker);

impl Wake for Peer {
    fn wake(&mut self, stamp: u64) {
        self.0.wake(stamp);
    }

    fn finish(&mut self) {
        self.0.nudge();
    }
}

fn peer_sleeper(shared: &Shared, reader: u64) {
    let sleeper = Sleeper::new();
    shared.cell(READY).fetch_add(1, Ordering::AcqRel);
    let mut number = 0;
    while shared.value(OVER) == 0 {
        sleeper.sleep(|stamp, now| {
            if number < WAKES {
                delay(shared, reader, number).store(now - stamp, Ordering::Release);
                number += 1;
            }
        });
    }
}
