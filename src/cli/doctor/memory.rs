//! `pmacctl doctor --memory`: which stretch of the DPRAM the daemon uses, and which the board's own programs.
//!
//! Sites keep data of their own in the DPRAM: M-variables that point into it. Where one points into the words of a function,
//! what the one writes the other takes for its own.

use std::time::Duration;

use super::report::Report;
use crate::cli::context::{Context, Failure};
use crate::client::{CommandError, Connection};
use crate::map::word_use::{self, m_variables};
use crate::map::{Family, Region, TypedAddress};
use crate::protocol::{BoardInfo, BoardSettings, Function};

/// So many definitions are asked for in one line: a longer reply would hold up other callers' lines.
const A_QUESTION: u16 = 50;
/// Time limit of one question.
const QUESTION_WITHIN: Duration = Duration::from_secs(10);
/// So many definitions of a stretch are shown.
const SHOWN: usize = 8;
/// What to do where both use the same words.
const CURE: &str =
    "leave the function out of `functions` in pmacd's configuration, or move them to the user area";

/// One M-variable that points into the DPRAM.
struct Definition {
    text: String,
    at: TypedAddress,
}

impl Definition {
    fn touches(&self, region: &Region) -> bool {
        let TypedAddress { space, offset } = self.at;
        region.contains(offset) || region.contains(offset.plus_words(space.words() - 1))
    }
}

/// Asks the board for its M-variables, and reports every stretch of the DPRAM.
pub fn memory(report: &mut Report, context: &Context) -> Result<(), Failure> {
    let mut connection = context.connection()?;
    let family = Context::family(None, &mut connection)?;
    let (settings, info) = (connection.settings()?, connection.info()?);
    let (found, unclear) = definitions(&mut connection, family)
        .map_err(|error| Failure::request(format!("the board's M-variables: {error}")))?;
    if !unclear.is_empty() {
        report.warn("memory", not_told(&unclear));
    }
    for region in family.regions {
        let here = found.iter().filter(|definition| definition.touches(region));
        tell(report, region, &uses(region, &settings, &info), &here.collect::<Vec<_>>());
    }
    Ok(())
}

/// The M-variables that point into the DPRAM, and of those that the board does not tell of, each with what it says instead.
/// Nothing is changed.
fn definitions(
    connection: &mut Connection,
    family: &Family,
) -> Result<(Vec<Definition>, Vec<String>), CommandError> {
    let count = m_variables(family);
    let (mut found, mut unclear) = (Vec::new(), Vec::new());
    for first in (0..count).step_by(A_QUESTION.into()) {
        let last = (first + A_QUESTION).min(count) - 1;
        let question = format!("M{first}..{last}->");
        let reply = connection.question(&question, QUESTION_WITHIN)?;
        if reply.len() != usize::from(last - first + 1) {
            unclear.push(format!("{} lines to {question}", reply.len()));
        }
        for (number, text) in (first..=last).zip(reply) {
            match word_use::definition(&text, number, family) {
                Some(word_use::Definition::Dpram(at)) => {
                    let text = text.split_once("->").map_or(text.as_str(), |(_, text)| text).trim();
                    found.push(Definition { text: format!("M{number}->{text}"), at });
                }
                Some(word_use::Definition::Elsewhere) => {}
                None => unclear.push(format!("M{number}: {text:?}")),
            }
        }
    }
    Ok((found, unclear))
}

/// What is told of answers that are no definitions.
fn not_told(unclear: &[String]) -> String {
    let shown = unclear[..unclear.len().min(SHOWN)].join(", ");
    let more = match unclear.len() {
        count if count <= SHOWN => String::new(),
        count => format!(" and {} more", count - SHOWN),
    };
    format!(
        "the board does not tell where all its M-variables point ({shown}{more}): more may point into the stretches below"
    )
}

/// The functions in use whose words lie in `region`.
fn uses(region: &Region, settings: &BoardSettings, info: &BoardInfo) -> Vec<&'static str> {
    let all = Function::ALL.into_iter();
    let all = all.filter(|function| settings.functions.has(*function) && info.leaves_free(*function));
    let has = |function: &Function| match region.name {
        // The headers of the buffers, and the buffers.
        "pointers" | "user" => {
            matches!(function, Function::Variables | Function::Rotary | Function::Gather)
        }
        name => name.starts_with(function.name()),
    };
    all.filter(has).map(Function::name).collect()
}

/// Reports a stretch: a warning where both use it.
fn tell(report: &mut Report, region: &Region, functions: &[&str], found: &[&Definition]) {
    let first =
        found.iter().take(SHOWN).map(|definition| definition.text.as_str()).collect::<Vec<_>>().join(" ");
    let shown = match found.len() {
        0 => "no M-variable".to_owned(),
        count if count <= SHOWN => first,
        count => format!("{first} and {} more", count - SHOWN),
    };
    let pmacd = if functions.is_empty() { "nothing".to_owned() } else { functions.join(", ") };
    let stretch = format!("{} from {}, {} bytes", region.name, region.start, 2 * region.words());
    let text = format!("{stretch}: pmacd uses {pmacd}; the board's programs: {shown}");
    // The user area is for both; the buffers in it have places of their own.
    if functions.is_empty() || found.is_empty() || region.name == "user" {
        report.ok("memory", text);
    } else {
        report.warn("memory", format!("{text}; {CURE}"));
    }
}
