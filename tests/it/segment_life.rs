//! The segment's life and death: owners that are killed, stopped, started twice or again, and what stands in their way.

use std::os::unix::fs::{PermissionsExt, chown};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use pmac_dpram::segment::{
    Condition, Publisher, RegionId, RegionState, Sample, SegmentError, State, Subscriber, WaitOutcome,
    monotonic_ns,
};

use super::segment::{LONG, assert_unmixed, attach, name, now, options, publish_numbered, regions};

const ROLE: &str = "PMAC_DPRAM_TEST_ROLE";
const DIRECTORY: &str = "PMAC_DPRAM_TEST_DIRECTORY";

#[test]
#[ignore = "no test of its own: a process that the others start"]
fn another_process() {
    let (role, directory) = (std::env::var(ROLE).unwrap(), std::env::var(DIRECTORY).unwrap());
    let options = options(Path::new(&directory), regions());
    if role == "without room" {
        // A write beyond the limit is then an error and does not end the process.
        let seen = std::sync::Arc::new(std::sync::atomic::AtomicBool::new(false));
        signal_hook::flag::register(libc::SIGXFSZ, seen).unwrap();
        let limit = nix::sys::resource::Resource::RLIMIT_FSIZE;
        nix::sys::resource::setrlimit(limit, 100_000, 100_000).unwrap();
    }
    if role.starts_with("without") {
        let error = Publisher::create(&options).err().expect("there is no room for it");
        assert!(matches!(error, SegmentError::Full { .. }), "{error}");
        println!("{error}");
        assert_eq!(std::fs::read_dir(&directory).unwrap().count(), 0, "nothing is left behind");
        return;
    }
    let mut publisher = Publisher::create(&options).unwrap();
    publisher.set_state(State::Live);
    publisher.set_region_state(RegionId::Servo, RegionState::Live);
    let end = Instant::now() + 3 * LONG;
    while Instant::now() < end {
        publisher.beat(monotonic_ns());
        for _ in 0..200 {
            publish_numbered(&mut publisher);
        }
        if role == "steady" {
            thread::sleep(Duration::from_millis(10));
        }
    }
}

/// A process that ends with the test, however that ends.
struct Other(Child);

impl Other {
    fn start(role: &str, directory: &Path) -> Self {
        Self(command(role, directory).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap())
    }

    fn signal(&self, signal: Signal) {
        kill(Pid::from_raw(self.0.id() as i32), signal).unwrap();
    }

    fn kill(mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }
}

impl Drop for Other {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn command(role: &str, directory: &Path) -> Command {
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args(["--exact", "segment_life::another_process", "--ignored", "--nocapture"]);
    command.env(ROLE, role).env(DIRECTORY, directory);
    command
}

fn eventually<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let end = Instant::now() + LONG;
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(Instant::now() < end, "waited in vain for {what}");
        thread::sleep(Duration::from_millis(2));
    }
}

/// A subscriber to whatever live segment newer than `generation` appears.
fn attach_newer(directory: &Path, generation: u64) -> Subscriber {
    eventually("a new segment", || {
        let reader = Subscriber::attach_in(directory, &name()).ok()?;
        (reader.generation() > generation && reader.condition() == Condition::Live).then_some(reader)
    })
}

/// Twenty owners are killed while they publish as fast as they can. Whoever is attached keeps a whole last value and learns of the death; the next
/// owner takes the name over, and the one attached to the old segment learns of that too.
#[test]
fn an_owner_killed_in_mid_publish_leaves_a_readable_segment() {
    let directory = tempfile::tempdir().unwrap();
    let mut sample = Sample::new();
    let mut previous: Option<Subscriber> = None;
    for round in 0..20u64 {
        let owner = Other::start("fast", directory.path());
        let reader = attach_newer(directory.path(), previous.as_ref().map_or(0, Subscriber::generation));
        if let Some(previous) = previous {
            assert_eq!(previous.condition(), Condition::Replaced);
            assert_eq!(previous.header().state, State::Dead, "the successor marked it dead");
            assert_eq!(previous.wait_newer(RegionId::Servo, u64::MAX, LONG).unwrap(), WaitOutcome::Dead);
        }
        let seen = 1000 + 37 * round;
        assert_eq!(reader.wait_newer(RegionId::Servo, seen, LONG).unwrap(), WaitOutcome::Newer);
        owner.kill();
        let last = reader.latest(RegionId::Servo, &mut sample).unwrap().unwrap();
        assert_unmixed(&sample);
        assert!(last > seen);
        assert_eq!(reader.latest(RegionId::Servo, &mut sample).unwrap(), Some(last));
        assert_eq!(reader.condition(), Condition::OwnerGone);
        if round == 0 {
            assert_eq!(reader.wait_newer(RegionId::Servo, last, LONG).unwrap(), WaitOutcome::Dead);
        }
        let mut cursor = reader.cursor(RegionId::Servo, 1).unwrap();
        let mut got = 0;
        while reader.next(&mut cursor, &mut sample).unwrap() {
            assert_unmixed(&sample);
            got += 1;
        }
        assert_eq!(got + cursor.lost(), last);
        previous = Some(reader);
    }
}

#[test]
fn an_owner_that_is_stopped_is_stale_until_it_goes_on() {
    let directory = tempfile::tempdir().unwrap();
    let owner = Other::start("steady", directory.path());
    let reader = attach_newer(directory.path(), 0);
    let mut sample = Sample::new();
    eventually("the first sample", || reader.latest(RegionId::Servo, &mut sample).unwrap());
    owner.signal(Signal::SIGSTOP);
    eventually("staleness", || (reader.condition() == Condition::Stale).then_some(()));
    reader.latest(RegionId::Servo, &mut sample).unwrap().unwrap();
    assert_unmixed(&sample);
    assert!(!reader.is_fresh(RegionId::Servo, &sample.stamp(), monotonic_ns()));
    assert_eq!(
        reader.wait_newer(RegionId::Servo, sample.sequence(), Duration::from_millis(200)).unwrap(),
        WaitOutcome::TimedOut,
        "it is not dead"
    );
    owner.signal(Signal::SIGCONT);
    eventually("life", || (reader.condition() == Condition::Live).then_some(()));
    eventually("fresh data", || {
        reader.latest(RegionId::Servo, &mut sample).unwrap();
        reader.is_fresh(RegionId::Servo, &sample.stamp(), monotonic_ns()).then_some(())
    });
}

#[test]
fn a_second_owner_is_refused_and_disturbs_nothing() {
    let directory = tempfile::tempdir().unwrap();
    let owner = Other::start("steady", directory.path());
    let reader = attach_newer(directory.path(), 0);
    match Publisher::create(&options(directory.path(), regions())) {
        Err(error @ SegmentError::InUse { .. }) => {
            assert!(error.to_string().contains(&format!("process {}", owner.0.id())), "{error}");
        }
        other => panic!("{:?}", other.err()),
    }
    assert_eq!(reader.condition(), Condition::Live);
    // Someone tidies up: the name's lock is gone, but the segment's own still tells.
    std::fs::remove_file(directory.path().join("pmac0.lock")).unwrap();
    match Publisher::create(&options(directory.path(), regions())) {
        Err(SegmentError::InUse { pid, .. }) => assert_eq!(pid, Some(owner.0.id())),
        other => panic!("{:?}", other.err()),
    }
    assert_eq!(reader.condition(), Condition::Live);
}

#[test]
fn a_clean_stop_is_seen_and_the_next_start_is_another_generation() {
    let directory = tempfile::tempdir().unwrap();
    let mut publisher = Publisher::create(&options(directory.path(), regions())).unwrap();
    publish_numbered(&mut publisher);
    let reader = attach(directory.path());
    let mut cursor = reader.cursor(RegionId::Servo, 1).unwrap();
    assert_eq!(reader.condition(), Condition::Init);
    drop(publisher);
    assert_eq!(reader.condition(), Condition::Dead);
    assert!(matches!(Subscriber::attach_in(directory.path(), &name()), Err(SegmentError::NotFound { .. })));
    let publisher = Publisher::create(&options(directory.path(), regions())).unwrap();
    assert_eq!(reader.condition(), Condition::Replaced);
    let again = attach(directory.path());
    assert!(again.generation() > reader.generation());
    assert_eq!(again.generation(), publisher.generation());
    let mut sample = Sample::new();
    assert!(reader.next(&mut cursor, &mut sample).unwrap());
    assert!(matches!(again.next(&mut cursor, &mut sample), Err(SegmentError::OtherGeneration { .. })));
}

#[test]
fn a_segment_left_unfinished_is_cleared_away() {
    let directory = tempfile::tempdir().unwrap();
    let unfinished = directory.path().join(".pmac0.0123456789abcdef.new");
    std::fs::write(&unfinished, b"half a segment").unwrap();
    let leftover = directory.path().join("pmac0");
    std::fs::write(&leftover, b"PMACDPRM, and cut short").unwrap();
    let mut publisher = Publisher::create(&options(directory.path(), regions())).unwrap();
    publisher.publish(RegionId::Panel, now(), &[5]);
    assert!(!unfinished.exists());
    let mut sample = Sample::new();
    attach(directory.path()).latest(RegionId::Panel, &mut sample).unwrap();
    assert_eq!(sample.words(), [5]);
}

#[test]
#[ignore = "needs root, to give files to another user"]
fn as_root_an_object_of_a_foreign_owner_is_left_alone_and_not_believed() {
    for what in ["pmac0", "pmac0.lock"] {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join(what);
        std::fs::write(&path, b"theirs").unwrap();
        chown(&path, Some(12345), None).unwrap();
        let error = Publisher::create(&options(directory.path(), regions())).err().unwrap().to_string();
        assert!(error.contains("user 12345") && error.contains(what), "{error}");
        assert_eq!(std::fs::read(&path).unwrap(), b"theirs");
        assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 1, "{what}");
    }
    let directory = tempfile::tempdir().unwrap();
    let publisher = Publisher::create(&options(directory.path(), regions())).unwrap();
    chown(publisher.path(), Some(12345), None).unwrap();
    let error = Subscriber::attach_in(directory.path(), &name()).err().unwrap().to_string();
    assert!(error.contains("user 12345"), "{error}");
}

#[test]
fn a_squatted_name_does_not_keep_pmacd_away() {
    let directory = tempfile::tempdir().unwrap();
    let squats = [".pmac0.new", ".pmac0.0123456789abcdef.new", ".pmac0.lock"];
    for squat in squats {
        // What nobody can remove but who made it: the sticky bit gives /dev/shm that, a directory with something in it gives it here.
        std::fs::create_dir_all(directory.path().join(squat).join("mine")).unwrap();
    }
    let publisher = Publisher::create(&options(directory.path(), regions())).unwrap();
    attach(directory.path());
    drop(publisher);
    assert_eq!(
        std::fs::read_dir(directory.path()).unwrap().count(),
        squats.len(),
        "nothing of others is touched"
    );
}

#[test]
fn a_hard_link_in_the_place_of_the_lock_is_cleared_away() {
    let directory = tempfile::tempdir().unwrap();
    let precious = directory.path().join("precious");
    std::fs::write(&precious, b"a board").unwrap();
    std::fs::hard_link(&precious, directory.path().join("pmac0.lock")).unwrap();
    let publisher = Publisher::create(&options(directory.path(), regions())).unwrap();
    assert_eq!(attach(directory.path()).generation(), publisher.generation());
    assert_eq!(std::fs::read(&precious).unwrap(), b"a board");
}

#[test]
fn a_segment_that_lives_keeps_its_name_with_another_name_and_without_its_lock() {
    let directory = tempfile::tempdir().unwrap();
    let _publisher = Publisher::create(&options(directory.path(), regions())).unwrap();
    let reader = attach(directory.path());
    std::fs::hard_link(directory.path().join("pmac0"), directory.path().join("x")).unwrap();
    std::fs::remove_file(directory.path().join("pmac0.lock")).unwrap();
    let error = Publisher::create(&options(directory.path(), regions())).err().unwrap();
    assert!(matches!(error, SegmentError::InUse { .. }), "{error}");
    assert_eq!(reader.condition(), Condition::Init);
}

#[test]
fn a_file_that_is_no_segment_is_refused_and_left_alone() {
    let late = [&[0; 0x4000][..], b"a board's own memory"].concat();
    for content in [&b"a board's own memory"[..], &late] {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("pmac0");
        std::fs::write(&path, content).unwrap();
        let error = Publisher::create(&options(directory.path(), regions())).err().unwrap();
        assert!(matches!(error, SegmentError::Occupied { .. }), "{error}");
        assert!(error.to_string().contains("/pmac0 is in the way: it is no segment"), "{error}");
        assert_eq!(std::fs::read(&path).unwrap(), content);
        assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 1);
    }
}

/// As somebody leaves it who truncates a segment.
#[test]
fn a_file_that_holds_nothing_is_replaced() {
    for content in [&b""[..], &[0; 5], &[0; 0x4000]] {
        let directory = tempfile::tempdir().unwrap();
        std::fs::write(directory.path().join("pmac0"), content).unwrap();
        let publisher = Publisher::create(&options(directory.path(), regions())).unwrap();
        assert_eq!(attach(directory.path()).generation(), publisher.generation());
    }
}

#[test]
fn a_lock_that_is_none_is_left_alone() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("pmac0.lock");
    std::fs::write(&path, b"notes").unwrap();
    let error = Publisher::create(&options(directory.path(), regions())).err().unwrap();
    assert!(
        matches!(error, SegmentError::Occupied { .. }) && error.to_string().contains("pmac0.lock"),
        "{error}"
    );
    assert_eq!(std::fs::read(&path).unwrap(), b"notes");
}

#[test]
fn what_others_can_write_to_is_not_believed() {
    let directory = tempfile::tempdir().unwrap();
    let mut closed = options(directory.path(), regions());
    closed.mode = 0o640;
    closed.group = Some(nix::unistd::getegid().as_raw());
    let publisher = Publisher::create(&closed).unwrap();
    let mode = || std::fs::metadata(publisher.path()).unwrap().permissions().mode() & 0o777;
    assert_eq!(mode(), 0o640, "whatever the umask");
    attach(directory.path());
    std::fs::set_permissions(publisher.path(), std::fs::Permissions::from_mode(0o646)).unwrap();
    assert!(matches!(
        Subscriber::attach_in(directory.path(), &name()),
        Err(SegmentError::WritableByOthers { mode: 0o646, .. })
    ));
}

fn assert_no_room(output: &std::process::Output) {
    let printed = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{printed}{}", String::from_utf8_lossy(&output.stderr));
    assert!(printed.contains("there is no room for the 23"), "{printed}");
}

#[test]
fn no_room_for_the_file_is_an_error_that_leaves_nothing_behind() {
    let directory = tempfile::tempdir().unwrap();
    assert_no_room(&command("without room", directory.path()).output().unwrap());
}

#[test]
#[ignore = "needs root, to mount a small file system"]
fn as_root_a_full_file_system_is_an_error_that_leaves_nothing_behind() {
    let directory = tempfile::tempdir().unwrap();
    let inner = command("without memory", directory.path());
    let output = Command::new("unshare")
        .args(["--mount", "sh", "-c", "mount -t tmpfs -o size=64k none \"$0\" && exec \"$@\""])
        .arg(directory.path())
        .arg(inner.get_program())
        .args(inner.get_args())
        .env(ROLE, "without memory")
        .env(DIRECTORY, directory.path())
        .output()
        .unwrap();
    assert_no_room(&output);
}
