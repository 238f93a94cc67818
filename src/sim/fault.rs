//! How the board is told to misbehave, so that a driver can be tried against it. [`faults`] lists what can go wrong.

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
    /// Lines and control characters in the DPRAM are not taken.
    pub ascii_deaf: bool,
    /// Lines are taken and executed, but no response comes.
    pub ascii_no_reply: bool,
    /// Background passes that each line takes.
    pub ascii_slow: u64,
    /// Servo cycles by which the closing `<ACK>` comes late.
    pub ascii_late_ack: u64,
    /// Servo cycles by which each line of a reply comes late.
    pub ascii_slow_lines: u64,
    /// Passes by which `^X` clears the words of the port late.
    pub ascii_late_cancel: u64,
    /// `SIZE` is refused.
    pub ascii_no_size: bool,
    /// `OPEN BINARY ROTARY` is refused, as by a board that does not know it.
    pub no_binary_rotary: bool,
    /// `J/` is refused.
    pub jog_stop_refused: bool,
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
    /// `CLOSE` of a Turbo board closes nothing, as where each port closes its own; `CLOSE ALL` does.
    pub close_ignored: bool,
    /// Without its page the DPRAM shows another one, which the host reads and writes as memory.
    pub other_page: bool,
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
            Place::Count { place, on } => count(on).map(|count| *place(self) = count),
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

/// Where a fault stands in [`Faults`], and so which values it takes.
#[derive(Clone, Copy)]
enum Place {
    Switch(fn(&mut Faults) -> &mut bool),
    /// So many times; `on` is so many.
    Count {
        place: fn(&mut Faults) -> &mut u64,
        on: u64,
    },
    /// So many cycles, or milliseconds.
    Cycles(fn(&mut Faults) -> &mut u64),
    /// A number in place of the true one.
    Instead(fn(&mut Faults) -> &mut Option<u16>),
}

/// A fault that can be set by its name.
pub struct Fault {
    /// The name.
    pub name: &'static str,
    /// What goes wrong.
    pub effect: &'static str,
    place: Place,
}

impl Fault {
    /// The values it takes, in words.
    #[must_use]
    pub const fn values(&self) -> &'static str {
        match self.place {
            Place::Switch(_) => "on or off",
            Place::Count { .. } => "on, off or a number",
            Place::Cycles(_) => "on, off, a number of cycles or Nms",
            Place::Instead(_) => "off or a number",
        }
    }
}

/// Every fault.
pub fn faults() -> impl Iterator<Item = &'static Fault> {
    FAULTS.iter().copied().flatten()
}

const fn switch(name: &'static str, effect: &'static str, place: fn(&mut Faults) -> &mut bool) -> Fault {
    Fault { name, effect, place: Place::Switch(place) }
}

const fn count(
    name: &'static str,
    effect: &'static str,
    on: u64,
    place: fn(&mut Faults) -> &mut u64,
) -> Fault {
    Fault { name, effect, place: Place::Count { place, on } }
}

/// The three faults of a function that works by a flag in the background pass.
macro_rules! function {
    ($function:ident, $title:literal, $torn:literal) => {
        &[
            switch(concat!(stringify!($function), "_stuck"), concat!($title, " does nothing"), |faults| {
                &mut faults.$function.stuck
            }),
            count(
                concat!(stringify!($function), "_late"),
                concat!($title, " acts so many background passes late"),
                u64::MAX,
                |faults| &mut faults.$function.late,
            ),
            switch(concat!(stringify!($function), "_torn"), $torn, |faults| &mut faults.$function.torn),
        ]
    };
}

static FAULTS: &[&[Fault]] = &[
    &[
        switch(
            "servo_busy_stuck",
            "PMAC-Busy of the servo report stays set, and nothing more is written",
            |f| &mut f.servo_busy_stuck,
        ),
        switch("servo_silent", "the servo report stands still", |f| &mut f.servo_silent),
        switch("background_stuck", "the background report stands still", |f| &mut f.background_stuck),
        switch("ascii_deaf", "lines and control characters in the DPRAM are not taken", |f| {
            &mut f.ascii_deaf
        }),
        switch("ascii_no_reply", "lines are taken and executed, but no response comes", |f| {
            &mut f.ascii_no_reply
        }),
        Fault {
            name: "ascii_slow",
            effect: "each line takes so long",
            place: Place::Cycles(|f| &mut f.ascii_slow),
        },
        Fault {
            name: "ascii_late_ack",
            effect: "the closing <ACK> comes so late",
            place: Place::Cycles(|f| &mut f.ascii_late_ack),
        },
        Fault {
            name: "ascii_slow_lines",
            effect: "each line of a reply comes so late",
            place: Place::Cycles(|f| &mut f.ascii_slow_lines),
        },
        Fault {
            name: "ascii_late_cancel",
            effect: "^X clears the words of the port so late, with whatever the host has put there by then",
            place: Place::Cycles(|f| &mut f.ascii_late_cancel),
        },
        switch("ascii_no_size", "SIZE is answered with an error", |f| &mut f.ascii_no_size),
        switch("no_binary_rotary", "OPEN BINARY ROTARY is answered with an error", |f| {
            &mut f.no_binary_rotary
        }),
        switch("jog_stop_refused", "J/ is answered with an error", |f| &mut f.jog_stop_refused),
        switch("ascii_torn", "a response's control word comes before the second half of its text", |f| {
            &mut f.ascii_torn
        }),
        switch("ascii_repeat", "every response comes twice", |f| &mut f.ascii_repeat),
        Fault {
            name: "ascii_count",
            effect: "the character count of a response says this number",
            place: Place::Instead(|f| &mut f.ascii_count),
        },
        count("lost_interrupt", "so many interrupts are not raised", u64::MAX, |f| &mut f.lost_interrupts),
        count("spurious_interrupt", "so many interrupts come with nothing behind them", 1, |f| {
            &mut f.spurious_interrupts
        }),
        switch(
            "close_ignored",
            "CLOSE of a Turbo board is acknowledged and closes nothing; CLOSE ALL does",
            |f| &mut f.close_ignored,
        ),
        switch("all_ones", "every word of the DPRAM reads all ones", |f| &mut f.all_ones),
        switch("all_zeros", "every word of the DPRAM reads zero", |f| &mut f.all_zeros),
        switch("other_page", "while its page is not selected, the DPRAM shows another one", |f| {
            &mut f.other_page
        }),
        switch(
            "host_port_stuck",
            "the interrupt controller takes no end of interrupt and no clearing",
            |f| &mut f.host_port_stuck,
        ),
    ],
    function!(
        panel,
        "the control panel",
        "the panel's mask is cleared before the second half of the requests is acted on"
    ),
    function!(
        variable_read,
        "the background variable read",
        "variables are ready before the second half of the data is there"
    ),
    function!(
        variable_write,
        "the background variable write",
        "the count is cleared before the second half of the records is written"
    ),
    function!(
        rotary,
        "the binary rotary transfer",
        "PMAC's rotary index stops in the middle of a line for a pass"
    ),
    function!(
        mailbox,
        "the mailbox port",
        "the response's interrupt comes before the second half of its characters"
    ),
];

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
