//! The command language's place (stand-in).

use super::machine::{Jog, Machine};

/// An error as PMAC numbers it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CommandError(pub u16);

impl CommandError {
    /// ERR001.
    pub const RUNNING: Self = Self(1);
    /// ERR003.
    pub const SYNTAX: Self = Self(3);
    /// ERR015.
    pub const NO_PROGRAM: Self = Self(15);
}

/// A family of boards.
#[derive(Debug)]
pub struct Family {
    /// Its name.
    pub name: &'static str,
}

/// Classic PMAC.
pub static PMAC: Family = Family { name: "pmac" };
/// Classic PMAC2.
pub static PMAC2: Family = Family { name: "pmac2" };

/// The I-variables.
#[derive(Debug, Clone)]
pub struct Variables {
    i: Vec<f64>,
}

impl Variables {
    /// Factory defaults.
    #[must_use]
    pub fn new(family: &'static Family) -> Self {
        let pmac2 = family.name == "pmac2";
        let mut i = vec![0.0; 1024];
        i[3] = 1.0;
        i[6] = 3.0;
        i[10] = if pmac2 { 3_713_991.0 } else { 3_713_707.0 };
        i[100] = 1.0;
        for n in 1..=8usize {
            let x = 100 * n;
            let all = [
                (3, 0x071F as f64 + n as f64),
                (5, 0x073F as f64),
                (7, 96.0),
                (8, 96.0),
                (9, 96.0),
                (11, 32000.0),
                (12, 16000.0),
                (15, 0.25),
                (16, 32.0),
                (19, 0.015625),
                (21, 50.0),
                (22, 32.0),
                (23, 32.0),
                (28, 160.0),
                (30, 2000.0),
                (34, 1.0),
                (69, 20480.0),
                (93, (0x0806 + 0xC0 * (n - 1)) as f64),
                (94, 1644.0),
                (95, 1644.0),
            ];
            for (k, value) in all {
                i[x + k] = value;
            }
        }
        Self { i }
    }

    /// I-variable `n`.
    #[must_use]
    pub fn i(&self, n: usize) -> f64 {
        self.i.get(n).copied().unwrap_or(0.0)
    }

    /// Sets I-variable `n`.
    pub fn set_i(&mut self, n: usize, value: f64) {
        if let Some(place) = self.i.get_mut(n) {
            *place = value;
        }
    }
}

/// Which motor belongs to which axis.
#[derive(Debug, Clone, Default)]
pub struct AxisDefinitions;

impl AxisDefinitions {
    /// The 0-based coordinate system of a motor.
    #[must_use]
    pub fn coordinate_system(&self, _motor: usize) -> Option<usize> {
        None
    }
}

/// What a line gave.
#[derive(Debug, Default)]
pub struct Reply {
    /// Lines of data.
    pub lines: Vec<String>,
    /// The error that ended the line.
    pub error: Option<CommandError>,
}

/// Understands a few commands.
#[derive(Debug, Default)]
pub struct Interpreter {
    motor: usize,
}

impl Interpreter {
    /// Executes one line.
    pub fn execute(&mut self, machine: &mut Machine, line: &[u8]) -> Reply {
        let mut reply = Reply::default();
        for word in String::from_utf8_lossy(line).to_ascii_uppercase().split_whitespace() {
            if let Err(error) = self.word(machine, word, &mut reply.lines) {
                reply.error = Some(error);
                break;
            }
        }
        reply
    }

    fn word(
        &mut self,
        machine: &mut Machine,
        word: &str,
        lines: &mut Vec<String>,
    ) -> Result<(), CommandError> {
        let mut rest = word;
        if let Some(tail) = rest.strip_prefix('#') {
            let digit = tail.chars().next().and_then(|c| c.to_digit(10)).ok_or(CommandError(3))?;
            self.motor = digit as usize - 1;
            rest = &tail[1..];
        }
        let number = |text: &str| text.parse::<f64>().map_err(|_| CommandError(3));
        match rest {
            "" => Ok(()),
            "J+" => machine.jog(self.motor, Jog::Plus, None),
            "J-" => machine.jog(self.motor, Jog::Minus, None),
            "J/" => machine.jog(self.motor, Jog::Stop, None),
            "K" => machine.kill(self.motor),
            "HM" => machine.home(self.motor),
            "HMZ" => machine.home_zero(self.motor),
            "VERSION" => {
                lines.push(machine.firmware().to_owned());
                Ok(())
            }
            "TYPE" => {
                lines.push(machine.type_text().to_owned());
                Ok(())
            }
            "P" => {
                lines.push(format!("{}", (machine.position(self.motor) * 10.0).round() / 10.0));
                Ok(())
            }
            "SAVE" => {
                machine.save();
                Ok(())
            }
            "GATHER" => machine.gather(),
            "ENDGATHER" => machine.end_gather(),
            "$$$" => {
                machine.reset(false);
                Ok(())
            }
            _ if rest.starts_with("J=") => machine.jog(self.motor, Jog::To(number(&rest[2..])?), None),
            _ if rest.starts_with('I') => match rest[1..].split_once('=') {
                None => {
                    let n: usize = rest[1..].parse().map_err(|_| CommandError(3))?;
                    lines.push(machine.variables.i(n).to_string());
                    Ok(())
                }
                Some((n, value)) => {
                    let n: usize = n.parse().map_err(|_| CommandError(3))?;
                    machine.variables.set_i(n, number(value)?);
                    machine.i_assigned(n);
                    Ok(())
                }
            },
            _ if rest.starts_with("GAT") => machine.define_gather(None),
            _ => Err(CommandError(3)),
        }
    }

    /// Acts on a control character.
    pub fn control(&mut self, machine: &mut Machine, character: u8) {
        match character {
            1 => machine.abort_all(),
            11 => machine.kill_all(),
            24 => machine.cancel_queues(),
            26 => machine.serial_becomes_active(),
            _ => {}
        }
    }
}

/// The serial port.
#[derive(Debug, Default)]
pub struct SerialPort {
    interpreter: Interpreter,
    line: Vec<u8>,
}

impl SerialPort {
    /// Takes one byte.
    pub fn receive(&mut self, machine: &mut Machine, byte: u8, out: &mut Vec<u8>) {
        match byte {
            b'\r' => {
                let line = std::mem::take(&mut self.line);
                let reply = self.interpreter.execute(machine, &line);
                for text in reply.lines {
                    out.extend_from_slice(text.as_bytes());
                    out.push(b'\r');
                }
                out.push(if reply.error.is_some() { 7 } else { 6 });
            }
            ..=31 => self.interpreter.control(machine, byte),
            _ if self.line.len() < 255 => self.line.push(byte),
            _ => {}
        }
    }
}

/// The families.
pub mod family {
    pub use super::{Family, PMAC, PMAC2};
}
