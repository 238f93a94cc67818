//! Draws the screen of `top`. Decides on the parts that fit; the data come from other modules.

mod board;
mod look;
mod pages;
mod rooms;
mod trace;

#[cfg(test)]
mod tests;

use std::time::{Duration, Instant};

use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::style::Style;

use super::asker::DaemonAnswer;
use super::state::{Page, ScreenState};
use super::trace::Traces;
use crate::cli::console::table::wrapped;
use crate::cli::show::status;
use crate::client::{Snapshot, Staleness};
use crate::format::Visible;
use crate::protocol::board::REPLAY_OVER;

pub use look::Look;

/// A daemon that answers at all answers within this time.
const DAEMON_SILENT_FOR: Duration = Duration::from_secs(3);

/// All data of the picture.
pub struct Picture<'a> {
    pub name: &'a str,
    /// The segment's data, or the reason for their absence.
    pub snapshot: Result<&'a Snapshot, &'a str>,
    pub answer: Option<&'a DaemonAnswer>,
    pub traces: &'a Traces,
    pub state: &'a ScreenState,
    pub look: Look,
    pub now: Instant,
}

impl Picture<'_> {
    pub fn draw(&self, frame: &mut Frame<'_>) {
        let said = self.last_lines(usize::from(frame.area().width));
        let [title, body, last] = split(frame.area(), rows(said.len()));
        self.title(frame, title);
        match self.state.page {
            Page::Board => self.board(frame, body),
            Page::Status => self.page(frame, body, &self.status_page()),
            Page::Help => self.page(frame, body, &pages::help()),
        }
        self.last(frame, last, &said);
    }

    /// The reason that the motors' data are not live, in `status`'s words.
    fn fault(&self) -> Option<String> {
        let snapshot = match self.snapshot {
            Ok(snapshot) => snapshot,
            Err(why) => return Some(format!("no data: {why}")),
        };
        match &snapshot.servo {
            Some(servo) => servo.stale.map(|stale| format!("STALE: {}", self.why(stale))),
            None => {
                let why = self.why(snapshot.stale.unwrap_or(Staleness::Off));
                Some(format!("STALE: there are no servo data yet: {why}"))
            }
        }
    }

    /// Why data are `stale`; for a replay, its end.
    fn why(&self, stale: Staleness) -> String {
        let is_over = self.answer.is_some_and(|answer| answer.status["socket"]["replay"]["over"] == true);
        if is_over { REPLAY_OVER.to_owned() } else { stale.to_string() }
    }

    /// The daemon's reason for the other data, if they are not live.
    fn daemon_fault(&self) -> Option<String> {
        let answer = self.answer?;
        let silent = self.now.saturating_duration_since(answer.at);
        if silent > DAEMON_SILENT_FOR {
            return Some(format!("pmacd has not answered for {} s", silent.as_secs()));
        }
        let condition = answer.status["condition"].as_str().filter(|condition| *condition != "live")?;
        let reason =
            answer.status["reason"].as_str().map_or_else(String::new, |reason| format!(": {reason}"));
        Some(format!("{condition}{reason}"))
    }

    fn title(&self, frame: &mut Frame<'_>, area: Rect) {
        let update = self.snapshot.ok().and_then(|snapshot| snapshot.servo.as_ref());
        let update = update.map_or_else(String::new, |servo| format!("  update {}", servo.sequence));
        let is_replay = self.snapshot.is_ok_and(|snapshot| snapshot.identity.replay);
        let (replay, style) = match is_replay {
            true => (" REPLAY, no board", self.look.warning()),
            false => ("", self.look.title()),
        };
        let left = format!("{replay} {}{update}", self.name);
        let right = "? keys  q end ";
        let width = usize::from(area.width);
        let gap = width.saturating_sub(left.chars().count() + right.len());
        let text = if gap == 0 { left } else { format!("{left}{}{right}", " ".repeat(gap)) };
        put(frame, area, 0, &text, Style::new());
        frame.buffer_mut().set_style(area, style);
    }

    /// The motor that jogs or may jog.
    fn armed(&self) -> String {
        match (self.state.jogs, self.state.arming.motor()) {
            (Some(motor), _) => format!(" #{motor} JOGS "),
            (None, Some(motor)) => format!(" #{motor} ARMED "),
            (None, None) => String::new(),
        }
    }

    /// The last lines: the typed text, or the armed motor and the last message. Shows warnings whole.
    fn last_lines(&self, width: usize) -> Vec<String> {
        let armed = self.armed();
        let text = match (&self.state.typed, &self.state.message) {
            (Some(typed), _) => return vec![format!(":{typed}_")],
            (None, Some(message)) => message.text.as_str(),
            (None, None) if armed.is_empty() => "a arms the jog keys, : watches",
            (None, None) => "",
        };
        wrapped(&format!("{armed} {}", Visible(text)), 0, width)
    }

    fn last(&self, frame: &mut Frame<'_>, area: Rect, lines: &[String]) {
        let is_alarm = self.state.message.as_ref().is_some_and(|message| message.alarm);
        let style = if is_alarm { self.look.alarm() } else { Style::new() };
        for (row, line) in (0..area.height).zip(lines) {
            put(frame, area, row, line, style);
        }
        if self.state.typed.is_none() {
            let armed =
                Rect { width: rows(self.armed().len()).min(area.width), height: area.height.min(1), ..area };
            frame.buffer_mut().set_style(armed, self.look.warning());
        }
    }

    /// A page of text, from the line to which the user has scrolled.
    fn page(&self, frame: &mut Frame<'_>, area: Rect, lines: &[(String, String)]) {
        let begin = lines.iter().map(|(about, _)| about.chars().count()).max().unwrap_or_default() + 1;
        let lines = lines.iter().map(|(about, text)| {
            if about.is_empty() {
                return wrapped(text, 0, usize::from(area.width));
            }
            let line = Visible(format!("{about:<begin$}{text}")).to_string();
            wrapped(&line, begin, usize::from(area.width))
        });
        let lines: Vec<String> = lines.flatten().collect();
        let from = self.state.turned.min(lines.len().saturating_sub(area.height.into()));
        for (row, line) in (0..area.height).zip(&lines[from..]) {
            put(frame, area, row, line, Style::new());
        }
    }

    /// The lines of `status` about `what`.
    fn said(&self, what: &str) -> Vec<String> {
        let lines = self.answer.map(|answer| status::lines(&answer.status)).unwrap_or_default();
        lines
            .into_iter()
            .filter(|(about, _)| about == what)
            .map(|(about, text)| format!("{about:<15} {text}"))
            .collect()
    }
}

/// The title, the part between, and the last lines.
fn split(area: Rect, last: u16) -> [Rect; 3] {
    let title = Rect { height: area.height.min(1), ..area };
    let last = last.min(area.height - title.height);
    let body = area.height - title.height - last;
    let row = |y: u16, height: u16| Rect { y: area.y + y, height, ..area };
    [title, row(title.height, body), row(title.height + body, last)]
}

/// `count` rows of a screen, at most the number that a screen can count.
fn rows(count: usize) -> u16 {
    u16::try_from(count).unwrap_or(u16::MAX)
}

/// A line of text in a row of an area, cut at the area's end.
fn put(frame: &mut Frame<'_>, area: Rect, row: u16, text: &str, style: Style) {
    if row < area.height {
        // The text may contain the board's words.
        let text = Visible(text).to_string();
        frame.buffer_mut().set_stringn(area.x, area.y + row, text, usize::from(area.width), style);
    }
}
