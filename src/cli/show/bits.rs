//! `pmacctl motor` and `pmacctl system`: every status bit of a motor, a coordinate system or the board, with its meaning.

use clap::Args;
use serde_json::{Value, json};

use crate::cli::act::jog;
use crate::cli::args::values::number;
use crate::cli::console::Table;
use crate::cli::context::{Context, Failure, Verdict, check_numbers};
use crate::cli::show::coordinates::{Overrides, systems};
use crate::cli::show::global_status;
use crate::cli::show::motors::{self, reason, stamp};
use crate::client::number::NOT_READ;
use crate::client::{Snapshot, View, identity};
use crate::decode::{BackgroundData, Flags};
use crate::map::{DEFAULT_FAMILY, Family, StatusTable};

/// `motor`.
#[derive(Debug, Args)]
pub struct MotorBits {
    /// The motor's number, or its name in pmacd's configuration
    #[arg(value_name = "MOTOR")]
    motor: String,
}

/// `system`.
#[derive(Debug, Args)]
pub struct SystemBits {
    /// The coordinate system's number [default: the board itself, the words of ???]
    #[arg(value_name = "C.S.", value_parser = number)]
    system: Option<u8>,
}

/// `pmacctl motor`.
pub fn motor(context: &mut Context, options: &MotorBits) -> Result<Verdict, Failure> {
    let mut board = context.board()?;
    let snapshot = board.snapshot()?;
    let number = jog::motor(&options.motor, || Ok(snapshot.identity.clone()))?;
    let family = family(&snapshot);
    check_numbers(family, true, &[number])?;
    let motors = motors::motors(&snapshot);
    let Some(motor) = motors.iter().find(|motor| motor.servo.motor == usize::from(number)) else {
        let stale = snapshot.servo.as_ref().map_or(snapshot.stale, |servo| servo.stale);
        let why = stale.map(|stale| format!(": {}", reason(&mut board, stale))).unwrap_or_default();
        return Err(Failure::Refused(format!("motor {number} is not in the servo report{why}")));
    };
    let words = Word::all(family.status.motor, &motor.status_words());
    let servo = snapshot.servo.as_ref();
    let shown = Shown {
        document: json!({ "servo": stamp(servo, snapshot.stale), "motor": motor.document() }),
        head: motors::table(std::slice::from_ref(motor)).to_string(),
        stale: servo.and_then(|servo| servo.stale).map(|stale| reason(&mut board, stale)),
        words,
        question: "?",
    };
    shown.show(context)
}

/// `pmacctl system`.
pub fn system(context: &mut Context, options: &SystemBits) -> Result<Verdict, Failure> {
    let mut board = context.board()?;
    let snapshot = board.snapshot()?;
    let Some(number) = options.system else { return global(context, &snapshot) };
    let family = family(&snapshot);
    check_numbers(family, false, &[number])?;
    let background = snapshot.background.as_ref();
    let systems_of = |view: &View<BackgroundData>| {
        let mut data = view.data.clone();
        data.coordinate_systems.retain(|system| system.coordinate_system == usize::from(number));
        data
    };
    let data = background.map(systems_of).filter(|data| !data.coordinate_systems.is_empty());
    let stale = background.map_or(snapshot.stale, |view| view.stale);
    let why = stale.map(|stale| reason(&mut board, stale));
    let Some(data) = data else {
        let why = why.map(|why| format!(": {why}")).unwrap_or_default();
        return Err(Failure::Refused(format!(
            "coordinate system {number} is not in the background report{why}"
        )));
    };
    let system = &data.coordinate_systems[0];
    let shown = Shown {
        document: json!({ "background": stamp(background, snapshot.stale), "coordinate_system": system }),
        head: systems(&data, &Overrides::ask(context, snapshot.identity.i10)).to_string(),
        stale: why,
        words: Word::all(family.status.coordinate_system, &system.status_words()),
        question: "??",
    };
    shown.show(context)
}

/// The board's own words.
fn global(context: &mut Context, snapshot: &Snapshot) -> Result<Verdict, Failure> {
    let servo = snapshot.servo.as_ref().filter(|view| view.is_fresh()).map(|view| &view.data);
    let background = snapshot.background.as_ref().filter(|view| view.is_fresh()).map(|view| &view.data);
    let flags = global_status::flags(servo, background);
    let flags = flags.map_or([None; 2], |flags| flags.map(Some));
    let shown = Shown {
        document: json!({}),
        head: String::new(),
        stale: flags[0].is_none().then(|| "no live report has the board's status words".to_owned()),
        words: Word::all(family(snapshot).status.global, &flags),
        question: "???",
    };
    shown.show(context)
}

fn family(snapshot: &Snapshot) -> &'static Family {
    identity::family(&snapshot.identity).unwrap_or(DEFAULT_FAMILY)
}

/// What a command shows.
struct Shown {
    /// The document without the words.
    document: Value,
    /// The values above the bits.
    head: String,
    /// Why the data are not live.
    stale: Option<String>,
    words: Vec<Word>,
    /// The command whose answer has the words.
    question: &'static str,
}

impl Shown {
    fn show(mut self, context: &mut Context) -> Result<Verdict, Failure> {
        self.document["words"] = self.words.iter().map(Word::document).collect();
        context.output.show(&self.document, || self.text())?;
        Ok((self.stale.is_none() && self.words.iter().all(|word| word.value.is_some())).into())
    }

    fn text(&self) -> String {
        let mut text = self.stale.as_ref().map_or_else(String::new, |why| format!("STALE: {why}\n"));
        text += &self.head;
        for (place, word) in (1..).zip(&self.words) {
            let value = word.value.map_or_else(|| NOT_READ.to_owned(), |value| format!("${value:06X}"));
            text += &format!("\nword {place} of {}: {value}\n{}", self.question, word.table());
        }
        text.trim_start_matches('\n').to_owned()
    }
}

/// A status word; without a value if no report has it.
struct Word {
    table: &'static StatusTable,
    value: Option<u32>,
}

impl Word {
    fn all(tables: &'static [StatusTable], words: &[Option<Flags>]) -> Vec<Self> {
        let value = |flags: &Option<Flags>| flags.map(|flags| flags.word & 0xFF_FFFF);
        tables.iter().zip(words).map(|(table, flags)| Self { table, value: value(flags) }).collect()
    }

    fn document(&self) -> Value {
        let flags = self.table.flags.iter().map(|(bit, name)| {
            let on = self.value.map(|value| value >> bit & 1 == 1);
            json!({ "bit": bit, "name": name, "on": on, "meaning": self.table.meaning(name) })
        });
        let fields = self.table.fields.iter().map(|field| {
            let (value, meaning) = (self.value.map(|value| field.of(value)), self.table.meaning(field.name));
            json!({ "bits": [field.high, field.low], "name": field.name, "value": value, "meaning": meaning })
        });
        json!({
            "word": self.table.name,
            "value": self.value.map(|value| format!("${value:06X}")),
            "bits": flags.collect::<Vec<_>>(),
            "fields": fields.collect::<Vec<_>>(),
        })
    }

    /// The bits, highest first.
    fn table(&self) -> Table {
        let state = |state: Option<String>| state.unwrap_or_else(|| NOT_READ.to_owned());
        let flags = self.table.flags.iter().map(|(bit, name)| {
            let on = self.value.map(|value| if value >> bit & 1 == 1 { "on" } else { "off" }.to_owned());
            (*bit, bit.to_string(), state(on), *name)
        });
        let fields = self.table.fields.iter().map(|field| {
            let value = self.value.map(|value| field.of(value).to_string());
            (field.high, format!("{}-{}", field.high, field.low), state(value), field.name)
        });
        let mut rows: Vec<_> = flags.chain(fields).collect();
        rows.sort_by_key(|(high, ..)| std::cmp::Reverse(*high));
        let mut table = Table::new(">bit|state|name|meaning of on");
        for (_, bits, state, name) in rows {
            table.row([bits, state, name.to_owned(), self.table.meaning(name).to_owned()]);
        }
        table
    }
}
