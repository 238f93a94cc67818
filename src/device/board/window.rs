//! A board whose DPRAM is a window of mapped memory: /dev/mem, a UIO map, a PCI resource, a VME window.

use std::fs::File;

use crate::device::Presence;
use crate::device::board::mapped::Mapped;
use crate::device::mapping::Mapping;
use crate::device::system::System;

/// How many words the driver samples before the window counts as silent.
const SAMPLES: usize = 64;

/// A mapped board.
pub struct WindowBoard {
    mapping: Mapping,
    /// The file whose disappearance or replacement shows that the device is gone.
    witness: Option<Witness>,
    /// Held as long as the board is open: the lock on it keeps other hosts away.
    _node: Option<File>,
}

struct Witness {
    system: System,
    path: String,
    identity: Option<(u64, u64)>,
}

impl WindowBoard {
    /// A board whose window cannot disappear.
    #[must_use]
    pub fn new(mapping: Mapping) -> Self {
        Self { mapping, witness: None, _node: None }
    }

    /// A board that is gone when the file at `path` disappears or is replaced; keeps `node` open as long as it lives.
    #[must_use]
    pub fn watched(mapping: Mapping, node: Option<File>, system: &System, path: String) -> Self {
        let identity = system.identity(&path);
        Self { mapping, witness: Some(Witness { system: system.clone(), path, identity }), _node: node }
    }
}

impl Mapped for WindowBoard {
    fn mapping(&self) -> &Mapping {
        &self.mapping
    }
}

impl Presence for WindowBoard {
    fn still_there(&self) -> bool {
        let there = |witness: &Witness| {
            witness.identity.is_some() && witness.system.identity(&witness.path) == witness.identity
        };
        self.witness.as_ref().is_none_or(there)
    }

    /// A single word proves that a device answers; only ones in all samples prove that none does.
    fn answers(&mut self) -> bool {
        let words = self.mapping.length() / 2;
        let step = (words / SAMPLES).max(1);
        (0..words)
            .step_by(step)
            .any(|word| self.mapping.read16(2 * word).is_some_and(|word| word != u16::MAX))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::Bus;
    use crate::device::testing::FakeSystem;
    use crate::map::HostOffset;

    fn board(file: &std::fs::File) -> WindowBoard {
        WindowBoard::new(Mapping::new(file, 0x20, 0x4000).unwrap())
    }

    #[test]
    fn words_are_those_of_the_window() {
        let file = tempfile::tempfile().unwrap();
        file.set_len(0x8000).unwrap();
        let mut board = board(&file);
        board.write16(HostOffset::new(0x3FFE), 0xABCD).unwrap();
        let mut words = [1; 2];
        board.read_block(HostOffset::new(0x3FFC), &mut words).unwrap();
        assert_eq!(words, [0, 0xABCD]);
        assert_eq!(Mapping::new(&file, 0, 0x8000).unwrap().read16(0x401E), Some(0xABCD));
        assert!(board.read_block(HostOffset::new(0x3FFE), &mut words).is_err());
        assert!(board.read16(HostOffset::new(0x4000)).is_err());
        assert!(board.write16(HostOffset::new(0x4000), 1).is_err());
        assert!(board.still_there());
    }

    #[test]
    fn memory_of_ones_alone_answers_not() {
        let file = tempfile::tempfile().unwrap();
        file.set_len(0x8000).unwrap();
        let mut board = board(&file);
        assert!(board.answers());
        for word in 0..0x2000 {
            board.write16(HostOffset::new(2 * word), u16::MAX).unwrap();
        }
        assert!(!board.answers());
        board.write16(HostOffset::new(0x100), 0).unwrap();
        assert!(board.answers());
    }

    #[test]
    fn a_device_that_went_away_or_was_replaced_is_noticed() {
        let fake = FakeSystem::new();
        let file = tempfile::tempfile().unwrap();
        file.set_len(0x8000).unwrap();
        let watched = |path: &str| {
            let mapping = Mapping::new(&file, 0, 0x4000).unwrap();
            WindowBoard::watched(mapping, None, &fake.system, path.to_owned())
        };
        fake.file("sys/class/uio/uio0/name", "x");
        let board = watched("/sys/class/uio/uio0");
        assert!(board.still_there());
        std::fs::rename(fake.path("sys/class/uio/uio0"), fake.path("sys/class/uio/uio1")).unwrap();
        assert!(!board.still_there());
        fake.file("sys/class/uio/uio0/name", "x");
        assert!(!board.still_there(), "another device has its name");
        assert!(watched("/sys/class/uio/uio0").still_there());
        assert!(!watched("/sys/class/uio/uio9").still_there());
    }
}
