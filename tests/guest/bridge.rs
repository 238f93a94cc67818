//! Turns the simulated board's interrupt counts into pulses on an interrupt pin of a virtual machine.
//!
//! `bridge SIMULATOR-SOCKET QTEST-SOCKET IOAPIC PIN`: every count that `pmac-sim --interrupt` tells becomes one rising and
//! one falling edge of PIN, through QEMU's qtest socket. Ends with the simulator and prints `pulses=N`.

use std::io::{BufRead, BufReader, Error, Read, Write};
use std::os::unix::net::UnixStream;
use std::time::Duration;

/// How long QEMU may take to answer.
const PATIENCE: Duration = Duration::from_secs(10);

/// A level on the pin, and QEMU's word that it is there.
fn set(qemu: &mut BufReader<UnixStream>, pin: &str, level: u8) -> Result<(), Error> {
    writeln!(qemu.get_mut(), "set_irq_in {pin} {level}")?;
    let mut answer = String::new();
    qemu.read_line(&mut answer)?;
    if answer.trim_end() == "OK" { Ok(()) } else { Err(Error::other(format!("QEMU answers {answer:?}"))) }
}

fn main() -> Result<(), Error> {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, simulator, qtest, ioapic, pin] = arguments.as_slice() else {
        return Err(Error::other("usage: bridge SIMULATOR-SOCKET QTEST-SOCKET IOAPIC PIN"));
    };
    let pin = format!("{ioapic} unnamed-gpio-in {pin}");
    let mut simulator = UnixStream::connect(simulator)?;
    let mut qemu = BufReader::new(UnixStream::connect(qtest)?);
    qemu.get_ref().set_read_timeout(Some(PATIENCE))?;
    let (mut told, mut pulses) = (None, 0u64);
    let mut count = [0; 4];
    while simulator.read_exact(&mut count).is_ok() {
        let count = u32::from_ne_bytes(count);
        for _ in 0..told.map_or(1, |told| count.wrapping_sub(told)) {
            set(&mut qemu, &pin, 1)?;
            set(&mut qemu, &pin, 0)?;
            pulses += 1;
        }
        told = Some(count);
    }
    println!("pulses={pulses}");
    Ok(())
}
