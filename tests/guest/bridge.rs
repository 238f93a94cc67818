//! Turns the simulated board's interrupt counts into pulses on an interrupt pin of a virtual machine.
//!
//! `bridge SIMULATOR QTEST IOAPIC PIN [ENDS]`: every count that `pmac-sim --interrupt` tells becomes one rising and one falling
//! edge of PIN, through QEMU's qtest socket. On the socket ENDS come the bytes that the guest writes to the board's interrupt
//! controller; as a PMAC's 8259 does, the next pulse then waits for the end of the one before. Stops with the simulator and
//! prints `pulses=N unended=N`.

use std::io::{BufRead, BufReader, Error, Read, Write};
use std::os::unix::net::UnixStream;
use std::time::Duration;

/// How long QEMU may take to answer.
const PATIENCE: Duration = Duration::from_secs(10);
/// How long the guest may take to end an interrupt, however busy the machine is.
const END: Duration = Duration::from_secs(2);
/// Nobody ends them: the others are not waited for.
const HOPELESS: u64 = 3;

/// A level on the pin, and QEMU's word that it is there.
fn set(qemu: &mut BufReader<UnixStream>, pin: &str, level: u8) -> Result<(), Error> {
    writeln!(qemu.get_mut(), "set_irq_in {pin} {level}")?;
    let mut answer = String::new();
    qemu.read_line(&mut answer)?;
    if answer.trim_end() == "OK" { Ok(()) } else { Err(Error::other(format!("QEMU answers {answer:?}"))) }
}

fn main() -> Result<(), Error> {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, simulator, qtest, ioapic, pin, ends @ ..] = arguments.as_slice() else {
        return Err(Error::other("usage: bridge SIMULATOR QTEST IOAPIC PIN [ENDS]"));
    };
    let pin = format!("{ioapic} unnamed-gpio-in {pin}");
    let mut simulator = UnixStream::connect(simulator)?;
    let mut qemu = BufReader::new(UnixStream::connect(qtest)?);
    qemu.get_ref().set_read_timeout(Some(PATIENCE))?;
    let mut ends = ends.first().map(UnixStream::connect).transpose()?;
    let (mut told, mut pulses, mut unended) = (None, 0u64, 0u64);
    let mut count = [0; 4];
    while simulator.read_exact(&mut count).is_ok() {
        let count = u32::from_ne_bytes(count);
        for _ in 0..told.map_or(1, |told| count.wrapping_sub(told)) {
            // An end without an interrupt, as the driver writes when it is opened, is not that of the next one.
            if let Some(ends) = &mut ends {
                ends.set_nonblocking(true)?;
                while ends.read(&mut [0; 64]).is_ok_and(|bytes| bytes > 0) {}
                ends.set_nonblocking(false)?;
            }
            set(&mut qemu, &pin, 1)?;
            set(&mut qemu, &pin, 0)?;
            pulses += 1;
            if let Some(ends) = ends.as_mut().filter(|_| unended < HOPELESS) {
                ends.set_read_timeout(Some(END))?;
                unended += u64::from(ends.read_exact(&mut [0]).is_err());
            }
        }
        told = Some(count);
    }
    println!("pulses={pulses} unended={unended}");
    Ok(())
}
