//! The coordinate systems of the background data, as a table, a line or JSON.

use serde_json::{Value, json};

use crate::cli::act::panel::panel_words;
use crate::cli::console::Table;
use crate::cli::context::Context;
use crate::cli::show::motors::stamp;
use crate::cli::show::screen::{Live, state, update};
use crate::client::number::{NOT_READ, fixed, short};
use crate::client::{Snapshot, Staleness, shown_flags};
use crate::decode::{BackgroundData, CoordinateSystem, Ports, Quantity};
use crate::function::panel::{FeedOverride, PanelWords};
use crate::map::AXES;

/// The control panel's overrides of the feed rate, if the daemon tells them. `%` and other words to which Ix93 may
/// point belong to the board.
#[derive(Debug, Default)]
pub struct Overrides {
    words: Option<PanelWords>,
    i10: Option<u32>,
}

impl Overrides {
    /// Asks the daemon for the panel's words: the segment does not have them.
    pub fn ask(context: &Context, i10: Option<u32>) -> Self {
        let words = || {
            let mut connection = context.connection().ok()?;
            let family = Context::family(None, &mut connection).ok()?;
            panel_words(&mut connection, family).ok()
        };
        Self { words: words(), i10 }
    }

    /// Whether the panel overrides the feed rate of coordinate system `number`, and by how much; `None` if unknown.
    fn of(&self, number: usize) -> Option<Option<FeedOverride>> {
        let words = self.words.as_ref()?;
        let raw = words.overrides.get(number - 1)?;
        let is_on = words.override_enable >> (number - 1) & 1 != 0;
        Some(FeedOverride::from_raw((*raw).into()).ok().filter(|_| is_on))
    }

    fn text(&self, number: usize) -> String {
        match self.of(number) {
            None => NOT_READ.to_owned(),
            Some(None) => "off".to_owned(),
            Some(Some(value)) => match self.i10.and_then(|i10| value.percent(i10)) {
                Some(percent) => format!("{percent:.2}%"),
                None => format!("{}raw", value.raw()),
            },
        }
    }

    fn document(&self, number: usize) -> Value {
        let Some(found) = self.of(number) else { return Value::Null };
        let percent = found.zip(self.i10).and_then(|(value, i10)| value.percent(i10));
        json!({ "on": found.is_some(), "raw": found.map(FeedOverride::raw), "percent": percent })
    }
}

/// The coordinate systems to show.
pub struct Systems<'a> {
    snapshot: &'a Snapshot,
    overrides: Overrides,
}

impl<'a> Systems<'a> {
    /// The coordinate systems of `snapshot`. Asks the daemon for the overrides of the feed rate.
    pub fn new(context: &Context, snapshot: &'a Snapshot) -> Self {
        Self { snapshot, overrides: Overrides::ask(context, snapshot.identity.i10) }
    }
}

impl Live for Systems<'_> {
    fn update(&self) -> (u64, bool) {
        update(self.snapshot.background.as_ref())
    }

    fn document(&self) -> Value {
        let background = self.snapshot.background.as_ref();
        let mut document = json!({ "background": stamp(background, self.snapshot.stale) });
        add(&mut document, background.map(|background| &background.data));
        for system in document["coordinate_systems"].as_array_mut().into_iter().flatten() {
            let number = system["coordinate_system"].as_u64().and_then(|number| usize::try_from(number).ok());
            system["feed_override"] = number.map_or(Value::Null, |number| self.overrides.document(number));
        }
        document
    }

    fn text(&self, _: Option<usize>, why: &mut dyn FnMut(Staleness) -> String) -> String {
        let Some(background) = &self.snapshot.background else {
            let why = why(self.snapshot.stale.unwrap_or(Staleness::Off));
            return format!("STALE: there are no background data yet: {why}\n");
        };
        let note = background.stale.map_or_else(String::new, |stale| format!("STALE: {}\n", why(stale)));
        note + &table(&background.data, &self.overrides)
    }

    fn line(&self) -> String {
        let Snapshot { background, stale, .. } = self.snapshot;
        let systems = background.iter().flat_map(|background| &background.data.coordinate_systems);
        let systems = systems.map(|system| {
            let number = system.coordinate_system;
            let values = [
                ("mode", mode(system)),
                ("lines", count(system.lines_remaining)),
                ("override", self.overrides.text(number)),
                ("targets", targets(system).replace(' ', ",")),
                ("flags", flags(system).join(",")),
            ];
            let values = values.map(|(name, value)| format!(" {name}={value}"));
            format!(" &{number}{}", values.concat())
        });
        state(background.as_ref(), *stale) + &systems.collect::<String>()
    }
}

/// Adds the background data to a document. Without data the parts are empty.
pub fn add(document: &mut Value, data: Option<&BackgroundData>) {
    document["coordinate_systems"] = data.map_or(json!([]), |data| json!(data.coordinate_systems));
    document["background_motors"] = data.map_or(json!([]), |data| json!(data.motors));
    document["ports"] = data.map_or(Value::Null, |data| json!(data.ports));
}

/// The table of the coordinate systems, and the board's ports.
pub fn table(data: &BackgroundData, overrides: &Overrides) -> String {
    let Ports { control_panel, thumbwheel, machine_io } = data.ports;
    let systems = systems(data, overrides);
    format!("{systems}ports: JPAN ${control_panel:06X}  JTHW ${thumbwheel:06X}  JOPTO ${machine_io:06X}\n")
}

/// The coordinate systems.
pub fn systems(data: &BackgroundData, overrides: &Overrides) -> Table {
    let mut table = Table::new(">system|mode|>lines|>PE|>left ms|>feed|>override|targets|flags");
    for system in &data.coordinate_systems {
        table.row([
            format!("&{}", system.coordinate_system),
            mode(system),
            count(system.lines_remaining),
            count(system.program_address_offset),
            system.time_left_in_move.map_or_else(|| NOT_READ.to_owned(), milliseconds),
            feed(system),
            overrides.text(system.coordinate_system),
            targets(system),
            flags(system).join(" "),
        ]);
    }
    if data.coordinate_systems.iter().all(|system| system.turbo.is_none()) {
        table.drop_column("feed");
    }
    table
}

fn count(number: Option<impl ToString>) -> String {
    number.map_or_else(|| NOT_READ.to_owned(), |number| number.to_string())
}

fn mode(system: &CoordinateSystem) -> String {
    let unknown = if system.program_status.is_some() { "?" } else { NOT_READ };
    system.motion_mode.map_or_else(|| unknown.to_owned(), |mode| format!("{mode:?}").to_lowercase())
}

/// The programmed feed rate, or the time of a move if programs give times. Only Turbo boards report it.
fn feed(system: &CoordinateSystem) -> String {
    match system.turbo.map(|turbo| (turbo.feed_rate, turbo.move_time_ms)) {
        Some((Some(rate), _)) => format!("F{}", short(rate)),
        Some((None, Some(time))) => format!("TM{}", short(time)),
        Some((None, None)) | None => NOT_READ.to_owned(),
    }
}

fn milliseconds(time: Quantity) -> String {
    time.value.map_or_else(String::new, |left| fixed(left, 1))
}

fn flags(system: &CoordinateSystem) -> Vec<&'static str> {
    let words = system.status_words();
    if words == [None; 3] {
        return vec![NOT_READ];
    }
    let mut flags = shown_flags::of_system(&words);
    flags.extend((system.turbo.and_then(|turbo| turbo.feed_hold) == Some(true)).then_some("hold"));
    flags
}

/// The axes with targets other than 0. Most machines use few of the nine.
fn targets(system: &CoordinateSystem) -> String {
    if system.axis_targets.0 == [None; AXES.len()] {
        return NOT_READ.to_owned();
    }
    let axes = AXES.iter().zip(system.axis_targets.0);
    let axes = axes.filter_map(|(axis, target)| Some((axis, target.filter(|target| *target != 0.0)?)));
    axes.map(|(axis, target)| format!("{axis}{}", short(target))).collect::<Vec<_>>().join(" ")
}
