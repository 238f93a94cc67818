//! Turns the simulated board's interrupt counts into pulses on an interrupt line of a virtual machine.
//!
//! `bridge QTEST SIMULATOR RAISE LOWER WAIT...`: for every count that `pmac-sim --interrupt` tells, RAISE and LOWER go to QEMU's qtest
//! socket; a board with several interrupts has four words for each. WAIT says what the board waits for, which is what keeps one
//! interrupt from hiding in another:
//!
//! * `ended:SOCKET`: after the line was lowered, for a byte the guest writes to the board's interrupt controller. So does a
//!   PMAC's 8259, whose line is an edge.
//! * `served:DPRAM`: before it is lowered, for the host to have released the response (0x06D0), as a board with a level does.
//!
//! Stops with the simulator and prints `pulses=N unserved=N`, a line for each interrupt.

use std::fs::File;
use std::io::{BufRead, BufReader, Error, Read, Write};
use std::os::unix::fs::FileExt;
use std::os::unix::net::UnixStream;
use std::sync::{Mutex, PoisonError};
use std::thread::sleep;
use std::time::{Duration, Instant};

const USAGE: &str = "usage: bridge QTEST SIMULATOR RAISE LOWER WAIT [SIMULATOR RAISE LOWER WAIT]...";
/// How long QEMU may take to answer.
const PATIENCE: Duration = Duration::from_secs(10);
/// How long the guest may take to serve an interrupt, however busy the machine is.
const SERVED: Duration = Duration::from_secs(2);
/// After so many that nobody served, the others are not waited for.
const HOPELESS: u64 = 3;
/// Set by the board with a response, cleared by the host that has it.
const RESPONSE: u64 = 0x06D0;

/// QEMU's socket, which takes one command at a time.
type Qemu = Mutex<BufReader<UnixStream>>;

/// What makes the line free for the next interrupt.
enum Wait {
    Ended(UnixStream),
    Served(File),
}

impl Wait {
    fn new(text: &str) -> Result<Self, Error> {
        match text.split_once(':') {
            Some(("ended", socket)) => Ok(Self::Ended(UnixStream::connect(socket)?)),
            Some(("served", memory)) => Ok(Self::Served(File::open(memory)?)),
            _ => Err(Error::other(format!("{text} is neither ended:SOCKET nor served:DPRAM"))),
        }
    }

    /// Forgets ends that belong to no interrupt, such as the one the driver writes when it is opened.
    fn begin(&mut self) -> Result<(), Error> {
        if let Self::Ended(ends) = self {
            ends.set_nonblocking(true)?;
            while ends.read(&mut [0; 64]).is_ok_and(|bytes| bytes > 0) {}
            ends.set_nonblocking(false)?;
        }
        Ok(())
    }

    /// Waits for the host to have seen the response; true if it has, or if that is not what is waited for.
    fn served(&self) -> Result<bool, Error> {
        let Self::Served(memory) = self else { return Ok(true) };
        let begun = Instant::now();
        let mut word = [0; 2];
        while begun.elapsed() < SERVED {
            memory.read_exact_at(&mut word, RESPONSE)?;
            if word == [0; 2] {
                return Ok(true);
            }
            sleep(Duration::from_micros(50));
        }
        Ok(false)
    }

    /// Waits for the interrupt's end at the controller; true if it came, or if that is not what is waited for.
    fn ended(&mut self) -> Result<bool, Error> {
        let Self::Ended(ends) = self else { return Ok(true) };
        ends.set_read_timeout(Some(SERVED))?;
        Ok(ends.read_exact(&mut [0]).is_ok())
    }
}

/// Has QEMU do something, and waits until it has.
fn tell(qemu: &Qemu, what: &str) -> Result<(), Error> {
    let mut qemu = qemu.lock().unwrap_or_else(PoisonError::into_inner);
    writeln!(qemu.get_mut(), "{what}")?;
    let mut answer = String::new();
    qemu.read_line(&mut answer)?;
    if answer.trim_end() == "OK" {
        Ok(())
    } else {
        Err(Error::other(format!("QEMU answers {answer:?} to {what}")))
    }
}

/// Turns the counts of one socket of the simulator into pulses of one line. `line` holds SIMULATOR RAISE LOWER WAIT.
fn serve(line: &[String], qemu: &Qemu) -> Result<String, Error> {
    let [simulator, raise, lower, wait] = line else { return Err(Error::other(USAGE)) };
    let mut simulator = UnixStream::connect(simulator)?;
    let mut wait = Wait::new(wait)?;
    let (mut told, mut pulses, mut unserved) = (None, 0u64, 0u64);
    let mut count = [0; 4];
    while simulator.read_exact(&mut count).is_ok() {
        let count = u32::from_ne_bytes(count);
        for _ in 0..told.map_or(1, |told| count.wrapping_sub(told)) {
            let patient = unserved < HOPELESS;
            wait.begin()?;
            tell(qemu, raise)?;
            let served = !patient || wait.served()?;
            tell(qemu, lower)?;
            let ended = !patient || wait.ended()?;
            pulses += 1;
            unserved += u64::from(!(served && ended));
        }
        told = Some(count);
    }
    Ok(format!("pulses={pulses} unserved={unserved}"))
}

fn main() -> Result<(), Error> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let Some((qtest, lines)) = arguments.split_first() else { return Err(Error::other(USAGE)) };
    let qemu = UnixStream::connect(qtest)?;
    qemu.set_read_timeout(Some(PATIENCE))?;
    let qemu = Mutex::new(BufReader::new(qemu));
    std::thread::scope(|scope| {
        let lines: Vec<_> = lines.chunks(4).map(|line| scope.spawn(|| serve(line, &qemu))).collect();
        for line in lines {
            println!("{}", line.join().map_err(|_| Error::other("a line's thread panicked"))??);
        }
        Ok(())
    })
}
