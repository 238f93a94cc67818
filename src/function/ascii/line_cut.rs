//! Where a line is cut that goes in two parts.
//!
//! "The first 159 characters are placed in DPRAM without a terminating NULL" (DPRAM manual p. 28), in a buffer of 160 bytes
//! (p. 29). A board that takes the last byte, too, would get one character more: a number that is cut there would be another one.

/// How many characters of `line` go in its first part, which has `first_part` of them at most and is filled up with blanks: up
/// to a blank, if there is one for which the board gets no more than `limit` characters in all. Then it matters to nothing how
/// many of the blanks the board takes.
pub(super) fn cut(line: &[u8], first_part: usize, limit: usize) -> usize {
    let spare = limit.saturating_sub(line.len() + 1);
    let least = first_part.saturating_sub(spare).max(line.len() - first_part);
    let is_quoted = |end: usize| line[..end].iter().filter(|byte| **byte == b'"').count() % 2 == 1;
    let ends = (least..=first_part).rev().filter(|end| *end > 0 && line[end - 1] == b' ');
    ends.into_iter().find(|end| !is_quoted(*end)).unwrap_or(first_part)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_cut_at_a_blank_so_that_the_last_byte_matters_to_no_number() {
        for line in ["P1=1234567 ".repeat(15), "P22=333 ".repeat(22), "#1J=1234 #2J=5678 ".repeat(10)] {
            let line = line.trim_end();
            let (first, second) = line.split_at(cut(line.as_bytes(), 159, 200));
            assert!(first.len() <= 159 && second.len() <= 159 && first.ends_with(' '), "{line}");
            // A board takes 159 characters of the first part, or all 160 that there are.
            for taken in [159, 160] {
                let whole = format!("{first:<taken$}{second}");
                assert!(whole.len() <= 200, "{line}");
                assert!(whole.split_whitespace().eq(line.split_whitespace()), "{whole}");
            }
        }
    }

    #[test]
    fn without_a_blank_that_may_grow_it_is_cut_where_the_buffer_ends() {
        for line in [format!("P1={}", "1".repeat(180)), format!("SEND\"{}\"", "a ".repeat(90))] {
            assert_eq!(cut(line.as_bytes(), 159, 200), 159, "{line}");
        }
        // As long as a line may be: there is no room for blanks.
        assert_eq!(cut(&"P1=12345 ".repeat(23).as_bytes()[..200], 159, 200), 159);
    }
}
