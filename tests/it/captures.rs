//! Every capture in `tests/captures`: played back, and compared with the simulator that is started from it.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

use pmac_dpram::map::Family;
use pmac_dpram::recording::{Op, Recording};
use pmac_dpram::segment::Counter;

use crate::replay::replayed;
use crate::support::VirtualSite;
use crate::support::tape::{record, updates};

/// How long the simulator is recorded.
const TIME: Duration = Duration::from_millis(200);

fn home() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/captures")
}

fn captures() -> Vec<PathBuf> {
    let entries = std::fs::read_dir(home()).unwrap().map(|entry| entry.unwrap().path());
    let mut all: Vec<PathBuf> = entries.filter(|path| path.is_dir()).collect();
    all.sort();
    assert!(!all.is_empty());
    all
}

/// What is asked of a board of `family`: who it is, and all its I-variables.
fn asked(family: &Family) -> Vec<String> {
    let motors = (1..=family.motors).map(|motor| format!("I{motor}00..{motor}99"));
    ["TYPE", "VERSION", "???", "SIZE", "I0..99"].into_iter().map(str::to_owned).chain(motors).collect()
}

/// A board with two motors that jog, reported at every tenth servo cycle; `simulator` are its options.
fn site(family: &Family, simulator: &[&str], moves: bool) -> VirtualSite {
    let site = VirtualSite::new();
    let config = format!("family = \"{}\"\n[servo]\nmotors = [1, 2]\n", family.name);
    let config = site.file("pmacd.toml", &config);
    site.start_simulator(simulator);
    site.start_daemon(&["--config", &config]);
    site.wait_for_live_servo();
    site.wait_for_identity();
    if moves {
        site.ask(&format!("I{}=10", family.i.servo_period));
        site.ask("#1J+");
        site.ask("#2J-");
        site.run_for(Duration::from_secs(3));
    }
    site
}

/// Of each update, by its timer: the words of the first motor's block, as the trace has them.
fn recorded_blocks(recording: &Recording, family: &Family) -> HashMap<u32, Vec<u16>> {
    let servo = &family.servo;
    let (first, words) = (servo.motors.first.word(), servo.motors.words);
    let (mut low, mut flag) = (0, 0);
    let mut block = vec![0; words];
    let mut found = HashMap::new();
    for access in recording.accesses.iter().filter(|access| access.op == Op::Read) {
        for half in 0..usize::from(access.width / 16) {
            let (word, value) = (access.offset.word() + half, (access.value >> (16 * half)) as u16);
            if word == servo.pmac_status.word.word() {
                flag = value;
            }
            if word == servo.timer.low.word() {
                low = value;
            }
            if let Some(place) = word.checked_sub(first).and_then(|at| block.get_mut(at)) {
                *place = value;
                // Overwritten until its last word was read; what a torn copy leaves, the next one replaces.
                found.insert(servo.timer.value(low, flag), block.clone());
            }
        }
    }
    found
}

#[test]
fn e6_the_mirror_of_every_capture_shows_what_was_recorded() {
    for directory in captures() {
        let recording = Recording::read(&directory).unwrap();
        let family = recording.about.family(&directory).unwrap();
        let recorded = recorded_blocks(&recording, family);
        let site = replayed(&directory);
        let servo = &family.servo;
        let shown = updates(&site, 1);
        // Of the first and the last, the trace may lack a part.
        let most = recorded.len();
        assert!(shown.len() + 2 >= most && shown.len() > 2, "{directory:?}: {} of {most}", shown.len());
        for image in &shown {
            let timer = servo
                .timer
                .value(image[servo.index(servo.timer.low)], image[servo.index(servo.pmac_status.word)]);
            let start = servo.index(servo.motors.first);
            let block = &image[start..start + servo.motors.words];
            assert_eq!(recorded.get(&timer).map(Vec::as_slice), Some(block), "{directory:?}: timer {timer}");
        }
        assert_eq!(site.attach().counter(Counter::Missed), 0, "{directory:?}");
        let (_, motors, _) = site.pmacctl(&["motors", "--json"]);
        let motors: serde_json::Value = serde_json::from_str(&motors).unwrap();
        let first = &motors["motors"][0];
        assert!(first["following_error"].is_object() && first["actual_position"].is_object(), "{motors}");
        site.stop_daemon();
        assert!(site.log().contains("nothing else was asked than was recorded"), "{}", site.log());
    }
}

#[test]
fn e6_no_simulated_capture_differs_from_the_simulator_that_is_started_from_it() {
    for directory in captures() {
        let recording = Recording::read(&directory).unwrap();
        let family = recording.about.family(&directory).unwrap();
        let from = directory.display().to_string();
        let site = site(family, &["--from", &from], false);
        let asked = asked(family);
        let (again, _) = record(&site, &asked.iter().map(String::as_str).collect::<Vec<_>>(), TIME);
        let (status, stdout, stderr) = site.pmacctl(&["compare", &from, again.to_str().unwrap()]);
        // A real board may differ: then this says where.
        if recording.about.board == "file" {
            assert_eq!(status, 0, "{stdout}{stderr}");
        } else {
            println!("{stdout}{stderr}");
        }
    }
}

#[test]
#[ignore = "writes into tests/captures"]
fn make_the_captures_of_the_simulator() {
    for name in ["pmac", "turbo2"] {
        let family = Family::by_name(name).unwrap();
        let site = site(family, &["--family", name, "--dpram-startup"], true);
        let asked = asked(family);
        let (directory, _) = record(&site, &asked.iter().map(String::as_str).collect::<Vec<_>>(), TIME);
        let to = home().join(format!("simulator-{name}"));
        let _ = std::fs::remove_dir_all(&to);
        for path in ["", "images"] {
            std::fs::create_dir_all(to.join(path)).unwrap();
            for entry in std::fs::read_dir(directory.join(path)).unwrap().map(Result::unwrap) {
                if entry.file_type().unwrap().is_file() {
                    std::fs::copy(entry.path(), to.join(path).join(entry.file_name())).unwrap();
                }
            }
        }
    }
}
