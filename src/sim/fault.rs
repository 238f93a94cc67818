//! How the board is told to misbehave, so that a driver can be tried against it.

/// The faults in force.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Faults {
    /// The servo report's PMAC-Busy bit is set and stays set; nothing more is written.
    pub servo_busy_stuck: bool,
    /// The servo report stands still.
    pub servo_silent: bool,
    /// The background report stands still.
    pub background_stuck: bool,
    /// Lines and control characters in the DPRAM are not looked at.
    pub ascii_deaf: bool,
    /// Lines are taken and executed, but no response comes.
    pub ascii_no_reply: bool,
    /// Servo cycles by which the closing `<ACK>` comes late.
    pub ascii_late_ack: u64,
    /// Interrupts still to be swallowed; `u64::MAX` is all of them.
    pub lost_interrupts: u64,
    /// Interrupts to raise with nothing behind them.
    pub spurious_interrupts: u64,
    /// Every word reads all ones, as with a board that has lost its power or its address.
    pub all_ones: bool,
}

impl Faults {
    /// Sets the fault `name` as `value` (`on`, `off` or a number) says; `ms_per_cycle` turns `50ms` into cycles.
    ///
    /// # Errors
    /// What is wrong with `name` or `value`, in words.
    pub fn set(&mut self, name: &str, value: &str, ms_per_cycle: f64) -> Result<(), String> {
        let switch = || match value {
            "on" => Ok(true),
            "off" | "0" => Ok(false),
            _ => Err(format!("fault {name} takes on or off, not {value:?}")),
        };
        let count = || match value {
            "on" => Ok(u64::MAX),
            "off" => Ok(0),
            _ => value.parse().map_err(|_| format!("fault {name} takes on, off or a number, not {value:?}")),
        };
        match name {
            "servo_busy_stuck" => self.servo_busy_stuck = switch()?,
            "servo_silent" => self.servo_silent = switch()?,
            "background_stuck" => self.background_stuck = switch()?,
            "ascii_deaf" => self.ascii_deaf = switch()?,
            "ascii_no_reply" => self.ascii_no_reply = switch()?,
            "ascii_late_ack" => {
                self.ascii_late_ack = match value.strip_suffix("ms").map(str::parse::<f64>) {
                    Some(Ok(ms)) if ms >= 0.0 => (ms / ms_per_cycle).ceil() as u64,
                    Some(_) => {
                        return Err(format!("fault {name} takes a number of cycles or Nms, not {value:?}"));
                    }
                    None => count()?,
                }
            }
            "lost_interrupt" => self.lost_interrupts = count()?,
            "spurious_interrupt" => self.spurious_interrupts = if value == "on" { 1 } else { count()? },
            "all_ones" => self.all_ones = switch()?,
            _ => {
                return Err(format!(
                    "no fault {name:?}; there are servo_busy_stuck, servo_silent, background_stuck, ascii_deaf, \
                     ascii_no_reply, ascii_late_ack, lost_interrupt, spurious_interrupt, all_ones"
                ));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_set_by_name_and_nonsense_is_refused() {
        let mut faults = Faults::default();
        faults.set("ascii_late_ack", "50ms", 0.5).unwrap();
        faults.set("lost_interrupt", "on", 0.5).unwrap();
        faults.set("all_ones", "on", 0.5).unwrap();
        assert_eq!(
            faults,
            Faults { ascii_late_ack: 100, lost_interrupts: u64::MAX, all_ones: true, ..Faults::default() }
        );
        faults.set("all_ones", "off", 0.5).unwrap();
        assert!(!faults.all_ones);
        for (name, value) in
            [("all_ones", "3"), ("ascii_late_ack", "-1ms"), ("ascii_late_ack", "x"), ("x", "on")]
        {
            assert!(faults.set(name, value, 0.5).is_err(), "{name} {value}");
        }
    }
}
