//! A Turbo PMAC2's DPRAM in a file, with the daemon on it, up to `pmacctl`. [`board`] plays the board.

mod board;

use std::time::Duration;

use pmac_dpram::segment::{Counter, RegionId, Sample};
use serde_json::json;

use board::{GARBAGE, SERVO_HOST, SYSTEM_COUNT, Site};

fn list(motors: impl IntoIterator<Item = usize>) -> String {
    format!("{:?}", motors.into_iter().collect::<Vec<_>>())
}

#[test]
fn the_motors_of_a_turbo_board_reach_pmacctl() {
    let choices = [vec![1], vec![2, 17, 32], (1..=8).collect(), (1..=32).collect::<Vec<_>>()];
    for motors in choices {
        for reading in ["optimistic", "handshake"] {
            let chosen = list(motors.iter().copied());
            let mut site = Site::new(&format!(
                "functions = [\"servo\"]\nservo_reading = \"{reading}\"\n[servo]\nmotors = {chosen}\n"
            ));
            site.cycles(400);
            let mask = motors.iter().fold(0, |mask, motor| mask | 1_u32 << (motor - 1));
            assert_eq!(site.board().mask(), mask, "the host chooses: {chosen}");
            let shown = site.json(&["motors"]);
            assert_eq!(shown["servo"]["fresh"], true, "{shown}");
            let rows = shown["motors"].as_array().unwrap();
            assert_eq!(rows.len(), motors.len(), "{shown}");
            for (row, motor) in rows.iter().zip(&motors) {
                let raw = |name: &str| row[name]["raw"].as_i64();
                assert_eq!(row["motor"], json!(motor));
                assert_eq!(raw("actual_position"), Some(3_072_000 * *motor as i64), "{row}");
                assert_eq!(raw("following_error"), Some(-3072 * *motor as i64), "{row}");
                assert_eq!(row.get("commanded_position"), None, "section 2: Turbo has none");
            }
            let status = site.json(&["status"]);
            assert_eq!(status["board"]["family"], "turbo2");
            assert_eq!(status["condition"], "live", "{status}");
            assert_eq!(status["board"]["reported_motors"], json!(motors.iter().max()));
            assert_eq!(status["board"]["motors_of_reports"], json!(motors));
            let told = match motors[..] {
                [1] => "1 motor\n".to_owned(),
                [2, ..] => "3 motors: 2, 17, 32\n".to_owned(),
                _ => format!("{} motors\n", motors.len()),
            };
            let (_, text, _) = site.site.pmacctl(&["status"]);
            assert!(text.contains(&format!("\nreports         {told}")), "{text}");
            assert_eq!(status["socket"]["functions"], json!(["servo"]));
            assert_eq!((site.count(Counter::Missed), site.count(Counter::Lost)), (0, 0), "{reading}");
        }
    }
}

#[test]
fn motors_that_are_not_activated_are_not_shown() {
    let config = "ask_board = false\nfunctions = [\"servo\"]\n";
    let mut site = Site::with_board(config, |board| {
        board.motors = 4;
        // Of the others some hold zeros, and the rest what was there at power-on.
        (0..20 * 24).for_each(|word| board.put(0x0074 + 0x30 * 12 + 2 * word, 0));
    });
    site.cycles(400);
    let shown = site.json(&["motors"]);
    let rows = shown["motors"].as_array().unwrap();
    let numbers: Vec<_> = rows.iter().map(|row| row["motor"].as_u64().unwrap()).collect();
    assert_eq!(numbers, [1, 2, 3, 4], "{shown}");
    let (_, told, _) = site.site.pmacctl(&["doctor"]);
    assert!(told.contains("not activated (Ix00=0), and so not shown: #5, #6, "), "{told}");
    site.board().motors = 32;
    site.cycles(400);
    assert_eq!(site.json(&["motors"])["motors"].as_array().unwrap().len(), 32);
}

#[test]
fn words_of_motors_outside_the_mask_are_neither_read_nor_written() {
    let mut site = Site::new("functions = [\"servo\"]\n[servo]\nmotors = [3]\n");
    site.cycles(400);
    let segment = site.site.attach();
    let mut sample = Sample::new();
    segment.latest(RegionId::Servo, &mut sample).unwrap().unwrap();
    // The image begins at 0x0068 and ends with motor 3. Unread words are 0 there, and the board's are garbage.
    let words = sample.words();
    let first = (0x0074 - 0x0068) / 2;
    assert_eq!(words.len(), first + 3 * 24);
    assert!(words[first..first + 2 * 24].iter().all(|word| *word == 0), "{words:?}");
    assert!(words[first + 2 * 24..].iter().any(|word| *word != 0));
    drop(segment);
    site.site.stop_daemon();
    let bytes = std::fs::read(site.site.path("dpram")).unwrap();
    let changed = (0..bytes.len()).step_by(2).filter(|at| bytes[*at..at + 2] != [GARBAGE; 2]);
    let changed: Vec<_> = changed.filter(|at| !(0x00D4..0x0104).contains(at)).collect();
    // Host busy, timer, ready; the mask is as it was found. The test itself has cleared the background report's flag.
    assert_eq!(changed, [0x006A, 0x006C, 0x006E, 0x067A]);
    assert_eq!(site.board().word(SERVO_HOST), 0, "it is left as a board needs it");
}

#[test]
fn a_turbo_update_costs_the_words_of_the_masked_motors() {
    for count in [1, 8, 32] {
        for (reading, polls) in [("optimistic", 6), ("handshake", 10)] {
            let chosen = list(1..=count);
            let mut site = Site::new(&format!(
                "functions = [\"servo\"]\nservo_reading = \"{reading}\"\n[servo]\nmotors = {chosen}\n"
            ));
            site.cycles(1000);
            let counts =
                |site: &Site| [Counter::Updates, Counter::ServoAccesses].map(|what| site.count(what));
            let before = counts(&site);
            site.cycles(4000);
            let after = counts(&site);
            let [updates, accesses] = [0, 1].map(|index| after[index] - before[index]);
            assert_eq!(updates, 4000, "none is missed: {count} motors, {reading}");
            // What the function's table of costs has for an update, with one idle poll to find it.
            let needed = updates * (24 * count as u64 + polls);
            assert!(accesses * 100 <= needed * 105, "{count} motors, {reading}: {accesses} of {needed}");
            assert!(accesses >= updates * 24 * count as u64);
        }
    }
}

#[test]
fn the_coordinate_systems_of_a_turbo_board_reach_pmacctl() {
    let mut site = Site::new("functions = [\"servo\", \"background\"]\n[background]\nmotors = [1, 9, 16]\n");
    site.cycles(1000);
    assert_eq!(site.board().word(SYSTEM_COUNT), 16, "the highest that is read");
    let shown = site.json(&["coordinates"]);
    let rows = shown["coordinate_systems"].as_array().unwrap_or_else(|| panic!("{shown}"));
    let numbers: Vec<_> = rows.iter().map(|row| row["coordinate_system"].as_u64().unwrap()).collect();
    assert_eq!(numbers, [1, 9, 16], "{shown}");
    for (row, number) in rows.iter().zip(numbers) {
        assert_eq!(row["lines_remaining"], json!(6 + number), "{row}");
    }
}

#[test]
fn that_a_turbo_board_gathers_for_others_is_told() {
    let mut site = Site::with_board("", |_| ());
    site.cycles(8000);
    let gathers = |site: &Site| {
        let status = site.json(&["status"]);
        status["socket"]["enabled"].as_array().unwrap().contains(&json!("gather"))
    };
    assert!(!gathers(&site));
    // `???`: bit 19 of the first word, data are gathered; bit 19 of the second one, a motion buffer is open.
    site.board().global[0] = 1 << 19;
    site.cycles(400);
    assert!(gathers(&site));
}

#[test]
fn a_function_that_is_not_there_is_refused_by_name() {
    let mut site = Site::new("");
    site.cycles(400);
    let status = site.json(&["status"]);
    assert_eq!(
        status["socket"]["functions"],
        json!(["ascii", "servo", "background", "variables", "rotary", "gather"])
    );
    let (code, stdout, _) = site.site.pmacctl(&["status"]);
    assert!(
        code != 2 && stdout.contains("functions       ascii servo background variables rotary gather\n"),
        "{stdout}"
    );
    let (code, _, stderr) = site.site.pmacctl(&["panel", "jog+", "1"]);
    let text = "pmacd does not use the function `panel` on a Turbo PMAC2: no text tells of a firmware that acts on its words";
    assert!(code != 0 && stderr.contains(text), "{stderr}");
    let (_, _, stderr) = site.site.pmacctl(&["jog", "1", "+"]);
    assert!(stderr.contains("command lines do what the panel's other keys do: #1J+, #1J-, #1J="), "{stderr}");
    let (_, stdout, _) = site.site.pmacctl(&["doctor"]);
    assert!(stdout.contains("pmacd does not use panel on a Turbo PMAC2"), "{stdout}");
}

#[test]
fn the_lines_of_a_set_up_are_for_the_daemons_board() {
    let mut site = Site::new("");
    site.cycles(400);
    for what in [&["enable", "servo"][..], &["isa", "--address", "0xD4000"]] {
        let mut printed = |family: &[&str]| site.running(&[&["setup"], what, family].concat());
        let turbos = printed(&["--family", "turbo2"]);
        assert_eq!(printed(&[]), turbos);
        assert_ne!(printed(&["--family", "pmac"]), turbos);
    }
}

/// I48 alone starts a Turbo board's report, so an ENDGATHER does not end it.
#[test]
fn a_gather_buffer_that_is_refused_says_what_ends_the_gather_in_its_way() {
    let mut site = Site::new("");
    site.cycles(400);
    site.board().refuses = Some("DEFINE");
    let (code, _, stderr) = site.running(&["gather", "-s", "1.actual_position", "--once", "-o", "-"]);
    assert!(code == 1 && stderr.contains("`pmacctl send ENDGATHER` ends that\n"), "{stderr}");
}

/// Nothing reports whether a program buffer is open, so the board is first asked for its size, twice in a line.
#[test]
fn a_board_without_a_report_that_tells_of_buffers_is_asked_and_answers_at_once() {
    let mut site = Site::with_board("functions = [\"ascii\", \"servo\"]\n", |_| ());
    site.cycles(6000);
    assert_eq!(site.running(&["send", "P1"]), (0, "1.5\n".to_owned(), String::new()));
    assert_eq!(site.json(&["status"])["board"]["type"], "TURBO2, X4");
}

#[test]
fn command_lines_go_through_a_turbo_boards_dpram() {
    let mut site = Site::with_board("", |_| ());
    site.cycles(8000);
    assert_eq!(site.board().parts, 0, "questions of our own fit one part");
    let status = site.json(&["status"]);
    assert_eq!(status["board"]["type"], "TURBO2, X4", "{status}");
    assert_eq!(status["board"]["firmware"], "1.947");
    // Scales of all 32 motors: position = raw / (Ixx08*32).
    let shown = site.json(&["motors"]);
    assert_eq!(shown["motors"][31]["actual_position"]["value"], json!(32000.0), "{shown}");
    assert_eq!(site.running(&["send", "P1"]), (0, "1.5\n".to_owned(), String::new()));
    assert_eq!(site.running(&["send", "P1=1.5"]), (0, String::new(), String::new()));
    let (code, _, stderr) = site.running(&["send", "HELLO"]);
    assert!(code == 1 && stderr.starts_with("ERR003: "), "{code} {stderr}");
    // The host completes a line of more than 159 characters in a second load, as on PMAC (DPRAM manual p. 28).
    let long = format!("Q{}", "1".repeat(199));
    assert_eq!(site.running(&["send", &long]).1, "200\n");
    assert_eq!(site.board().parts, 1);
    let (code, ..) = site.running(&["kill"]);
    assert_eq!((code, site.board().characters.last()), (0, Some(&0x0B)));
}

#[test]
fn a_program_buffer_that_the_background_report_shows_open_takes_no_line_of_others() {
    let mut site = Site::with_board("", |_| ());
    site.cycles(8000);
    // Open: 19 a motion buffer, 18 a rotary buffer for text, 17 a PLC buffer; 20, for binary lines, takes no text (Turbo Software
    // Reference p. 290).
    for bit in 17..=19 {
        site.board().global[1] = 1 << bit;
        site.cycles(400);
        let (code, _, stderr) = site.running(&["send", "P1"]);
        assert!(code != 0 && stderr.contains("opened by somebody else"), "bit {bit}: {code} {stderr}");
        // Bits 16 and 21 say other things, and 20 lets no text in.
        site.board().global[1] = 1 << 16 | 1 << 21 | 1 << 20;
        site.cycles(400);
        assert_eq!(site.running(&["send", "P1"]).1, "1.5\n", "bit {bit}");
    }
}

#[test]
fn a_message_of_a_program_is_told_without_its_mark() {
    let mut site = Site::with_board("", |_| ());
    site.cycles(8000);
    let mut messages = site.site.connection().messages().unwrap();
    site.cycles(100);
    // I64=1 puts STX before it (Turbo Software Reference p. 67); 2 in bits 9-8 is a program's SEND (Turbo User Manual p. 406).
    site.board().responses.push_back((0x020D, "\u{2}HELLO".to_owned()));
    site.cycles(400);
    let message = messages.next_within(Duration::from_secs(10)).unwrap().expect("a message");
    assert_eq!(message.text, "HELLO");
}

#[test]
fn a_turbo_board_gathers() {
    let mut site = Site::with_board("", |_| ());
    site.cycles(8000);
    let arguments =
        ["gather", "--source", "1.following_error", "--source", "X:$9D", "--seconds", "1", "-o", "-"];
    let (code, stdout, stderr) = site.running(&arguments);
    assert_eq!(code, 0, "{stderr}");
    let rows: Vec<Vec<f64>> = stdout
        .lines()
        .filter(|line| line.starts_with(|first: char| first.is_ascii_digit()))
        .map(|line| line.split(',').map(|value| value.parse().unwrap()).collect())
        .collect();
    assert_eq!(rows.len(), 2000, "a second of half milliseconds: {stdout:.400}");
    for (row, sample) in rows.iter().zip(1..) {
        let values = &row[row.len() - 2..];
        assert_eq!(values, [-f64::from(sample), f64::from(sample)], "none is lost");
    }
    assert!(!site.board().gathers, "ENDGATHER was sent");
    site.cycles(400);
    assert_eq!(site.json(&["motors"])["servo"]["fresh"], true, "and has not ended the servo report");
}

#[test]
fn background_variables_of_a_turbo_board_are_read() {
    let mut site = Site::with_board("", |_| ());
    site.cycles(8000);
    let (code, stdout, stderr) =
        site.running(&["variable", "watch", "Y:$C0", "X:$9D", "D:$8B", "--count", "1", "--json"]);
    assert_eq!(code, 0, "{stderr}");
    let shown: serde_json::Value = serde_json::from_str(&stdout).unwrap();
    let values: Vec<_> =
        shown["values"].as_array().unwrap().iter().map(|value| value["value"].clone()).collect();
    // The played board answers with the entry itself: the kinds are $00, $20 and $10.
    assert_eq!(values, [json!(0xC0), json!(0x20_009D), json!(0x10_008B)], "{shown}");
    // No text says where address bits 18-16 stand in an entry, nor where the parts of a record to write.
    let (code, _, stderr) = site.running(&["variable", "watch", "X:$78000", "--count", "1"]);
    assert!(code == 1 && stderr.contains("send `RX$078000` instead"), "{code} {stderr}");
    let (code, _, stderr) = site.running(&["variable", "set", "Y:$770=1"]);
    assert!(code == 1 && stderr.contains("send a line instead (`WX$ADDRESS,VALUE`"), "{code} {stderr}");
}
