//! A part of a report: what the daemon does not read costs nothing on the bus, and is never shown as a value.

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use pmac_dpram::client::Board;
use pmac_dpram::map::{PMAC, Selection};
use pmac_dpram::protocol::{BackgroundSettings, BoardSettings, ServoSettings};
use pmac_dpram::segment::{Counter, DIRECTORY, RegionId, Sample, layout};
use proptest::prelude::*;
use serde_json::Value;

use crate::support::rig::Rig;
use crate::support::{VirtualSite, counter, is_live};

/// Motors 1 and 3 with actual position and velocity; of coordinate system 1 its targets' X and the lines left.
fn partial(name: &str) -> Rig {
    let servo = Selection::new([4..8, 20..22], [1, 3]);
    let background = Selection::new([38..42, 52..54], [1]);
    let name = format!("pmac-test-{name}-{}", std::process::id());
    let selections = vec![(RegionId::Servo, servo), (RegionId::Background, background)];
    Rig::selecting(Path::new(DIRECTORY), &name, selections).live()
}

#[test]
fn what_is_not_read_is_shown_as_such() {
    let rig = partial("unread");
    assert_eq!(
        rig.run("motors").stdout,
        "motor  target  commanded  actual  following error  velocity  flags\n   \
            #1       -          -   999.8                -       0.0  -\n   \
            #3       -          -  -77raw                -      5raw  -\n"
    );
    assert_eq!(
        rig.run("coordinates").stdout,
        "system  mode  lines  PE  left ms  override  targets  flags\n    \
            &1  -         3   -        -         -  X12.5    -\n\
            ports: JPAN $000000  JTHW $000000  JOPTO $000000\n"
    );
    let watched = rig.run("watch --count 1").stdout;
    assert!(
        watched.contains(" #1=999.8 following_error=- flags=- #3=-77raw following_error=- flags=-\n"),
        "{watched}"
    );

    let motors = rig.run("motors --json").json();
    let motor = &motors["motors"][0];
    assert_eq!(motor["actual_position"]["value"], 999.75);
    for absent in ["commanded_position", "servo_status", "status", "previous_dac", "handwheel_pointer"] {
        assert!(motor.as_object().unwrap().contains_key(absent));
        assert_eq!(motor[absent], Value::Null, "{absent}");
    }
    assert_eq!((motors["motors"].as_array().unwrap().len(), &motors["motors"][1]["motor"]), (2, &3.into()));
    let systems = rig.run("coordinates --json").json();
    let system = &systems["coordinate_systems"][0];
    assert_eq!((&system["axis_targets"]["X"], &system["axis_targets"]["Y"]), (&12.5.into(), &Value::Null));
    assert_eq!((&system["lines_remaining"], &system["program_status"]), (&3.into(), &Value::Null));
    assert_eq!(systems["background_motors"][0]["target_position"], Value::Null);
}

#[test]
fn a_program_without_our_code_finds_it_in_the_regions_entry() {
    let rig = partial("entry");
    let path = Path::new(DIRECTORY).join(&rig.name);
    let bytes = std::fs::read(&path).unwrap();
    let word = |offset: usize| u64::from_ne_bytes(bytes[offset..offset + 8].try_into().unwrap());
    assert_eq!((word(0x300), word(layout::AT_ABI_MINOR)), (RegionId::Servo as u64, layout::ABI_MINOR));
    assert_eq!(!word(0x300 + 0x58), 0b0011_0000_0000_0000_1111_0000);
    assert_eq!(!word(0x300 + 0x60), 0b101);
}

#[test]
#[ignore = "needs python3"]
fn with_python_a_reader_finds_what_is_read() {
    let rig = partial("python");
    let path = Path::new(DIRECTORY).join(&rig.name);
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/segment_reader.py");
    let ran = Command::new("python3").arg(script).arg(&path).output().unwrap();
    let document: Value = serde_json::from_slice(&ran.stdout).unwrap();
    let words = |region: &str| document["regions"][region]["latest"]["words"].as_array().unwrap().clone();
    let read = words("servo").iter().map(|word| word.is_u64()).collect::<Vec<_>>();
    let expected = |index: usize| match index.checked_sub(18) {
        None => true,
        Some(word) => [0, 2].contains(&(word / 30)) && [4, 5, 6, 7, 20, 21].contains(&(word % 30)),
    };
    assert_eq!(read, (0..read.len()).map(expected).collect::<Vec<_>>());
    assert_eq!(words("background").iter().filter(|word| word.is_u64()).count(), 18 + 6);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    /// Whatever a segment says is not read: what is shown then is of words that are read, and nothing panics.
    #[test]
    fn any_selection_can_be_shown(words in any::<u64>(), numbers in any::<u64>()) {
        let directory = tempfile::tempdir().unwrap();
        let selection = Selection::without(words, numbers);
        let selections = vec![(RegionId::Servo, selection), (RegionId::Background, selection)];
        let rig = Rig::selecting(directory.path(), "pmac0", selections).live();
        let mut board = Board::attach_in(directory.path(), "pmac0").unwrap();
        let snapshot = board.snapshot().unwrap();
        let servo = snapshot.servo.unwrap().data;
        let shown: Vec<_> = servo.motors.iter().map(|motor| motor.motor).collect();
        let expected: Vec<_> = (1..=3).filter(|motor| numbers & 1 << (motor - 1) == 0).collect();
        prop_assert_eq!(shown, expected);
        for motor in servo.motors {
            prop_assert_eq!(motor.actual_position.is_some(), words & 0xF0 == 0);
            prop_assert_eq!(motor.status.is_some(), words & 0xC_0000 == 0);
        }
        for system in snapshot.background.unwrap().data.coordinate_systems {
            prop_assert_eq!(system.axis_targets.axis("A").is_some(), words & 0xF << 14 == 0);
        }
        drop(rig);
    }
}

#[test]
#[ignore = "needs python3"]
fn with_python_the_example_of_another_language_follows_from_now_on_and_shows_counts() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    site.wait_until("a board that takes a jog", || site.pmacctl(&["send", "#1J=300 #2J^-55.5"]).0 == 0);
    let subscriber = site.attach();
    // More than the ring has: what is gone is not counted as lost by somebody who comes now.
    site.wait_until("a ring that has been round", || {
        subscriber.region(RegionId::Servo).is_ok_and(|region| region.published > region.slots)
    });
    site.wait_until("both to be there", || {
        let line = site.pmacctl(&["watch", "--count", "1"]).1;
        line.contains("#1=300.0") && line.contains("#2=-55.5")
    });
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/segment_reader.py");
    let path = Path::new(DIRECTORY).join(&site.name);
    let ran = Command::new("python3").arg(script).arg(&path).args(["servo", "100"]).output().unwrap();
    let followed: Value = serde_json::from_slice(&ran.stdout).unwrap();
    assert_eq!((&followed["got"], &followed["lost"]), (&100.into(), &0.into()), "{followed}");
    assert!(followed.get("mixed").is_none() && followed["fresh"].is_boolean(), "{followed}");
    let positions = &followed["actual_positions"];
    assert_eq!((&positions["1"], &positions["2"]), (&300.0.into(), &(-55.5).into()), "{followed}");
}

/// A daemon with this configuration on a simulated board, with live servo and background data.
fn configured(text: &str) -> VirtualSite {
    with_both_reports(VirtualSite::configured(&[], text))
}

/// A daemon that reads data by 32 bits.
fn by_32_bits(options: &[&str]) -> VirtualSite {
    let site = VirtualSite::new();
    site.start_simulator(&["--dpram-startup"]);
    let board = format!("file:{},access=32", site.path("dpram").display());
    site.start_daemon_on(&board, options);
    with_both_reports(site)
}

fn with_both_reports(site: VirtualSite) -> VirtualSite {
    let segment = site.attach();
    site.wait_until("both reports", || {
        is_live(&segment, RegionId::Servo) && is_live(&segment, RegionId::Background)
    });
    site
}

/// The bus accesses of the servo data and of the background data for each report.
fn accesses_a_report(site: &VirtualSite) -> [f64; 2] {
    let segment = site.attach();
    let count = || {
        [Counter::ServoAccesses, Counter::Updates, Counter::BackgroundAccesses, Counter::BackgroundUpdates]
            .map(|what| counter(&segment, what) as f64)
    };
    // A background report is read in pieces: only whole ones are counted.
    let run_to_the_end_of_a_report = || {
        let reports = count()[3];
        let ended = (0..200).any(|_| {
            site.run_for(Duration::from_millis(1));
            count()[3] > reports
        });
        assert!(ended, "no background report in 200 ms");
        count()
    };
    site.hold();
    let before = run_to_the_end_of_a_report();
    site.run_for(Duration::from_secs(2));
    let after = run_to_the_end_of_a_report();
    site.go_on();
    let [servo, updates, background, reports] = std::array::from_fn(|index| after[index] - before[index]);
    assert!(updates > 4000.0 && reports > 30.0, "{updates} {reports}");
    [servo / updates, background / reports]
}

#[test]
fn a_daemon_that_is_told_to_reads_less() {
    for (text, servo, background) in [
        ("", 246.0, 507.0),
        ("[servo]\nspare_words = false\n", 214.0, 507.0),
        (
            "[servo]\nmotors = [1, 3]\nfields = ['actual_position', 'servo_status']\n\
             [background]\nmotors = [2]\nfields = ['background_status', 'program_status']\n",
            18.0,
            15.0,
        ),
    ] {
        costs(&configured(text), text, servo, background);
    }
}

#[test]
fn a_daemon_that_may_reads_two_words_at_once() {
    let site = by_32_bits(&[]);
    costs(&site, "access=32", 124.0, 256.0);
    // The same data as by 16 bits: commands, replies, positions.
    site.wait_until("a board that takes commands", || site.pmacctl(&["send", "#1J=3000"]).0 == 0);
    site.wait_until("the motor where it was sent", || site.pmacctl(&["send", "#1P"]).1 == "3000\n");
    site.wait_until("its position in the segment", || {
        let (_, text, _) = site.pmacctl(&["motors", "--json"]);
        let document: Value = serde_json::from_str(&text).unwrap();
        document["motors"][0]["actual_position"]["value"] == 3000.0
    });
    let csv = site.path("data.csv");
    let gather = ["gather", "--source", "1.actual_position", "--seconds", "0.2", "-o", csv.to_str().unwrap()];
    let (status, stdout, stderr) = site.pmacctl(&gather);
    assert!(status == 0 && stdout.contains(" lost=0 "), "{stdout}{stderr}");
    let gathered = std::fs::read_to_string(csv).unwrap();
    assert!(gathered.lines().skip(1).all(|line| line.ends_with(",3000")), "{gathered}");
    let (status, stdout, stderr) =
        site.pmacctl(&["variable", "watch", "X:$0000", "1.actual_position", "--count", "2"]);
    assert!(status == 0 && stdout.contains(" 1.actual_position=3000"), "{stdout}{stderr}");
    site.assert_no_violations();

    drop(site);
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("handshake.toml");
    std::fs::write(&path, "servo_reading = 'handshake'\n[servo]\nspare_words = false\n").unwrap();
    let site = by_32_bits(&["--config", path.to_str().unwrap()]);
    costs(&site, "access=32, handshake, without spare words", 111.0, 256.0);
}

/// Asserts what each report costs.
#[track_caller]
fn costs(site: &VirtualSite, what: &str, servo: f64, background: f64) {
    let [measured_servo, measured_background] = accesses_a_report(site);
    println!("{what:?}: {measured_servo} of {servo}, {measured_background} of {background}");
    assert!(measured_servo >= servo, "{what:?}: {measured_servo}");
    // A poll in vain costs 1, whatever an update costs.
    assert!(measured_servo <= servo + 2.0, "{what:?}: {measured_servo}");
    assert!(measured_background >= background * 0.99, "{what:?}: {measured_background}");
    assert!(measured_background <= background * 1.01 + 2.0, "{what:?}: {measured_background}");
    site.assert_no_violations();
}

#[test]
fn what_the_daemon_does_not_read_is_0_in_the_segment_and_absent_at_its_clients() {
    let site = configured("[servo]\nmotors = [2]\nfields = ['actual_position']\n");
    let settings = site.connection().settings().unwrap();
    let servo = serde_json::to_value(&settings.servo).unwrap();
    assert_eq!(servo, serde_json::json!({"motors": [2], "fields": ["actual_position"], "spare_words": true}));
    site.wait_until("a motor that moves", || site.pmacctl(&["send", "#2J+"]).0 == 0);
    site.wait_until("its position", || {
        let (_, text, _) = site.pmacctl(&["motors", "--json"]);
        let document: Value = serde_json::from_str(&text).unwrap();
        let motors = document["motors"].as_array().unwrap();
        assert!(motors.len() == 1 && motors[0]["motor"] == 2 && motors[0]["commanded_position"].is_null());
        motors[0]["actual_position"]["raw"].as_i64().unwrap() > 1000
    });
    let segment = site.attach();
    let mut sample = Sample::new();
    segment.latest(RegionId::Servo, &mut sample).unwrap().unwrap();
    // Up to the end of motor 2: 18 words of the board, 30 of motor 1, 30 of motor 2.
    let words = sample.words();
    assert_eq!(words.len(), 78);
    let zero = |range: std::ops::Range<usize>| words[range].iter().all(|word| *word == 0);
    assert!(zero(18..52) && !zero(52..56) && zero(56..78));
}

/// The daemon's bus accesses and the words it has changed on a board that does nothing, from its start to its end.
fn touched(functions: &str) -> (u64, Vec<usize>) {
    const WORD: u8 = 0x5A;
    let site = VirtualSite::new();
    let memory = site.path("dpram");
    std::fs::write(&memory, vec![WORD; 0x4000]).unwrap();
    let path = site.path("pmacd.toml");
    std::fs::write(&path, format!("ask_board = false\nfunctions = [{functions}]\n")).unwrap();
    site.start_daemon(&["--config", path.to_str().unwrap()]);
    let segment = site.attach();
    let beats = segment.header().beats + 6;
    site.wait_until("signs of life", || segment.header().beats >= beats);
    let accesses = counter(&segment, Counter::BusAccesses);
    site.stop_daemon();
    let bytes = std::fs::read(&memory).unwrap();
    let words = bytes.chunks(2).enumerate().filter(|(_, bytes)| **bytes != [WORD; 2]);
    (accesses, words.map(|(index, _)| 2 * index).collect())
}

#[test]
fn a_function_that_is_switched_off_is_left_alone_from_start_to_end() {
    // Of functions that only act when asked there is not one access.
    assert_eq!(touched("'gather', 'rotary'"), (0, vec![]));
    // Each of the others changes its own host's words and no more.
    for (function, expected) in [
        ("'servo'", &[0x24][..]),
        ("'background'", &[0x228]),
        // What another host left is withdrawn. The board is asked nothing.
        ("'ascii'", &[0x62C, 0x62E, 0x6D0]),
        ("'variables'", &[0x7D4, 0x7E8, 0x7EC]),
        ("'panel'", &[0x00]),
    ] {
        let (accesses, words) = touched(function);
        assert!(accesses > 0, "{function}");
        assert_eq!(words, expected, "{function}");
    }
}

#[test]
fn a_daemon_with_servo_data_alone_does_the_rest_no_more() {
    let site = VirtualSite::new();
    let path = site.path("pmacd.toml");
    std::fs::write(&path, "functions = ['servo']\nmotors = 2\ni10 = 3713707\n").unwrap();
    site.start_simulator(&["--dpram-startup"]);
    site.start_daemon(&["--config", path.to_str().unwrap()]);
    site.wait_for_live_servo();
    let segment = site.attach();
    let updates = counter(&segment, Counter::Updates);
    site.wait_until("updates", || counter(&segment, Counter::Updates) > updates + 500);
    for untouched in [Counter::AsciiAccesses, Counter::AsciiCommands, Counter::BackgroundAccesses] {
        assert_eq!(counter(&segment, untouched), 0, "{untouched:?}");
    }
    // What the configuration says of the board is known all the same.
    let (status, stdout, _) = site.pmacctl(&["watch", "--count", "1"]);
    assert!(status == 0 && stdout.contains(" #2=") && !stdout.contains(" #3="), "{stdout}");
    for command in [
        &["send", "#1P"][..],
        &["send", "^K"],
        &["panel", "jog+", "1"],
        &["variable", "watch", "X:$0000"],
        &["gather", "--source", "servo_timer", "--seconds", "0.1", "-o", "-"],
    ] {
        let (status, _, stderr) = site.pmacctl(command);
        assert!(status != 0 && stderr.contains("is switched off"), "{command:?}: {stderr}");
    }
    let (status, stdout, _) = site.pmacctl(&["doctor"]);
    assert_eq!(status, 0, "{stdout}");
    assert!(stdout.contains("ascii, panel, background, variables, rotary, gather switched off"), "{stdout}");
    site.assert_no_violations();
}

#[test]
fn the_example_shows_what_is_read_by_default() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("systemd/pmacd.toml.example");
    let text = std::fs::read_to_string(path).unwrap();
    let lines = text.lines().filter_map(|line| line.strip_prefix("# "));
    let of = |table: &'static str| lines.clone().skip_while(move |line| *line != table).skip(1);
    let functions = lines.clone().find(|line| line.starts_with("functions = "));
    let mut written = format!("{}\n", functions.unwrap());
    for (table, keys) in [("[servo]", 3), ("[background]", 2)] {
        written += &format!("{table}\n");
        for line in of(table).take(keys) {
            written += &format!("{line}\n");
        }
    }
    let settings: BoardSettings =
        toml::from_str(&written).unwrap_or_else(|error| panic!("{error}\n{written}"));
    let (servo, background) = (ServoSettings::all(&PMAC), BackgroundSettings::all(&PMAC));
    assert_eq!(settings, BoardSettings { servo, background, ..BoardSettings::default() });
}
