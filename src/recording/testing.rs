//! Recordings for the unit tests.

use super::{About, FORMAT, Recording};
use crate::map::PMAC;
use crate::protocol::BoardSettings;

/// An empty recording of a PMAC.
pub fn recording() -> Recording {
    let about = About {
        format: FORMAT,
        program: "pmacctl 0.1.0".into(),
        pmacd: "0.1.0".into(),
        taken: "2026-11-25T12:00:00.000000Z".into(),
        began_ns: 0,
        name: "pmac0".into(),
        board: "sim".into(),
        family: PMAC.name.into(),
        board_type: None,
        firmware: None,
        dpram_bytes: PMAC.length,
        servo_period_ns: None,
        settings: BoardSettings::default(),
        updates: 0,
        accesses: 0,
        dropped: 0,
        cut_short: None,
        left_out: Vec::new(),
    };
    Recording {
        about,
        images: Vec::new(),
        accesses: Vec::new(),
        answers: Vec::new(),
        variables: None,
        system: serde_json::Value::Null,
    }
}
