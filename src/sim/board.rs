//! The board: its memory, variables and motors, the servo interrupt and the background loop.
//!
//! Servo interrupt, once a cycle: count, time bases, motors, gathering, servo report. Background, after each cycle:
//! status words, background report, DPRAM ASCII (with the interpreter, see [`super::world::World`]), the judge. The commands that
//! the language calls are in `commands.rs`, the registers and status words in `registers.rs`.

use super::coordinate::CoordinateSystem;
use super::dpram::{Dpram, DpramError};
use super::fault::Faults;
use super::functions::Functions;
use super::gather::Gather;
use super::judge::Judge;
use super::language::variables::SavedVariables;
use super::language::{AxisDefinitions, Family, Variables};
use super::mailbox::Mailbox;
use super::motor::{Events, Loop, Motor};
use super::program::Programs;
use super::program::store::Store;
use super::random::Random;
use super::servo_report::ServoReport;
use super::set_up::SetUp;
use super::{background_report, offsets};

pub use super::ascii::AsciiPort;
pub use super::commands::Jog;
pub use super::identity::Identity;
pub use super::memory::Memory;

/// Motors and coordinate systems of a classic board.
pub const MOTORS: usize = 8;

/// The port that responses not asked for go to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Port {
    /// The serial port.
    Serial,
    /// The DPRAM.
    Dpram,
    /// The VME mailboxes.
    Mailbox,
}

/// What was counted since the simulator started.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Statistics {
    /// Servo cycles.
    pub servo_cycles: u64,
    /// Servo cycles that came too late in real time and were skipped.
    pub late: u64,
    /// Background reports.
    pub background_updates: u64,
    /// Board resets, the one at power-on not counted.
    pub resets: u64,
}

/// What a reset brings back.
struct Saved {
    variables: SavedVariables,
    axes: AxisDefinitions,
    store: Store,
    set_up: SetUp,
    /// Whose factory values the set-up registers have.
    vme: bool,
}

impl Saved {
    fn factory(variables: &Variables, memory: &Memory, vme: bool) -> Self {
        Self {
            variables: variables.snapshot(memory),
            axes: AxisDefinitions::default(),
            store: Store::default(),
            set_up: SetUp::factory(vme),
            vme,
        }
    }
}

/// The board without its command interpreter.
pub struct Board {
    /// X, Y and DPRAM.
    pub memory: Memory,
    /// I-variables and definitions.
    pub variables: Variables,
    /// Axis definitions.
    pub axes: AxisDefinitions,
    /// The faults in force.
    pub faults: Faults,
    /// What hosts did wrong.
    pub judge: Judge,
    /// What was counted.
    pub stats: Statistics,
    /// The servo report.
    pub report: ServoReport,
    /// The DPRAM ASCII port.
    pub ascii: AsciiPort,
    /// Program buffers and what runs out of them.
    pub programs: Programs,
    /// What the board has to say on the serial port without being asked; whoever serves the port takes it away.
    pub serial_output: Vec<u8>,
    /// The functions that work by flags in the background pass.
    pub functions: Functions,
    /// The VME mailbox port, on a board that has one.
    pub mailbox: Option<Mailbox>,
    /// Number that stands for coordinate system 1 in a binary rotary header: 0 or 1.
    pub rotary_cs_base: u16,
    /// The watchdog has tripped: the board does nothing until a reset.
    pub watchdog: bool,
    /// What fixes the servo clock when a rate was asked for: I10 of it.
    pub fixed_i10: Option<f64>,
    pub(super) identity: Identity,
    pub(super) motors: Vec<Motor>,
    pub(super) coordinates: Vec<CoordinateSystem>,
    pub(super) gather: Gather,
    pub(super) port: Port,
    saved: Saved,
    noise: Option<Random>,
    /// What the memory held before it went out of reach ([`Faults::all_ones`], [`Faults::all_zeros`], its page).
    out_of_reach: Option<Vec<u16>>,
}

impl Board {
    /// A board at factory defaults, just powered up. `seed` adds encoder noise of half a count.
    #[must_use]
    pub fn new(memory: Memory, identity: Identity, fixed_i10: Option<f64>, seed: Option<u64>) -> Self {
        let variables = factory(&identity, fixed_i10);
        let mut board = Self {
            saved: Saved::factory(&variables, &memory, false),
            programs: Programs::default(),
            serial_output: Vec::new(),
            memory,
            variables,
            axes: AxisDefinitions::default(),
            faults: Faults::default(),
            judge: Judge::default(),
            stats: Statistics::default(),
            report: ServoReport::default(),
            ascii: AsciiPort::default(),
            functions: Functions::default(),
            mailbox: None,
            rotary_cs_base: 1,
            watchdog: false,
            fixed_i10,
            motors: vec![Motor::new(); identity.motors.clamp(1, MOTORS)],
            coordinates: vec![CoordinateSystem::default(); MOTORS],
            gather: Gather::new(&identity.firmware),
            port: Port::Serial,
            identity,
            noise: seed.map(Random::new),
            out_of_reach: None,
        };
        board.power_on();
        board
    }

    /// A board of `family` with firmware 1.16D and memory of its own, that no host can reach but by commands.
    ///
    /// # Errors
    /// [`DpramError`] when the system gives no memory.
    pub fn alone(family: &'static Family) -> Result<Self, DpramError> {
        Ok(Self::new(Memory::new(Dpram::private()?), Identity::new(family, "1.16D"), None, None))
    }

    /// The port that responses not asked for go to: the one the last command came through, while I58=1 lets the DPRAM be
    /// one.
    #[must_use]
    pub fn response_port(&self) -> Port {
        match self.port {
            Port::Dpram if self.variables.i(58) != 1.0 => Port::Serial,
            port => port,
        }
    }

    /// A command came through the mailboxes.
    pub(super) fn mailbox_becomes_active(&mut self) {
        self.port = Port::Mailbox;
    }

    /// Whether the interrupt line of the DPRAM's responses is asserted: I56=1, and the host has not taken the last one.
    #[must_use]
    pub fn response_waits(&self) -> bool {
        self.variables.i(56) == 1.0
            && self.out_of_reach.is_none()
            && self.memory.dpram.read16(offsets::ASCII_IN_CONTROL) != 0
    }

    /// A command came through the DPRAM.
    pub(super) fn dpram_becomes_active(&mut self) {
        self.port = Port::Dpram;
    }

    /// Milliseconds from one servo interrupt to the next.
    #[must_use]
    pub fn cycle_ms(&self) -> f64 {
        let i10 = self.fixed_i10.unwrap_or_else(|| self.variables.i(10));
        // I10=0 would stop the clock; the board's own default is the least surprising stand-in.
        (if i10 > 0.0 { i10 } else { 3_713_707.0 }) / 8_388_608.0
    }

    /// The world around 0-based `motor`: limit switches, trigger, a held shaft. `None` when there is no such motor.
    pub fn inputs(&mut self, motor: usize) -> Option<&mut super::motor::Inputs> {
        self.motors.get_mut(motor).map(|motor| &mut motor.inputs)
    }

    /// One servo interrupt.
    pub fn servo_cycle(&mut self) {
        self.stats.servo_cycles += 1;
        let count = self.memory.read_x(offsets::SERVO_COUNTER).wrapping_add(1);
        self.memory.write_x(offsets::SERVO_COUNTER, count);
        let mut time_base = [1.0; MOTORS];
        for (index, coordinate) in self.coordinates.iter_mut().enumerate() {
            time_base[index] = coordinate.cycle(index, &self.variables, &mut self.memory);
        }
        let ms = self.cycle_ms();
        self.programs_cycle(ms, &time_base);
        for motor in 0..self.motors.len() {
            if !self.active(motor) {
                continue;
            }
            let factor = self.axes.coordinate_system(motor).map_or(1.0, |cs| time_base[cs]);
            self.compensate(motor);
            let noise = self.noise.as_mut().map_or(0.0, |noise| noise.unit() / 2.0);
            let events = self.motors[motor].cycle(100 * (motor + 1), &self.variables, ms, factor, noise);
            if events != Events::default() {
                self.on_events(motor, events);
            }
            self.write_servo_registers(motor);
        }
        self.gather.cycle(&self.variables, &mut self.memory);
        if self.out_of_reach.is_none() {
            self.report.cycle(&self.variables, &self.gather, &self.faults, &mut self.memory);
        }
    }

    /// The housekeeping part of a background pass, without the command ports.
    pub fn housekeeping(&mut self) {
        for motor in 0..self.motors.len() {
            self.scan_in_position(motor);
            self.average_velocity(motor);
            self.take_up_backlash(motor);
            self.write_background_registers(motor);
        }
        for cs in 0..MOTORS {
            self.write_coordinate_registers(cs);
        }
        self.serve_requests();
        self.background_plcs();
        self.write_global_status();
        if self.out_of_reach.is_some() {
            return;
        }
        if background_report::pass(&self.variables, &self.faults, &self.programs.report, &mut self.memory) {
            self.stats.background_updates += 1;
        }
        self.judge.pass(self.stats.servo_cycles, &mut self.memory.dpram);
    }

    /// Puts all ones (or zeros) into the whole DPRAM while it is out of reach, by that fault or for want of its page, and
    /// the old content back after it. Says whether it is out of reach.
    ///
    /// Without its page the DPRAM stands still: PMAC's own commands into it count, its functions rest.
    pub(super) fn is_out_of_reach(&mut self) -> bool {
        let reachable = self.mailbox.as_ref().is_none_or(Mailbox::reaches_dpram);
        let dpram = &mut self.memory.dpram;
        let words = (0..offsets::LENGTH as u16).step_by(2);
        if self.faults.hides_memory() || !reachable {
            let reads = if self.faults.all_zeros { 0 } else { 0xFFFF };
            let fresh = self.out_of_reach.is_none();
            let before = self
                .out_of_reach
                .get_or_insert_with(|| words.clone().map(|offset| dpram.read16(offset)).collect());
            for (offset, before) in words.zip(before) {
                let found = dpram.read16(offset);
                if !fresh && found != reads && found == dpram.shadow(offset) {
                    *before = found;
                }
                if found != reads {
                    dpram.disturb(offset, reads);
                }
            }
            return true;
        }
        if let Some(before) = self.out_of_reach.take() {
            let status = offsets::SERVO_PMAC_STATUS;
            let hidden = dpram.read16(status);
            for (offset, value) in words.zip(&before).filter(|(offset, _)| *offset != status) {
                dpram.disturb(offset, *value);
            }
            // The board did not stand still meanwhile: the status word of before is not to be seen again beside the old data.
            self.report.cycle(&self.variables, &self.gather, &self.faults, &mut self.memory);
            if self.memory.dpram.read16(status) == hidden {
                self.memory.dpram.disturb(status, before[usize::from(status / 2)]);
            }
        }
        false
    }

    fn on_events(&mut self, motor: usize, events: Events) {
        if events.homed {
            self.home_bias(motor);
        }
        if !events.limit && !events.fatal {
            return;
        }
        let cs = self.axes.coordinate_system(motor);
        if let Some(cs) = cs {
            self.end_program(cs);
        }
        // Ix25 bits 21-22: what a fatal error kills besides the motor itself: 0 all, 1 its coordinate system.
        let scope = self.ix(motor, 25) as u32 >> 21 & 3;
        for other in (0..self.motors.len()).filter(|&other| other != motor) {
            let same = cs.is_some() && self.axes.coordinate_system(other) == cs;
            if events.fatal && (scope == 0 || scope == 1 && same) {
                self.motors[other].open(Loop::Killed);
            } else if same && self.motors[other].moving() {
                let rate = self.ix(other, 15);
                self.motors[other].abort(rate);
            }
        }
    }

    /// Makes it a VME board, with these mailboxes and a VME board's set-up registers.
    pub(super) fn fit_mailbox(&mut self, mailbox: Option<Mailbox>) {
        self.mailbox = mailbox;
        self.saved.vme = self.mailbox.is_some();
        self.saved.set_up = SetUp::factory(self.saved.vme);
        self.saved.set_up.put(&mut self.memory);
    }

    /// Reloads the saved (or factory) values and starts anew.
    pub(super) fn restart(&mut self, factory_values: bool) {
        if factory_values {
            self.memory.clear();
            let variables = factory(&self.identity, self.fixed_i10);
            self.saved = Saved::factory(&variables, &self.memory, self.saved.vme);
        }
        self.variables.restore(&self.saved.variables, &mut self.memory);
        self.axes = self.saved.axes.clone();
        self.programs = Programs::new(self.saved.store.clone());
        self.stats.resets += 1;
        self.power_on();
    }

    /// Keeps the present values for the next reset.
    pub fn save(&mut self) {
        let store = self.programs.store.kept();
        self.saved = Saved {
            variables: self.variables.snapshot(&self.memory),
            axes: self.axes.clone(),
            store,
            set_up: SetUp::of(&self.memory),
            vme: self.saved.vme,
        };
    }

    fn power_on(&mut self) {
        self.memory.clear_registers();
        self.saved.set_up.put(&mut self.memory);
        for word in [
            offsets::PANEL_ENABLE,
            offsets::SERVO_PMAC_STATUS,
            offsets::BACKGROUND_READY,
            offsets::BACKGROUND_TIMER,
            offsets::ASCII_OUT_CONTROL,
            offsets::ASCII_OUT_CHARACTER,
            offsets::ASCII_IN_CONTROL,
            offsets::ASCII_IN_COUNT,
            offsets::VARIABLE_WRITE_COUNT,
        ] {
            self.memory.dpram.write16(word, 0);
        }
        for header in offsets::ROTARY {
            self.memory.dpram.write16(header, 0);
        }
        self.watchdog = false;
        if let Some(mailbox) = &mut self.mailbox {
            mailbox.reset();
        }
        self.functions = Functions::default();
        self.ascii.clear();
        self.report.reset();
        self.gather = Gather::new(&self.identity.firmware);
        self.port = Port::Serial;
        for (index, coordinate) in self.coordinates.iter_mut().enumerate() {
            coordinate.reset(index, &self.variables, &mut self.memory);
        }
        for motor in 0..self.motors.len() {
            self.motors[motor].reset();
            self.power_on_motor(motor);
            self.write_servo_registers(motor);
        }
        for cs in 0..MOTORS {
            // Ix91: the program to point to at power-up.
            let _ = self.begin(cs, self.variables.i(100 * (cs + 1) + 91));
        }
        self.housekeeping();
    }

    fn power_on_motor(&mut self, motor: usize) {
        if !self.active(motor) {
            return;
        }
        let mode = self.ix(motor, 80) as u32;
        if self.ix(motor, 10) != 0.0 && mode & 4 == 0 {
            let offset = self.ix(motor, 26) / 16.0;
            self.motors[motor].absolute(offset, true);
        }
        if mode & 1 == 1 {
            self.motors[motor].close_loop();
        }
    }

    /// Motor I-variable `Ixn` of the 0-based `motor`.
    pub(super) fn ix(&self, motor: usize, n: usize) -> f64 {
        self.variables.i(100 * (motor + 1) + n)
    }

    /// Whether 0-based `motor` exists and is activated.
    pub(super) fn active(&self, motor: usize) -> bool {
        motor < self.motors.len() && self.ix(motor, 0) == 1.0
    }
}

fn factory(identity: &Identity, fixed_i10: Option<f64>) -> Variables {
    let mut variables = Variables::new(identity.family);
    if let Some(i10) = fixed_i10 {
        variables.set_i(10, i10);
    }
    variables
}
