//! The state of `top`: selection, arming and typed text. The state knows neither terminal nor board.

use std::time::{Duration, Instant};

use ratatui::termion::event::Key;

use super::arming::{Arming, IDLE};
use super::hand::{Order, Told};
use super::keys::{Action, action};
use crate::cli::act::hold;
use crate::cli::console::late;
use crate::protocol::control;

/// The page that fills the screen.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub enum Page {
    #[default]
    Board,
    Status,
    Help,
}

/// The lines of a page of text are fewer.
const LONGEST_PAGE: usize = 100;

/// An effect outside the state.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Effect {
    Hand(Order),
    /// A control character, to the board.
    Character(u8),
    /// Watch these names from now on.
    Watch(Vec<String>),
    Suspend,
    Quit,
}

/// A sentence in the last line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Message {
    pub text: String,
    /// Something is wrong, or may be.
    pub alarm: bool,
}

/// A stop or control character whose outcome is still unknown.
#[derive(Debug, Clone, Copy)]
enum Waiting {
    Stop { motor: u8, since: Instant },
    Character { character: u8, since: Instant },
}

#[derive(Debug, Default)]
pub struct ScreenState {
    pub page: Page,
    /// The number of the selected motor.
    pub selected: usize,
    /// The first shown row of the coordinate systems.
    pub scrolled: usize,
    /// The first shown line of a page of text.
    pub turned: usize,
    pub arming: Arming,
    /// The motor that jogs.
    pub jogs: Option<u8>,
    /// The line that the user types.
    pub typed: Option<String>,
    pub message: Option<Message>,
    /// The names of the watched registers and variables.
    pub watches: Vec<String>,
    waiting: Vec<Waiting>,
    /// The numbers of the board's motors.
    motors: Vec<usize>,
    /// The number of coordinate systems.
    systems: usize,
}

impl ScreenState {
    pub fn new(watches: Vec<String>) -> Self {
        Self { watches, ..Self::default() }
    }

    /// Takes a new picture, with these motors and this many coordinate systems. Without `live` data the user cannot see
    /// the motors move.
    pub fn saw(&mut self, motors: Vec<usize>, systems: usize, live: bool) -> Vec<Effect> {
        self.motors = motors;
        self.systems = systems;
        if !self.motors.contains(&self.selected)
            && let Some(first) = self.motors.first()
        {
            self.selected = *first;
        }
        if !live && (self.arming.motor().is_some() || self.jogs.is_some()) {
            self.alarm("disarmed: the data are not live, so nobody can see what the motor does");
            return self.disarm();
        }
        Vec::new()
    }

    /// The user has pressed a key, at `now`.
    pub fn key(&mut self, key: Key, live: bool, now: Instant) -> Vec<Effect> {
        if let Some(typed) = self.typed.take() {
            return self.edit(typed, key);
        }
        let action = action(key);
        if let Action::Jog(direction) = action {
            return self.jog(direction, now);
        }
        let mut effects = self.disarm();
        self.message = None;
        match action {
            Action::Select(rows) if self.page == Page::Board => self.select(rows),
            Action::Select(rows) => self.turned = self.turned.saturating_add_signed(rows).min(LONGEST_PAGE),
            Action::Scroll(rows) => {
                let last = self.systems.saturating_sub(1);
                self.scrolled = self.scrolled.saturating_add_signed(rows).min(last);
            }
            Action::Arm => effects.extend(self.arm(live)),
            Action::Abort => effects.push(self.send(control::ABORT, now)),
            Action::Kill => effects.push(self.send(control::KILL, now)),
            Action::Prompt => self.typed = Some(String::new()),
            Action::Status => self.turn_to(Page::Status),
            Action::Help => self.turn_to(Page::Help),
            Action::Back => self.turn_to(Page::Board),
            Action::Suspend => effects.push(Effect::Suspend),
            Action::Quit => effects.push(Effect::Quit),
            Action::Jog(_) => {}
        }
        effects
    }

    /// The hand has reported an event, at `now`.
    pub fn told(&mut self, told: Told, now: Instant) -> Vec<Effect> {
        match told {
            Told::Armed(motor) => {
                self.arming.allowed(motor, now);
                if self.arming.motor() == Some(motor) {
                    self.say(&format!(
                        "#{motor} is armed: hold - or + down to jog it; any other key disarms"
                    ));
                }
            }
            Told::Refused(why) => {
                let what = if self.arming.motor().is_some() { "disarmed" } else { "not armed" };
                self.alarm(&format!("{what}: {why}"));
                return self.disarm();
            }
            Told::Jogs(motor) => {
                self.jogs = Some(motor);
                self.say(&format!("#{motor} jogs while the key is held down"));
            }
            Told::Stopping(motor) => self.waiting.push(Waiting::Stop { motor, since: now }),
            Told::Stopped(motor) => {
                self.jogs = None;
                self.waiting.retain(|waiting| !matches!(waiting, Waiting::Stop { .. }));
                self.say(&format!("#{motor}: the board has taken the stop"));
            }
            Told::Fault(text) => {
                self.jogs = None;
                self.waiting.retain(|waiting| !matches!(waiting, Waiting::Stop { .. }));
                self.alarm(&text);
                return self.disarm();
            }
            Told::Character(sent, result) => {
                self.waiting.retain(
                    |waiting| !matches!(waiting, Waiting::Character { character, .. } if *character == sent),
                );
                let name = control::name(sent);
                match result {
                    Ok(()) => self.say(&format!("{name}: the board took it")),
                    Err(why) => self.alarm(&format!("{name}: {why}")),
                }
            }
        }
        Vec::new()
    }

    /// Time has passed, until `now`.
    pub fn tick(&mut self, now: Instant) {
        if self.arming.idles(now) {
            self.say(&format!("disarmed: no jog key was pressed for {} s", IDLE.as_secs()));
        }
        let is_late = |since: Instant, limit: Duration| now.saturating_duration_since(since) >= limit;
        let late = self.waiting.iter().find_map(|waiting| match waiting {
            Waiting::Stop { motor, since } => {
                is_late(*since, hold::UNSURE_AFTER).then(|| hold::may_be_moving(&[*motor]))
            }
            Waiting::Character { character, since } => is_late(*since, late::WARN_AFTER)
                .then(|| format!("{}: {}", control::name(*character), late::UNANSWERED)),
        });
        if let Some(text) = late {
            self.alarm(&text);
        }
    }

    /// Stops every jog, and disarms.
    pub fn disarm(&mut self) -> Vec<Effect> {
        self.arming.disarm().map(Effect::Hand).into_iter().collect()
    }

    fn turn_to(&mut self, page: Page) {
        (self.page, self.turned) = (page, 0);
    }

    fn select(&mut self, rows: isize) {
        let at = self.motors.iter().position(|motor| *motor == self.selected).unwrap_or_default();
        let to = at.saturating_add_signed(rows).min(self.motors.len().saturating_sub(1));
        self.selected = self.motors.get(to).copied().unwrap_or_default();
    }

    fn arm(&mut self, live: bool) -> Option<Effect> {
        if self.page != Page::Board {
            self.alarm("not armed: the motors are not on the screen; Esc shows them");
            return None;
        }
        let motor = u8::try_from(self.selected).ok().filter(|motor| *motor > 0);
        if !live || motor.is_none() {
            self.alarm("not armed: the data are not live, so nobody can see what the motor does");
            return None;
        }
        let motor = motor?;
        self.arming = Arming::Asked(motor);
        Some(Effect::Hand(Order::Arm(motor)))
    }

    fn jog(&mut self, direction: crate::function::panel::PanelAction, now: Instant) -> Vec<Effect> {
        match self.arming.press(direction, now) {
            None => {
                self.say("the jog keys are not armed: a arms them for the selected motor");
                Vec::new()
            }
            Some(order) => order.map(Effect::Hand).into_iter().collect(),
        }
    }

    fn send(&mut self, character: u8, now: Instant) -> Effect {
        self.waiting.push(Waiting::Character { character, since: now });
        self.say(&format!("{} is sent", control::name(character)));
        Effect::Character(character)
    }

    /// A key in the line that the user types.
    fn edit(&mut self, mut typed: String, key: Key) -> Vec<Effect> {
        match key {
            Key::Char('\n') => return self.enter(&typed),
            Key::Char(character) => typed.push(character),
            Key::Backspace if typed.pop().is_none() => return Vec::new(),
            Key::Esc | Key::Ctrl('c') => return Vec::new(),
            _ => {}
        }
        self.typed = Some(typed);
        Vec::new()
    }

    fn enter(&mut self, typed: &str) -> Vec<Effect> {
        let mut words = typed.split_whitespace().map(str::to_owned);
        match words.next().as_deref() {
            None => return Vec::new(),
            Some("q" | "quit") => return vec![Effect::Quit],
            Some("watch") => {
                let before = self.watches.len();
                for word in words {
                    if !self.watches.contains(&word) {
                        self.watches.push(word);
                    }
                }
                if self.watches.len() == before {
                    self.say("write watch P1 M102 I122 X:$0028 1.actual_position");
                    return Vec::new();
                }
            }
            Some("unwatch") => {
                let unwanted: Vec<String> = words.collect();
                self.watches.retain(|name| !unwanted.is_empty() && !unwanted.contains(name));
            }
            Some(other) => {
                self.alarm(&format!("{other}: unknown; write watch NAME..., unwatch [NAME...] or quit"));
                return Vec::new();
            }
        }
        vec![Effect::Watch(self.watches.clone())]
    }

    fn say(&mut self, text: &str) {
        self.message = Some(Message { text: text.to_owned(), alarm: false });
    }

    fn alarm(&mut self, text: &str) {
        self.message = Some(Message { text: text.to_owned(), alarm: true });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: fn(u64) -> Duration = Duration::from_millis;

    fn seeing(motors: &[usize]) -> ScreenState {
        let mut state = ScreenState::default();
        assert_eq!(state.saw(motors.to_vec(), 8, true), []);
        state
    }

    fn armed(now: Instant) -> ScreenState {
        let mut state = seeing(&[1, 2, 5]);
        state.key(Key::Down, true, now);
        state.key(Key::Down, true, now);
        assert_eq!(state.key(Key::Char('a'), true, now), [Effect::Hand(Order::Arm(5))]);
        state.told(Told::Armed(5), now);
        assert_eq!(state.arming.motor(), Some(5));
        state
    }

    fn said(state: &ScreenState) -> &str {
        state.message.as_ref().map_or("", |message| &message.text)
    }

    #[test]
    fn motors_are_selected_as_they_are_reported() {
        let now = Instant::now();
        let mut state = seeing(&[1, 2, 5]);
        assert_eq!(state.selected, 1);
        for (key, selected) in
            [(Key::Down, 2), (Key::PageDown, 5), (Key::Down, 5), (Key::PageUp, 1), (Key::Up, 1)]
        {
            state.key(key, true, now);
            assert_eq!(state.selected, selected, "{key:?}");
        }
        state.saw(vec![3, 4], 8, true);
        assert_eq!(state.selected, 3);
    }

    #[test]
    fn any_other_key_stops_and_disarms() {
        let now = Instant::now();
        for key in [Key::Down, Key::Char(' '), Key::Esc, Key::Char('?'), Key::Char(':')] {
            let mut state = armed(now);
            state.key(Key::Right, true, now);
            state.key(Key::Right, true, now + MS(300));
            state.told(Told::Jogs(5), now + MS(310));
            assert_eq!(state.key(key, true, now + MS(320)), [Effect::Hand(Order::Stop)], "{key:?}");
            assert_eq!(state.arming.motor(), None);
        }
    }

    #[test]
    fn a_jog_key_needs_armed_keys_and_live_data() {
        let now = Instant::now();
        let mut state = seeing(&[1]);
        assert_eq!(state.key(Key::Right, true, now), []);
        assert!(said(&state).contains("a arms them"));
        assert_eq!(state.key(Key::Char('a'), false, now), []);
        assert!(said(&state).contains("not live"));
        let mut state = armed(now);
        state.key(Key::Left, true, now);
        state.key(Key::Left, true, now + MS(300));
        state.told(Told::Jogs(5), now + MS(310));
        assert_eq!(state.saw(vec![1, 2, 5], 8, false), [Effect::Hand(Order::Stop)]);
        assert!(said(&state).contains("disarmed"));
    }

    #[test]
    fn what_is_refused_says_why_and_disarms() {
        let now = Instant::now();
        let mut state = armed(now);
        state.told(Told::Refused("not permitted".to_owned()), now);
        assert_eq!((said(&state), state.arming.motor()), ("disarmed: not permitted", None));
        state.key(Key::Char('a'), true, now);
        state.told(Told::Refused("not permitted".to_owned()), now);
        assert_eq!(said(&state), "not armed: not permitted");
        state.told(Told::Armed(5), now);
        assert_eq!(state.arming.motor(), None, "the answer to an older question");
    }

    #[test]
    fn a_stop_that_is_not_confirmed_is_told_soon() {
        let now = Instant::now();
        let mut state = armed(now);
        state.told(Told::Jogs(5), now);
        state.told(Told::Stopping(5), now);
        state.tick(now + MS(590));
        assert!(!said(&state).contains("MAY BE MOVING"));
        state.tick(now + MS(600));
        assert!(said(&state).contains("motor 5 MAY BE MOVING"));
        state.told(Told::Stopped(5), now + MS(900));
        state.tick(now + MS(2000));
        assert_eq!(said(&state), "#5: the board has taken the stop");
        assert_eq!(state.key(Key::Ctrl('a'), true, now), [Effect::Character(1)]);
        state.tick(now + MS(1000));
        assert!(said(&state).contains("nothing is known to stand"));
    }

    #[test]
    fn watches_are_typed() {
        let now = Instant::now();
        let mut state = seeing(&[1]);
        let mut line = |text: &str| {
            let keys = ":".chars().chain(text.chars()).chain(['\n']);
            keys.flat_map(|key| state.key(Key::Char(key), true, now)).collect::<Vec<_>>()
        };
        let watch = |names: &[&str]| vec![Effect::Watch(names.iter().map(|&name| name.to_owned()).collect())];
        assert_eq!(line("watch P1 M102"), watch(&["P1", "M102"]));
        assert_eq!(line("watch P1 X:$28"), watch(&["P1", "M102", "X:$28"]));
        assert_eq!(line("watch"), []);
        assert_eq!(line("unwatch M102"), watch(&["P1", "X:$28"]));
        assert_eq!(line("unwatch"), watch(&[]));
        assert_eq!(line("frob"), []);
        assert_eq!(line(""), []);
        assert_eq!(line("quit"), [Effect::Quit]);
        assert_eq!(state.typed, None);
    }
}
