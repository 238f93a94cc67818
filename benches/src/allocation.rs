//! `allocation`: whether the daemon's bus thread asks for memory after its start, with every function in use.
//!
//! Runs `pmacd_counted`, which is the whole daemon with a counting allocator. The same, shorter, is one of the driver's own tests.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use pmac_dpram::segment::Counter;

use crate::machine;
use crate::process::Child;
use crate::rig::{Rig, Setup, program};

/// What `&1` may have in its rotary buffer, in the board's words: more than the program below needs.
const BOARD_WORDS: &str = "9000";

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
    use_everything(&rig, 2);
    std::thread::sleep(Duration::from_millis(200));
    let before = bus_counts(&counts);
    let counted = || [Counter::Updates, Counter::AsciiCommands].map(|counter| subscriber.counter(counter));
    let [updates, lines] = counted();
    use_everything(&rig, seconds);
    std::thread::sleep(Duration::from_millis(200));
    let after = bus_counts(&counts);
    let [updates_now, lines_now] = counted();
    println!("start and first use: {} allocations in the bus thread", before[0]);
    println!(
        "then {seconds} s: {} servo updates, {} command lines, variables watched and set, words read and written, a gather, a held jog, \
         a rotary stream, changed I-variables",
        updates_now - updates,
        lines_now - lines,
    );
    println!(
        "{} allocations in the bus thread; {} times it gave back what the socket's thread had set aside for a job",
        after[0] - before[0],
        after[1] - before[1]
    );
    after[0] == before[0]
}

/// Command clients, a variable watch, a gather, a jog, words read and written, a rotary stream; the first four for `seconds`.
fn use_everything(rig: &Rig, seconds: u64) {
    let sender = Child::run(|| {
        let mut connection = rig.connection();
        let end = Instant::now() + Duration::from_secs(seconds);
        while Instant::now() < end {
            connection.send("I122 #1P", Duration::from_secs(5)).expect("an answer");
        }
    });
    let file = |name: &str| rig.memory().with_file_name(name).to_str().expect("a path").to_owned();
    let (samples, program) = (file("samples.csv"), file("program.pmc"));
    let text: String = (0..2000).map(|line| format!("X{} Y{}\n", line % 1000, line * 7 % 500)).collect();
    std::fs::write(&program, text).expect("written");
    let count = (seconds * 15).to_string();
    let time = seconds.to_string();
    let at_once: [&[&str]; 3] = [
        &["variable", "watch", "--count", &count, "X:$0000", "1.actual_position"],
        &["gather", "--source", "1.actual_position", "--period", "1", "--seconds", &time, "-o", &samples],
        &["panel", "jog+", "3", "--hold", "--seconds", &time],
    ];
    let running = at_once.map(|arguments| (arguments, pmacctl(rig, arguments).spawn().expect("pmacctl")));
    for (arguments, mut child) in running {
        let status = child.wait().expect("pmacctl");
        assert!(status.success(), "{arguments:?}");
    }
    sender.join();
    // A rotary buffer cannot be defined above a gather buffer, nor one above itself.
    let then: [&[&str]; 8] = [
        &["variable", "set", "Y:$0770=5"],
        &["write", "Y:$DA00", "5"],
        &["read", "Y:$DA00"],
        &["panel", "feed", "1", "off"],
        &["send", "I119=1"],
        &["send", "DELETE GATHER"],
        &["rotary", "stream", &program, "--define", BOARD_WORDS],
        &["send", "&1 Q DELETE ROT"],
    ];
    for arguments in then {
        let status = pmacctl(rig, arguments).status().expect("pmacctl");
        assert!(status.success(), "{arguments:?}");
    }
}

fn pmacctl(rig: &Rig, arguments: &[&str]) -> Command {
    let mut command = Command::new(program("pmacctl"));
    command.args(["--name", &rig.name, "--socket"]).arg(rig.socket()).args(arguments);
    command.stdin(Stdio::null()).stdout(Stdio::null());
    command
}

/// How often the bus thread asked for memory, and gave some back.
fn bus_counts(path: &Path) -> [u64; 2] {
    let text = std::fs::read_to_string(path).expect("the counts");
    let counts = text.lines().find_map(|line| {
        let (asked, given_back) = line.strip_prefix("bus ")?.split_once(' ')?;
        Some([asked.parse().ok()?, given_back.parse().ok()?])
    });
    counts.unwrap_or_else(|| panic!("no thread called bus: {text}"))
}
