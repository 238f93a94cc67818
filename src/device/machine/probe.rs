//! Samples a window without writing to it, and judges which kind of device answers.
//!
//! A board that reports servo data increments the timer of the servo report (DPRAM manual p. 15). The probe only sees
//! a count at that word: another device, or a board of another family, may count there too. Without reports a PMAC's
//! DPRAM looks like any memory, and only a write could tell the difference.

use std::time::{Duration, Instant};

use serde::Serialize;

use crate::device::{Bus, BusError};
use crate::map::{Family, HostOffset, ServoBlock};

/// Samples of the timer, and the time between two. Short, and no multiple of a usual servo period.
const SAMPLES: usize = 40;
const PAUSE: Duration = Duration::from_micros(5300);
/// In Hz; every servo clock is well below this.
const FASTEST_HZ: f64 = 100_000.0;
/// How many samples must find the timer advanced: PMAC reports every I19 servo cycles.
const MOVED_LEAST: usize = 4;

/// The verdict on a window.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Every word reads as ones: no device answers.
    Absent,
    /// A word counts where the family has the timer of its servo report.
    Reporting,
    /// Words change, but not like servo data.
    Changing,
    /// Memory without changes: a PMAC whose reports are off, or another device.
    Still,
}

/// The findings.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Probe {
    /// The verdict.
    pub verdict: Verdict,
    /// Words read.
    pub words: usize,
    /// Words that read as 0xFFFF.
    pub ones: usize,
    /// Words that read as 0.
    pub zeros: usize,
    /// Words that changed from the first to the last sample.
    pub changed: usize,
    /// Samples that found the timer advanced.
    pub timer_moves: usize,
    /// How far the timer counts in a second, if it counts: servo cycles, if it is the timer of a servo report.
    pub servo_hz: Option<f64>,
}

/// Reads the window of `bus`, a board of `family`, twice, and its servo timer several times in between. Takes a quarter
/// of a second, writes nothing.
///
/// # Errors
/// When the window is shorter than a DPRAM.
pub fn probe(bus: &mut impl Bus, family: &Family) -> Result<Probe, BusError> {
    probe_by(bus, family, |_| std::thread::sleep(PAUSE))
}

/// As [`probe`]; the caller provides the pause before each sample.
///
/// # Errors
/// When the window is shorter than a DPRAM.
pub fn probe_by<B: Bus>(
    bus: &mut B,
    family: &Family,
    mut pause: impl FnMut(&mut B),
) -> Result<Probe, BusError> {
    let first = image(bus, family)?;
    let begin = Instant::now();
    let servo = &family.servo;
    let mut last_seen = timer(bus, servo)?;
    let (mut moves, mut cycles) = (0, 0u64);
    for _ in 0..SAMPLES {
        pause(bus);
        let Some(now) = timer(bus, servo)? else { continue };
        let passed = now.wrapping_sub(last_seen.unwrap_or(now)) & ((1 << servo.timer.bits()) - 1);
        moves += usize::from(passed != 0);
        cycles += u64::from(passed);
        last_seen = Some(now);
    }
    let seconds = begin.elapsed().as_secs_f64();
    let last = image(bus, family)?;
    let count = |value: u16| last.iter().filter(|word| **word == value).count();
    let changed = first.iter().zip(&last).filter(|(before, after)| before != after).count();
    let hz = cycles as f64 / seconds;
    // A timer that jumps about, like noise, would be faster than any servo clock.
    let reports = moves >= MOVED_LEAST && hz < FASTEST_HZ;
    let ones = count(u16::MAX);
    let verdict = match () {
        () if ones == last.len() => Verdict::Absent,
        () if reports => Verdict::Reporting,
        () if changed > 0 || moves > 0 => Verdict::Changing,
        () => Verdict::Still,
    };
    Ok(Probe {
        verdict,
        words: last.len(),
        ones,
        zeros: count(0),
        changed,
        timer_moves: moves,
        servo_hz: (verdict == Verdict::Reporting).then_some(hz),
    })
}

/// The servo timer, or `None` while PMAC writes its report.
pub(super) fn timer(bus: &mut impl Bus, servo: &ServoBlock) -> Result<Option<u32>, BusError> {
    let status = bus.read16(servo.pmac_status.word)?;
    if servo.busy.is_busy(servo.pmac_status.is_set(status)) {
        return Ok(None);
    }
    let timer = servo.timer;
    let low = if timer.low == servo.pmac_status.word { status } else { bus.read16(timer.low)? };
    let high = timer.high.map_or(Ok(0), |(word, _)| bus.read16(word))?;
    Ok(Some(timer.value(low, high)))
}

fn image(bus: &mut impl Bus, family: &Family) -> Result<Vec<u16>, BusError> {
    let mut words = vec![0; family.length as usize / 2];
    bus.read_block(HostOffset::new(0), &mut words)?;
    Ok(words)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::FileBoard;
    use crate::map::PMAC;

    const TIMER: HostOffset = PMAC.servo.timer.low;
    const TIMER_MASK: u16 = (1 << PMAC.servo.timer.low_bits) - 1;

    fn bus() -> FileBoard {
        let file = tempfile::tempfile().unwrap();
        file.set_len(PMAC.length.into()).unwrap();
        FileBoard::from_file(&file, PMAC.length as usize).unwrap()
    }

    #[test]
    fn a_timer_that_counts_is_a_board_that_reports() {
        let (mut bus, mut timer) = (bus(), 0x7FF0);
        bus.write16(TIMER, timer).unwrap();
        let seen = probe_by(&mut bus, &PMAC, |bus| {
            std::thread::sleep(Duration::from_millis(1));
            timer = (timer + 2) & TIMER_MASK;
            bus.write16(TIMER, timer).unwrap();
        });
        let seen = seen.unwrap();
        assert_eq!((seen.verdict, seen.timer_moves), (Verdict::Reporting, SAMPLES), "{seen:?}");
        assert!(seen.servo_hz.is_some_and(|hz| hz > 0.0 && hz < 2000.0), "{seen:?}");
    }

    #[test]
    fn ones_still_memory_and_memory_that_changes_otherwise_are_told_apart() {
        let (mut bus, pause) = (bus(), |_: &mut FileBoard| {});
        let seen = probe_by(&mut bus, &PMAC, pause).unwrap();
        assert_eq!((seen.verdict, seen.zeros, seen.servo_hz), (Verdict::Still, 0x2000, None));
        let mut value = 0u16;
        let noise = |bus: &mut FileBoard| {
            value = value.wrapping_mul(25_173).wrapping_add(13_849);
            bus.write16(TIMER, value).unwrap();
        };
        assert_eq!(probe_by(&mut bus, &PMAC, noise).unwrap().verdict, Verdict::Changing);
        for word in 0..0x2000 {
            bus.write16(HostOffset::new(2 * word), u16::MAX).unwrap();
        }
        let seen = probe_by(&mut bus, &PMAC, pause).unwrap();
        assert_eq!((seen.verdict, seen.ones, seen.timer_moves), (Verdict::Absent, 0x2000, 0));
    }

    #[test]
    fn nothing_is_written() {
        struct ReadOnly(FileBoard);
        impl Bus for ReadOnly {
            fn length(&self) -> usize {
                self.0.length()
            }
            fn read16(&mut self, offset: HostOffset) -> Result<u16, BusError> {
                self.0.read16(offset)
            }
            fn write16(&mut self, _: HostOffset, _: u16) -> Result<(), BusError> {
                panic!("written")
            }
            fn read_block(&mut self, first: HostOffset, words: &mut [u16]) -> Result<(), BusError> {
                self.0.read_block(first, words)
            }
            fn order_reads(&mut self) {}
            fn order_writes(&mut self) {}
        }
        assert!(probe_by(&mut ReadOnly(bus()), &PMAC, |_| {}).is_ok());
    }
}
