//! The names of segment, lock and socket, and what others do to them while the daemon runs.

use std::fs;
use std::io::{BufRead, BufReader};
use std::os::unix::fs::{MetadataExt, chown};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use pmac_dpram::client::Board;
use pmac_dpram::segment::{
    Condition, Keeper, Publisher, RegionId, RegionState, Sample, SegmentError, State, Subscriber,
    WaitOutcome, monotonic_ns,
};

use super::segment::{LONG, assert_unmixed, attach, options, publish_numbered, regions};
use crate::support::rig::Rig;
use crate::support::{Ended, PATIENCE, Site, output_within, wait_until};

/// What a program, or a user, does to a file.
type Deed = (&'static str, fn(&Path));

const DEEDS: [Deed; 5] = [
    ("removed", |path| fs::remove_file(path).unwrap()),
    ("renamed", |path| fs::rename(path, path.with_extension("away")).unwrap()),
    ("replaced by a copy", |path| {
        let copy = path.with_extension("copy");
        fs::copy(path, &copy).unwrap();
        fs::rename(copy, path).unwrap();
    }),
    ("replaced by an empty file", |path| {
        fs::remove_file(path).unwrap();
        fs::write(path, b"").unwrap();
    }),
    ("removed with its directory's other files", |path| {
        for entry in fs::read_dir(path.parent().unwrap()).unwrap() {
            fs::remove_file(entry.unwrap().path()).unwrap();
        }
    }),
];

fn inode(path: &Path) -> Option<u64> {
    path.symlink_metadata().ok().map(|there| there.ino())
}

/// A publisher in a thread of its own, that publishes and beats while `work` runs.
fn while_publishing(directory: &Path, work: impl FnOnce(&mut Keeper)) {
    let mut publisher = Publisher::create(&options(directory, regions())).unwrap();
    publisher.set_state(State::Live);
    publisher.set_region_state(RegionId::Servo, RegionState::Live);
    let mut keeper = publisher.keeper().unwrap();
    let over = AtomicBool::new(false);
    thread::scope(|scope| {
        let _ended = Ended(&over);
        let over = &over;
        scope.spawn(move || {
            while !over.load(Ordering::Relaxed) {
                publisher.move_if_asked();
                publisher.beat(monotonic_ns());
                publish_numbered(&mut publisher);
                thread::sleep(Duration::from_micros(100));
            }
        });
        work(&mut keeper);
    });
}

#[test]
fn a_segment_that_lost_its_name_goes_on_under_it_and_its_readers_lose_no_sample() {
    for (deed, act) in DEEDS {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("pmac0");
        while_publishing(directory.path(), |keeper| {
            let first = attach(directory.path());
            assert_eq!(first.wait_newer(RegionId::Servo, 5000, LONG).unwrap(), WaitOutcome::Newer);
            let mut cursor = first.cursor(RegionId::Servo, 5000).unwrap();
            act(&path);
            keeper.tend().unwrap();
            wait_until("the end of the old one", || first.header().state == State::Dead);
            let second = attach(directory.path());
            assert_eq!(
                (second.generation(), second.condition()),
                (first.generation(), Condition::Live),
                "{deed}"
            );
            let mut sample = Sample::new();
            // What the first one had has been carried over, and the numbers go on.
            let until = second.published(RegionId::Servo).unwrap() + 100;
            let mut next = 5000;
            while next < until {
                if second.next(&mut cursor, &mut sample).unwrap() {
                    assert_eq!(sample.sequence(), next, "{deed}");
                    assert_unmixed(&sample);
                    next += 1;
                }
            }
            assert_eq!(cursor.lost(), 0, "{deed}");
            assert!(directory.path().join("pmac0.lock").exists(), "{deed}");
            let second = inode(&path);
            keeper.tend().unwrap();
            assert_eq!(inode(&path), second, "{deed}: what is in its place stays");
        });
        let left: Vec<PathBuf> =
            fs::read_dir(directory.path()).unwrap().map(|entry| entry.unwrap().path()).collect();
        assert!(
            left.iter().all(|path| path.extension().is_some_and(|end| end == "away")),
            "{deed}: {left:?}"
        );
    }
}

#[test]
fn a_lock_that_lost_its_name_is_taken_again_and_keeps_others_away() {
    let directory = tempfile::tempdir().unwrap();
    let lock = directory.path().join("pmac0.lock");
    while_publishing(directory.path(), |keeper| {
        for (_, act) in &DEEDS[..4] {
            act(&lock);
            keeper.tend().unwrap();
            let error = Publisher::create(&options(directory.path(), regions())).err().unwrap();
            assert!(error.to_string().contains("pmac0.lock is in use by process"), "{error}");
        }
    });
    assert!(!lock.exists());
}

#[test]
fn a_segment_whose_thread_makes_no_rounds_stays_what_it_is() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("pmac0");
    let mut publisher = Publisher::create(&options(directory.path(), regions())).unwrap();
    let reader = attach(directory.path());
    let mut keeper = publisher.keeper().unwrap();
    fs::remove_file(&path).unwrap();
    assert!(matches!(keeper.tend(), Err(SegmentError::NotMoved { .. })));
    publisher.move_if_asked();
    publish_numbered(&mut publisher);
    assert_eq!(reader.published(RegionId::Servo).unwrap(), 1);
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1, "only the lock");
}

const IN_THE_WAY: [Deed; 3] = [
    ("a directory", |path| fs::create_dir(path).unwrap()),
    ("a link", |path| std::os::unix::fs::symlink("/nonexistent/segment", path).unwrap()),
    ("somebody's text", |path| fs::write(path, b"precious").unwrap()),
];

fn remove(path: &Path) {
    fs::remove_file(path).or_else(|_| fs::remove_dir(path)).unwrap();
}

fn is_left((deed, act): Deed) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("pmac0");
    while_publishing(directory.path(), |keeper| {
        let mut board = Board::attach_in(directory.path(), "pmac0").unwrap();
        fs::remove_file(&path).unwrap();
        act(&path);
        let there = inode(&path);
        for _ in 0..2 {
            let error = keeper.tend().unwrap_err().to_string();
            assert!(error.contains("pmac0"), "{deed}: {error}");
            assert_eq!(inode(&path), there, "{deed}");
        }
        let last = board.servo_sequence().unwrap();
        assert!(board.wait(last, LONG).unwrap(), "{deed}");
        assert_eq!(board.refresh().unwrap(), Condition::Live, "{deed}");
        remove(&path);
        keeper.tend().unwrap();
        assert_eq!(attach(directory.path()).condition(), Condition::Live, "{deed}");
        assert_eq!(board.refresh().unwrap(), Condition::Live, "{deed}");
        assert_eq!(board.subscriber().header().state, State::Live, "{deed}");
    });
}

#[test]
fn what_is_in_the_way_of_a_segment_is_left_and_its_clients_read_on() {
    IN_THE_WAY.into_iter().for_each(is_left);
}

#[test]
#[ignore = "needs root, to give files to another user"]
fn as_root_another_users_file_in_the_way_of_a_segment_is_left_and_its_clients_read_on() {
    is_left(("another user's file", |path| {
        fs::write(path, b"").unwrap();
        chown(path, Some(4242), None).unwrap();
    }));
}

#[test]
fn a_link_to_another_segment_that_lives_gives_way_and_that_segment_goes_on() {
    let directory = tempfile::tempdir().unwrap();
    let mut other = options(directory.path(), regions());
    other.name = "pmac1".parse().unwrap();
    let other = Publisher::create(&other).unwrap();
    let path = directory.path().join("pmac0");
    while_publishing(directory.path(), |keeper| {
        fs::remove_file(&path).unwrap();
        fs::hard_link(other.path(), &path).unwrap();
        keeper.tend().unwrap();
        assert_eq!(attach(directory.path()).condition(), Condition::Live);
        let other = Subscriber::attach_in(directory.path(), &"pmac1".parse().unwrap()).unwrap();
        assert_eq!(other.condition(), Condition::Init);
    });
}

/// A copy has the same generation, and tells of a life that is over.
#[test]
fn a_copy_takes_no_client_away_from_a_segment_that_lives() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("pmac0");
    while_publishing(directory.path(), |_| {
        let mut board = Board::attach_in(directory.path(), "pmac0").unwrap();
        let (_, copy) = DEEDS[2];
        copy(&path);
        let last = board.servo_sequence().unwrap();
        assert!(board.wait(last + 10, LONG).unwrap());
        assert_eq!(board.refresh().unwrap(), Condition::Live);
    });
}

#[test]
fn a_client_outlives_a_malformed_file_where_the_segment_was() {
    let rig = Rig::new();
    let (name, path) = (rig.name.clone(), rig.publisher.path().to_owned());
    let mut board = Board::attach(&name).unwrap();
    drop(rig);
    for content in [&b""[..], b"no segment"] {
        fs::write(&path, content).unwrap();
        assert_eq!(board.refresh().unwrap(), Condition::Dead);
        assert!(board.snapshot().unwrap().stale.is_some());
    }
    fs::remove_file(&path).unwrap();
    let rig = Rig::named(&name);
    assert_eq!(board.refresh().unwrap(), Condition::Init);
    assert_eq!(board.subscriber().generation(), rig.publisher.generation());
}

fn count(log: &str, text: &str) -> usize {
    log.matches(text).count()
}

/// Starts `pmacctl log` and waits for its first rows.
fn begin_log(site: &Site) -> Child {
    let path = site.path("log.csv");
    let arguments = ["log", "-o", path.to_str().unwrap(), "--motors", "1"];
    let child = site.command(&arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    wait_until("the log's first rows", || fs::metadata(&path).is_ok_and(|there| there.len() > 0));
    child
}

/// Ends a log by ^C; what it said.
fn end_log(mut log: Child) -> String {
    kill(Pid::from_raw(log.id().cast_signed()), Signal::SIGINT).unwrap();
    let ended = output_within(&mut log, PATIENCE);
    let said = String::from_utf8([ended.stdout, ended.stderr].concat()).unwrap();
    assert_eq!(ended.status.code(), Some(0), "{said}");
    said
}

#[test]
fn a_daemon_makes_the_names_again_that_other_programs_remove() {
    let site = Site::running(&[], &[]);
    site.wait_for_live_servo();
    wait_until("the board's scales", || site.has_scales());
    let segment = Path::new("/dev/shm").join(&site.name);
    let mut board = Board::attach(&site.name).unwrap();
    let log = begin_log(&site);
    fs::remove_file(&segment).unwrap();
    wait_until("the segment", || segment.exists());
    assert_eq!(site.run(&["motors"]).code, Some(0));
    wait_until("fresh data through the client that was attached before", || {
        board.snapshot().is_ok_and(|snapshot| snapshot.servo.is_some_and(|servo| servo.is_fresh()))
    });
    assert_eq!(board.subscriber().header().state, State::Live);

    fs::remove_file(site.socket()).unwrap();
    wait_until("the socket", || site.socket().exists());
    assert_eq!(site.run(&["abort", "1"]).code, Some(0));
    fs::rename(site.socket(), site.path("elsewhere")).unwrap();
    fs::create_dir(site.socket()).unwrap();
    wait_until("its trouble in the log", || site.log().contains("exists and is not a socket"));
    fs::remove_dir(site.socket()).unwrap();
    wait_until("the socket", || site.socket().exists());
    assert_eq!(site.run(&["abort", "1"]).code, Some(0));

    let said = end_log(log);
    assert!(said.contains(" lost=0 "), "{said}");
    let log = site.log();
    let segment = format!("{} was removed, renamed or replaced", segment.display());
    let socket = format!("{} was removed, renamed or replaced", site.socket().display());
    assert_eq!((count(&log, &segment), count(&log, &socket)), (1, 2), "{log}");
}

fn start(site: &Site, arguments: &[&str]) -> Child {
    site.command(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

#[test]
fn a_gather_and_a_capture_go_on_in_a_segment_that_is_published_again() {
    let site = Site::running(&[], &[]);
    site.wait_for_live_servo();
    wait_until("the board's scales", || site.has_scales());
    let segment = Path::new("/dev/shm").join(&site.name);
    let rows = site.path("rows.csv");
    let rows = rows.to_str().unwrap();
    let arguments = ["gather", "--source", "servo_timer", "--period", "4", "--seconds", "3", "-o", rows];
    let mut gather = start(&site, &arguments);
    let reader = Subscriber::attach(&site.segment()).unwrap();
    wait_until("the first samples", || reader.published(RegionId::Gather).unwrap() > 0);
    let directory = site.path("capture");
    let arguments = ["capture", directory.to_str().unwrap(), "--seconds", "3", "--no-variables"];
    let mut capture = start(&site, &arguments);
    wait_until("the first image", || directory.join("images/0000.bin").exists());
    fs::remove_file(&segment).unwrap();
    wait_until("the segment", || segment.exists());
    let ended = output_within(&mut gather, PATIENCE);
    assert!(ended.status.success(), "{ended:?}");
    assert!(String::from_utf8_lossy(&ended.stdout).contains(" lost=0 "), "{ended:?}");
    let ended = output_within(&mut capture, PATIENCE);
    assert!(ended.status.success(), "{ended:?}");
}

#[test]
fn a_motion_is_waited_for_while_something_else_is_in_the_segments_place() {
    let site = Site::running(&[], &[]);
    site.wait_for_live_servo();
    wait_until("the board's scales", || site.has_scales());
    let segment = Path::new("/dev/shm").join(&site.name);
    let mut jog = start(&site, &["jog", "1", "=60000", "--wait"]);
    let velocity = || site.run(&["send", "#1V"]).stdout.trim().parse::<f64>().unwrap();
    wait_until("the jog", || velocity() > 1.0);
    fs::remove_file(&segment).unwrap();
    fs::create_dir(&segment).unwrap();
    let ended = output_within(&mut jog, PATIENCE);
    fs::remove_dir(&segment).unwrap();
    assert!(ended.status.success(), "{ended:?}");
}

/// Python takes what it attaches to for its own, and removes it when it ends.
const SHARED_MEMORY: &str = "
import sys
from multiprocessing import shared_memory
shared_memory.SharedMemory(name=sys.argv[1]).close()
";

#[test]
#[ignore = "needs python3"]
fn the_segment_comes_back_that_pythons_shared_memory_removes() {
    let site = Site::running(&[], &[]);
    let attached = Command::new("python3").args(["-c", SHARED_MEMORY, &site.name]).status().unwrap();
    assert!(attached.success());
    wait_until("the segment", || Subscriber::attach(&site.segment()).is_ok());
    site.wait_for_live_servo();
}

/// Its right to the directories must be enough.
#[test]
#[ignore = "needs root"]
fn as_root_a_daemon_that_became_another_user_makes_its_names_again() {
    let user = nix::unistd::User::from_name("nobody").unwrap().unwrap();
    let mut site = Site::new();
    let own = |path: PathBuf| chown(path, Some(user.uid.as_raw()), Some(user.gid.as_raw())).unwrap();
    own(site.path(""));
    site.start_simulator(&["--dpram-startup"]);
    own(site.path("dpram"));
    own(site.path("interrupt"));
    let daemon = site.daemon_command(&["--user", "nobody"]).stderr(Stdio::null()).spawn().unwrap();
    let site = site.adopt(daemon);
    let segment = Path::new("/dev/shm").join(&site.name);
    let names = [segment.clone(), segment.with_extension("lock"), site.socket()];
    wait_until("the names", || names.iter().all(|name| name.exists()));
    wait_until("the socket", || UnixStream::connect(site.socket()).is_ok());
    names.iter().for_each(|name| fs::remove_file(name).unwrap());
    wait_until("the names", || names.iter().all(|name| name.exists()));
    assert!(names.iter().all(|name| name.metadata().unwrap().uid() == user.uid.as_raw()));
    wait_until("the socket", || UnixStream::connect(site.socket()).is_ok());
}

#[test]
#[ignore = "needs root, to mount a file system"]
fn as_root_a_daemon_makes_its_names_again_in_a_file_system_mounted_over_them() {
    let mut site = Site::new();
    site.start_simulator(&["--dpram-startup"]);
    let plain = site.daemon_command(&[]);
    let mut command = Command::new("unshare");
    command.arg("--mount").arg(plain.get_program()).args(plain.get_args());
    let site = site.adopt(command.stdin(Stdio::null()).stderr(Stdio::null()).spawn().unwrap());
    wait_until("the socket", || site.socket().exists());
    let daemon = site.daemon_pid().to_string();
    let mount = ["-m", "-t", &daemon, "mount", "-t", "tmpfs", "none", "/dev/shm"];
    assert!(Command::new("nsenter").args(mount).status().unwrap().success());
    let seen = |path: PathBuf| PathBuf::from(format!("/proc/{daemon}/root{}", path.display()));
    let segment = Path::new("/dev/shm").join(&site.name);
    for name in [segment.with_extension("lock"), segment, site.socket()].map(seen) {
        wait_until("a name", || name.exists());
    }
}

#[test]
fn a_log_outlives_a_malformed_file_where_the_segment_was() {
    let mut site = Site::running(&[], &[]);
    site.wait_for_live_servo();
    wait_until("the board's scales", || site.has_scales());
    let mut log = begin_log(&site);
    let segment = Path::new("/dev/shm").join(&site.name);
    site.kill_daemon();
    let old = segment.with_extension("old");
    fs::rename(&segment, &old).unwrap();
    fs::write(&segment, b"").unwrap();
    fs::remove_file(old).unwrap();
    let mut said = String::new();
    BufReader::new(log.stderr.take().unwrap()).read_line(&mut said).unwrap();
    assert!(said.contains("no updates (pmacd is gone; start it)"), "{said}");
    site.start_daemon(&[]);
    site.wait_for_live_servo();
    let rows = site.path("log.csv");
    let length = fs::metadata(&rows).unwrap().len();
    wait_until("rows of the new daemon", || fs::metadata(&rows).unwrap().len() > length);
    end_log(log);
}

#[test]
fn a_truncated_segment_ends_daemon_and_readers_by_a_line_and_the_next_start_replaces_it() {
    let mut site = Site::running(&[], &[]);
    site.wait_for_live_servo();
    wait_until("the board's scales", || site.has_scales());
    let mut log = begin_log(&site);
    let segment = Path::new("/dev/shm").join(&site.name);
    fs::File::options().write(true).open(&segment).unwrap().set_len(0).unwrap();
    let ended = output_within(&mut log, PATIENCE);
    let said = String::from_utf8(ended.stderr).unwrap();
    assert_eq!(ended.status.code(), Some(2), "{said}");
    assert!(said.contains("pmacctl: SIGBUS, memory that was mapped is gone: perhaps somebody"), "{said}");
    wait_until("the daemon's last line", || {
        site.log().contains("pmacd: SIGBUS, memory that was mapped is gone: perhaps somebody")
    });
    assert_eq!(site.stop_daemon(), 69);
    site.start_daemon(&[]);
    site.wait_for_live_servo();
    assert!(site.log().contains("which holds nothing: somebody has truncated it"), "{}", site.log());
}

#[test]
fn doctor_concludes_which_name_of_a_running_daemon_is_lost() {
    let site = Site::running(&[], &[]);
    site.wait_for_live_servo();
    let segment = Path::new("/dev/shm").join(&site.name);
    fs::remove_file(&segment).unwrap();
    fs::create_dir(&segment).unwrap();
    let ran = site.run(&["doctor"]);
    fs::remove_dir(&segment).unwrap();
    assert_eq!(ran.code, Some(1), "{ran:?}");
    assert!(ran.stdout.contains("FAIL  names") && ran.stdout.contains("track=False"), "{ran:?}");

    // A daemon that is stopped makes nothing again.
    wait_until("the segment", || Subscriber::attach(&site.segment()).is_ok());
    site.signal_daemon(Signal::SIGSTOP);
    fs::remove_file(site.socket()).unwrap();
    let ran = site.run(&["doctor"]);
    site.signal_daemon(Signal::SIGCONT);
    assert!(ran.stdout.contains("runs, and no socket is at that path"), "{ran:?}");
}
