//! Where a window of byte registers is, as the configuration writes it, and the one function that opens it.

use std::fs::OpenOptions;
use std::path::PathBuf;
use std::str::FromStr;

use super::byte::{ByteBus, ByteBusError, PortRegisters};
use super::mapping::Mapping;

/// A window of byte registers.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum ByteSpec {
    /// `file:PATH`: a file that another process, such as the simulator, treats as its registers.
    File(PathBuf),
    /// `port:0x210`: from this address on in the I/O space of a PC.
    Port(u16),
}

/// Why a window cannot be had.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ByteSpecError {
    /// It is not understood.
    #[error("registers `{spec}`: {reason}; write file:PATH or port:ADDRESS")]
    Spec {
        /// What was written.
        spec: String,
        /// What is wrong with it.
        reason: &'static str,
    },
    /// It cannot be opened.
    #[error("cannot open the registers {what}: {source}")]
    Open {
        /// Which.
        what: String,
        /// What the kernel said.
        source: std::io::Error,
    },
    /// The file is not as long as the window.
    #[error("{path} has {found} bytes, these registers take {expected}; is it the simulator's file?")]
    Length {
        /// The file.
        path: PathBuf,
        /// Its length.
        found: u64,
        /// The length it needs.
        expected: usize,
    },
}

impl FromStr for ByteSpec {
    type Err = ByteSpecError;

    fn from_str(spec: &str) -> Result<Self, ByteSpecError> {
        let refuse = |reason| ByteSpecError::Spec { spec: spec.to_owned(), reason };
        match spec.split_once(':') {
            Some(("file", "")) => Err(refuse("the path after file: is missing")),
            Some(("file", path)) => Ok(Self::File(path.into())),
            Some(("port", address)) => {
                let digits = address.strip_prefix("0x").or_else(|| address.strip_prefix("0X"));
                let address =
                    digits.map_or_else(|| address.parse(), |digits| u16::from_str_radix(digits, 16));
                address.map(Self::Port).map_err(|_| refuse("an I/O address is a number from 0 to 0xFFFF"))
            }
            _ => Err(refuse("there is no such kind of registers")),
        }
    }
}

impl std::fmt::Display for ByteSpec {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::File(path) => write!(f, "file:{}", path.display()),
            Self::Port(address) => write!(f, "port:{address:#x}"),
        }
    }
}

/// Opens the window of `length` bytes that `spec` names. Every kind of window is opened here.
///
/// # Errors
/// [`ByteSpecError`] when it cannot be opened, or is a file of another length.
pub fn open_bytes(spec: &ByteSpec, length: usize) -> Result<Box<dyn ByteBus>, ByteSpecError> {
    let failed = |source| ByteSpecError::Open { what: spec.to_string(), source };
    match spec {
        ByteSpec::File(path) => {
            let file = OpenOptions::new().read(true).write(true).open(path).map_err(failed)?;
            let found = file.metadata().map_err(failed)?.len();
            if found != length as u64 {
                return Err(ByteSpecError::Length { path: path.clone(), found, expected: length });
            }
            Ok(Box::new(Mapping::new(&file, 0, length).map_err(failed)?))
        }
        ByteSpec::Port(base) => Ok(Box::new(PortRegisters::open(*base, length).map_err(failed)?)),
    }
}

/// Registers of the host port: its I/O addresses.
const HOST_PORT_LENGTH: usize = 16;
/// The register that reads other than it is written.
const COMMAND: u32 = 8;
/// Where a simulated host port takes what is written to it: its file cannot tell that a byte was written that has not
/// changed.
const SIMULATED_COMMAND: u32 = 12;

/// Opens the registers of a host port.
///
/// # Errors
/// As [`open_bytes`].
pub fn open_host_port(spec: &ByteSpec) -> Result<Box<dyn ByteBus>, ByteSpecError> {
    let bus = open_bytes(spec, HOST_PORT_LENGTH)?;
    Ok(match spec {
        ByteSpec::File(_) => Box::new(SimulatedHostPort(bus)),
        ByteSpec::Port(_) => bus,
    })
}

struct SimulatedHostPort(Box<dyn ByteBus>);

impl ByteBus for SimulatedHostPort {
    fn read8(&mut self, offset: u32) -> Result<u8, ByteBusError> {
        self.0.read8(offset)
    }
    fn write8(&mut self, offset: u32, value: u8) -> Result<(), ByteBusError> {
        self.0.write8(if offset == COMMAND { SIMULATED_COMMAND } else { offset }, value)
    }
    fn order_accesses(&mut self) {
        self.0.order_accesses();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_what_is_meant() {
        for (text, spec) in [
            ("file:/dev/shm/mailbox", ByteSpec::File("/dev/shm/mailbox".into())),
            ("port:0x210", ByteSpec::Port(0x210)),
            ("port:528", ByteSpec::Port(528)),
        ] {
            assert_eq!(text.parse::<ByteSpec>().unwrap(), spec);
            assert_eq!(spec.to_string().parse::<ByteSpec>().unwrap(), spec);
        }
        for text in ["", "file:", "port:", "port:0x10000", "port:-1", "tape:0"] {
            assert!(matches!(text.parse::<ByteSpec>(), Err(ByteSpecError::Spec { .. })), "{text}");
        }
    }

    #[test]
    fn a_file_serves_if_it_is_as_long_as_the_registers() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let spec = ByteSpec::File(file.path().to_owned());
        assert!(matches!(open_bytes(&spec, 16), Err(ByteSpecError::Length { found: 0, expected: 16, .. })));
        file.as_file().set_len(16).unwrap();
        let mut window = open_bytes(&spec, 16).unwrap();
        window.write8(15, 7).unwrap();
        assert_eq!(std::fs::read(file.path()).unwrap()[15], 7);
        drop(window);
        let mut port = open_host_port(&spec).unwrap();
        port.write8(8, 0x67).unwrap();
        port.write8(9, 0x7F).unwrap();
        assert_eq!(std::fs::read(file.path()).unwrap()[8..13], [0, 0x7F, 0, 0, 0x67]);
        let missing = ByteSpec::File("/nonexistent/registers".into());
        assert!(matches!(open_bytes(&missing, 16), Err(ByteSpecError::Open { .. })));
    }
}
