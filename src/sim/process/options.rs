//! The options of `pmac-sim`.

use std::path::{Path, PathBuf};

use clap::Parser;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

use crate::map::readings::RotaryCode2;
use crate::map::{DPRAM_SIZES, Family, Firmware, Generation, Readings};
use crate::recording::{About, RecordingError};
use crate::sim::board::families::{SIMULATED, with_length};
use crate::sim::board::firmware::FirmwareTables;
use crate::sim::board::identity::Identity;
use crate::sim::board::processor::{PROCESSORS, Processor};

/// A simulated PMAC: the board's side of a DPRAM, in its own process.
///
/// Once it runs it needs no right: started by root, it gives up every capability. It follows no link to its memory, and takes
/// no other user's file.
#[derive(Debug, Parser)]
#[command(name = "pmac-sim", version, disable_help_subcommand = true)]
pub struct Options {
    /// The shared memory: a file as long as the family's DPRAM, created if missing and never removed
    #[arg(long, value_name = "PATH")]
    pub memory: PathBuf,
    /// Socket that sends a 4-byte count at each interrupt, as UIO does
    #[arg(long, value_name = "unix:PATH", value_parser = unix_path)]
    pub interrupt: Option<UnixPath>,
    /// The VME mailbox port: a file of 512 bytes, created if missing
    #[arg(long, value_name = "PATH")]
    pub mailbox: Option<PathBuf>,
    /// Socket that sends a 4-byte count each time PMAC has taken a mailbox group (vector v-1)
    #[arg(long, value_name = "unix:PATH", value_parser = unix_path, requires = "mailbox")]
    pub mailbox_taken: Option<UnixPath>,
    /// Socket that sends a 4-byte count at each mailbox response (vector v)
    #[arg(long, value_name = "unix:PATH", value_parser = unix_path, requires = "mailbox")]
    pub mailbox_response: Option<UnixPath>,
    /// Hide the DPRAM after each reset until this page (A19-A14) is written to mailbox base+0x121
    #[arg(long, value_name = "N", value_parser = page, requires = "mailbox")]
    pub dpram_page: Option<u8>,
    /// The interrupt registers of the ISA host port: a file of 16 bytes, created if missing
    #[arg(long, value_name = "PATH")]
    pub host_port: Option<PathBuf>,
    /// The number of coordinate system 1 in a binary rotary header
    #[arg(long, value_name = "0|1", default_value_t = 1, value_parser = clap::value_parser!(u16).range(0..=1))]
    pub rotary_cs_base: u16,
    /// Socket that is the serial port: raw bytes
    #[arg(long, value_name = "unix:PATH", value_parser = unix_path)]
    pub serial: Option<UnixPath>,
    /// Socket for commands to the simulator itself: a line in, a line out
    #[arg(long, value_name = "unix:PATH", value_parser = unix_path)]
    pub control: Option<UnixPath>,
    /// How many motors there are, at most those of the family; without it, as many as the family has
    #[arg(long, value_parser = clap::value_parser!(u8).range(1..=most_motors()))]
    pub motors: Option<u8>,
    /// Servo interrupts a second; sets I10. Without it the rate follows I10
    #[arg(long, value_name = "HZ", value_parser = servo_hz)]
    pub servo_hz: Option<f64>,
    /// Board family
    #[arg(long, default_value = "pmac", value_parser = family())]
    pub family: &'static FirmwareTables,
    /// The size of the DPRAM in 16-bit words; without it, what boards of the family come with
    #[arg(long, value_name = "8k|32k", value_parser = PossibleValuesParser::new(DPRAM_SIZES.map(|(name, _)| name)))]
    pub dpram: Option<String>,
    /// Firmware that VERSION answers; it also decides where the gather buffer is. Without it 1.16D, of a Turbo board 1.947
    #[arg(long)]
    pub firmware: Option<Firmware>,
    /// Processor and memory of a Turbo board by its option: 5C, 5D, 5E or 5F (80 to 240 MHz), with 0 for standard or 3 for extended memory
    #[arg(long, value_name = "OPTION", default_value = "5C0", value_parser = processor())]
    pub cpu: Processor,
    /// Put MACRO stations on the ring of a Turbo board: they keep what MS and MSW write, and do nothing else
    #[arg(long = "macro")]
    pub stations: bool,
    /// File of on-line command lines sent at start; comments begin with ;
    #[arg(long, value_name = "FILE", conflicts_with = "dpram_startup")]
    pub startup: Option<PathBuf>,
    /// Send the family's start-up lines, which enable all DPRAM functions
    #[arg(long)]
    pub dpram_startup: bool,
    /// Start the board that was recorded in DIR, as far as the recording tells: family, DPRAM, firmware, variables
    #[arg(long, value_name = "DIR", conflicts_with_all = ["family", "dpram", "firmware", "startup", "dpram_startup"])]
    pub from: Option<PathBuf>,
    /// Where the board has CODE2 of ABS, INC and FRAX in binary rotary commands, which no text decides
    #[arg(long, value_name = "bit12|bit16", value_parser = rotary_code2())]
    pub rotary_code2: Option<RotaryCode2>,
    /// Run servo cycles only when the control socket says `step`
    #[arg(long = "virtual", requires = "control")]
    pub virtual_time: bool,
    /// Give the encoders half a count of noise from this seed
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Power up with anything in the memory, from this seed, as a board does; off: with what the file holds
    #[arg(long, value_name = "SEED|off", default_value = "1", value_parser = garbage)]
    pub garbage: Garbage,
    /// How many times as long as a board's SAVE, $$$, DEFINE, DELETE and LIST take; 0: no time
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = factor)]
    pub slow: f64,
    /// Power up with I2=3, I55=1 and I57=1 saved: these functions act before any host does
    #[arg(long)]
    pub saved_enables: bool,
    /// Make the memory's directory; exit when the parent process (PID) exits, and remove both
    #[arg(long, value_name = "PID", hide = true)]
    pub with_parent: Option<u32>,
}

/// Options that describe no board.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NoSuchBoard {
    /// A recording that cannot be read.
    #[error("--from: {0}")]
    Recording(#[from] RecordingError),
    /// A DPRAM of a size that the family does not have.
    #[error("--dpram: {0}")]
    Dpram(String),
    /// A processor that only Turbo boards have.
    #[error("--cpu {}: a {} has no such option; leave --cpu out or give --family turbo or turbo2", .0.option, .1.title)]
    Processor(Processor, &'static Family),
    /// More motors than the family has.
    #[error("a {} has at most {} motors; give --motors 1 to {}", .0.title, .0.motors, .0.motors)]
    Motors(&'static Family),
}

/// The memory's content at power-on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Garbage {
    /// The file's content.
    Off,
    /// Anything, from a seed.
    From(u64),
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
    ///
    /// # Errors
    /// A recording that cannot be read, or a DPRAM or motors that no board of the family has.
    pub fn identity(&self) -> Result<Identity, NoSuchBoard> {
        let recorded = self.from.as_deref().map(About::read).transpose()?;
        let read = recorded.as_ref().map_or_else(Readings::default, |about| about.settings.readings);
        let readings = Readings { rotary_code2: self.rotary_code2.or(read.rotary_code2) };
        let family = recorded.as_ref().zip(self.from.as_deref());
        let family = family.map(|(about, directory)| about.family(directory)).transpose()?;
        let tables = match (family, &self.dpram) {
            (Some(family), _) => {
                let named = SIMULATED.iter().find(|tables| tables.family.name == family.name);
                named.and_then(|tables| with_length(tables, family.length)).unwrap_or(self.family)
            }
            (None, Some(size)) => {
                let family = self.family.family.with_dpram(size).map_err(NoSuchBoard::Dpram)?;
                with_length(self.family, family.length).unwrap_or(self.family)
            }
            (None, None) => self.family,
        };
        let told = recorded.and_then(|about| about.firmware);
        let firmware = self.firmware.map(|firmware| firmware.to_string()).or(told);
        let firmware = firmware.unwrap_or_else(|| tables.firmware.to_owned());
        let identity = Identity::new(tables, &firmware);
        let motors = self.motors.map_or(identity.motors, usize::from);
        if motors > tables.family.motors {
            return Err(NoSuchBoard::Motors(tables.family));
        }
        if self.cpu != Processor::default() && tables.family.generation != Generation::Turbo {
            return Err(NoSuchBoard::Processor(self.cpu, tables.family));
        }
        Ok(Identity { motors, readings, processor: self.cpu, stations: self.stations, ..identity })
    }

    /// The I10 that the asked rate means.
    #[must_use]
    pub fn fixed_i10(&self) -> Option<f64> {
        self.servo_hz.map(|hz| (8_388_608.0 * 1000.0 / hz).round())
    }
}

/// The families that can be simulated, by their names.
fn family() -> impl TypedValueParser<Value = &'static FirmwareTables> {
    let name = |tables: &&FirmwareTables| PossibleValue::new(tables.family.name).help(tables.family.title);
    PossibleValuesParser::new(SIMULATED.iter().map(name)).map(|name| {
        SIMULATED.iter().copied().find(|tables| tables.family.name == name).unwrap_or(SIMULATED[0])
    })
}

/// The processors by their options.
fn processor() -> impl TypedValueParser<Value = Processor> {
    let name = |processor: Processor| PossibleValue::new(processor.option).help(processor.text);
    PossibleValuesParser::new(PROCESSORS.map(name))
        .map(|name| PROCESSORS.into_iter().find(|processor| processor.option == name).unwrap_or_default())
}

/// The most motors that a simulated board has.
fn most_motors() -> i64 {
    SIMULATED.iter().map(|tables| tables.family.motors as i64).max().unwrap_or(1)
}

fn unix_path(text: &str) -> Result<UnixPath, String> {
    match text.strip_prefix("unix:") {
        Some(path) if !path.is_empty() => Ok(UnixPath(path.into())),
        _ => Err("it has to be unix:PATH".into()),
    }
}

fn rotary_code2() -> impl TypedValueParser<Value = RotaryCode2> {
    PossibleValuesParser::new(["bit12", "bit16"]).map(|name| match &*name {
        "bit12" => RotaryCode2::Bit12,
        _ => RotaryCode2::Bit16,
    })
}

fn garbage(text: &str) -> Result<Garbage, String> {
    match text {
        "off" => Ok(Garbage::Off),
        _ => text.parse().map(Garbage::From).map_err(|_| "it has to be a seed, or off".into()),
    }
}

fn factor(text: &str) -> Result<f64, String> {
    let factor = text.parse().ok().filter(|factor| (0.0..=1000.0).contains(factor));
    factor.ok_or_else(|| "it has to be from 0 to 1000".into())
}

/// Six bits, decimal or with 0x.
fn page(text: &str) -> Result<u8, String> {
    let number = match text.strip_prefix("0x") {
        Some(digits) => u8::from_str_radix(digits, 16),
        None => text.parse(),
    };
    number.ok().filter(|page| *page < 0x40).ok_or_else(|| "it has to be from 0 to 0x3F".into())
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
