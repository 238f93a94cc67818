//! `pmacctl top` on a terminal: what it shows, when its keys move a motor, and how it leaves the terminal.
//!
//! Time is never hurried here: the screen would find that the data of a board are old whose time runs ahead of it.

use std::fs::File;
use std::io::{Read, Write};
use std::os::fd::OwnedFd;
use std::process::{Child, Stdio};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use nix::pty::Winsize;
use nix::sys::signal::{Signal, kill};
use nix::sys::termios::{SetArg, Termios, tcgetattr, tcsetattr};
use nix::unistd::Pid;

use crate::support::rig::{Ran, command, pmacctl, pty};
use crate::support::{PATIENCE, VirtualSite, status_within, wait_until};

const RIGHT: &str = "\x1b[C";
const SIZE: (u16, u16) = (24, 80);

/// `top` on a terminal, and somebody who sits at it.
struct Seat {
    child: Child,
    keyboard: File,
    slave: OwnedFd,
    seen: Arc<Mutex<vt100::Parser>>,
    before: Termios,
}

impl Seat {
    fn at(site: &VirtualSite, arguments: &[&str]) -> Self {
        let pty = pty(Some(&Winsize { ws_row: SIZE.0, ws_col: SIZE.1, ws_xpixel: 0, ws_ypixel: 0 }));
        let before = tcgetattr(&pty.slave).unwrap();
        let slave = || Stdio::from(pty.slave.try_clone().unwrap());
        let mut command = command();
        command.args(["--name", &site.name, "--socket"]).arg(site.socket()).arg("top").args(arguments);
        command.env("TERM", "xterm").env_remove("NO_COLOR").stdin(slave()).stdout(slave()).stderr(slave());
        let child = command.spawn().unwrap();
        let keyboard = File::from(pty.master);
        let seen = Arc::new(Mutex::new(vt100::Parser::new(SIZE.0, SIZE.1, 0)));
        let (theirs, mut source) = (Arc::clone(&seen), keyboard.try_clone().unwrap());
        std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            while let Ok(count @ 1..) = source.read(&mut bytes) {
                theirs.lock().unwrap().process(&bytes[..count]);
            }
        });
        Self { child, keyboard, slave: pty.slave, seen, before }
    }

    fn types(&mut self, text: &str) {
        self.keyboard.write_all(text.as_bytes()).unwrap();
    }

    fn screen(&self) -> String {
        self.seen.lock().unwrap().screen().contents()
    }

    fn shows(&self, text: &str) -> bool {
        self.screen().contains(text)
    }

    #[track_caller]
    fn sees(&self, text: &str) {
        wait_until(&format!("{text:?} on the screen"), || self.shows(text));
    }

    fn signal(&self, signal: Signal) {
        kill(Pid::from_raw(self.child.id().cast_signed()), signal).unwrap();
    }

    /// Arms the jog keys of motor 1 and holds a key down until it moves.
    fn jogs(&mut self, site: &VirtualSite) {
        self.types("a");
        self.sees("#1 ARMED");
        wait_until("a motor that jogs", || {
            self.types(RIGHT);
            // As a key repeats.
            std::thread::sleep(Duration::from_millis(30));
            moves(site)
        });
    }

    /// Disarms. Not by the escape key, which makes another key of what is typed right behind it.
    fn disarms(&mut self) {
        self.types(" ");
        wait_until("disarmed keys", || !self.shows("ARMED") && !self.shows("JOGS"));
    }

    /// Whether the terminal is as it was, on its first screen and with a cursor.
    fn is_left_in_order(&self) -> bool {
        let seen = self.seen.lock().unwrap();
        let screen = seen.screen();
        tcgetattr(&self.slave).unwrap() == self.before && !screen.alternate_screen() && !screen.hide_cursor()
    }

    fn ended(&mut self) -> Option<i32> {
        status_within(&mut self.child, PATIENCE).code()
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        if std::thread::panicking() {
            eprintln!("what was on the screen:\n{}", self.screen());
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn running() -> VirtualSite {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    site.wait_for_identity();
    site
}

#[test]
fn a_replay_says_so_in_the_title_of_every_page() {
    let site = VirtualSite::new();
    let recording = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/captures/simulator-pmac");
    site.start_daemon_on(&format!("replay:{recording}"), &[]);
    let mut seat = Seat::at(&site, &[]);
    for (key, text) in [("", "a arms the jog keys"), ("s", "condition"), ("?", "suspend, until fg")] {
        seat.types(key);
        seat.sees(text);
        assert!(seat.screen().starts_with(" REPLAY, no board"), "{}", seat.screen());
    }
    seat.types("q");
    assert_eq!(seat.ended(), Some(0));
}

fn moves(site: &VirtualSite) -> bool {
    let motors = site.pmacctl(&["motors"]).1;
    motors.lines().any(|line| line.contains("#1 ") && line.contains("moving"))
}

#[test]
fn the_screen_shows_the_board_and_is_taken_away() {
    let site = running();
    let mut seat = Seat::at(&site, &["P1", "X:$0000"]);
    for text in ["in-position", "following error of #1", "counters", "linear", "P1=0"] {
        seat.sees(text);
    }
    assert!(!seat.shows("REPLAY"), "{}", seat.screen());
    site.connection().send("P1=7", PATIENCE).unwrap();
    seat.sees("P1=7");
    seat.types("s");
    seat.sees("condition       live");
    seat.types("?");
    seat.sees("suspend, until fg");
    seat.types("\x1b");
    seat.sees("in-position");
    seat.types(":watch P2\r");
    seat.sees("P2=0");
    // The window becomes smaller.
    shrink(&seat.slave);
    seat.seen.lock().unwrap().screen_mut().set_size(10, 40);
    wait_until("a small screen", || {
        let screen = seat.screen();
        screen.lines().nth(9).is_some_and(|line| line.contains("a arms the jog keys"))
    });
    seat.types("q");
    assert_eq!(seat.ended(), Some(0), "{}", seat.screen());
    wait_until("a terminal left in order", || seat.is_left_in_order());
    site.assert_no_violations();
}

#[test]
fn a_motor_jogs_only_while_its_armed_key_is_held_down() {
    let site = running();
    let mut seat = Seat::at(&site, &[]);
    seat.sees("in-position");
    seat.types(RIGHT);
    seat.sees("the jog keys are not armed");
    seat.types("a");
    seat.sees("#1 ARMED");
    // However many presses lay waiting, they are one.
    seat.types(&RIGHT.repeat(40));
    site.run_for(Duration::from_secs(1));
    assert!(!moves(&site), "a single press moves nothing");
    assert!(!site.log().contains("panel jog"), "{}", site.log());
    seat.disarms();
    seat.jogs(&site);
    assert!(site.log().contains(&format!("pid {} panel jog+ [1], held", seat.child.id())), "{}", site.log());
    // The key is released.
    wait_until("a motor that stands", || !moves(&site));
    seat.sees("#1: the board has taken the stop");
    assert!(!site.log().contains("not renewed"), "the screen itself has stopped it: {}", site.log());
    // Another key stops it, too, and disarms.
    seat.disarms();
    seat.jogs(&site);
    seat.disarms();
    wait_until("a motor that stands", || !moves(&site));
    seat.types("q");
    assert_eq!(seat.ended(), Some(0), "{}", seat.screen());
    site.assert_no_violations();
}

#[test]
fn a_turbo_boards_motor_jogs_by_line_while_its_armed_key_is_held_down() {
    let site = VirtualSite::configured(&["--family", "turbo2"], "family = \"turbo2\"\n");
    site.wait_for_live_servo();
    site.wait_for_identity();
    let mut seat = Seat::at(&site, &[]);
    seat.sees("in-position");
    seat.jogs(&site);
    // The key is released.
    wait_until("a motor that stands", || !moves(&site));
    seat.sees("#1: the board has taken the stop");
    seat.disarms();
    seat.jogs(&site);
    seat.signal(Signal::SIGKILL);
    wait_until("a motor that stands", || !moves(&site));
    site.assert_no_violations();
}

#[test]
fn a_jog_ends_with_the_screen_however_that_ends() {
    let site = running();
    for end in ["kill", "term", "key"] {
        let mut seat = Seat::at(&site, &[]);
        seat.sees("in-position");
        seat.jogs(&site);
        match end {
            "kill" => seat.signal(Signal::SIGKILL),
            "term" => seat.signal(Signal::SIGTERM),
            _ => seat.types("\x03"),
        }
        wait_until("a motor that stands", || !moves(&site));
        if end == "term" {
            assert_eq!(seat.ended(), Some(0), "{end}");
            wait_until("a terminal left in order", || seat.is_left_in_order());
        }
        drop(seat);
        wait_until("a motor that nobody holds", || site.pmacctl(&["jog", "1", "stop"]).0 == 0);
    }
    site.assert_no_violations();
}

#[test]
fn two_screens_do_not_jog_one_motor() {
    let site = running();
    let (mut first, mut second) = (Seat::at(&site, &[]), Seat::at(&site, &[]));
    first.sees("in-position");
    second.sees("in-position");
    second.types("a");
    second.sees("#1 ARMED");
    first.jogs(&site);
    // On a slow machine the first one may have let go meanwhile; then it is the one that is refused.
    let mut told = String::new();
    wait_until("a refusal", || {
        for seat in [&mut first, &mut second] {
            // The next key takes away what the last one has told.
            let screen = seat.screen();
            if screen.contains("disarmed: ") {
                told = screen;
                return true;
            }
            seat.types(RIGHT);
        }
        // As keys repeat.
        std::thread::sleep(Duration::from_millis(60));
        false
    });
    assert!(told.contains("holds a jog of motor 1"), "{told}");
    wait_until("a motor that stands", || !moves(&site));
}

#[test]
fn the_screen_outlives_the_daemon() {
    let site = running();
    let mut seat = Seat::at(&site, &[]);
    seat.sees("in-position");
    site.stop_daemon();
    seat.sees("STALE: pmacd is gone; start it");
    seat.types("a");
    seat.sees("not armed: the data are not live");
    site.start_daemon(&[]);
    wait_until("the new daemon's data", || {
        !seat.shows("STALE") && !seat.shows("absent") && seat.shows("counters")
    });
    site.board_stands_still(true);
    seat.sees("STALE: ");
    site.board_stands_still(false);
    wait_until("the board's data", || !seat.shows("STALE"));
    seat.types("q");
    assert_eq!(seat.ended(), Some(0), "{}", seat.screen());
}

#[test]
fn a_suspended_screen_gives_the_terminal_back_and_takes_it_again() {
    let site = running();
    let mut seat = Seat::at(&site, &[]);
    let state = |seat: &Seat| {
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", seat.child.id())).unwrap();
        stat.rsplit_once(") ").unwrap().1.chars().next().unwrap()
    };
    for how in ["\x1a", "signal"] {
        seat.sees("in-position");
        if how == "signal" {
            seat.signal(Signal::SIGTSTP)
        } else {
            seat.types(how)
        }
        wait_until("a stopped process", || state(&seat) == 'T');
        wait_until("a terminal left in order", || seat.is_left_in_order());
        seat.signal(Signal::SIGCONT);
    }
    seat.sees("in-position");
    // Whatever has been done to the terminal behind its back.
    seat.signal(Signal::SIGSTOP);
    wait_until("a stopped process", || state(&seat) == 'T');
    tcsetattr(&seat.slave, SetArg::TCSANOW, &seat.before).unwrap();
    seat.signal(Signal::SIGCONT);
    seat.types("?");
    seat.sees("suspend, until fg");
    seat.types("q");
    assert_eq!(seat.ended(), Some(0), "{}", seat.screen());
    wait_until("a terminal left in order", || seat.is_left_in_order());
}

#[test]
fn without_a_terminal_it_says_what_to_use_instead() {
    let ran = pmacctl("top");
    let why = "pmacctl: top needs a terminal; in a pipe, pmacctl watch prints lines, and motors --json a document\n";
    assert_eq!(ran, Ran { stdout: String::new(), stderr: why.to_owned(), code: Some(2) });
}

/// Makes the window 40 columns wide and 10 rows high.
fn shrink(terminal: &OwnedFd) {
    let size = rustix::termios::Winsize { ws_row: 10, ws_col: 40, ws_xpixel: 0, ws_ypixel: 0 };
    rustix::termios::tcsetwinsize(terminal, size).unwrap();
}
