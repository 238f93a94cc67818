//! `pmacctl explain`: I-variables, errors, addresses and status bits in words. Needs no daemon.

use clap::Args;
use serde_json::{Map, Value, json};

use crate::cli::args::values::family;
use crate::cli::context::{Context, Failure, Verdict};
use crate::client::shown_flags;
use crate::map::{
    Entry, FAMILIES, Family, Generation, Layout, PmacRegister, SourceAt, StatusTable, TypedAddress, errors,
    i_variable,
};

/// `explain`.
#[derive(Debug, Args)]
pub struct Explain {
    /// An I-variable (I130, Ix30, Isx87), an error (ERR003), an address ('Y:$D009') or a status bit (home_complete)
    #[arg(value_name = "NAME", required = true)]
    names: Vec<String>,
    /// The board's family [default: that of pmacd's board; without a daemon, every family]
    #[arg(long, value_name = "FAMILY", value_parser = family)]
    family: Option<&'static Family>,
}

pub fn run(context: &mut Context, options: &Explain) -> Result<Verdict, Failure> {
    let families = match options.family {
        Some(family) => vec![family],
        None => match context.board_family()? {
            Some((family, _)) => vec![family],
            None => FAMILIES.to_vec(),
        },
    };
    let (mut told, mut unknown) = (Vec::new(), None);
    for name in &options.names {
        match explained(name, &families) {
            Ok(meanings) => told.extend(meanings),
            Err(failure) => unknown = unknown.or(Some(failure)),
        }
    }
    if let Some(failure) = unknown.take_if(|_| told.is_empty()) {
        return Err(failure);
    }
    let document: Vec<Value> = told.iter().map(|(families, meaning)| meaning.document(families)).collect();
    context.output.show(&document, || {
        let texts = told.iter().map(|(of, meaning)| meaning.text(of, families.len()));
        texts.collect::<Vec<_>>().join("\n")
    })?;
    unknown.map_or(Ok(Verdict::Yes), Err)
}

/// The meanings of a name, each with the families that have it.
type Explained = Vec<(Vec<&'static Family>, Meaning)>;

/// What `name` means on boards of `families`.
fn explained(name: &str, families: &[&'static Family]) -> Result<Explained, Failure> {
    let mut all: Explained = Vec::new();
    for family in families {
        for meaning in meanings(name, family) {
            match all.iter_mut().find(|(_, known)| *known == meaning) {
                Some((of, _)) => of.push(family),
                None => all.push((vec![family], meaning)),
            }
        }
    }
    if all.is_empty() {
        let on = families.iter().map(|family| family.title).collect::<Vec<_>>().join(", ");
        return Err(Failure::Request(format!(
            "{name:?} is not known on {on}; write an I-variable (I130, Ix30, Isx87), an error (ERR003), an address \
             ('Y:$D009'; pmacctl board map lists them) or a status bit (home_complete; pmacctl motor 1 lists them)"
        )));
    }
    Ok(all)
}

/// A meaning of a name.
#[derive(Debug, PartialEq)]
struct Meaning {
    kind: &'static str,
    name: String,
    title: String,
    /// What is known of it; empty where nothing is.
    facts: Vec<(&'static str, String)>,
}

impl Meaning {
    fn document(&self, families: &[&Family]) -> Value {
        let mut document = Map::new();
        document.insert("kind".to_owned(), json!(self.kind));
        document.insert("name".to_owned(), json!(self.name));
        document.insert("title".to_owned(), json!(self.title));
        let families: Vec<&str> = families.iter().map(|family| family.name).collect();
        document.insert("families".to_owned(), json!(families));
        let facts = self.facts.iter().map(|(key, value)| {
            let value = if value.is_empty() { Value::Null } else { json!(value) };
            ((*key).to_owned(), value)
        });
        document.extend(facts);
        Value::Object(document)
    }

    /// As text; with the families unless all of `asked` have it.
    fn text(&self, families: &[&Family], asked: usize) -> String {
        let titles: Vec<&str> = families.iter().map(|family| family.title).collect();
        let on = if families.len() == asked { String::new() } else { format!(" ({})", titles.join(", ")) };
        let mut text = format!("{}{on}: {}\n", self.name, self.title);
        for (key, value) in self.facts.iter().filter(|(_, value)| !value.is_empty()) {
            text += &format!("  {key:<9}{value}\n");
        }
        text
    }
}

fn meanings(name: &str, family: &'static Family) -> Vec<Meaning> {
    let variable = i_variable(name, family).map(|variable| Meaning {
        kind: "i_variable",
        name: variable.name,
        title: variable.title.to_owned(),
        facts: vec![
            ("of", variable.of),
            ("unit", variable.unit.to_owned()),
            ("range", variable.range.to_owned()),
            ("default", variable.default.to_owned()),
            ("page", variable.page),
        ],
    });
    let one = variable.or_else(|| error(name, family)).or_else(|| address(name, family));
    match one {
        Some(meaning) => vec![meaning],
        None => bits(name, family),
    }
}

/// The error `ERR003`. The manuals list the errors under I6.
fn error(name: &str, family: &Family) -> Option<Meaning> {
    let digits = name.trim().get(3..).filter(|_| name.trim()[..3].eq_ignore_ascii_case("ERR"))?;
    let number: u16 = digits.parse().ok()?;
    let is_known = number <= errors::LAST_OF_PMAC || family.generation == Generation::Turbo;
    let title = errors::meaning(number).filter(|_| is_known)?.to_owned();
    let page = i_variable("I6", family).map(|variable| variable.page).unwrap_or_default();
    Some(Meaning { kind: "error", name: format!("ERR{number:03}"), title, facts: vec![("page", page)] })
}

/// A place in the DPRAM, or a register of the board's own memory of which the DPRAM has a copy.
fn address(text: &str, family: &'static Family) -> Option<Meaning> {
    let layout = Layout::new(family, None);
    if let Ok(place) = TypedAddress::parse(text, family) {
        let name = place.pmac_address(family).to_string();
        let offset = format!("0x{:04X} in the DPRAM", place.offset.bytes());
        let Some(entry) = layout.entries().find(|entry| entry.contains(place.offset)) else {
            let title = format!("part of the {} area", family.region(place.offset)?.name);
            return Some(Meaning { kind: "register", name, title, facts: vec![("offset", offset)] });
        };
        return Some(register(name, offset, &entry, family));
    }
    let asked = text.parse::<PmacRegister>().ok()?.address();
    let entry = layout.entries().find(|entry| entry.source(family) == SourceAt::One(asked))?;
    let copy = format!("{} copies it", family.print_half(entry.offset));
    Some(register(asked.to_string(), copy, &entry, family))
}

fn register(name: String, offset: String, entry: &Entry, family: &Family) -> Meaning {
    let register = entry.register;
    let kind = register.number.map(|kind| kind.title());
    let of = kind.zip(entry.number).map_or_else(String::new, |(kind, number)| format!("{kind} {number}"));
    let source = entry.source(family).to_string();
    let bits = register.bits.iter().map(|bits| match bits.high == bits.low {
        true => format!("{} {}", bits.low, bits.name),
        false => format!("{}-{} {}", bits.high, bits.low, bits.name),
    });
    Meaning {
        kind: "register",
        name,
        title: register.title.to_owned(),
        facts: vec![
            ("of", of),
            ("offset", offset),
            ("register", format!("{}, {}", register.function, register.name)),
            ("format", register.format.name().to_owned()),
            ("unit", register.units.to_owned()),
            ("writer", register.writer.to_string()),
            ("copy of", source),
            ("bits", bits.collect::<Vec<_>>().join(", ")),
            ("note", register.note.to_owned()),
        ],
    }
}

/// The status bits called `name`, or shown by the word `name`.
fn bits(name: &str, family: &Family) -> Vec<Meaning> {
    let name = name.trim().to_ascii_lowercase();
    let shown: Vec<&str> = shown_flags::named(&name).collect();
    let page = match family.generation {
        Generation::Pmac => "Software Reference p. 189-198",
        Generation::Turbo => "Turbo Software Reference p. 283-290",
    };
    let words = |question: &'static str, tables: &'static [StatusTable]| {
        (1..).zip(tables).map(move |(place, table)| (question, place, table))
    };
    let status = family.status;
    let all = words("?", status.motor).chain(words("??", status.coordinate_system));
    let mut found = Vec::new();
    for (question, place, table) in all.chain(words("???", status.global)) {
        for (bit, flag) in table.flags.iter().filter(|(_, flag)| *flag == name || shown.contains(flag)) {
            found.push(Meaning {
                kind: "status_bit",
                name: (*flag).to_owned(),
                title: table.meaning(flag).to_owned(),
                facts: vec![
                    ("of", table.owner().to_owned()),
                    ("word", format!("{place} of {question}, bit {bit}")),
                    ("page", page.to_owned()),
                ],
            });
        }
    }
    found
}
