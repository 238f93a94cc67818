//! `pmacctl terminal`: in a pipe, and on a terminal. `pmacctl rotary stream` on a terminal.

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::os::fd::OwnedFd;
use std::process::{Child, Stdio};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::support::bench::Bench;
use crate::support::rig::{Ran, command, pty};
use crate::support::{PATIENCE, VirtualSite, status_within, wait_until};

fn terminal(site: &VirtualSite, options: &[&str]) -> std::process::Command {
    let mut command = command();
    command.args(["--name", &site.name, "--socket"]).arg(site.socket()).arg("terminal").args(options);
    command
}

fn piped(site: &VirtualSite, options: &[&str]) -> Child {
    let mut command = terminal(site, options);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

#[test]
fn in_a_pipe_replies_errors_and_texts_are_kept_apart() {
    let site = VirtualSite::running(&[], &[]);
    let mut child = piped(&site, &[]);
    let mut stdin = child.stdin.take().unwrap();
    let mut stdout = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
    stdin.write_all(b"P1=5\n\n P1 P2 \nUUU\n").unwrap();
    assert_eq!((stdout.next().unwrap(), stdout.next().unwrap()), ("5".to_owned(), "0".to_owned()));
    let mut stderr = BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap);
    assert_eq!(stderr.next().unwrap(), "ERR003: data error or unrecognized command");
    site.control("send HELLO THERE");
    assert_eq!(stderr.next().unwrap(), "-- SEND: HELLO THERE");
    stdin.write_all(b"^K\n#1?\n.quit\nP1=6\n").unwrap();
    let status = u64::from_str_radix(&stdout.next().unwrap(), 16).unwrap();
    assert_eq!(status >> 42 & 1, 1, "killed: the loop is open");
    assert_eq!(child.wait().unwrap().code(), Some(1), "one line was refused");
    assert_eq!(site.connection().send("P1", PATIENCE).unwrap(), ["5"], "nothing after .quit");

    let mut child = piped(&site, &["--json"]);
    child.stdin.take().unwrap().write_all(b"P1..2\nUUU\n.frob\n").unwrap();
    let ran = Ran::from(child.wait_with_output().unwrap());
    let lines: Vec<serde_json::Value> =
        ran.stdout.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines[0], serde_json::json!({ "line": "P1..2", "lines": ["5", "0"], "error": null }));
    assert_eq!(lines[1]["error"]["code"], 3);
    assert!(lines[2]["error"]["message"].as_str().unwrap().contains(".help"));
    site.assert_no_violations();
}

#[test]
fn control_characters_of_the_board_do_nothing_unless_wanted() {
    let site = VirtualSite::running(&[], &[]);
    for (options, shown) in [(&[][..], "-- SEND: A\\x1b[2JB"), (&["--raw"], "-- SEND: A\u{1b}[2JB")] {
        let mut child = piped(&site, options);
        let mut stdin = child.stdin.take().unwrap();
        stdin.write_all(b"P1\n").unwrap();
        let mut stdout = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
        assert_eq!(stdout.next().unwrap(), "0");
        site.control("send A\u{1b}[2JB");
        let mut stderr = BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap);
        assert_eq!(stderr.next().unwrap(), shown);
        stdin.write_all(b".quit\n").unwrap();
        child.wait().unwrap();
    }
}

#[test]
fn of_a_reply_that_breaks_off_what_came_is_shown() {
    let bench = Bench::new();
    for (options, shown) in [
        (&[][..], "a part of it\nb\n"),
        (&["--json"], "{\"error\":{\"code\":null,\"message\":\"the board did not answer in time"),
    ] {
        let mut command = command();
        command.arg("--socket").arg(&bench.socket).arg("terminal").args(options);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        child.stdin.take().unwrap().write_all(b"PART\nb\n").unwrap();
        let ran = Ran::from(child.wait_with_output().unwrap());
        assert!(ran.stdout.starts_with(shown), "{ran:?}");
        assert!(ran.stdout.contains("a part of it") && ran.stdout.lines().count() == 2, "{ran:?}");
        assert_eq!(ran.stderr.contains("may or may not"), options.is_empty(), "{ran:?}");
        assert_eq!(ran.code, Some(1));
    }
}

/// A process that is not left behind by a test that fails.
struct Running(Child);

impl Running {
    fn ended(mut self) -> Option<i32> {
        status_within(&mut self.0, PATIENCE).code()
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A person at a terminal, who types and sees.
struct Person {
    keyboard: File,
    screen: Arc<Mutex<String>>,
}

impl Person {
    /// Sits down at the terminal of this end.
    fn at(master: OwnedFd) -> Self {
        let keyboard = File::from(master);
        let screen = Arc::new(Mutex::new(String::new()));
        let (seen, mut source) = (Arc::clone(&screen), keyboard.try_clone().unwrap());
        std::thread::spawn(move || {
            let mut bytes = [0; 1024];
            while let Ok(count @ 1..) = source.read(&mut bytes) {
                seen.lock().unwrap().push_str(&String::from_utf8_lossy(&bytes[..count]));
            }
        });
        Self { keyboard, screen }
    }

    fn types(&mut self, text: &str) {
        self.keyboard.write_all(text.as_bytes()).unwrap();
    }

    fn sees(&self, text: &str) {
        wait_until(&format!("{text:?} on the screen"), || self.screen().contains(text));
    }

    fn sees_prompt_behind(&self, text: &str) {
        wait_until(&format!("a prompt behind {text:?}"), || {
            self.screen().rsplit_once(text).is_some_and(|(_, behind)| behind.contains("&1> "))
        });
    }

    fn screen(&self) -> String {
        self.screen.lock().unwrap().clone()
    }
}

#[test]
fn on_a_terminal_there_is_a_prompt_editing_and_history() {
    let site = VirtualSite::running(&[], &[]);
    let size = nix::pty::Winsize { ws_row: 24, ws_col: 80, ws_xpixel: 0, ws_ypixel: 0 };
    let pty = pty(Some(&size));
    let state = tempfile::tempdir().unwrap();
    let slave = || Stdio::from(pty.slave.try_clone().unwrap());
    let start = |state: &std::path::Path| {
        let mut command = terminal(&site, &[]);
        command.env("XDG_STATE_HOME", state).env("TERM", "xterm");
        Running(command.stdin(slave()).stdout(slave()).stderr(slave()).spawn().unwrap())
    };
    let child = start(state.path());
    let mut person = Person::at(pty.master);
    person.sees("#8 &1> ");
    // A wrong character, taken back.
    person.types("P9=12\x7f7\r");
    person.types("P9\r");
    person.sees("\n17\r\n");
    person.types("#2\r");
    person.sees("#2 &1> ");
    person.types("UUU\r");
    person.sees("ERR003: data error or unrecognized command");
    person.types("P9=P9");
    person.sees("P9=P9");
    site.control("send WATCH OUT");
    person.sees("-- SEND: WATCH OUT");
    person.types("+1\r");
    // Two lines back in the history, and this one again.
    person.types("P9\r");
    person.sees("\n18\r\n");
    person.types("\x1b[A\x1b[A\rP9\r");
    person.sees("\n19\r\n");
    person.types(".quit\r");
    assert_eq!(child.ended(), Some(0), "{}", person.screen());
    let history = std::fs::read_to_string(state.path().join("pmacctl/history")).unwrap();
    assert!(history.contains("P9=P9+1\nP9\n"), "{history}");

    let child = start(state.path());
    site.wait_until("another prompt", || person.screen().matches(".quit ends").count() == 2);
    person.types("\x1b[A\x1b[A\r");
    site.wait_until("the answer", || person.screen().matches("\n19\r\n").count() == 2);
    // End of input. Without a prompt the terminal is not yet in the editor's mode, and takes ^D for itself.
    person.sees_prompt_behind("\n19\r\n");
    person.types("\x04");
    assert_eq!(child.ended(), Some(0), "{}", person.screen());
    site.assert_no_violations();
}

#[test]
fn the_keys_that_abort_and_kill_reach_the_board_from_an_empty_line() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    let pty = pty(Some(&nix::pty::Winsize { ws_row: 24, ws_col: 80, ws_xpixel: 0, ws_ypixel: 0 }));
    let slave = || Stdio::from(pty.slave.try_clone().unwrap());
    let mut command = terminal(&site, &["--no-history"]);
    let command = command.env("TERM", "xterm").stdin(slave()).stdout(slave()).stderr(slave());
    let child = Running(command.spawn().unwrap());
    let mut person = Person::at(pty.master);
    person.sees("&1> ");
    let shows = |flag: &str| site.pmacctl(&["motors"]).1.contains(flag);
    // In the middle of a line they are not sent, and the line stays as it is, with its cursor.
    person.types("P99=15\x1b[D\x0b");
    person.sees("^K: not sent, because a line is begun");
    person.types("\x01");
    person.sees("^A: not sent");
    person.types("2\rP99\r");
    person.sees("\n125\r\n");
    assert!(!shows("open-loop"), "nothing is killed");
    person.types("#1J+\r");
    site.wait_until("the jog", || shows("moving"));
    person.types("\x0b");
    person.sees("\n^K sent\r\n");
    site.wait_until("the open loops of killed motors", || shows("open-loop"));
    person.types("\x01");
    site.wait_until("the closed loops of an abort", || !shows("open-loop"));
    // ^C still drops a line. Without a prompt the terminal is not yet in the editor's mode, and takes it for itself.
    person.types("P98=7 P98\r");
    person.sees_prompt_behind("\n7\r\n");
    person.types("P99=3333\x03");
    person.sees_prompt_behind("P99=3333");
    person.types("P97=P99 P97\r");
    site.wait_until("the answer", || person.screen().matches("\n125\r\n").count() == 2);
    person.types(".quit\r");
    assert_eq!(child.ended(), Some(0), "{}", person.screen());
    site.assert_no_violations();
}

#[test]
fn on_a_terminal_a_stream_shows_how_far_it_is() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    let mut connection = site.connection();
    connection.send("&1 #1->X", PATIENCE).unwrap();
    // More than the board's buffer holds, and than it runs in a moment.
    let moves: String = (0..1350).map(|step| format!("X{}\n", step % 2)).collect();
    let path = site.path("run.pmc");
    std::fs::write(&path, format!("LINEAR ABS TM5 TA2 TS0\n{moves}")).unwrap();
    let pty = pty(Some(&nix::pty::Winsize { ws_row: 24, ws_col: 80, ws_xpixel: 0, ws_ypixel: 0 }));
    let slave = || Stdio::from(pty.slave.try_clone().unwrap());
    let mut command = command();
    command.args(["--name", &site.name, "--socket"]).arg(site.socket()).args(["rotary", "stream"]).arg(&path);
    command.args(["--define", "1000", "--run"]).env("TERM", "xterm");
    let child = Running(command.stdin(slave()).stdout(slave()).stderr(slave()).spawn().unwrap());
    let person = Person::at(pty.master);
    person.sees(" of 1351 lines, ");
    let ended = site.hurried(|| child.ended());
    // What was said last may not be on the screen yet.
    site.wait_until("the end of the screen", || person.screen().ends_with("\r\n"));
    assert_eq!(ended, Some(0), "{}", person.screen());
    site.wait_until("the whole summary", || person.screen().ends_with("for a jog or the next stream\r\n"));
    let screen = person.screen();
    // Each state of the bar replaces the one before, and the summary the last one.
    let mut states: Vec<&str> = screen.split("\x1b[K").collect();
    let summary = states.pop().unwrap();
    assert!(summary.starts_with("lines=1351 commands=1354 underruns="), "{screen:?}");
    let (figures, goes_on) = summary.split_once("\r\n").unwrap();
    assert!(figures.contains(" seconds=") && !figures.contains('\n'), "{screen:?}");
    assert!(goes_on.contains("pmacctl send '&1Q'") && goes_on.lines().count() == 1, "{screen:?}");
    assert_eq!(states.pop(), Some("\r"), "the bar is wiped out");
    let sent = |state: &&str| -> usize {
        let (bar, rest) = state.strip_prefix("\r[").unwrap().split_once("] ").unwrap();
        assert!(bar.len() == 30 && bar.trim_start_matches('#').trim_end_matches('-').is_empty(), "{state:?}");
        assert!(
            rest.contains(" of 1351 lines, ") && rest.ends_with(" s") && !rest.contains('\n'),
            "{state:?}"
        );
        rest.split_once(' ').unwrap().0.parse().unwrap()
    };
    let sent: Vec<usize> = states.iter().map(sent).collect();
    assert!(sent.is_sorted() && sent.last().is_some_and(|&last| last <= 1351), "{sent:?}");
    assert!(states.iter().any(|state| state.contains('#')), "{screen:?}");
    connection.send("&1A", PATIENCE).unwrap();
    assert_eq!(
        connection.send("I57", PATIENCE).unwrap(),
        ["0"],
        "no buffer is left open, and the function off"
    );
    site.assert_no_violations();
}

#[test]
fn a_piped_terminal_notices_a_reset_between_two_lines() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_identity();
    // A reset shows when the board has run for longer before it than since.
    site.run_for(Duration::from_secs(10));
    let mut child = piped(&site, &[]);
    let mut stdin = child.stdin.take().unwrap();
    let mut stdout = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
    stdin.write_all(b"P1=5\nP1\n").unwrap();
    assert_eq!(stdout.next().unwrap(), "5");
    site.control("reset");
    // What is under way while the daemon notices the reset is given up, and told so.
    site.run_for(Duration::from_millis(500));
    stdin.write_all(b"P2=6\nP2\n").unwrap();
    assert_eq!(stdout.next().unwrap(), "6");
    drop(stdin);
    let ran = Ran::from(child.wait_with_output().unwrap());
    assert_eq!(ran.code, Some(1), "{ran:?}");
    assert!(ran.stderr.contains("reset between line 1 and line 4"), "{ran:?}");
    // One that nothing disturbs ends well.
    let mut child = piped(&site, &[]);
    child.stdin.take().unwrap().write_all(b"P1=5\n").unwrap();
    assert_eq!(Ran::from(child.wait_with_output().unwrap()).code, Some(0));
}

#[test]
fn a_line_by_an_address_that_somebody_else_has_changed_is_not_sent() {
    let site = VirtualSite::running(&[], &[]);
    let mut other = site.connection();
    let mut child = piped(&site, &[]);
    let mut stdin = child.stdin.take().unwrap();
    let mut stdout = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
    let mut stderr = BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap);
    stdin.write_all(b"#2\nP\n").unwrap();
    stdout.next().unwrap();
    other.send("#5", PATIENCE).unwrap();
    stdin.write_all(b"J+\n").unwrap();
    let told = stderr.next().unwrap();
    assert_eq!(
        told,
        "not sent: somebody else has addressed #5 &1 meanwhile; write into the line what it is for, as in #2 &1 J+"
    );
    // What names its motor, or is for none, is sent.
    stdin.write_all(b"P7=4\nP7\n#2P\n").unwrap();
    assert_eq!((stdout.next().unwrap().as_str(), stdout.next().unwrap().as_str()), ("4", "0"));
    drop(stdin);
    assert_eq!(child.wait().unwrap().code(), Some(1));
    for motor in [2, 5] {
        let speed: f64 = other.send(&format!("#{motor}V"), PATIENCE).unwrap()[0].parse().unwrap();
        assert!(speed.abs() < 0.1, "motor {motor} moves");
    }
    site.assert_no_violations();
}

#[test]
fn a_line_that_belongs_into_a_buffer_is_no_command_when_somebody_has_closed_that() {
    for closing in ["CLOSE", "a reset"] {
        let site = VirtualSite::running(&[], &[]);
        site.wait_for_live_servo();
        let mut other = site.connection();
        site.wait_until("a board that takes commands", || site.connection().send("P7=1", PATIENCE).is_ok());
        let mut child = piped(&site, &[]);
        let mut stdin = child.stdin.take().unwrap();
        let mut stderr = BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap);
        stdin.write_all(b"OPEN PROG 7 CLEAR\nP7=2\n").unwrap();
        site.wait_until("a line in the program", || site.log().contains("sends \"P7=2\""));
        if closing == "CLOSE" {
            other.send(closing, PATIENCE).unwrap();
        } else {
            site.control("reset");
            // What goes before the reports have stopped may be carried out: nothing tells the daemon yet.
            site.run_for(Duration::from_secs(1));
            site.wait_until("a board that answers", || site.connection().send("P7=1", PATIENCE).is_ok());
        }
        stdin.write_all(b"P7=3\n").unwrap();
        let told = stderr.by_ref().find(|line| line.contains("not sent")).unwrap();
        assert!(
            told.contains(
                "not sent, it would have been carried out at once: somebody closed the program buffer"
            ) && told.contains("CLOSE, or another OPEN, ends the lines that belong into it"),
            "{closing}: {told}"
        );
        // When its user has closed it, lines go again.
        stdin.write_all(b"P7=4\nCLOSE\nP9=5\n").unwrap();
        drop(stdin);
        assert_eq!(child.wait().unwrap().code(), Some(1));
        assert_eq!(site.ask("P7 P9"), ["1", "5"], "{closing}");
        site.assert_no_violations();
    }
}

#[test]
fn the_prompt_shows_an_address_that_somebody_else_has_changed() {
    let site = VirtualSite::running(&[], &[]);
    let pty = pty(Some(&nix::pty::Winsize { ws_row: 24, ws_col: 200, ws_xpixel: 0, ws_ypixel: 0 }));
    let slave = || Stdio::from(pty.slave.try_clone().unwrap());
    let mut command = terminal(&site, &["--no-history"]);
    let command = command.env("TERM", "xterm").stdin(slave()).stdout(slave()).stderr(slave());
    let child = Running(command.spawn().unwrap());
    let mut person = Person::at(pty.master);
    person.sees("#8 &1> ");
    person.types("#2\r");
    person.sees("#2 &1> ");
    site.connection().send("#5", PATIENCE).unwrap();
    person.types("J+\r");
    person.sees("not sent: somebody else has addressed #5 &1 meanwhile");
    person.sees("-- somebody else has addressed #5 &1; it was #2 &1");
    person.sees("#5 &1> ");
    // He has seen it now.
    person.types("P\r");
    person.sees("\n0\r\n");
    person.types(".quit\r");
    assert_eq!(child.ended(), Some(0), "{}", person.screen());
    site.assert_no_violations();
}
