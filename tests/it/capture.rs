//! The trace of the daemon's bus accesses, and captures of a board.

use std::collections::BTreeMap;
use std::io::Read as _;
use std::os::unix::fs::MetadataExt as _;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::Duration;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use pmac_dpram::client::{CommandError, Connection};
use pmac_dpram::map::FAMILIES;
use pmac_dpram::protocol::CallError;
use pmac_dpram::recording::{About, Access, Op, Recording, Replies};
use pmac_dpram::segment::Counter;

use crate::support::VirtualSite;

/// Longer than a client may be silent.
const SILENT: Duration = Duration::from_secs(6);

/// Accesses that are left, four numbers each.
fn rest(connection: &mut Connection) -> Vec<u64> {
    let mut all = Vec::new();
    loop {
        let reply = connection.trace(true).unwrap();
        assert_eq!(reply.dropped, 0);
        if reply.accesses.is_empty() {
            return all;
        }
        all.extend(reply.accesses);
    }
}

fn refusal(connection: &mut Connection) -> String {
    match connection.trace(false) {
        Err(CommandError::Refused(CallError::Refused { reason })) => reason,
        other => panic!("{other:?}"),
    }
}

#[test]
fn every_access_to_the_bus_is_traced_while_an_engineer_wants_it() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_until("servo data", || site.attach().counter(Counter::Updates) > 0);
    site.hold();
    let (mut connection, mut other) = (site.connection(), site.connection());
    assert_eq!(connection.trace(true).unwrap().accesses, [0; 0], "nothing to end");
    assert_eq!(connection.trace(false).unwrap().accesses, [0; 0]);
    assert!(site.log().contains("traces the bus accesses"), "{}", site.log());
    assert!(refusal(&mut other).contains(&format!("(pid {}) traces the bus accesses", std::process::id())));
    let accesses = || site.attach().counter(Counter::BusAccesses);
    // The count is published with the heartbeat, so at first it may be of before the trace.
    site.step(150);
    let before = accesses();
    site.step(150);
    let counted = accesses() - before;
    let traced = rest(&mut connection).len() as u64 / 4;
    // Of twice the time, and a heartbeat either way.
    assert!(counted > 10_000 && (counted..4 * counted).contains(&traced), "{traced} of {counted}");
    // Whoever comes next has it, and begins with nothing.
    site.step(10);
    assert_eq!(other.trace(false).unwrap().accesses, [0; 0]);
    drop(other);
    site.step(10);
    assert_eq!(connection.trace(false).unwrap().accesses, [0; 0], "the client before is gone");
    site.run_for(SILENT);
    let mut third = site.connection();
    assert_eq!(third.trace(false).unwrap().accesses, [0; 0], "the client before was silent too long");
    drop(third);
    site.step(10);
    // That one hears of it, once: what is missing is no part of a trace.
    assert!(refusal(&mut connection).contains("nothing was asked for 5 s"));
    assert_eq!(connection.trace(false).unwrap().accesses, [0; 0]);
}

#[test]
fn a_trace_that_nobody_fetches_counts_what_it_drops() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_until("servo data", || site.attach().counter(Counter::Updates) > 0);
    site.hold();
    let mut connection = site.connection();
    connection.trace(false).unwrap();
    site.run_for(Duration::from_secs(3));
    let reply = connection.trace(false).unwrap();
    assert_eq!(reply.accesses.len(), 4 * 4096);
    assert!(reply.dropped > 0);
    // Times go up, offsets are those of the DPRAM.
    for access in reply.accesses.chunks(4).skip(1) {
        assert!(access[0] < 1_000_000_000 && access[1] < 2 && access[2] < 0x4000 && access[3] < 0x10000);
    }
}

/// A directory that is not there yet.
fn directory(site: &VirtualSite) -> (PathBuf, String) {
    let path = site.path("capture");
    let text = path.to_str().unwrap().to_owned();
    (path, text)
}

#[test]
fn a_capture_holds_the_board_and_changes_nothing() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_until("the board's scales", || site.has_scales());
    site.ask("P7=2.5 M50->* M50=12");
    site.ask("&1#2");
    let (path, text) = directory(&site);
    let ran = site.hurried(|| site.run(&["capture", &text, "--seconds", "0.05"]));
    assert_eq!((ran.stderr.as_str(), ran.code), ("", Some(0)), "{ran:?}");
    let last = ran.stdout.lines().last().unwrap();
    let recording = Recording::read(&path).unwrap();
    let About { updates, accesses, dropped, cut_short, left_out, .. } = &recording.about;
    assert_eq!(last, format!("updates={updates} accesses={accesses} dropped={dropped}"));
    assert!(
        *updates > 100 && *dropped == 0 && *accesses == recording.accesses.len() as u64 && *accesses > 10_000,
        "{last}"
    );
    assert_eq!(*cut_short, None);
    for sentence in left_out {
        assert!(ran.stdout.contains(&format!("left out: {sentence}\n")), "{ran:?}");
    }
    assert!(left_out.iter().any(|sentence| sentence.contains("no password")), "{left_out:?}");

    let about = &recording.about;
    assert_eq!((about.board.as_str(), about.family.as_str(), about.dpram_bytes), ("file", "pmac", 0x4000));
    let variables = recording.variables.as_deref().unwrap();
    assert!(["\nP7=2.5\n", "\nM50->*\n", "\nM50=12\n"].iter().all(|line| variables.contains(line)));
    assert!(!variables.contains("OPEN"));
    let answer =
        |line: &str| recording.answers.iter().find(|answer| answer.line == line).unwrap().reply.clone();
    assert_eq!(answer("TYPE"), site.ask("TYPE"));
    assert_eq!(answer("^F").len(), 1, "the daemon asks it at its start");
    let asked = |line: &str| recording.answers.iter().find(|answer| answer.line == line).unwrap();
    assert!(asked("XYZZY").refused.as_deref().unwrap().contains("ERR003"), "an error, and what follows it");
    let longest = recording.answers.iter().max_by_key(|answer| answer.line.len()).unwrap();
    assert!(longest.line.len() > 159 && longest.reply == ["32"; 40], "a line in two parts: {longest:?}");
    // The question was asked while the bus was traced: its words are there, and nobody else's.
    let image = &recording.images[0];
    assert!(!recording.images.is_empty() && image.words.len() == 0x2000);
    let ascii = &FAMILIES[0].ascii;
    assert!(image.words[ascii.command.word()..][..80].iter().all(|word| *word == 0));
    let type_line = u32::from(u16::from_le_bytes(*b"TY"));
    let is_type = |access: &&Access| {
        access.op == Op::Write && access.offset == ascii.command && access.value == type_line
    };
    assert!(recording.accesses.iter().any(|access| is_type(&access)));
    assert!(recording.system["machine"].as_object().unwrap().contains_key("/proc/sys/kernel/osrelease"));
    assert_eq!(recording.system["latencies"]["question"]["count"], recording.answers.len());
    // What was addressed still is, and what is running runs.
    assert_eq!((site.ask("&"), site.ask("#")), (vec!["1".to_owned()], vec!["2".to_owned()]));
    site.assert_no_violations();

    let again = site.run(&["capture", &text]);
    assert_eq!(again.code, Some(2));
    assert!(again.stderr.contains("not empty: name a directory that is not there yet"), "{again:?}");
}

#[test]
fn a_turbo_board_with_the_small_dpram_is_captured() {
    let site = VirtualSite::configured(&["--family", "turbo"], "family = \"turbo\"\n");
    let (path, text) = directory(&site);
    let ran = site.hurried(|| site.run(&["capture", &text, "--seconds", "0.05", "--no-variables"]));
    assert_eq!((ran.stderr.as_str(), ran.code), ("", Some(0)), "{ran:?}");
    let recording = Recording::read(&path).unwrap();
    assert_eq!((recording.images[0].words.len(), recording.variables.as_ref()), (0x2000, None));
    // Without these a replay has no scales.
    let replies = Replies::of(&recording);
    for line in
        ["I10 I47 I48 I57 I49 I55 I3", "I5 I6", "I107I108I109I160I207I208I209I260", "I3207I3208I3209I3260"]
    {
        assert!(replies.to(line).is_some_and(|answer| answer.refused.is_none()), "{line}");
    }
}

#[test]
fn what_is_not_told_to_a_capture_is_said() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_until("the board's scales", || site.has_scales());
    site.ask("OPEN PROG 1 CLEAR");
    let (_, text) = directory(&site);
    let ran = site.hurried(|| site.run(&["capture", &text, "--seconds", "0.05"]));
    assert_eq!(ran.code, Some(1), "not whole: {ran:?}");
    assert!(ran.stdout.contains("left out: variables and definitions: "), "{ran:?}");
    assert!(!ran.stdout.contains("the answer to TYPE"), "TYPE is on-line only: {ran:?}");
}

#[test]
fn passwords_and_programs_are_in_no_capture() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_until("the board's scales", || site.has_scales());
    site.ask("OPEN PROG 1 CLEAR");
    site.connection().send_into_buffer("X123456", Duration::from_secs(5)).unwrap();
    site.ask("CLOSE");
    let (path, text) = directory(&site);
    let mut command = site.command(&["capture", &text, "--seconds", "0.05", "--no-variables"]);
    let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
    let mut asking = site.connection();
    let asked = std::thread::scope(|scope| {
        let others = scope.spawn(|| {
            let mut asked = 0;
            while child.try_wait().unwrap().is_none() {
                let listed = asking.send("LIST PROG 1", Duration::from_secs(5)).unwrap();
                assert!(listed.concat().contains("123456"));
                asking.send("PASSWORD=SESAME", Duration::from_secs(5)).unwrap();
                asked += 1;
            }
            asked
        });
        site.slowly_until(|| others.is_finished());
        others.join().unwrap()
    });
    assert!(asked > 0);
    let recording = Recording::read(&path).unwrap();
    assert_eq!(recording.variables, None);
    let ascii = &FAMILIES[0].ascii;
    let texts = recording.accesses.iter().filter(|access| ascii.has_text_in(access.offset, 1));
    let bytes: Vec<u8> = texts.flat_map(|access| (access.value as u16).to_le_bytes()).collect();
    assert!(bytes.len() > 100, "lines went by while the bus was traced");
    for secret in [b"SESA", b"PASS", b"LIST", b"1234"] {
        assert!(!bytes.windows(4).any(|bytes| bytes == secret), "{secret:?}");
    }
    assert!(bytes.windows(4).any(|bytes| bytes == b"TYPE"), "what may be shown is there");
}

#[test]
fn a_capture_that_is_cut_short_is_whole_up_to_there_and_says_so() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_until("the board's scales", || site.has_scales());
    let begin = |name: &str| {
        let path = site.path(name);
        let text = path.to_str().unwrap().to_owned();
        let mut command = site.command(&["capture", &text, "--seconds", "1000", "--no-variables"]);
        let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        site.slowly_until(|| path.join("images/0000.bin").exists());
        (child, path)
    };
    let (mut child, path) = begin("by-signal");
    kill(Pid::from_raw(child.id() as i32), Signal::SIGINT).unwrap();
    site.slowly_until(|| child.try_wait().unwrap().is_some());
    let ran = child.wait_with_output().unwrap();
    assert_eq!(ran.status.code(), Some(1));
    let recording = Recording::read(&path).unwrap();
    assert_eq!(recording.about.cut_short.as_deref(), Some("ended by a signal"));
    assert!(!recording.accesses.is_empty() && recording.about.accesses == recording.accesses.len() as u64);

    let (mut child, path) = begin("killed");
    child.kill().unwrap();
    child.wait().unwrap();
    let cut_short = Recording::read(&path).unwrap().about.cut_short.unwrap();
    assert!(cut_short.contains("it was killed"), "{cut_short}");

    let (child, path) = begin("without-daemon");
    site.stop_daemon();
    let ran = child.wait_with_output().unwrap();
    assert!(!ran.status.success(), "{ran:?}");
    let recording = Recording::read(&path).unwrap();
    assert!(recording.about.cut_short.unwrap().contains("pmacd"), "{ran:?}");
    assert!(!recording.images.is_empty());
}

#[test]
fn a_full_disk_leaves_whole_lines() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_until("the board's scales", || site.has_scales());
    let (path, text) = directory(&site);
    // No file may grow beyond 200 KiB, as if the disk were full then.
    let program = env!("CARGO_BIN_EXE_pmacctl");
    let script = format!(
        "ulimit -f 200; exec {program} --name {} --socket {} capture {text} --seconds 100 --no-variables",
        site.name,
        site.socket().display()
    );
    let ran = site.hurried(|| Command::new("bash").args(["-c", &script]).output().unwrap());
    assert_eq!(ran.status.code(), Some(2), "{ran:?}");
    let stderr = String::from_utf8(ran.stderr).unwrap();
    assert!(stderr.contains("trace.ndjson: File too large"), "{stderr}");
    let recording = Recording::read(&path).unwrap();
    assert!(recording.about.cut_short.unwrap().contains("File too large"));
    assert!(recording.accesses.len() > 1000 && recording.about.accesses == recording.accesses.len() as u64);
}

/// Where the directory's group is somebody else's, nobody of it may change what is sent on.
#[test]
fn nobody_else_may_write_into_a_captures_files_whatever_the_umask() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_until("the board's scales", || site.has_scales());
    let (path, text) = directory(&site);
    let capture = site.command(&["capture", &text, "--seconds", "0.05", "--no-variables"]);
    let mut shell = Command::new("sh");
    shell.args(["-c", "umask 002; exec \"$@\"", "sh"]).arg(capture.get_program()).args(capture.get_args());
    let child = shell.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let output = std::thread::spawn(|| child.wait_with_output().unwrap());
    site.wait_until("the capture", || output.is_finished());
    let ran = output.join().unwrap();
    assert!(ran.status.success(), "{ran:?}");
    for directory in [path.clone(), path.join("images")] {
        for entry in std::fs::read_dir(directory).unwrap() {
            let entry = entry.unwrap();
            let mode = entry.metadata().unwrap().mode();
            assert_eq!(mode & 0o022, 0, "{:?}: {mode:o}", entry.path());
        }
    }
}

/// The files of a tar, by name.
fn files_of(tar: &[u8]) -> BTreeMap<String, String> {
    let mut archive = tar::Archive::new(tar);
    let entries = archive.entries().unwrap().map(|entry| {
        let mut entry = entry.unwrap();
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).unwrap();
        (entry.path().unwrap().display().to_string(), String::from_utf8_lossy(&bytes).into_owned())
    });
    entries.collect()
}

#[test]
fn a_report_is_one_file_without_names_and_paths_of_the_users() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_until("the board's scales", || site.has_scales());
    let path = site.path("report.tar.gz");
    let text = path.to_str().unwrap();
    let ran = site.hurried(|| site.run(&["doctor", "--report", text]));
    assert_eq!((ran.stderr.as_str(), ran.code), ("", Some(0)), "{ran:?}");
    assert!(
        ran.stdout.contains("What it does not hold:") && ran.stdout.contains("look at it before you send it")
    );
    let packed = std::fs::read(&path).unwrap();
    let size = format!("\n{text}: {} kB\n", packed.len().div_ceil(1000));
    assert!(ran.stdout.contains(&size), "{size}: {ran:?}");
    let mut tar = Vec::new();
    flate2::read::GzDecoder::new(&*packed).read_to_end(&mut tar).unwrap();
    let files = files_of(&tar);
    let of = |name: &str| files[&format!("pmac-report/{name}")].as_str();
    assert!(ran.stdout.starts_with(of("README.txt")), "what is said is in it: {ran:?}");
    let doctor: serde_json::Value = serde_json::from_str(of("doctor.json")).unwrap();
    let status: serde_json::Value = serde_json::from_str(of("status.json")).unwrap();
    assert!(doctor.as_array().unwrap().iter().any(|check| check["check"] == "socket"));
    assert_eq!((&status["condition"], &status["socket"]["board"]), (&"live".into(), &"file".into()));
    assert!(of("capture/about.json").contains("\"cut_short\": null"), "{}", of("capture/about.json"));
    assert!(of("capture/variables.pmc").contains("\nI122=") && of("capture/trace.ndjson").ends_with("}\n"));
    let socket = site.socket();
    let place = socket.parent().unwrap().display().to_string();
    assert!(files.values().all(|text| !text.contains(&place)), "{place}: {files:?}");
    // Nothing is left beside it, and nothing that is there is replaced.
    let beside = std::fs::read_dir(path.parent().unwrap()).unwrap();
    assert!(
        !beside.into_iter().any(|entry| entry.unwrap().file_name().to_string_lossy().contains("partial"))
    );
    let again = site.run(&["doctor", "--report", text]);
    assert!(again.code == Some(2) && again.stderr.contains("File exists"), "{again:?}");

    // Without a daemon it says so, and holds what there is.
    site.stop_daemon();
    let path = site.path("without.tar");
    let ran = site.run(&["doctor", "--report", path.to_str().unwrap()]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    assert!(ran.stdout.contains("\nFAIL  "), "why its status is 1: {ran:?}");
    let files = files_of(&std::fs::read(&path).unwrap());
    assert!(files["pmac-report/README.txt"].contains("  no capture: "), "{files:?}");
    assert!(!files.keys().any(|name| name.contains("capture/")));
    assert!(files.values().all(|text| !text.contains(&place)), "{place}: {files:?}");
}
