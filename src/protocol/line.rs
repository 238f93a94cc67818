//! What every reader of a command line goes by: what of it are commands, and whom it addresses.

/// The parts of `line` that are commands. What stands in quotes is text that a program sends.
pub fn commands(line: &str) -> impl Iterator<Item = &str> {
    line.split('"').step_by(2)
}

/// As [`commands`], of a line that need not be text.
pub fn command_bytes(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(|byte| *byte == b'"').step_by(2)
}

/// Whether `line` resets the board: `$$$` or `$$$***`. `MS$$$0` resets a station of a MACRO ring.
#[must_use]
pub fn resets(line: &[u8]) -> bool {
    let is_stations = |before: &[u8]| {
        let before = before.trim_ascii_end();
        let ends = |word: &[u8]| {
            before.len().checked_sub(word.len()).is_some_and(|at| before[at..].eq_ignore_ascii_case(word))
        };
        ends(b"MS") || ends(b"MACROSLV")
    };
    command_bytes(line).any(|part| {
        part.windows(3).enumerate().any(|(at, three)| three == b"$$$" && !is_stations(&part[..at]))
    })
}

/// Whether `line` asks for variables and does nothing else: `I10`, `P1..5`, `M1->`. Asks for no memory.
#[must_use]
pub fn only_asks_for_variables(line: &[u8]) -> bool {
    let line = line.trim_ascii();
    let behind = |at: usize| line.get(at + 1).copied().unwrap_or(b' ');
    let is_variable =
        |at: usize| b"IPQM".contains(&line[at].to_ascii_uppercase()) && behind(at).is_ascii_digit();
    let is_fine = |at: usize| match line[at] {
        b'0'..=b'9' | b'.' | b',' | b' ' => true,
        b'-' => behind(at) == b'>',
        b'>' => at > 0 && line[at - 1] == b'-',
        _ => is_variable(at),
    };
    !line.is_empty() && is_variable(0) && (0..line.len()).all(is_fine)
}

/// The commands of `line` without blanks and in capitals.
#[must_use]
pub fn plain(line: &str) -> String {
    let letters = commands(line).flat_map(str::chars).filter(|c| !c.is_whitespace());
    letters.map(|c| c.to_ascii_uppercase()).collect()
}

/// A [`plain`] line without what only asks whom the board addresses, `#` and `##`, `&` and `&&`: what follows means whom the line
/// has addressed before.
#[must_use]
pub fn without_questions(plain: &str) -> String {
    let behind = plain.chars().skip(1).map(Some).chain([None]);
    let is_address = |behind: Option<char>| behind.is_some_and(|c| c.is_ascii_digit());
    let kept = plain.chars().zip(behind).filter(|(c, behind)| !matches!(c, '#' | '&') || is_address(*behind));
    kept.map(|(c, _)| c).collect()
}

/// A [`plain`] line without `##3`, by which a Turbo board chooses whom `^B` and others report, and addresses nobody (FACTS-TURBO 14).
/// A PMAC may take the number for an address.
#[must_use]
pub fn without_groups(plain: &str) -> String {
    let mut parts = plain.split("##");
    let first = parts.next().unwrap_or_default().to_owned();
    parts.fold(first, |line, part| line + part.trim_start_matches(|c: char| c.is_ascii_digit()))
}

/// Of a [`plain`] line, each address that begins with `sign` (`#` or `&`): its bit, bit 0 being number 1, and what is said to it.
/// A number that no family has gives no bit.
pub fn addressed(plain: &str, sign: char) -> impl Iterator<Item = (u32, &str)> {
    plain.split(sign).skip(1).map(|part| {
        let digits = part.find(|c: char| !c.is_ascii_digit()).unwrap_or(part.len());
        let (number, commands) = part.split_at(digits);
        (number.parse().map_or(0, bit), commands)
    })
}

/// The bit of motor or coordinate system `number`, bit 0 being number 1. A number that no family has gives none.
#[must_use]
pub fn bit(number: u32) -> u32 {
    number.checked_sub(1).and_then(|place| 1_u32.checked_shl(place)).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_in_quotes_is_no_command() {
        let line = "& 1 r SEND\"#2J+ $$$\" #3 hm";
        assert_eq!(plain(line), "&1RSEND#3HM");
        assert!(!resets(line.as_bytes()) && resets(b" $$$***"));
        assert!(!resets(b"ms $$$0") && !resets(b"MACROSLV$$$0") && resets(b"MSSAVE0 $$$"));
        assert_eq!(command_bytes(line.as_bytes()).count(), commands(line).count());
    }

    #[test]
    fn a_line_that_only_asks_for_variables_is_known() {
        for line in ["I10", "p1..5", "M1->", "Q1 P2", " I10I20 ", "M0..49->"] {
            assert!(only_asks_for_variables(line.as_bytes()), "{line}");
        }
        for line in [
            "", "10", "P1=5", "#1P", "&1>", "I10>", "I1*", "M1->*", "TYPE", "#1J+", "P(1)", "Q", "P1 Q",
            "P1-2",
        ] {
            assert!(!only_asks_for_variables(line.as_bytes()), "{line}");
        }
    }

    #[test]
    fn d7_a_question_whom_the_board_addresses_is_no_address() {
        assert_eq!(without_questions("#3##J+#&&2R&#"), "#3J+&2R");
        assert_eq!(without_groups("#1##2J+##"), "#1J+");
    }

    #[test]
    fn each_address_has_its_commands() {
        let told: Vec<_> = addressed("P1#1J+#32HM#33K#0K#99999999999$", '#').collect();
        assert_eq!(told, [(1, "J+"), (1 << 31, "HM"), (0, "K"), (0, "K"), (0, "$")]);
        assert_eq!(addressed("#1&2R", '&').collect::<Vec<_>>(), [(2, "R")]);
        assert_eq!(addressed("P1", '&').count(), 0);
    }
}
