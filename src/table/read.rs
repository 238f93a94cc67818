//! Reads a table from a file that [`super::CsvWriter`] or [`super::NpyWriter`] wrote.

use super::npy::MAGIC;
use super::{Field, FieldKind};
use crate::format::file_text;

/// Why a file holds no table.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ReadError {
    /// The file is empty.
    #[error("the file is empty")]
    Empty,
    /// No table: one line without a comma.
    #[error("no table: neither a NumPy file nor names and numbers between commas")]
    NoTable,
    /// The line, from 1, has another number of values than the head.
    #[error("line {line} has {found} values, the first line {expected} names")]
    Width {
        /// The line's number.
        line: usize,
        /// Values found.
        found: usize,
        /// Names in the head.
        expected: usize,
    },
    /// A value that is no number.
    #[error("line {line}: {text:?} is no number")]
    Number {
        /// The line's number.
        line: usize,
        /// The value.
        text: String,
    },
    /// A NumPy file of another kind.
    #[error("not a NumPy 1.0 file of named fields of 8 bytes, as gather and log write them")]
    Numpy,
}

/// A table in memory, field by field.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// The fields.
    pub fields: Vec<Field>,
    /// For each field its values, row by row.
    pub columns: Vec<Vec<f64>>,
}

impl Table {
    /// The table in the bytes of a file, CSV or NumPy.
    ///
    /// # Errors
    /// [`ReadError`]. Bytes after the last whole row are left out.
    pub fn parse(bytes: &[u8]) -> Result<Self, ReadError> {
        match bytes.strip_prefix(MAGIC) {
            Some(rest) => numpy(rest).ok_or(ReadError::Numpy),
            None => csv(&file_text::read(bytes).map_err(|_| ReadError::NoTable)?),
        }
    }

    /// The number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.columns.first().map_or(0, Vec::len)
    }

    /// The index of the field called `name`.
    #[must_use]
    pub fn index(&self, name: &str) -> Option<usize> {
        self.fields.iter().position(|field| field.name == name)
    }

    /// The values of the field called `name`.
    #[must_use]
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        self.columns.get(self.index(name)?).map(Vec::as_slice)
    }
}

fn csv(text: &str) -> Result<Table, ReadError> {
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.is_empty());
    let (_, head) = lines.next().ok_or(ReadError::Empty)?;
    let fields: Vec<Field> = cells(head)
        .iter()
        .map(|title| {
            let (name, unit) = Field::parts(title);
            Field::new(name, unit, FieldKind::Real)
        })
        .collect();
    let mut columns = vec![Vec::new(); fields.len()];
    let mut lines = lines.peekable();
    if fields.len() == 1 && lines.peek().is_none() {
        return Err(ReadError::NoTable);
    }
    for (index, line) in lines {
        let line_number = index + 1;
        let found = line.split(',').count();
        if found != fields.len() {
            return Err(ReadError::Width { line: line_number, found, expected: fields.len() });
        }
        for (column, text) in columns.iter_mut().zip(line.split(',')) {
            let text = text.trim();
            let value = if text.is_empty() { Ok(f64::NAN) } else { text.parse() };
            let wrong = |_| ReadError::Number { line: line_number, text: text.to_owned() };
            column.push(value.map_err(wrong)?);
        }
    }
    Ok(Table { fields, columns })
}

/// The cells of a line; some may be quoted.
fn cells(line: &str) -> Vec<String> {
    let mut cells = vec![String::new()];
    let mut quoted = false;
    let mut characters = line.chars().peekable();
    while let Some(character) = characters.next() {
        match character {
            '"' if quoted && characters.peek() == Some(&'"') => {
                characters.next();
                push(&mut cells, '"');
            }
            '"' => quoted = !quoted,
            ',' if !quoted => cells.push(String::new()),
            other => push(&mut cells, other),
        }
    }
    cells
}

fn push(cells: &mut [String], character: char) {
    if let Some(cell) = cells.last_mut() {
        cell.push(character);
    }
}

/// The table behind the magic.
fn numpy(rest: &[u8]) -> Option<Table> {
    let (length, rest) = rest.split_first_chunk::<2>()?;
    let (header, data) = rest.split_at_checked(usize::from(u16::from_le_bytes(*length)))?;
    let header = std::str::from_utf8(header).ok()?;
    let (described, shape) = header.split_once("], 'fortran_order': False, 'shape': (")?;
    let described = described.strip_prefix("{'descr': [")?;
    let count: usize = shape.split_once(',')?.0.parse().ok()?;
    let fields: Vec<(Field, bool)> = described
        .split("), (")
        .map(|field| {
            let field = field.trim_start_matches('(').trim_end_matches(')');
            let (names, format) = field.rsplit_once(", '")?;
            let is_integer = match format.strip_suffix('\'')? {
                "<i8" => true,
                "<f8" => false,
                _ => return None,
            };
            // A field with a unit has a title, which holds its name, too.
            let title = match names.strip_suffix(')') {
                Some(both) => both.split_once("', '")?.0,
                None => names.strip_suffix('\'')?,
            };
            let title = title.strip_prefix('\'')?.replace("\\'", "'").replace("\\\\", "\\");
            let (name, unit) = Field::parts(&title);
            let kind = if is_integer { FieldKind::Integer } else { FieldKind::Real };
            Some((Field::new(name, unit, kind), is_integer))
        })
        .collect::<Option<_>>()?;
    let mut columns = vec![Vec::new(); fields.len()];
    let (words, _) = data.as_chunks::<8>();
    // A file that was cut off holds fewer rows than its header says.
    for row in words.chunks_exact(fields.len()).take(count) {
        for ((column, word), (_, is_integer)) in columns.iter_mut().zip(row).zip(&fields) {
            column.push(if *is_integer {
                i64::from_le_bytes(*word) as f64
            } else {
                f64::from_le_bytes(*word)
            });
        }
    }
    Some(Table { fields: fields.into_iter().map(|(field, _)| field).collect(), columns })
}

#[cfg(test)]
mod tests {
    use super::super::{CsvWriter, NpyWriter};
    use super::*;
    use std::io::Cursor;

    fn fields() -> Vec<Field> {
        vec![
            Field::new("sample", "", FieldKind::Integer),
            Field::new("1.velocity", "count/s", FieldKind::Real),
            Field::new("X:$0033,u", "it's", FieldKind::Real),
        ]
    }

    const ROWS: [[f64; 3]; 2] = [[1.0, -2.5, 1e300], [4_000_000_000_000.0, 0.1, -0.0]];

    #[test]
    fn what_was_written_is_read() {
        let mut csv = CsvWriter::new(Vec::new(), &fields()).unwrap();
        let mut npy = NpyWriter::new(Cursor::new(Vec::new()), &fields()).unwrap();
        for row in ROWS {
            csv.row(&row).unwrap();
            npy.row(&row).unwrap();
        }
        let csv = Table::parse(&csv.finish().unwrap()).unwrap();
        let npy = Table::parse(&npy.finish().unwrap().into_inner()).unwrap();
        let columns: Vec<Vec<f64>> =
            (0..3).map(|field| ROWS.iter().map(|row| row[field]).collect()).collect();
        assert_eq!((&csv.columns, &npy.columns), (&columns, &columns));
        assert_eq!((csv.rows(), csv.column("1.velocity")), (2, Some(&columns[1][..])));
        assert_eq!(
            csv.fields.iter().map(|field| &field.unit[..]).collect::<Vec<_>>(),
            ["", "count/s", "it's"]
        );
        assert_eq!(npy.fields, fields());
    }

    #[test]
    fn what_is_no_table_says_where() {
        let error = |text: &str| Table::parse(text.as_bytes()).unwrap_err().to_string();
        assert_eq!(error(""), "the file is empty");
        assert_eq!(error("a,b\n1,2\n3\n"), "line 3 has 1 values, the first line 2 names");
        assert_eq!(error("a,b\n1,x\n"), "line 2: \"x\" is no number");
        let mut bytes = MAGIC.to_vec();
        bytes.extend([9, 0]);
        assert_eq!(Table::parse(&bytes), Err(ReadError::Numpy));
    }

    #[test]
    fn a_missing_value_is_not_a_number() {
        let table = Table::parse(b"a,b\n1,\n,NaN\n").unwrap();
        assert!(table.columns[1].iter().all(|value| value.is_nan()) && table.columns[0][1].is_nan());
    }
}
