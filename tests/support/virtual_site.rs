//! A simulated board and its daemon in the test's process, in virtual time. Real clients use their real segment and
//! socket.
//!
//! One thread owns board, daemon and time. While a call waits for the board, or the test waits in
//! [`VirtualSite::wait_until`] or [`VirtualSite::run_for`], time passes as fast as the machine can compute it;
//! otherwise at most as fast as real time. On a slow machine time passes slowly for board and daemon alike, so neither
//! can be late. Nor can a client: time waits for a jog's holder that has to renew it, and for a client that traces the bus to
//! take the accesses.

use std::cell::RefCell;
use std::fmt::Write as _;
use std::ops::Deref;
use std::process::Stdio;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel, sync_channel};
use std::sync::{Arc, Mutex, Once};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use pmac_dpram::segment::{RegionId, Subscriber};

use super::rig::Ran;
use super::world::World;
use super::{PATIENCE, Place, is_live};

/// Time between two polls while virtual time stands still.
const PAUSE: Duration = Duration::from_micros(300);

/// An action to run between two steps.
type Request = Box<dyn FnOnce(&mut World) + Send>;

/// The state shared by the test and the world's thread.
#[derive(Default)]
struct Pace {
    /// How many callers wait for time to pass.
    hurried: AtomicUsize,
    /// Whether time stands still.
    held: AtomicBool,
    /// The daemon's log.
    log: Mutex<String>,
}

/// A board and a daemon in virtual time.
pub struct VirtualSite {
    place: Place,
    pace: Arc<Pace>,
    requests: Option<Sender<Request>>,
    thread: Option<JoinHandle<()>>,
}

impl Deref for VirtualSite {
    type Target = Place;

    fn deref(&self) -> &Place {
        &self.place
    }
}

impl VirtualSite {
    /// A world without board and daemon.
    pub fn new() -> Self {
        let pace = Arc::new(Pace::default());
        let (requests, taken) = channel();
        let theirs = Arc::clone(&pace);
        let thread = std::thread::Builder::new().name("world".to_owned());
        let thread = thread.spawn(move || run(&theirs, &taken)).unwrap();
        Self { place: Place::new(), pace, requests: Some(requests), thread: Some(thread) }
    }

    /// A board with all DPRAM functions enabled and a daemon on it.
    pub fn running(simulator: &[&str], daemon: &[&str]) -> Self {
        let site = Self::new();
        site.start_simulator(&[&["--dpram-startup"], simulator].concat());
        site.start_daemon(daemon);
        site
    }

    /// As [`VirtualSite::running`], with this configuration of the daemon.
    pub fn configured(simulator: &[&str], config: &str) -> Self {
        let site = Self::new();
        let config = site.file("pmacd.toml", config);
        site.start_simulator(&[&["--dpram-startup"], simulator].concat());
        site.start_daemon(&["--config", &config]);
        site
    }

    /// Runs `action` between two steps.
    pub fn with_world<R: Send + 'static>(&self, action: impl FnOnce(&mut World) -> R + Send + 'static) -> R {
        let (done, result) = sync_channel(1);
        let request = move |world: &mut World| drop(done.send(action(world)));
        let sent = self.requests.as_ref().unwrap().send(Box::new(request));
        sent.ok().and_then(|()| result.recv().ok()).expect("the world has not come to an end")
    }

    /// Starts the simulator, with the sockets and the memory of this place.
    pub fn start_simulator(&self, options: &[&str]) {
        let socket = |name: &str| format!("unix:{}", self.path(name).display());
        let mut all = vec!["--memory".to_owned(), self.path("dpram").display().to_string()];
        for name in ["interrupt", "serial", "control"] {
            all.extend([format!("--{name}"), socket(name)]);
        }
        all.extend(options.iter().map(|&option| option.to_owned()));
        self.with_world(move |world| world.start_simulator(&all));
    }

    /// Starts a daemon on the board.
    pub fn start_daemon(&self, options: &[&str]) {
        let board =
            format!("file:{},irq=unix:{}", self.path("dpram").display(), self.path("interrupt").display());
        self.start_daemon_on(&board, options);
    }

    /// The refusal of a daemon with the configuration file `config` to start on the board.
    pub fn refusal(&self, config: &str) -> String {
        let board = format!("file:{}", self.path("dpram").display());
        let mut all = vec!["--board".to_owned(), board, "--name".to_owned(), self.name.clone()];
        all.extend(["--socket".to_owned(), self.socket().display().to_string()]);
        all.extend(["--config".to_owned(), config.to_owned()]);
        self.with_world(move |world| world.start_daemon(&all)).unwrap_err()
    }

    /// Starts a daemon on the board that `board` names.
    pub fn start_daemon_on(&self, board: &str, options: &[&str]) {
        let mut all = vec!["--board".to_owned(), board.to_owned(), "--name".to_owned(), self.name.clone()];
        all.extend(["--socket".to_owned(), self.socket().display().to_string()]);
        all.extend(options.iter().map(|&option| option.to_owned()));
        self.pace.log.lock().unwrap().clear();
        let deadline = Instant::now() + PATIENCE;
        loop {
            let again = all.clone();
            match self.with_world(move |world| world.start_daemon(&again)) {
                // A process that another test starts has the lock of the daemon before until it runs its own program.
                Err(reason) if reason.contains("another running pmacd") && Instant::now() < deadline => {
                    std::thread::sleep(PAUSE);
                }
                result => return result.unwrap(),
            }
        }
    }

    /// The log of the daemon since its start.
    pub fn log(&self) -> String {
        self.pace.log.lock().unwrap().clone()
    }

    /// Stops the daemon gracefully. The motors that may still move, as it says; bit 0 is motor 1.
    pub fn stop_daemon(&self) -> u32 {
        self.with_world(World::stop_daemon)
    }

    /// Turns off the board's power.
    pub fn kill_simulator(&self) {
        self.with_world(|world| world.simulator = None);
    }

    /// Stops the board's execution, or lets it continue.
    pub fn board_stands_still(&self, still: bool) {
        self.with_world(move |world| world.board_stands_still = still);
    }

    /// Stops the daemon's execution, or lets it continue.
    pub fn daemon_stands_still(&self, still: bool) {
        self.with_world(move |world| world.daemon_stands_still = still);
    }

    /// Looks into the simulated board.
    pub fn with_board<R: Send + 'static>(
        &self,
        action: impl FnOnce(&mut pmac_dpram::sim::world::World) -> R + Send + 'static,
    ) -> R {
        self.with_world(|world| action(world.simulator.as_mut().unwrap().board()))
    }

    /// Has the simulator execute a line of its control socket.
    #[track_caller]
    pub fn control(&self, line: &str) -> String {
        let text = line.to_owned();
        let answer = self.with_world(move |world| world.simulator.as_mut().unwrap().control_line(&text));
        assert!(!answer.starts_with("error"), "{line}: {answer}");
        answer
    }

    /// The simulator's own counters.
    pub fn status(&self) -> serde_json::Value {
        serde_json::from_str(&self.control("status")).unwrap()
    }

    /// Checks that the simulator saw the host break no handshake.
    #[track_caller]
    pub fn assert_no_violations(&self) {
        assert_eq!(self.status()["violations"], serde_json::json!([]));
    }

    /// Lets `time` pass.
    pub fn run_for(&self, time: Duration) {
        self.with_world(move |world| world.run_for(time));
    }

    /// Runs this many servo cycles.
    pub fn step(&self, cycles: u64) {
        self.with_world(move |world| (0..cycles).for_each(|_| world.step()));
    }

    /// Stops time until [`VirtualSite::go_on`]; only [`VirtualSite::run_for`] and [`VirtualSite::step`] still move it.
    /// The daemon answers what it can answer without the board.
    pub fn hold(&self) {
        self.pace.held.store(true, Ordering::SeqCst);
        // Returns when the step in progress is done.
        self.with_world(|_| ());
    }

    /// Lets time pass again.
    pub fn go_on(&self) {
        self.pace.held.store(false, Ordering::SeqCst);
    }

    /// Lets time pass until `condition` is true, slowly enough for another process to fetch every bus access.
    pub fn slowly_until(&self, mut condition: impl FnMut() -> bool) {
        let begun = Instant::now();
        self.hold();
        while !condition() {
            assert!(begun.elapsed() < PATIENCE, "waited in vain");
            self.step(1);
            std::thread::sleep(Duration::from_millis(3));
        }
        self.go_on();
    }

    /// Runs `pmacctl` with time passing like that.
    pub fn run_slowly(&self, arguments: &[&str]) -> Ran {
        let mut command = self.command(arguments);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        self.slowly_until(|| child.try_wait().unwrap().is_some());
        child.wait_with_output().unwrap().into()
    }

    /// Lets time pass as fast as possible while `action` runs.
    pub fn hurried<R>(&self, action: impl FnOnce() -> R) -> R {
        struct Hurry<'a>(&'a Pace);
        impl Drop for Hurry<'_> {
            fn drop(&mut self) {
                self.0.hurried.fetch_sub(1, Ordering::Relaxed);
            }
        }
        self.pace.hurried.fetch_add(1, Ordering::Relaxed);
        let _hurry = Hurry(&self.pace);
        action()
    }

    /// Lets time pass until `condition` is true.
    #[track_caller]
    pub fn wait_until(&self, what: &str, mut condition: impl FnMut() -> bool) {
        let deadline = Instant::now() + PATIENCE;
        self.hurried(|| {
            while !condition() {
                assert!(Instant::now() < deadline, "waited in vain for {what}");
                std::thread::sleep(PAUSE);
            }
        });
    }

    #[track_caller]
    pub fn wait_for_live_servo(&self) {
        let name = self.segment();
        self.wait_until("live servo data", || {
            Subscriber::attach(&name).is_ok_and(|subscriber| is_live(&subscriber, RegionId::Servo))
        });
    }

    /// Waits until the board takes commands, and has made motors 1 and 2 the axes X and Y of coordinate system 1.
    #[track_caller]
    pub fn wait_for_axes(&self) {
        self.wait_for_live_servo();
        self.wait_until("a board that takes commands", || self.pmacctl(&["send", "&1 #1->X #2->Y"]).0 == 0);
    }

    /// The word of the DPRAM at `offset`, as `pmacctl read` tells it.
    #[track_caller]
    pub fn word(&self, offset: &str) -> u64 {
        let (status, stdout, stderr) = self.pmacctl(&["read", offset, "--json"]);
        assert_eq!(status, 0, "{stderr}");
        let document: serde_json::Value = serde_json::from_str(&stdout).unwrap();
        document[0]["words"][0].as_u64().unwrap()
    }

    /// Waits until the daemon has identified the board.
    #[track_caller]
    pub fn wait_for_identity(&self) {
        self.wait_until("the board to be identified", || {
            ["PMAC", "TURBO"].iter().any(|kind| self.log().contains(&format!("the board is {kind}")))
        });
    }
}

impl Drop for VirtualSite {
    fn drop(&mut self) {
        drop(self.requests.take());
        let ended = self.thread.take().map(JoinHandle::join);
        if std::thread::panicking() {
            eprintln!("what the daemon had logged:\n{}", self.log());
        } else if let Some(Err(panic)) = ended {
            std::panic::resume_unwind(panic);
        }
    }
}

/// Lets time pass until no caller is left.
fn run(pace: &Arc<Pace>, requests: &Receiver<Request>) {
    keep_log_of_this_thread(pace);
    let mut world = World::new();
    // No step before then, unless a caller waits for one.
    let mut due = Instant::now();
    // Since when time has waited for the holder of a jog.
    let mut waits_for_holder = None;
    loop {
        let hurried = pace.hurried.load(Ordering::Relaxed) > 0 || world.is_waited_for();
        let held = pace.held.load(Ordering::SeqCst) || world.waits_for_trace_reader();
        let holder_is_due =
            world.is_lease_over() && waits_for_holder.get_or_insert_with(Instant::now).elapsed() < PATIENCE;
        if !world.is_lease_over() {
            waits_for_holder = None;
        }
        let now = Instant::now();
        let passes = !held && !holder_is_due && (hurried || now >= due);
        if passes {
            // Drop a delay of more than 5 ms instead of catching up. Steps in a hurry are no debt: after them time goes on at once.
            let earliest = now.checked_sub(Duration::from_millis(5)).unwrap_or(now);
            due = if hurried { now } else { due.max(earliest) } + world.period();
            world.step();
        } else {
            world.poll();
        }
        let request = if passes {
            requests.try_recv().map_err(|error| match error {
                std::sync::mpsc::TryRecvError::Empty => RecvTimeoutError::Timeout,
                std::sync::mpsc::TryRecvError::Disconnected => RecvTimeoutError::Disconnected,
            })
        } else {
            requests.recv_timeout(PAUSE)
        };
        match request {
            Ok(request) => request(&mut world),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
    }
}

thread_local! {
    /// The log of this thread.
    static LOG: RefCell<Option<Arc<Pace>>> = const { RefCell::new(None) };
}

/// A log for each thread: the daemons of several tests log in one process.
struct ThreadLog;

impl log::Log for ThreadLog {
    fn enabled(&self, metadata: &log::Metadata) -> bool {
        metadata.level() <= log::Level::Info
    }

    fn log(&self, record: &log::Record) {
        LOG.with_borrow(|pace| {
            if let Some(pace) = pace {
                let mut log = pace.log.lock().unwrap();
                let _ = writeln!(log, "[{:<5}] {}", record.level(), record.args());
            }
        });
    }

    fn flush(&self) {}
}

fn keep_log_of_this_thread(pace: &Arc<Pace>) {
    static INIT: Once = Once::new();
    INIT.call_once(|| {
        if log::set_logger(&ThreadLog).is_ok() {
            log::set_max_level(log::LevelFilter::Info);
        }
    });
    LOG.set(Some(Arc::clone(pace)));
}
