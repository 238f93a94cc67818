//! The words of a board's DPRAM that these tests look at or spoil, wherever its family has them.

use pmac_dpram::map::{Family, HostOffset, Layout};

/// A word that the board writes, or a bit of the host's, by what it is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Word {
    /// Control word of a response.
    ResponseControl,
    /// The characters of a response.
    ResponseCount,
    GatherSize,
    GatherIndex,
    /// The index where no firmware moved it.
    PrintedGatherIndex,
    /// Host-Busy of the servo report.
    ServoBusy,
    /// Host-Busy of the background report.
    BackgroundBusy,
    /// Data-Ready of the background report.
    BackgroundReady,
    BackgroundTimer,
}

impl Word {
    /// Where it lies; `None` where the family has none.
    pub fn offset(self, family: &'static Family) -> Option<HostOffset> {
        let background = &family.background;
        let moved = |offset: HostOffset| offset.plus_words(family.gather_shift as usize / 2);
        Some(match self {
            Self::ResponseControl => family.ascii.response_control,
            Self::ResponseCount => family.ascii.response_count,
            Self::GatherSize => moved(family.gather.size),
            Self::GatherIndex => moved(family.gather.index),
            Self::PrintedGatherIndex => family.gather.index,
            Self::ServoBusy => family.servo.host_busy.word,
            Self::BackgroundBusy => background.host_busy?.word,
            Self::BackgroundReady => background.ready.word,
            Self::BackgroundTimer => background.timer.low,
        })
    }
}

/// Bits of the host on which a board would wait for ever: Host-Busy, the command's flag and character, the panel's requests,
/// the counts of the variable tables.
pub fn host_bits(family: &Family) -> Vec<(HostOffset, u16)> {
    let busy = [Some(family.servo.host_busy), family.background.host_busy];
    let flags = busy.into_iter().flatten().chain([family.ascii.command_loaded]);
    let counts = [family.variable_write.count, family.variable_read.count];
    let panel = family.panel.as_ref().map(|panel| panel.request_enable);
    flags
        .map(|flag| (flag.word, flag.mask))
        .chain([(family.ascii.control_character, 0xFF)])
        .chain(counts.into_iter().chain(panel).map(|word| (word, 0xFFFF)))
        .collect()
}

/// Where the registers of each motor stand in the payload of a servo sample, in words: its start, and the motor's blocks.
/// The spare words of a block are no registers.
struct Motors {
    first: usize,
    words: usize,
    registers: &'static [(usize, usize)],
}

fn motors(family: &Family) -> Motors {
    let servo = &family.servo;
    Motors {
        // The payload begins with the report.
        first: servo.index(servo.motors.first),
        words: servo.motors.words,
        registers: match servo.mask {
            None => &[(0, 26)],
            Some(_) => &[(0, 16), (20, 24)],
        },
    }
}

/// The longs of all motors that carry the number of their update once the simulator's tags are on.
pub fn tagged_longs(family: &Family, words: &[u16]) -> impl Iterator<Item = u32> {
    let Motors { first, words: block, registers } = motors(family);
    words.get(first..).unwrap_or_default().chunks(block).flat_map(move |motor| {
        let longs = registers.iter().flat_map(|&(from, to)| (from..to).step_by(2));
        longs.map(|at| u32::from(motor[at]) | u32::from(motor[at + 1]) << 16).collect::<Vec<_>>()
    })
}

/// Where the time of an update stands in the payload of a servo sample once the simulator writes it: at the position of
/// motor 1 that the simulator does without, of two longs.
pub fn time_index(family: &'static Family) -> usize {
    let layout = Layout::new(family, None);
    let find = |register| layout.find("servo", register, Some(1));
    let place = find("motor_compensation_position").or_else(|| find("motor_position_bias"));
    family.servo.index(place.expect("a register of the report").offset)
}
