//! `pmacctl compare`: where a recorded board does otherwise than the simulator that is started from the recording, or than another
//! recorded one.

mod seen;
mod simulated;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;
use serde_json::json;

use crate::cli::context::{Context, Failure, Verdict};
use crate::cli::files::settings_file::{Item, parse};
use crate::format::Visible;
use crate::map::Function;
use crate::recording::{Recording, Replies};
use seen::Seen;

/// Servo periods that differ by less are the same, parts of a thousand: clocks differ.
const PERIOD_PER_MILLE: f64 = 20.0;
/// Lines whose answers are no difference: who the board is, when it was made, and what moves.
const APART: [&str; 12] =
    ["TYPE", "VERSION", "VER", "DATE", "TIME", "TODAY", "CID", "CPU", "SID", "P", "V", "F"];
/// How many differences of a kind are printed.
const PRINTED: usize = 40;

#[derive(Debug, Args)]
pub struct Compare {
    /// A directory that capture wrote
    #[arg(value_name = "DIR")]
    pub directory: PathBuf,
    /// A second one; without it, the simulator that is started from DIR
    #[arg(value_name = "DIR2")]
    pub other: Option<PathBuf>,
}

/// A difference.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
struct Difference {
    /// `answer`, `variable`, `words`, `update` or `handshake`.
    kind: &'static str,
    /// What differs.
    what: String,
    /// How it is in the first.
    first: String,
    /// How it is in the second.
    second: String,
}

/// What the first has, and what the second has.
type Sides<T> = [T; 2];

pub fn run(context: &mut Context, options: &Compare) -> Result<Verdict, Failure> {
    let first = read(&options.directory)?;
    let second = match &options.other {
        Some(other) => read(other)?,
        None => simulated::capture(&options.directory, &first)?,
    };
    let second_name = if options.other.is_some() { "second" } else { "simulator" };
    let found = differences(&first, &options.directory, &second)?;
    if context.output.is_json() {
        let who = [&first, &second].map(|recording| {
            let about = &recording.about;
            json!({ "family": about.family, "type": about.board_type, "firmware": about.firmware,
                "taken": about.taken, "accesses": recording.accesses.len(), "images": recording.images.len() })
        });
        let [one, other] = who;
        context.output.json(&json!({ "first": one, "second": other, "differences": found }))?;
    } else {
        print(context, &first, &second, second_name, &found)?;
    }
    Ok(found.is_empty().into())
}

fn read(directory: &Path) -> Result<Recording, Failure> {
    Recording::read(directory).map_err(Failure::request)
}

fn print(
    context: &mut Context,
    first: &Recording,
    second: &Recording,
    second_name: &str,
    found: &[Difference],
) -> Result<(), Failure> {
    for (name, recording) in [("recorded", first), (second_name, second)] {
        let about = &recording.about;
        let told = |text: &Option<String>| text.clone().unwrap_or_else(|| "unknown".to_owned());
        context.output.line(format_args!(
            "{name}: {}, type {}, firmware {}, {} accesses, {} images",
            about.family,
            Visible(told(&about.board_type)),
            Visible(told(&about.firmware)),
            recording.accesses.len(),
            recording.images.len()
        ))?;
    }
    for (name, recording) in [("recorded", first), (second_name, second)] {
        let about = &recording.about;
        if let Some(why) = &about.cut_short {
            context.output.line(format_args!("{name}: cut short: {}", Visible(why)))?;
        }
        if about.dropped > 0 {
            context.output.line(format_args!("{name}: {} more accesses were not recorded", about.dropped))?;
        }
    }
    for kind in ["answer", "variable", "words", "update", "handshake"] {
        let of_kind: Vec<_> = found.iter().filter(|difference| difference.kind == kind).collect();
        for Difference { what, first, second, .. } in of_kind.iter().take(PRINTED) {
            let [what, first, second] = [what, first, second].map(Visible);
            context
                .output
                .line(format_args!("{kind} {what}\n  recorded   {first}\n  {second_name:<10} {second}"))?;
        }
        if let Some(more) = of_kind.len().checked_sub(PRINTED).filter(|more| *more > 0) {
            context.output.line(format_args!("{kind}: {more} more, see --json"))?;
        }
    }
    context.output.line(format_args!("differences={}", found.len()))?;
    Ok(())
}

/// Everything in which `first`, which lies in `directory`, and `second` differ.
fn differences(first: &Recording, directory: &Path, second: &Recording) -> Result<Vec<Difference>, Failure> {
    let family = first.about.family(directory).map_err(Failure::request)?;
    let other = second.about.family(directory).map_err(Failure::request)?;
    if family != other {
        return Err(Failure::Request(format!(
            "the one is a {} with a DPRAM of {} bytes, the other a {} with one of {}: there is nothing to compare",
            family.title, family.length, other.title, other.length
        )));
    }
    let mut found = answers(first, second);
    found.extend(variables(first, second)?);
    // Without a trace nothing is known of what the board writes.
    if [first, second].iter().all(|recording| !recording.accesses.is_empty()) {
        let seen = [first, second].map(|recording| Seen::of(recording, family));
        found.extend(words(&seen));
        found.extend(updates(&seen));
        found.extend(orders(&seen));
    }
    Ok(found)
}

fn answers(first: &Recording, second: &Recording) -> Vec<Difference> {
    let theirs = Replies::of(second);
    let mut found = Vec::new();
    for answer in &first.answers {
        let line = answer.line.trim().to_ascii_uppercase();
        let is_variable =
            line.starts_with(['I', 'P', 'Q', 'M']) && line[1..].starts_with(|c: char| c.is_ascii_digit());
        if APART.contains(&line.as_str()) || is_variable || line.starts_with('^') {
            continue;
        }
        let Some(other) = theirs.to(&answer.line) else { continue };
        let texts = [answer, &other].map(|answer| match &answer.refused {
            Some(why) => why.clone(),
            None => answer.reply.join(" | "),
        });
        if texts[0] != texts[1] {
            let [first, second] = texts;
            found.push(Difference { kind: "answer", what: format!("`{}`", answer.line), first, second });
        }
    }
    found
}

/// The variables and definitions that both hold.
fn variables(first: &Recording, second: &Recording) -> Result<Vec<Difference>, Failure> {
    let held = |recording: &Recording| -> Result<BTreeMap<Item, String>, Failure> {
        let text = recording.variables.as_deref().unwrap_or_default();
        let entries = parse("variables.pmc", text).map_err(|mistakes| {
            let first = mistakes.first().map(ToString::to_string).unwrap_or_default();
            Failure::Request(format!("{first}; of such a capture no variable can be compared"))
        })?;
        Ok(entries.into_iter().map(|entry| (entry.item, entry.text)).collect())
    };
    let sides = [held(first)?, held(second)?];
    // A capture may leave kinds of them out: what only one holds says nothing.
    let both = sides[0].iter().filter_map(|(item, one)| Some((*item, one, sides[1].get(item)?)));
    let differ = both.filter(|(item, one, other)| !item.is_program() && !item.same(one, other));
    let found = differ.map(|(item, one, other)| Difference {
        kind: "variable",
        what: format!("{item}{}", if item.sign() == "->" { "->" } else { "" }),
        first: one.clone(),
        second: other.clone(),
    });
    Ok(found.collect())
}

/// Functions into whose words one of the boards writes, and the other does not.
fn words(seen: &Sides<Seen>) -> Vec<Difference> {
    // What lies in the ASCII port and in the tables of variables depends on what was asked meanwhile.
    let functions = Function::ALL
        .into_iter()
        .filter(|function| !matches!(function, Function::Ascii | Function::Variables));
    let names = functions.map(Function::name).chain(["user"]);
    let mut found = Vec::new();
    for name in names {
        let counts = seen.each_ref().map(|seen| seen.words.get(name).copied().unwrap_or(0));
        if (counts[0] == 0) != (counts[1] == 0) {
            let [first, second] = counts.map(|count| match count {
                0 => "writes none".to_owned(),
                count => format!("writes {count}"),
            });
            let what = if name == "user" { "of no function" } else { name };
            found.push(Difference { kind: "words", what: what.to_owned(), first, second });
        }
    }
    found
}

fn updates(seen: &Sides<Seen>) -> Vec<Difference> {
    let mut found = Vec::new();
    let mut add = |what: &str, [first, second]: Sides<String>| {
        found.push(Difference { kind: "update", what: what.to_owned(), first, second });
    };
    let cycles = seen.each_ref().map(|seen| seen.update_cycles);
    if cycles[0] != cycles[1] {
        let told = |cycles: Option<u32>| cycles.map_or("none seen".to_owned(), |cycles| cycles.to_string());
        add("servo cycles from one update to the next", cycles.map(told));
    }
    if let (Some(one), Some(other)) = (seen[0].servo_period_ns, seen[1].servo_period_ns)
        && (one.0.max(other.0) - one.1.min(other.1)) * 1000.0 > one.1.max(other.1) * PERIOD_PER_MILLE
    {
        // Where they overlap, lateness may be all that there is.
        let told = |(from, to)| format!("{:.2} to {:.2} us", from / 1000.0, to / 1000.0);
        add("servo period", [one, other].map(told));
    }
    found
}

/// Orders of answers that only one of them has shown. Of what was not asked in both nothing is known.
fn orders(seen: &Sides<Seen>) -> Vec<Difference> {
    let kind = |order: &str| order.split(", ").next().unwrap_or_default().to_owned();
    let kinds =
        seen.each_ref().map(|seen| seen.orders.iter().map(|order| kind(order)).collect::<BTreeSet<_>>());
    // A host that looks late sees what came meanwhile in the order in which it looks. So a kind of which both boards have shown one
    // order is no difference.
    let shared: BTreeSet<_> = seen[0].orders.intersection(&seen[1].orders).map(|order| kind(order)).collect();
    let mut found = Vec::new();
    for (at, side) in seen.iter().enumerate() {
        let other = 1 - at;
        let ours = |order: &&String| kinds[other].contains(&kind(order)) && !shared.contains(&kind(order));
        for order in side.orders.iter().filter(ours) {
            let mut sides = ["not seen".to_owned(), "not seen".to_owned()];
            sides[at].clone_from(order);
            let [first, second] = sides;
            found.push(Difference { kind: "handshake", what: kind(order), first, second });
        }
    }
    found
}

#[cfg(test)]
mod tests;
