//! The file of `pmacctl gather`, CSV or NumPy. After an error it holds the samples before it, and their number.

use std::io::{self, Write};

use crate::cli::console::sink::Rows;
use crate::cli::context::Failure;
use crate::gather::{Column, CsvWriter, NpyWriter, SampleClock};

/// Writes samples to a file.
pub struct Writer {
    form: Form,
    samples: u64,
    /// Whether an error has been returned.
    failed: bool,
}

enum Form {
    Csv(CsvWriter<Rows>),
    Npy(NpyWriter<Rows>),
}

impl Writer {
    /// Opens the file. It stays unchanged until the first samples are written.
    ///
    /// # Errors
    /// [`Failure`]. A NumPy file must be a regular file.
    pub fn new(rows: Rows, npy: bool, columns: &[Column], clock: SampleClock) -> Result<Self, Failure> {
        if npy && !rows.is_regular() {
            let error = io::Error::other(
                "not a regular file; .npy needs one, because its header gets the number of samples at the end; use .csv",
            );
            return Err(rows.failed(error));
        }
        let form = if npy {
            Form::Npy(NpyWriter::new(rows, columns, clock)?)
        } else {
            Form::Csv(CsvWriter::new(rows, columns, clock)?)
        };
        let mut writer = Self { form, samples: 0, failed: false };
        writer.rows().end_row()?;
        Ok(writer)
    }

    fn rows(&mut self) -> &mut Rows {
        match &mut self.form {
            Form::Csv(writer) => writer.output(),
            Form::Npy(writer) => writer.output(),
        }
    }

    /// Writes one sample.
    ///
    /// # Errors
    /// [`Failure`], with the number of samples in the file.
    pub fn row(&mut self, number: u64, values: &[f64]) -> Result<(), Failure> {
        let put = match &mut self.form {
            Form::Csv(writer) => writer.row(number, values),
            Form::Npy(writer) => writer.row(number, values),
        };
        self.samples += 1;
        put.and_then(|()| self.rows().end_row()).map_err(|error| self.cut_off(error))
    }

    /// Writes the rest, and the number of samples into the NumPy header.
    ///
    /// # Errors
    /// As [`Writer::row`], unless that has returned one already.
    pub fn finish(&mut self) -> Result<(), Failure> {
        if self.failed {
            return Ok(());
        }
        let put = self.rows().flush().and_then(|()| match &mut self.form {
            Form::Csv(_) => Ok(()),
            Form::Npy(writer) => writer.note(),
        });
        put.map_err(|error| self.cut_off(error))
    }

    /// Removes a new file to which nothing has been written.
    pub fn discard(&mut self) {
        self.rows().discard();
    }

    /// Saves what it can after `error`, and returns the error with the number of samples.
    fn cut_off(&mut self, error: io::Error) -> Failure {
        self.failed = true;
        // The first row is the header.
        let kept = self.rows().rows().saturating_sub(1);
        let noted = match &mut self.form {
            Form::Csv(_) => Ok(()),
            Form::Npy(writer) => {
                writer.keep(kept);
                writer.note()
            }
        };
        let kind = error.kind();
        if kind == io::ErrorKind::BrokenPipe {
            return Failure::Output(error);
        }
        let not_noted = if noted.is_err() { ", but its header does not say so" } else { "" };
        let text = format!("{error}; {kept} of {} samples are written, whole{not_noted}", self.samples);
        self.rows().failed(io::Error::new(kind, text))
    }
}
