//! Decorator: keeps every access to a board's words while a client traces.
//!
//! The thread that owns the bus writes the accesses into a ring of fixed size and never waits: it counts and drops
//! accesses that do not fit. One reader takes them out.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use crate::clock::Clock;
use crate::device::{Access, Bus, BusError, Presence};
use crate::map::HostOffset;
use crate::protocol::board::Replay;

/// The kind of an access.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TracedKind {
    /// The host read a word.
    Read16,
    /// The host wrote a word.
    Write16,
    /// The host read two words at once.
    Read32,
}

impl TracedKind {
    const ALL: [Self; 3] = [Self::Read16, Self::Write16, Self::Read32];

    /// Its number in the ring, and on the socket.
    #[must_use]
    pub const fn number(self) -> u8 {
        self as u8
    }
}

/// An access.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TracedAccess {
    /// Its time. The words of a block have the time at which the block began.
    pub time_ns: u64,
    /// Its kind.
    pub kind: TracedKind,
    /// Its first word.
    pub offset: HostOffset,
    /// The word; of two, the one at `offset` is the low half.
    pub value: u32,
}

/// One place of the ring: a time; and kind (2 bits), word offset (30 bits) and value (32 bits).
#[derive(Default)]
struct Slot {
    time_ns: AtomicU64,
    rest: AtomicU64,
}

/// The ring between the thread that owns the bus and the one that takes the accesses out.
pub struct Trace {
    is_on: AtomicBool,
    slots: Box<[Slot]>,
    /// Accesses put in, and taken out, since the start.
    put: AtomicU64,
    taken: AtomicU64,
    dropped: AtomicU64,
}

impl Trace {
    /// A ring of `places`, which is switched off.
    #[must_use]
    pub fn new(places: usize) -> Arc<Self> {
        let counts = || AtomicU64::new(0);
        Arc::new(Self {
            is_on: AtomicBool::new(false),
            slots: (0..places).map(|_| Slot::default()).collect(),
            put: counts(),
            taken: counts(),
            dropped: counts(),
        })
    }

    /// Empties the ring, and keeps accesses from now on. Only the thread that takes them out calls this and the
    /// methods below.
    pub fn begin(&self) {
        self.taken.store(self.put.load(Ordering::Acquire), Ordering::Release);
        self.is_on.store(true, Ordering::Release);
    }

    /// Keeps no more accesses.
    pub fn end(&self) {
        self.is_on.store(false, Ordering::Release);
    }

    /// How many accesses found no place since the start.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Acquire)
    }

    /// How many accesses wait to be taken out, while accesses are kept.
    #[must_use]
    pub fn waiting(&self) -> u64 {
        let waiting = || self.put.load(Ordering::Acquire) - self.taken.load(Ordering::Acquire);
        if self.is_on() { waiting() } else { 0 }
    }

    /// Takes out at most `most` accesses, the oldest first.
    #[must_use]
    pub fn take(&self, most: usize) -> Vec<TracedAccess> {
        let (put, taken) = (self.put.load(Ordering::Acquire), self.taken.load(Ordering::Relaxed));
        let count = (put - taken).min(most as u64);
        let accesses = (taken..taken + count).filter_map(|number| self.access(number)).collect();
        self.taken.store(taken + count, Ordering::Release);
        accesses
    }

    fn access(&self, number: u64) -> Option<TracedAccess> {
        let slot = self.slot(number)?;
        let rest = slot.rest.load(Ordering::Relaxed);
        Some(TracedAccess {
            time_ns: slot.time_ns.load(Ordering::Relaxed),
            kind: *TracedKind::ALL.get((rest >> 62) as usize)?,
            offset: HostOffset::new(0).plus_words((rest >> 32 & 0x3FFF_FFFF) as usize),
            value: rest as u32,
        })
    }

    fn slot(&self, number: u64) -> Option<&Slot> {
        self.slots.get((number % (self.slots.len() as u64).max(1)) as usize)
    }

    fn is_on(&self) -> bool {
        self.is_on.load(Ordering::Relaxed)
    }

    /// Only the thread that owns the bus calls this.
    fn put(&self, access: TracedAccess) {
        let put = self.put.load(Ordering::Relaxed);
        let is_full = put - self.taken.load(Ordering::Acquire) >= self.slots.len() as u64;
        match self.slot(put).filter(|_| !is_full) {
            Some(slot) => {
                let place = u64::from(access.kind.number()) << 62 | (access.offset.word() as u64) << 32;
                slot.time_ns.store(access.time_ns, Ordering::Relaxed);
                slot.rest.store(place | u64::from(access.value), Ordering::Relaxed);
                self.put.store(put + 1, Ordering::Release);
            }
            None => self.dropped.store(self.dropped.load(Ordering::Relaxed) + 1, Ordering::Release),
        }
    }
}

/// A bus whose accesses go into a [`Trace`] while the trace is on.
pub struct Traced<B> {
    bus: B,
    trace: Arc<Trace>,
    clock: Clock,
}

impl<B> Traced<B> {
    /// The accesses to `bus` go into `trace`, with the times of `clock`.
    pub fn new(bus: B, trace: Arc<Trace>, clock: Clock) -> Self {
        Self { bus, trace, clock }
    }

    /// Replaces the bus. The trace goes on.
    pub fn replace(&mut self, bus: B) {
        self.bus = bus;
    }

    /// The time of the next access, if it is kept.
    fn begins(&self) -> Option<u64> {
        self.trace.is_on().then(|| self.clock.ns())
    }

    fn keep(&self, time_ns: Option<u64>, kind: TracedKind, offset: HostOffset, value: u32) {
        if let Some(time_ns) = time_ns {
            self.trace.put(TracedAccess { time_ns, kind, offset, value });
        }
    }

    fn keep_words(&self, time_ns: Option<u64>, first: HostOffset, words: &[u16]) {
        if time_ns.is_some() {
            for (index, word) in words.iter().enumerate() {
                self.keep(time_ns, TracedKind::Read16, first.plus_words(index), u32::from(*word));
            }
        }
    }

    /// Keeps a read by 32 bits where two words share an aligned location, as the board was read.
    fn keep_pairs(&self, time_ns: Option<u64>, first: HostOffset, words: &[u16]) {
        if time_ns.is_none() {
            return;
        }
        let single = first.word() % Access::MOST_WORDS;
        let (before, aligned) = words.split_at(single.min(words.len()));
        self.keep_words(time_ns, first, before);
        let start = first.plus_words(before.len());
        let (pairs, behind) = aligned.as_chunks();
        for (index, [low, high]) in pairs.iter().enumerate() {
            let value = u32::from(*high) << 16 | u32::from(*low);
            self.keep(time_ns, TracedKind::Read32, start.plus_words(index * Access::MOST_WORDS), value);
        }
        self.keep_words(time_ns, start.plus_words(aligned.len() - behind.len()), behind);
    }
}

impl<B: Bus> Bus for Traced<B> {
    fn length(&self) -> usize {
        self.bus.length()
    }

    fn access(&self) -> Access {
        self.bus.access()
    }

    fn read16(&mut self, offset: HostOffset) -> Result<u16, BusError> {
        let time_ns = self.begins();
        let word = self.bus.read16(offset)?;
        self.keep(time_ns, TracedKind::Read16, offset, u32::from(word));
        Ok(word)
    }

    fn write16(&mut self, offset: HostOffset, value: u16) -> Result<(), BusError> {
        let time_ns = self.begins();
        self.bus.write16(offset, value)?;
        self.keep(time_ns, TracedKind::Write16, offset, u32::from(value));
        Ok(())
    }

    fn read_block(&mut self, first: HostOffset, words: &mut [u16]) -> Result<(), BusError> {
        let time_ns = self.begins();
        self.bus.read_block(first, words)?;
        self.keep_words(time_ns, first, words);
        Ok(())
    }

    fn read_data(&mut self, first: HostOffset, words: &mut [u16]) -> Result<usize, BusError> {
        let time_ns = self.begins();
        let accesses = self.bus.read_data(first, words)?;
        if accesses < words.len() {
            self.keep_pairs(time_ns, first, words);
        } else {
            self.keep_words(time_ns, first, words);
        }
        Ok(accesses)
    }

    fn order_reads(&mut self) {
        self.bus.order_reads();
    }

    fn order_writes(&mut self) {
        self.bus.order_writes();
    }
}

impl<B: Presence> Presence for Traced<B> {
    fn still_there(&self) -> bool {
        self.bus.still_there()
    }

    fn answers(&mut self) -> bool {
        self.bus.answers()
    }

    fn replay(&self) -> Option<Replay> {
        self.bus.replay()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::ManualTime;
    use crate::device::FileBoard;

    const HERE: HostOffset = HostOffset::new(0x102);

    fn board(places: usize, access: Access) -> (Traced<FileBoard>, Arc<Trace>) {
        let file = tempfile::tempfile().unwrap();
        file.set_len(0x4000).unwrap();
        let trace = Trace::new(places);
        let bus = FileBoard::from_file(&file, 0x4000).unwrap().with_access(access);
        (Traced::new(bus, Arc::clone(&trace), ManualTime::at(7).clock()), trace)
    }

    fn access(kind: TracedKind, bytes: u32, value: u32) -> TracedAccess {
        TracedAccess { time_ns: 7, kind, offset: HostOffset::new(bytes), value }
    }

    #[test]
    fn every_access_is_kept_in_its_order_while_it_is_wanted() {
        let (mut bus, trace) = board(16, Access::Bits16);
        bus.read16(HERE).unwrap();
        trace.begin();
        bus.write16(HERE, 0xABCD).unwrap();
        assert_eq!(bus.read16(HERE).unwrap(), 0xABCD);
        bus.read_block(HostOffset::new(0x100), &mut [0; 2]).unwrap();
        assert_eq!(bus.read_data(HERE, &mut [0; 2]).unwrap(), 2);
        assert!(bus.read16(HostOffset::new(0x4000)).is_err(), "never on the bus");
        bus.write16(HostOffset::new(0x3FFE), 1).unwrap();
        trace.end();
        bus.read16(HERE).unwrap();
        use TracedKind::{Read16, Write16};
        let all = [
            access(Write16, 0x102, 0xABCD),
            access(Read16, 0x102, 0xABCD),
            access(Read16, 0x100, 0),
            access(Read16, 0x102, 0xABCD),
            access(Read16, 0x102, 0xABCD),
            access(Read16, 0x104, 0),
            access(Write16, 0x3FFE, 1),
        ];
        assert_eq!([trace.take(3), trace.take(99), trace.take(99)].concat(), all);
        assert_eq!(trace.dropped(), 0);
    }

    #[test]
    fn two_words_at_once_are_one_access() {
        let (mut bus, trace) = board(16, Access::Bits32);
        for word in 0..6 {
            bus.write16(HostOffset::new(0x100 + 2 * word), word as u16 + 1).unwrap();
        }
        trace.begin();
        let mut words = [0; 4];
        let accesses = bus.read_data(HERE, &mut words).unwrap();
        use TracedKind::{Read16, Read32};
        let kept = [access(Read16, 0x102, 2), access(Read32, 0x104, 0x0004_0003), access(Read16, 0x108, 5)];
        assert_eq!((accesses, trace.take(99).as_slice()), (3, kept.as_slice()));
    }

    #[test]
    fn what_does_not_fit_is_dropped_and_counted() {
        let (mut bus, trace) = board(4, Access::Bits16);
        trace.begin();
        bus.read_block(HERE, &mut [0; 6]).unwrap();
        assert_eq!((trace.take(2).len(), trace.dropped()), (2, 2));
        bus.read_block(HERE, &mut [0; 3]).unwrap();
        assert_eq!((trace.take(99).len(), trace.dropped()), (4, 3));
        bus.read16(HERE).unwrap();
        trace.begin();
        assert_eq!(trace.take(99), [], "what an earlier reader has left");
    }
}
