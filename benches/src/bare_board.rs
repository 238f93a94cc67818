//! A board without a daemon: command lines by the library's own handshake, in this process.

use std::time::{Duration, Instant};

use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use pmac_dpram::device::{FileBoard, Interrupt, InterruptSource};
use pmac_dpram::format::TextOrder;
use pmac_dpram::function::ascii::DpramPort;
use pmac_dpram::function::line_port::{AsciiEvent, LinePort};
use pmac_dpram::map::Family;

use crate::rig::Rig;

/// How long a line and its reply may take.
const PATIENCE: Duration = Duration::from_secs(5);

/// Pauses so spread that questions come at any moment of the board's cycle: asked one right after the other, they would all keep
/// step with it, and a microsecond more or less would count as nothing or as a whole cycle.
pub struct Pauses(u64);

impl Default for Pauses {
    fn default() -> Self {
        Self(1)
    }
}

impl Pauses {
    pub fn pause(&mut self) {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        std::thread::sleep(Duration::from_nanos((self.0 >> 33) % 500_000));
    }
}

/// The memory of a simulated board, and its interrupt, which is waited for as the daemon does.
pub struct BareBoard {
    bus: FileBoard,
    interrupt: Interrupt,
    port: DpramPort,
}

impl BareBoard {
    /// That of `rig`, whose family this is.
    pub fn open(rig: &Rig, family: &'static Family) -> Self {
        let mut bus = FileBoard::open(&rig.memory(), family.length as usize).expect("the board's memory");
        let source = InterruptSource::Unix(rig.interrupt());
        let interrupt = Interrupt::connect(&source).expect("its interrupt");
        let mut port = DpramPort::new(&family.ascii, TextOrder::default());
        port.release(&mut bus).expect("the bus");
        std::thread::sleep(Duration::from_millis(100));
        Self { bus, interrupt, port }
    }

    /// The lines of the board's reply to `line`.
    pub fn ask(&mut self, line: &str) -> Vec<String> {
        self.exchange(line).unwrap_or_else(|error| panic!("{line}: ERR{error:03}"))
    }

    /// The same, or the error.
    pub fn exchange(&mut self, line: &str) -> Result<Vec<String>, u16> {
        let Self { bus, interrupt, port } = self;
        let (start, mut lines) = (Instant::now(), Vec::new());
        while !port.begin(bus, line.as_bytes()).expect("the bus") {
            port.poll(bus, Instant::now()).expect("the bus");
            assert!(start.elapsed() < PATIENCE, "the port is never idle");
        }
        loop {
            match port.poll(bus, Instant::now()).expect("the bus") {
                Some(AsciiEvent::Done(done)) => return done.map(|()| lines),
                Some(AsciiEvent::Error(error)) => {
                    port.settled(Instant::now());
                    return Err(error);
                }
                Some(AsciiEvent::Line(text)) => lines.push(text.to_latin1()),
                Some(_) => {}
                None => {
                    let mut watched = [PollFd::new(interrupt.descriptor(), PollFlags::POLLIN)];
                    poll(&mut watched, PollTimeout::from(20_u8)).expect("a wait");
                    interrupt.take();
                }
            }
            assert!(start.elapsed() < PATIENCE, "no answer");
        }
    }
}
