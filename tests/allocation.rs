//! The bus thread asks for no memory once everything has been used: the whole daemon, with an allocator that counts what its
//! thread `bus` does, against a simulated board while every function works.
//!
//! An allocation may wait for a lock that any other thread holds, or for the kernel; a thread that has to read every servo
//! update cannot afford either. Where one was made is printed.

// The one thing here that needs it: an allocator.
#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::backtrace::Backtrace;
use std::cell::Cell;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use pmac_dpram::segment::{Counter, RegionId};

#[path = "support/mod.rs"]
mod support;

use support::{PATIENCE, Site, is_live, joined, output_within, wait_until};

/// Whether allocations are counted now.
static ARMED: AtomicBool = AtomicBool::new(false);
static ALLOCATIONS: AtomicU64 = AtomicU64::new(0);
/// How many are shown with where they were made.
const SHOWN: u64 = 20;

thread_local! {
    /// Needs no memory of its own and no destructor, so that the allocator may use it at any time.
    static IS_BUS: Cell<Option<bool>> = const { Cell::new(None) };
}

struct Counting;

fn count() {
    if !ARMED.load(Ordering::Relaxed) {
        return;
    }
    let is_bus = IS_BUS.get().unwrap_or_else(|| {
        let mut name = [0_u8; 16];
        // SAFETY: the kernel writes at most 16 bytes there.
        unsafe { libc::prctl(libc::PR_GET_NAME, name.as_mut_ptr()) };
        name.starts_with(b"bus\0")
    });
    IS_BUS.set(Some(is_bus));
    if is_bus && ALLOCATIONS.fetch_add(1, Ordering::Relaxed) < SHOWN {
        // What printing allocates is not counted.
        IS_BUS.set(Some(false));
        eprintln!("the bus thread allocates:\n{}", Backtrace::force_capture());
        IS_BUS.set(Some(true));
    }
}

// SAFETY: everything is the system's allocator's.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        // SAFETY: the caller's promises are passed on.
        unsafe { System.realloc(block, layout, size) }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        // SAFETY: the caller's promises are passed on.
        unsafe { System.dealloc(block, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// The counting itself: this would be found.
fn check_that_it_counts() {
    let allocate = || {
        ARMED.store(true, Ordering::Relaxed);
        std::hint::black_box(vec![0_u8; 100]);
        ARMED.store(false, Ordering::Relaxed);
    };
    allocate();
    assert_eq!(ALLOCATIONS.load(Ordering::Relaxed), 0, "not the bus thread's");
    let bus = std::thread::Builder::new().name("bus".to_owned());
    bus.spawn(allocate).unwrap().join().unwrap();
    assert_eq!(ALLOCATIONS.swap(0, Ordering::Relaxed), 1);
}

#[test]
fn once_everything_was_used_the_bus_thread_allocates_nothing() {
    check_that_it_counts();
    let mut site = Site::new();
    site.start_simulator(&["--dpram-startup"]);
    let command = site.daemon_command(&[]);
    let arguments = std::iter::once("pmacd".into()).chain(command.get_args().map(Into::into));
    let arguments: Vec<std::ffi::OsString> = arguments.collect();
    let daemon = std::thread::spawn(move || pmac_dpram::daemon::main_with(arguments));
    let subscriber = || pmac_dpram::segment::Subscriber::attach(&site.segment());
    wait_until("the daemon", || subscriber().is_ok_and(|segment| is_live(&segment, RegionId::Servo)));
    site.wait_for_its_functions();
    // The interrupt is connected, what the first error of each kind says is said.
    use_everything(&site);

    let before = subscriber().unwrap().counter(Counter::Updates);
    ARMED.store(true, Ordering::Relaxed);
    use_everything(&site);
    ARMED.store(false, Ordering::Relaxed);
    let updates = subscriber().unwrap().counter(Counter::Updates) - before;
    assert!(updates > 100, "{updates} servo updates");
    site.assert_no_violations();
    // It is this process that a signal ends; the daemon has its handler.
    kill(nix::unistd::getpid(), Signal::SIGTERM).unwrap();
    assert_eq!(joined(daemon), std::process::ExitCode::SUCCESS);
    assert_eq!(ALLOCATIONS.load(Ordering::Relaxed), 0, "allocations in the bus thread, {updates} updates");
}

/// Each function at work, what is refused and what fails too, and in the end a reset of the board.
fn use_everything(site: &Site) {
    let file = |name: &str| site.path(name).to_str().unwrap().to_owned();
    let (samples, program) = (file("samples.csv"), file("program.pmc"));
    let moves: String = (0..200).map(|line| format!("X{line} Y{}\n", line * 7 % 50)).collect();
    std::fs::write(&program, moves).unwrap();
    let at_once: [&[&str]; 4] = [
        &["variable", "watch", "--count", "5", "X:$0000", "Y:$0770", "1.actual_position"],
        &["gather", "--source", "1.actual_position", "--period", "1", "--seconds", "0.5", "-o", &samples],
        &["panel", "jog+", "3", "--hold", "--seconds", "0.5"],
        &["watch", "--count", "3"],
    ];
    let running = at_once.map(|arguments| (arguments, pmacctl(site, arguments).spawn().unwrap()));
    let (mut connection, end) = (site.connection(), Instant::now() + Duration::from_millis(500));
    let mut tracer = site.connection();
    while Instant::now() < end {
        tracer.trace(false).unwrap();
        assert_eq!(connection.send("I122 #3", PATIENCE).unwrap(), ["32"]);
    }
    for (arguments, mut child) in running {
        let output = output_within(&mut child, PATIENCE);
        // A machine that is too busy to renew the hold in time has it ended, as it should be.
        let ended = output.stderr.starts_with(b"the held jog was not renewed in time");
        assert!(output.status.success() || ended, "{arguments:?}: {output:?}");
    }
    let identity = |i59| {
        let line = format!("I59={i59}");
        assert!(pmacctl(site, &["send", &line]).status().unwrap().success());
        let mut board = pmac_dpram::client::Board::attach(&site.name).unwrap();
        wait_until("the changed identity", || board.identity().unwrap().reported_motors() == Some(i59));
    };
    identity(4);
    identity(8);
    let then: [(&[&str], i32); 15] = [
        (&["panel", "feed", "1", "50%"], 0),
        (&["panel", "feed", "1", "off"], 0),
        (&["variable", "set", "Y:$0770,8,4=5", "D:$0778=1000000"], 0),
        (&["write", "Y:$DA00", "5"], 0),
        (&["write", "Y:$DA00,8,4", "3"], 0),
        (&["read", "X:$D009", "Y:$DA00"], 0),
        (&["send", "XYZZY"], 1),
        (&["send", "^P"], 0),
        (&["status"], 0),
        (&["send", "DELETE GATHER"], 0),
        (&["send", "&1 #1->X #2->Y"], 0),
        (&["rotary", "stream", &program, "--define", "2000"], 0),
        (&["send", "&1 Q DELETE ROT"], 0),
        (&["send", "^K"], 0),
        (&["panel", "jog-stop", "1"], 0),
    ];
    for (arguments, status) in then {
        let output = pmacctl(site, arguments).output().unwrap();
        assert_eq!(output.status.code(), Some(status), "{arguments:?}: {output:?}");
    }
    // The segment loses its name, and gets it again.
    let path = site.attach().path().to_owned();
    std::fs::remove_file(&path).unwrap();
    wait_until("the segment's name", || path.exists());
    // And a text of a program's own, a reset, after which the servo report waits for GATHER, and all questions to the board.
    site.control("send hello");
    site.control("reset");
    wait_until("a board that answers again", || {
        pmacctl(site, &["send", "GATHER"]).status().unwrap().success()
    });
    wait_until("the board's answers and servo data", || {
        let is_idle = || {
            let before = site.attach().counter(Counter::AsciiCommands);
            std::thread::sleep(Duration::from_millis(500));
            before == site.attach().counter(Counter::AsciiCommands)
        };
        is_live(&site.attach(), RegionId::Servo) && is_idle()
    });
}

fn pmacctl(site: &Site, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pmacctl"));
    command.args(["--name", &site.name, "--socket"]).arg(site.socket()).args(arguments);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}
