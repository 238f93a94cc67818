//! A table as comma-separated text: a line of names with units, then one line a row.

use std::io::{self, Write};

use super::{Field, FieldKind};

/// Writes rows as text.
pub struct CsvWriter<W> {
    out: W,
    kinds: Vec<FieldKind>,
}

impl<W: Write> CsvWriter<W> {
    /// Writes the line of names: the fields' titles.
    ///
    /// # Errors
    /// The output's error.
    pub fn new(mut out: W, fields: &[Field]) -> io::Result<Self> {
        for (index, field) in fields.iter().enumerate() {
            let comma = if index == 0 { "" } else { "," };
            write!(out, "{comma}{}", quoted(&field.title()))?;
        }
        writeln!(out)?;
        Ok(Self { out, kinds: fields.iter().map(|field| field.kind).collect() })
    }

    /// Writes one row: a value a field. An unknown value is NaN.
    ///
    /// # Errors
    /// The output's error.
    pub fn row(&mut self, values: &[f64]) -> io::Result<()> {
        for (index, (value, kind)) in values.iter().zip(&self.kinds).enumerate() {
            let comma = if index == 0 { "" } else { "," };
            match kind {
                FieldKind::Seconds if value.is_finite() => {
                    let time = format!("{value:.9}");
                    write!(self.out, "{comma}{}", time.trim_end_matches('0').trim_end_matches('.'))?;
                }
                _ => write!(self.out, "{comma}{value}")?,
            }
        }
        writeln!(self.out)
    }

    /// The output.
    pub fn output(&mut self) -> &mut W {
        &mut self.out
    }

    /// Flushes and returns the output.
    ///
    /// # Errors
    /// The output's error.
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
    use super::*;

    #[test]
    fn times_end_at_the_nanosecond() {
        let fields = [Field::new("time_s", "", FieldKind::Seconds)];
        let mut writer = CsvWriter::new(Vec::new(), &fields).unwrap();
        for time in [0.0, 0.000_442_708_373, 0.442_708_373_069_763_2, 4_427.083_730_697_632] {
            writer.row(&[time]).unwrap();
        }
        let text = String::from_utf8(writer.finish().unwrap()).unwrap();
        assert_eq!(text, "time_s\n0\n0.000442708\n0.442708373\n4427.083730698\n");
    }

    #[test]
    fn names_units_and_what_is_not_known() {
        let fields = [
            Field::new("sample", "", FieldKind::Integer),
            Field::new("1.actual_position", "count", FieldKind::Real),
            Field::new("X:$0033,u", "", FieldKind::Real),
        ];
        let mut writer = CsvWriter::new(Vec::new(), &fields).unwrap();
        writer.row(&[0.0, -5.25, 8_388_608.0]).unwrap();
        writer.row(&[7.0, 0.1, f64::NAN]).unwrap();
        let text = String::from_utf8(writer.finish().unwrap()).unwrap();
        assert_eq!(text, "sample,1.actual_position [count],\"X:$0033,u\"\n0,-5.25,8388608\n7,0.1,NaN\n");
    }
}
