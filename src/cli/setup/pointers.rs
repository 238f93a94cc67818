//! The M-variables of a board that point into its DPRAM, read from the board.

use std::time::Duration;

use crate::cli::context::Failure;
use crate::client::Connection;
use crate::map::word_use::{self, m_variables};
use crate::map::{Family, TypedAddress};

/// The definitions in one question: a longer reply would hold up other clients' lines.
const A_QUESTION: u16 = 50;
/// Time limit of one question.
const QUESTION_WITHIN: Duration = Duration::from_secs(10);

/// An M-variable that points into the DPRAM.
pub struct Pointer {
    /// The variable's number.
    pub number: u16,
    /// Its definition, without the variable.
    pub text: String,
    /// The address that the M-variable points to.
    pub at: TypedAddress,
}

/// The M-variables of a board.
pub struct Pointers {
    /// The M-variables that point into the DPRAM, by number.
    pub found: Vec<Pointer>,
    /// The board's answers that are no definitions.
    pub unclear: Vec<String>,
}

impl Pointers {
    /// Asks the board, and changes nothing on it.
    pub fn asked(connection: &mut Connection, family: &Family) -> Result<Self, Failure> {
        let count = m_variables(family);
        let (mut found, mut unclear) = (Vec::new(), Vec::new());
        for first in (0..count).step_by(A_QUESTION.into()) {
            let last = (first + A_QUESTION).min(count) - 1;
            let question = format!("M{first}..{last}->");
            let reply = connection.question(&question, QUESTION_WITHIN);
            let reply =
                reply.map_err(|error| Failure::request(format!("the board's M-variables: {error}")))?;
            if reply.len() != usize::from(last - first + 1) {
                unclear.push(format!("{} lines to {question}", reply.len()));
            }
            for (number, text) in (first..=last).zip(reply) {
                match word_use::definition(&text, number, family) {
                    Some(word_use::Definition::Dpram(at)) => {
                        let text = text.split_once("->").map_or(text.as_str(), |(_, text)| text).trim();
                        found.push(Pointer { number, text: text.to_owned(), at });
                    }
                    Some(word_use::Definition::Elsewhere) => {}
                    None => unclear.push(format!("M{number}: {text:?}")),
                }
            }
        }
        Ok(Self { found, unclear })
    }
}
