//! The `replay:` board: a recording, played back. It moves no motor.
//!
//! The window begins as the first image, and changes as `timeline` says, in the clock's time. A word that the host
//! writes stays until the recorded PMAC overwrites it. `ascii` plays PMAC's half of the ASCII port. `differences`
//! tells in the log where the host departs from the recording: when the recording is over, and the rest when the board
//! is closed.

mod ascii;
mod differences;
mod images;
mod timeline;

use std::path::Path;
use std::sync::Arc;

use log::{info, warn};

use self::ascii::AsciiHalf;
use self::differences::Differences;
use self::timeline::Timeline;
use crate::clock::Clock;
use crate::device::{Bus, BusError, Presence};
use crate::format::TextOrder;
use crate::map::{Family, HostOffset};
use crate::protocol::board::Replay;
use crate::recording::{Recording, RecordingError, Replies};

/// The recording begins once the host has sent no line for so long. By then the host has identified the board.
const QUIET_NS: u64 = 300_000_000;
/// The recording begins at the latest so long after the host's first access.
const LATEST_NS: u64 = 1_500_000_000;

/// A recording as a board.
pub struct ReplayBoard {
    window: Vec<u16>,
    clock: Clock,
    timeline: Timeline,
    ascii: AsciiHalf,
    differences: Differences,
    /// The word of the servo report's flag.
    servo_flag: u16,
    /// When the host first accessed the board.
    opened_ns: Option<u64>,
    /// When the host last sent a line.
    asked_ns: u64,
    /// When the recording began to play.
    began_ns: Option<u64>,
    over: bool,
}

/// An opened recording.
pub struct OpenedReplay {
    /// The board.
    pub board: ReplayBoard,
    /// The recording's answers.
    pub replies: Arc<Replies>,
}

impl ReplayBoard {
    /// The recording in `directory`, of a board of `family` whose texts are packed in `order`, in the time of `clock`.
    ///
    /// # Errors
    /// [`RecordingError`].
    pub fn open(
        directory: &Path,
        family: &'static Family,
        order: TextOrder,
        clock: Clock,
    ) -> Result<OpenedReplay, RecordingError> {
        info!("replay: reads {}", directory.display());
        let recording = Recording::read(directory)?;
        let about = &recording.about;
        info!(
            "replay of {} taken {} ({}, {}): nothing can be moved",
            directory.display(),
            about.taken,
            about.board_type.as_deref().unwrap_or(family.title),
            about.firmware.as_deref().unwrap_or("firmware unknown")
        );
        if let Some(why) = &about.cut_short {
            warn!("replay: the recording was cut short: {why}");
        }
        if about.dropped > 0 {
            let (all, dropped) = (about.accesses.saturating_add(about.dropped), about.dropped);
            warn!("replay: of {all} accesses {dropped} were not recorded; what they showed is missing");
        }
        Ok(Self::of(&recording, family, order, clock))
    }

    /// As [`Self::open`], for a recording in memory.
    #[must_use]
    pub fn of(
        recording: &Recording,
        family: &'static Family,
        order: TextOrder,
        clock: Clock,
    ) -> OpenedReplay {
        let words = family.length as usize / 2;
        let mut window: Vec<u16> =
            recording.images.first().map_or_else(Vec::new, |image| image.words.clone());
        window.resize(words, 0);
        let timeline = Timeline::of(recording, family, &window);
        let replies = Arc::new(Replies::of(recording));
        let ascii = AsciiHalf::new(&family.ascii, order, Arc::clone(&replies));
        ascii.clear(&mut window);
        let board = Self {
            window,
            clock,
            timeline,
            ascii,
            differences: Differences::new(recording, family),
            servo_flag: family.servo.pmac_status.word.word() as u16,
            opened_ns: None,
            asked_ns: 0,
            began_ns: None,
            over: false,
        };
        OpenedReplay { board, replies }
    }

    /// The host accesses `word`: puts the changes that are due by now into the window. At the host's first access
    /// these are the words of the beginning. A host that has seen no update for long looks seldom, so the first update
    /// is due when the host looks.
    fn play(&mut self, word: usize) {
        let now = self.clock.ns();
        let opened = *self.opened_ns.get_or_insert(now);
        let is_quiet = now >= self.asked_ns.max(opened) + QUIET_NS;
        let looks = is_quiet && word == usize::from(self.servo_flag);
        if self.began_ns.is_none() && (looks || now >= opened + LATEST_NS) {
            self.began_ns = Some(now.saturating_sub(self.timeline.first_ns(self.servo_flag)));
        }
        if self.over {
            return;
        }
        let at_ns = self.began_ns.map_or(0, |began| now - began);
        for (word, value) in self.timeline.take_due(at_ns) {
            self.window[usize::from(*word)] = *value;
        }
        if at_ns > self.timeline.end_ns() {
            self.over = true;
            let seconds = self.timeline.end_ns() as f64 / 1e9;
            info!("replay: the recording is over after {seconds:.3} s; its data are stale from now on");
            self.differences.tell();
        }
    }

    fn check(&self, offset: HostOffset, words: usize) -> Result<(), BusError> {
        let length = self.length();
        if offset.bytes() as usize + 2 * words > length {
            return Err(BusError::OutOfRange { offset, words, length });
        }
        Ok(())
    }
}

impl Bus for ReplayBoard {
    fn length(&self) -> usize {
        2 * self.window.len()
    }

    fn read16(&mut self, offset: HostOffset) -> Result<u16, BusError> {
        let mut word = [0];
        self.read_block(offset, &mut word).map(|()| word[0])
    }

    fn write16(&mut self, offset: HostOffset, value: u16) -> Result<(), BusError> {
        self.check(offset, 1)?;
        self.play(offset.word());
        let found = std::mem::replace(&mut self.window[offset.word()], value);
        self.differences.write(offset.word(), found, value);
        if self.ascii.written(&mut self.window, offset, &mut self.differences) {
            self.asked_ns = self.clock.ns();
        }
        Ok(())
    }

    fn read_block(&mut self, first: HostOffset, words: &mut [u16]) -> Result<(), BusError> {
        self.check(first, words.len())?;
        self.play(first.word());
        let all = first.word()..first.word() + words.len();
        words.copy_from_slice(&self.window[all.clone()]);
        all.for_each(|word| self.differences.read(word));
        Ok(())
    }

    // The bus thread has both halves.
    fn order_reads(&mut self) {}
    fn order_writes(&mut self) {}
}

impl Presence for ReplayBoard {
    fn replay(&self) -> Option<Replay> {
        Some(Replay { over: self.over, differences: self.differences.count() as u32 })
    }
}

impl Drop for ReplayBoard {
    fn drop(&mut self) {
        self.differences.tell();
    }
}
