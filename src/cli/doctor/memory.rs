//! `pmacctl doctor --memory`: the stretches of the DPRAM that the daemon uses, and those that the board's own programs
//! use.
//!
//! Sites keep data of their own in the DPRAM, with M-variables that point there. If such an M-variable points into the
//! words of a function, the board's program and the function take each other's writes for their own.

use super::report::Report;
use crate::cli::context::{Context, Failure};
use crate::cli::setup::pointers::{Pointer, Pointers};
use crate::map::{Region, TypedAddress};
use crate::protocol::{BoardInfo, BoardSettings, Function};

/// The most definitions shown for a stretch.
const SHOWN: usize = 8;
/// The cure if both use the same words.
const CURE: &str =
    "leave the function out of `functions` in pmacd's configuration, or move them to the user area";

/// An M-variable that points into the DPRAM.
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
    let Pointers { found, unclear } = Pointers::asked(&mut connection, family)?;
    let definition =
        |found: Pointer| Definition { text: format!("M{}->{}", found.number, found.text), at: found.at };
    let found: Vec<Definition> = found.into_iter().map(definition).collect();
    if !unclear.is_empty() {
        report.warn("memory", not_told(&unclear));
    }
    for region in family.regions {
        let here = found.iter().filter(|definition| definition.touches(region));
        tell(report, region, &uses(region, &settings, &info), &here.collect::<Vec<_>>());
    }
    Ok(())
}

/// The text for answers that are no definitions.
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

/// The used functions whose words lie in `region`.
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

/// Reports a stretch; warns if both daemon and programs use it.
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
