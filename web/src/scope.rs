//! A scope's traces: the chosen values of motors, and their part of a batch of updates.

use std::fmt::Write as _;

use pmac_dpram::client::View;
use pmac_dpram::decode::servo::is_field;
use pmac_dpram::decode::{ServoData, ServoMotor};
use pmac_dpram::map::FAMILIES;

use crate::feed::Batch;

/// More traces than a picture can show.
const TRACES: usize = 16;

const COMMANDED: &str = "commanded_position";

/// A value of a motor.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Trace {
    motor: usize,
    field: String,
}

/// The traces that a client asks for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Traces(Vec<Trace>);

impl Traces {
    /// Reads `1.actual_position,2.following_error`.
    ///
    /// # Errors
    /// The fault in the text.
    pub fn parse(text: &str) -> Result<Self, String> {
        let one = |text: &str| {
            let (motor, field) = text.split_once('.')?;
            let motor: u8 = motor.parse().ok()?;
            // If the board's family has no such motor or field, the values are null.
            let has_motor = motor > 0 && FAMILIES.iter().any(|family| usize::from(motor) <= family.motors);
            (has_motor && is_field(field)).then(|| Trace { motor: motor.into(), field: field.to_owned() })
        };
        let traces: Option<Vec<Trace>> = text.split(',').map(one).collect();
        let traces = traces.ok_or("write traces as 1.actual_position,2.following_error")?;
        if traces.len() > TRACES { Err(format!("at most {TRACES} traces")) } else { Ok(Self(traces)) }
    }

    /// A batch as JSON: `t` in seconds of the board's servo timer (in servo cycles if a cycle's length is not known:
    /// then `cycles` is true); `v` an array a trace, null where the update has no value; `unscaled` whether a missing
    /// scale is the reason; `stale` if no updates follow.
    #[must_use]
    pub fn json(&self, batch: &Batch) -> String {
        let mut json = String::from("{\"t\":[");
        let cycle_s = batch.cycle_s.unwrap_or(1.0);
        list(&mut json, batch.updates.iter().map(|update| Some(update.servo_timer as f64 * cycle_s)));
        json.push_str("],\"v\":[");
        for (index, trace) in self.0.iter().enumerate() {
            json.push_str(if index == 0 { "[" } else { ",[" });
            let numbers = batch.updates.iter().map(|update| trace.number(&update.data.motors)?);
            list(&mut json, numbers);
            json.push(']');
        }
        let is_unscaled = |update: &View<ServoData>| {
            let mut numbers = self.0.iter().filter_map(|trace| trace.number(&update.data.motors));
            numbers.any(|number| number.is_none())
        };
        let unscaled = batch.updates.last().is_some_and(is_unscaled);
        let stale = batch.stale.map(|stale| stale.to_string());
        let rest = serde_json::json!({ "generation": batch.generation, "lost": batch.lost, "stale": stale, "unscaled": unscaled,
            "cycles": batch.cycle_s.is_none() });
        json.push_str("],");
        json.push_str(rest.to_string().trim_start_matches('{'));
        json
    }
}

impl Trace {
    /// The value in an update: `None` if the update lacks it, `Some(None)` while its scale is not known.
    fn number(&self, motors: &[ServoMotor]) -> Option<Option<f64>> {
        let motor = motors.iter().find(|motor| motor.motor == self.motor)?;
        let number = |field: &str| motor.quantities()[motor.place(field)?].map(|quantity| quantity.number());
        if motor.place(&self.field).is_some() || self.field != COMMANDED {
            return number(&self.field);
        }
        // A Turbo PMAC reports no commanded position (Turbo User Manual p. 402): its following error has it.
        let (actual, error) = (number("actual_position")?, number("following_error")?);
        Some(actual.zip(error).map(|(actual, error)| actual + error))
    }
}

fn list(json: &mut String, values: impl Iterator<Item = Option<f64>>) {
    for (index, value) in values.enumerate() {
        let comma = if index == 0 { "" } else { "," };
        let _ = match value.filter(|value| value.is_finite()) {
            Some(value) => write!(json, "{comma}{value}"),
            None => write!(json, "{comma}null"),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn traces_name_a_motor_and_a_field() {
        let traces = Traces::parse("1.actual_position,32.following_error").unwrap();
        assert_eq!(traces.0[1], Trace { motor: 32, field: "following_error".to_owned() });
        let many = vec!["1.velocity"; TRACES + 1].join(",");
        for wrong in ["", "1", "0.velocity", "33.velocity", "1.nonsense", "1.<script>", "1.velocity,", &many]
        {
            assert!(Traces::parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_batch_without_updates_says_why() {
        let stale = Some(pmac_dpram::client::Staleness::DaemonGone);
        let batch = Batch { generation: 3, cycle_s: None, updates: Vec::new(), lost: 7, stale };
        let json: serde_json::Value =
            serde_json::from_str(&Traces::parse("1.velocity").unwrap().json(&batch)).unwrap();
        assert_eq!((&json["t"], &json["v"]), (&serde_json::json!([]), &serde_json::json!([[]])));
        assert_eq!((&json["lost"], &json["cycles"]), (&7.into(), &true.into()));
        assert!(json["stale"].as_str().unwrap().contains("pmacd"), "{json}");
    }
}
