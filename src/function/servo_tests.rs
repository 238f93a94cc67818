//! The servo report's reader against a board that interferes.

use super::*;
use crate::device::{Counted, FileBoard};
use crate::map::pmac::{PMAC_BUSY, SERVO_HOST_STATUS, SERVO_MOTOR, SERVO_PMAC_STATUS};
use crate::map::{HostOffset, PMAC};

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
    let (mut bus, mut reader) =
        (bus(), ServoReader::new(&PMAC.servo, ServoReading::Optimistic, crate::map::Selection::ALL));
    update(&mut bus, 5);
    assert_eq!(reader.poll(&mut bus).unwrap(), ServoPoll::First(5));
    assert_eq!(reader.poll(&mut bus).unwrap(), ServoPoll::Unchanged);
    update(&mut bus, 6);
    assert_eq!(reader.poll(&mut bus).unwrap(), ServoPoll::Update(6));
    assert_eq!(reader.image()[PMAC.servo.index(SERVO_MOTOR)], 6);
    reader.reset();
    update(&mut bus, 9);
    assert_eq!(reader.poll(&mut bus).unwrap(), ServoPoll::First(9));
}

#[test]
fn an_update_costs_the_words_it_needs() {
    for (reading, overhead) in [(ServoReading::Optimistic, 2), (ServoReading::Handshake, 5)] {
        for motors in 0..=8 {
            let (mut bus, mut reader) =
                (bus(), ServoReader::new(&PMAC.servo, reading, crate::map::Selection::ALL));
            reader.set_motors(Motors::first(motors as usize));
            reader.poll(&mut bus).unwrap();
            update(&mut bus, 1);
            let before = bus.accesses();
            assert_eq!(reader.poll(&mut bus).unwrap(), ServoPoll::Update(1));
            assert_eq!(bus.accesses() - before, overhead + 4 + 30 * motors as u64, "{reading:?} {motors}");
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
        // Wherever PMAC sets its busy flag during the copy, even after the host set Host-Busy, the reader refuses the
        // copy.
        let accesses = if reading == ServoReading::Optimistic { 1..246 } else { 2..248 };
        for at in accesses {
            let file = tempfile::tempfile().unwrap();
            file.set_len(0x4000).unwrap();
            let mut bus = FileBoard::from_file(&file, 0x4000).unwrap();
            let mut reader = ServoReader::new(&PMAC.servo, reading, crate::map::Selection::ALL);
            reader.poll(&mut bus).unwrap();
            update(&mut bus, 1);
            let mut bus = Interfering { bus, accesses: 0, at, write: (SERVO_PMAC_STATUS, PMAC_BUSY | 1) };
            let poll = reader.poll(&mut bus).unwrap();
            assert!(matches!(poll, ServoPoll::Torn | ServoPoll::Busy), "{reading:?} {at} {poll:?}");
            assert_eq!(bus.bus.read16(SERVO_HOST_STATUS).unwrap(), 0);
            // The reader takes the update at the next poll, once PMAC is done.
            bus.bus.write16(SERVO_PMAC_STATUS, 2).unwrap();
            assert_eq!(reader.poll(&mut bus).unwrap(), ServoPoll::Update(2));
        }
    }
}

#[test]
fn a_stuck_busy_bit_and_a_missing_board_give_no_data() {
    let (mut bus, mut reader) =
        (bus(), ServoReader::new(&PMAC.servo, ServoReading::Handshake, crate::map::Selection::ALL));
    bus.write16(SERVO_PMAC_STATUS, PMAC_BUSY | 3).unwrap();
    assert_eq!(reader.poll(&mut bus).unwrap(), ServoPoll::Busy);
    bus.write16(SERVO_PMAC_STATUS, 0xFFFF).unwrap();
    assert_eq!(reader.poll(&mut bus).unwrap(), ServoPoll::Busy);
    assert_eq!(bus.read16(SERVO_HOST_STATUS).unwrap(), 0);
}
