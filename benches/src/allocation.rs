//! `allocation`: whether the daemon's bus thread asks for memory after its start, with every function in use.
//!
//! Runs `pmacd_counted`, which is the whole daemon with a counting allocator.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use pmac_dpram::segment::Counter;

use crate::machine;
use crate::process::Child;
use crate::rig::{Rig, Setup, program};

/// Measures `seconds`, and says whether the bus thread allocated. False if it did.
pub fn run(seconds: u64) -> bool {
    machine::introduce("allocation");
    let mut rig = Rig::simulator_alone(&Setup::default());
    let counts = rig.memory().with_file_name("counts");
    rig.start_daemon_of("pmacd_counted", &Setup::default(), &[("PMAC_COUNTS", &counts)]);
    let subscriber = rig.subscriber();
    std::thread::sleep(Duration::from_secs(1));
    // Once through everything: what a function sets aside when it is first used belongs to the start.
    rig.connection().send("&1 #1->X #2->Y", Duration::from_secs(5)).expect("axes");
    drop(use_everything(&rig, 2));
    std::thread::sleep(Duration::from_millis(200));
    let before = bus_count(&counts);
    let updates = subscriber.counter(Counter::Updates);
    let users = use_everything(&rig, seconds);
    std::thread::sleep(Duration::from_millis(200));
    let after = bus_count(&counts);
    println!("start and first use: {before} allocations in the bus thread");
    println!(
        "then {seconds} s: {} servo updates, {} command lines, {users}: {} allocations in the bus thread",
        subscriber.counter(Counter::Updates) - updates,
        subscriber.counter(Counter::AsciiCommands),
        after - before
    );
    after == before
}

/// Command clients, a variable watch, a gather, a jog, words read and written, a rotary stream; all for `seconds`.
fn use_everything(rig: &Rig, seconds: u64) -> String {
    let sender = Child::run(|| {
        let mut connection = rig.connection();
        let end = std::time::Instant::now() + Duration::from_secs(seconds);
        while std::time::Instant::now() < end {
            connection.send("I122 #1P", Duration::from_secs(5)).expect("an answer");
        }
    });
    let file = rig.memory().with_file_name("program.pmc");
    let text: String = (0..2000).map(|line| format!("X{} Y{}\n", line % 1000, line * 7 % 500)).collect();
    std::fs::write(&file, text).expect("written");
    let file = file.to_str().expect("a path");
    let count = (seconds * 15).to_string();
    let time = seconds.to_string();
    let all: [&[&str]; 3] = [
        &["variable", "watch", "--count", &count, "X:$0000", "1.actual_position"],
        &["gather", "--source", "1.actual_position", "--period", "1", "--seconds", &time, "-o", "/dev/null"],
        &["panel", "jog+", "3", "--hold", "--seconds", &time],
    ];
    let running: Vec<_> =
        all.iter().map(|arguments| pmacctl(rig, arguments).spawn().expect("pmacctl")).collect();
    for mut child in running {
        let _ = child.wait();
    }
    sender.join();
    // A rotary buffer cannot be defined above a gather buffer.
    let then: [&[&str]; 4] = [
        &["variable", "set", "Y:$0700=5"],
        &["send", "ENDGATHER"],
        &["send", "DELETE GATHER"],
        &["rotary", "stream", file, "--define", "9000"],
    ];
    for arguments in then {
        let status = pmacctl(rig, arguments).status().expect("pmacctl");
        assert!(status.success(), "{arguments:?}");
    }
    "variables watched and set, gather, a held jog, a rotary stream".to_owned()
}

fn pmacctl(rig: &Rig, arguments: &[&str]) -> Command {
    let mut command = Command::new(program("pmacctl"));
    command.args(["--name", &rig.name, "--socket"]).arg(rig.socket()).args(arguments);
    command.stdin(Stdio::null()).stdout(Stdio::null());
    command
}

fn bus_count(path: &Path) -> u64 {
    let text = std::fs::read_to_string(path).expect("the counts");
    let bus = text.lines().find_map(|line| line.strip_prefix("bus ")?.parse().ok());
    bus.unwrap_or_else(|| panic!("no thread called bus: {text}"))
}
