//! Where the log goes: to stderr, by a thread of its own.
//!
//! Whoever reads stderr may stop reading: a pager, a stopped service manager. A thread that logs must not wait for it,
//! least of all the bus thread. So lines go into a bounded queue; what finds no room is dropped, and counted. The thread
//! starts when the program has become who it shall be; until then lines wait in the queue.

use std::io::{self, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::time::Duration;

/// Lines that may wait.
const LINES: usize = 1024;
/// How long the end of the program waits for the lines that are left.
const LAST_WORDS: Duration = Duration::from_millis(500);

/// A line, or the wish to know when all lines before it are written.
enum Entry {
    Line(Vec<u8>),
    Flushed(SyncSender<()>),
}

/// The end that takes lines. Never waits.
#[derive(Clone)]
pub struct LogSink {
    entries: SyncSender<Entry>,
    dropped: Arc<AtomicU64>,
}

impl LogSink {
    /// The end that takes lines, and the one that will write them to `target`. `prefix` begins the lines of its own.
    pub fn new(target: impl Write + Send + 'static, prefix: &'static str) -> (Self, LogWriter) {
        let (entries, queue) = sync_channel(LINES);
        let sink = Self { entries, dropped: Arc::default() };
        let dropped = Arc::clone(&sink.dropped);
        let run = Box::new(move || write_all(&queue, &dropped, target, prefix));
        (sink, LogWriter { run: Some(run) })
    }

    /// Waits until everything logged so far is written, but not for long.
    pub fn finish(&self) {
        let (written, all) = sync_channel(1);
        if self.entries.try_send(Entry::Flushed(written)).is_ok() {
            let _: Result<(), RecvTimeoutError> = all.recv_timeout(LAST_WORDS);
        }
    }
}

/// The end that writes, in a thread of its own once it is started.
pub struct LogWriter {
    run: Option<Box<dyn FnOnce() + Send>>,
}

impl LogWriter {
    /// Starts the thread, unless it runs already.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn start(&mut self) -> io::Result<()> {
        let Some(run) = self.run.take() else { return Ok(()) };
        std::thread::Builder::new().name("log".to_owned()).spawn(run).map(drop)
    }
}

impl Write for LogSink {
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        if let Err(TrySendError::Full(_)) = self.entries.try_send(Entry::Line(line.to_vec())) {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn write_all(queue: &Receiver<Entry>, dropped: &AtomicU64, mut target: impl Write, prefix: &str) {
    // Nobody can be told that the log cannot be written.
    for entry in queue {
        match entry {
            Entry::Line(line) => drop(target.write_all(&line)),
            Entry::Flushed(written) => drop(written.try_send(())),
        }
        match dropped.swap(0, Ordering::Relaxed) {
            0 => {}
            lines => drop(writeln!(target, "{prefix}{lines} log lines were dropped: nobody read the log")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;
    use std::time::Instant;

    #[test]
    fn a_reader_that_stops_costs_lines_and_no_time() {
        let (mut reader, pipe) = io::pipe().unwrap();
        let (mut sink, mut writer) = LogSink::new(pipe, "[WARN ] ");
        writer.start().unwrap();
        let began = Instant::now();
        for _ in 0..4 * LINES {
            sink.write_all(&[b'x'; 200]).unwrap();
        }
        sink.finish();
        assert!(began.elapsed() < Duration::from_secs(5), "nobody waited for the reader");
        drop(sink);
        let mut text = String::new();
        reader.read_to_string(&mut text).unwrap();
        assert!(text.contains("log lines were dropped"));
    }

    #[test]
    fn the_last_words_are_written_before_the_end() {
        let (mut reader, pipe) = io::pipe().unwrap();
        let (mut sink, mut writer) = LogSink::new(pipe, "");
        sink.write_all(b"stopping\n").unwrap();
        writer.start().unwrap();
        writer.start().unwrap();
        sink.finish();
        let mut text = [0; 9];
        reader.read_exact(&mut text).unwrap();
        assert_eq!(&text, b"stopping\n");
    }
}
