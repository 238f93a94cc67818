//! Rotary streams that go at once, each of its own coordinate system: they share the board's binary entry.

use std::fs::Permissions;
use std::io::Write;
use std::os::unix::fs::{FileExt, PermissionsExt};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use nix::sys::signal::Signal;
use pmac_dpram::client::RotaryPlace;
use pmac_dpram::protocol::calls::LeftLines;
use serde_json::{Value, json};

use crate::rotary_beside::{Client, place, running, words};
use crate::support::jogs::signal;
use crate::support::raw::Raw;
use crate::support::{PATIENCE, VirtualSite, output_within};

/// Families, each with the bit of the second word of `???` that tells of binary entry.
const FAMILIES: [(&str, u32); 2] = [("pmac", 1 << 6), ("turbo2", 1 << 20)];

/// The place of the stream into coordinate system `cs` from buffer `cs`, whose rotary buffer is defined.
fn place_of(cs: u8) -> RotaryPlace {
    RotaryPlace { buffer: cs, coordinate_system: cs, define_longs: None, modes: Vec::new(), ..place() }
}

/// A board with rotary buffers and an axis in coordinate systems 1 and 2.
fn prepared(family: &str) -> VirtualSite {
    let site = running(family);
    for line in ["&2#2->X", "&2DEFINE ROT 100", "&1DEFINE ROT 100"] {
        site.ask(line);
    }
    site
}

/// Begins the stream into coordinate system `cs`. Returns when its program runs.
fn streaming(site: &VirtualSite, cs: u8) -> Client {
    Client::of(site, place_of(cs))
}

fn is_open(site: &VirtualSite, flag: u32) -> bool {
    u32::from_str_radix(&site.ask("???")[0][6..12], 16).unwrap() & flag != 0
}

#[test]
fn two_streams_go_at_once_and_the_last_one_closes_what_the_first_one_opened() {
    for (family, flag) in FAMILIES {
        let site = prepared(family);
        let [first, second] = [1, 2].map(|cs| streaming(&site, cs));
        for stream in [&first, &second] {
            stream.goes_on(&site);
        }
        for (line, reply) in [("P5=7", &[][..]), ("P5", &["7"]), ("#3J/", &[]), ("#3J+", &[]), ("#3J/", &[])]
        {
            assert_eq!(site.ask(line), reply, "{family} {line}");
        }
        let gathered = site.run(&["gather", "--source", "servo_timer", "--seconds", "0.1", "-o", "-"]);
        assert!(
            gathered.code == Some(0) || gathered.stderr.contains("DEFINE GATHER"),
            "{family}: {gathered:?}"
        );
        let saved = site.run(&["backup", "--what", "I,AXES,PLC", "-o", "-"]);
        assert!(saved.code == Some(0) && saved.stdout.contains("I100="), "{family}: {saved:?}");
        let refused = site.run(&["send", "OPEN PROG 9"]);
        assert!(
            refused.code == Some(1) && refused.stderr.contains("has had BINARY ROTARY open"),
            "{family}: {refused:?}"
        );
        for stream in [&first, &second] {
            stream.goes_on(&site);
        }
        assert_eq!(first.stop(&site).reason, None, "{family}");
        assert!(is_open(&site, flag), "{family}: for the second one");
        second.goes_on(&site);
        assert_eq!(second.stop(&site).reason, None, "{family}");
        assert!(!is_open(&site, flag), "{family}: closed");
        let log = site.log();
        for line in ["OPEN BINARY ROTARY", "CLOSE"] {
            assert_eq!(
                log.matches(&format!("(rotary stream) sends {line:?}")).count(),
                1,
                "{family} {line}: {log}"
            );
        }
        site.assert_no_violations();
    }
}

#[test]
fn an_abort_of_one_stream_leaves_the_other_and_takes_none_of_its_lines_later() {
    for (family, flag) in FAMILIES {
        let site = prepared(family);
        let [first, second] = [1, 2].map(|cs| streaming(&site, cs));
        assert_eq!(site.run(&["abort", "1"]).code, Some(0), "{family}");
        second.goes_on(&site);
        let stopped = first.stop(&site);
        let reason = stopped.reason.unwrap_or_default();
        assert!(reason.contains("aborted its coordinate system"), "{family}: {reason}");
        assert!(stopped.ahead_lines > 0, "{family}");
        let left = stopped.left_lines.unwrap();
        site.run_for(Duration::from_secs(1));
        assert_eq!(site.ask("&1PR"), [left.to_string()], "{family}: the board takes none of them");
        // Neither is there room for a clear, nor would the lines that the board has not taken follow.
        for (how, says) in [
            (LeftLines::Clear, "would end the other rotary streams"),
            (LeftLines::Continue, "still in the DPRAM"),
        ] {
            let error = site.connection().rotary_start(RotaryPlace { left: Some(how), ..place_of(1) });
            let error = error.unwrap_err().to_string();
            assert!(left > 0 && error.contains(says), "{family}: {error}");
        }
        second.goes_on(&site);
        assert_eq!(second.stop(&site).reason, None, "{family}");
        assert!(!is_open(&site, flag), "{family}");
        let cleared = RotaryPlace { left: Some(LeftLines::Clear), ..place_of(1) };
        site.connection().rotary_start(cleared).unwrap();
        site.assert_no_violations();
    }
}

#[test]
fn a_close_ends_every_stream_and_the_next_one_opens_again() {
    for (family, flag) in FAMILIES {
        let site = prepared(family);
        let streams = [1, 2].map(|cs| streaming(&site, cs));
        assert_eq!(site.run(&["send", "CLOSE"]).code, Some(0), "{family}");
        for stream in streams {
            let reason = stream.stop(&site).reason.unwrap_or_default();
            assert!(reason.contains("closed the rotary buffers"), "{family}: {reason}");
        }
        let owner = RotaryPlace { left: Some(LeftLines::Clear), ..place_of(2) };
        let mut next = site.connection();
        next.rotary_start(owner).unwrap();
        assert!(is_open(&site, flag), "{family}");
    }
}

#[test]
fn streams_that_would_share_a_coordinate_system_or_memory_are_refused() {
    let site = prepared("pmac");
    let start = Some(pmac_dpram::map::HostOffset::new(0x2000));
    let stream = Client::of(&site, RotaryPlace { start, ..place_of(1) });
    let refused = |place| site.connection().rotary_start(place).unwrap_err().to_string();
    let same = refused(RotaryPlace { coordinate_system: 1, ..place_of(2) });
    assert!(
        same.contains("rotary buffer 1 and its coordinate system have one stream at a time: uid"),
        "{same}"
    );
    let there = refused(RotaryPlace { start, ..place_of(2) });
    assert!(there.contains("rotary buffer 1 lies there"), "{there}");
    stream.goes_on(&site);
    assert_eq!(stream.stop(&site).reason, None);
    site.assert_no_violations();
}

#[test]
fn no_second_stream_begins_where_open_rot_would_store_its_set_up() {
    let site = prepared("pmac");
    site.control("fault no_binary_rotary on");
    let first = streaming(&site, 1);
    let error = site.connection().rotary_start(place_of(2)).unwrap_err().to_string();
    assert!(error.contains("takes OPEN ROT alone") && error.contains("nothing was sent"), "{error}");
    first.goes_on(&site);
    assert_eq!(first.stop(&site).reason, None);
    site.assert_no_violations();
}

/// Starts a daemon again.
fn restart(site: &VirtualSite) {
    let config = site.path("pmacd.toml");
    site.start_daemon(&["--config", config.to_str().unwrap()]);
    site.wait_until("a board that takes commands", || site.pmacctl(&["send", "P1"]).0 == 0);
}

/// How many lines the board's own rotary buffer of coordinate system `cs` holds.
fn left(site: &VirtualSite, cs: u8) -> u64 {
    site.ask(&format!("&{cs}PR"))[0].parse().unwrap()
}

#[test]
fn a_daemon_that_stops_ends_every_stream() {
    for (family, flag) in FAMILIES {
        let site = prepared(family);
        let streams = [1, 2].map(|cs| streaming(&site, cs));
        site.stop_daemon();
        for stream in streams {
            let told = stream.end(&site);
            assert!(told.as_ref().is_none_or(|stopped| stopped.reason.is_some()), "{family}: {told:?}");
        }
        restart(&site);
        assert!(!is_open(&site, flag), "{family}");
        assert!(family != "pmac" || site.ask("I57") == ["0"]);
        let before = [1, 2].map(|cs| left(&site, cs));
        site.run_for(Duration::from_secs(3));
        assert_eq!([1, 2].map(|cs| left(&site, cs)), before, "{family}: nothing runs");
        assert!(before.iter().all(|left| *left > 0), "{family}: {before:?}");
        site.assert_no_violations();
    }
}

#[test]
fn what_the_streams_of_a_killed_daemon_left_is_refused_and_cleared_one_by_one() {
    for (family, flag) in FAMILIES {
        let site = prepared(family);
        let streams = [1, 2].map(|cs| streaming(&site, cs));
        site.with_world(|world| world.daemon = None);
        UnixStream::connect(site.path("serial")).unwrap().write_all(b"&1A&2A\r").unwrap();
        assert!(streams.map(|stream| stream.end(&site)).iter().all(Option::is_none), "{family}");
        restart(&site);
        assert!(is_open(&site, flag), "{family}: nobody has closed");
        let start = |cs, how| {
            let refused = site.connection().rotary_start(RotaryPlace { left: how, ..place_of(cs) });
            refused.unwrap_err().to_string()
        };
        for cs in [1, 2] {
            let error = start(cs, None);
            assert!(error.contains(&format!("are left in &{cs}'s rotary buffer")), "{family}: {error}");
            let error = start(cs, Some(LeftLines::Clear));
            assert!(error.contains("CLOSE"), "{family}: {error}");
        }
        site.ask("CLOSE");
        let clear = |cs| Client::of(&site, RotaryPlace { left: Some(LeftLines::Clear), ..place_of(cs) });
        let first = clear(1);
        for (how, says) in [
            (None, "--clear (when the other rotary streams are over) takes them away"),
            (Some(LeftLines::Clear), "try again when they are over"),
        ] {
            let error = start(2, how);
            assert!(error.contains(says), "{family}: {error}");
        }
        first.goes_on(&site);
        assert_eq!(first.stop(&site).reason, None, "{family}");
        let second = clear(2);
        second.goes_on(&site);
        assert_eq!(second.stop(&site).reason, None, "{family}");
        assert!(!is_open(&site, flag), "{family}");
        site.assert_no_violations();
    }
}

#[test]
fn a_header_that_no_stream_of_the_system_wrote_holds_no_lines_that_wait() {
    let site = prepared("pmac");
    for line in ["&1", "OPEN ROT", "X1", "X2", "CLOSE"] {
        site.ask(line);
    }
    let memory = std::fs::File::options().write(true).open(site.path("dpram")).unwrap();
    let header = u64::from(pmac_dpram::map::PMAC.rotary.headers[0].bytes());
    // The second word is the coordinate system. The size of 0 stands for a stream that has ended.
    for (system, is_continued) in [(1_u16, false), (0x1616, true)] {
        let words = [0, system, 4, 2, 0].map(u16::to_le_bytes).concat();
        memory.write_all_at(&words, header).unwrap();
        let place = RotaryPlace { left: Some(LeftLines::Continue), run: false, ..place_of(1) };
        let started = site.connection().rotary_start(place);
        assert_eq!(started.as_ref().is_ok_and(|begun| begun.found_lines == 2), is_continued, "{started:?}");
    }
}

#[test]
#[ignore = "needs root, to be another user"]
fn as_root_streams_of_two_users_go_at_once_and_a_refusal_names_a_user_whose_stream_goes() {
    // Group 1 exists everywhere.
    let group = nix::unistd::Group::from_gid(nix::unistd::Gid::from_raw(1)).unwrap().unwrap().name;
    let config = format!("socket_mode = \"0666\"\n[roles]\nengineer = [{group:?}]\n");
    let site = VirtualSite::configured(&[], &config);
    site.wait_until("a board that takes commands", || site.pmacctl(&["send", "#1J/"]).0 == 0);
    for line in ["&2#2->X", "&2DEFINE ROT 100", "&1#1->X", "&1DEFINE ROT 100"] {
        site.ask(line);
    }
    let program = site.path("pmacctl");
    std::fs::copy(env!("CARGO_BIN_EXE_pmacctl"), &program).unwrap();
    let file = site.file("long.pmc", &("LINEAR INC TM100\n".to_owned() + &"X1\n".repeat(9000)));
    for path in [program.parent().unwrap(), &program, Path::new(&file)] {
        std::fs::set_permissions(path, Permissions::from_mode(0o755)).unwrap();
    }
    let stream = |uid: &str, cs: &str| {
        let mut command = Command::new("setpriv");
        command.args(["--reuid", uid, "--regid", "1", "--clear-groups"]).arg(&program);
        command.args(["--name", &site.name, "--socket"]).arg(site.socket());
        command.args(["rotary", "stream", &file, "--buffer", cs, "--cs", cs, "--size", "40", "--run"]);
        let child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn();
        let run = format!("sends \"&{cs}R\"");
        site.wait_until("a program that runs", || site.log().contains(&run));
        child.unwrap()
    };
    let end = |mut child: Child| {
        signal(&child, Signal::SIGINT);
        let ran = site.hurried(|| output_within(&mut child, PATIENCE));
        String::from_utf8_lossy(&ran.stderr).into_owned()
    };
    // A refusal names the user of either stream.
    let names = |uids: &[&str]| {
        let refused = site.run(&["send", "OPEN PROG 9"]);
        assert!(refused.stderr.contains("has had BINARY ROTARY open"), "{refused:?}");
        uids.iter().any(|uid| refused.stderr.contains(&format!("uid {uid} ")))
    };
    let [first, second] = [("65533", "1"), ("65534", "2")].map(|(uid, cs)| stream(uid, cs));
    assert!(names(&["65533", "65534"]));
    let same = site.connection().rotary_start(place_of(1)).unwrap_err().to_string();
    assert!(same.contains("uid 65533 (pid"), "{same}");
    let told = end(first);
    assert!(told.contains("lines were sent"), "{told}");
    site.wait_until("the other user's name", || names(&["65534"]));
    let told = end(second);
    assert!(told.contains("lines were sent"), "{told}");
    assert_eq!(site.ask("I57"), ["0"]);
    site.assert_no_violations();
}

/// A ring that the daemon let run empty is counted as an underrun.
#[test]
fn none_of_sixteen_streams_at_nine_kilohertz_starves() {
    const LINES: u32 = 20;
    const BATCHES: usize = 4;
    let site =
        VirtualSite::configured(&["--family", "turbo2", "--servo-hz", "9000"], "family = \"turbo2\"\n");
    site.wait_until("a board that takes commands", || site.pmacctl(&["send", "#1J/"]).0 == 0);
    for cs in (1..=16).rev() {
        site.ask(&format!("&{cs}#{cs}->X"));
        site.ask(&format!("&{cs}DEFINE ROT 20"));
        // A line takes 20 ms.
        site.ask(&format!("I{}=20", 5087 + 100 * cs));
    }
    let lines: Vec<Value> = (0..LINES).map(|number| json!({ "words": words(number) })).collect();
    let mut streams: Vec<Raw> = (1..=16).map(|_| Raw::at(&site.socket())).collect();
    // Every stream makes these calls, one behind the other. The replies to the last one.
    let mut all = |calls: &[(&str, &dyn Fn(usize) -> Value)]| -> Vec<Value> {
        for (method, parameters) in calls {
            (1..).zip(&mut streams).for_each(|(cs, stream)| stream.call(method, parameters(cs)));
        }
        let reply = |stream: &mut Raw| {
            let replies: Vec<Value> = calls.iter().map(|_| stream.receive().unwrap()).collect();
            assert!(replies.iter().all(|reply| reply["error"].is_null()), "{replies:?}");
            replies.into_iter().last().unwrap()
        };
        site.hurried(|| streams.iter_mut().map(reply).collect())
    };
    let start = |cs| json!({"buffer": cs, "size_longs": 40, "coordinate_system": cs, "coordinate_system_base": 1, "run": true, "modes": []});
    let send = |cs| json!({"buffer": cs, "lines": lines, "timeout_ms": 60_000});
    let buffer = |cs| json!({"buffer": cs});
    all(&[("RotaryStart", &start)]);
    let mut calls: Vec<(&str, &dyn Fn(usize) -> Value)> = vec![("RotarySend", &send); BATCHES];
    calls.extend([("RotaryFinish", &buffer as &dyn Fn(usize) -> Value), ("RotaryState", &buffer)]);
    for state in all(&calls) {
        let state = &state["parameters"];
        let sent = BATCHES * LINES as usize;
        assert_eq!((&state["sent_lines"], &state["underruns"]), (&sent.into(), &0.into()), "{state}");
    }
    site.assert_no_violations();
}
