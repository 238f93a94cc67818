//! `pmac-sim` as a process: its sockets, its steps, its end, its refusals.

use std::fs::OpenOptions;
use std::io::{Read, Write};
use std::os::unix::fs::FileExt;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use pmac_dpram::device::mapping::Mapping;

use crate::support::sim::{Sim, connect};

#[test]
fn virtual_time_stands_still_until_stepped() {
    let mut sim = Sim::start(&["--virtual", "--dpram-startup"]);
    assert_eq!(sim.status("servo_cycles"), 0);
    sim.ok("step 100");
    assert_eq!((sim.status("servo_cycles"), sim.status("updates"), sim.read(0x0026)), (100, 100, 100));
    sim.write(0x0024, 1);
    sim.ok("step 7");
    assert_eq!((sim.status("skipped"), sim.read(0x0026)), (7, 100));
    assert_eq!(sim.status("servo_cycles"), 107);
    assert_eq!(
        (sim.status("late"), sim.status("violations_total"), sim.status("background_updates")),
        (0, 0, 1)
    );
}

#[test]
fn interrupts_are_counted_for_every_host_and_can_be_lost() {
    let mut sim = Sim::start(&["--virtual", "--dpram-startup"]);
    let mut hosts = [sim.socket("interrupt"), sim.socket("interrupt")];
    let count = |host: &mut UnixStream| {
        let mut bytes = [0; 4];
        host.read_exact(&mut bytes).unwrap();
        u32::from_ne_bytes(bytes)
    };
    // An answer on the control socket, and a second one: by then the connections have been taken.
    sim.status("resets");
    sim.status("resets");
    sim.ok("fault spurious_interrupt 1");
    sim.ok("step 1");
    for host in &mut hosts {
        assert_eq!(count(host), 1);
        host.write_all(&1u32.to_ne_bytes()).unwrap();
    }
    sim.write_text("I10");
    sim.write(0x062C, 1);
    sim.ok("step 5");
    assert_eq!(sim.read(0x06D0), 0x000D);
    sim.write(0x06D0, 0);
    sim.ok("step 5");
    assert_eq!(sim.read(0x06D0), 0x0006);
    for host in &mut hosts {
        assert_eq!([count(host), count(host)], [2, 3]);
    }
    sim.ok("fault lost_interrupt 1");
    for _ in 0..2 {
        sim.write(0x06D0, 0);
        sim.write(0x062C, 1);
        sim.ok("step 5");
    }
    assert_eq!(count(&mut hosts[0]), 4, "one of the two was lost");
}

#[test]
fn the_running_simulator_holds_no_capability() {
    let mut sim = Sim::start(&["--virtual"]);
    sim.ok("step 1");
    let status = std::fs::read_to_string(format!("/proc/{}/status", sim.child.id())).unwrap();
    for line in ["CapEff:\t0000000000000000", "CapPrm:\t0000000000000000", "NoNewPrivs:\t1"] {
        assert!(status.contains(line), "{status}");
    }
}

#[test]
fn the_serial_port_is_a_byte_stream() {
    let mut sim = Sim::start(&["--virtual", "--dpram-startup", "--firmware", "1.17c"]);
    let mut serial = sim.socket("serial");
    serial.write_all(b"VERSION\r").unwrap();
    let mut answer = [0; 7];
    serial.read_exact(&mut answer).unwrap();
    assert_eq!(&answer, b"1.17C\r\x06");
    sim.ok("send HELLO");
    let mut answer = [0; 6];
    serial.read_exact(&mut answer).unwrap();
    assert_eq!(&answer, b"HELLO\r");
}

#[test]
fn control_refuses_nonsense_in_one_line() {
    let mut sim = Sim::start(&["--virtual"]);
    for command in [
        "",
        "nonsense",
        "step",
        "step x",
        "step -1",
        "fault",
        "fault x on",
        "limit 9 +",
        "limit 0 +",
        "limit 1 x",
        "trigger",
        "tag",
    ] {
        let answer = sim.ask(command);
        assert!(answer.starts_with("error: "), "{command:?}: {answer}");
    }
    let long = "x".repeat(100_000);
    assert!(sim.ask(&long).starts_with("error: "));
    sim.ok("limit 1 +");
    sim.ok("reset");
    assert_eq!(sim.status("resets"), 1);
}

#[test]
fn it_ends_on_sigterm_and_exit_and_leaves_only_the_memory() {
    let mut sim = Sim::start(&["--dpram-startup"]);
    let pid = nix::unistd::Pid::from_raw(sim.child.id().try_into().unwrap());
    nix::sys::signal::kill(pid, nix::sys::signal::Signal::SIGTERM).unwrap();
    assert_eq!(sim.wait(), Some(0));
    let left: Vec<_> =
        std::fs::read_dir(sim.directory.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(left, ["dpram"]);
    let mut sim = Sim::start(&["--virtual"]);
    sim.ok("exit");
    assert_eq!(sim.wait(), Some(0));
}

#[test]
fn a_killed_simulator_is_replaced_on_the_same_memory() {
    let mut sim = Sim::start(&["--virtual", "--dpram-startup"]);
    sim.write(0x0026, 0x8005);
    sim.replace(&["--virtual", "--dpram-startup"]);
    sim.ok("step 3");
    assert_eq!(sim.read(0x0026), 3);
}

fn refused(options: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_pmac-sim")).args(options).stdin(Stdio::null()).output().unwrap()
}

#[test]
fn turbo_boards_start_with_the_dpram_that_is_asked_for() {
    for (family, dpram, length) in [
        ("turbo", None, 0x4000),
        ("turbo", Some("32k"), 0x1_0000),
        ("turbo2", None, 0x1_0000),
        ("turbo2", Some("8k"), 0x4000),
    ] {
        let mut options = vec!["--virtual", "--dpram-startup", "--family", family];
        options.extend(dpram.into_iter().flat_map(|size| ["--dpram", size]));
        let mut sim = Sim::start(&options);
        assert_eq!(std::fs::metadata(sim.path("dpram")).unwrap().len(), length, "{options:?}");
        sim.ok("step 3");
        // Motor and background report, 32 motors and 16 coordinate systems.
        assert_eq!([0x006E, 0x067A].map(|word| sim.read(word) >> 15), [1, 1]);
        assert_eq!([0x0070, 0x0072, 0x0674].map(|word| sim.read(word)), [0xFFFF, 0xFFFF, 16]);
        assert_eq!((sim.status("servo_cycles"), sim.status("violations_total")), (3, 0));
        let mut serial = sim.socket("serial");
        serial.write_all(b"i6=1 i3=2 ver\r").unwrap();
        let mut reply = [0; 7];
        serial.read_exact(&mut reply).unwrap();
        assert_eq!(&reply, b"1.947\r\x06");
    }
}

#[test]
fn bad_options_get_one_line_and_status_2() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).display().to_string();
    let (memory, short, startup) = (path("dpram"), path("short"), path("startup"));
    std::fs::write(&short, [0; 100]).unwrap();
    std::fs::write(&startup, "I10\n\n; comment\nI19 ; fine\nNONSENSE\n").unwrap();
    let socket = format!("unix:{}", path("no/where"));
    let cases: &[(&[&str], &str)] = &[
        (&[], "--memory"),
        (&["--memory", "/nonexistent/dpram"], "/nonexistent/dpram"),
        (&["--memory", &short], "100 bytes"),
        (&["--memory", &memory, "--motors", "9"], "--motors"),
        (&["--memory", &memory, "--family", "turbo", "--motors", "33"], "--motors"),
        (&["--memory", &memory, "--dpram", "32k"], "has a DPRAM of `32k`; write 8k"),
        (&["--memory", &memory, "--family", "turbo2", "--dpram", "16k"], "--dpram"),
        (&["--memory", &memory, "--servo-hz", "nan"], "--servo-hz"),
        (&["--memory", &memory, "--servo-hz", "0"], "--servo-hz"),
        (&["--memory", &memory, "--serial", "/tmp/x"], "unix:PATH"),
        (&["--memory", &memory, "--serial", &socket], "no/where"),
        (&["--memory", &memory, "--virtual"], "--control"),
        (&["--memory", &memory, "--family", "vax"], "vax"),
        (&["--memory", &memory, "--firmware", "new"], "1.16D"),
        (&["--memory", &memory, "--startup", "/nonexistent/file"], "/nonexistent/file"),
        (&["--memory", &memory, "--startup", &startup], "line 5"),
        (&["--memory", &memory, "stray"], "stray"),
    ];
    for (options, says) in cases {
        let output = refused(options);
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{options:?}: {text}");
        assert_eq!(text.lines().count(), 1, "{options:?}: {text}");
        assert!(text.contains(says), "{options:?}: {text}");
    }
    assert_eq!(refused(&["--help"]).status.code(), Some(0));
    let sim = Sim::start(&["--virtual"]);
    let output = refused(&["--memory", &sim.directory.path().join("dpram").display().to_string()]);
    assert!(String::from_utf8(output.stderr).unwrap().contains("another running pmac-sim"));
}

#[test]
fn mailboxes_and_host_port_are_files_with_sockets_for_their_interrupts() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).display().to_string();
    let (taken, response) = (format!("unix:{}", at("taken")), format!("unix:{}", at("response")));
    let mut sim = Sim::start(&[
        "--virtual",
        "--dpram-startup",
        "--mailbox",
        &at("mailbox"),
        "--mailbox-taken",
        &taken,
        "--mailbox-response",
        &response,
        "--host-port",
        &at("port"),
    ]);
    let mut lines = [connect(Path::new(&at("taken"))), connect(Path::new(&at("response")))];
    let mut interrupt = sim.socket("interrupt");
    sim.status("resets");
    sim.status("resets");
    let count = |line: &mut UnixStream| {
        let mut bytes = [0; 4];
        line.read_exact(&mut bytes).unwrap();
        u32::from_ne_bytes(bytes)
    };
    let file = OpenOptions::new().read(true).write(true).open(at("mailbox")).unwrap();
    let mailboxes = Mapping::new(&file, 0, 0x200).unwrap();
    for (mailbox, character) in [(1, 0), (2, b'1'), (3, b'0'), (4, b'\r'), (0, b'I')] {
        mailboxes.write16(2 * mailbox, u16::from(character) << 8).unwrap();
    }
    sim.ok("step 5");
    assert_eq!((count(&mut lines[0]), count(&mut lines[1])), (1, 1));
    let text: Vec<u8> = (0..8).map(|n| (mailboxes.read16(2 * n).unwrap() >> 8) as u8).collect();
    assert_eq!(text, b"3713707\r");

    let port = OpenOptions::new().read(true).write(true).open(at("port")).unwrap();
    port.write_all_at(&[0x7F], 9).unwrap();
    sim.write_text("I10");
    sim.write(0x062C, 1);
    sim.ok("step 5");
    sim.write(0x06D0, 0);
    sim.ok("step 5");
    assert_eq!(count(&mut interrupt), 1, "one until the end of interrupt, although two responses came");
    port.write_all_at(&[0x67], 12).unwrap();
    sim.ok("step 1");
    assert_eq!(count(&mut interrupt), 2);
    assert_eq!(sim.status("violations_total"), 0);
}

const COMMANDS: &str = include_str!("../data/online_commands.tsv");

/// The answer up to its end: data lines joined by `|`, or the error behind them.
fn converse(serial: &mut UnixStream, line: &str) -> String {
    serial.write_all(format!("{line}\r").as_bytes()).unwrap();
    let (mut text, mut error) = (String::new(), false);
    loop {
        let mut byte = [0];
        serial.read_exact(&mut byte).unwrap();
        match byte[0] {
            0x06 => return text.trim_end_matches('|').to_owned(),
            0x07 => error = true,
            b'\r' if error => return text,
            b'\r' => text.push('|'),
            other => text.push(other.into()),
        }
    }
}

#[test]
fn every_online_command_is_taken_or_refused_with_its_number() {
    let sim = Sim::start(&["--dpram-startup"]);
    let mut serial = sim.socket("serial");
    serial.write_all(b"I3=2 I6=1 I9=2\r").unwrap();
    let mut byte = [0];
    serial.read_exact(&mut byte).unwrap();
    let mut wrong = Vec::new();
    for row in COMMANDS.lines().filter(|row| !row.starts_with("# ")) {
        let (line, expected) = row.split_once('\t').unwrap();
        let answer = converse(&mut serial, line);
        let parts = (answer.split('|'), expected.split('|'));
        let same = parts.0.clone().count() == parts.1.clone().count()
            && parts
                .0
                .zip(parts.1)
                .all(|(found, expected)| found == expected || expected == "*" && !found.starts_with("ERR"));
        if !same {
            wrong.push(format!("{line:?}: {answer:?}, not {expected:?}"));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
