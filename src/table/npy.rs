//! A table as a NumPy file, `.npy` version 1.0: one-dimensional, a structured element for each row. Its fields have the
//! type `<i8` for whole numbers and `<f8` for others. The field's title, which NumPy keeps beside the name, has the
//! unit.
//!
//! The header says how many elements follow, which the writer does not know before the end. So the header has room for
//! any number, and [`NpyWriter::note`] writes the present number into it: a reader can use a file that was cut off up
//! to there.

use std::io::{self, Seek, SeekFrom, Write};

use super::{Field, FieldKind};

pub(super) const MAGIC: &[u8; 8] = b"\x93NUMPY\x01\x00";
/// Digits of the largest u64.
const COUNT_DIGITS: usize = 20;
/// Magic, length and header together are a multiple of this.
const ALIGNMENT: usize = 64;

/// Writes rows as elements of a NumPy array.
pub struct NpyWriter<W> {
    out: W,
    kinds: Vec<FieldKind>,
    /// The header's text before the number of elements, and its length in all.
    dictionary: String,
    header_length: usize,
    elements: u64,
}

impl<W: Write + Seek> NpyWriter<W> {
    /// Writes the header of an empty array at the beginning of `out`.
    ///
    /// # Errors
    /// The error of `out`; [`io::ErrorKind::InvalidInput`] if the header would be longer than version 1.0 allows.
    pub fn new(out: W, fields: &[Field]) -> io::Result<Self> {
        let described: Vec<String> = fields
            .iter()
            .map(|field| {
                let name = quoted(&field.name);
                let format = if field.kind == FieldKind::Integer { "<i8" } else { "<f8" };
                if field.unit.is_empty() {
                    format!("({name}, '{format}')")
                } else {
                    format!("(({}, {name}), '{format}')", quoted(&field.title()))
                }
            })
            .collect();
        let dictionary = format!("{{'descr': [{}], 'fortran_order': False, 'shape': (", described.join(", "));
        // Behind the count: `,), }` and the newline.
        let unpadded = MAGIC.len() + 2 + dictionary.len() + COUNT_DIGITS + 6;
        let header_length = unpadded.next_multiple_of(ALIGNMENT) - MAGIC.len() - 2;
        if header_length > usize::from(u16::MAX) {
            return Err(io::Error::new(
                io::ErrorKind::InvalidInput,
                "too many columns for a NumPy 1.0 header",
            ));
        }
        let kinds = fields.iter().map(|field| field.kind).collect();
        let mut writer = Self { out, kinds, dictionary, header_length, elements: 0 };
        writer.header()?;
        Ok(writer)
    }

    /// Writes one row: a value a field. An unknown value is NaN.
    ///
    /// # Errors
    /// The output's error.
    pub fn row(&mut self, values: &[f64]) -> io::Result<()> {
        for (value, kind) in values.iter().zip(&self.kinds) {
            let bytes = match kind {
                FieldKind::Integer => (*value as i64).to_le_bytes(),
                FieldKind::Seconds | FieldKind::Real => value.to_le_bytes(),
            };
            self.out.write_all(&bytes)?;
        }
        self.elements += 1;
        Ok(())
    }

    /// The output.
    pub fn output(&mut self) -> &mut W {
        &mut self.out
    }

    /// Counts only the first `elements`, for an output that took no more.
    pub fn keep(&mut self, elements: u64) {
        self.elements = elements;
    }

    /// Writes the present number of elements into the header, and goes on at the end.
    ///
    /// # Errors
    /// The output's error.
    pub fn note(&mut self) -> io::Result<()> {
        self.out.seek(SeekFrom::Start(0))?;
        self.header()?;
        self.out.seek(SeekFrom::End(0))?;
        self.out.flush()
    }

    /// Writes the number of elements and returns the output.
    ///
    /// # Errors
    /// The output's error.
    pub fn finish(mut self) -> io::Result<W> {
        self.note()?;
        Ok(self.out)
    }

    fn header(&mut self) -> io::Result<()> {
        let text = format!("{}{},), }}", self.dictionary, self.elements);
        self.out.write_all(MAGIC)?;
        self.out.write_all(&(self.header_length as u16).to_le_bytes())?;
        writeln!(self.out, "{text:width$}", width = self.header_length - 1)
    }
}

fn quoted(text: &str) -> String {
    format!("'{}'", text.replace('\\', "\\\\").replace('\'', "\\'"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    fn header(bytes: &[u8]) -> (&str, &[u8]) {
        assert_eq!(&bytes[..8], MAGIC);
        let length = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
        assert_eq!((10 + length) % 64, 0);
        let (header, data) = bytes[10..].split_at(length);
        (std::str::from_utf8(header).unwrap(), data)
    }

    fn fields() -> [Field; 3] {
        [
            Field::new("sample", "", FieldKind::Integer),
            Field::new("time_s", "", FieldKind::Seconds),
            Field::new("X:$0033,u", "count", FieldKind::Real),
        ]
    }

    #[test]
    fn a_structured_array_of_the_rows() {
        let mut writer = NpyWriter::new(Cursor::new(Vec::new()), &fields()).unwrap();
        writer.row(&[0.0, 0.0, 1.5]).unwrap();
        writer.note().unwrap();
        writer.row(&[7.0, 0.007, -1.0]).unwrap();
        let bytes = writer.finish().unwrap().into_inner();
        let (text, data) = header(&bytes);
        assert_eq!(
            text.trim_end_matches(' ').trim_end_matches('\n').trim_end(),
            "{'descr': [('sample', '<i8'), ('time_s', '<f8'), \
             (('X:$0033,u [count]', 'X:$0033,u'), '<f8')], 'fortran_order': False, 'shape': (2,), }"
        );
        assert!(text.ends_with('\n'));
        let words: Vec<_> = data.as_chunks::<8>().0.iter().map(|bytes| u64::from_le_bytes(*bytes)).collect();
        assert_eq!(data.len(), 2 * 3 * 8);
        assert_eq!((words[0], words[3]), (0, 7));
        let floats: Vec<_> = words.iter().map(|word| f64::from_bits(*word)).collect();
        assert_eq!((floats[2], floats[4], floats[5]), (1.5, 0.007, -1.0));
    }

    #[test]
    fn the_header_keeps_its_length_whatever_the_count() {
        let mut writer = NpyWriter::new(Cursor::new(Vec::new()), &fields()).unwrap();
        let empty = writer.out.get_ref().len();
        writer.elements = u64::MAX;
        writer.note().unwrap();
        let bytes = writer.out.into_inner();
        assert_eq!(bytes.len(), empty);
        assert!(header(&bytes).0.contains("(18446744073709551615,)"));
    }
}
