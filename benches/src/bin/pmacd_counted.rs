//! `pmacd` with an allocator that counts, thread by thread. While it runs, the file that the environment variable `PMAC_COUNTS`
//! names holds a line for every thread: its name, how often it asked for memory, and how often it gave some back.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::Duration;

/// More threads than the daemon ever has.
const THREADS: usize = 64;
const NONE: usize = usize::MAX;

static ASKED: [AtomicU64; THREADS] = [const { AtomicU64::new(0) }; THREADS];
static GIVEN_BACK: [AtomicU64; THREADS] = [const { AtomicU64::new(0) }; THREADS];
static IDS: [AtomicU64; THREADS] = [const { AtomicU64::new(0) }; THREADS];
static NEXT: AtomicUsize = AtomicUsize::new(0);

thread_local! {
    /// Needs no memory of its own and no destructor, so that the allocator may use it at any time.
    static PLACE: Cell<usize> = const { Cell::new(NONE) };
}

struct Counting;

fn count(counts: &[AtomicU64; THREADS]) {
    let place = PLACE.get();
    let place = if place == NONE {
        let place = NEXT.fetch_add(1, Ordering::Relaxed).min(THREADS - 1);
        // SAFETY: asks for a number and touches no memory.
        let id = unsafe { libc::syscall(libc::SYS_gettid) };
        IDS[place].store(id.cast_unsigned(), Ordering::Relaxed);
        PLACE.set(place);
        place
    } else {
        place
    };
    counts[place].fetch_add(1, Ordering::Relaxed);
}

// SAFETY: everything is the system's allocator's; counting allocates nothing.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(&ASKED);
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(&ASKED);
        // SAFETY: the caller's promises are passed on.
        unsafe { System.realloc(block, layout, size) }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        count(&GIVEN_BACK);
        // SAFETY: the caller's promises are passed on.
        unsafe { System.dealloc(block, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn main() -> ExitCode {
    if let Some(path) = std::env::var_os("PMAC_COUNTS") {
        std::thread::spawn(move || {
            loop {
                std::thread::sleep(Duration::from_millis(50));
                let _ = std::fs::write(&path, report());
            }
        });
    }
    pmac_dpram::daemon::main()
}

fn report() -> String {
    let mut text = String::new();
    for ((id, asked), given_back) in IDS.iter().zip(&ASKED).zip(&GIVEN_BACK) {
        let [id, asked, given_back] = [id, asked, given_back].map(|count| count.load(Ordering::Relaxed));
        if let Ok(name) = std::fs::read_to_string(format!("/proc/self/task/{id}/comm")) {
            text += &format!("{} {asked} {given_back}\n", name.trim());
        }
    }
    text
}
