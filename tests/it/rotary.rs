//! `pmacctl rotary` as a program: what it prints where, and how it ends.

use serde_json::json;

use crate::support::rig::{Ran, pmacctl_with};

fn rotary(arguments: &[&str]) -> Ran {
    pmacctl_with([&["rotary"], arguments].concat())
}

/// A directory with one file of this text, and the file's path.
fn file(text: &str) -> (tempfile::TempDir, String) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("program.pmc");
    std::fs::write(&path, text).unwrap();
    let path = path.to_str().unwrap().to_owned();
    (directory, path)
}

#[test]
fn a_program_is_encoded_to_words_and_decoded_to_text() {
    let (_directory, program) = file("; start\nLINEAR ABS(X,Y)\n\tX10 Y-3.25 ; there\nDWELL250\n");
    let told = ["--set", "rotary_code2=bit16"];
    let encoded = rotary(&[&["encode", &program, "--json"], &told[..]].concat());
    assert_eq!((encoded.code, encoded.stderr.as_str()), (Some(0), ""));
    let untold = rotary(&["encode", &program]);
    assert_eq!((untold.code, untold.stdout.as_str()), (Some(1), ""));
    assert!(
        untold.stderr.contains(":2:8: ABS cannot be sent") && untold.stderr.contains("rotary check"),
        "{untold:?}"
    );
    let command = |line, column, text, word1, word2| json!({"line": line, "column": column, "text": text, "word1": word1, "word2": word2});
    let expected = json!([
        command(2, 1, "LINEAR", "010F80", "000000"),
        command(2, 8, "ABS(X,Y)", "000782", "140000"),
        command(3, 2, "X10", "000E23", "500000"),
        command(3, 6, "Y-3.25", "000661", "980000"),
        command(4, 1, "DWELL250", "440F27", "7D0000"),
    ]);
    assert_eq!(encoded.json(), expected);

    let plain = rotary(&[&["encode", &program], &told[..]].concat());
    let text = "LIN ABS(X,Y)\nX10 Y-3.25\nDWE250\n";
    for words in [&encoded.stdout, &plain.stdout] {
        let (_directory, words) = file(words);
        let decoded = rotary(&[&["decode", &words], &told[..]].concat());
        assert_eq!((decoded.code, decoded.stdout.as_str(), decoded.stderr.as_str()), (Some(0), text, ""));
    }
    let decoded = rotary(&["decode", "000E23", "500000", "000661", "980000"]);
    assert_eq!((decoded.code, decoded.stdout.as_str()), (Some(0), "X10 Y-3.25\n"));
}

#[test]
fn what_cannot_be_sent_is_told_with_its_place_and_nothing_is_printed() {
    let (_directory, program) = file("X10\nIF (P1>0)\n  X(P1) Y5 HOME9\nP1=123456789\n");
    let refused = rotary(&["encode", &program, "--json"]);
    assert_eq!((refused.code, refused.stdout.as_str()), (Some(1), ""));
    let lines: Vec<&str> = refused.stderr.lines().collect();
    let starts =
        [":4:4: warning: 123456789 loses precision", ":2:1: IF", ":3:4: an expression", ":3:16: 9: HOME"];
    assert_eq!(lines.len(), starts.len(), "{lines:?}");
    for (line, start) in lines.iter().zip(starts) {
        assert!(line.starts_with(&format!("{program}{start}")), "{line}");
    }
}

#[test]
fn lost_precision_is_a_warning() {
    let (_directory, program) = file("DWELL0.333333333");
    let encoded = rotary(&["--json", "encode", &program]);
    assert_eq!(encoded.code, Some(0));
    assert_eq!(encoded.json()[0]["word1"], "440F1E");
    assert!(encoded.stderr.starts_with(&format!("{program}:1:6: warning: 0.333333333 loses precision")));
}

#[test]
fn a_request_that_cannot_be_made_ends_with_two() {
    let (_directory, program) = file("X10");
    for arguments in [
        &["encode", "/nonexistent/program"][..],
        &["encode", "/"],
        &["encode", &program, "--set", "exponent_bias=64"],
        &["encode", &program, "--set", "bias=1"],
        &["decode", &program],
        &["decode", "000E23", "500000", "000661"],
    ] {
        let ran = rotary(arguments);
        assert_eq!((ran.code, ran.stdout.as_str()), (Some(2), ""), "{arguments:?}: {}", ran.stderr);
        assert_eq!(ran.stderr.lines().count(), 1, "{arguments:?}: {}", ran.stderr);
    }
}

#[test]
fn words_that_are_no_command_are_refused() {
    let ran = rotary(&["decode", "000E23", "500000", "080F80", "000000"]);
    assert_eq!((ran.code, ran.stdout.as_str()), (Some(1), ""));
    assert_eq!(ran.stderr, "words: pair 2 (080F80 000000): WAIT is not implemented in PMAC\n");
}

#[test]
fn the_uncertain_points_are_settings() {
    let (_directory, program) = file("X10 M1|=1 LINEAR");
    let ran = rotary(&["encode", &program, "--set", "exponent_bias=32", "--set", "mode_code_bit=18"]);
    assert_eq!(
        ran.stdout,
        "000E24 500000  ; 1:1 X10\n0043E1 400000  ; 1:5 M1|=1\n040780 000000  ; 1:11 LINEAR\n"
    );
}
