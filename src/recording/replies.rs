//! A recording's answer to a line: from the same question, or variable by variable.

use std::collections::HashMap;

use super::{Answer, Recording};

/// The most variables that one line asks for.
const MOST_VARIABLES: usize = 512;

/// The size of the open buffer.
const SIZE: &str = "SIZE";

/// The replies that a recording holds.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Replies {
    lines: HashMap<String, Answer>,
    /// The values, by the line that asks for one variable alone: `I10`, `P1`, `M7->`.
    variables: HashMap<String, String>,
}

impl Replies {
    /// The replies of `recording`. The last answer to a question counts.
    #[must_use]
    pub fn of(recording: &Recording) -> Self {
        let mut replies = Self::default();
        for line in recording.variables.as_deref().unwrap_or_default().lines().map_while(variable_line) {
            replies.variables.extend(line);
        }
        for answer in &recording.answers {
            let asked = asked(&plain(&answer.line)).unwrap_or_default();
            if asked.len() == answer.reply.len() {
                replies.variables.extend(asked.into_iter().zip(answer.reply.iter().cloned()));
            }
            replies.lines.insert(plain(&answer.line), answer.clone());
        }
        replies
    }

    /// The answer to `line`; `None` if the recording has none.
    #[must_use]
    pub fn to(&self, line: &str) -> Option<Answer> {
        let line = plain(line);
        if let Some(answer) = self.lines.get(&line) {
            return Some(answer.clone());
        }
        // The daemon sends `SIZE` several times in one line, to recognise the answers by their number.
        if let Some(size) = self.lines.get(SIZE).filter(|size| size.refused.is_some())
            && line.replace(SIZE, "").is_empty()
        {
            return Some(size.clone());
        }
        let values = asked(&line)?.into_iter().map(|variable| self.variables.get(&variable).cloned());
        let reply = values.collect::<Option<Vec<_>>>()?;
        Some(Answer { line, reply, refused: None })
    }

    /// Whether the recording knows the definition of each of `count` M-variables.
    #[must_use]
    pub fn has_definitions(&self, count: u16) -> bool {
        (0..count).all(|number| self.variables.contains_key(&format!("M{number}->")))
    }
}

/// A line for comparison: capitals, no blanks.
fn plain(line: &str) -> String {
    line.chars().filter(|letter| !letter.is_whitespace()).map(|letter| letter.to_ascii_uppercase()).collect()
}

/// The variable and value of a line of a file that `pmacctl backup` writes. The file lists the Q-variables of
/// coordinate system 1 first, so reading ends at the first line that addresses another one, or begins a program.
fn variable_line(line: &str) -> Option<Option<(String, String)>> {
    let line = line.split(';').next().unwrap_or_default().trim();
    if line.starts_with("OPEN") || line.starts_with('&') && !line.starts_with("&1") {
        return None;
    }
    let (name, value, arrow) = match line.split_once("->") {
        Some((name, value)) => (name, value, "->"),
        None => match line.split_once('=') {
            Some((name, value)) => (name, value, ""),
            None => return Some(None),
        },
    };
    let name = format!("{}{arrow}", name.trim().trim_start_matches("&1"));
    let is_variable = asked(&name).is_some_and(|asked| asked.len() == 1);
    Some(is_variable.then(|| (name, value.trim().to_owned())))
}

/// The variables of a line that only asks for variables, each as the line that asks for it alone.
fn asked(line: &str) -> Option<Vec<String>> {
    let mut rest = line;
    let mut variables = Vec::new();
    while let Some(kind) = rest.chars().next() {
        if let Some(behind) = rest.strip_prefix(SIZE) {
            variables.push(SIZE.to_owned());
            rest = behind;
            continue;
        }
        if !"IPQM".contains(kind) {
            return None;
        }
        let (first, mut behind) = number(&rest[1..])?;
        let mut last = first;
        if let Some(range) = behind.strip_prefix("..") {
            (last, behind) = number(range)?;
        }
        let arrow = if behind.starts_with("->") { "->" } else { "" };
        rest = &behind[arrow.len()..];
        // An assignment or an expression begins with none of these letters.
        let is_too_many = usize::from(last.saturating_sub(first)) + variables.len() >= MOST_VARIABLES;
        if last < first || is_too_many || arrow == "->" && kind != 'M' {
            return None;
        }
        variables.extend((first..=last).map(|number| format!("{kind}{number}{arrow}")));
    }
    (!variables.is_empty()).then_some(variables)
}

/// The number at the start of `text`, and the rest.
fn number(text: &str) -> Option<(u16, &str)> {
    let end = text.find(|letter: char| !letter.is_ascii_digit()).unwrap_or(text.len());
    Some((text[..end].parse().ok()?, &text[end..]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn replies(answers: &[(&str, &[&str])], variables: &str) -> Replies {
        let answers = answers.iter().map(|(line, reply)| Answer {
            line: (*line).to_owned(),
            reply: reply.iter().map(|line| (*line).to_owned()).collect(),
            refused: None,
        });
        let mut recording = super::super::testing::recording();
        recording.answers = answers.collect();
        recording.variables = Some(variables.to_owned());
        Replies::of(&recording)
    }

    #[test]
    fn a_question_is_answered_variable_by_variable() {
        let replies = replies(
            &[
                ("TYPE", &["PMAC1"]),
                ("I10..12", &["1", "2", "3"]),
                ("M1..2->", &["X:$0,4", "*"]),
                ("I20", &[]),
                ("SIZE", &["0"]),
            ],
            "; backup\nI10=9\nP5=2.5 ; note\nM7->Y:$C080\nM7=0\n&1\nQ1=4\n&2\nQ1=5\nOPEN PLC 1 CLEAR\nP5=7\nCLOSE\n",
        );
        let reply = |line| replies.to(line).map(|answer| answer.reply.join(" "));
        for (line, expected) in [
            ("type", "PMAC1"),
            ("I10 I12", "1 3"),
            ("I11I10", "2 1"),
            ("I12,I10", ""),
            ("I10..13", ""),
            ("M1..2->", "X:$0,4 *"),
            ("M7->", "Y:$C080"),
            ("M7", "0"),
            ("P5", "2.5"),
            ("Q1", "4"),
            ("I10=5", ""),
            ("P5+1", ""),
            ("SIZE SIZE", "0 0"),
            ("J+", ""),
            ("M1..70000->", ""),
            ("I2..1", ""),
        ] {
            assert_eq!(reply(line), (!expected.is_empty()).then(|| expected.to_owned()), "{line}");
        }
        assert_eq!(reply("I20").as_deref(), Some(""), "the board acknowledged it");
        assert!(replies.has_definitions(0) && !replies.has_definitions(2));
    }
}
