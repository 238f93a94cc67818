//! The log. It never blocks the gateway, and clients cannot fill it.
//!
//! Lines wait in a bounded queue for the reader of stderr; the gateway drops and counts the lines that do not fit.
//! Before the queue each kind of line has a quota; the gateway drops and counts lines beyond it, too.

use std::io::{self, Write};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use log::{Level, LevelFilter, Log, Metadata, Record};
use pmac_dpram::process::log_sink::LogSink;

use crate::quota::Quota;

/// The log target of lines for commands that move or stop something.
pub const MOTION: &str = "motion";

/// Formats lines, and keeps their number within bounds.
struct Journal {
    lines: env_logger::Logger,
    /// Quotas: the gateway's own warnings, lines that clients cause, lines of [`MOTION`].
    quotas: Mutex<[Quota; 3]>,
}

/// Starts the log of this process, on stderr.
///
/// # Errors
/// The system cannot start a thread, or a log was started before.
pub fn start() -> io::Result<LogSink> {
    let (sink, mut writer) = LogSink::new(io::stderr(), "pmac-gateway: ");
    writer.start()?;
    let lines = env_logger::Builder::new()
        .filter_level(LevelFilter::Info)
        .format(|line, record| writeln!(line, "pmac-gateway: {}", record.args()))
        .target(env_logger::Target::Pipe(Box::new(sink.clone())))
        .build();
    let few = || Quota::new(20, Duration::from_secs(10));
    // `pmacd` logs every such command, within its own bounds.
    let motion = Quota::new(1000, Duration::from_millis(100));
    let journal = Journal { lines, quotas: Mutex::new([few(), few(), motion]) };
    log::set_boxed_logger(Box::new(journal)).map_err(io::Error::other)?;
    log::set_max_level(LevelFilter::Info);
    Ok(sink)
}

impl Log for Journal {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        self.lines.enabled(metadata)
    }

    fn log(&self, record: &Record<'_>) {
        let kind = match record.level() {
            _ if record.target() == MOTION => 2,
            Level::Error | Level::Warn => 0,
            _ => 1,
        };
        let mut quotas = self.quotas.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(left_out) = quotas[kind].take(Instant::now()) else { return };
        if left_out > 0 {
            let told = format_args!("{left_out} lines before this one were left out: there were too many");
            self.lines.log(&Record::builder().level(record.level()).args(told).build());
        }
        self.lines.log(record);
    }

    fn flush(&self) {}
}
