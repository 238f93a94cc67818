//! How long a client waits, for whatever daemon it is pointed at: `latency NAME SOCKET SAMPLES LABEL`.
//!
//! Prints microseconds, median and 99th of a hundred, of
//! * `wake`: from the daemon's first read of a servo report on the board to a client that slept for it and has it,
//! * `ask`: a call that the daemon answers by itself: the socket and two changes of process,
//! * `read`: one that reads a word of the board,
//! * `send`: a command line and its reply, which an interrupt announces where there is one.

use std::error::Error;
use std::path::Path;
use std::time::{Duration, Instant};

use pmac_dpram::client::{Board, CommandError};
use pmac_dpram::map::HostOffset;
use pmac_dpram::segment::monotonic_ns;

/// How long one sample may take.
const PATIENCE: Duration = Duration::from_secs(5);

fn report(label: &str, what: &str, mut nanoseconds: Vec<u64>) {
    nanoseconds.sort_unstable();
    let at = |percent: usize| nanoseconds[(nanoseconds.len() - 1) * percent / 100] / 1000;
    println!("{label} {what} {} {}", at(50), at(99));
}

/// The times that so many runs of `run` take.
fn times<T>(
    samples: usize,
    mut run: impl FnMut() -> Result<T, CommandError>,
) -> Result<Vec<u64>, CommandError> {
    let mut times = Vec::with_capacity(samples);
    for _ in 0..samples {
        let begun = Instant::now();
        run()?;
        times.push(begun.elapsed().as_nanos() as u64);
    }
    Ok(times)
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, name, socket, samples, label] = arguments.as_slice() else {
        return Err("usage: latency NAME SOCKET SAMPLES LABEL".into());
    };
    let samples: usize = samples.parse()?;
    let mut board = Board::attach(name)?.with_socket(Path::new(socket));
    let mut wakes = Vec::with_capacity(samples);
    while wakes.len() < samples {
        let last = board.servo_sequence()?;
        if !board.wait(last, PATIENCE)? {
            return Err("no servo data".into());
        }
        let Some(servo) = board.snapshot()?.servo else { continue };
        wakes.push(monotonic_ns().saturating_sub(servo.time_ns));
    }
    report(label, "wake", wakes);
    let connection = board.connection()?;
    report(label, "ask", times(samples, || connection.info())?);
    let word = HostOffset::new(0x26);
    report(label, "read", times(samples, || connection.read(word, 1))?);
    report(label, "send", times(samples, || connection.send("P100", PATIENCE))?);
    Ok(())
}
