//! Processes that measure together: forked, each on a processor of its own, with a few shared words between them.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr::null_mut;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use nix::sched::{CpuSet, sched_setaffinity};
use nix::sys::signal::{Signal, kill};
use nix::sys::wait::{WaitPidFlag, WaitStatus, waitpid};
use nix::unistd::{ForkResult, Pid, fork};

/// Words between cells that different processes write: two cache lines, so that no prefetcher couples them.
const CELL: usize = 16;
/// Nothing here takes longer than this; a partner that is silent for so long has died.
const PATIENCE: Duration = Duration::from_secs(60);

/// Zeroed memory that a forked process shares with its parent.
pub struct Shared {
    start: *mut AtomicU64,
    words: usize,
}

// SAFETY: all that is reached through a shared reference are atomics; who uses `address` keeps accesses apart himself, as with
// any raw pointer.
unsafe impl Sync for Shared {}

impl Shared {
    /// `cells` words on cache lines of their own.
    pub fn cells(cells: usize) -> Self {
        Self::words(cells * CELL)
    }

    /// `words` words side by side.
    pub fn words(words: usize) -> Self {
        let (protection, flags) =
            (libc::PROT_READ | libc::PROT_WRITE, libc::MAP_SHARED | libc::MAP_ANONYMOUS | libc::MAP_POPULATE);
        // SAFETY: a new mapping at a place the kernel chooses.
        let start = unsafe { libc::mmap(null_mut(), words * 8, protection, flags, -1, 0) };
        assert!(start != libc::MAP_FAILED, "no memory for {words} shared words");
        Self { start: start.cast(), words }
    }

    pub fn word(&self, index: usize) -> &AtomicU64 {
        assert!(index < self.words);
        // SAFETY: inside the mapping, which lives as long as `self`, aligned, and used as atomics only but for `address`.
        unsafe { &*self.start.add(index) }
    }

    pub fn cell(&self, index: usize) -> &AtomicU64 {
        self.word(index * CELL)
    }

    /// The memory itself, for plain copies that the measurement keeps apart in time.
    pub fn address(&self) -> *mut u8 {
        self.start.cast()
    }

    pub fn set(&self, cell: usize, value: u64) {
        self.cell(cell).store(value, Ordering::Release);
    }

    pub fn value(&self, cell: usize) -> u64 {
        self.cell(cell).load(Ordering::Acquire)
    }

    /// Yields until the cell is at least `value`.
    pub fn wait(&self, cell: usize, value: u64) {
        let start = Instant::now();
        while self.value(cell) < value {
            assert!(start.elapsed() < PATIENCE, "the other process does not answer");
            std::thread::yield_now();
        }
    }

    /// Spins until the cell is at least `value`.
    #[inline(always)]
    pub fn spin(&self, cell: usize, value: u64) {
        let cell = self.cell(cell);
        let mut rounds = 0_u64;
        while cell.load(Ordering::Acquire) < value {
            rounds += 1;
            assert!(rounds < 1 << 34, "the other process does not answer");
        }
    }
}

impl Drop for Shared {
    fn drop(&mut self) {
        // SAFETY: the mapping of `words`; nothing borrowed from it outlives `self`.
        unsafe { libc::munmap(self.start.cast(), self.words * 8) };
    }
}

/// Binds the calling process to one processor.
pub fn bind(processor: usize) {
    let mut set = CpuSet::new();
    let bound = set.set(processor).and_then(|()| sched_setaffinity(Pid::from_raw(0), &set));
    assert!(bound.is_ok(), "cannot run on processor {processor}: two are needed");
}

/// Lets the calling process run anywhere again.
pub fn unbind() {
    let mut set = CpuSet::new();
    for processor in 0..CpuSet::count() {
        let _ = set.set(processor);
    }
    let _ = sched_setaffinity(Pid::from_raw(0), &set);
}

/// A forked process. Killed when it is dropped without having been waited for.
pub struct Child(Option<Pid>);

impl Child {
    /// Runs `work` in a process of its own, which ends with its parent.
    pub fn run(work: impl FnOnce()) -> Self {
        // SAFETY: this program runs one thread only wherever it forks, so that the child may do all that the parent may.
        match unsafe { fork() }.expect("fork") {
            ForkResult::Parent { child } => Self(Some(child)),
            ForkResult::Child => {
                let _ = nix::sys::prctl::set_pdeathsig(Signal::SIGKILL);
                let done = catch_unwind(AssertUnwindSafe(work));
                // SAFETY: ends the process without running what belongs to the parent.
                unsafe { libc::_exit(i32::from(done.is_err())) }
            }
        }
    }

    /// As [`Child::run`], on one processor.
    pub fn on(processor: usize, work: impl FnOnce()) -> Self {
        Self::run(|| {
            bind(processor);
            work();
        })
    }

    pub fn join(mut self) {
        let Some(pid) = self.0.take() else { return };
        let status = waitpid(pid, None).expect("waitpid");
        assert!(matches!(status, WaitStatus::Exited(_, 0)), "a measuring process failed: {status:?}");
    }

    /// Whether the process has ended; waits for nothing.
    pub fn is_over(&mut self) -> bool {
        let Some(pid) = self.0 else { return true };
        let status = waitpid(pid, Some(WaitPidFlag::WNOHANG)).expect("waitpid");
        if status == WaitStatus::StillAlive {
            return false;
        }
        self.0 = None;
        assert!(matches!(status, WaitStatus::Exited(_, 0)), "a measuring process failed: {status:?}");
        true
    }

    pub fn signal(&self, signal: Signal) {
        if let Some(pid) = self.0 {
            kill(pid, signal).expect("kill");
        }
    }
}

impl Drop for Child {
    fn drop(&mut self) {
        if let Some(pid) = self.0.take() {
            let _ = kill(pid, Signal::SIGKILL);
            let _ = waitpid(pid, None);
        }
    }
}

/// A process that keeps `processor` from halting without taking time from anybody: on a virtual machine, waking a halted one is
/// the hypervisor's business and would hide ours.
pub fn keep_awake(processor: usize) -> Child {
    Child::on(processor, || {
        // SAFETY: a plain old structure, for which all zeros is a value.
        let parameter: libc::sched_param = unsafe { std::mem::zeroed() };
        // SAFETY: `parameter` outlives the call.
        unsafe { libc::sched_setscheduler(0, libc::SCHED_IDLE, &raw const parameter) };
        loop {
            std::hint::spin_loop();
        }
    })
}

/// More urgent than others, if that is allowed.
pub fn hurry() -> bool {
    // SAFETY: changes this process's own priority only.
    unsafe { libc::setpriority(libc::PRIO_PROCESS, 0, -10) == 0 }
}

/// Processor seconds that were used by others than this process and its children, and stolen by the hypervisor, since the machine started.
pub fn others() -> (f64, f64) {
    let text = std::fs::read_to_string("/proc/stat").unwrap_or_default();
    let first = text.lines().next().unwrap_or_default();
    let fields: Vec<f64> =
        first.split_whitespace().skip(1).map(|field| field.parse().unwrap_or(0.0) / 100.0).collect();
    let at = |index: usize| fields.get(index).copied().unwrap_or(0.0);
    let busy = at(0) + at(1) + at(2) + at(5) + at(6);
    let own = [nix::sys::resource::UsageWho::RUSAGE_SELF, nix::sys::resource::UsageWho::RUSAGE_CHILDREN]
        .into_iter()
        .filter_map(|who| nix::sys::resource::getrusage(who).ok())
        .map(|usage| {
            let [user, system] = [usage.user_time(), usage.system_time()]
                .map(|time| time.tv_sec() as f64 + time.tv_usec() as f64 / 1e6);
            user + system
        })
        .sum::<f64>();
    (busy - own, at(7))
}

/// Waits at most `patience` for a moment in which others leave the processors alone.
pub fn quiet(patience: Duration) {
    let start = Instant::now();
    while start.elapsed() < patience {
        let (before, _) = others();
        std::thread::sleep(Duration::from_millis(200));
        if others().0 - before < 0.02 {
            return;
        }
    }
}
