//! Downloads of program files. The daemon runs the lines as one sequence, and closes a buffer that they leave open.

use std::cell::Cell;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Weak};

use pmac_dpram::client::command::lines::LinesOptions;
use pmac_dpram::language::deadlines;
use pmac_dpram::preprocess::preprocess;
use pmac_dpram::protocol::board::RunLinesReply;

use crate::device::{Device, lock};
use crate::fault::Fault;
use crate::process::{with, with_any};

/// The program's callbacks.
pub(crate) trait Told {
    /// A line for the program's user.
    fn message(&self, text: &str);
    /// How much is done, in percent.
    fn progress(&self, percent: i32);
}

/// A download, which `PmacAbortDownload` ends from here on.
pub(crate) struct Download {
    number: u32,
    is_aborted: Arc<AtomicBool>,
}

impl Download {
    pub(crate) fn new(number: u32) -> Self {
        let is_aborted = Arc::default();
        // Without the device, the download itself fails and tells.
        let _ = with(number, |device| {
            let mut downloads = lock(&device.downloads);
            downloads.retain(|download| download.strong_count() > 0);
            downloads.push(Arc::downgrade(&is_aborted));
            Ok(())
        });
        Self { number, is_aborted }
    }

    /// Sends the lines of a file, with names and includes resolved, or only checks the file. Ends with the first line
    /// that the board refuses.
    pub(crate) fn run(&self, file: Option<Vec<u8>>, sends: bool, told: &impl Told) -> Result<(), Fault> {
        let done = with(self.number, |device| self.send(device, file, sends, told));
        if let Err(fault) = &done {
            told.message(&fault.why);
        }
        done
    }

    fn goes_on(&self) -> bool {
        !self.is_aborted.load(Ordering::Relaxed)
    }

    fn send(
        &self,
        device: &Device,
        file: Option<Vec<u8>>,
        sends: bool,
        told: &impl Told,
    ) -> Result<(), Fault> {
        let file = file.ok_or_else(|| Fault::argument("the file's name is NULL"))?;
        let file = PathBuf::from(String::from_utf8_lossy(&file).into_owned());
        let read = |path: &Path| fs::read(path).map_err(|error| error.to_string());
        let lines = preprocess(&[file], &read).map_err(|mistakes| {
            let text: Vec<String> = mistakes.iter().map(ToString::to_string).collect();
            Fault::argument(text.join("\n"))
        })?;
        told.progress(0);
        if sends && !lines.is_empty() {
            drop(device.turn()?);
            if !self.goes_on() {
                return Err(Fault::refused("the download was aborted; nothing was sent"));
            }
            let texts: Vec<&str> = lines.iter().map(|line| line.text.as_str()).collect();
            let mut failed = None;
            // How many lines the board has taken, once the daemon has answered.
            let heard = Cell::new(None);
            let options = LinesOptions { kind: "download", timeout: deadlines::PLAIN * 2, keep_going: false };
            let mut hear = |reply: &RunLinesReply| {
                let line = reply.line.and_then(|line| lines.get(usize::try_from(line).ok()?));
                if let (Some(failure), Some(line)) = (&reply.failure, line) {
                    failed = Some(format!("{}: {}: {}", line.place, failure.message, line.text));
                }
                heard.set(usize::try_from(reply.taken).ok());
                reply.lines.iter().for_each(|line| told.message(line));
                let percent = 100 * reply.taken / lines.len() as u64;
                told.progress(i32::try_from(percent).unwrap_or(100));
                self.goes_on()
            };
            let over = device.ask_while(
                || heard.get().is_none(),
                |connection| connection.run_lines(options, &texts, &mut hear),
            );
            if let Some(failed) = failed {
                let rest = over.err().map_or(String::new(), |fault| format!("; {}", fault.why));
                return Err(Fault::refused(failed + &rest));
            }
            let over = over.map_err(|fault| fault.after(heard.get().unwrap_or(0), lines.len(), "lines"))?;
            let notes = over.notes.join("; ");
            if over.taken < lines.len() as u64 {
                let (taken, all) = (over.taken, lines.len());
                return Err(Fault::refused(format!("the board has taken {taken} of {all} lines; {notes}")));
            }
            over.notes.iter().for_each(|note| told.message(note));
        }
        told.progress(100);
        Ok(())
    }
}

/// Ends the downloads after the call under way, which has eight lines at most.
pub(crate) fn abort(number: u32) -> Result<(), Fault> {
    with_any(number, |device| {
        for download in lock(&device.downloads).iter().filter_map(Weak::upgrade) {
            download.store(true, Ordering::Relaxed);
        }
        Ok(())
    })
}
