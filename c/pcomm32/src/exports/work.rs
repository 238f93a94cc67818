//! Rotary buffers, downloads, texts and callbacks.

use std::ffi::c_char;

use super::{BOOL, DWORD, FALSE, TRUE, int, truth};
use crate::border::{Place, Room, Text, exports};
use crate::download::{self, Download, Told};
use crate::{process, rotary, status, texts};

/// A buffer's number; a number that no board has for one that is none.
fn buffer(index: DWORD) -> u16 {
    u16::try_from(index).unwrap_or(u16::MAX)
}

/// Text for the program's user, and whether a line ends with it.
type DOWNLOADMSGPROC = Option<extern "C" fn(text: *const c_char, newline: BOOL)>;
/// A line of the file in place of the file: no public source tells how.
type DOWNLOADGETPROC = Option<extern "C" fn(index: int, room: *mut c_char, max: int) -> BOOL>;
/// How much is done, in percent.
type DOWNLOADPROGRESS = Option<extern "C" fn(percent: int)>;

/// Callbacks of a download, or none.
struct Callbacks(DOWNLOADMSGPROC, DOWNLOADPROGRESS);

impl Told for Callbacks {
    fn message(&self, text: &str) {
        let mut bytes = text.as_bytes().to_vec();
        bytes.retain(|byte| *byte != 0);
        bytes.push(0);
        if let Some(told) = self.0 {
            told(bytes.as_ptr().cast(), TRUE);
        }
    }

    fn progress(&self, percent: int) {
        if let Some(told) = self.1 {
            told(percent);
        }
    }
}

fn run(download: &Download, callbacks: &Callbacks, file: Option<Vec<u8>>, sends: BOOL) -> int {
    int::from(download.run(file, sends != FALSE, callbacks).is_ok())
}

/// What a callback gets: the vendor's `INTRBUFFER`.
#[repr(C)]
pub struct IntrBuffer {
    data: *mut c_char,
    length: u32,
    kind: DWORD,
}

/// The program's own number comes back in `message`.
type PMACINTRPROC = Option<extern "C" fn(message: DWORD, buffer: *mut IntrBuffer)>;

fn call_back(number: DWORD, procedure: PMACINTRPROC, message: DWORD, mask: DWORD) -> BOOL {
    let Some(procedure) = procedure else { return FALSE };
    let told = move |text: &[u8]| {
        let mut bytes = [text, &[0]].concat();
        let length = u32::try_from(text.len()).unwrap_or(0);
        procedure(message, &mut IntrBuffer { data: bytes.as_mut_ptr().cast(), length, kind: 0 });
    };
    truth(texts::call_back(number, mask, told))
}

exports! {
    /// Announces a rotary buffer; 0 feeds coordinate system 1. The daemon's configuration has its size.
    PmacDPRRotBufChange(number: DWORD, index: u16, _size: u16) -> i16 = rotary::SYNTAX => rotary::announce(number, index);
    /// As `PmacDPRRotBufChange`.
    PmacDPRRotBufInit(number: DWORD, index: u16) -> i16 = rotary::SYNTAX => rotary::announce(number, index);
    /// Ends the stream; a program that the board has not got whole ends, too.
    PmacDPRRotBufRemove(number: DWORD, index: u16) -> i16 = rotary::SYNTAX => rotary::remove(number, index);
    /// Ends the stream, and keeps the buffer.
    PmacDPRRotBufClr(number: DWORD, index: DWORD) -> () = () => {
        rotary::clear(number, buffer(index));
    };
    /// The number of rotary buffers.
    PmacDPRBufLast(number: DWORD) -> int = 0 => rotary::last(number).unwrap_or(0);
    /// The stream itself opens and closes the rotary buffers.
    PmacDPRRotBuf(number: DWORD, _on: BOOL) -> i16 = rotary::SYNTAX => match rotary::last(number) {
        Ok(_) => rotary::OK,
        Err(_) => rotary::SYNTAX,
    };
    /// A line of the motion program; "" sends what waits. 0 in, 1 no room yet, negative: an error.
    PmacDPRAsciiStrToRotA(number: DWORD, text: Text, index: u16) -> i16 = rotary::SYNTAX =>
        rotary::line(number, index, text.copy().as_deref());
    /// As `PmacDPRAsciiStrToRotA`.
    PmacDPRAsciiStrToRotEx(number: DWORD, text: Text, index: u16, _rest: BOOL) -> i16 = rotary::SYNTAX =>
        rotary::line(number, index, text.copy().as_deref());
    /// Commands of two longs each: 0 in, 1 no room yet, -1 an error.
    PmacDPRrotput(number: DWORD, count: int, longs: Place<DWORD>, index: int) -> i16 = -1 => {
        // The longest line that any buffer holds.
        let count = usize::try_from(count).unwrap_or(0).min(4096);
        rotary::words(number, buffer(index as DWORD), longs.copy(count).filter(|longs| !longs.is_empty()))
    };

    /// Sends a program file: 1, or 0 after a failure. Callbacks may be NULL; map and log files are not written.
    PmacDownloadA(
        number: DWORD, message: DOWNLOADMSGPROC, _get: DOWNLOADGETPROC, progress: DOWNLOADPROGRESS, file: Text,
        _macro: BOOL, _map: BOOL, _log: BOOL, sends: BOOL
    ) -> int = 0 => run(&Download::new(number), &Callbacks(message, progress), file.copy(), sends);
    /// As `PmacDownloadA`, in a thread: 1 if the thread has begun.
    PmacThreadDownloadA(
        number: DWORD, message: DOWNLOADMSGPROC, _get: DOWNLOADGETPROC, progress: DOWNLOADPROGRESS, file: Text,
        _macro: BOOL, _map: BOOL, _log: BOOL, sends: BOOL
    ) -> int = 0 => {
        let (download, callbacks, file) = (Download::new(number), Callbacks(message, progress), file.copy());
        let work = move || {
            run(&download, &callbacks, file, sends);
        };
        int::from(process::spawn("pcomm32-download", work).is_ok())
    };
    /// As `PmacDownloadA`, without callbacks.
    PmacDownloadFile(number: DWORD, file: Text) -> () = () => {
        run(&Download::new(number), &Callbacks(None, None), file.copy(), TRUE);
    };
    /// Ends the downloads: each sends seven more lines at most after the line under way.
    PmacAbortDownload(number: DWORD) -> () = () => drop(download::abort(number));

    /// Whether a text of a board's program waits, since the first such call.
    USReadReady(number: DWORD) -> BOOL = FALSE => BOOL::from(texts::is_ready(number).unwrap_or(false));
    /// The next text of a board's program.
    GetUSResponse(number: DWORD, room: Room, max: DWORD) -> BOOL = FALSE => match texts::next(number) {
        Ok(text) => BOOL::from(room.put(max as usize, &text) > 0),
        Err(_) => {
            room.put(max as usize, b"");
            FALSE
        }
    };
    /// Calls back from a thread with the texts of the board's programs, if the mask has their interrupt.
    PmacINTRFuncCallInit(number: DWORD, procedure: PMACINTRPROC, message: DWORD, mask: DWORD) -> BOOL = FALSE =>
        call_back(number, procedure, message, mask);
    /// Ends the callbacks.
    PmacINTRTerminate(number: DWORD) -> BOOL = FALSE => truth(texts::no_call_back(number));
    /// The daemon reads the board's variables in the background: TRUE.
    PmacDPRBackGroundVar(number: DWORD, _on: BOOL) -> BOOL = FALSE => truth(status::is_used(number, "ascii", false));
}
