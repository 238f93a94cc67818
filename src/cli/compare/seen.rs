//! What a recording shows of the board's own doing: which words it writes, when it updates its servo report, in which order it
//! answers.

use std::collections::{BTreeMap, BTreeSet};

use crate::map::functions::response;
use crate::map::word_use::function_of;
use crate::map::{BufferLayout, Family, HostOffset};
use crate::recording::{Access, Op, Recording};

/// A stretch over which a servo period is measured. A look that is late by a tenth of a millisecond then makes a hundredth of it.
const STRETCH_NS: u64 = 10_000_000;
/// One of so many stretches is left out at each end.
const OUTLIERS: usize = 20;

/// What was seen of a board.
#[derive(Debug, Default, PartialEq)]
pub struct Seen {
    /// How many words of each function the board has changed; `user` stands for those of none.
    pub words: BTreeMap<String, usize>,
    /// Servo cycles from one servo update to the next, the usual number.
    pub update_cycles: Option<u32>,
    /// From where to where the servo period may be by the timer and the trace's clock, in nanoseconds.
    pub servo_period_ns: Option<(f64, f64)>,
    /// Each order in which command lines and control characters were answered, step by step.
    pub orders: BTreeSet<String>,
}

impl Seen {
    /// What `recording`, a board of `family`, shows.
    pub fn of(recording: &Recording, family: &'static Family) -> Self {
        let mut watch = Watch::new(recording, family);
        recording.accesses.iter().for_each(|access| watch.see(access));
        watch.finish(recording, family)
    }
}

struct Watch {
    family: &'static Family,
    /// What lay in each word when it was last read or written.
    now: Vec<Option<u16>>,
    changed: BTreeSet<usize>,
    written: BTreeSet<usize>,
    /// Times and timers of servo updates.
    updates: Vec<(u64, u32)>,
    flag: u16,
    exchange: Option<Vec<&'static str>>,
    /// What the flags of the ASCII port were when last read, or written.
    loaded: bool,
    character: bool,
    response: u16,
    orders: BTreeSet<String>,
}

impl Watch {
    fn new(recording: &Recording, family: &'static Family) -> Self {
        let words = family.length as usize / 2;
        let mut now = vec![None; words];
        if let Some(first) = recording.images.first() {
            now.iter_mut().zip(&first.words).for_each(|(now, word)| *now = Some(*word));
        }
        Self {
            family,
            now,
            changed: BTreeSet::new(),
            written: BTreeSet::new(),
            updates: Vec::new(),
            flag: 0,
            exchange: None,
            loaded: false,
            character: false,
            response: 0,
            orders: BTreeSet::new(),
        }
    }

    fn see(&mut self, access: &Access) {
        let halves = [access.value as u16, (access.value >> 16) as u16];
        for (index, value) in halves.into_iter().take(usize::from(access.width / 16)).enumerate() {
            let offset = access.offset.plus_words(index);
            let before = self.now[offset.word()].replace(value);
            match access.op {
                Op::Read => {
                    if before.is_some_and(|before| before != value) {
                        self.changed.insert(offset.word());
                    }
                    self.see_update(offset, value, access.t_ns);
                    self.see_answer(offset, value);
                }
                Op::Write => {
                    self.written.insert(offset.word());
                    self.see_question(offset, value);
                }
            }
        }
    }

    /// The timer's last word was read.
    fn see_update(&mut self, offset: HostOffset, value: u16, t_ns: u64) {
        let servo = &self.family.servo;
        if offset == servo.pmac_status.word {
            self.flag = value;
        }
        let is_busy = servo.busy.is_busy(servo.pmac_status.is_set(self.flag));
        if offset != servo.timer.low || is_busy || self.flag == u16::MAX {
            return;
        }
        let timer = servo.timer.value(value, self.flag);
        if self.updates.last().is_none_or(|(_, last)| *last != timer) {
            self.updates.push((t_ns, timer));
        }
    }

    fn see_question(&mut self, offset: HostOffset, value: u16) {
        let port = &self.family.ascii;
        if offset == port.command_loaded.word {
            self.loaded = value != 0;
            self.begin(value != 0, "line");
        } else if offset == port.control_character {
            self.character = value != 0;
            self.begin(value != 0, "control character");
        } else if offset == port.response_control {
            self.response = value;
        }
    }

    fn begin(&mut self, begins: bool, what: &'static str) {
        if begins {
            self.end();
            self.exchange = Some(vec![what]);
        }
    }

    fn see_answer(&mut self, offset: HostOffset, value: u16) {
        let port = &self.family.ascii;
        let step = if offset == port.command_loaded.word {
            let taken = std::mem::replace(&mut self.loaded, value != 0) && value == 0;
            taken.then_some("command flag cleared")
        } else if offset == port.control_character {
            let taken = std::mem::replace(&mut self.character, value != 0) && value == 0;
            taken.then_some("character cleared")
        } else if offset == port.response_control {
            let is_new = std::mem::replace(&mut self.response, value) != value && value != 0;
            is_new.then(|| response_name(value))
        } else {
            None
        };
        let Some((step, exchange)) = step.zip(self.exchange.as_mut()) else { return };
        if exchange.last() != Some(&step) {
            exchange.push(step);
        }
        if exchange.first() == Some(&"line")
            && (value == response::ACKNOWLEDGE || value & response::ERROR != 0)
        {
            self.end();
        }
    }

    fn end(&mut self) {
        if let Some(steps) = self.exchange.take().filter(|steps| steps.len() > 1) {
            self.orders.insert(steps.join(", "));
        }
    }

    fn finish(mut self, recording: &Recording, family: &'static Family) -> Seen {
        // The last one may not be whole.
        self.exchange = None;
        for pair in recording.images.windows(2) {
            let words = pair[0].words.iter().zip(&pair[1].words).enumerate();
            let changed = words.filter(|(word, (one, other))| one != other && !self.written.contains(word));
            self.changed.extend(changed.map(|(word, _)| word));
        }
        let settings = &recording.about.settings;
        let firmware = recording.about.firmware.as_deref().and_then(|text| text.parse().ok());
        let layout = BufferLayout::new(&settings.layout(family, firmware), &settings.plan).ok();
        let mut words: BTreeMap<String, usize> = BTreeMap::new();
        for word in &self.changed {
            let offset = HostOffset::new(2 * *word as u32);
            let function = layout.as_ref().and_then(|layout| function_of(layout, offset));
            *words.entry(function.map_or("user", |function| function.name()).to_owned()).or_default() += 1;
        }
        let range = 1_u32 << family.servo.timer.bits();
        let cycles = |pair: &[(u64, u32)]| pair[1].1.wrapping_sub(pair[0].1) % range;
        // The first one was there when the trace began.
        let updates = self.updates.get(1..).unwrap_or_default();
        let mut steps: Vec<u32> = updates.windows(2).map(cycles).collect();
        steps.sort_unstable();
        Seen {
            words,
            update_cycles: steps.get(steps.len() / 2).copied(),
            servo_period_ns: periods(updates, range),
            orders: self.orders,
        }
    }
}

/// The shortest and longest servo period, in nanoseconds a servo cycle, that the updates allow: the median from update to update,
/// and what longer stretches give, without their outliers. A busy machine delays single updates and the looks for them.
fn periods(updates: &[(u64, u32)], range: u32) -> Option<(f64, f64)> {
    let sorted = |least_ns: u64| {
        let mut begin = *updates.first()?;
        let mut periods = Vec::new();
        for update in &updates[1..] {
            let time_ns = update.0 - begin.0;
            if time_ns >= least_ns {
                let cycles = update.1.wrapping_sub(begin.1) % range;
                periods.push(time_ns as f64 / f64::from(cycles.max(1)));
                begin = *update;
            }
        }
        periods.sort_by(f64::total_cmp);
        Some(periods)
    };
    let single = sorted(0)?;
    let usual = *single.get(single.len() / 2)?;
    let stretches = sorted(STRETCH_NS)?;
    let mut kept = stretches.iter().skip(stretches.len() / OUTLIERS);
    let shortest = kept.next().map_or(usual, |shortest| shortest.min(usual));
    let longest = kept.rev().nth(stretches.len() / OUTLIERS).map_or(usual, |longest| longest.max(usual));
    Some((shortest, longest))
}

fn response_name(control: u16) -> &'static str {
    match control {
        response::LINE => "reply line",
        response::ACKNOWLEDGE => "<ACK>",
        response::TO_PROGRAM => "reply to a program",
        response::MESSAGE => "message of a program",
        _ if control & response::ERROR != 0 => "error",
        _ => "unknown control word",
    }
}
