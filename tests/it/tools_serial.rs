//! Setting a board up over a serial line: a pty whose far end is the simulator's serial port.

use std::fs::File;
use std::io::{Read, Write};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::time::Duration;

use pmac_dpram::client::{SerialError, SerialLine};

use crate::support::rig::{pmacctl, pty};
use crate::support::{PATIENCE, VirtualSite};

/// Enough for a line whose answer comes in the form it has just set, which is not understood yet.
const SHORT: Duration = Duration::from_millis(400);

/// A pty bridged to the simulator's serial socket. Its threads end with the simulator or when the pty is closed.
struct Wire {
    path: PathBuf,
    _slave: OwnedFd,
}

impl Wire {
    fn to(site: &VirtualSite) -> Self {
        let pty = pty(None);
        let path = nix::unistd::ttyname(&pty.slave).unwrap();
        let board = UnixStream::connect(site.path("serial")).unwrap();
        let host = File::from(pty.master);
        carry(host.try_clone().unwrap(), board.try_clone().unwrap());
        carry(board, host);
        Self { path, _slave: pty.slave }
    }
}

fn carry(mut from: impl Read + Send + 'static, mut to: impl Write + Send + 'static) {
    std::thread::spawn(move || {
        let mut bytes = [0; 256];
        while let Ok(count @ 1..) = from.read(&mut bytes) {
            if to.write_all(&bytes[..count]).is_err() {
                break;
            }
        }
    });
}

/// Calls `test` with every one of the `cases`, all at once: the silence that ends an answer is real time, whoever waits for it.
fn at_once<T: Copy + Send>(cases: &[T], test: impl Fn(T) + Sync) {
    std::thread::scope(|scope| {
        for &case in cases {
            let test = &test;
            scope.spawn(move || test(case));
        }
    });
}

/// A board whose answers have the form that the line `form` sets, after a line to it was open.
fn board_of(form: &str) -> (VirtualSite, Wire) {
    let site = VirtualSite::new();
    site.start_simulator(&[]);
    let wire = Wire::to(&site);
    SerialLine::open(&wire.path, 9600).unwrap().send(form, SHORT).ok();
    (site, wire)
}

#[test]
fn every_form_of_handshake_is_understood() {
    let others = [(0, 0), (1, 3)];
    let forms: Vec<_> = (0..4).flat_map(|i3| others.map(|(i4, i6)| (i3, i4, i6))).collect();
    at_once(&forms, |(i3, i4, i6)| {
        let form = format!("I3={i3} I4={i4} I6={i6}");
        let (_site, wire) = board_of(&form);
        let mut line = SerialLine::open(&wire.path, 38_400).unwrap_or_else(|error| panic!("{form}: {error}"));
        let taken = line.send("P1=25 P2=50", PATIENCE);
        assert_eq!(taken.unwrap_or_else(|error| panic!("{form}: {error}")), [""; 0], "{form}");
        assert_eq!(line.send("P1..2", PATIENCE).unwrap(), ["25", "50"], "{form}");
        let refused = line.send("P1 #99", PATIENCE).unwrap_err();
        let number = (i6 & 1 == 1).then_some(3);
        assert!(
            matches!(&refused, SerialError::Board { code, lines } if *code == number && *lines == ["25"]),
            "{form}: {refused:?}"
        );
        assert_eq!(line.send("P2", PATIENCE).unwrap(), ["50"], "{form}");
    });
}

#[test]
fn a_board_is_set_up_over_the_serial_line() {
    at_once(&["I3=0", "I3=1", "I3=2", "I3=3"], |form| {
        let (_site, wire) = board_of(form);
        let port = wire.path.display();
        let setup = format!("setup isa --address 0xD4000 --send --port {port} --baud 38400");
        let ran = pmacctl(&setup);
        assert!(ran.stderr.contains("--yes") && ran.code == Some(2), "{ran:?}");
        SerialLine::open(&wire.path, 9600).unwrap().send("I19=4", PATIENCE).unwrap();
        // The second GATHER would gather data, for which there is no buffer.
        let enable = format!("setup enable servo --motors 2 --send --yes --json --port {port}");
        let ran = pmacctl(&enable);
        assert_eq!((ran.code, &ran.json()["error"]), (Some(0), &serde_json::json!(null)), "{form}: {ran:?}");
        let ran = pmacctl(&enable);
        assert_eq!((ran.code, ran.json()["error"]["code"].as_u64()), (Some(1), Some(3)), "{form}: {ran:?}");
        assert!(ran.stderr.starts_with("done: I19=1, I59=2, I48=1; failed: GATHER; "), "{ran:?}");
    });
}

#[test]
fn lines_over_the_serial_line_are_for_the_family_that_the_board_tells() {
    let site = VirtualSite::new();
    site.start_simulator(&["--family", "turbo2"]);
    let wire = Wire::to(&site);
    let enable = format!("setup enable variables --send --yes --json --port {}", wire.path.display());
    let refused = pmacctl(&format!("{enable} --family pmac"));
    assert!(refused.stderr.contains("give --family turbo2") && refused.code == Some(2), "{refused:?}");
    // The words that PMAC has there are no such words on a Turbo board.
    let sent = pmacctl(&enable).json()["sent"].to_string();
    assert!(sent.contains("WY$060412,0") && !sent.contains("WY$D1FB"), "{sent}");
}
