//! `pmacd --board replay:DIR`: a recording gives the daemon its board again.

use std::path::Path;
use std::time::Duration;

use pmac_dpram::client::CommandError;
use pmac_dpram::protocol::CallError;

use crate::support::VirtualSite;
use crate::support::tape::{published, record, updates};

const TIME: Duration = Duration::from_millis(200);
/// What the daemon asks a board.
const ASKED: [&str; 9] =
    ["TYPE", "VERSION", "???", "SIZE", "^F", "I0..199", "I200..399", "I400..599", "I600..899"];

/// A daemon on the replay of `directory`, which has come to its end.
pub fn replayed(directory: &Path) -> VirtualSite {
    let site = VirtualSite::new();
    site.start_daemon_on(&format!("replay:{}", directory.display()), &[]);
    site.wait_until("the end of the recording", || site.log().contains("the recording is over"));
    site.run_for(Duration::from_millis(300));
    site
}

/// As [`replayed`], and the words of every update that was shown meanwhile, however many there are.
pub fn followed(directory: &Path) -> (VirtualSite, Vec<Vec<u16>>) {
    let site = VirtualSite::new();
    site.hold();
    site.start_daemon_on(&format!("replay:{}", directory.display()), &[]);
    let mut shown = Vec::new();
    let mut is_over = false;
    while !is_over {
        is_over = site.log().contains("the recording is over");
        site.run_for(Duration::from_millis(300));
        shown.extend(updates(&site, shown.len() as u64 + 1));
    }
    site.go_on();
    (site, shown)
}

fn moving(family: &str) -> VirtualSite {
    let site = VirtualSite::configured(&["--family", family], &format!("family = \"{family}\"\n"));
    site.wait_for_axes();
    site.wait_for_identity();
    site.ask("#1J+");
    site.ask("#2J-");
    site.run_for(Duration::from_millis(400));
    site
}

#[test]
fn an_escape_sequence_in_the_boards_type_is_seen_and_does_nothing() {
    let recorded = moving("pmac");
    let (directory, _) = record(&recorded, &ASKED, TIME);
    let answers = directory.join("answers.ndjson");
    let text = std::fs::read_to_string(&answers).unwrap();
    std::fs::write(&answers, text.replace("PMAC1, ISA", "PMAC1\\u001b[2J, ISA")).unwrap();
    let site = replayed(&directory);
    let board_type = || site.connection().info().unwrap().board_type;
    site.wait_until("the board's type", || board_type().is_some());
    assert!(board_type().unwrap().contains("PMAC1\u{1b}[2J"), "as the board has it: {:?}", board_type());
    for arguments in [&["status"][..], &["doctor"]] {
        let (_, stdout, stderr) = site.pmacctl(arguments);
        assert!(
            !stdout.contains('\u{1b}') && !stderr.contains('\u{1b}'),
            "{arguments:?}: {stdout:?} {stderr:?}"
        );
    }
    let shown = site.pmacctl(&["status"]).1;
    assert!(shown.contains("PMAC1\\x1b[2J"), "{shown:?}");
    let document = site.pmacctl(&["status", "--json"]).1;
    assert!(!document.contains('\u{1b}') && document.contains("PMAC1\\u001b[2J"), "{document:?}");
}

fn gives_the_board_again(family: &str, asked: &[&str]) {
    let recorded = moving(family);
    let (directory, original) = record(&recorded, asked, TIME);
    assert!(original.len() > 40, "{} updates", original.len());
    let site = replayed(&directory);
    let again = updates(&site, 1);
    // At its start the daemon looks seldom; from its first update on it has every one.
    assert!(again.len() > original.len() / 2, "{} of {}", again.len(), original.len());
    let mut rest = original.iter();
    assert!(again.iter().all(|shown| rest.any(|recorded| recorded == shown)), "an update that was none");
    assert_eq!(published(&site), again.len() as u64);
    site.wait_until("the board's type", || site.connection().info().unwrap().board_type.is_some());
    let info = site.connection().info().unwrap();
    let replay = info.replay.unwrap();
    assert!(replay.over, "{}", site.log());
    let (status, stdout, _) = site.pmacctl(&["status"]);
    assert!(status == 1 && stdout.contains("a recording, no board: nothing can be moved"), "{stdout}");
    assert!(stdout.contains("stale: the recording is over") && !stdout.contains("cable"), "{stdout}");
    for verb in ["motors", "coordinates"] {
        let (status, stdout, _) = site.pmacctl(&[verb]);
        assert!(status == 1 && stdout.starts_with("STALE: ") && !stdout.contains("cable"), "{stdout}");
        assert!(stdout.contains("the recording is over; a pmacd"), "{stdout}");
    }
    let (status, stdout, stderr) =
        site.pmacctl(&["log", "-o", &site.path("none.csv").display().to_string(), "--seconds", "0.1"]);
    assert_eq!((status, &*stdout), (1, "updates=0 lost=0 missed=0\n"), "{stderr}");
    assert!(stderr.contains("no update came: the recording is over"), "{stderr}");
    assert!(site.log().contains("nothing else was asked than was recorded"), "told when it is over");
    let copy = site.path("copy");
    let (status, _, stderr) = site.pmacctl(&["capture", copy.to_str().unwrap()]);
    assert!(status == 1 && stderr.contains("a replay of a recording, no board"), "{status} {stderr}");
    assert!(!copy.exists());
    let doctor = site.pmacctl(&["doctor"]).1;
    assert!(doctor.contains("it is over, and its data are stale"), "{doctor}");
    assert!(doctor.contains("updates; the recording is over"), "{doctor}");
    assert!(!doctor.contains("pmacctl send") && !doctor.contains("check that"), "{doctor}");
    assert_eq!(info.board_type, recorded.connection().info().unwrap().board_type);
    site.stop_daemon();
    let told = site.log().matches("nothing else was asked than was recorded").count();
    assert_eq!((told, replay.differences), (1, 0), "{}", site.log());
}

#[test]
fn a_replay_gives_the_daemon_the_board_again() {
    gives_the_board_again("pmac", &ASKED);
}

#[test]
fn a_replay_gives_the_daemon_a_turbo_board_again() {
    let motors: Vec<String> = (1..=32).map(|motor| format!("I{motor}00..{motor}99")).collect();
    let all: Vec<&str> =
        ASKED[..5].iter().copied().chain(["I0..99"]).chain(motors.iter().map(String::as_str)).collect();
    gives_the_board_again("turbo2", &all);
}

#[test]
fn what_pmacctl_captured_is_played_again() {
    let recorded = moving("pmac");
    let directory = recorded.path("captured");
    let ran =
        recorded.hurried(|| recorded.run(&["capture", directory.to_str().unwrap(), "--seconds", "0.2"]));
    assert_eq!(ran.code, Some(0), "{ran:?}");
    let site = replayed(&directory);
    assert!(published(&site) > 100, "{}", site.log());
    site.wait_until("the board's type", || site.connection().info().unwrap().board_type.is_some());
    assert_eq!(
        site.connection().info().unwrap().board_type,
        recorded.connection().info().unwrap().board_type
    );
    assert_eq!(site.ask("I122"), recorded.ask("I122"));
}

/// Its own questions are refused then, and nobody's line waits for that.
#[test]
fn a_recording_without_the_boards_variables_answers_what_it_has() {
    let recorded = moving("turbo2");
    let (directory, _) = record(&recorded, &["TYPE"], TIME);
    let site = replayed(&directory);
    assert_eq!(site.ask("TYPE"), recorded.ask("TYPE"));
    assert!(site.log().contains("lines that the recording has no answer to: `"), "{}", site.log());
    assert!(site.log().contains("DPRAM ASCII: live"), "{}", site.log());
    assert!(!site.log().contains("no answer (") && !site.log().contains("(is I"), "{}", site.log());
}

#[test]
fn nothing_can_be_moved_in_a_replay_and_every_difference_is_told() {
    let recorded = moving("pmac");
    // Of what the daemon asks for, a part.
    let (directory, _) = record(&recorded, &["TYPE", "VERSION", "SIZE"], TIME);
    let site = replayed(&directory);
    let mut connection = site.connection().confirming(true);
    let refused = |result: Result<(), CommandError>| match result {
        Err(CommandError::Refused(CallError::Refused { reason })) => {
            assert!(reason.starts_with("this is a replay of a recording, no board:"), "{reason}");
        }
        other => panic!("{other:?}"),
    };
    let patience = Duration::from_secs(5);
    for line in ["#1J+", "I100", "P1=3", "$$$", "#1J+ #2J/"] {
        refused(connection.send(line, patience).map(drop));
    }
    refused(connection.control(b'R' - 64).map(drop));
    refused(connection.control(b'A' - 64).map(drop));
    refused(connection.jog_to(1, 10.0));
    refused(connection.panel("jog+", &[1]));
    // It is over: that its data are not live is no matter.
    for arguments in [
        &["jog", "1", "=5"][..],
        &["jog", "1", "stop", "--wait"],
        &["tune", "step", "1", "--size", "10", "--yes"],
        &["panel", "home", "1", "--wait"],
        &["jog", "1", "+"],
    ] {
        let (status, stdout, stderr) = site.pmacctl(arguments);
        let said = "this is a replay of a recording, no board: nothing can be moved, written or set\n";
        assert!(status == 1 && stdout.is_empty() && stderr.ends_with(said), "{arguments:?}: {stderr}");
    }
    let differences = || site.connection().info().unwrap().replay.unwrap().differences;
    site.wait_until("a difference", || differences() > 0);
    site.stop_daemon();
    let log = site.log();
    let told =
        log.lines().find(|line| line.contains("lines that the recording has no answer to: `")).unwrap();
    assert!(!told.contains("J+"), "what a client asks is no difference of the driver's: {told}");
}
