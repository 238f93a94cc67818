//! Recognises the generation of the board in a window by reading alone.
//!
//! The generations' servo reports lie at different places, so a running report is proof. But memory at power-on holds
//! any values, and sites keep counters of their own in the DPRAM (a counter that a PLC increments looks like a timer).
//! So words count as a report only if all of this holds:
//! * its timer goes on as a servo clock does, at one rate over the whole time (DPRAM manual p. 15, Turbo User Manual
//!   p. 403);
//! * no such timer goes on in the other generation's place;
//! * the block of some motor is a copy of PMAC's registers: the motor is activated, not every flag of its status is
//!   set, and every long of the block repeats its bit 23 above, as the DPRAM holds 24-bit words (DPRAM manual p. 11,
//!   Turbo User Manual p. 402).
//!
//! A board whose reports are off shows no generation by reading, and this module does not guess.

use super::probe::timer;
use crate::device::{Bus, BusError};
use crate::format::{int24, join32};
use crate::map::{Family, PMAC, TURBO, block_fields};

/// The window that this module reads, in bytes: every family has at least so much, and its reports in it.
pub const WINDOW: usize = PMAC.length as usize;
/// One family of each generation; within one, the reports are alike.
static GENERATIONS: [&Family; 2] = [&PMAC, &TURBO];
/// How often a look reads the timers.
const SAMPLES: usize = 48;
/// The least samples that a look needs: it loses those during which the board was writing.
const LEAST: usize = 32;
/// In how many samples, at least, the timer must have moved on.
const MOVES: usize = 16;
/// Servo clocks in Hz; the default is 2.26 kHz, and no manual names a board beyond 40 kHz.
const CLOCKS: std::ops::RangeInclusive<f64> = 400.0..=50_000.0;
/// How far a sample may be off the one rate, in seconds: reports come every so many cycles, and this process is not
/// alone.
const SLACK_S: f64 = 0.015;
/// How often a look reads a block, at most, until no update came meanwhile.
const BLOCK_READS: usize = 32;

/// A reading of a timer: the time in nanoseconds, and the value.
type Sample = (u64, u32);

/// Looks at the board on `bus`, up to `looks` times until it is known: a held-up machine spoils a look. Each look
/// lasts as long as 48 calls of `pause`, which waits some milliseconds (best at an uneven pace) and tells the time in
/// nanoseconds. Writes nothing. Returns the family that has the same reports as the board: [`PMAC`] or [`TURBO`];
/// `None` when the reports do not tell.
///
/// # Errors
/// When the window is shorter than [`WINDOW`].
pub fn recognise<B: Bus>(
    bus: &mut B,
    looks: usize,
    mut pause: impl FnMut(&mut B) -> u64,
) -> Result<Option<&'static Family>, BusError> {
    for _ in 0..looks {
        let seen = look(bus, &mut pause)?;
        if seen.is_some() {
            return Ok(seen);
        }
    }
    Ok(None)
}

fn look<B: Bus>(
    bus: &mut B,
    pause: &mut impl FnMut(&mut B) -> u64,
) -> Result<Option<&'static Family>, BusError> {
    let mut samples: [Vec<Sample>; 2] = [const { Vec::new() }; 2];
    for _ in 0..SAMPLES {
        let time_ns = pause(bus);
        for (family, samples) in GENERATIONS.iter().zip(&mut samples) {
            samples.extend(timer(bus, &family.servo)?.map(|value| (time_ns, value)));
        }
    }
    let looks = GENERATIONS.into_iter().zip(&samples);
    let mut with_clock = looks.filter(|(family, samples)| is_servo_clock(samples, family.servo.timer.bits()));
    let (Some((family, _)), None) = (with_clock.next(), with_clock.next()) else { return Ok(None) };
    Ok(has_motor(bus, family, pause)?.then_some(family))
}

/// Whether the samples of a timer of so many bits are those of a servo clock.
fn is_servo_clock(samples: &[Sample], bits: u32) -> bool {
    let Some(&(begin_ns, mut last)) = samples.first() else { return false };
    let (mut cycles, mut moves) = (0_u64, 0);
    let mut track = Vec::with_capacity(samples.len());
    for &(time_ns, value) in samples {
        let passed = value.wrapping_sub(last) & ((1 << bits) - 1);
        cycles += u64::from(passed);
        moves += usize::from(passed != 0);
        last = value;
        track.push((time_ns.saturating_sub(begin_ns) as f64 / 1e9, cycles as f64));
    }
    let Some(&(seconds, total)) = track.last() else { return false };
    let hz = total / seconds;
    samples.len() >= LEAST
        && moves >= MOVES
        && CLOCKS.contains(&hz)
        && track.iter().all(|(at, cycles)| (cycles - hz * at).abs() <= hz * SLACK_S)
}

/// Whether some motor's block in the servo report is a copy of PMAC's registers.
fn has_motor<B: Bus>(
    bus: &mut B,
    family: &Family,
    pause: &mut impl FnMut(&mut B) -> u64,
) -> Result<bool, BusError> {
    for motor in 1..=family.servo.motors.count {
        let Some(first) = family.servo.motors.at(motor) else { continue };
        let mut words = vec![0; family.servo.motors.words];
        for _ in 0..BLOCK_READS {
            let before = timer(bus, &family.servo)?;
            bus.read_block(first, &mut words)?;
            if before.is_some() && timer(bus, &family.servo)? == before {
                if is_motor(family, &words) {
                    return Ok(true);
                }
                break;
            }
            pause(bus);
        }
    }
    Ok(false)
}

/// Whether `words`, a motor's block, are those of an activated motor.
fn is_motor(family: &Family, words: &[u16]) -> bool {
    let flag = family.servo.activated;
    let word = |at: usize| words.get(at).copied().unwrap_or_default();
    let at = flag.word.words_since(family.servo.motors.first);
    let flags = [word(at - at % 2), word(at - at % 2 + 1)];
    let mut longs = block_fields(family, "servo")
        .filter(|field| field.name != "spare")
        .flat_map(|field| words[field.words].chunks_exact(2));
    flag.is_set(word(at))
        // No motor has every flag: one whose loop is open searches for no home, and integrates nothing.
        && flags != [u16::MAX; 2]
        && longs.all(|long| {
            let long = join32(long[0], long[1]);
            int24::extend(long) == long
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::FileBoard;
    use crate::format::split32;
    use crate::map::HostOffset;

    const CYCLE_NS: u64 = 442_673;

    fn board(fill: impl Fn(u32) -> u16) -> FileBoard {
        let file = tempfile::tempfile().unwrap();
        file.set_len(WINDOW as u64).unwrap();
        let mut board = FileBoard::from_file(&file, WINDOW).unwrap();
        for word in 0..WINDOW as u32 / 2 {
            board.write16(HostOffset::new(2 * word), fill(word)).unwrap();
        }
        board
    }

    /// Looks at `board` once; `report` makes the board's changes up to a servo cycle.
    fn look(board: &mut FileBoard, report: impl FnMut(&mut FileBoard, u64)) -> Option<&'static str> {
        looks(board, 1, report)
    }

    fn looks(
        board: &mut FileBoard,
        looks: usize,
        mut report: impl FnMut(&mut FileBoard, u64),
    ) -> Option<&'static str> {
        let mut cycle = 0;
        let seen = recognise(board, looks, |board| {
            cycle += 12;
            report(board, cycle);
            cycle * CYCLE_NS
        });
        seen.unwrap().map(|family| family.name)
    }

    fn set_timer(board: &mut FileBoard, family: &Family, value: u64) {
        let (timer, status) = (family.servo.timer, family.servo.pmac_status);
        let flag = if family.servo.busy.flag(false) { status.mask } else { 0 };
        match timer.high {
            None => board.write16(timer.low, value as u16 & 0x7FFF | flag).unwrap(),
            Some((high, _)) => {
                board.write16(timer.low, value as u16).unwrap();
                board.write16(high, (value >> 16) as u16 & 0xFF | flag).unwrap();
            }
        }
    }

    /// Writes a motor's block, which the two generations do not share: registers of PMAC, activated.
    fn set_motor(board: &mut FileBoard, family: &Family) {
        let number = if family == &PMAC { 8 } else { 3 };
        let first = family.servo.motors.at(number).unwrap();
        for field in block_fields(family, "servo").filter(|field| field.name != "spare") {
            for word in field.words.step_by(2) {
                let value = if field.name == "servo_status" { 0x84_2000 } else { 0x12_3456 + word as u32 };
                let words = split32(int24::extend(value));
                (0..2).for_each(|half| board.write16(first.plus_words(word + half), words[half]).unwrap());
            }
        }
    }

    fn garbage(seed: u32) -> impl Fn(u32) -> u16 {
        move |word| ((word + 1).wrapping_mul(seed | 1).wrapping_mul(2_654_435_761) >> 15) as u16
    }

    #[test]
    fn a_report_that_goes_on_tells_the_generation() {
        for family in GENERATIONS {
            for seed in 0..50 {
                let mut board = board(garbage(seed));
                set_motor(&mut board, family);
                let seen = look(&mut board, |board, cycle| set_timer(board, family, 0x7FE0 + cycle));
                assert_eq!(seen, Some(family.name), "seed {seed}");
            }
        }
    }

    #[test]
    fn a_machine_that_is_held_up_looks_again() {
        // The board seems to stand for 50 ms in the first look.
        let held_up = |board: &mut FileBoard, cycle: u64| {
            let seen = if (200..313).contains(&cycle) { 200 } else { cycle };
            set_timer(board, &PMAC, seen);
        };
        for (number, expected) in [(1, None), (2, Some(PMAC.name))] {
            let mut board = board(garbage(3));
            set_motor(&mut board, &PMAC);
            assert_eq!(looks(&mut board, number, held_up), expected, "{number} looks");
        }
    }

    #[test]
    fn memory_in_which_nothing_is_reported_tells_nothing() {
        for seed in 0..50 {
            assert_eq!(look(&mut board(garbage(seed)), |_, _| {}), None, "seed {seed}");
            let mut board = board(garbage(seed));
            GENERATIONS.iter().for_each(|family| set_motor(&mut board, family));
            assert_eq!(look(&mut board, |_, _| {}), None, "an old report, seed {seed}");
        }
        for fill in [0, 0xFFFF, 0x5A5A] {
            assert_eq!(look(&mut board(|_| fill), |_, _| {}), None);
        }
    }

    /// A PLC of a site counts at the very word, as fast as the servo, on a board of the other generation.
    #[test]
    fn a_sites_counter_in_the_timers_place_is_no_report() {
        for family in GENERATIONS {
            for fill in [0, 0xFFFF] {
                let count = |board: &mut FileBoard, cycle| set_timer(board, family, cycle);
                assert_eq!(look(&mut board(|_| fill), count), None, "{}", family.name);
            }
            for seed in 0..50 {
                let count = |board: &mut FileBoard, cycle| set_timer(board, family, cycle);
                assert_eq!(look(&mut board(garbage(seed)), count), None, "{} seed {seed}", family.name);
            }
        }
    }

    #[test]
    fn a_timer_that_is_no_clock_is_no_report() {
        for family in GENERATIONS {
            let told = |timer: fn(u64) -> u64| {
                let mut board = board(|_| 0);
                set_motor(&mut board, family);
                look(&mut board, |board, cycle| set_timer(board, family, timer(cycle)))
            };
            assert_eq!(told(|cycle| cycle), Some(family.name));
            assert_eq!(told(|cycle| cycle / 100), None, "too slow, {}", family.name);
            assert_eq!(told(|cycle| cycle.wrapping_mul(25_173) >> 3), None, "jumps, {}", family.name);
            assert_eq!(told(|cycle| u64::MAX - cycle), None, "backwards, {}", family.name);
            assert_eq!(told(|cycle| cycle + cycle * cycle / 200), None, "faster and faster, {}", family.name);
            assert_eq!(told(|cycle| cycle.min(300)), None, "stands still, {}", family.name);
        }
    }

    #[test]
    fn two_reports_at_once_tell_nothing() {
        let mut board = board(|_| 0);
        GENERATIONS.iter().for_each(|family| set_motor(&mut board, family));
        let both = |board: &mut FileBoard, cycle| {
            GENERATIONS.iter().for_each(|family| set_timer(board, family, cycle));
        };
        assert_eq!(look(&mut board, both), None);
    }
}
