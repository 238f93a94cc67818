//! The devices of each process. A forked child has devices of its own: a thread of the parent may have locked the
//! parent's, and the connections are the parent's, too.

use std::{io, thread};

use nix::sys::signal::{SigSet, SigmaskHow, Signal};

use crate::border::Once;
use crate::config::{Config, DEVICES};
use crate::device::Device;
use crate::fault::{self, Fault};

/// The devices of one process.
struct Devices {
    process: u32,
    config: Result<Config, String>,
    devices: [Device; DEVICES],
    /// Those of a child.
    child: Once<Self>,
}

static FIRST: Once<Devices> = Once::new();

impl Devices {
    /// The devices of this process; a child's are open where its parent's were.
    fn new(parent: Option<&Self>) -> Self {
        let devices = std::array::from_fn(|number| {
            Device::new(number, parent.is_some_and(|parent| parent.devices[number].is_open()))
        });
        Self { process: std::process::id(), config: Config::read(), devices, child: Once::new() }
    }

    fn of_this_process() -> &'static Self {
        // No thread waits for another one here, so what a fork has copied stops nobody.
        let mut devices = FIRST.get_or_make(|| Self::new(None));
        while devices.process != std::process::id() {
            devices = devices.child.get_or_make(|| Self::new(Some(devices)));
        }
        devices
    }
}

/// Runs `work` in a thread of this library. Signals go to the program's own threads, but for those of a fault, which are
/// the thread's own.
pub(crate) fn spawn(name: &str, work: impl FnOnce() + Send + 'static) -> io::Result<()> {
    let mut signals = SigSet::all();
    [Signal::SIGSEGV, Signal::SIGBUS, Signal::SIGFPE, Signal::SIGILL, Signal::SIGABRT, Signal::SIGTRAP]
        .into_iter()
        .for_each(|fault| signals.remove(fault));
    let before = signals.thread_swap_mask(SigmaskHow::SIG_BLOCK)?;
    let spawned = thread::Builder::new().name(name.to_owned()).spawn(work);
    // The mask is this thread's own, so the kernel takes it back.
    let _ = before.thread_set_mask();
    spawned.map(drop)
}

/// The configuration of this process.
pub(crate) fn config() -> Result<&'static Config, Fault> {
    Devices::of_this_process().config.as_ref().map_err(|why| Fault::argument(why.clone()))
}

/// Does `work` for the device of this number, open or not. Keeps the outcome for `PmacGetError`.
pub(crate) fn with_any<T>(
    number: u32,
    work: impl FnOnce(&'static Device) -> Result<T, Fault>,
) -> Result<T, Fault> {
    let devices = &Devices::of_this_process().devices;
    let device = devices.get(number as usize);
    let device =
        device.ok_or_else(|| Fault::argument(format!("device {number}: there are 0 to {}", DEVICES - 1)));
    let done = device.and_then(work);
    fault::keep(number, done.as_ref().err());
    done
}

/// As [`with_any`], for a device that must be open.
pub(crate) fn with<T>(
    number: u32,
    work: impl FnOnce(&'static Device) -> Result<T, Fault>,
) -> Result<T, Fault> {
    with_any(number, |device| match device.is_open() {
        true => work(device),
        false => Err(Fault::argument(format!("device {number} is not open: call OpenPmacDevice first"))),
    })
}
