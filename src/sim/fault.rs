//! How the board is told to misbehave, so that a driver can be tried against it.

/// What can go wrong with one of the functions that work by a flag in the background pass.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct FunctionFault {
    /// The function does nothing.
    pub stuck: bool,
    /// Background passes by which it acts late.
    pub late: u64,
    /// It says that it is done when half is done; the rest follows in the next pass.
    pub torn: bool,
}

/// Counts the passes by which a function acts late.
#[derive(Debug, Clone, Default)]
pub struct Delay(Option<u64>);

impl Delay {
    /// One pass with something to do; says whether it is done now, `late` passes after the first such pass.
    pub fn over(&mut self, late: u64) -> bool {
        let left = self.0.unwrap_or(late).min(late);
        self.0 = left.checked_sub(1);
        left == 0
    }
}

/// The faults in force.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Faults {
    /// The control panel. Torn: the mask is cleared before the second half of the requests is acted on.
    pub panel: FunctionFault,
    /// The background variable read. Torn: ready before the second half of the data is there.
    pub variable_read: FunctionFault,
    /// The background variable write. Torn: the count is cleared before the second half of the records is written.
    pub variable_write: FunctionFault,
    /// The binary rotary transfer. Torn: PMAC's index stops in the middle of a line for a pass.
    pub rotary: FunctionFault,
    /// The VME mailboxes. Torn: the response's interrupt comes before the second half of its characters.
    pub mailbox: FunctionFault,
    /// The interrupt controller of the host port takes no end of interrupt, and no clearing.
    pub host_port_stuck: bool,
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
    /// The control word of a response stands before the second half of its text does.
    pub ascii_torn: bool,
    /// Every response is given twice.
    pub ascii_repeat: bool,
    /// What the character count of a response says instead of the truth.
    pub ascii_count: Option<u16>,
    /// Every word reads zero.
    pub all_zeros: bool,
    /// Every word reads all ones, as with a board that has lost its power or its address.
    pub all_ones: bool,
}

impl Faults {
    /// Whether a host sees nothing of the memory.
    #[must_use]
    pub fn hides_memory(&self) -> bool {
        self.all_ones || self.all_zeros
    }

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
            "ascii_torn" => self.ascii_torn = switch()?,
            "ascii_repeat" => self.ascii_repeat = switch()?,
            "ascii_count" => self.ascii_count = if value == "off" { None } else { Some(count()? as u16) },
            "lost_interrupt" => self.lost_interrupts = count()?,
            "spurious_interrupt" => self.spurious_interrupts = if value == "on" { 1 } else { count()? },
            "all_ones" => self.all_ones = switch()?,
            "all_zeros" => self.all_zeros = switch()?,
            "host_port_stuck" => self.host_port_stuck = switch()?,
            _ => match name.rsplit_once('_').map(|(function, kind)| (self.function(function), kind)) {
                Some((Some(fault), "stuck")) => fault.stuck = switch()?,
                Some((Some(fault), "torn")) => fault.torn = switch()?,
                Some((Some(fault), "late")) => fault.late = count()?,
                _ => {
                    return Err(format!(
                        "no fault {name:?}; there are servo_busy_stuck, servo_silent, background_stuck, ascii_deaf, \
                         ascii_no_reply, ascii_late_ack, ascii_torn, ascii_repeat, ascii_count, lost_interrupt, \
                         spurious_interrupt, all_ones, all_zeros, host_port_stuck, and _stuck, _late, _torn of panel, variable_read, variable_write, rotary, \
                         mailbox"
                    ));
                }
            },
        }
        Ok(())
    }

    fn function(&mut self, name: &str) -> Option<&mut FunctionFault> {
        match name {
            "panel" => Some(&mut self.panel),
            "variable_read" => Some(&mut self.variable_read),
            "variable_write" => Some(&mut self.variable_write),
            "rotary" => Some(&mut self.rotary),
            "mailbox" => Some(&mut self.mailbox),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_delay_counts_passes_and_starts_anew() {
        let mut delay = Delay::default();
        let passes: Vec<bool> = (0..6).map(|_| delay.over(2)).collect();
        assert_eq!(passes, [false, false, true, false, false, true]);
        assert!(delay.over(0));
    }

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
        faults.set("variable_read_torn", "on", 0.5).unwrap();
        faults.set("rotary_late", "7", 0.5).unwrap();
        assert!(faults.variable_read.torn && faults.rotary.late == 7);
        for (name, value) in [
            ("panel_late", "x"),
            ("panel_deaf", "on"),
            ("servo_late", "1"),
            ("all_ones", "3"),
            ("ascii_late_ack", "-1ms"),
            ("ascii_late_ack", "x"),
            ("x", "on"),
        ] {
            assert!(faults.set(name, value, 0.5).is_err(), "{name} {value}");
        }
    }
}
