//! The interrupt of a UIO device: a read returns the total so far, four bytes; the next interrupt needs a re-arm.
//!
//! The host re-arms a driver with an `irqcontrol` by writing 1 to the node. `uio_pci_generic` has none (ENOSYS): on an
//! interrupt it masks the device's INTx in the PCI command register (bit 10), and the host clears that bit through
//! sysfs.

use std::fs::{File, OpenOptions};
use std::io::{self, Read, Write};
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::PathBuf;

use crate::device::refusal::allowed;
use crate::device::system::System;
use crate::device::system::kernel::Lockdown;

/// Offset of the command register in PCI configuration space, and its bit that masks INTx.
const PCI_COMMAND: u64 = 4;
const INTX_DISABLE: u16 = 1 << 10;

/// Why the device gives no interrupts.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NoInterrupt {
    /// The driver has no interrupt line.
    #[error("{0} has no interrupt: its driver was given none, or the board's is not connected")]
    NoLine(String),
    /// The interrupt would come once and never again.
    #[error("the interrupt of {device} cannot be armed: {reason}")]
    Rearm {
        /// The device.
        device: String,
        /// Why, and what to do.
        reason: String,
    },
    /// Any other error.
    #[error("the interrupt's descriptor: {0}")]
    Io(#[from] io::Error),
}

/// How to re-arm the interrupt.
#[derive(Debug)]
enum Rearm {
    /// By a write to the node.
    Write,
    /// By clearing INTx-disable in this file of sysfs.
    Config(File),
}

/// An armed interrupt.
#[derive(Debug)]
pub struct UioInterrupt {
    file: File,
    rearm: Rearm,
    /// The total when it was opened, if the kernel gives it.
    total: Option<u32>,
}

/// The result of a read.
#[derive(Debug)]
pub(in crate::device) enum Count {
    /// The total so far.
    Total(u32),
    /// No interrupt since the last read.
    Nothing,
    /// The device is gone.
    Gone,
    /// One interrupt came, and no more can come.
    Last(u32),
}

impl UioInterrupt {
    /// Arms the interrupt of the device whose node is `file` and which sysfs describes in `directory`.
    pub(in crate::device) fn new(system: &System, directory: &str, file: File) -> Result<Self, NoInterrupt> {
        let device = directory.rsplit('/').next().unwrap_or(directory).to_owned();
        let total = system.number(format!("{directory}/event")).ok().map(|total| total as u32);
        let refuse = |reason| Err(NoInterrupt::Rearm { device: device.clone(), reason });
        match write_enable(&file) {
            Ok(()) => return Ok(Self { file, rearm: Rearm::Write, total }),
            Err(error) => match error.raw_os_error() {
                Some(libc::EIO) => return Err(NoInterrupt::NoLine(device)),
                Some(libc::ENOSYS) => {}
                _ => return refuse(error.to_string()),
            },
        }
        let config = open_config(system, directory).and_then(|config| unmask(&config).map(|()| config));
        match config {
            Ok(config) => Ok(Self { file, rearm: Rearm::Config(config), total }),
            Err(error) => refuse(config_refused(system, directory, &error)),
        }
    }

    /// Readable when an interrupt has come.
    pub(in crate::device) fn file(&self) -> &File {
        &self.file
    }

    /// The total when it was opened.
    pub(in crate::device) fn total(&self) -> Option<u32> {
        self.total
    }

    /// Reads the count and arms the next interrupt.
    pub(in crate::device) fn read(&mut self) -> Count {
        match read_count(&self.file) {
            Ok(None) => Count::Nothing,
            Ok(Some(total)) => match self.arm() {
                Ok(()) => Count::Total(total),
                Err(_) => Count::Last(total),
            },
            Err(_) => Count::Gone,
        }
    }

    fn arm(&self) -> io::Result<()> {
        match &self.rearm {
            Rearm::Write => write_enable(&self.file),
            Rearm::Config(config) => unmask(config),
        }
    }
}

fn write_enable(mut file: &File) -> io::Result<()> {
    file.write_all(&1u32.to_ne_bytes())
}

/// Clears only INTx-disable in the device's command register.
fn unmask(config: &File) -> io::Result<()> {
    let mut command = [0; 2];
    config.read_exact_at(&mut command, PCI_COMMAND)?;
    let command = u16::from_le_bytes(command);
    if command & INTX_DISABLE != 0 {
        config.write_all_at(&(command & !INTX_DISABLE).to_le_bytes(), PCI_COMMAND)?;
    }
    Ok(())
}

/// The total; `None` when no interrupt came since the last read. The kernel returns all four bytes or none.
fn read_count(mut file: &File) -> io::Result<Option<u32>> {
    let mut count = [0; 4];
    loop {
        return match file.read(&mut count) {
            Ok(4) => Ok(Some(u32::from_ne_bytes(count))),
            Ok(_) => Err(io::ErrorKind::UnexpectedEof.into()),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => Ok(None),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Err(error) => Err(error),
        };
    }
}

fn config_path(directory: &str) -> PathBuf {
    PathBuf::from(format!("{directory}/device/config"))
}

fn open_config(system: &System, directory: &str) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.read(true).write(true).custom_flags(libc::O_CLOEXEC);
    options.open(system.path(config_path(directory)))
}

/// Why INTx cannot be unmasked through sysfs, and what to do.
fn config_refused(system: &System, directory: &str, error: &io::Error) -> String {
    let path = system.path(config_path(directory));
    let why = match (error.raw_os_error(), Lockdown::of(system).mode()) {
        (Some(libc::EPERM), Some(mode)) => {
            format!(
                "the kernel is locked down (mode {mode}), which forbids writing it; replies are polled for"
            )
        }
        (Some(libc::EACCES), _) => format!(
            "this user may not write it ({}); have /usr/lib/pmacd/pci-prepare give it to user pmacd alone before the \
            start (drop-in pci.conf)",
            allowed(&path).unwrap_or_default()
        ),
        (Some(libc::EROFS), _) => {
            "it is read-only for the service; name the device's directory in ReadWritePaths=".to_owned()
        }
        _ => error.to_string(),
    };
    format!("its driver takes no re-arm by write (ENOSYS, as uio_pci_generic), and {}: {why}", path.display())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::testing::FakeSystem;
    use std::os::fd::OwnedFd;
    use std::os::unix::net::UnixStream;

    const DIRECTORY: &str = "/sys/class/uio/uio0";

    /// A device with an `irqcontrol`; the other end receives what the host writes.
    fn armed(fake: &FakeSystem) -> (UnixStream, UioInterrupt) {
        let (driver, node) = UnixStream::pair().unwrap();
        node.set_nonblocking(true).unwrap();
        let file = File::from(OwnedFd::from(node));
        (driver, UioInterrupt::new(&fake.system, DIRECTORY, file).unwrap())
    }

    fn enables(driver: &mut UnixStream) -> usize {
        driver.set_nonblocking(true).unwrap();
        let mut bytes = [0; 64];
        let count = driver.read(&mut bytes).unwrap_or(0);
        assert!(bytes[..count].chunks(4).all(|word| word == 1u32.to_ne_bytes()));
        count / 4
    }

    fn config_of(fake: &FakeSystem) -> u16 {
        let bytes = std::fs::read(fake.path("sys/class/uio/uio0/device/config")).unwrap();
        u16::from_le_bytes([bytes[4], bytes[5]])
    }

    #[test]
    fn each_count_is_followed_by_a_re_arm() {
        let fake = FakeSystem::new();
        fake.uio(0, "pmac-dpram", 0xD4000, 0x4000, 0, 16);
        fake.file("sys/class/uio/uio0/event", "41\n");
        let (mut driver, mut interrupt) = armed(&fake);
        assert_eq!(interrupt.total(), Some(41));
        assert_eq!(enables(&mut driver), 1);
        assert!(matches!(interrupt.read(), Count::Nothing));
        assert_eq!(enables(&mut driver), 0);
        driver.write_all(&42u32.to_ne_bytes()).unwrap();
        assert!(matches!(interrupt.read(), Count::Total(42)));
        assert_eq!(enables(&mut driver), 1);
        drop(driver);
        assert!(matches!(interrupt.read(), Count::Gone));
    }

    #[test]
    fn intx_is_unmasked_and_nothing_else_in_the_command_register() {
        let fake = FakeSystem::new();
        fake.uio(0, "uio_pci_generic", 0xFEBF_0000, 0x4000, 0, 16);
        fake.memory("sys/class/uio/uio0/device/config", 64);
        let config = open_config(&fake.system, DIRECTORY).unwrap();
        let set = |command: u16| {
            let file = open_config(&fake.system, DIRECTORY).unwrap();
            file.write_all_at(&command.to_le_bytes(), PCI_COMMAND).unwrap();
        };
        for (before, after) in [(0x0507, 0x0107), (0x0103, 0x0103), (0xFFFF, 0xFBFF)] {
            set(before);
            unmask(&config).unwrap();
            assert_eq!(config_of(&fake), after);
        }
    }

    #[test]
    fn what_keeps_intx_masked_is_told_apart() {
        let fake = FakeSystem::new();
        let why = |errno| config_refused(&fake.system, DIRECTORY, &io::Error::from_raw_os_error(errno));
        assert!(why(libc::EACCES).contains("may not write it"));
        assert!(why(libc::EROFS).contains("ReadWritePaths"));
        fake.file("sys/kernel/security/lockdown", "none [integrity] confidentiality");
        assert!(why(libc::EPERM).contains("locked down (mode integrity)"));
    }
}
