//! What a simulated board can be made to do wrong.

use crate::support::Site;

/// What the board does wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Misbehaviour {
    Nothing,
    /// A fault of the simulator with its value, taken back afterwards.
    Fault(&'static str, &'static str),
    /// Words that are nonsense: an index, a count, a control word.
    Poke(&'static str, &'static str),
    /// The servo counter jumps.
    Timer(&'static str),
    Reset,
    /// The board's process is killed, as a power failure does, and started again.
    Power,
}

/// Whatever a run can draw.
pub const MISBEHAVIOURS: &[Misbehaviour] = {
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
        Poke("06D0", "000D"),
        Poke("06D0", "FFFF"),
        Poke("06D0", "8003"),
        Poke("06D2", "FFFF"),
        // Index and size of the gather buffer, in both places.
        Poke("08FE", "FFFF"),
        Poke("08FC", "0001"),
        Poke("07FE", "7FFF"),
        // Host-Busy, set by somebody else.
        Poke("0024", "0001"),
        // Data-Ready and the timer of the background report.
        Poke("0228", "FFFF"),
        Poke("022A", "0000"),
        Timer("-1"),
        Timer("-20000"),
        Timer("100000"),
        Reset,
        Power,
    ]
};

/// Makes the board of `site` do it.
pub fn disturb(site: &Site, misbehaviour: Misbehaviour) {
    match misbehaviour {
        Misbehaviour::Nothing | Misbehaviour::Power => {}
        Misbehaviour::Fault(name, value) => drop(site.control(&format!("fault {name} {value}"))),
        Misbehaviour::Poke(offset, value) => drop(site.control(&format!("poke {offset} {value}"))),
        Misbehaviour::Timer(step) => drop(site.control(&format!("timer {step}"))),
        Misbehaviour::Reset => drop(site.control("reset")),
    }
}

/// Whether the board may give responses that no host could know to be wrong.
pub fn garbles(misbehaviour: Misbehaviour) -> bool {
    matches!(
        misbehaviour,
        Misbehaviour::Fault("ascii_torn" | "ascii_repeat" | "ascii_count", _)
            | Misbehaviour::Poke("06D0" | "06D2", _)
    )
}
