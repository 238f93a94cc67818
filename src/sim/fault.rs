//! Faults that a test sets in the board, to try a driver against them. [`faults`] lists them.

/// A fault of one of the functions that work by a flag in the background pass.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct FunctionFault {
    /// The function does nothing.
    pub stuck: bool,
    /// Background passes by which the function acts late.
    pub late: u64,
    /// The function reports the end of its work when half is done; the rest follows in the next pass.
    pub torn: bool,
}

/// Counts the passes by which a function acts late.
#[derive(Debug, Clone, Default)]
pub struct Delay(Option<u64>);

impl Delay {
    /// One pass with work to do; true when the function acts now: `late` passes after the first such pass.
    pub fn over(&mut self, late: u64) -> bool {
        let left = self.0.unwrap_or(late).min(late);
        self.0 = left.checked_sub(1);
        left == 0
    }
}

/// Declares the faults: the fields of [`Faults`], and the table of their names.
macro_rules! declare {
    (
        faults { $($name:ident: $kind:ident, $effect:literal;)* }
        functions { $($function:ident, $title:literal, $torn:literal;)* }
    ) => {
        /// The faults in force.
        #[derive(Debug, Clone, Default, PartialEq)]
        pub struct Faults {
            $(#[doc = $effect] pub $name: declare!($kind),)*
            $(#[doc = $title] pub $function: FunctionFault,)*
        }

        static FAULTS: &[&[Fault]] = &[
            &[$(Fault { name: stringify!($name), effect: $effect, place: Place::$kind(|f| &mut f.$name) },)*],
            $(&[
                Fault {
                    name: concat!(stringify!($function), "_stuck"),
                    effect: concat!($title, " does nothing"),
                    place: Place::Switch(|f| &mut f.$function.stuck),
                },
                Fault {
                    name: concat!(stringify!($function), "_late"),
                    effect: concat!($title, " acts so many background passes late"),
                    place: Place::Count(|f| &mut f.$function.late),
                },
                Fault {
                    name: concat!(stringify!($function), "_torn"),
                    effect: $torn,
                    place: Place::Switch(|f| &mut f.$function.torn),
                },
            ],)*
        ];
    };
    (Switch) => { bool };
    (Instead) => { Option<u16> };
    ($counted:ident) => { u64 };
}

declare! {
    faults {
        servo_busy_stuck: Switch, "PMAC-Busy of the servo report stays set, and nothing more is written";
        servo_silent: Switch, "the servo report stands still";
        background_stuck: Switch, "the background report stands still";
        ascii_deaf: Switch, "lines and control characters in the DPRAM are not taken";
        ascii_no_reply: Switch, "lines are taken and executed, but no response comes";
        ascii_slow: Cycles, "each line takes so long";
        ascii_late_ack: Cycles, "the closing ACK comes so late";
        ascii_slow_lines: Cycles, "each line of a reply comes so late";
        ascii_late_cancel: Cycles, "^X clears the words of the port so late, with whatever the host has put there by then";
        ascii_no_size: Switch, "SIZE is answered with an error";
        no_binary_rotary: Switch, "OPEN BINARY ROTARY is answered with an error";
        jog_stop_refused: Switch, "J/ is answered with an error";
        ascii_torn: Switch, "a response's control word comes before the second half of its text";
        ascii_repeat: Switch, "every response comes twice";
        ascii_count: Instead, "the character count of a response says this number";
        lost_interrupt: Count, "so many interrupts are not raised";
        spurious_interrupt: Once, "so many interrupts come with nothing behind them";
        close_ignored: Switch, "CLOSE of a Turbo board is acknowledged and closes nothing; CLOSE ALL does";
        all_ones: Switch, "every word of the DPRAM reads all ones";
        all_zeros: Switch, "every word of the DPRAM reads zero";
        other_page: Switch, "while its page is not selected, the DPRAM shows another one";
        host_port_stuck: Switch, "the interrupt controller takes no end of interrupt and no clearing";
    }
    functions {
        panel, "the control panel", "the panel's mask is cleared before the second half of the requests is acted on";
        variable_read, "the background variable read", "variables are ready before the second half of the data is there";
        variable_write, "the background variable write", "the count is cleared before the second half of the records is written";
        rotary, "the binary rotary transfer", "PMAC's rotary index stops in the middle of a line for a pass";
        mailbox, "the mailbox port", "the response's interrupt comes before the second half of its characters";
    }
}

impl Faults {
    /// Whether a fault hides the memory from the host.
    #[must_use]
    pub fn hides_memory(&self) -> bool {
        self.all_ones || self.all_zeros
    }

    /// Sets the fault `name` as `value` (`on`, `off` or a number) says; `ms_per_cycle` turns `50ms` into cycles.
    ///
    /// # Errors
    /// The mistake in `name` or `value`, in words.
    pub fn set(&mut self, name: &str, value: &str, ms_per_cycle: f64) -> Result<(), String> {
        let Some(fault) = faults().find(|fault| fault.name == name) else {
            let names: Vec<_> = faults().map(|fault| fault.name).collect();
            return Err(format!("no fault {name:?}; there are {}", names.join(", ")));
        };
        let count = |on: u64| match value {
            "on" => Some(on),
            "off" => Some(0),
            _ => value.parse().ok(),
        };
        let taken = match fault.place {
            Place::Switch(place) => match value {
                "on" => Some(true),
                "off" | "0" => Some(false),
                _ => None,
            }
            .map(|on| *place(self) = on),
            Place::Count(place) => count(u64::MAX).map(|count| *place(self) = count),
            Place::Once(place) => count(1).map(|count| *place(self) = count),
            Place::Cycles(place) => match value.strip_suffix("ms") {
                Some(ms) => {
                    let ms = ms.parse().ok().filter(|ms: &f64| *ms >= 0.0);
                    ms.map(|ms| (ms / ms_per_cycle).ceil() as u64)
                }
                None => count(u64::MAX),
            }
            .map(|cycles| *place(self) = cycles),
            Place::Instead(place) => match value {
                "off" => Some(None),
                _ => value.parse().ok().map(Some),
            }
            .map(|number| *place(self) = number),
        };
        taken.ok_or_else(|| format!("fault {name} takes {}, not {value:?}", fault.values()))
    }
}

/// The fault's field in [`Faults`], which decides on its values.
#[derive(Clone, Copy)]
enum Place {
    Switch(fn(&mut Faults) -> &mut bool),
    /// This many times; `on` is always.
    Count(fn(&mut Faults) -> &mut u64),
    /// This many times; `on` is one time.
    Once(fn(&mut Faults) -> &mut u64),
    /// This many cycles, or milliseconds.
    Cycles(fn(&mut Faults) -> &mut u64),
    /// A number in place of the true one.
    Instead(fn(&mut Faults) -> &mut Option<u16>),
}

/// A fault that can be set by its name.
pub struct Fault {
    /// The name.
    pub name: &'static str,
    /// The fault's effect.
    pub effect: &'static str,
    place: Place,
}

impl Fault {
    /// The fault's possible values, in words.
    #[must_use]
    pub const fn values(&self) -> &'static str {
        match self.place {
            Place::Switch(_) => "on or off",
            Place::Count(_) | Place::Once(_) => "on, off or a number",
            Place::Cycles(_) => "on, off, a number of cycles or Nms",
            Place::Instead(_) => "off or a number",
        }
    }
}

/// Every fault.
pub fn faults() -> impl Iterator<Item = &'static Fault> {
    FAULTS.iter().copied().flatten()
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
            Faults { ascii_late_ack: 100, lost_interrupt: u64::MAX, all_ones: true, ..Faults::default() }
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

    #[test]
    fn each_fault_of_the_list_is_set_and_taken_back() {
        for fault in faults() {
            let mut set = Faults::default();
            set.set(fault.name, "on", 1.0).or_else(|_| set.set(fault.name, "3", 1.0)).unwrap();
            assert_ne!(set, Faults::default(), "{}", fault.name);
            set.set(fault.name, "off", 1.0).unwrap();
            assert_eq!(set, Faults::default(), "{}", fault.name);
        }
    }

    #[test]
    fn the_list_has_every_fault_there_is() {
        // A field that no fault of the list sets stays as it was.
        let mut all = Faults::default();
        for fault in faults() {
            let _ = all.set(fault.name, "on", 1.0).or_else(|_| all.set(fault.name, "3", 1.0));
        }
        let fields = |faults: &Faults| {
            let text = format!("{faults:?}").replace("FunctionFault {", "");
            text.split(", ").map(str::to_owned).collect::<Vec<_>>()
        };
        for (set, unset) in fields(&all).iter().zip(fields(&Faults::default())) {
            assert_ne!(*set, unset);
        }
    }
}
