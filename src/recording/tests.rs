//! Recordings: the reader gets back what the writer wrote, and refuses damaged files with the place.

use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use super::read::Lines;
use super::{
    About, Access, Accesses, Answer, FORMAT, Image, ImageAt, MOST_IMAGES, Op, Recording, Writer, files,
};
use crate::map::{FAMILIES, HostOffset};
use crate::protocol::BoardSettings;

fn about() -> About {
    About {
        format: FORMAT,
        program: "pmacctl 0.1.0".into(),
        pmacd: "0.1.0".into(),
        taken: "2026-11-25T12:00:00.000000Z".into(),
        began_ns: 1000,
        name: "pmac0".into(),
        board: "sim".into(),
        family: FAMILIES[0].name.into(),
        board_type: Some("PMAC1".into()),
        firmware: None,
        dpram_bytes: FAMILIES[0].length,
        servo_period_ns: Some(442_726),
        settings: BoardSettings::default(),
        updates: 7,
        accesses: 0,
        dropped: 3,
        cut_short: Some("still being written".into()),
        left_out: vec!["motion programs".into()],
    }
}

fn accesses() -> Vec<Access> {
    let access =
        |t_ns, op, bytes, width, value| Access { t_ns, op, offset: HostOffset::new(bytes), width, value };
    vec![
        access(1000, Op::Read, 0x24, 16, 0xFFFF),
        access(1000, Op::Read, 0x28, 32, 0xFFFF_FFFE),
        access(2000, Op::Write, 0x3FFE, 16, 1),
    ]
}

/// A recording in `directory`, whole.
fn write(directory: &Path) -> Recording {
    let words: Vec<u16> = (0..FAMILIES[0].length / 2).map(|word| word as u16 ^ 0xA5A5).collect();
    let answers = [
        Answer { line: "TYPE".into(), reply: vec!["PMAC1".into()], refused: None },
        Answer { line: "I9999".into(), reply: vec![], refused: Some("ERR003".into()) },
    ];
    let system = json!({ "kernel": "6.1" });
    let mut writer = Writer::create(directory, &about()).unwrap();
    accesses().iter().for_each(|access| writer.access(access).unwrap());
    answers.iter().for_each(|answer| writer.answer(answer).unwrap());
    for t_ns in [1000, 3000] {
        writer.image(t_ns, &words).unwrap();
    }
    writer.variables("I0=0\n").unwrap();
    writer.system(&system).unwrap();
    writer.finish(About { cut_short: None, ..about() }).unwrap();
    Recording {
        about: About { cut_short: None, accesses: 3, ..about() },
        images: [1000, 3000].map(|t_ns| Image { t_ns, words: words.clone() }).to_vec(),
        accesses: accesses(),
        answers: answers.to_vec(),
        variables: Some("I0=0\n".into()),
        system,
    }
}

fn fault(directory: &Path) -> String {
    let text = Recording::read(directory).unwrap_err().to_string();
    text.strip_prefix(&format!("{}/", directory.display())).unwrap_or(&text).to_owned()
}

#[test]
fn a_recording_comes_back_as_it_was_written() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path().join("new/capture");
    let written = write(&at);
    assert_eq!(Recording::read(&at).unwrap(), written);
    let trace = fs::read_to_string(at.join(files::TRACE)).unwrap();
    let first = "{\"t\":1000,\"op\":\"r\",\"offset\":\"0x0024\",\"width\":16,\"value\":65535}\n";
    assert!(trace.starts_with(first), "{trace}");
    assert_eq!(fs::read(at.join("images/0001.bin")).unwrap()[..4], [0xA5, 0xA5, 0xA4, 0xA5]);
    let error = Writer::create(&at, &about()).unwrap_err().to_string();
    assert!(error.ends_with("not empty: name a directory that is not there yet"), "{error}");
    // A recording need not have every file.
    for name in [files::TRACE, files::ANSWERS, files::IMAGE_TIMES, files::VARIABLES, files::SYSTEM] {
        fs::remove_file(at.join(name)).unwrap();
    }
    let bare = Recording::read(&at).unwrap();
    assert_eq!(
        (bare.accesses.len(), bare.images.len(), bare.variables, bare.system),
        (0, 0, None, Value::Null)
    );
}

#[test]
fn a_recording_that_was_cut_short_is_read_up_to_there_and_says_so() {
    let directory = tempfile::tempdir().unwrap();
    let mut writer = Writer::create(directory.path(), &about()).unwrap();
    writer.answer(&Answer { line: "TYPE".into(), reply: vec![], refused: None }).unwrap();
    drop(writer);
    let trace = directory.path().join(files::TRACE);
    let line = serde_json::to_string(&accesses()[0]).unwrap();
    fs::write(&trace, format!("{line}\n{}", &line[..20])).unwrap();
    let read = Recording::read(directory.path()).unwrap();
    assert_eq!(read.about.cut_short.as_deref(), Some("still being written"));
    assert_eq!((read.accesses.as_slice(), read.answers.len()), (&accesses()[..1], 1));
}

#[test]
fn a_damaged_recording_is_refused_with_file_and_line() {
    let directory = tempfile::tempdir().unwrap();
    assert!(fault(directory.path()).starts_with("about.json: not there: this is no capture"));
    let line = serde_json::to_string(&accesses()[2]).unwrap();
    let changed = |from: &str, to: &str| line.replace(from, to);
    let early = serde_json::to_string(&accesses()[0]).unwrap();
    for (text, wanted) in [
        (format!("{line}\n{line}"), "trace.ndjson:2: the line has no end"),
        (format!("{line}\n{}\n", &line[..20]), "trace.ndjson:2: EOF"),
        (format!("{line}\n{early}\n"), "trace.ndjson:2: earlier than the access before it"),
        (changed("16", "8") + "\n", "trace.ndjson:1: a width of 8 bits"),
        (changed("16", "32") + "\n", "trace.ndjson:1: 0x3FFE is outside the DPRAM of 16384 bytes"),
        (changed("0x3FFE", "0xFFFFFFFE") + "\n", "trace.ndjson:1: 0xFFFFFFFE is outside"),
        (
            changed("0x3FFE", "0x3FFF") + "\n",
            "trace.ndjson:1: invalid value: string \"0x3FFF\", expected an even",
        ),
        (changed(":1}", ":65536}") + "\n", "trace.ndjson:1: 65536 does not fit 16 bits"),
        (changed("}", ",\"more\":1}") + "\n", "trace.ndjson:1: unknown field `more`"),
        ("x".repeat(70_000), "trace.ndjson:1: longer than 65536 bytes"),
    ] {
        let at = tempfile::tempdir().unwrap();
        write(at.path());
        fs::write(at.path().join(files::TRACE), &text).unwrap();
        let fault = fault(at.path());
        assert!(fault.starts_with(wanted), "{fault}, not {wanted}");
    }
    let at = directory.path().join("other");
    write(&at);
    let image = at.join("images/0001.bin");
    let bytes = fs::read(&image).unwrap();
    for wrong in [&bytes[1..], &[bytes.as_slice(), &[0]].concat()] {
        fs::write(&image, wrong).unwrap();
        assert!(fault(&at).starts_with("images/0001.bin: not the 16384 bytes"), "{}", fault(&at));
    }
    fs::write(at.join(files::IMAGE_TIMES), "{\"t\":1,\"file\":\"../x\"}\n").unwrap();
    assert_eq!(fault(&at), "images.ndjson:1: an image lies in the directory of images");
    let about = fs::read_to_string(at.join(files::ABOUT)).unwrap();
    fs::write(at.join(files::ABOUT), about.replace("\"format\": 1", "\"format\": 2")).unwrap();
    assert_eq!(fault(&at), "about.json: a capture of format 2; this program reads 1");
    fs::write(at.join(files::ABOUT), about.replace("\"updates\": 7", "\"updates\": -7")).unwrap();
    assert!(fault(&at).starts_with("about.json:"), "{}", fault(&at));
    fs::write(at.join(files::ABOUT), "x".repeat(17 << 20)).unwrap();
    assert_eq!(fault(&at), "about.json: longer than 16777216 bytes");
    fs::remove_file(at.join(files::ABOUT)).unwrap();
    nix::unistd::mkfifo(&at.join(files::ABOUT), nix::sys::stat::Mode::S_IRWXU).unwrap();
    assert_eq!(fault(&at), "about.json: no plain file");
}

#[test]
fn a_recording_is_read_in_bounds() {
    let directory = tempfile::tempdir().unwrap();
    write(directory.path());
    let time = "{\"t\":1,\"file\":\"0000.bin\"}\n";
    fs::write(directory.path().join(files::IMAGE_TIMES), time.repeat(MOST_IMAGES + 1)).unwrap();
    let times = Lines::<ImageAt>::open(directory.path(), files::IMAGE_TIMES, &about(), MOST_IMAGES);
    let last = times.unwrap().last().unwrap().unwrap_err().to_string();
    assert!(last.ends_with("images.ndjson:4097: more than 4096 lines"), "{last}");
    // Replies of empty lines take memory, too.
    let answer = format!("{{\"line\":\"P1\",\"reply\":[{}\"\"]}}\n", "\"\",".repeat(20_000));
    fs::write(directory.path().join(files::ANSWERS), answer.repeat(80)).unwrap();
    let fault = Recording::read(directory.path()).unwrap_err().to_string();
    assert!(fault.ends_with(": the replies take more than 16777216 bytes"), "{fault}");
    // The reader stops at the first fault.
    fs::write(directory.path().join(files::TRACE), "x\nx\nx\n").unwrap();
    assert_eq!(Accesses::of(directory.path(), &about()).unwrap().count(), 1);
}

/// A recorder running as root would overwrite the file that a link there names, or copy it.
#[test]
fn a_recording_is_made_where_nobody_else_can_reach_and_follows_no_link() {
    use std::os::unix::fs::{PermissionsExt as _, symlink};
    let place = tempfile::tempdir().unwrap();
    let at = |name: &str| place.path().join(name);
    let refused = |name: &str| Writer::create(&at(name), &about()).unwrap_err().to_string();
    for (name, mode) in [("open", 0o777), ("sticky", 0o1777)] {
        fs::create_dir(at(name)).unwrap();
        fs::set_permissions(at(name), fs::Permissions::from_mode(mode)).unwrap();
        assert!(refused(name).contains("others may write into it"), "{}", refused(name));
    }
    fs::create_dir(at("empty")).unwrap();
    symlink(at("empty"), at("link")).unwrap();
    assert!(refused("link").starts_with(&at("link").display().to_string()), "{}", refused("link"));
    // A directory that takes its place meanwhile gets no file.
    let writer = Writer::create(&at("own"), &about()).unwrap();
    fs::rename(at("own"), at("moved")).unwrap();
    fs::create_dir(at("own")).unwrap();
    symlink(at("victim"), at("own").join("variables.partial")).unwrap();
    fs::write(at("victim"), "precious").unwrap();
    writer.variables("I100=1").unwrap();
    assert_eq!(fs::read_to_string(at("victim")).unwrap(), "precious");
    assert_eq!(fs::read_to_string(at("moved").join(files::VARIABLES)).unwrap(), "I100=1");

    write(&at("read"));
    fs::remove_file(at("read").join(files::VARIABLES)).unwrap();
    symlink(at("victim"), at("read").join(files::VARIABLES)).unwrap();
    assert!(fault(&at("read")).contains("a link, no plain file"), "{}", fault(&at("read")));
}

#[test]
fn an_image_is_named_once() {
    let place = tempfile::tempdir().unwrap();
    write(place.path());
    let path = place.path().join(files::IMAGE_TIMES);
    let first = fs::read_to_string(&path).unwrap().lines().next().unwrap().to_owned();
    fs::write(&path, format!("{first}\n{first}\n")).unwrap();
    assert!(fault(place.path()).contains("an image that is there already"), "{}", fault(place.path()));
}

#[test]
fn a_recording_of_an_earlier_version_has_readings_that_are_no_more() {
    let directory = tempfile::tempdir().unwrap();
    write(directory.path());
    let path = directory.path().join(files::ABOUT);
    let mut old: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    old["settings"]["readings"] = json!({
        "reply_count": "with_nul", "control_flag": "line", "rotary_code2": "bit16", "gather_size_word": "not_written",
        "panel_mask": "when_done", "write_record": "as_pmac", "mailbox_bell": "alone"
    });
    fs::write(&path, old.to_string()).unwrap();
    let readings = About::read(directory.path()).unwrap().settings.readings;
    assert_eq!(serde_json::to_value(readings).unwrap()["rotary_code2"], "bit16");
    assert!(Recording::read(directory.path()).is_ok());
}
