//! The options of `pmac-sim`.

use std::path::{Path, PathBuf};

use clap::{Parser, ValueEnum};

use super::language::family;
use super::machine::Identity;
use crate::map::Firmware;

/// A simulated PMAC: the board's side of a DPRAM, in its own process.
#[derive(Debug, Parser)]
#[command(name = "pmac-sim", version, about, disable_help_subcommand = true)]
pub struct Options {
    /// The shared memory: a file of 16384 bytes, created if missing and never removed
    #[arg(long, value_name = "PATH")]
    pub memory: PathBuf,
    /// Socket on which each interrupt is told as a 4-byte count, as UIO gives it
    #[arg(long, value_name = "unix:PATH", value_parser = unix_path)]
    pub interrupt: Option<UnixPath>,
    /// Socket that is the serial port: raw bytes
    #[arg(long, value_name = "unix:PATH", value_parser = unix_path)]
    pub serial: Option<UnixPath>,
    /// Socket for commands to the simulator itself: a line in, a line out
    #[arg(long, value_name = "unix:PATH", value_parser = unix_path)]
    pub control: Option<UnixPath>,
    /// How many motors there are
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u8).range(1..=8))]
    pub motors: u8,
    /// Servo interrupts a second; sets I10. Without it the rate follows I10
    #[arg(long, value_name = "HZ", value_parser = servo_hz)]
    pub servo_hz: Option<f64>,
    /// What family of boards to be one of
    #[arg(long, value_enum, default_value_t = BoardFamily::Pmac)]
    pub family: BoardFamily,
    /// What VERSION answers; it also decides where the gather buffer lies
    #[arg(long, default_value = "1.16D")]
    pub firmware: Firmware,
    /// File of on-line command lines sent at start; comments begin with ;
    #[arg(long, value_name = "FILE", conflicts_with = "dpram_startup")]
    pub startup: Option<PathBuf>,
    /// Send the shipped start-up lines, which enable all DPRAM functions for eight motors
    #[arg(long)]
    pub dpram_startup: bool,
    /// Let time go on only by the control socket's `step`
    #[arg(long = "virtual", requires = "control")]
    pub virtual_time: bool,
    /// Give the encoders half a count of noise from this seed
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// End when the process that started this one ends, whose number it is, and remove the memory and its directory
    #[arg(long, value_name = "PID", hide = true)]
    pub with_parent: Option<u32>,
}

/// The families that can be simulated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum BoardFamily {
    /// PMAC(1)
    Pmac,
    /// PMAC2
    Pmac2,
}

/// A path given as `unix:PATH`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UnixPath(PathBuf);

impl UnixPath {
    /// The path.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.0
    }
}

impl Options {
    /// The board these options describe.
    #[must_use]
    pub fn identity(&self) -> Identity {
        let family = match self.family {
            BoardFamily::Pmac => &family::PMAC,
            BoardFamily::Pmac2 => &family::PMAC2,
        };
        Identity { motors: self.motors.into(), ..Identity::new(family, &self.firmware.to_string()) }
    }

    /// The I10 that the asked rate means.
    #[must_use]
    pub fn fixed_i10(&self) -> Option<f64> {
        self.servo_hz.map(|hz| (8_388_608.0 * 1000.0 / hz).round())
    }
}

fn unix_path(text: &str) -> Result<UnixPath, String> {
    match text.strip_prefix("unix:") {
        Some(path) if !path.is_empty() => Ok(UnixPath(path.into())),
        _ => Err("it has to be unix:PATH".into()),
    }
}

/// I10 has 23 bits: a period of at most a second.
fn servo_hz(text: &str) -> Result<f64, String> {
    let hz: f64 = text.parse().map_err(|_| "it has to be a number".to_owned())?;
    if (1001.0 / 1000.0..=100_000.0).contains(&hz) {
        Ok(hz)
    } else {
        Err("it has to be from 1.001 to 100000".into())
    }
}
