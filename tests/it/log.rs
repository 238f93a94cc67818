//! `pmacctl log`: every servo update in a file, and what is missing in rows of its own.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, ChildStdout, Stdio};
use std::time::Duration;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use pmac_dpram::segment::Counter;
use pmac_dpram::table::Table;

use crate::support::{PATIENCE, VirtualSite, wait_until};

/// Servo cycles at a time: what the segment keeps is four times as much.
const PIECE: u64 = 1000;
/// Rows that the log may not have sent yet: it collects 8 KiB.
const COLLECTED: u64 = 400;

/// A log to a pipe, on a board whose time stands still but for the steps of the test.
struct Log<'a> {
    site: &'a VirtualSite,
    child: Child,
    stdout: BufReader<ChildStdout>,
    text: String,
}

impl<'a> Log<'a> {
    fn begin(site: &'a VirtualSite, options: &[&str]) -> Self {
        site.wait_until("the board's scales", || site.has_scales());
        site.hold();
        let arguments = [&["log", "-o", "-", "--motors", "1"], options].concat();
        let mut child =
            site.command(&arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let stdout = BufReader::new(child.stdout.take().unwrap());
        let mut log = Self { site, child, stdout, text: String::new() };
        // Nobody can see when it has attached; it has when it writes.
        log.follow_until(1);
        log
    }

    /// Lets time pass, and reads rows, until update `number` has been read.
    fn follow_until(&mut self, number: u64) {
        let attached = self.site.attach();
        let published = || attached.counter(Counter::Updates);
        let mut last = 0;
        let mut due = 0;
        while last < number {
            if last >= due {
                self.site.step(PIECE);
                due = published().saturating_sub(COLLECTED);
            }
            let mut line = String::new();
            assert!(self.stdout.read_line(&mut line).unwrap() > 0, "the log has ended");
            last = line.split(',').next().and_then(|update| update.parse().ok()).unwrap_or(0);
            due = due.min(published().saturating_sub(COLLECTED));
            self.text += &line;
        }
    }

    /// Ends it as a service manager does: its table, and its last words.
    fn end(self) -> (Table, String) {
        let (text, said) = self.stop();
        (Table::parse(text.as_bytes()).unwrap(), said)
    }

    /// The same, with its rows as text.
    fn stop(mut self) -> (String, String) {
        kill(Pid::from_raw(self.child.id().cast_signed()), Signal::SIGTERM).unwrap();
        for line in self.stdout.lines() {
            self.text += &line.unwrap();
            self.text.push('\n');
        }
        let said = std::io::read_to_string(self.child.stderr.take().unwrap()).unwrap();
        assert!(self.child.wait().unwrap().success(), "{said}");
        self.site.go_on();
        (self.text, said)
    }
}

#[test]
fn every_update_stands_in_the_file() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_axes();
    site.ask("#1J+");
    let mut log = Log::begin(&site, &[]);
    let first = site.attach().counter(Counter::Updates);
    log.follow_until(first + 10 * PIECE);
    let (table, said) = log.end();
    let column = |name: &str| table.column(name).unwrap();
    let updates = column("update");
    assert!(updates.windows(2).all(|pair| pair[1] == pair[0] + 1.0), "one after the other");
    assert!(updates.len() as u64 >= 10 * PIECE);
    let summary = format!("updates={} lost=0 missed=0\n", updates.len());
    assert!(said.ends_with(&summary), "{said}");
    // By the board's own timer: a servo cycle from row to row.
    let period = 3_713_707.0 / 8_388_608_000.0;
    let (times, positions) = (column("time_s"), column("1.actual_position"));
    let span = times[times.len() - 1] - times[0];
    assert!((span - period * (times.len() - 1) as f64).abs() < 1e-6, "{span}");
    assert!(positions.windows(2).skip(PIECE as usize).all(|pair| pair[1] > pair[0]), "the motor jogs");
    let index = table.index("1.velocity").unwrap();
    assert_eq!(table.fields[index].unit, "count/s");
}

/// Seconds of the board's time that the long log takes, unless `PMAC_LOG_SECONDS` says otherwise.
const LONG_SECONDS: u64 = 3600;

#[test]
#[ignore = "an hour of the board's time, as fast as it goes"]
fn an_hour_of_updates_stands_in_the_file() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_axes();
    site.ask("#1J+");
    let seconds = std::env::var("PMAC_LOG_SECONDS").map_or(LONG_SECONDS, |text| text.parse().unwrap());
    let began = std::time::Instant::now();
    let mut log = Log::begin(&site, &[]);
    let first = site.attach().counter(Counter::Updates);
    let (mut rows, mut last) = (0_u64, None);
    let mut count = |text: &str| {
        // What is no number is the table's head.
        for number in text.lines().filter_map(|line| line.split(',').next()?.parse::<u64>().ok()) {
            assert!(last.is_none_or(|last| number == last + 1), "{number} after {last:?}");
            (last, rows) = (Some(number), rows + 1);
        }
    };
    let end = first + seconds * 2258;
    for piece in (first..end).step_by(PIECE as usize) {
        log.follow_until(piece + PIECE);
        count(&std::mem::take(&mut log.text));
    }
    let (rest, said) = log.stop();
    count(&rest);
    assert!(rows >= end - first && said.ends_with(&format!("updates={rows} lost=0 missed=0\n")), "{said}");
    println!(
        "{seconds} s of the board's time in {:.0} s: {}",
        began.elapsed().as_secs_f64(),
        said.trim_end()
    );
}

#[test]
fn what_the_daemon_missed_is_a_row_of_its_own() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_axes();
    let mut log = Log::begin(&site, &["--fields", "commanded_position"]);
    let subscriber = site.attach();
    let missed_before = subscriber.counter(Counter::Missed);
    for pause in [3, 40] {
        site.daemon_stands_still(true);
        site.step(pause);
        site.daemon_stands_still(false);
        log.follow_until(subscriber.counter(Counter::Updates) + PIECE);
    }
    let missed = subscriber.counter(Counter::Missed) - missed_before;
    assert!(missed >= 40, "{missed}");
    let (table, said) = log.end();
    let column = |name: &str| table.column(name).unwrap();
    let (counted, positions) = (column("missed"), column("1.commanded_position"));
    assert_eq!(counted.iter().sum::<f64>() as u64, missed);
    let gaps = counted.iter().zip(positions).filter(|(missed, _)| **missed > 0.0);
    assert!(gaps.clone().count() >= 2 && gaps.clone().all(|(_, position)| position.is_nan()));
    let updates = positions.iter().filter(|position| !position.is_nan()).count();
    assert!(said.ends_with(&format!("updates={updates} lost=0 missed={missed}\n")), "{said}");
    // The time goes on by what the board did meanwhile.
    let times = column("time_s");
    let period = 3_713_707.0 / 8_388_608_000.0;
    let span = times[times.len() - 1] - times[0];
    assert!((span - period * ((updates - 1) as f64 + missed as f64)).abs() < 1e-6, "{span}");
}

#[test]
fn a_pause_of_the_daemon_is_told_and_that_its_updates_are_not_counted() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_axes();
    let mut log = Log::begin(&site, &["--fields", "commanded_position"]);
    let subscriber = site.attach();
    // Longer than the data may be old: 0.44 s and 0.89 s.
    for pause in [1000, 2000] {
        site.daemon_stands_still(true);
        site.step(pause);
        site.daemon_stands_still(false);
        log.follow_until(subscriber.counter(Counter::Updates) + PIECE);
    }
    let (table, said) = log.end();
    let column = |name: &str| table.column(name).unwrap();
    let (missed, lost, positions) = (column("missed"), column("lost"), column("1.commanded_position"));
    let is_pause = |row: &usize| positions[*row].is_nan() && missed[*row] == 0.0 && lost[*row] == 0.0;
    assert_eq!((0..table.rows()).filter(is_pause).count(), 2, "{said}");
    let told = "2 pauses of the board or of pmacd, 1.3 s in all: the updates in that time, if the board made any, are not counted";
    assert!(said.contains(told), "{said}");
    let last = said.lines().last().unwrap_or_default();
    assert!(last.starts_with("updates=") && last.contains(" lost=0 missed="), "{said}");
    // Without a pause there is nothing to say.
    let file = site.path("none.csv").display().to_string();
    let arguments = ["log", "-o", &file, "--motors", "1", "--seconds", "0.05", "--json"];
    let ran = site.run_slowly(&arguments);
    let document: serde_json::Value = serde_json::from_str(&ran.stdout).unwrap();
    assert_eq!((&document["pauses"], &document["paused_s"]), (&0.into(), &0.0.into()), "{ran:?}");
    assert!(!ran.stderr.contains("pause"), "{ran:?}");
}

#[test]
fn an_update_of_unknown_scale_is_missing_and_the_time_goes_on_over_a_reset() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_axes();
    site.wait_until("the board's scales", || site.has_scales());
    let mut child = site.command(&["log", "-o", "-", "--motors", "1"]);
    let mut child = child.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let stdout = child.stdout.take().unwrap();
    let text = std::thread::spawn(move || std::io::read_to_string(stdout).unwrap());
    site.run_for(Duration::from_secs(1));
    // A reset: the board's timer begins anew, and the report comes again with a GATHER.
    let seconds = || site.with_world(|world| world.now_ns()) as f64 / 1e9;
    let reset = seconds();
    site.control("reset");
    site.run_for(Duration::from_secs(2));
    let mut board = site.connection();
    site.wait_until("a board that takes commands", || board.send("P1", PATIENCE).is_ok());
    let least = seconds() - reset;
    board.send("GATHER", PATIENCE).unwrap();
    let most = seconds() - reset;
    site.run_for(Duration::from_secs(1));
    // Another daemon, which does not know the scales.
    site.stop_daemon();
    site.start_daemon(&["--config", &site.file("silent.toml", "ask_board = false\n")]);
    site.wait_for_live_servo();
    site.run_for(Duration::from_millis(500));
    kill(Pid::from_raw(child.id().cast_signed()), Signal::SIGTERM).unwrap();
    let table = Table::parse(text.join().unwrap().as_bytes()).unwrap();
    let said = std::io::read_to_string(child.stderr.take().unwrap()).unwrap();
    assert!(child.wait().unwrap().success(), "{said}");
    let column = |name: &str| table.column(name).unwrap();
    let (positions, missed) = (column("1.actual_position"), column("missed"));
    let known = positions.iter().filter(|position| !position.is_nan()).count();
    assert!(said.contains(&format!("updates={known} lost=0 missed=")), "{known}: {said}");
    let (times, updates) = (column("time_s"), column("update"));
    // What was read has a number of its own; a gap has that of the update before.
    let is_gap = |row: usize| row > 0 && updates[row] == updates[row - 1];
    let read = (0..missed.len()).filter(|row| missed[*row] > 0.0 && !is_gap(*row)).count();
    assert!(said.contains(&format!("{read} of the missed were read, but the board had not told")), "{said}");
    let status = column("1.servo_status");
    let without: Vec<_> = (0..missed.len()).filter(|row| positions[*row].is_nan()).collect();
    assert!(read > 0 && without.iter().all(|row| status[*row].is_nan()), "{read}");
    assert!(without.iter().all(|row| is_gap(*row) || missed[*row] == 1.0), "{read}");
    let firsts = 1 + updates.windows(2).position(|pair| pair[1] < pair[0]).unwrap();
    let pauses = times[..firsts].windows(2).map(|pair| pair[1] - pair[0]);
    let pause = pauses.fold(0.0, f64::max);
    assert!((least - 0.05..most + 0.05).contains(&pause), "{pause} s, not {least} to {most}");
}

/// After a reset the scales come again a while after the updates, and after a start of `pmacd` too.
#[test]
fn a_log_waits_for_the_scales_before_it_decides_its_columns() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_axes();
    site.wait_until("the board's scales", || site.has_scales());
    site.control("reset");
    let mut board = site.connection();
    site.wait_until("the report again", || board.send("GATHER", PATIENCE).is_ok());
    let (status, stdout, said) = site.pmacctl(&["log", "-o", "-", "--motors", "1", "--seconds", "0.1"]);
    assert!(status == 0 && said.ends_with(" lost=0 missed=0\n"), "{said}");
    let head = stdout.lines().next().unwrap_or_default();
    assert!(head.contains("time_s,") && head.contains("1.actual_position [count]"), "{head}");
}

#[test]
fn without_scales_a_log_is_raw_after_a_bounded_time_and_says_so() {
    let site = VirtualSite::new();
    site.start_simulator(&["--dpram-startup"]);
    site.start_daemon(&["--config", &site.file("silent.toml", "ask_board = false\n")]);
    site.wait_for_live_servo();
    let (status, stdout, said) = site.pmacctl(&["log", "-o", "-", "--motors", "1", "--seconds", "0.1"]);
    assert_eq!(status, 0, "{said}");
    assert!(
        said.contains("time_s, 1.commanded_position") && said.contains("has not told the scale"),
        "{said}"
    );
    assert!(stdout.starts_with("update,servo_cycle,"), "{stdout:.200}");
}

/// A log into `file`, which has begun.
fn log_into(site: &VirtualSite, file: &Path, options: &[&str]) -> Child {
    let arguments = [&["log", "-o", file.to_str().unwrap(), "--motors", "1"], options].concat();
    let child = site.command(&arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    // It is opened at the first update.
    site.wait_until("the log's file", || file.exists());
    child
}

#[test]
fn data_that_stop_and_stay_away_are_a_row_at_the_end_and_exit_status_1() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_axes();
    for seconds in [Some(30.0), None] {
        site.wait_for_live_servo();
        site.wait_until("the board's scales", || site.has_scales());
        let file = site.path(if seconds.is_some() { "timed.csv" } else { "stopped.csv" });
        let options =
            seconds.map_or(vec![], |seconds: f64| vec!["--seconds".to_owned(), seconds.to_string()]);
        let log = log_into(&site, &file, &options.iter().map(String::as_str).collect::<Vec<_>>());
        let pid = Pid::from_raw(log.id().cast_signed());
        // No GATHER follows: the report does not come again.
        site.control("reset");
        let output = std::thread::spawn(|| log.wait_with_output().unwrap());
        if seconds.is_none() {
            site.run_for(Duration::from_secs(4));
            kill(pid, Signal::SIGTERM).unwrap();
        }
        site.wait_until("the end of the log", || output.is_finished());
        let output = output.join().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        let last = said.lines().last().unwrap_or_default();
        assert!(
            output.status.code() == Some(1) && last.starts_with("no update came for the last "),
            "{said}"
        );
        let mut board = site.connection();
        site.wait_until("the report again", || board.send("GATHER", PATIENCE).is_ok());
        let table = Table::parse(&std::fs::read(&file).unwrap()).unwrap();
        let column = |name: &str| table.column(name).unwrap();
        let end = table.rows() - 1;
        let row: Vec<f64> = ["missed", "lost"].iter().map(|name| column(name)[end]).collect();
        assert!(row == [0.0, 0.0] && column("1.actual_position")[end].is_nan(), "{row:?}");
        assert_eq!(column("update")[end], column("update")[end - 1]);
        for time in ["time_s", "unix_s"] {
            let pause = column(time)[end] - column(time)[end - 1];
            assert!(pause >= 1.0, "{time}: {pause}");
        }
        let length = column("time_s")[end];
        assert!(seconds.is_none_or(|seconds| length <= seconds + 0.1), "{length}");
    }
}

#[test]
fn a_trigger_that_never_comes_leaves_the_file_as_it_was() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_axes();
    let file = site.path("log.csv");
    std::fs::write(&file, "an old one").unwrap();
    let options = ["-o", file.to_str().unwrap(), "--motors", "1", "--trigger", "1.velocity>1e9"];
    let mut log = site.command(&[&["log"], &options[..]].concat());
    let child = log.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    // Longer than rows may wait until they are written.
    std::thread::sleep(Duration::from_millis(2500));
    kill(Pid::from_raw(child.id().cast_signed()), Signal::SIGTERM).unwrap();
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(1) && said.ends_with("nothing is written\n"), "{said}");
    assert_eq!(said.matches("waiting for 1.velocity>1000000000; ^C ends it\n").count(), 1, "{said}");
    assert_eq!(std::fs::read(&file).unwrap(), b"an old one");
}

/// After a reset the length of a servo cycle is not known for a while. The timer, which begins anew, is no turn of its 24 bits then.
#[test]
fn a_turbo_boards_reset_is_no_number_of_missed_updates() {
    let site =
        VirtualSite::configured(&["--family", "turbo2"], "family = \"turbo2\"\n[servo]\nmotors = [1]\n");
    site.wait_until("the board's scales", || site.has_scales());
    let mut child = site.command(&["log", "-o", "-", "--motors", "1"]);
    let mut child = child.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let stdout = child.stdout.take().unwrap();
    let text = std::thread::spawn(move || std::io::read_to_string(stdout).unwrap());
    site.run_for(Duration::from_secs(1));
    site.control("reset");
    let mut board = site.connection();
    site.wait_until("the report again", || board.send("I47=1 I57=0 I48=1", PATIENCE).is_ok());
    site.run_for(Duration::from_secs(1));
    kill(Pid::from_raw(child.id().cast_signed()), Signal::SIGTERM).unwrap();
    let table = Table::parse(text.join().unwrap().as_bytes()).unwrap();
    assert!(child.wait().unwrap().success());
    let (all_missed, status) = (table.column("missed").unwrap(), table.column("1.servo_status").unwrap());
    for (missed, status) in all_missed.iter().zip(status) {
        assert!(*missed == 0.0 || status.is_nan(), "what was missed has no values: {missed}, {status}");
    }
    let missed: f64 = all_missed.iter().sum();
    let times = table.column("time_s").unwrap();
    assert!(times.len() > 1000 && missed < 100_000.0, "{} rows, {missed} missed", times.len());
}

#[test]
fn a_trigger_brings_the_rows_from_before_it() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_axes();
    site.wait_until("the board's scales", || site.has_scales());
    let file = site.path("log.csv").display().to_string();
    let options = ["--trigger", "|1.following_error|>5", "--before", "0.1", "--seconds", "0.2"];
    let arguments = [&["log", "-o", &file, "--motors", "1"], &options[..]].concat();
    let child = site.command(&arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    // The motor stands until the log has begun, and moves to and fro until it has seen that and ended.
    site.wait_until("the log's file", || std::fs::exists(&file).unwrap());
    let output = std::thread::spawn(|| child.wait_with_output().unwrap());
    let mut there = false;
    // Time runs at its real speed, so that the log, a process of its own, keeps up.
    wait_until("the end of the log", || {
        site.ask(if there { "#1J=0" } else { "#1J=5000" });
        there = !there;
        output.is_finished()
    });
    let output = output.join().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let table = Table::parse(&std::fs::read(&file).unwrap()).unwrap();
    let (times, errors) = (table.column("time_s").unwrap(), table.column("1.following_error").unwrap());
    let at = times.iter().position(|time| *time == 0.0).unwrap();
    assert!(errors[at].abs() > 5.0 && errors[..at].iter().all(|error| error.abs() <= 5.0), "{}", errors[at]);
    assert!(times[0] < 0.0 && times[0] >= -0.11, "{}", times[0]);
    assert!((0.15..0.25).contains(&times[times.len() - 1]), "{}", times[times.len() - 1]);
}

#[test]
fn what_is_missing_before_the_trigger_is_a_row_too() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_axes();
    site.wait_until("the board's scales", || site.has_scales());
    let file = site.path("log.csv");
    let options = ["--trigger", "|1.commanded_position|>50", "--before", "60", "--seconds", "0.2"];
    let log = log_into(&site, &file, &options);
    site.run_for(Duration::from_millis(100));
    site.daemon_stands_still(true);
    site.step(40);
    site.daemon_stands_still(false);
    site.run_for(Duration::from_millis(100));
    let output = std::thread::spawn(|| log.wait_with_output().unwrap());
    site.ask("#1J=5000");
    site.wait_until("the end of the log", || output.is_finished());
    let output = output.join().unwrap();
    let (told, said) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{said}");
    let table = Table::parse(&std::fs::read(&file).unwrap()).unwrap();
    let column = |name: &str| table.column(name).unwrap();
    let missed = column("missed");
    let gap = missed.iter().position(|missed| *missed >= 40.0).unwrap();
    assert!(column("time_s")[gap] < 0.0 && column("1.commanded_position")[gap].is_nan());
    assert_eq!(column("update")[gap], column("update")[gap - 1]);
    let (updates, missed) =
        (missed.iter().filter(|missed| **missed == 0.0).count(), missed.iter().sum::<f64>());
    assert!(told.ends_with(&format!("updates={updates} lost=0 missed={missed}\n")), "{told}");
}

#[test]
fn what_cannot_be_logged_is_refused_in_words() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    for (options, said) in [
        (&["-o", "x.txt"][..], "the name must end in .csv or .npy"),
        (&["-o", "-", "--motors", "9"], "motor 9 is not in the servo report; it has 1, 2, 3"),
        (&["-o", "-", "--fields", "speed"], "the servo report has no \"speed\"; it has commanded_position"),
        (&["-o", "-", "--trigger", "1.speed>3"], "--trigger: the servo report has no \"speed\""),
        (&["-o", "-", "--trigger", "12.velocity>3"], "--trigger: motor 12 is not in the servo report"),
        (&["-o", "-", "--keep", "1G"], "stdout is one file"),
        (&["-o", "-", "--before", "3"], "--trigger"),
        (&["-o", "/nonexistent/x.csv"], "/nonexistent/x.csv: No such file"),
    ] {
        let (status, stdout, stderr) = site.pmacctl(&[&["log"], options].concat());
        assert_eq!((status, &*stdout), (2, ""), "{options:?}: {stderr}");
        assert!(stderr.contains(said), "{options:?}: {stderr}");
    }
}
