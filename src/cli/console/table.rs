//! Tables with aligned columns.

use std::fmt;

use crate::format::Visible;

/// Rows of text under headings, with two blanks between columns and none at the ends of lines.
#[derive(Debug)]
pub struct Table {
    headings: Vec<&'static str>,
    /// Whether the column's cells are aligned right.
    rights: Vec<bool>,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// The headings are separated by `|`. A `>` before a heading aligns its column right.
    pub fn new(headings: &'static str) -> Self {
        let (headings, rights) = headings.split('|').map(aligned).unzip();
        Self { headings, rights, rows: Vec::new() }
    }

    pub fn row(&mut self, cells: impl IntoIterator<Item = String>) {
        self.rows.push(cells.into_iter().collect());
    }

    /// Puts a column before the last one; a cell for each row.
    pub fn column_before_last(&mut self, heading: &'static str, cells: impl IntoIterator<Item = String>) {
        let before_last = |length: usize| length.saturating_sub(1);
        let (heading, right) = aligned(heading);
        let at = before_last(self.headings.len());
        self.headings.insert(at, heading);
        self.rights.insert(at, right);
        for (row, cell) in self.rows.iter_mut().zip(cells) {
            row.insert(before_last(row.len()), cell);
        }
    }

    /// Removes the column called `name`, if there is one.
    pub fn drop_column(&mut self, name: &str) {
        let Some(index) = self.headings.iter().position(|heading| *heading == name) else { return };
        self.headings.remove(index);
        self.rights.remove(index);
        for row in self.rows.iter_mut().filter(|row| index < row.len()) {
            row.remove(index);
        }
    }

    /// The table in lines of at most `width` characters, if possible: first without the columns in `spare`, one after the
    /// other, then with the words of the last column in further lines. No cell is cut: half a number is another number.
    pub fn fitting(self, width: usize, spare: &[&str]) -> String {
        self.fitting_rows(width, spare).into_iter().flatten().map(|line| line + "\n").collect()
    }

    /// As [`Self::fitting`]: the lines of the heading, then the lines of each row.
    pub fn fitting_rows(mut self, width: usize, spare: &[&str]) -> Vec<Vec<String>> {
        for name in spare {
            if self.to_string().lines().all(|line| line.chars().count() <= width) {
                break;
            }
            self.drop_column(name);
        }
        let widths = self.widths();
        let begin: usize = widths.iter().take(widths.len().saturating_sub(1)).map(|column| column + 2).sum();
        self.to_string().lines().map(|line| wrapped(line, begin, width)).collect()
    }

    fn lines(&self) -> impl Iterator<Item = Vec<String>> {
        let heading = self.headings.iter().map(|&heading| heading.to_owned()).collect();
        std::iter::once(heading).chain(self.rows.iter().cloned())
    }

    fn widths(&self) -> Vec<usize> {
        let width = |column: usize| {
            let cells = self.lines().filter_map(|line| Some(line.get(column)?.chars().count()));
            cells.max().unwrap_or(0)
        };
        (0..self.headings.len()).map(width).collect()
    }
}

/// The heading, and whether its `>` aligns the column right.
fn aligned(heading: &'static str) -> (&'static str, bool) {
    heading.strip_prefix('>').map_or((heading, false), |heading| (heading, true))
}

/// The line, and below it the words that stand behind character `begin` and do not fit.
pub fn wrapped(line: &str, begin: usize, width: usize) -> Vec<String> {
    let mut row: String = line.chars().take(begin).collect();
    let mut lines = Vec::new();
    for (index, word) in line.chars().skip(begin).collect::<String>().split(' ').enumerate() {
        if index > 0 && row.chars().count() + 1 + word.chars().count() > width {
            lines.push(std::mem::replace(&mut row, " ".repeat(begin)));
        } else if index > 0 {
            row.push(' ');
        }
        row += word;
    }
    lines.push(row.trim_end().to_owned());
    lines
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let widths = self.widths();
        for line in self.lines() {
            let mut text = String::new();
            for (column, (right, width)) in self.rights.iter().zip(&widths).enumerate() {
                let cell = line.get(column).map_or("", String::as_str);
                if column > 0 {
                    text.push_str("  ");
                }
                text.push_str(&if *right { format!("{cell:>width$}") } else { format!("{cell:<width$}") });
            }
            // The cell may contain the board's words.
            writeln!(f, "{}", Visible(text.trim_end()))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_line_up() {
        let mut table = Table::new(">a|name|z");
        table.row(["1".to_owned(), "x".to_owned(), "end".to_owned()]);
        table.row(["100".to_owned(), "longer".to_owned()]);
        assert_eq!(table.to_string(), "  a  name    z\n  1  x       end\n100  longer\n");
    }

    #[test]
    fn a_narrow_screen_costs_whole_columns_and_no_flag() {
        let table = || {
            let mut table = Table::new(">motor|>spare|flags");
            table.row(["#1", "123456.7", "homed in-position"].map(str::to_owned));
            table.row(["#2", "8", ""].map(str::to_owned));
            table
        };
        let wide = table().to_string();
        assert_eq!(table().fitting(34, &["spare"]), wide);
        let narrow = "motor  flags\n   #1  homed in-position\n   #2\n";
        assert_eq!(table().fitting(33, &["spare"]), narrow);
        let wrapped = "motor  flags\n   #1  homed\n       in-position\n   #2\n";
        assert_eq!(table().fitting(23, &["spare"]), wrapped);
        assert_eq!(table().fitting(1, &["spare"]), wrapped);
    }

    #[test]
    fn a_column_comes_before_the_last() {
        let mut table = Table::new("a|z");
        table.row(["1", "end"].map(str::to_owned));
        table.column_before_last(">m", ["x".to_owned()]);
        assert_eq!(table.to_string(), "a  m  z\n1  x  end\n");
        assert_eq!(table.fitting_rows(5, &[]), [["a  m  z"], ["1  x  end"]]);
    }

    #[test]
    fn control_characters_of_a_board_are_seen_in_a_table() {
        let mut table = Table::new("reply");
        table.row(["a\u{9b}2J\u{1b}".to_owned()]);
        assert_eq!(table.to_string(), "reply\na\\x9b2J\\x1b\n");
    }
}
