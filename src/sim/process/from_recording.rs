//! Sets a board as the recorded board was set.

use std::io::Write as _;

use crate::format::Visible;
use crate::map::functions::ReportStart;
use crate::recording::Access;
use crate::sim::world::World;

/// The most refused lines that the message names.
const NAMED: usize = 8;

/// Sends the variables, definitions and axes of `text`, as `pmacctl backup` writes them, but no programs. A recorded
/// board may know more than the simulator: the simulator names the lines that it refuses on stderr, and goes on. A
/// report that `GATHER` starts begins if a client of the recording read that report.
pub(super) fn set(world: &mut World, text: &str, accesses: &[Access]) {
    let mut is_program = false;
    let mut refused = Vec::new();
    for line in text.lines() {
        let line = line.split(';').next().unwrap_or_default().trim();
        is_program |= line.starts_with("OPEN");
        if is_program || line.is_empty() {
            is_program &= line != "CLOSE";
            continue;
        }
        if let Some(error) = world.execute(line.as_bytes()).error {
            refused.push(format!("`{line}` (ERR{:03})", error.0));
        }
    }
    let servo = &world.board.family().servo;
    let was_read = || accesses.iter().any(|access| access.offset == servo.motors.first);
    if servo.start == ReportStart::Gather && was_read() {
        let _ = world.execute(b"GATHER");
    }
    if !refused.is_empty() {
        let count = refused.len();
        refused.truncate(NAMED);
        // Nobody reads stderr: ignore the error.
        let _ = writeln!(
            std::io::stderr(),
            "pmac-sim: {count} lines of the recording are not the simulator's, as {}",
            Visible(refused.join(", "))
        );
    }
}
