//! Writes the log to stderr in a thread of its own.
//!
//! The reader of stderr may stop (a pager, a stopped service manager). No thread that logs may wait for it, least of
//! all the bus thread. So lines go into a bounded queue, in pieces allocated at the start. A full queue drops lines and
//! counts them. Until the writing thread starts, lines wait in the queue: a program that changes its user starts the
//! thread afterwards.

use std::io::{self, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::time::{Duration, Instant};

/// The number of queued pieces, and their length. Most lines fit one piece.
const PIECES: usize = 1024;
const PIECE_BYTES: usize = 240;
/// Time limit for writing the remaining lines at the end of the program.
const LAST_WORDS: Duration = Duration::from_secs(2);
/// Period of the checks for room meanwhile.
const LOOK: Duration = Duration::from_millis(2);

/// A piece of a line, or a request to report when all earlier pieces are written.
#[expect(clippy::large_enum_variant, reason = "inline, so that logging allocates nothing")]
enum Entry {
    Piece { bytes: [u8; PIECE_BYTES], length: usize, begins: bool },
    Flushed(SyncSender<()>),
}

/// The sending end of the queue. It never waits.
#[derive(Clone)]
pub struct LogSink {
    entries: SyncSender<Entry>,
    dropped: Arc<AtomicU64>,
}

impl LogSink {
    /// Makes the sending end, and the end that writes to `target`. The sink's own lines start with `prefix`.
    pub fn new(target: impl Write + Send + 'static, prefix: &'static str) -> (Self, LogWriter) {
        let (entries, queue) = sync_channel(PIECES);
        let sink = Self { entries, dropped: Arc::default() };
        let dropped = Arc::clone(&sink.dropped);
        let run = Box::new(move || write_all(&queue, &dropped, target, prefix));
        (sink, LogWriter { run: Some(run) })
    }

    /// Waits until the thread has written all earlier lines, within a time limit.
    pub fn finish(&self) {
        let deadline = Instant::now() + LAST_WORDS;
        let (written, all) = sync_channel(1);
        let mut entry = Entry::Flushed(written);
        // A full queue has no room for the request either.
        while let Err(TrySendError::Full(back)) = self.entries.try_send(entry) {
            if Instant::now() >= deadline {
                return;
            }
            entry = back;
            std::thread::sleep(LOOK);
        }
        let left = deadline.saturating_duration_since(Instant::now());
        let _: Result<(), RecvTimeoutError> = all.recv_timeout(left);
    }
}

/// The writing end of the queue. [`Self::start`] gives it a thread.
pub struct LogWriter {
    run: Option<Box<dyn FnOnce() + Send>>,
}

impl LogWriter {
    /// Starts the thread, if it does not run yet.
    ///
    /// # Errors
    /// The system cannot start a thread.
    pub fn start(&mut self) -> io::Result<()> {
        let Some(run) = self.run.take() else { return Ok(()) };
        std::thread::Builder::new().name("log".to_owned()).spawn(run).map(drop)
    }
}

impl Write for LogSink {
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        // The logger writes whole lines, one thread at a time, so the pieces of a line stay together.
        for (number, piece) in line.chunks(PIECE_BYTES).enumerate() {
            let mut bytes = [0; PIECE_BYTES];
            bytes[..piece.len()].copy_from_slice(piece);
            let entry = Entry::Piece { bytes, length: piece.len(), begins: number == 0 };
            if let Err(TrySendError::Full(_)) = self.entries.try_send(entry) {
                self.dropped.fetch_add(1, Ordering::Relaxed);
                break;
            }
        }
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn write_all(queue: &Receiver<Entry>, dropped: &AtomicU64, mut target: impl Write, prefix: &str) {
    // Errors are ignored: there is no place left to report them.
    let mut in_line = false;
    for entry in queue {
        match entry {
            Entry::Piece { bytes, length, begins } => {
                if begins && in_line {
                    // The queue has dropped the rest of the previous line.
                    let _ = target.write_all(b"\n");
                }
                in_line = !bytes[..length].ends_with(b"\n");
                drop(target.write_all(&bytes[..length]));
            }
            Entry::Flushed(written) => drop(written.try_send(())),
        }
        if !in_line {
            match dropped.swap(0, Ordering::Relaxed) {
                0 => {}
                lines => drop(writeln!(
                    target,
                    "{prefix}{lines} log lines were dropped: the reader of the log was too slow"
                )),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;

    #[test]
    fn a_reader_that_stops_costs_lines_and_no_time() {
        let (mut reader, pipe) = io::pipe().unwrap();
        let (mut sink, mut writer) = LogSink::new(pipe, "[WARN ] ");
        writer.start().unwrap();
        let began = Instant::now();
        for _ in 0..4 * PIECES {
            sink.write_all(format!("{}\n", "x".repeat(200)).as_bytes()).unwrap();
        }
        sink.finish();
        assert!(began.elapsed() < Duration::from_secs(5), "nobody waited for the reader");
        drop(sink);
        let mut text = String::new();
        reader.read_to_string(&mut text).unwrap();
        assert!(text.contains("log lines were dropped"));
    }

    #[test]
    fn a_long_line_is_put_together_again() {
        let (mut reader, pipe) = io::pipe().unwrap();
        let (mut sink, mut writer) = LogSink::new(pipe, "");
        let line = format!("{}\n", "0123456789".repeat(100));
        sink.write_all(line.as_bytes()).unwrap();
        sink.write_all(b"next\n").unwrap();
        writer.start().unwrap();
        sink.finish();
        drop(sink);
        let mut text = String::new();
        reader.read_to_string(&mut text).unwrap();
        assert_eq!(text, line + "next\n");
    }

    /// Takes nothing until the test releases it.
    struct Held(Receiver<()>, Arc<AtomicU64>);

    impl Write for Held {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let _ = self.0.recv();
            self.1.fetch_add(1, Ordering::Relaxed);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn the_end_waits_for_the_lines_that_fill_the_queue() {
        let (let_go, held) = sync_channel::<()>(0);
        let written = Arc::new(AtomicU64::new(0));
        let (mut sink, mut writer) = LogSink::new(Held(held, Arc::clone(&written)), "");
        writer.start().unwrap();
        for _ in 0..PIECES + 2 {
            sink.write_all(b"line\n").unwrap();
        }
        let reader = std::thread::spawn(move || {
            std::thread::sleep(10 * LOOK);
            drop(let_go);
        });
        let began = Instant::now();
        sink.finish();
        // The thread writes all lines unless the reader was too slow.
        if began.elapsed() < LAST_WORDS {
            assert!(written.load(Ordering::Relaxed) >= PIECES as u64);
        }
        reader.join().unwrap();
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
