//! Servo fixed data: motor data that PMAC copies into the DPRAM every I19 servo cycles (DPRAM manual p. 14-17).
//!
//! PMAC tests the host's Host-Busy bit (Y:$D009 bit 0), skips the update if it is set, else sets its own PMAC-Busy
//! bit (X:$D009 bit 15), copies motors 1 to I59, stores the servo timer (bits 14-0) and clears PMAC-Busy. Because it
//! tests Host-Busy before it sets its own flag, Host-Busy alone does not protect a slow read: an update may begin
//! right after the host looked. So in both ways of reading the status word is read again after the data, and unless
//! both readings are equal and not busy, the copy is discarded. What this cannot show: a bus that returned something else
//! in the middle of a copy, for less than a servo period; and, in optimistic reading, a servo counter that is set back by
//! one update at that moment, so that two updates in a row have the same number.
//!
//! Host-Busy left set by a host that died stops the updates for ever; [`ServoReader::release`] clears it.

use std::ops::Range;

use crate::clock::Clock;
use crate::device::{Bus, BusError};
use crate::map::Selection;
use crate::map::classic::{
    self, HOST_BUSY, PMAC_BUSY, PROGRAM_BUFFER_OPEN, SERVO_GLOBAL_STATUS_Y, SERVO_HOST_STATUS, SERVO_MOTOR,
    SERVO_MOTOR_WORDS, SERVO_PMAC_STATUS, SERVO_TIMER_MASK,
};

/// How the buffer is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ServoReading {
    /// PMAC's status word serves as a sequence number; the host sets no bit and PMAC never skips an update.
    /// Not the procedure the manual gives; not yet confirmed on a card.
    #[default]
    Optimistic,
    /// The manual's procedure: Host-Busy is set around each read, and PMAC skips updates that fall into it.
    Handshake,
}

/// Words of the servo buffer, from the host status word at 0x0024 to the end of motor 8's block.
pub const SERVO_WORDS: usize = word_index(SERVO_MOTOR) + classic::MOTORS * SERVO_MOTOR_WORDS;
/// A copy that took longer is thrown away: the timer comes round after 32768 servo cycles, 14.5 s at the default rate.
const LONGEST_COPY_NS: u64 = 1_000_000_000;
/// The two global status longs.
const GLOBAL_WORDS: usize = 4;
/// How often PMAC-Busy is looked at after Host-Busy was set, before this update is given up.
const BUSY_LOOKS: usize = 8;

/// The word's place in the image of the buffer.
const fn word_index(offset: crate::map::HostOffset) -> usize {
    offset.word() - SERVO_HOST_STATUS.word()
}

/// What a look at the servo buffer gave.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ServoLook {
    /// No update since the last one taken.
    Unchanged,
    /// The first look: the value is the timer of what lies there from before, which is not taken.
    First(u16),
    /// PMAC is writing the buffer.
    Busy,
    /// PMAC wrote while the host read; the copy was discarded.
    Torn,
    /// A new update lies in [`ServoReader::image`]; the value is its servo timer.
    Update(u16),
}

/// Reads the servo fixed data of motors 1 to `motors`, or what was selected of it.
pub struct ServoReader {
    reading: ServoReading,
    selection: Selection,
    motors: usize,
    /// What is read of the motors' blocks, in words from the first one's start.
    runs: Vec<Range<usize>>,
    last_timer: Option<u16>,
    clock: Clock,
    image: [u16; SERVO_WORDS],
}

impl ServoReader {
    /// A reader that has seen nothing yet.
    #[must_use]
    pub fn new(reading: ServoReading) -> Self {
        Self::selecting(reading, Selection::ALL)
    }

    /// As [`ServoReader::new`], but of the motors' blocks only what `selection` has.
    #[must_use]
    pub fn selecting(reading: ServoReading, selection: Selection) -> Self {
        let mut reader = Self {
            reading,
            selection,
            motors: 0,
            // Room for any selection, so that it is not allocated later.
            runs: Vec::with_capacity(classic::MOTORS * SERVO_MOTOR_WORDS),
            last_timer: None,
            clock: Clock::real(),
            image: [0; SERVO_WORDS],
        };
        reader.set_motors(classic::MOTORS);
        reader
    }

    /// The same reader, which measures by `clock` how long a copy takes.
    #[must_use]
    pub fn timed_by(mut self, clock: Clock) -> Self {
        self.clock = clock;
        self
    }

    /// How the buffer is read.
    #[must_use]
    pub fn reading(&self) -> ServoReading {
        self.reading
    }

    /// Reads motors 1 to `motors` from now on (I59); at most 8.
    pub fn set_motors(&mut self, motors: usize) {
        self.motors = motors.min(classic::MOTORS);
        self.selection.runs(SERVO_MOTOR_WORDS, self.motors, &mut self.runs);
    }

    /// The motors the board reports, as far as is known.
    #[must_use]
    pub fn motors(&self) -> usize {
        self.motors
    }

    /// The buffer as last taken, from the word at 0x0024 on, up to the last motor read. Words the host does not read
    /// (its own status, the global spares, what was not selected) are 0.
    #[must_use]
    pub fn image(&self) -> &[u16] {
        let motors = self.selection.last_number(self.motors);
        &self.image[..word_index(SERVO_MOTOR) + motors * SERVO_MOTOR_WORDS]
    }

    /// Whether a program buffer was open on the board at the last update, as the copy of its global status says.
    #[must_use]
    pub fn program_buffer_open(&self) -> bool {
        self.image
            .get(word_index(SERVO_GLOBAL_STATUS_Y) + 1)
            .is_some_and(|word| word & PROGRAM_BUFFER_OPEN != 0)
    }

    /// Forgets the last update. What lies in the buffer at the next look counts as old: only a change after it is an
    /// update, so data from before a reset or a restart is never taken for new.
    pub fn forget(&mut self) {
        self.last_timer = None;
    }

    /// Clears the host's bit, whoever set it.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn release(bus: &mut impl Bus) -> Result<(), BusError> {
        bus.write16(SERVO_HOST_STATUS, 0)?;
        bus.order_writes();
        Ok(())
    }

    /// Looks once, and takes the update if there is a new one.
    ///
    /// # Errors
    /// When the bus cannot be reached; Host-Busy may then be left set.
    pub fn look(&mut self, bus: &mut impl Bus) -> Result<ServoLook, BusError> {
        let status = bus.read16(SERVO_PMAC_STATUS)?;
        if status & PMAC_BUSY != 0 {
            return Ok(ServoLook::Busy);
        }
        let timer = status & SERVO_TIMER_MASK;
        match self.last_timer {
            Some(last) if last != timer => {}
            Some(_) => return Ok(ServoLook::Unchanged),
            None => {
                self.last_timer = Some(timer);
                return Ok(ServoLook::First(timer));
            }
        }
        let look = match self.reading {
            ServoReading::Optimistic => self.copy(bus, status)?,
            ServoReading::Handshake => {
                bus.write16(SERVO_HOST_STATUS, HOST_BUSY)?;
                bus.order_writes();
                let look = self.copy_held(bus);
                Self::release(bus)?;
                look?
            }
        };
        if let ServoLook::Update(timer) = look {
            self.last_timer = Some(timer);
        }
        Ok(look)
    }

    /// Copies while Host-Busy is set, once PMAC is not busy.
    fn copy_held(&mut self, bus: &mut impl Bus) -> Result<ServoLook, BusError> {
        for _ in 0..BUSY_LOOKS {
            let status = bus.read16(SERVO_PMAC_STATUS)?;
            if status & PMAC_BUSY == 0 {
                return self.copy(bus, status);
            }
        }
        Ok(ServoLook::Busy)
    }

    /// Copies the buffer; `before` is the status word read before. Accepts the copy only if it still stands.
    fn copy(&mut self, bus: &mut impl Bus, before: u16) -> Result<ServoLook, BusError> {
        bus.order_reads();
        let began_ns = self.clock.ns();
        let global = word_index(SERVO_GLOBAL_STATUS_Y);
        bus.read_data(SERVO_GLOBAL_STATUS_Y, &mut self.image[global..global + GLOBAL_WORDS])?;
        let motors = &mut self.image[word_index(SERVO_MOTOR)..];
        for run in &self.runs {
            bus.read_data(SERVO_MOTOR.plus_words(run.start), &mut motors[run.clone()])?;
        }
        bus.order_reads();
        let after = bus.read16(SERVO_PMAC_STATUS)?;
        // A timer that comes round while this thread is held up looks as if nothing had happened.
        if after != before || self.clock.ns().saturating_sub(began_ns) > LONGEST_COPY_NS {
            return Ok(ServoLook::Torn);
        }
        self.image[word_index(SERVO_PMAC_STATUS)] = after;
        Ok(ServoLook::Update(after & SERVO_TIMER_MASK))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::{Counted, FileBoard};
    use crate::map::HostOffset;

    fn bus() -> Counted<FileBoard> {
        let file = tempfile::tempfile().unwrap();
        file.set_len(0x4000).unwrap();
        Counted::new(FileBoard::from_file(&file, 0x4000).unwrap())
    }

    fn update(bus: &mut impl Bus, timer: u16) {
        bus.write16(SERVO_MOTOR, timer).unwrap();
        bus.write16(SERVO_PMAC_STATUS, timer).unwrap();
    }

    #[test]
    fn what_lay_there_before_is_not_an_update() {
        let (mut bus, mut reader) = (bus(), ServoReader::new(ServoReading::Optimistic));
        update(&mut bus, 5);
        assert_eq!(reader.look(&mut bus).unwrap(), ServoLook::First(5));
        assert_eq!(reader.look(&mut bus).unwrap(), ServoLook::Unchanged);
        update(&mut bus, 6);
        assert_eq!(reader.look(&mut bus).unwrap(), ServoLook::Update(6));
        assert_eq!(reader.image()[word_index(SERVO_MOTOR)], 6);
        reader.forget();
        update(&mut bus, 9);
        assert_eq!(reader.look(&mut bus).unwrap(), ServoLook::First(9));
    }

    #[test]
    fn an_update_costs_the_words_it_needs() {
        for (reading, overhead) in [(ServoReading::Optimistic, 2), (ServoReading::Handshake, 5)] {
            for motors in 0..=8 {
                let (mut bus, mut reader) = (bus(), ServoReader::new(reading));
                reader.set_motors(motors);
                reader.look(&mut bus).unwrap();
                update(&mut bus, 1);
                let before = bus.accesses();
                assert_eq!(reader.look(&mut bus).unwrap(), ServoLook::Update(1));
                assert_eq!(
                    bus.accesses() - before,
                    overhead + 4 + 30 * motors as u64,
                    "{reading:?} {motors}"
                );
                assert_eq!(bus.read16(SERVO_HOST_STATUS).unwrap(), 0, "Host-Busy is clear again");
            }
        }
    }

    /// A bus on which PMAC acts at a chosen access of the host.
    struct Interfering {
        bus: FileBoard,
        accesses: usize,
        at: usize,
        write: (HostOffset, u16),
    }

    impl Interfering {
        fn act(&mut self, words: usize) {
            for _ in 0..words {
                if self.accesses == self.at {
                    self.bus.write16(self.write.0, self.write.1).unwrap();
                }
                self.accesses += 1;
            }
        }
    }

    impl Bus for Interfering {
        fn length(&self) -> usize {
            self.bus.length()
        }
        fn read16(&mut self, offset: HostOffset) -> Result<u16, BusError> {
            self.act(1);
            self.bus.read16(offset)
        }
        fn write16(&mut self, offset: HostOffset, value: u16) -> Result<(), BusError> {
            self.act(1);
            self.bus.write16(offset, value)
        }
        fn read_block(&mut self, first: HostOffset, words: &mut [u16]) -> Result<(), BusError> {
            self.act(words.len());
            self.bus.read_block(first, words)
        }
        fn order_reads(&mut self) {}
        fn order_writes(&mut self) {}
    }

    #[test]
    fn a_copy_pmac_wrote_into_is_never_accepted() {
        for reading in [ServoReading::Optimistic, ServoReading::Handshake] {
            // Wherever PMAC-Busy comes up during the copy, even after Host-Busy was set, the copy is refused.
            let accesses = if reading == ServoReading::Optimistic { 1..246 } else { 2..248 };
            for at in accesses {
                let file = tempfile::tempfile().unwrap();
                file.set_len(0x4000).unwrap();
                let mut bus = FileBoard::from_file(&file, 0x4000).unwrap();
                let mut reader = ServoReader::new(reading);
                reader.look(&mut bus).unwrap();
                update(&mut bus, 1);
                let mut bus = Interfering { bus, accesses: 0, at, write: (SERVO_PMAC_STATUS, PMAC_BUSY | 1) };
                let look = reader.look(&mut bus).unwrap();
                assert!(matches!(look, ServoLook::Torn | ServoLook::Busy), "{reading:?} {at} {look:?}");
                assert_eq!(bus.bus.read16(SERVO_HOST_STATUS).unwrap(), 0);
                // It is taken at the next look, once PMAC is done.
                bus.bus.write16(SERVO_PMAC_STATUS, 2).unwrap();
                assert_eq!(reader.look(&mut bus).unwrap(), ServoLook::Update(2));
            }
        }
    }

    #[test]
    fn a_stuck_busy_bit_and_a_missing_board_give_no_data() {
        let (mut bus, mut reader) = (bus(), ServoReader::new(ServoReading::Handshake));
        bus.write16(SERVO_PMAC_STATUS, PMAC_BUSY | 3).unwrap();
        assert_eq!(reader.look(&mut bus).unwrap(), ServoLook::Busy);
        bus.write16(SERVO_PMAC_STATUS, 0xFFFF).unwrap();
        assert_eq!(reader.look(&mut bus).unwrap(), ServoLook::Busy);
        assert_eq!(bus.read16(SERVO_HOST_STATUS).unwrap(), 0);
    }
}
