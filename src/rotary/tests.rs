//! Both directions together: known vectors, refused texts, and generated programs.

use proptest::prelude::*;
use serde::Deserialize;

use super::*;
use crate::map::readings::RotaryCode2;

#[derive(Deserialize)]
struct Vectors {
    replies: Vec<Reply>,
    compile: Vec<Vector>,
}

#[derive(Deserialize)]
struct Reply {
    id: u32,
    send: String,
    expect: String,
}

#[derive(Deserialize)]
struct Vector {
    line: String,
    words: Vec<(String, String)>,
}

fn vectors() -> Vectors {
    serde_json::from_str(include_str!("../../tests/data/replies.json")).unwrap()
}

/// Settings that say where the code of ABS, INC and FRAX stands.
fn told() -> Settings {
    Settings { rotary_code2: Some(RotaryCode2::Bit12), ..Settings::default() }
}

fn words(text: &str) -> Vec<(u32, u32)> {
    match compile(text.as_bytes(), &told()) {
        Ok(compiled) => compiled.program.words().collect(),
        Err(refused) => panic!("{text}: {:?}", refused.errors.listed),
    }
}

/// The errors of a text as `line:column: reason`.
fn errors(text: &str) -> Vec<String> {
    let refused = compile(text.as_bytes(), &told()).unwrap_err();
    refused.errors.listed.iter().map(ToString::to_string).collect()
}

fn text(words: &[(u32, u32)]) -> String {
    let lines = decompile(words, &told()).unwrap().program.lines;
    lines.iter().map(|line| line.text() + "\n").collect()
}

#[test]
fn every_known_vector_compiles_to_its_words_and_back() {
    let vectors = vectors().compile;
    assert!(vectors.len() >= 54);
    for vector in vectors {
        let number = |digits: &String| u32::from_str_radix(digits, 16).unwrap();
        let expected: Vec<(u32, u32)> = vector.words.iter().map(|(a, b)| (number(a), number(b))).collect();
        assert_eq!(words(&vector.line), expected, "{}", vector.line);
        assert_eq!(words(&text(&expected)), expected, "{}", vector.line);
        assert!(decompile(&expected, &told()).unwrap().notes.is_empty());
    }
}

#[test]
fn every_text_that_must_be_refused_is() {
    let refused: Vec<Reply> =
        vectors().replies.into_iter().filter(|reply| reply.expect == "REJECT").collect();
    assert!(refused.len() >= 7);
    for reply in refused {
        assert!(!errors(&reply.send).is_empty(), "{}: {}", reply.id, reply.send);
    }
}

#[test]
fn texts_that_a_rotary_buffer_takes_as_ascii_are_taken() {
    for text in [
        "X10 Y20 F5 M3",
        "X10^-0.01 Y5.43^0.05",
        "B10^200 C20 X10",
        "LINEAR ABS",
        "CIRCLE 1",
        "FRAX(X,Y,Z)",
        "M20|=$01",
        "M875 |= $FF00",
        "INC (A, B, C)",
        "K33.333",
        "x+10y- 5",
        "G01X1.5Y-2M08",
        "nrmi0.866j0.500",
        "HOMEZ 1..3,5",
        "Dis Plc 0..3,7",
        "P1=+5 Q2=-$10",
    ] {
        words(text);
    }
}

#[test]
fn long_and_short_names_have_the_same_words() {
    for (long, short) in [
        ("LINEAR", "LIN"),
        ("RAPID", "RPD"),
        ("CIRCLE1", "CIR1"),
        ("NORMAL I1", "NRM I1"),
        ("NORMAL I1", "NORM I1"),
        ("BLOCKSTART", "BSTART"),
        ("BLOCKSTOP", "BSTOP"),
        ("TSELECT5", "TSEL5"),
        ("DWELL5", "DWE5"),
        ("DELAY5", "DLY5"),
        ("HOME5", "HM5"),
        ("HOMEZ5", "HMZ5"),
        ("ENABLE PLC5", "ENAPLC5"),
        ("DISABLE PLC5", "DISPLC5"),
    ] {
        assert_eq!(words(long), words(&short.to_lowercase()), "{long}");
    }
}

#[test]
fn canonical_text_is_short() {
    let canonical = |source: &str| text(&words(source)).trim_end().to_owned();
    for (source, expected) in [
        ("linear abs x10y-3.250 ; a move", "LIN ABS X10 Y-3.25"),
        ("X1000:50 Y+5^-0.5", "X1000:50 Y5^-0.5"),
        ("INC(Z,A,R) FRAX(X,Y,Z,U,V,W,A,B,C)", "INC(A,Z,R) FRAX"),
        ("HOME8,1..3 ENABLE PLC 31,30", "HM1..3,8 ENA PLC 30,31"),
        ("CC0 TSELECT0 P100=.5 M20|=$FE", "CC0 TSEL0 P100=0.5 M20|=254"),
        ("CALL20.15 G01 DWELL250.5", "CALL20.15 G1 DWE250.5"),
    ] {
        assert_eq!(canonical(source), expected);
    }
}

#[test]
fn lines_and_places_are_those_of_the_text() {
    let source = "; a comment\n\n  LINEAR F5 // modes\r\n\tX10Y20:5\n";
    let program = compile(source.as_bytes(), &told()).unwrap().program;
    let places: Vec<(u32, u32, &str)> =
        program.commands().map(|(line, command)| (line, command.column, command.text.as_str())).collect();
    assert_eq!(places, [(3, 3, "LINEAR"), (3, 10, "F5"), (4, 2, "X10"), (4, 5, "Y20"), (4, 8, ":5")]);
    let starts: Vec<bool> = program.words().map(|(word1, _)| word1 & START_OF_LINE != 0).collect();
    assert_eq!(starts, [true, false, true, false, false]);
    assert_eq!(program.lines.iter().map(|line| line.column).collect::<Vec<_>>(), [3, 2]);
    let document = serde_json::to_value(program.documents().next().unwrap()).unwrap();
    let expected = serde_json::json!(
        {"line": 3, "column": 3, "text": "LINEAR", "word1": "010F80", "word2": "000000"}
    );
    assert_eq!(document, expected);
}

#[test]
fn every_reason_has_its_place() {
    for (text, expected) in [
        ("X1 IF (P1>0)", "1:4: IF cannot be sent"),
        ("\nENDWHILE", "2:1: ENDWHILE cannot be sent"),
        ("GOTO 10", "1:1: GOTO cannot be sent"),
        ("CMD\"&1B1R\"", "1:1: CMD cannot be sent: text"),
        ("N100 X5", "1:1: N cannot be sent"),
        ("O5", "1:1: O cannot be sent"),
        ("WAIT", "1:1: WAIT cannot be sent: its binary code is not implemented"),
        ("NOFRAX(X)", "1:1: NOFRAX cannot be sent: it has no binary code"),
        ("FRAX2(X)", "1:1: FRAX2 cannot be sent"),
        ("ENABLE PLCC 1", "1:8: PLCC cannot be sent"),
        ("CC3", "1:3: 3: CC takes whole numbers from 0 to 2"),
        ("OPEN ROT", "1:1: OPEN is an on-line command"),
        ("#1J+", "1:1: # is an on-line command"),
        ("M5->X:$C000", "1:1: M-> is an on-line command"),
        ("X(P1)", "1:2: an expression"),
        ("X5+3", "1:3: an expression"),
        ("P1=SIN(5)", "1:4: an expression"),
        ("P1=2^3", "1:5: an expression"),
        ("P1=P2", "1:4: a variable as data"),
        ("XP1", "1:2: a variable as data"),
        ("P1..10=5", "1:1: a range of variables"),
        ("I5=*", "1:4: the default value"),
        ("P1024=5", "1:1: P1024: variable numbers"),
        ("M1.5=5", "1:1: M1.5: variable numbers"),
        ("P5|=1", "1:3: |= is for M-variables only"),
        ("Q5==1", "1:3: == is for M-variables only"),
        ("X", "1:1: X needs a constant"),
        ("Y5 X=3", "1:4: X needs a constant"),
        ("Y5 X P1=3", "1:4: X needs a constant"),
        ("P1=$1000000000000", "1:4: a hexadecimal constant has 12 digits at most"),
        ("HOME9", "1:5: 9: HOME takes whole numbers from 1 to 8"),
        ("HM", "1:1: HOME needs motor numbers"),
        ("HOME3..1", "1:5: 3..1: a range begins with the smaller number"),
        ("ENABLE PLC 32", "1:12: 32: ENABLE takes whole numbers from 0 to 31"),
        ("DISABLE 5", "1:1: DISABLE must be followed by PLC"),
        ("CIRCLE3", "1:7: 3: CIRCLE takes whole numbers from 1 to 2"),
        ("TSEL1024", "1:5: 1024: TSELECT takes whole numbers from 0 to 1023"),
        ("ADIS-1", "1:5: -1: ADIS takes whole numbers from 0 to 1023"),
        ("DWELL-1", "1:6: -1: DWELL takes 0 to 8388607"),
        ("TA8388608", "1:3: 8388608: TA takes 0 to 8388607"),
        ("PVT0", "1:4: 0: PVT takes numbers above 0"),
        ("F-5", "1:2: -5: F takes numbers above 0"),
        ("G1000", "1:2: 1000: G takes 0 to below 1000"),
        ("X4294967296", "1:2: 4294967296: float too large"),
        ("P1=$FFFFFFFFFFFF", "1:4: $FFFFFFFFFFFF: float too large"),
        ("F5:3", "1:3: : stands only after an axis"),
        ("X5:3^2", "1:5: ^ stands only after an axis"),
        ("NORMAL X5", "1:1: NORMAL needs one or more of I, J, K"),
        ("PSET", "1:1: PSET needs one or more axes"),
        ("ABS()", "1:5: the list of ABS"),
        ("FRAX(X,R)", "1:8: the list of FRAX"),
        ("INC(X", "1:6: the list of INC"),
        ("X1 5", "1:4: 5: a number without a command"),
        ("PLC 5", "1:1: PLC does not begin"),
        ("=5", "1:1: = does not begin"),
        ("X5 é", "1:4: the character é"),
        ("X5 \u{7}", "1:4: the character 0x07"),
    ] {
        let errors = errors(text);
        assert_eq!(errors.len(), 1, "{text}: {errors:?}");
        assert!(errors[0].starts_with(expected), "{text}: {}", errors[0]);
    }
}

#[test]
fn one_run_tells_all_errors() {
    let text = "X(P1) Y(P2)\nX5 Y6\nHOME9,10 G2000\nCMD\"R\" N5 Z\n";
    let places: Vec<String> =
        errors(text).iter().map(|error| error.splitn(3, ':').take(2).collect::<Vec<_>>().join(":")).collect();
    assert_eq!(places, ["1:2", "1:8", "3:5", "3:7", "3:11", "4:1", "4:8", "4:11"]);
}

#[test]
fn lost_digits_are_warned_of_where_a_mantissa_is_short() {
    let warnings = |text: &str| {
        let warnings = compile(text.as_bytes(), &told()).unwrap().warnings.listed;
        warnings.iter().map(ToString::to_string).collect::<Vec<_>>()
    };
    let expected = "2:4: 123456789 loses precision: P= has a 24-bit mantissa, 123456784 is sent";
    assert_eq!(warnings("X1\nP1=123456789"), [expected]);
    assert_eq!(warnings("DWELL0.333333333 TA100.00001 X1:0.123456789").len(), 3);
    assert!(warnings("X123456789.123456 CALL20.12345 P1=0.1 DWELL250.5 P2=8388607 TM0.1").is_empty());
    assert_eq!(
        warnings("X0.0000000001"),
        ["1:2: 0.0000000001 is nearer to zero than any number of the format: 0 is sent"]
    );
    assert_eq!(warnings("X1E3").len(), 1);
    assert!(warnings("X1 E3").is_empty());
}

#[test]
fn a_number_has_to_be_in_range_as_it_is_sent_too() {
    for text in ["F0.0000000001", "PVT0.0000000001", "CALL32767.99999999999", "G999.999999999999"] {
        let found = errors(text);
        assert_eq!(found.len(), 1, "{text}: {found:?}");
    }
    // If the range includes 0, the compiler sends 0 with a warning.
    for text in ["X0.0000000001", "F0.000000001", "CALL32767.9999"] {
        assert!(compile(text.as_bytes(), &told()).is_ok(), "{text}");
    }
}

#[test]
fn a_line_longer_than_the_buffer_is_refused() {
    let settings = Settings { buffer_words: 8, ..Settings::default() };
    assert!(compile(b"X1 Y2", &settings).is_ok());
    let refused = compile(b"X1\n  X1 Y2 Z3", &settings).unwrap_err();
    assert_eq!(
        refused.errors.listed[0].to_string(),
        "2:3: 3 commands in a line: a buffer of 8 words takes 2; split the line"
    );
}

#[test]
fn abs_inc_and_frax_go_before_the_first_move_of_a_stream_or_their_code_is_told() {
    let untold = Settings::default();
    for (text, modes, words) in [
        ("LINEAR INC F5 P1=3\nABS(X,R) X10 Y5\nX5", &["INC", "ABS(X,R)"][..], 6),
        ("INC\nFRAX (X , Y)", &["INC", "FRAX(X,Y)"], 0),
        ("DWELL5 X1", &[], 2),
    ] {
        let (compiled, before) = compile_stream(text.as_bytes(), &untold).unwrap();
        assert_eq!(
            (before, compiled.program.words().count()),
            (modes.iter().map(ToString::to_string).collect(), words)
        );
        let starts = compiled.program.lines.iter().map(|line| line.commands[0].word1 & START_OF_LINE != 0);
        assert!(starts.into_iter().all(|starts| starts), "{text}");
        let refused = compile(text.as_bytes(), &untold);
        assert_eq!(refused.is_err(), !modes.is_empty(), "without a stream there is no line before it");
    }
    for (text, place) in [
        ("X10 ABS", "1:5"),
        ("G91\n\nABS", "3:1"),
        ("CALL5 INC", "1:7"),
        ("HOME1 INC", "1:7"),
        ("STOP FRAX", "1:6"),
        ("PSET X0 ABS", "1:9"),
        ("NORMAL K-1 INC(R)", "1:12"),
    ] {
        let error = compile_stream(text.as_bytes(), &untold).unwrap_err().errors.listed[0].to_string();
        assert!(error.starts_with(place) && error.contains("rotary_code2"), "{error}");
        let (compiled, before) = compile_stream(text.as_bytes(), &told()).unwrap();
        assert!(
            before.is_empty() && compiled.program.words().next().is_some(),
            "where it is told the stream has them"
        );
    }
}

#[test]
fn the_bit_wise_assignments_whose_codes_are_not_sure_are_refused() {
    for text in ["M20^=$FF", "M20 &= $FE"] {
        let error = &errors(text)[0];
        assert!(
            error.contains("the manual gives its binary code in two ways; send it as an on-line command"),
            "{error}"
        );
    }
    assert_eq!(errors("P1^=3"), ["1:3: ^= is for M-variables only"]);
}

fn number() -> impl Strategy<Value = String> {
    prop_oneof![r"-?[0-9]{1,9}", r"-?[0-9]{1,6}\.[0-9]{1,9}", r"-?\.[0-9]{1,12}", r"-?\$[0-9A-Fa-f]{1,6}",]
}

fn positive() -> impl Strategy<Value = String> {
    prop_oneof![r"[1-9][0-9]{0,5}", r"[1-9][0-9]{0,2}\.[0-9]{0,5}"]
}

/// A list of numbers from `least` to `most`, with some ranges.
fn list(least: u32, most: u32) -> impl Strategy<Value = String> {
    prop::collection::vec((least..=most, least..=most, any::<bool>()), 1..4).prop_map(|parts| {
        let part = |(a, b, single): (u32, u32, bool)| {
            if single { a.to_string() } else { format!("{}..{}", a.min(b), a.max(b)) }
        };
        parts.into_iter().map(part).collect::<Vec<_>>().join(",")
    })
}

/// A command of each shape, in one of its spellings.
fn statement() -> impl Strategy<Value = String> {
    let axes = prop::sample::subsequence(codes::AXES.to_vec(), 1..=9);
    let of = |names: &'static [&'static str]| prop::sample::select(names);
    prop_oneof![
        4 => ("[ABCUVWXYZabcuvwxyz]", number(), prop::option::of(("[:^]", number())))
            .prop_map(|(axis, n, mark)| format!("{axis}{n}{}", mark.map_or(String::new(), |(m, v)| m + &v))),
        2 => ("[EHIJKLPQRSr]", number()).prop_map(|(letter, n)| format!("{letter} {n}")),
        2 => ("[DGMTCALLFf]", "[1-9][0-9]{0,2}(\\.[0-9]{1,5})?").prop_map(|(letter, n)| letter + &n),
        1 => "CALL ?[1-9][0-9]{0,3}(\\.[0-9]{1,5})?",
        2 => (of(&["TA", "ts", "TM", "PVT", "DWELL", "DWE", "DLY", "DELAY", "CCR"]), positive())
            .prop_map(|(name, n)| format!("{name}{n}")),
        2 => ("[IMPQ]", 0..1024u32, number()).prop_map(|(letter, n, value)| format!("{letter}{n}={value}")),
        1 => (0..1024u32, of(&["|=", "=="]), number()).prop_map(|(n, o, v)| format!("M{n} {o} {v}")),
        1 => (of(&["CIRCLE", "CIR", "SPLINE"]), 1..3u32).prop_map(|(name, n)| format!("{name} {n}")),
        1 => (of(&["TSEL", "TSELECT", "ADIS", "AROT", "IDIS", "IROT"]), 0..1024u32)
            .prop_map(|(name, n)| format!("{name}{n}")),
        1 => "CC[0-2]",
        1 => of(&["LIN", "LINEAR", "RAPID", "rpd", "STOP", "BSTART", "BLOCKSTOP", "TINIT"]).prop_map(str::to_owned),
        1 => ("[IJK]", number()).prop_map(|(letter, n)| format!("NORMAL {letter}{n}")),
        1 => ("[XYZ]", number()).prop_map(|(letter, n)| format!("PSET {letter}{n}")),
        1 => (of(&["ABS", "INC", "FRAX"]), prop::option::of(axes)).prop_map(|(name, axes)| match axes {
            None => name.to_owned(),
            Some(axes) => {
                let axes: Vec<String> = axes.iter().map(|&axis| char::from(axis).to_string()).collect();
                format!("{name}({})", axes.join(", "))
            }
        }),
        1 => of(&["ABS(R)", "INC(X,R)"]).prop_map(str::to_owned),
        1 => (of(&["HOME", "HM", "HOMEZ", "HMZ"]), list(1, 8)).prop_map(|(name, list)| format!("{name}{list}")),
        1 => (of(&["ENABLE PLC", "DIS PLC"]), list(0, 31)).prop_map(|(name, list)| format!("{name} {list}")),
    ]
}

fn program() -> impl Strategy<Value = String> {
    let line = prop::collection::vec(statement(), 0..6).prop_map(|parts| parts.join(" "));
    prop::collection::vec(line, 1..6).prop_map(|lines| lines.join("\n"))
}

fn settings() -> impl Strategy<Value = Settings> {
    (20..50u8, 16..20u8, any::<bool>()).prop_map(|(exponent_bias, mode_code_bit, high)| Settings {
        exponent_bias,
        mode_code_bit,
        rotary_code2: Some(if high { RotaryCode2::Bit16 } else { RotaryCode2::Bit12 }),
        ..Settings::default()
    })
}

proptest! {
    #[test]
    fn programs_come_back_to_the_same_words(source in program(), settings in settings()) {
        let compiled = match compile(source.as_bytes(), &settings) {
            Ok(compiled) => compiled,
            // A large number may exceed a given bias; these programs have no other fault.
            Err(refused) => {
                let large = |error: &Placed<Reason>| matches!(error.what, Reason::TooLarge { .. });
                prop_assert!(refused.errors.listed.iter().all(large), "{source}: {:?}", refused.errors.listed);
                return Ok(());
            }
        };
        let words: Vec<(u32, u32)> = compiled.program.words().collect();
        let back = decompile(&words, &settings).unwrap();
        prop_assert!(back.notes.is_empty(), "{source}: {:?}", back.notes.listed);
        let text: String = back.program.lines.iter().map(|line| line.text() + "\n").collect();
        let again = compile(text.as_bytes(), &settings).unwrap().program;
        prop_assert_eq!(again.words().collect::<Vec<_>>(), words, "{} became {}", source, text);
        // The reported places are those of the commands in the canonical text.
        for ((_, told), (_, own)) in back.program.commands().zip(again.commands()) {
            prop_assert_eq!(told, own);
        }
    }

    #[test]
    fn no_bytes_panic(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let _ = compile(&bytes, &told());
    }

    #[test]
    fn nothing_made_of_the_language_panics(
        parts in prop::collection::vec(prop::sample::select(&[
            "X", "P", "M", "N", "1", "1024", "99999999999999999999", "$FF", "$", ".", "..", "(", ")", ",", "=", "==",
            "^=", "&=", "|=", ":", "^", "-", "+", "*", "->", "HOME", "ENABLE", "PLC", "ABS", "FRAX", "CIRCLE", "CC",
            "NORMAL", "PSET", "CMD", "\"", "IF", "SIN", "E", " ", "\n", ";", "//", "é", "#",
        ][..]), 0..40),
    ) {
        let text = parts.concat();
        if let Ok(compiled) = compile(text.as_bytes(), &told()) {
            let words: Vec<(u32, u32)> = compiled.program.words().collect();
            prop_assert!(decompile(&words, &told()).is_ok());
        }
    }

    #[test]
    fn no_words_panic_and_what_is_noted_is_all_that_differs(
        words in prop::collection::vec((any::<u32>(), any::<u32>()), 0..20),
    ) {
        let words: Vec<(u32, u32)> = words.into_iter().map(|(a, b)| (a & 0xFF_FFFF, b & 0xFF_FFFF)).collect();
        let sendable: Vec<(u32, u32)> = words
            .into_iter()
            .filter(|&(a, b)| Item::from_words(a, b, &told()).is_ok())
            .collect();
        let back = decompile(&sendable, &told()).unwrap();
        if back.notes.is_empty() {
            let text: String = back.program.lines.iter().map(|line| line.text() + "\n").collect();
            let again = compile(text.as_bytes(), &told()).unwrap().program;
            prop_assert_eq!(again.words().collect::<Vec<_>>(), sendable);
        }
    }
}
