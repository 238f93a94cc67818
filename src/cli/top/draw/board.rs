//! The page of the board: health, motors, the following error of the selected motor, coordinate systems, watches.

use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::style::Style;

use super::rooms::Rooms;
use super::{Picture, put, rows, trace};
use crate::cli::console::table::wrapped;
use crate::cli::show::coordinates::{self, Overrides};
use crate::cli::show::{motors, user};
use crate::cli::top::trace::WINDOW;
use crate::client::number::{NOT_READ, fixed};
use crate::client::{Staleness, View};
use crate::format::Visible;

/// Columns that a narrow screen can do without, the least important first.
const SPARE_OF_MOTORS: [&str; 7] =
    ["target", "commanded", "name", TRACE, "velocity", "following error", "position"];
const SPARE_OF_SYSTEMS: [&str; 4] = ["left ms", "targets", "PE", "mode"];
const TRACE: &str = "trace";
/// The width of a trace in the table.
const COLUMNS: usize = 10;
/// The parts of `status` that the health shows, and the parts that need the user's attention.
const HEALTH: [&str; 2] = ["daemon", "counters"];
const NOTES: [&str; 5] = ["open buffer", "elsewhere", "not used yet", "programs' words", "unfinished"];

/// Rows of a table, each in one or more lines, under a heading.
type Rows = Vec<Vec<String>>;

impl Picture<'_> {
    pub(super) fn board(&self, frame: &mut Frame<'_>, area: Rect) {
        let width = usize::from(area.width);
        let (health, motors, systems) = (self.health(width), self.motors(width), self.systems(width));
        let mut watches = self.watches(width);
        let like = Rooms {
            health: rows(health.len()),
            motors: rows(motors.iter().map(Vec::len).sum()),
            trace: Rooms::trace_likes(),
            systems: rows(systems.iter().map(Vec::len).sum()),
            watches: rows(watches.len()),
        };
        let rooms = Rooms::share(area.height, like);
        tell_of_the_rest(&mut watches, rooms.watches.into(), width);
        let mut y = area.y;
        let mut room = |height: u16| {
            let room = Rect { y, height, ..area };
            y += height;
            room
        };
        self.styled(frame, room(rooms.health), &health);
        self.table(frame, room(rooms.motors), &motors, self.selected_row(), self.fault().is_some());
        let place = room(rooms.trace);
        if rooms.trace > 0 {
            self.selected_trace(frame, place);
        }
        let is_old = !self.background_is_fresh();
        self.scrolled_table(frame, room(rooms.systems), &systems, is_old);
        self.styled(frame, room(rooms.watches), &watches);
    }

    /// The condition, the health parts of `status`, and the parts that need the user's attention.
    fn health(&self, width: usize) -> Vec<(String, Style)> {
        let fault = self.fault().or_else(|| self.daemon_fault());
        let mut lines = match fault {
            Some(fault) => vec![(fault, self.look.alarm())],
            None if self.answer.is_none() => vec![("live; pmacd is asked".to_owned(), Style::new())],
            None => Vec::new(),
        };
        let plain = HEALTH.iter().flat_map(|what| self.said(what)).map(|line| (line, Style::new()));
        let notes = NOTES.iter().flat_map(|what| self.said(what)).map(|line| (line, self.look.heading()));
        lines.extend(plain);
        lines.extend(notes);
        wrap(lines, width)
    }

    fn motors(&self, width: usize) -> Rows {
        let Ok(snapshot) = self.snapshot else { return Vec::new() };
        let found = motors::shown(snapshot);
        let mut table = motors::table(&found);
        // The board reports no velocity: compute it from the positions.
        if found.first().is_some_and(|motor| !motor.is_reported("actual_velocity")) {
            let velocity = |motor: usize| {
                self.traces.velocity(motor).map_or_else(|| NOT_READ.to_owned(), |counts| fixed(counts, 1))
            };
            let all = found.iter().map(|motor| velocity(motor.servo.motor));
            table.column_before_last(">velocity", all);
        }
        let small = |motor: usize| {
            let trace = self.traces.of(motor);
            trace.map_or_else(|| NOT_READ.to_owned(), |trace| trace.small(COLUMNS, self.now))
        };
        table.column_before_last(TRACE, found.iter().map(|motor| small(motor.servo.motor)));
        table.fitting_rows(width, &SPARE_OF_MOTORS)
    }

    /// Which row of the motors' table is selected, from 1; 0 is the heading.
    fn selected_row(&self) -> usize {
        let motors = self.snapshot.map(motors::shown).unwrap_or_default();
        let selected = motors.iter().position(|motor| motor.servo.motor == self.state.selected);
        selected.map_or(0, |index| index + 1)
    }

    fn background_is_fresh(&self) -> bool {
        let background = self.snapshot.ok().and_then(|snapshot| snapshot.background.as_ref());
        background.is_some_and(|background| background.is_fresh())
    }

    fn systems(&self, width: usize) -> Rows {
        let Ok(snapshot) = self.snapshot else { return Vec::new() };
        let Some(background) = &snapshot.background else {
            let why = self.why(snapshot.stale.unwrap_or(Staleness::Off));
            return vec![vec![format!("STALE: there are no background data yet: {why}")]];
        };
        let none = Overrides::default();
        let overrides = self.answer.map_or(&none, |answer| &answer.overrides);
        let mut rows =
            coordinates::systems(&background.data, overrides).fitting_rows(width, &SPARE_OF_SYSTEMS);
        if let (Some(stale), Some(heading)) = (background.stale, rows.first_mut()) {
            heading.insert(0, format!("STALE: {}", self.why(stale)));
        }
        rows
    }

    /// The site's own words and the watched values, as many a line as fit, and why some are unknown.
    fn watches(&self, width: usize) -> Vec<(String, Style)> {
        let words = self.snapshot.ok().and_then(|snapshot| snapshot.user.as_ref());
        let is_live = words.is_some_and(View::is_fresh);
        let values = words.iter().flat_map(|view| &view.data.words).map(|values| {
            let value = if is_live { user::text(values) } else { NOT_READ.to_owned() };
            let unit = values.values.as_ref().map_or("", |_| &values.word.unit[..]);
            let unit = if is_live { unit } else { "" };
            format!("{}={value} {unit}", &values.word.name[..]).trim_end().to_owned()
        });
        let watched = self.answer.map(|answer| &answer.watched);
        let asked = watched.iter().flat_map(|watched| &watched.values);
        let asked = asked.map(|(name, value)| format!("{name}={value}"));
        let mut lines: Vec<String> = Vec::new();
        for text in values.chain(asked) {
            match lines.last_mut().filter(|line| line.chars().count() + 2 + text.chars().count() <= width) {
                Some(line) => *line += &format!("  {text}"),
                None => lines.push(text),
            }
        }
        let fault = watched.and_then(|watched| watched.fault.as_ref());
        let fault = fault.map(|fault| (format!("watch: {fault}"), self.look.alarm()));
        wrap(lines.into_iter().map(|line| (line, Style::new())).chain(fault), width)
    }

    fn styled(&self, frame: &mut Frame<'_>, area: Rect, lines: &[(String, Style)]) {
        for (row, (line, style)) in (0..area.height).zip(lines) {
            put(frame, area, row, line, *style);
        }
    }

    /// The heading, and the rows around the selected row.
    fn table(&self, frame: &mut Frame<'_>, area: Rect, table: &Rows, selected: usize, is_old: bool) {
        let Some((heading, body)) = table.split_first() else { return };
        let room = usize::from(area.height).saturating_sub(heading.len());
        let from = first_row(body, selected.saturating_sub(1), room);
        let lines = heading.iter().map(|line| (line, self.look.heading()));
        let style = |row: usize| match (row + 1 == selected, is_old) {
            (true, _) => self.look.selected(),
            (false, true) => self.look.old(),
            (false, false) => Style::new(),
        };
        let rows = body.iter().enumerate().skip(from);
        let rows = rows.flat_map(|(row, lines)| lines.iter().map(move |line| (line, style(row))));
        for (row, (line, style)) in (0..area.height).zip(lines.chain(rows)) {
            put(frame, area, row, line, style);
        }
    }

    /// The heading, and the rows from the user's scroll position on.
    fn scrolled_table(&self, frame: &mut Frame<'_>, area: Rect, table: &Rows, is_old: bool) {
        let Some((heading, body)) = table.split_first() else { return };
        let style = if is_old { self.look.old() } else { Style::new() };
        let room = usize::from(area.height).saturating_sub(heading.len());
        let from = self.state.scrolled.min(body.len().saturating_sub(room.max(1)));
        let lines = heading.iter().map(|line| (line, self.look.heading()));
        let rows = body.iter().skip(from).flatten().map(|line| (line, style));
        for (row, (line, style)) in (0..area.height).zip(lines.chain(rows)) {
            put(frame, area, row, line, style);
        }
    }

    /// The following error of the selected motor.
    fn selected_trace(&self, frame: &mut Frame<'_>, area: Rect) {
        let number = self.state.selected;
        let Some(trace) = self.traces.of(number) else { return };
        let unit = trace.peak().map_or_else(
            || "its scale is not known".to_owned(),
            |peak| format!("counts, at most {} in {} s", fixed(peak, 1), WINDOW.as_secs()),
        );
        let [title, chart] =
            [Rect { height: 1, ..area }, Rect { y: area.y + 1, height: area.height - 1, ..area }];
        let motors = self.snapshot.map(motors::shown).unwrap_or_default();
        let motor = motors.iter().find(|motor| motor.servo.motor == number);
        let name = motor.and_then(|motor| motor.name()).map_or_else(String::new, |name| format!(" {name}"));
        put(frame, title, 0, &format!("following error of #{number}{name}: {unit}"), self.look.heading());
        trace::draw(frame, chart, trace, self.look, self.now);
    }
}

/// The first row to show, so that the selected row is the last in `room` lines; the first row of all if they all fit.
fn first_row(rows: &[Vec<String>], selected: usize, room: usize) -> usize {
    let mut left = room.saturating_sub(rows.get(selected).map_or(0, Vec::len));
    let mut from = selected.min(rows.len());
    while let Some(before) = from.checked_sub(1).filter(|before| rows[*before].len() <= left) {
        left -= rows[before].len();
        from = before;
    }
    from
}

/// Says at the end of the last of the `room` lines that more follow, if some do.
fn tell_of_the_rest(lines: &mut [(String, Style)], room: usize, width: usize) {
    let rest = lines.len().saturating_sub(room);
    let Some((last, _)) = room.checked_sub(1).and_then(|last| lines.get_mut(last)).filter(|_| rest > 0)
    else {
        return;
    };
    let note = format!(" +{rest} more lines");
    let kept = width.saturating_sub(note.len());
    *last = format!("{:<kept$}{note}", last.chars().take(kept).collect::<String>());
}

/// The lines, wrapped to the width.
fn wrap(lines: impl IntoIterator<Item = (String, Style)>, width: usize) -> Vec<(String, Style)> {
    let wrap = |(line, style): (String, Style)| {
        let lines = wrapped(&Visible(line).to_string(), 0, width);
        lines.into_iter().map(move |line| (line, style))
    };
    lines.into_iter().flat_map(wrap).collect()
}
