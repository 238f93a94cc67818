//! PMAC's changes of its DPRAM during a recording, from the daemon's reads.
//!
//! The replay puts a report into the window as a whole: the words that the daemon read while the report's flag stayed
//! the same. So an update is never half old and half new, however the daemon was interrupted. The replay leaves out an
//! update that the daemon did not read to its end. Other words change in bursts, as the daemon read them.
//!
//! If a word reads as the host wrote it, PMAC did not write it. The timeline leaves out the words of the ASCII port:
//! the replay itself answers there. Later images fill the gaps of the trace ([`super::images`]).

use std::ops::Range;

use super::images::{LaterImage, later_images};
use crate::map::functions::Flag;
use crate::map::{Family, HostOffset, Timer};
use crate::recording::{Op, Recording};

/// A burst of reads ends when none follows for this long.
const BURST_NS: u64 = 50_000;

/// Words that change at the same time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Step {
    /// Their time, from the first access on.
    pub at_ns: u64,
    /// The end of this step's changes among all changes; they begin where the step before ends.
    pub end: usize,
}

/// The changes of the window, with their times.
#[derive(Debug, Default)]
pub struct Timeline {
    steps: Vec<Step>,
    changes: Vec<(u16, u16)>,
    next: usize,
    /// When the last thing was read.
    end_ns: u64,
}

impl Timeline {
    /// The timeline of `recording`, a board of `family`, whose window begins as `window`.
    #[must_use]
    pub fn of(recording: &Recording, family: &Family, window: &[u16]) -> Self {
        let mut reader = Reader::new(family, window);
        let zero = recording.accesses.first().map_or(recording.about.began_ns, |access| access.t_ns);
        let mut images = later_images(recording, zero).peekable();
        for access in &recording.accesses {
            while let Some(image) = images.next_if(|image| image.at_ns <= access.t_ns - zero) {
                reader.see_image(image);
            }
            let (at_ns, low) = (access.t_ns - zero, access.offset.word() as u16);
            let halves = [(low, access.value as u16), (low + 1, (access.value >> 16) as u16)];
            for (word, value) in halves.into_iter().take(usize::from(access.width / 16)) {
                match access.op {
                    Op::Read => reader.read(word, value, at_ns),
                    Op::Write => reader.write(word, value),
                }
            }
        }
        images.for_each(|image| reader.see_image(image));
        // A later image does not show the window when the trace began. The replay then begins with the first update.
        let begins_late =
            !recording.accesses.is_empty() && recording.images.first().is_none_or(|image| image.t_ns > zero);
        let mut found = reader.finish(begins_late);
        // Otherwise the window begins as the image, and the daemon's reads come after it.
        found.iter_mut().filter(|_| !begins_late).for_each(|(at_ns, _)| *at_ns = at_ns.saturating_add(1));
        found.sort_by_key(|(at_ns, _)| *at_ns);
        let last_access = recording.accesses.last().map_or(0, |access| access.t_ns);
        let end_ns = recording.images.last().map_or(0, |image| image.t_ns).max(last_access);
        let mut timeline = Self { end_ns: end_ns.saturating_sub(zero), ..Self::default() };
        for (at_ns, changes) in found {
            timeline.changes.extend(changes);
            timeline.steps.push(Step { at_ns, end: timeline.changes.len() });
        }
        timeline
    }

    /// The changes that are due `at_ns` after the beginning and that no earlier call returned.
    pub fn take_due(&mut self, at_ns: u64) -> &[(u16, u16)] {
        let begin = self.next.checked_sub(1).map_or(0, |last| self.steps[last].end);
        while self.steps.get(self.next).is_some_and(|step| step.at_ns <= at_ns) {
            self.next += 1;
        }
        let end = self.next.checked_sub(1).map_or(0, |last| self.steps[last].end);
        &self.changes[begin..end]
    }

    /// When `word` changes first, from the beginning on; 0 if it never changes.
    #[must_use]
    pub fn first_ns(&self, word: u16) -> u64 {
        let mut begin = 0;
        for step in &self.steps {
            let changes = &self.changes[begin..step.end];
            begin = step.end;
            if step.at_ns > 0 && changes.iter().any(|(changed, _)| *changed == word) {
                return step.at_ns;
            }
        }
        0
    }

    /// When the last thing was read, from the beginning on.
    #[must_use]
    pub const fn end_ns(&self) -> u64 {
        self.end_ns
    }
}

/// The words of the ASCII port.
#[must_use]
pub fn ascii_words(family: &Family) -> Vec<Range<u16>> {
    let port = &family.ascii;
    let span = |first: HostOffset, words: usize| first.word() as u16..(first.word() + words) as u16;
    vec![
        span(port.command_loaded.word, 1),
        span(port.control_character, 1),
        span(port.command, port.command_bytes / 2),
        span(port.response_control, 1),
        span(port.response_count, 1),
        span(port.response, crate::map::functions::RESPONSE_BYTES / 2),
    ]
}

/// A report, and the daemon's reads of it.
struct Report {
    words: Range<u16>,
    /// The host's words in it.
    hosts: Vec<u16>,
    flag: u16,
    /// The flag's bits that are set, and those that are clear, when the report is whole.
    when_whole: (u16, u16),
    timer: u16,
    /// The daemon's reads since the flag's last change.
    open: Option<Update>,
    whole: Vec<Update>,
}

/// An update of a report.
struct Update {
    at_ns: u64,
    flag: u16,
    words: Vec<(u16, u16)>,
    /// How many of the words the daemon read before its last look at the flag.
    sound: usize,
}

impl Report {
    /// `is_set`: the flag, when the report is whole.
    fn new(
        words: Range<HostOffset>,
        flag: Flag,
        is_set: bool,
        timer: Timer,
        hosts: &[Option<HostOffset>],
    ) -> Self {
        let hosts = hosts.iter().flatten().map(|host| host.word() as u16).collect();
        Self {
            words: words.start.word() as u16..words.end.word() as u16,
            hosts,
            flag: flag.word.word() as u16,
            when_whole: if is_set { (flag.mask, 0) } else { (0, flag.mask) },
            timer: timer.low.word() as u16,
            open: None,
            whole: Vec::new(),
        }
    }

    /// The daemon has read the flag; with `is_old` it is unchanged.
    fn look(&mut self, flag: u16, is_old: bool, at_ns: u64) {
        if let Some(open) = self.open.as_mut().filter(|open| open.flag == flag) {
            open.sound = open.words.len();
            return;
        }
        self.close();
        self.open = (!is_old).then(|| Update { at_ns, flag, words: Vec::new(), sound: 0 });
    }

    fn read(&mut self, word: u16, value: u16) {
        if let Some(open) = self.open.as_mut().filter(|_| !self.hosts.contains(&word)) {
            open.words.push((word, value));
        }
    }

    fn close(&mut self) {
        if let Some(mut open) = self.open.take() {
            open.words.truncate(open.sound);
            self.whole.push(open);
        }
    }

    /// The update that an image shows, with the flag as PMAC left it; the host may have changed the flag since.
    fn of_image(&self, image: &LaterImage<'_>) -> Option<(u64, Vec<(u16, u16)>)> {
        let mut words = image.report(&self.words, &self.hosts)?;
        let (set, cleared) = self.when_whole;
        let at = words.iter().position(|(word, _)| *word == self.flag)?;
        let (flag, value) = words.remove(at);
        words.push((flag, (value | set) & !cleared));
        Some((image.at_ns, words))
    }

    /// The updates that the daemon read to their end: those with every word that more than half of all updates have.
    /// If the trace has none, the updates of `images`. With `begins_late` the trace's first update was in the window
    /// from the beginning.
    fn finish(mut self, images: &[LaterImage<'_>], begins_late: bool) -> Vec<(u64, Vec<(u16, u16)>)> {
        let shown: Vec<_> =
            images.iter().filter_map(|image| Some((&image.around, self.of_image(image)?))).collect();
        let mut updates = self.finish_trace();
        let is_told = |around: &Range<u64>| updates.iter().any(|(at_ns, _)| around.contains(at_ns));
        let untold: Vec<_> =
            shown.into_iter().filter(|(around, _)| !is_told(around)).map(|(_, update)| update).collect();
        if let Some((at_ns, _)) = updates.first_mut().filter(|_| begins_late) {
            *at_ns = 0;
        }
        updates.extend(untold);
        updates
    }

    fn finish_trace(&mut self) -> Vec<(u64, Vec<(u16, u16)>)> {
        self.close();
        let is_data = |word: u16| word != self.timer;
        self.whole.retain(|update| update.words.iter().any(|(word, _)| is_data(*word)));
        let first = self.words.start;
        let places = |update: &Update| {
            let mut places: Vec<_> = update.words.iter().map(|(word, _)| usize::from(word - first)).collect();
            places.sort_unstable();
            places.dedup();
            places
        };
        let mut counts = vec![0; self.words.len()];
        self.whole.iter().flat_map(places).for_each(|place| counts[place] += 1);
        let most = self.whole.len() / 2;
        let needed = counts.iter().filter(|count| **count > most).count();
        let is_whole =
            |update: &Update| places(update).iter().filter(|place| counts[**place] > most).count() == needed;
        let flag = self.flag;
        let whole = std::mem::take(&mut self.whole).into_iter().filter(is_whole);
        whole
            .map(|Update { at_ns, flag: value, mut words, .. }| {
                words.push((flag, value));
                (at_ns, words)
            })
            .collect()
    }
}

/// Goes through the accesses.
struct Reader<'a> {
    ascii: Vec<Range<u16>>,
    reports: [Report; 2],
    /// Each word's value, as far as the daemon read or wrote it.
    now: Vec<u16>,
    burst: Vec<(u16, u16)>,
    burst_at_ns: u64,
    last_ns: u64,
    found: Vec<(u64, Vec<(u16, u16)>)>,
    images: Vec<LaterImage<'a>>,
}

impl<'a> Reader<'a> {
    fn new(family: &Family, window: &[u16]) -> Self {
        let (servo, background) = (&family.servo, &family.background);
        let region = |region: crate::map::Region| region.start..region.end;
        let second = |mask: HostOffset| mask.plus_words(1);
        let servo_hosts = [Some(servo.host_busy.word), servo.mask, servo.mask.map(second)];
        let background_hosts = [background.host_busy.map(|busy| busy.word), background.count];
        Self {
            ascii: ascii_words(family),
            reports: [
                Report::new(
                    region(servo.region),
                    servo.pmac_status,
                    servo.busy.flag(false),
                    servo.timer,
                    &servo_hosts,
                ),
                Report::new(
                    region(background.region),
                    background.ready,
                    true,
                    background.timer,
                    &background_hosts,
                ),
            ],
            now: window.to_vec(),
            burst: Vec::new(),
            burst_at_ns: 0,
            last_ns: 0,
            found: Vec::new(),
            images: Vec::new(),
        }
    }

    fn read(&mut self, word: u16, value: u16, at_ns: u64) {
        if self.ascii.iter().any(|words| words.contains(&word)) {
            return;
        }
        let Some(now) = self.now.get_mut(usize::from(word)) else { return };
        let is_old = std::mem::replace(now, value) == value;
        if let Some(report) = self.reports.iter_mut().find(|report| report.words.contains(&word)) {
            if word == report.flag {
                report.look(value, is_old, at_ns)
            } else {
                report.read(word, value)
            }
            return;
        }
        if at_ns > self.last_ns + BURST_NS {
            self.end_burst();
        }
        self.last_ns = at_ns;
        if !is_old {
            if self.burst.is_empty() {
                self.burst_at_ns = at_ns;
            }
            self.burst.push((word, value));
        }
    }

    fn write(&mut self, word: u16, value: u16) {
        if let Some(now) = self.now.get_mut(usize::from(word)) {
            *now = value;
        }
        // The host has set the flag to its present value.
        self.reports.iter_mut().filter(|report| report.flag == word).for_each(Report::close);
    }

    /// Takes an image's words outside of reports; `finish` takes its reports.
    fn see_image(&mut self, image: LaterImage<'a>) {
        self.end_burst();
        let is_mine = |word: &u16| {
            !self
                .ascii
                .iter()
                .chain(self.reports.iter().map(|report| &report.words))
                .any(|words| words.contains(word))
        };
        let told: Vec<_> = image.untraced().filter(|(word, _)| is_mine(word)).collect();
        let mut changes = Vec::new();
        for (word, value) in told {
            if let Some(now) = self.now.get_mut(usize::from(word)).filter(|now| **now != value) {
                *now = value;
                changes.push((word, value));
            }
        }
        if !changes.is_empty() {
            self.found.push((image.at_ns, changes));
        }
        self.images.push(image);
    }

    fn end_burst(&mut self) {
        if !self.burst.is_empty() {
            self.found.push((self.burst_at_ns, std::mem::take(&mut self.burst)));
        }
    }

    fn finish(mut self, begins_late: bool) -> Vec<(u64, Vec<(u16, u16)>)> {
        self.end_burst();
        let Self { reports, mut found, images, .. } = self;
        for report in reports {
            found.extend(report.finish(&images, begins_late));
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::{PMAC, TURBO2};
    use crate::recording::testing::recording;
    use crate::recording::{Access, Image};

    fn steps(family: &Family, accesses: &[(u64, char, HostOffset, u32)]) -> Vec<(u64, Vec<(u16, u16)>)> {
        steps_with(family, accesses, &[])
    }

    /// Accesses: a time in microseconds, `r` or `w`, a word of the DPRAM, a value. Later images: a time, and words
    /// that are not 0.
    fn steps_with(
        family: &Family,
        accesses: &[(u64, char, HostOffset, u32)],
        images: &[(u64, Vec<(HostOffset, u16)>)],
    ) -> Vec<(u64, Vec<(u16, u16)>)> {
        let mut recording = recording();
        recording.accesses = accesses
            .iter()
            .map(|(at, op, offset, value)| Access {
                t_ns: 5_000 + at * 1000,
                op: if *op == 'r' { Op::Read } else { Op::Write },
                offset: *offset,
                width: if *value > 0xFFFF { 32 } else { 16 },
                value: *value,
            })
            .collect();
        let window = vec![0; family.length as usize / 2];
        recording.images = vec![Image { t_ns: 0, words: window.clone() }];
        recording.images.extend(images.iter().map(|(at, words)| {
            let mut image = window.clone();
            words.iter().for_each(|(offset, value)| image[offset.word()] = *value);
            Image { t_ns: 5_000 + at * 1000, words: image }
        }));
        let mut timeline = Timeline::of(&recording, family, &window);
        let times: Vec<u64> = timeline.steps.iter().map(|step| step.at_ns).collect();
        times.into_iter().map(|at| (at / 1000, timeline.take_due(at).to_vec())).collect()
    }

    fn word(offset: HostOffset) -> u16 {
        offset.word() as u16
    }

    #[test]
    fn an_update_is_put_there_as_a_whole_however_it_was_read() {
        let servo = &PMAC.servo;
        let (flag, data) = (servo.pmac_status.word, servo.motors.first);
        let next = data.plus_words(1);
        let found = steps(
            &PMAC,
            &[
                // The earlier value: the daemon read none.
                (0, 'r', flag, 6),
                (1, 'r', flag, 7),
                (2, 'r', data, 70),
                // The daemon was held up in the middle.
                (500, 'r', next, 71),
                (501, 'r', flag, 7),
                // Read after the last look: the word may belong to either update.
                (600, 'r', data, 99),
                // Torn: begun of 8, and read again of 9.
                (1000, 'r', flag, 8),
                (1001, 'r', data, 80),
                (1002, 'r', flag, 9),
                (1003, 'r', data, 90),
                (1004, 'r', next, 91),
                (1005, 'r', flag, 9),
                // Not read to its end.
                (2000, 'r', flag, 10),
                (2001, 'r', data, 100),
                (2002, 'r', flag, 10),
            ],
        );
        let update = |at, timer, first, second| {
            (at, vec![(word(data), first), (word(next), second), (word(flag), timer)])
        };
        assert_eq!(found, [update(1, 7, 70, 71), update(1002, 9, 90, 91)]);
    }

    #[test]
    fn a_flag_that_the_host_clears_comes_again_with_each_update() {
        let servo = &TURBO2.servo;
        let (flag, timer, data) = (servo.pmac_status.word, servo.timer.low, servo.motors.first);
        let set = u32::from(servo.pmac_status.mask);
        let update = |at: u64, value: u32| {
            [
                (at, 'r', flag, set),
                (at, 'r', timer, value),
                (at, 'r', data, value << 16 | 5),
                (at, 'r', flag, set),
                (at, 'r', timer, value),
                (at, 'w', flag, 0),
                (at + 100, 'r', flag, 0),
            ]
        };
        let found = steps(&TURBO2, &[update(10, 1), update(400, 2)].concat());
        let times: Vec<u64> = found.iter().map(|(at, _)| *at).collect();
        assert_eq!(times, [0, 390]);
        for (_, changes) in &found {
            assert_eq!(changes.last(), Some(&(word(flag), servo.pmac_status.mask)));
            assert!(changes.contains(&(word(data), 5)), "{changes:?}");
        }
    }

    #[test]
    fn other_words_come_in_bursts_and_the_hosts_own_not_at_all() {
        let (own, other) = (HostOffset::new(0x2000), HostOffset::new(0x2002));
        let ascii = PMAC.ascii.response;
        let found = steps(
            &PMAC,
            &[
                (0, 'r', own, 0),
                (10, 'w', own, 3),
                (20, 'r', own, 3),
                (30, 'r', other, 8),
                (60, 'r', own, 4),
                (70, 'r', ascii, 9),
                (200, 'r', other, 9),
            ],
        );
        assert_eq!(found, [(30, vec![(word(other), 8), (word(own), 4)]), (200, vec![(word(other), 9)])]);
    }

    #[test]
    fn without_a_trace_the_images_are_played_and_a_report_comes_whole() {
        let servo = &TURBO2.servo;
        let (flag, timer, data) = (servo.pmac_status, servo.timer.low, servo.motors.first);
        let free = HostOffset::new(0x2000);
        let first =
            vec![(timer, 7), (data, 5), (free, 1), (servo.mask.unwrap(), 3), (TURBO2.ascii.response, 9)];
        let second = vec![(timer, 7), (data, 5), (free, 2)];
        let found = steps_with(&TURBO2, &[], &[(1000, first), (2000, second)]);
        let times: Vec<u64> = found.iter().map(|(at, _)| *at).collect();
        assert_eq!(times, [1005, 1005, 2005], "the board made no update between the images");
        // Return a change at once when it is due.
        let (others, report) = found[0].1.split_at(1);
        assert_eq!(others, [(word(free), 1)]);
        assert!(report.contains(&(word(timer), 7)) && report.contains(&(word(data), 5)), "{report:?}");
        assert_eq!(report.last(), Some(&(word(flag.word), flag.mask)), "the host has cleared it since");
        assert!(!report.iter().any(|(at, _)| *at == word(servo.mask.unwrap())), "the host's own");
        assert_eq!(found[2].1, [(word(free), 2)]);
    }

    #[test]
    fn what_the_trace_tells_the_images_do_not() {
        let servo = &PMAC.servo;
        let (flag, data) = (servo.pmac_status.word, servo.motors.first);
        let (told, untold) = (HostOffset::new(0x2000), HostOffset::new(0x2100));
        let update = |at: u64, timer: u32| {
            [(at, 'r', flag, timer), (at + 1, 'r', data, timer), (at + 2, 'r', flag, timer)]
        };
        let accesses =
            [&update(0, 1)[..], &update(1000, 2), &[(2100, 'r', told, 4)], &update(9000, 3)].concat();
        let image = |timer, value| vec![(flag, timer), (data, timer), (told, value), (untold, value)];
        // The trace has a gap from 2100 on.
        let images = [(2000, image(2, 4)), (4000, image(20, 5)), (6000, image(30, 6)), (9500, image(3, 7))];
        let found = steps_with(&PMAC, &accesses, &images);
        let servo_timers: Vec<_> = found
            .iter()
            .flat_map(|(at, changes)| changes.iter().map(move |change| (*at, *change)))
            .filter(|(_, (at, _))| *at == word(flag))
            .map(|(at, (_, timer))| (at, timer))
            .collect();
        assert_eq!(servo_timers, [(0, 1), (1000, 2), (4000, 20), (9000, 3)], "{found:?}");
        let of = |offset| -> Vec<(u64, u16)> {
            let all = found.iter().flat_map(|(at, changes)| changes.iter().map(move |change| (*at, *change)));
            all.filter(|(_, (at, _))| *at == word(offset)).map(|(at, (_, value))| (at, value)).collect()
        };
        assert_eq!(of(told), [(2100, 4), (4000, 5), (6000, 6), (9500, 7)]);
        assert_eq!(of(untold), [(2000, 4), (4000, 5), (6000, 6), (9500, 7)]);
    }
}
