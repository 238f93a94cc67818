//! Gathered data as comma-separated text: a line of names with units, then one line a sample.

use std::io::{self, Write};

use super::{Column, SampleClock};

/// Writes samples as text. Times are in whole nanoseconds; every other number is the shortest text that reads back as the
/// same f64.
pub struct CsvWriter<W> {
    out: W,
    clock: SampleClock,
}

impl<W: Write> CsvWriter<W> {
    /// Writes the line of names: `sample`, `time_s` (`servo_cycle` while I10 is not known), the columns' titles.
    ///
    /// # Errors
    /// What `out` reports.
    pub fn new(mut out: W, columns: &[Column], clock: SampleClock) -> io::Result<Self> {
        write!(out, "sample,{}", clock.title())?;
        for column in columns {
            write!(out, ",{}", quoted(&column.title()))?;
        }
        writeln!(out)?;
        Ok(Self { out, clock })
    }

    /// Writes one sample. Lost ones are missing lines: the sample number jumps.
    ///
    /// # Errors
    /// What the output reports.
    pub fn row(&mut self, sample: u64, values: &[f64]) -> io::Result<()> {
        let time = format!("{:.9}", self.clock.at(sample));
        write!(self.out, "{sample},{}", time.trim_end_matches('0').trim_end_matches('.'))?;
        for value in values {
            write!(self.out, ",{value}")?;
        }
        writeln!(self.out)
    }

    /// What it writes to.
    pub fn output(&mut self) -> &mut W {
        &mut self.out
    }

    /// Flushes and gives the output back.
    ///
    /// # Errors
    /// What the output reports.
    pub fn finish(mut self) -> io::Result<W> {
        self.out.flush()?;
        Ok(self.out)
    }
}

fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::super::column::tests::{columns, scales};
    use super::*;

    #[test]
    fn times_end_at_the_nanosecond() {
        let times = |servo_period_ns, samples: &[u64]| -> Vec<String> {
            let clock = SampleClock { period: 1, servo_period_ns };
            let mut writer = CsvWriter::new(Vec::new(), &[], clock).unwrap();
            samples.iter().for_each(|&sample| writer.row(sample, &[]).unwrap());
            let text = String::from_utf8(writer.finish().unwrap()).unwrap();
            text.lines().skip(1).map(|line| line.split_once(',').unwrap().1.to_owned()).collect()
        };
        let written = times(Some(442_708.373_069_763_2), &[0, 1, 1000, 10_000_000]);
        assert_eq!(written, ["0", "0.000442708", "0.442708373", "4427.083730698"]);
        assert_eq!(times(None, &[0, 10, 100]), ["0", "10", "100"]);
    }

    #[test]
    fn names_units_and_gaps() {
        let columns = columns(&["1.actual_position", "X:$0033,u"], &scales());
        let clock = SampleClock { period: 2, servo_period_ns: Some(500_000.0) };
        let mut writer = CsvWriter::new(Vec::new(), &columns, clock).unwrap();
        writer.row(0, &[-5.25, 8_388_608.0]).unwrap();
        writer.row(7, &[0.1, 0.0]).unwrap();
        let text = String::from_utf8(writer.finish().unwrap()).unwrap();
        assert_eq!(
            text,
            "sample,time_s,1.actual_position [count],\"X:$0033,u\"\n0,0,-5.25,8388608\n7,0.007,0.1,0\n"
        );
    }
}
