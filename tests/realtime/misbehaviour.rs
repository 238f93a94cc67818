//! What a simulated board can be made to do wrong.

use pmac_dpram::map::{Family, Function};

use crate::board_words::Word;
use crate::support::Site;

/// What the board does wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Misbehaviour {
    Nothing,
    /// A fault of the simulator with its value, taken back afterwards.
    Fault(&'static str, &'static str),
    /// Words that are nonsense: an index, a count, a control word.
    Poke(Word, u16),
    /// The servo counter jumps.
    Timer(&'static str),
    Reset,
    /// The board's process is killed, as a power failure does, and started again.
    Power,
}

/// Whatever a run can draw on a board of any family.
const MISBEHAVIOURS: &[Misbehaviour] = {
    use Misbehaviour::*;
    &[
        Nothing,
        Fault("servo_busy_stuck", "on"),
        Fault("servo_silent", "on"),
        Fault("background_stuck", "on"),
        Fault("ascii_deaf", "on"),
        Fault("ascii_no_reply", "on"),
        Fault("ascii_late_ack", "30ms"),
        Fault("ascii_late_ack", "400ms"),
        Fault("ascii_torn", "on"),
        Fault("ascii_repeat", "on"),
        Fault("ascii_count", "0"),
        Fault("ascii_count", "1"),
        Fault("ascii_count", "300"),
        Fault("ascii_count", "65535"),
        Fault("lost_interrupt", "on"),
        Fault("lost_interrupt", "3"),
        Fault("spurious_interrupt", "50"),
        Fault("all_ones", "on"),
        Fault("all_zeros", "on"),
        Fault("panel_stuck", "on"),
        Fault("panel_late", "200"),
        Fault("panel_torn", "on"),
        Fault("variable_read_stuck", "on"),
        Fault("variable_read_late", "200"),
        Fault("variable_read_torn", "on"),
        Fault("variable_write_stuck", "on"),
        Fault("variable_write_late", "200"),
        Fault("variable_write_torn", "on"),
        Fault("rotary_stuck", "on"),
        Fault("rotary_late", "100"),
        Fault("rotary_torn", "on"),
        // Control word, count and text of a response nobody gave.
        Poke(Word::ResponseControl, 0x000D),
        Poke(Word::ResponseControl, 0xFFFF),
        Poke(Word::ResponseControl, 0x8003),
        Poke(Word::ResponseCount, 0xFFFF),
        // Index and size of the gather buffer, in both places.
        Poke(Word::GatherIndex, 0xFFFF),
        Poke(Word::GatherSize, 0x0001),
        Poke(Word::PrintedGatherIndex, 0x7FFF),
        // Host-Busy, set by somebody else, at the bit of either family.
        Poke(Word::ServoBusy, 0x8001),
        Poke(Word::BackgroundBusy, 0x8000),
        // Data-Ready and the timer of the background report.
        Poke(Word::BackgroundReady, 0xFFFF),
        Poke(Word::BackgroundTimer, 0x0000),
        Timer("-1"),
        Timer("-20000"),
        Timer("100000"),
        Reset,
        Power,
    ]
};

/// Whatever a run can draw on a board of `family`: faults of the functions that are used there, words that it has.
pub fn misbehaviours(family: &'static Family) -> Vec<Misbehaviour> {
    let is_used = |misbehaviour: &Misbehaviour| match misbehaviour {
        Misbehaviour::Fault(name, _) if name.starts_with("panel_") => {
            family.functions.contains(&Function::Panel)
        }
        Misbehaviour::Fault(name, _) if name.starts_with("rotary_") => {
            family.functions.contains(&Function::Rotary)
        }
        Misbehaviour::Poke(word, _) => word.offset(family).is_some(),
        _ => true,
    };
    MISBEHAVIOURS.iter().copied().filter(is_used).collect()
}

/// Makes the board of `site`, which is of `family`, do it.
pub fn disturb(site: &Site, family: &'static Family, misbehaviour: Misbehaviour) {
    match misbehaviour {
        Misbehaviour::Nothing | Misbehaviour::Power => {}
        Misbehaviour::Fault(name, value) => drop(site.control(&format!("fault {name} {value}"))),
        Misbehaviour::Poke(word, value) => {
            let offset = word.offset(family).expect("a word that the family has");
            site.control(&format!("poke {:04X} {value:04X}", offset.bytes()));
        }
        Misbehaviour::Timer(step) => drop(site.control(&format!("timer {step}"))),
        Misbehaviour::Reset => drop(site.control("reset")),
    }
}

/// Whether the board may give responses that no host could know to be wrong.
pub fn garbles(misbehaviour: Misbehaviour) -> bool {
    matches!(
        misbehaviour,
        Misbehaviour::Fault("ascii_torn" | "ascii_repeat" | "ascii_count", _)
            | Misbehaviour::Poke(Word::ResponseControl | Word::ResponseCount, _)
    )
}
