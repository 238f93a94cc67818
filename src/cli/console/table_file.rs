//! A file of rows, CSV or NumPy. After an error the file holds the rows before the error, and their number.

use std::io;
use std::path::Path;

use crate::cli::console::interrupt::Interrupt;
use crate::cli::console::sink::{Rows, is_taken};
use crate::cli::context::Failure;
use crate::table::{CsvWriter, Field, FileFormat, NpyWriter};

/// Writes rows to a file.
pub struct TableFile {
    writer: Writer,
    rows: u64,
    /// The error that the caller has got already.
    failed: Option<io::ErrorKind>,
}

enum Writer {
    Csv(CsvWriter<Rows>),
    Npy(NpyWriter<Rows>),
}

impl TableFile {
    /// Opens the file. It stays unchanged until the first rows are written.
    ///
    /// # Errors
    /// [`Failure`]. A NumPy file must be a regular file.
    pub fn open(path: &Path, fields: &[Field], stop: &Interrupt) -> Result<Self, Failure> {
        let format = format_of(path)?;
        Self::over(Rows::open(path, format == FileFormat::Csv, stop)?, format, fields)
    }

    /// As [`Self::open`], but only a new file; `None` where any file exists.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn create_new(path: &Path, fields: &[Field], stop: &Interrupt) -> Result<Option<Self>, Failure> {
        let format = format_of(path)?;
        let made = Rows::create_new(path, format == FileFormat::Csv, stop)?;
        made.map(|rows| Self::over(rows, format, fields)).transpose()
    }

    fn over(rows: Rows, format: FileFormat, fields: &[Field]) -> Result<Self, Failure> {
        if format == FileFormat::Npy && !rows.is_regular() {
            let error = io::Error::other(
                "not a regular file; .npy needs one, because its header gets the number of rows at the end; use .csv",
            );
            return Err(rows.failed(error));
        }
        let writer = match format {
            FileFormat::Csv => Writer::Csv(CsvWriter::new(rows, fields)?),
            FileFormat::Npy => Writer::Npy(NpyWriter::new(rows, fields)?),
        };
        let mut file = Self { writer, rows: 0, failed: None };
        file.output().end_row()?;
        Ok(file)
    }

    fn output(&mut self) -> &mut Rows {
        match &mut self.writer {
            Writer::Csv(writer) => writer.output(),
            Writer::Npy(writer) => writer.output(),
        }
    }

    /// Writes one row.
    ///
    /// # Errors
    /// [`Failure`], with the number of rows in the file.
    pub fn row(&mut self, values: &[f64]) -> Result<(), Failure> {
        let put = match &mut self.writer {
            Writer::Csv(writer) => writer.row(values),
            Writer::Npy(writer) => writer.row(values),
        };
        self.rows += 1;
        put.and_then(|()| self.output().end_row()).map_err(|error| self.cut_off(error))
    }

    /// The bytes in the file, and those still to be written.
    pub fn bytes(&mut self) -> u64 {
        self.output().bytes()
    }

    /// The number of whole rows in the file, without the head.
    pub fn kept(&mut self) -> u64 {
        self.output().rows().saturating_sub(1)
    }

    /// Goes on after a lack of room; `false` after any other error. The rows that found no room are lost.
    pub fn resume_full(&mut self) -> bool {
        use io::ErrorKind::{FileTooLarge, QuotaExceeded, StorageFull};
        let is_full = matches!(self.failed, Some(StorageFull | QuotaExceeded | FileTooLarge));
        if is_full {
            self.failed = None;
            self.rows = self.kept();
        }
        is_full
    }

    /// Writes the rest, and the number of rows into the NumPy header.
    ///
    /// # Errors
    /// As [`TableFile::row`], unless that has returned an error already.
    pub fn finish(&mut self) -> Result<(), Failure> {
        if self.failed.is_some() {
            return Ok(());
        }
        let put = io::Write::flush(self.output()).and_then(|()| match &mut self.writer {
            Writer::Csv(_) => Ok(()),
            Writer::Npy(writer) => writer.note(),
        });
        put.map_err(|error| self.cut_off(error))
    }

    /// Removes a new file to which nothing has been written.
    pub fn discard(&mut self) {
        self.output().discard();
    }

    /// Saves what fits after `error`, and returns the error with the number of rows.
    fn cut_off(&mut self, error: io::Error) -> Failure {
        self.failed = Some(error.kind());
        if is_taken(&error) {
            return self.output().failed(error);
        }
        let kept = self.kept();
        let noted = match &mut self.writer {
            Writer::Csv(_) => Ok(()),
            Writer::Npy(writer) => {
                writer.keep(kept);
                writer.note()
            }
        };
        let kind = error.kind();
        if kind == io::ErrorKind::BrokenPipe {
            return Failure::Output(error);
        }
        let not_noted = if noted.is_err() { ", but its header does not say so" } else { "" };
        let text = format!("{error}; {kept} of {} samples are written, whole{not_noted}", self.rows);
        self.output().failed(io::Error::new(kind, text))
    }
}

fn format_of(path: &Path) -> Result<FileFormat, Failure> {
    FileFormat::of(path).map_err(|why| Failure::Request(format!("{}: {why}", path.display())))
}
