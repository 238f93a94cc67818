//! The board: its memory, variables and motors, and the work of the servo interrupt and the background loop on them.
//!
//! The board knows no function of the DPRAM, no program and no command language: those build on the board and change
//! it. [`crate::sim::world`] runs them in order in each cycle.
//!
//! | file | idea |
//! |---|---|
//! | [`memory`], [`dpram`], [`register_table`] | X and Y memory, the part shared with the host; where registers lie |
//! | [`families`], [`firmware`], [`turbo`], [`settings`], [`status_bits`] | the differences between families |
//! | [`i_rows`], `turbo_rows` | factory values |
//! | [`identity`], [`processor`], [`calendar`] | the board's answers about itself; date and time |
//! | [`variables`], [`m_definition`], [`number`], [`password`], `access` | I-, P-, Q- and M-variables |
//! | [`motor`], [`profile`], `compensation` | servo loop, drive and shaft; jog and home moves; leadscrew and backlash |
//! | `absolute_sensor` | the position at power-on and `$*` |
//! | [`coordinate`], `timers`, [`axes`], `axis_position` | time base; countdown timers; axis definitions; positions of axes |
//! | [`jog`], `coordinate_commands` | effects of commands |
//! | `registers`, `written` | registers and status words; registers that a program or a host writes |
//! | [`gather`], [`output`], [`bus_setup`] | data gathering; text that waits at the ports; set-up that SAVE keeps |

mod absolute_sensor;
mod access;
pub mod axes;
mod axis_position;
pub mod bus_setup;
pub mod calendar;
mod compensation;
pub mod coordinate;
mod coordinate_commands;
pub mod dpram;
pub mod error;
pub mod families;
pub mod firmware;
pub mod gather;
pub mod i_rows;
pub mod identity;
pub mod jog;
pub mod m_definition;
pub mod macro_stations;
pub mod memory;
pub mod motor;
pub mod number;
pub mod output;
pub mod password;
pub mod processor;
pub mod profile;
pub mod random;
pub mod register_table;
mod registers;
pub mod settings;
pub mod status_bits;
mod timers;
pub mod turbo;
mod turbo_rows;
pub mod variables;
mod written;

use crate::map::functions::rotary_header;
use crate::map::{Family, Firmware, IVariables};
use crate::sim::fault::Faults;
use crate::sim::judge::Judge;

use axes::AxisDefinitions;
use bus_setup::{BusSetup, Found};
use calendar::Clock;
use coordinate::CoordinateSystem;
use gather::Gather;
use identity::Identity;
use macro_stations::MacroStations;
use memory::Memory;
use motor::{Events, Inputs, Motor};
use output::{Output, Port};
use random::Random;
use variables::{SavedVariables, Variables};

/// Counts since the simulator started.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Statistics {
    /// Servo cycles.
    pub servo_cycles: u64,
    /// Servo cycles that came too late in real time and were skipped.
    pub late: u64,
    /// Background reports.
    pub background_updates: u64,
    /// Board resets, without the power-on.
    pub resets: u64,
}

/// The board's own values that a reset restores.
struct Saved {
    variables: SavedVariables,
    axes: AxisDefinitions,
    bus_setup: BusSetup,
    /// The bus set-up registers have a VME board's factory values.
    vme: bool,
}

impl Saved {
    fn factory(variables: &Variables, memory: &Memory, vme: bool) -> Self {
        Self {
            variables: variables.snapshot(memory),
            axes: AxisDefinitions::default(),
            bus_setup: BusSetup::factory(vme),
            vme,
        }
    }
}

/// Memory, variables, motors and coordinate systems, and the work of the servo interrupt and the background loop on
/// them.
pub struct Board {
    /// X, Y and DPRAM.
    pub memory: Memory,
    /// I-variables and definitions.
    pub variables: Variables,
    /// The MACRO stations.
    pub stations: MacroStations,
    /// Axis definitions.
    pub axes: AxisDefinitions,
    /// The faults in force.
    pub faults: Faults,
    /// Breaches of the handshakes by hosts.
    pub judge: Judge,
    /// Counts since the simulator started.
    pub stats: Statistics,
    /// Text that waits at the board's ports.
    pub output: Output,
    /// Number that stands for coordinate system 1 in a binary rotary header: 0 or 1.
    pub rotary_cs_base: u16,
    /// The watchdog has tripped: the board does nothing until a reset.
    pub watchdog: bool,
    /// The host cannot reach the DPRAM: a fault hides it, or the host has not written its page.
    pub out_of_reach: bool,
    /// Ports and interrupts that the host finds with the bus set-up in force.
    pub found: Found,
    /// Factor on the time that a command takes on a real board; 0: commands take no time.
    pub slow: f64,
    /// Date and time.
    pub clock: Clock,
    /// Cases in which the simulator does less for a program or a host than either may expect, each case once.
    pub notes: Vec<String>,
    /// The servo cycle of the last reset.
    reset_at: u64,
    /// Servo cycles for which a command still occupies the background loop.
    taken_up: u64,
    /// I10 of the servo rate that the user asked for; `None`: the clock follows the variable I10.
    pub fixed_i10: Option<f64>,
    /// The kind of board.
    pub identity: Identity,
    /// The motors.
    pub motors: Vec<Motor>,
    /// Data gathering and the servo report's start and stop.
    pub gather: Gather,
    coordinates: Vec<CoordinateSystem>,
    port: Port,
    saved: Saved,
    noise: Option<Random>,
}

impl Board {
    /// A board at factory defaults, just powered up. `seed` adds encoder noise of half a count.
    #[must_use]
    pub fn new(memory: Memory, identity: Identity, fixed_i10: Option<f64>, seed: Option<u64>) -> Self {
        let family = identity.tables.family;
        let variables = factory(&identity, fixed_i10);
        let mut board = Self {
            saved: Saved::factory(&variables, &memory, false),
            memory,
            variables,
            stations: MacroStations::default(),
            axes: AxisDefinitions::default(),
            faults: Faults::default(),
            judge: Judge::new(family),
            stats: Statistics::default(),
            output: Output::default(),
            rotary_cs_base: 1,
            watchdog: false,
            out_of_reach: false,
            found: Found { dpram: true, mailboxes: true, interrupts: true },
            slow: 0.0,
            clock: Clock::default(),
            notes: Vec::new(),
            reset_at: 0,
            taken_up: 0,
            fixed_i10,
            motors: vec![Motor::new(); identity.motors.clamp(1, family.motors)],
            coordinates: vec![CoordinateSystem::default(); family.coordinate_systems],
            gather: Gather::new(&identity),
            port: Port::Serial,
            identity,
            noise: seed.map(Random::new),
        };
        board.power_on();
        board
    }

    /// Whether the board is a VME board.
    #[must_use]
    pub fn is_vme(&self) -> bool {
        self.saved.vme
    }

    /// Makes the board a VME board: its bus set-up registers have a VME board's factory values.
    pub fn fit_vme(&mut self) {
        self.saved.vme = true;
        self.saved.bus_setup = BusSetup::factory(true);
        self.saved.bus_setup.put(&mut self.memory, &self.variables);
        self.found = Found::with(&self.memory, true);
    }

    /// Resets the board to the saved (or factory) values, everything else as at power-up. [`Statistics::resets`] shows
    /// the owners of programs, functions and interpreter that those must be reset, too.
    ///
    /// A reset to factory values leaves the values of the last `SAVE` stored: the next reset restores them (Turbo User
    /// Manual p. 243, User Manual p. 36).
    pub fn reset(&mut self, factory_values: bool) {
        let kept = factory_values.then(|| {
            self.memory.clear();
            let variables = factory(&self.identity, self.fixed_i10);
            let factory = Saved::factory(&variables, &self.memory, self.saved.vme);
            std::mem::replace(&mut self.saved, factory)
        });
        self.variables.restore(&self.saved.variables, &mut self.memory);
        self.axes = self.saved.axes.clone();
        self.stats.resets += 1;
        self.power_on();
        if let Some(kept) = kept {
            self.saved = kept;
        }
    }

    /// A command occupies the background loop for `ms` milliseconds on a real board.
    pub fn take_time(&mut self, ms: f64) {
        self.taken_up = (ms * self.slow / self.cycle_ms()) as u64;
    }

    /// Whether a command occupies the background loop.
    #[must_use]
    pub fn is_at_work(&self) -> bool {
        self.taken_up > 0
    }

    /// Takes one servo cycle off the time for which a command occupies the background loop.
    pub fn work(&mut self) {
        self.taken_up = self.taken_up.saturating_sub(1);
    }

    /// Saves the present values for the next reset.
    pub fn save(&mut self) {
        self.saved = Saved {
            variables: self.variables.snapshot(&self.memory),
            axes: self.axes.clone(),
            bus_setup: BusSetup::of(&self.memory),
            vme: self.saved.vme,
        };
    }

    fn power_on(&mut self) {
        self.memory.clear_registers();
        self.saved.bus_setup.put(&mut self.memory, &self.variables);
        self.found = Found::with(&self.memory, self.saved.vme);
        let Family { base, length, .. } = *self.family();
        if let Some(dpram_end) = self.memory.registers().dpram_end {
            self.memory.write(dpram_end, base + length / 4);
        }
        let Family { servo, background, ascii, panel, variable_write, rotary, .. } = self.family();
        for word in [
            servo.pmac_status.word,
            background.ready.word,
            background.timer.low,
            ascii.command_loaded.word,
            ascii.control_character,
            ascii.response_control,
            ascii.response_count,
            variable_write.count,
        ]
        .into_iter()
        .chain(panel.iter().map(|panel| panel.request_enable))
        .chain(rotary.headers.iter().map(|header| header.plus_words(rotary_header::STATUS)))
        {
            self.memory.dpram.write16(word, 0);
        }
        self.watchdog = false;
        self.clock = Clock::default();
        self.reset_at = self.stats.servo_cycles;
        self.output.cancel();
        self.gather = Gather::new(&self.identity);
        self.port = Port::Serial;
        for (index, coordinate) in self.coordinates.iter_mut().enumerate() {
            coordinate.reset(index, &self.variables, &mut self.memory);
        }
        for motor in 0..self.motors.len() {
            self.motors[motor].reset();
            self.power_on_motor(motor);
            self.write_servo_registers(motor);
        }
    }

    /// The begin of a servo interrupt: counts it and moves the time base of each coordinate system on.
    pub fn begin_servo_cycle(&mut self) {
        self.stats.servo_cycles += 1;
        let counter = self.memory.registers().servo_counter;
        let count = self.memory.read(counter).wrapping_add(1);
        self.memory.write(counter, count);
        self.count_down();
        for (index, coordinate) in self.coordinates.iter_mut().enumerate() {
            coordinate.cycle(index, &self.variables, &mut self.memory);
        }
    }

    /// The time base of the 0-based coordinate system `cs` in this servo cycle, 1.0 for 100%.
    #[must_use]
    pub fn time_base(&self, cs: usize) -> f64 {
        self.coordinates.get(cs).map_or(1.0, CoordinateSystem::factor)
    }

    /// Whether the 0-based coordinate system `cs` is in a feed hold.
    #[must_use]
    pub fn is_held(&self, cs: usize) -> bool {
        self.coordinates.get(cs).is_some_and(CoordinateSystem::is_held)
    }

    /// How many coordinate systems the board has.
    #[must_use]
    pub fn coordinate_systems(&self) -> usize {
        self.coordinates.len()
    }

    /// The board's family.
    #[must_use]
    pub fn family(&self) -> &'static Family {
        self.identity.tables.family
    }

    /// Whether the board's firmware came before `version`.
    #[must_use]
    pub fn is_older_than(&self, version: &str) -> bool {
        let number = |text: &str| text.parse::<Firmware>().ok();
        number(&self.identity.firmware).zip(number(version)).is_some_and(|(own, version)| own < version)
    }

    /// The servo counter, 24 bits.
    #[must_use]
    pub fn servo_counter(&self) -> u32 {
        self.memory.read(self.memory.registers().servo_counter)
    }

    /// The servo loop of the 0-based `motor`, at `time_base` of its coordinate system.
    pub fn servo_loop(&mut self, motor: usize, time_base: f64) -> Events {
        let ms = self.cycle_ms();
        self.motors[motor].capture = self.capture(motor);
        let noise = self.noise.as_mut().map_or(0.0, |noise| noise.unit() / 2.0);
        self.motors[motor].cycle(IVariables::motor(motor + 1, 0), &self.variables, ms, time_base, noise)
    }

    /// Stores a sample of gathered data when one is due.
    pub fn gather_cycle(&mut self) {
        self.gather.cycle(&self.variables, &mut self.memory);
    }

    /// The port for responses that no command asked for: the port of the last command, but the serial port instead of
    /// the DPRAM while DPRAM ASCII is off.
    #[must_use]
    pub fn response_port(&self) -> Port {
        match self.port {
            Port::Dpram if !self.takes_ascii() => Port::Serial,
            port => port,
        }
    }

    /// Whether I58 (in this family's numbers) enables DPRAM ASCII.
    #[must_use]
    pub fn takes_ascii(&self) -> bool {
        self.enabled(self.family().i.ascii_enable) && self.uses_dpram()
    }

    /// Whether the functions use this DPRAM: I24 of a Turbo board names the DPRAM that serves all of them (Turbo User
    /// Manual p. 45).
    #[must_use]
    pub fn uses_dpram(&self) -> bool {
        let base = self.settings().dpram_base;
        base.is_none_or(|number| self.variables.i_integer(number) == i64::from(self.family().base))
    }

    /// Whether the I-variable that enables a function of the DPRAM is 1.
    #[must_use]
    pub fn enabled(&self, number: u16) -> bool {
        self.variables.i(number.into()) == 1.0
    }

    /// A command came through the mailboxes.
    pub fn mailbox_becomes_active(&mut self) {
        self.port = Port::Mailbox;
    }

    /// A command came through the DPRAM.
    pub fn dpram_becomes_active(&mut self) {
        self.port = Port::Dpram;
    }

    /// Seconds since the last reset.
    #[must_use]
    pub fn seconds_up(&self) -> u64 {
        ((self.stats.servo_cycles - self.reset_at) as f64 * self.cycle_ms() / 1000.0) as u64
    }

    /// Milliseconds from one servo interrupt to the next.
    #[must_use]
    pub fn cycle_ms(&self) -> f64 {
        let i10 = self.fixed_i10.unwrap_or_else(|| self.variables.i(10));
        // I10=0 would stop the clock; the board's own default is the least surprising stand-in.
        (if i10 > 0.0 { i10 } else { self.family().default_i10.into() }) / 8_388_608.0
    }

    /// The world around 0-based `motor`: limit switches, trigger, a held shaft. `None` when the board has no such
    /// motor.
    pub fn inputs(&mut self, motor: usize) -> Option<&mut Inputs> {
        self.motors.get_mut(motor).map(|motor| &mut motor.inputs)
    }

    fn power_on_motor(&mut self, motor: usize) {
        if !self.active(motor) {
            return;
        }
        let mode = self.ix(motor, 80) as u32;
        if self.ix(motor, 10) != 0.0 && mode & 4 == 0 {
            let position = self.sensed_position(motor);
            self.motors[motor].absolute(position);
        }
        if mode & 1 == 1 {
            self.motors[motor].close_loop();
        }
    }

    /// Motor I-variable `Ixn` of the 0-based `motor`.
    pub fn ix(&self, motor: usize, n: usize) -> f64 {
        self.variables.i(IVariables::motor(motor + 1, n))
    }

    /// Whether 0-based `motor` exists and is activated.
    pub fn active(&self, motor: usize) -> bool {
        motor < self.motors.len() && self.ix(motor, 0) == 1.0
    }
}

fn factory(identity: &Identity, fixed_i10: Option<f64>) -> Variables {
    let mut variables = Variables::new(identity.tables);
    if let Some(i10) = fixed_i10 {
        // I10 holds 0 to 8388607 (Software Reference, I10), not quite a millisecond: I10 cannot express a slower cycle.
        variables.set_i(10, i10.min(8_388_607.0));
    }
    variables
}
