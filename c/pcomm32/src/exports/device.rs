//! Opening, closing, locking, errors.

use std::ffi::c_char;

use super::{BOOL, DWORD, FALSE, Pointer, TRUE, int, truth, wide};
use crate::border::{Room, exports};
use crate::{device, fault, process};

exports! {
    /// Opens the device: TRUE if its daemon answers.
    OpenPmacDevice(number: DWORD) -> BOOL = FALSE => truth(process::with_any(number, device::Device::open));
    /// Closes the device.
    ClosePmacDevice(number: DWORD) -> BOOL = FALSE => truth(process::with(number, |device| {
        device.close();
        Ok(())
    }));
    /// The configured device, without a dialog.
    PmacSelect(_window: Pointer) -> wide = 0 => process::config().map_or(0, |config| config.select as usize);
    /// How many devices the configuration names.
    DrvNumberOfDevices() -> int = 0 => device::configured();
    /// There is nothing to configure by a dialog.
    PmacConfigure(_window: Pointer, number: DWORD) -> BOOL = FALSE => {
        fault::lacks(Some(number), "PmacConfigure");
        FALSE
    };
    /// The calls of other threads wait, but for stops.
    LockPmac(number: DWORD) -> () = () => drop(process::with(number, device::Device::hold));
    /// Ends `LockPmac`.
    ReleasePmac(number: DWORD) -> () = () => drop(process::with(number, device::Device::release));
    /// The number of this thread's last error with the device; 0: none.
    PmacGetError(number: DWORD) -> int = -3 => fault::last(number).map_or(0, |fault| fault.number());
    /// The text of that error. Returns its length.
    PmacGetErrorStrA(number: DWORD, room: Room<c_char>, max: int) -> int = 0 => {
        let text = fault::last(number).map_or(String::new(), |fault| fault.why);
        room.put(usize::try_from(max).unwrap_or(0), text.as_bytes()) as int
    };
    /// Whether a program buffer of this process is open.
    InBufferedMode(number: DWORD) -> BOOL = FALSE => match process::with(number, |device| Ok(device.has_open_buffer())) {
        Ok(true) => TRUE,
        _ => FALSE,
    };
}
