//! The simulated board's serial port as a host meets it: `pmac-sim --serial`, a raw byte stream on a socket.

use std::io::{ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::time::Duration;

use crate::replies::{SETUPS, vectors};
use crate::support::{PATIENCE, VirtualSite, World};

/// A terminal on the serial port.
struct Terminal<'a> {
    site: &'a VirtualSite,
    stream: UnixStream,
}

impl<'a> Terminal<'a> {
    fn open(site: &'a VirtualSite) -> Self {
        let stream = UnixStream::connect(site.path("serial")).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        Self { site, stream }
    }

    /// Sends `bytes`; returns what comes back, at least `least` bytes, and all there is.
    fn talk(&mut self, bytes: &[u8], least: usize) -> Vec<u8> {
        self.stream.write_all(bytes).unwrap();
        let mut answer = Vec::new();
        let mut chunk = [0; 4096];
        while answer.len() < least {
            match self.stream.read(&mut chunk) {
                Ok(0) => break,
                Ok(count) => answer.extend_from_slice(&chunk[..count]),
                // A signal to any thread of the tests ends a read that has a time limit.
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => panic!("{:?} gave only {:?}: {error}", bytes, String::from_utf8_lossy(&answer)),
            }
        }
        // Polled twice, the simulator has read what was sent and answered it.
        for _ in 0..2 {
            self.site.with_world(World::poll);
        }
        self.stream.set_read_timeout(Some(Duration::from_millis(1))).unwrap();
        while let Ok(count @ 1..) = self.stream.read(&mut chunk) {
            answer.extend_from_slice(&chunk[..count]);
        }
        self.stream.set_read_timeout(Some(PATIENCE)).unwrap();
        answer
    }
}

#[test]
fn the_printed_vectors_hold_over_the_port_byte_for_byte() {
    let mut wrong = Vec::new();
    for vector in vectors() {
        let Some((_, setup)) = SETUPS.iter().find(|(ids, _)| ids.contains(&vector.id)) else { continue };
        let site = VirtualSite::new();
        // Time stands still: what a setup writes into registers is not overtaken by the servo.
        site.hold();
        site.start_simulator(vector.options());
        let mut terminal = Terminal::open(&site);
        let prepared = terminal.talk(setup.as_bytes(), 0);
        assert!(!prepared.contains(&7), "the preparation of vector {} fails", vector.id);
        let got = terminal.talk(vector.send.as_bytes(), vector.expect.len());
        if got != vector.expect.as_bytes() {
            let got = String::from_utf8_lossy(&got).into_owned();
            wrong.push(format!("{}: {:?} gives {got:?}, not {:?}", vector.id, vector.send, vector.expect));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn the_active_response_port_moves_with_the_commands_and_by_control_z() {
    let site = VirtualSite::new();
    site.start_simulator(&[]);
    let mut terminal = Terminal::open(&site);
    assert_eq!(terminal.talk(b"I3=2 I6=1\r", 1), b"\x06");
    site.control("send AT POWER-ON THE SERIAL PORT IS ACTIVE");
    assert!(String::from_utf8(terminal.talk(b"", 10)).unwrap().contains("POWER-ON"));
    assert_eq!(terminal.talk(b"I58=1\r", 1), b"\x06");
    site.start_daemon(&[]);
    let mut messages = site.connection().messages().unwrap();
    assert_eq!(site.connection().send("VERSION", PATIENCE).unwrap(), ["1.16D"]);
    // The daemon's own questions also make the DPRAM the active port.
    site.control("send TO THE DPRAM");
    let message = messages.next_within(PATIENCE).unwrap().expect("the text in time");
    assert_eq!(message.text, "TO THE DPRAM");
    assert_eq!(terminal.talk(b"P0\r", 3), b"0\r\x06", "a reply goes where the command came from");
    terminal.talk(b"\x1a", 0);
    site.control("send BACK");
    assert!(String::from_utf8(terminal.talk(b"", 4)).unwrap().contains("BACK"));
    assert_eq!(terminal.talk(b"I58\r", 3), b"0\r\x06", "^Z has switched DPRAM ASCII off");
    assert!(site.connection().send("VERSION", Duration::from_millis(300)).is_err());
    site.assert_no_violations();
}
