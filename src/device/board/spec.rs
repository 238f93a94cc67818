//! Which board: the `--board` specification, parsed.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use crate::device::board::pci::PciAddress;
use crate::device::system::number;
use crate::device::{Access, InterruptSource};
use crate::map::{CPU_OPTIONS, DPRAM_SIZES, Family};

/// The longest window to map: no DPRAM is longer.
const LONGEST_WINDOW: u64 = 0x10_0000;

/// The user's `--board` specification.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum BoardSpec {
    /// `sim[,family=NAME][,dpram=SIZE][,cpu=OPTION][,from=DIR]`: start a simulator and use its memory.
    Simulator(SimulatorSpec),
    /// `file:PATH[,irq=SOURCE][,access=32]`: a file that another process uses as its DPRAM.
    File {
        /// The memory file.
        path: PathBuf,
        /// Where the other process announces interrupts, if anywhere.
        interrupt: Option<InterruptSource>,
        /// The maximum width of a read of its data.
        access: Access,
    },
    /// `replay:DIR`: a recording that `pmacctl board capture` wrote.
    Replay {
        /// The recording's directory.
        directory: PathBuf,
        /// Whether it plays as fast as possible in virtual time, and not in real time.
        at_once: bool,
    },
    /// A window of the machine's memory: a board in a slot.
    Window(WindowSpec),
}

/// A simulator to start.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct SimulatorSpec {
    /// The name of its family, if the specification gives it.
    pub family: Option<&'static str>,
    /// The size of its DPRAM by name ([`crate::map::DPRAM_SIZES`]); `None`: what boards of the family come with.
    pub dpram: Option<&'static str>,
    /// The option of its processor and memory ([`crate::map::CPU_OPTIONS`]); `None`: the smallest.
    pub cpu: Option<&'static str>,
    /// The recording of the board that the simulator imitates.
    pub from: Option<PathBuf>,
}

/// A board in a slot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WindowSpec {
    /// The memory to map.
    pub place: Place,
    /// Offset of the DPRAM in that place, in bytes.
    pub offset: u64,
    /// How many bytes to map; `None`: as many as the board's DPRAM has.
    pub length: Option<usize>,
    /// The source of its interrupts; `None`: for a UIO board the same device.
    pub interrupt: Option<InterruptSource>,
    /// The maximum width of a read of its data.
    pub access: Access,
}

impl BoardSpec {
    /// The length of a board that is a file: its DPRAM's.
    #[must_use]
    pub fn file_bytes(&self) -> Option<u32> {
        let Self::File { path, .. } = self else { return None };
        std::fs::metadata(path).ok().and_then(|file| u32::try_from(file.len()).ok())
    }
}

impl WindowSpec {
    /// How many bytes to map for a DPRAM of `dpram` bytes.
    ///
    /// # Errors
    /// When the specification gives fewer.
    pub fn bytes(&self, dpram: usize) -> Result<usize, String> {
        match self.length {
            Some(length) if length < dpram => Err(format!(
                "length={length:#x} is too short: the DPRAM of this family has {dpram:#x} bytes; leave length= out"
            )),
            length => Ok(length.unwrap_or(dpram)),
        }
    }
}

/// The memory that contains a board's window.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Place {
    /// `mem:ADDR`: physical memory from this address on.
    Memory(u64),
    /// `uio:/dev/uioN[,map=M]`: a map of a UIO device.
    Uio {
        /// The device's node.
        node: PathBuf,
        /// Which map.
        map: u32,
    },
    /// `pci:DOMAIN:BUS:DEVICE.FUNCTION[,bar=N]`: a memory resource of a PCI device.
    Pci {
        /// Where the device is.
        address: PciAddress,
        /// Which BAR; `None`: the first that is long enough.
        bar: Option<u8>,
    },
    /// `vme:NODE`: a window of a VME bridge, as a node that can be mapped.
    Vme(PathBuf),
}

impl Place {
    /// Parses a place of this kind and takes its options; `None` when the kind is no place.
    pub(in crate::device) fn parse(
        kind: &str,
        subject: &str,
        given: &mut Given,
    ) -> Result<Option<Self>, String> {
        let place = match kind {
            "mem" => Self::Memory(address(needed(kind, "address", subject)?)?),
            "uio" => {
                let node = node(needed(kind, "node", subject)?, "/dev/uio0")?;
                Self::Uio { node, map: given.map.take().unwrap_or(0) }
            }
            "pci" => {
                let address = needed(kind, "address", subject)?.parse()?;
                Self::Pci { address, bar: given.bar.take() }
            }
            "vme" => Self::Vme(node(needed(kind, "node", subject)?, "/dev/bus/vme/m0")?),
            _ => return Ok(None),
        };
        Ok(Some(place))
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Memory(address) => write!(f, "mem:{address:#x}"),
            Self::Uio { node, map } => write!(f, "uio:{},map={map}", node.display()),
            Self::Pci { address, bar: None } => write!(f, "pci:{address}"),
            Self::Pci { address, bar: Some(bar) } => write!(f, "pci:{address},bar={bar}"),
            Self::Vme(node) => write!(f, "vme:{}", node.display()),
        }
    }
}

/// Why the driver refused a board specification.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "board `{spec}`: {reason}; write sim[,family=NAME][,dpram=8k|32k][,cpu=OPTION][,from=DIR], replay:DIR[,time=virtual], file:PATH, mem:0xADDRESS, uio:/dev/uioN[,map=M], pci:0000:03:00.0[,bar=N] \
    or vme:NODE, each but sim and replay with [,irq=SOURCE], each but sim, replay and vme with [,access=32]"
)]
pub struct SpecError {
    spec: String,
    reason: String,
}

impl BoardSpec {
    /// The recording that the board plays, or that its simulator imitates.
    #[must_use]
    pub fn recording(&self) -> Option<&Path> {
        match self {
            Self::Replay { directory, .. } => Some(directory),
            Self::Simulator(simulator) => simulator.from.as_deref(),
            _ => None,
        }
    }

    /// The maximum width of a read of its data.
    #[must_use]
    pub const fn access(&self) -> Access {
        match self {
            Self::Simulator(_) | Self::Replay { .. } => Access::Bits16,
            Self::File { access, .. } | Self::Window(WindowSpec { access, .. }) => *access,
        }
    }
}

/// The specification `text` without paths of files and directories, for other users' eyes.
#[must_use]
pub fn without_paths(text: &str) -> String {
    let kind = text.split_once(':').map_or(text, |(kind, _)| kind);
    if matches!(kind, "file" | "replay") {
        return kind.to_owned();
    }
    let short = |option: &str| match option {
        from if from.starts_with("from=") => "from".to_owned(),
        irq if irq.starts_with("irq=unix:") => "irq=unix".to_owned(),
        other => other.to_owned(),
    };
    text.split(',').map(short).collect::<Vec<_>>().join(",")
}

impl FromStr for BoardSpec {
    type Err = SpecError;

    fn from_str(spec: &str) -> Result<Self, SpecError> {
        parse(spec).map_err(|reason| SpecError { spec: spec.to_owned(), reason })
    }
}

fn parse(spec: &str) -> Result<BoardSpec, String> {
    if let Some(options) = spec.strip_prefix("sim") {
        return simulator(options).map(BoardSpec::Simulator);
    }
    let (kind, rest) = spec.split_once(':').unwrap_or((spec, ""));
    if kind == "replay" {
        // The directory's name may hold commas.
        let (directory, time) = rest.rsplit_once(",time=").unwrap_or((rest, "real"));
        let at_once = match time {
            "real" => false,
            "virtual" => true,
            _ => return Err(format!("time={time}: write time=real or time=virtual")),
        };
        return Ok(BoardSpec::Replay { directory: needed(kind, "directory", directory)?.into(), at_once });
    }
    let (subject, mut given) = Given::split(rest)?;
    let board = match Place::parse(kind, subject, &mut given)? {
        Some(place) => BoardSpec::Window(given.window(place)?),
        None if kind == "file" => {
            let (interrupt, access) = (given.interrupt.take(), given.access.take().unwrap_or_default());
            BoardSpec::File { path: needed(kind, "path", subject)?.into(), interrupt, access }
        }
        None => return Err(format!("there is no board kind `{kind}`")),
    };
    given.nothing_left(kind)?;
    Ok(board)
}

/// The options behind `sim`.
fn simulator(options: &str) -> Result<SimulatorSpec, String> {
    let mut parts = options.split(',');
    if parts.next() != Some("") {
        return Err("sim takes only ,family=NAME, ,dpram=SIZE, ,cpu=OPTION and ,from=DIR after it".to_owned());
    }
    let mut simulator = SimulatorSpec::default();
    for option in parts {
        let (key, value) = option.split_once('=').ok_or_else(|| format!("unknown option `{option}`"))?;
        let twice = match key {
            "family" => {
                let family = Family::by_name(value).map_err(|error| error.to_string())?;
                simulator.family.replace(family.name).is_some()
            }
            "dpram" => {
                let known = DPRAM_SIZES.iter().find(|(name, _)| *name == value);
                let (name, _) = known.ok_or_else(|| format!("{option}: write dpram=8k or dpram=32k"))?;
                simulator.dpram.replace(name).is_some()
            }
            "cpu" => {
                let known = CPU_OPTIONS.iter().find(|name| **name == value);
                let name =
                    known.ok_or_else(|| format!("{option}: write cpu={}", CPU_OPTIONS.join(" or cpu=")))?;
                simulator.cpu.replace(name).is_some()
            }
            "from" if value.is_empty() => return Err("the directory after from= is missing".to_owned()),
            "from" => simulator.from.replace(value.into()).is_some(),
            _ => return Err(format!("unknown option `{option}`")),
        };
        if twice {
            return Err(format!("{key}= is given twice"));
        }
    }
    if simulator.from.is_some() && (simulator.family.is_some() || simulator.dpram.is_some()) {
        return Err("from= tells family and DPRAM; leave family= and dpram= out".to_owned());
    }
    Ok(simulator)
}

pub(in crate::device) fn needed<'a>(kind: &str, what: &str, subject: &'a str) -> Result<&'a str, String> {
    if subject.is_empty() { Err(format!("the {what} after {kind}: is missing")) } else { Ok(subject) }
}

/// The options behind the first comma.
#[derive(Default)]
pub(in crate::device) struct Given {
    interrupt: Option<InterruptSource>,
    map: Option<u32>,
    bar: Option<u8>,
    pub(in crate::device) offset: Option<u64>,
    length: Option<usize>,
    access: Option<Access>,
}

impl Given {
    /// Splits `rest` into what precedes the first comma, and the options behind it.
    pub(in crate::device) fn split(rest: &str) -> Result<(&str, Self), String> {
        let mut parts = rest.split(',');
        let subject = parts.next().unwrap_or_default();
        let mut given = Self::default();
        for option in parts {
            let (key, value) = option.split_once('=').ok_or_else(|| format!("unknown option `{option}`"))?;
            let twice = match key {
                "irq" => given.interrupt.replace(value.parse()?).is_some(),
                "map" => given.map.replace(small(option, value, 15)?.into()).is_some(),
                "bar" => given.bar.replace(small(option, value, 5)?).is_some(),
                "offset" => given.offset.replace(even(option, value)?).is_some(),
                "length" => given.length.replace(length(option, value)?).is_some(),
                "access" => given.access.replace(access(option, value)?).is_some(),
                _ => return Err(format!("unknown option `{option}`")),
            };
            if twice {
                return Err(format!("{key}= is given twice"));
            }
        }
        Ok((subject, given))
    }

    /// The window in `place`; takes the options that every window has.
    fn window(&mut self, place: Place) -> Result<WindowSpec, String> {
        let offset = self.offset.take().unwrap_or(0);
        let length = self.length.take();
        let longest = length.map_or(LONGEST_WINDOW, |length| length as u64);
        let start = if let Place::Memory(address) = place { address } else { 0 };
        if start.checked_add(offset).and_then(|first| first.checked_add(longest)).is_none() {
            return Err("the window leaves the machine's addresses".to_owned());
        }
        // A VME board is a 16-bit slave.
        let access =
            if matches!(place, Place::Vme(_)) { None } else { self.access.take() }.unwrap_or_default();
        Ok(WindowSpec { place, offset, length, interrupt: self.interrupt.take(), access })
    }

    /// Rejects an option that this kind of board does not have.
    pub(in crate::device) fn nothing_left(&self, kind: &str) -> Result<(), String> {
        let left = [
            (self.interrupt.is_some(), "irq"),
            (self.map.is_some(), "map"),
            (self.bar.is_some(), "bar"),
            (self.offset.is_some(), "offset"),
            (self.length.is_some(), "length"),
            (self.access.is_some(), "access"),
        ];
        match left.into_iter().find(|(left, _)| *left) {
            Some((_, option)) => Err(format!("{kind}: has no option {option}=")),
            None => Ok(()),
        }
    }
}

fn address(text: &str) -> Result<u64, String> {
    number(text)
        .filter(|address| address.is_multiple_of(2))
        .ok_or_else(|| format!("{text} is no address of a word; write it as 0xD4000"))
}

fn node(text: &str, as_in: &str) -> Result<PathBuf, String> {
    if text.starts_with('/') {
        Ok(text.into())
    } else {
        Err(format!("{text} is no node; write it as {as_in}"))
    }
}

fn even(option: &str, value: &str) -> Result<u64, String> {
    number(value)
        .filter(|number| number.is_multiple_of(2))
        .ok_or_else(|| format!("{option}: write an even number of bytes, as 0x4000"))
}

fn small(option: &str, value: &str, most: u8) -> Result<u8, String> {
    let small = number(value).and_then(|number| u8::try_from(number).ok()).filter(|number| *number <= most);
    small.ok_or_else(|| format!("{option}: write a number from 0 to {most}"))
}

fn length(option: &str, value: &str) -> Result<usize, String> {
    let length = even(option, value)?;
    let fits = usize::try_from(length).ok().filter(|_| (1..=LONGEST_WINDOW).contains(&length));
    fits.ok_or_else(|| format!("{option}: {LONGEST_WINDOW:#x} bytes are mapped at most"))
}

fn access(option: &str, value: &str) -> Result<Access, String> {
    match value {
        "16" => Ok(Access::Bits16),
        "32" => Ok(Access::Bits32),
        _ => Err(format!("{option}: data are read by 16 or by 32 bits")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn others_see_no_path_of_a_board() {
        for (text, shown) in [
            ("file:/home/me/dpram,irq=unix:/home/me/irq", "file"),
            ("replay:/home/me/board,time=virtual", "replay"),
            ("sim,family=turbo2,from=/home/me/board", "sim,family=turbo2,from"),
            ("sim,from=/home/me/board", "sim,from"),
            ("mem:0xd4000,irq=unix:/home/me/irq", "mem:0xd4000,irq=unix"),
            ("pci:0000:03:00.0,bar=2,irq=uio:/dev/uio0", "pci:0000:03:00.0,bar=2,irq=uio:/dev/uio0"),
        ] {
            assert_eq!(without_paths(text), shown);
        }
    }

    fn window(place: Place) -> WindowSpec {
        WindowSpec { place, offset: 0, length: None, interrupt: None, access: Access::Bits16 }
    }

    #[test]
    fn what_is_written_is_what_is_meant() {
        let uio = |map| Place::Uio { node: "/dev/uio0".into(), map };
        let irq = || Some(InterruptSource::Uio("/dev/uio0".into()));
        for (text, spec) in [
            ("sim", BoardSpec::Simulator(SimulatorSpec::default())),
            (
                "sim,family=TURBO2,dpram=8k,cpu=5F3",
                BoardSpec::Simulator(SimulatorSpec {
                    family: Some("turbo2"),
                    dpram: Some("8k"),
                    cpu: Some("5F3"),
                    ..SimulatorSpec::default()
                }),
            ),
            ("replay:/captures/a,b", BoardSpec::Replay { directory: "/captures/a,b".into(), at_once: false }),
            ("replay:a,b,time=virtual", BoardSpec::Replay { directory: "a,b".into(), at_once: true }),
            (
                "sim,from=captures/x",
                BoardSpec::Simulator(SimulatorSpec {
                    from: Some("captures/x".into()),
                    ..SimulatorSpec::default()
                }),
            ),
            (
                "file:/dev/shm/dpram",
                BoardSpec::File { path: "/dev/shm/dpram".into(), interrupt: None, access: Access::Bits16 },
            ),
            (
                "file:m,access=32",
                BoardSpec::File { path: "m".into(), interrupt: None, access: Access::Bits32 },
            ),
            ("mem:0xD4000,access=16", BoardSpec::Window(window(Place::Memory(0xD4000)))),
            (
                "pci:03:00.0,access=32",
                BoardSpec::Window(WindowSpec {
                    access: Access::Bits32,
                    ..window(Place::Pci { address: "03:00.0".parse().unwrap(), bar: None })
                }),
            ),
            (
                "file:m,irq=unix:/run/irq",
                BoardSpec::File {
                    path: "m".into(),
                    interrupt: Some(InterruptSource::Unix("/run/irq".into())),
                    access: Access::Bits16,
                },
            ),
            ("mem:0xD4000", BoardSpec::Window(window(Place::Memory(0xD4000)))),
            (
                "mem:0xD4000,irq=uio:/dev/uio0,length=0x8000",
                BoardSpec::Window(WindowSpec {
                    length: Some(0x8000),
                    interrupt: irq(),
                    ..window(Place::Memory(0xD4000))
                }),
            ),
            ("uio:/dev/uio0", BoardSpec::Window(window(uio(0)))),
            ("uio:/dev/uio0,map=1", BoardSpec::Window(window(uio(1)))),
            (
                "uio:/dev/uio0,offset=0xFA0000",
                BoardSpec::Window(WindowSpec { offset: 0xFA_0000, ..window(uio(0)) }),
            ),
            (
                "pci:0000:03:00.0",
                BoardSpec::Window(window(Place::Pci { address: "03:00.0".parse().unwrap(), bar: None })),
            ),
            (
                "pci:0000:03:00.0,bar=2,irq=uio:/dev/uio0",
                BoardSpec::Window(WindowSpec {
                    interrupt: irq(),
                    ..window(Place::Pci { address: "03:00.0".parse().unwrap(), bar: Some(2) })
                }),
            ),
            (
                "vme:/dev/bus/vme/m0,offset=0x8000",
                BoardSpec::Window(WindowSpec {
                    offset: 0x8000,
                    ..window(Place::Vme("/dev/bus/vme/m0".into()))
                }),
            ),
        ] {
            assert_eq!(text.parse(), Ok(spec), "{text}");
        }
    }

    #[test]
    fn a_window_is_as_long_as_the_dpram_or_longer() {
        let spec = |length| WindowSpec { length, ..window(Place::Memory(0xD4000)) };
        assert_eq!((spec(None).bytes(0x4000), spec(None).bytes(0x10000)), (Ok(0x4000), Ok(0x10000)));
        assert_eq!(spec(Some(0x8000)).bytes(0x4000), Ok(0x8000));
        assert!(spec(Some(0x8000)).bytes(0x10000).unwrap_err().contains("has 0x10000 bytes"));
    }

    #[test]
    fn anything_else_is_refused_with_its_reason() {
        for (spec, reason) in [
            ("", "no board kind ``"),
            ("sim:x", "sim takes only ,family=NAME"),
            ("sim:", "sim takes only ,family=NAME"),
            ("sim,family=turbo3", "there are pmac, pmac2, turbo, turbo2"),
            ("sim,family=turbo,family=turbo", "family= is given twice"),
            ("sim,dpram=16k", "write dpram=8k or dpram=32k"),
            ("sim,irq=unix:b", "unknown option `irq=unix:b`"),
            ("file:", "path after file: is missing"),
            ("file:a,irq=b", "irq=b"),
            ("file:a,irq=unix:", "irq=unix:"),
            ("file:a,irq=uio:uio0", "irq=uio:/dev/uioN"),
            ("file:a,irq=unix:b,irq=unix:c", "given twice"),
            ("file:a,speed=9", "unknown option `speed=9`"),
            ("file:a,length=0x4000", "file: has no option length="),
            ("mem:", "address after mem: is missing"),
            ("mem:D4000", "write it as 0xD4000"),
            ("mem:0xD4001", "write it as 0xD4000"),
            ("mem:0xD4000,map=1", "mem: has no option map="),
            ("mem:0xD4000,length=0", "at most"),
            ("mem:0xD4000,length=0x10000000", "at most"),
            ("mem:0xFFFFFFFFFFFFF000", "leaves the machine's addresses"),
            ("mem:0xD4000,offset=1", "an even number"),
            ("uio:uio0", "write it as /dev/uio0"),
            ("uio:/dev/uio0,map=16", "from 0 to 15"),
            ("uio:/dev/uio0,map", "unknown option `map`"),
            ("pci:03", "03 is no PCI address"),
            ("pci:0000:03:00.0,bar=6", "from 0 to 5"),
            ("pci:0000:03:00.0,map=0", "pci: has no option map="),
            ("vme:m0", "write it as /dev/bus/vme/m0"),
            ("vme:/dev/bus/vme/m0,access=32", "vme: has no option access="),
            ("pci:03:00.0,access=64", "access=64: data are read by 16 or by 32 bits"),
            ("mem:0xD4000,access=32,access=16", "given twice"),
            ("isa:0x210", "no board kind `isa`"),
        ] {
            let error = spec.parse::<BoardSpec>().unwrap_err().to_string();
            assert!(error.contains(reason), "{spec}: {error}");
        }
    }
}
