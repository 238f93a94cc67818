//! Each function does its work on a board of either family.

use crate::support::jogs::{ask, until};
use crate::support::{PATIENCE, VirtualSite};

/// A family's board: whether it has a panel, and where the test writes.
struct Board {
    family: &'static str,
    has_panel: bool,
    /// Registers that nobody else uses are at this address and the next ones, in hexadecimal without the last digit.
    free: &'static str,
}

const PMAC: Board = Board { family: "pmac", has_panel: true, free: "077" };
const TURBO: Board = Board { family: "turbo2", has_panel: false, free: "670" };

impl Board {
    /// It, and its daemon.
    fn site(&self) -> VirtualSite {
        let config = format!("family = {:?}\n", self.family);
        let site = VirtualSite::configured(&["--family", self.family], &config);
        site.wait_for_identity();
        site.wait_for_live_servo();
        if self.has_panel {
            assert_eq!(site.pmacctl(&["send", "I2=3"]).0, 0);
        }
        site
    }
}

fn done(site: &VirtualSite, arguments: &[&str]) -> String {
    let (status, stdout, stderr) = site.pmacctl(arguments);
    assert_eq!((status, stderr.as_str()), (0, ""), "{arguments:?}: {stdout}");
    stdout
}

/// Servo and background data, command lines, panel, variables, gathering and a program by the binary rotary buffer.
fn every_function_works(site: &VirtualSite, kind: &Board) {
    lines_are_answered(site);
    a_motor_jogs(site, kind);
    variables_are_written_and_read(site, kind);
    samples_are_gathered(site);
    a_program_runs(site, kind);
    site.assert_no_violations();
}

fn lines_are_answered(site: &VirtualSite) {
    let mut board = site.connection();
    assert_eq!(board.send("P5=7", PATIENCE).unwrap(), [] as [&str; 0]);
    assert_eq!(board.send("P5 I108", PATIENCE).unwrap(), ["7", "96"]);
    board.send("NONSENSE", PATIENCE).unwrap_err();
    assert_eq!(board.send("P5", PATIENCE).unwrap(), ["7"]);
}

fn a_motor_jogs(site: &VirtualSite, kind: &Board) {
    let mut board = site.connection();
    let key = |key: &str, line: &str| {
        if kind.has_panel { done(site, &["panel", key, "3"]) } else { done(site, &["send", line]) }
    };
    key("jog+", "#3J+");
    until(&mut board, "#3V", "it goes", |speed| speed > 1.0);
    site.wait_until("the motor's position", || {
        // A program that is held up between data and clock finds them stale: time runs faster here than it does.
        let (_, document, _) = site.pmacctl(&["motors", "--json"]);
        let document: serde_json::Value = serde_json::from_str(&document).unwrap();
        document["servo"]["fresh"] == true
            && document["motors"][2]["actual_position"]["value"].as_f64().unwrap() > 0.0
    });
    key("jog-stop", "#3J/");
    until(&mut board, "#3V", "it stands", |speed| speed.abs() < 0.1);
    site.wait_until("a background report", || site.pmacctl(&["coordinates", "--json"]).0 == 0);
}

fn variables_are_written_and_read(site: &VirtualSite, kind: &Board) {
    let mut board = site.connection();
    let free = kind.free;
    let [first, bits, long] = [format!("Y:${free}0"), format!("X:${free}1"), format!("D:${free}8")];
    if kind.has_panel {
        let [some_bits, values] = [format!("{bits},4,8=-2"), format!("{long}=-3")];
        done(site, &["variable", "set", &format!("{first}=5"), &some_bits, &values]);
    } else {
        let lines = [("WY", "0", "5"), ("WX", "1", "$FE0"), ("WL", "8", "-3")];
        for (command, digit, value) in lines {
            board.send(&format!("{command}${free}{digit},{value}"), PATIENCE).unwrap();
        }
    }
    for (line, word) in [("RHY", "0", "000005"), ("RHX", "1", "000FE0"), ("RHX", "8", "FFFFFF")]
        .map(|(command, digit, word)| (format!("{command}${free}{digit}"), word))
    {
        assert_eq!(board.send(&line, PATIENCE).unwrap(), [word], "{line}");
    }
    // A table that changes under a value: what is shown is never another register's.
    for (registers, values) in [
        ([&first, &long], format!(" {first}=5 {long}=-3")),
        ([&long, &bits], format!(" {long}=-3 {bits}=4064")),
    ] {
        let shown = done(site, &["variable", "watch", registers[0], registers[1], "--count", "3"]);
        assert!(shown.lines().all(|line| line.ends_with(&values)), "{shown}");
    }
}

fn samples_are_gathered(site: &VirtualSite) {
    let (status, gathered, stderr) =
        site.pmacctl(&["gather", "--source", "servo_timer", "--seconds", "0.2", "-o", "-"]);
    assert_eq!(status, 0, "{stderr}");
    let timer = |line: &str| line.rsplit(',').next().unwrap().parse::<i64>().unwrap();
    let timers: Vec<i64> = gathered.lines().skip(1).map(timer).collect();
    assert!(timers.len() > 400 && timers.windows(2).all(|pair| pair[1] == pair[0] + 1), "{gathered}");
}

/// It is longer than the buffer in the DPRAM, so that both indices go round.
fn a_program_runs(site: &VirtualSite, kind: &Board) {
    let mut board = site.connection();
    board.send("&1 #1->X", PATIENCE).unwrap();
    board.send(&format!("M100->Y:${}9,0,4", kind.free), PATIENCE).unwrap();
    let text = format!("RAPID INC X20\nM100=6\nM100|=3\n{}DWELL 1000\n", "X1\n".repeat(10));
    let program = site.file("program.pmc", &text);
    let (status, _, stderr) =
        site.pmacctl(&["rotary", "stream", &program, "--define", "200", "--size", "24", "--run"]);
    assert_eq!(status, 0, "{stderr}");
    site.wait_until("the dwell behind its moves", || ask(&mut board, "PR") == 0.0);
    assert_eq!((ask(&mut board, "#1P").round(), ask(&mut board, "M100")), (30.0, 7.0));
}

#[test]
fn every_function_works_on_a_board_of_either_family() {
    for board in [PMAC, TURBO] {
        every_function_works(&board.site(), &board);
    }
}

#[test]
fn firmware_that_writes_no_variables_is_not_asked_to() {
    for (firmware, writes) in [("1.15F", false), ("1.15G", true)] {
        let site = VirtualSite::running(&["--firmware", firmware], &[]);
        site.wait_for_identity();
        let (status, _, told) = site.pmacctl(&["variable", "set", "Y:$0770=5"]);
        assert_eq!(status == 0, writes, "{firmware}: {told}");
        assert_eq!(told.contains("from 1.15G on"), !writes, "{told}");
        site.assert_no_violations();
    }
}
