//! The board that the command language acts on: memory, variables, axis definitions, and the effects of commands.
//!
//! This one has registers but no motors that move: it keeps the last jog of each motor and reports what its registers
//! hold (Software Reference p. 399). It stands in for the machine with a servo clock.

use super::language::variables::{SavedVariables, force_dpram_handshake};
use super::language::{AxisDefinitions, CommandError, Family, Variables};
use crate::format::{fixed48, int24};

type Outcome = Result<(), CommandError>;

/// X and Y words; those of the DPRAM keep 16 bits.
#[derive(Debug)]
pub struct Memory {
    x: Vec<u32>,
    y: Vec<u32>,
}

impl Default for Memory {
    fn default() -> Self {
        Self { x: vec![0; 0x1_0000], y: vec![0; 0x1_0000] }
    }
}

impl Memory {
    /// The word at `X:address`.
    #[must_use]
    pub fn read_x(&self, address: u16) -> u32 {
        self.x[usize::from(address)]
    }

    /// The word at `Y:address`.
    #[must_use]
    pub fn read_y(&self, address: u16) -> u32 {
        self.y[usize::from(address)]
    }

    /// Writes `X:address`.
    pub fn write_x(&mut self, address: u16, value: u32) {
        self.x[usize::from(address)] = value & mask(address);
    }

    /// Writes `Y:address`.
    pub fn write_y(&mut self, address: u16, value: u32) {
        self.y[usize::from(address)] = value & mask(address);
    }
}

const fn mask(address: u16) -> u32 {
    if address >= 0xD000 && address <= 0xDFFF { 0xFFFF } else { int24::MASK }
}

/// A jog command. Positions and distances in counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Jog {
    /// `J+`
    Plus,
    /// `J-`
    Minus,
    /// `J/`
    Stop,
    /// `J=`
    PreJog,
    /// `J={c}`
    To(f64),
    /// `J=={c}`
    ToAsPreJog(f64),
    /// `J:{c}`
    ByCommanded(f64),
    /// `J^{c}`
    ByActual(f64),
    /// `J=*`
    ToVariable,
    /// `J:*`
    ByCommandedVariable,
    /// `J^*`
    ByActualVariable,
    /// `J!`
    RoundCommanded,
}

/// The board.
#[derive(Debug)]
pub struct Machine {
    /// X and Y words.
    pub memory: Memory,
    /// I-variables, M definitions.
    pub variables: Variables,
    /// Axis definitions.
    pub axes: AxisDefinitions,
    /// The last jog of each motor, and its distance after a trigger.
    pub jogs: Vec<Option<(Jog, Option<f64>)>>,
    overrides: Vec<f64>,
    gather: Option<u32>,
    saved: SavedVariables,
}

#[allow(missing_docs, clippy::missing_errors_doc, clippy::must_use_candidate)]
impl Machine {
    pub fn new(family: &'static Family) -> Self {
        let (variables, memory) = (Variables::new(family), Memory::default());
        Self {
            saved: variables.snapshot(&memory),
            memory,
            variables,
            axes: AxisDefinitions::default(),
            jogs: vec![None; family.motors],
            overrides: vec![100.0; family.coordinate_systems],
            gather: None,
        }
    }

    pub fn jog(&mut self, motor: usize, jog: Jog, until_trigger: Option<f64>) -> Outcome {
        self.jogs[motor] = Some((jog, until_trigger));
        Ok(())
    }

    pub fn home(&mut self, motor: usize) -> Outcome {
        self.jogs[motor] = None;
        Ok(())
    }

    pub fn home_zero(&mut self, motor: usize) -> Outcome {
        self.write_d(0x2B, motor, 0);
        Ok(())
    }

    pub fn kill(&mut self, motor: usize) -> Outcome {
        self.jogs[motor] = None;
        Ok(())
    }

    pub fn open_loop(&mut self, motor: usize, _percent: f64) -> Outcome {
        self.kill(motor)
    }

    pub fn reset_motor(&mut self, motor: usize) -> Outcome {
        self.jog(motor, Jog::Stop, None)
    }

    pub fn absolute_position(&mut self, motor: usize) -> Outcome {
        self.home_zero(motor)
    }

    fn write_d(&mut self, register: u16, motor: usize, value: i64) {
        let [y, x] = fixed48::encode(value);
        let address = register + 0x3C * motor as u16;
        self.memory.write_y(address, y);
        self.memory.write_x(address, x);
    }

    fn read_d(&self, address: u16) -> f64 {
        fixed48::decode(self.memory.read_y(address), self.memory.read_x(address)) as f64
    }

    pub fn position(&self, motor: usize) -> f64 {
        let servo = 0x3C * motor as u16;
        let background = 0xC0 * motor as u16;
        let sum = self.read_d(0x2B + servo) + self.read_d(0x813 + background) + self.read_d(0x46 + servo);
        sum / (self.variables.i(100 * (motor + 1) + 8) * 32.0)
    }

    pub fn velocity(&self, motor: usize) -> f64 {
        let raw = int24::signed(self.memory.read_x(0x33 + 0x3C * motor as u16));
        f64::from(raw) / (self.variables.i(100 * (motor + 1) + 9) * 32.0)
    }

    pub fn following_error(&self, motor: usize) -> f64 {
        let servo = 0x3C * motor as u16;
        (self.read_d(0x28 + servo) - self.read_d(0x2B + servo)) / 3072.0
    }

    pub fn motor_status(&self, motor: usize) -> [u32; 2] {
        [self.memory.read_x(0x3D + 0x3C * motor as u16), self.memory.read_y(0x814 + 0xC0 * motor as u16)]
    }

    pub fn coordinate_status(&self, cs: usize) -> [u32; 2] {
        [self.memory.read_x(0x818 + 0xC0 * cs as u16), self.memory.read_y(0x817 + 0xC0 * cs as u16)]
    }

    pub fn global_status(&self) -> [u32; 2] {
        [self.memory.read_x(3), self.memory.read_y(3)]
    }

    pub fn abort(&mut self, cs: usize) {
        self.quit(cs);
    }

    pub fn quit(&mut self, cs: usize) {
        let address = 0x818 + 0xC0 * cs as u16;
        self.memory.write_x(address, self.memory.read_x(address) & !1);
    }

    pub fn feed_hold(&mut self, _cs: usize) {}
    pub fn program_hold(&mut self, _cs: usize) {}
    pub fn stop_after_move(&mut self, _cs: usize) {}

    pub fn run(&mut self, _cs: usize) -> Outcome {
        Err(CommandError::NO_PROGRAM)
    }

    pub fn step(&mut self, _cs: usize) -> Outcome {
        Err(CommandError::NO_PROGRAM)
    }

    pub fn begin(&mut self, _cs: usize, _program: f64) -> Outcome {
        Err(CommandError::SYNTAX)
    }

    pub fn set_override(&mut self, cs: usize, percent: f64) {
        self.overrides[cs] = percent;
    }

    pub fn override_percent(&self, cs: usize) -> f64 {
        self.overrides[cs]
    }

    pub fn gather(&mut self) -> Outcome {
        self.gather.map(|_| ()).ok_or(CommandError::SYNTAX)
    }

    pub fn end_gather(&mut self) -> Outcome {
        Ok(())
    }

    pub fn define_gather(&mut self, longs: Option<u32>) -> Outcome {
        self.gather = Some(longs.unwrap_or(0));
        Ok(())
    }

    pub fn delete_gather(&mut self) -> Outcome {
        self.gather = None;
        Ok(())
    }

    pub fn zero_axes(&mut self, _cs: usize) -> Outcome {
        Ok(())
    }

    pub fn rename_axis(&mut self, _cs: usize, _axis: char, _position: f64) -> Outcome {
        Ok(())
    }

    pub fn i_assigned(&mut self, number: usize) {
        if number == 58 && self.variables.i(58) == 1.0 {
            force_dpram_handshake(&mut self.variables, "1.16D");
        }
    }

    pub fn free_memory(&self) -> i64 {
        41_301
    }

    pub fn save(&mut self) {
        self.saved = self.variables.snapshot(&self.memory);
    }

    pub fn reset(&mut self, factory: bool) {
        if factory {
            self.variables.reset_to_factory();
            self.memory = Memory::default();
        } else {
            self.variables.restore(&self.saved, &mut self.memory);
        }
    }

    pub fn firmware(&self) -> &str {
        "1.16D"
    }

    pub fn type_text(&self) -> &str {
        "PMAC1, VME, FLASH, PID, CLK X3"
    }

    pub fn date_text(&self) -> &str {
        "07/17/1999"
    }

    pub fn checksum(&self) -> u32 {
        0x12_3456
    }

    pub fn serial_becomes_active(&mut self) {
        self.variables.set_i(58, 0.0);
    }

    pub fn cancel_queues(&mut self) {}
    pub fn kill_all(&mut self) {}
    pub fn abort_all(&mut self) {}
    pub fn hold_all(&mut self) {}
    pub fn quit_all(&mut self) {}
    pub fn run_all(&mut self) {}
    pub fn step_all(&mut self) {}

    pub fn disable_plcs(&mut self) {
        self.variables.set_i(5, 0.0);
    }
}
