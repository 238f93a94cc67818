//! What each key of `top` does: the table that `?` shows.

use ratatui::termion::event::Key;

use crate::function::panel::PanelAction;

/// What a key asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Action {
    /// The motor so many rows further down is selected.
    Select(isize),
    /// The coordinate systems are shown from so many rows further down.
    Scroll(isize),
    Arm,
    /// While it is held down.
    Jog(PanelAction),
    Abort,
    Kill,
    /// A line is typed.
    Prompt,
    Status,
    Help,
    /// Back to the motors; or only the end of what another key began.
    Back,
    Suspend,
    Quit,
}

/// A line of the table.
pub struct Binding {
    keys: &'static [Key],
    /// The keys as people write them.
    pub shown: &'static str,
    action: Action,
    pub does: &'static str,
}

/// Rows of a page.
const PAGE: isize = 8;

/// Every key. Any key but the jog keys also stops a jog and disarms.
pub const BINDINGS: &[Binding] = &[
    Binding {
        keys: &[Key::Up, Key::Char('k')],
        shown: "up, k",
        action: Action::Select(-1),
        does: "select the motor above",
    },
    Binding {
        keys: &[Key::Down, Key::Char('j')],
        shown: "down, j",
        action: Action::Select(1),
        does: "select the motor below",
    },
    Binding {
        keys: &[Key::PageUp],
        shown: "page up",
        action: Action::Select(-PAGE),
        does: "select a motor further up",
    },
    Binding {
        keys: &[Key::PageDown],
        shown: "page down",
        action: Action::Select(PAGE),
        does: "select a motor further down",
    },
    Binding {
        keys: &[Key::Char('[')],
        shown: "[",
        action: Action::Scroll(-1),
        does: "show the coordinate systems further up",
    },
    Binding {
        keys: &[Key::Char(']')],
        shown: "]",
        action: Action::Scroll(1),
        does: "show the coordinate systems further down",
    },
    Binding {
        keys: &[Key::Char('a')],
        shown: "a",
        action: Action::Arm,
        does: "arm the jog keys for the selected motor",
    },
    Binding {
        keys: &[Key::Left, Key::Char('-')],
        shown: "left, -",
        action: Action::Jog(PanelAction::JogMinus),
        does: "armed and held down: jog in the negative direction",
    },
    Binding {
        keys: &[Key::Right, Key::Char('+')],
        shown: "right, +",
        action: Action::Jog(PanelAction::JogPlus),
        does: "armed and held down: jog in the positive direction",
    },
    Binding {
        keys: &[Key::Ctrl('a')],
        shown: "^A",
        action: Action::Abort,
        does: "abort all motion, as pmacctl abort",
    },
    Binding {
        keys: &[Key::Ctrl('k')],
        shown: "^K",
        action: Action::Kill,
        does: "kill every motor, as pmacctl kill",
    },
    Binding {
        keys: &[Key::Char(':')],
        shown: ":",
        action: Action::Prompt,
        does: "type watch NAME..., unwatch [NAME...] or quit",
    },
    Binding {
        keys: &[Key::Char('s')],
        shown: "s",
        action: Action::Status,
        does: "show the status of the daemon and the board",
    },
    Binding { keys: &[Key::Char('?')], shown: "?", action: Action::Help, does: "show the keys" },
    Binding { keys: &[Key::Esc], shown: "esc", action: Action::Back, does: "disarm; go back to the motors" },
    Binding { keys: &[Key::Ctrl('z')], shown: "^Z", action: Action::Suspend, does: "suspend, until fg" },
    Binding {
        keys: &[Key::Char('q'), Key::Ctrl('c'), Key::Ctrl('d')],
        shown: "q, ^C",
        action: Action::Quit,
        does: "end",
    },
];

/// What `key` asks for; any other key only ends a jog.
pub fn action(key: Key) -> Action {
    let found = BINDINGS.iter().find(|binding| binding.keys.contains(&key));
    found.map_or(Action::Select(0), |binding| binding.action)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_key_has_two_meanings() {
        let keys: Vec<Key> = BINDINGS.iter().flat_map(|binding| binding.keys.iter().copied()).collect();
        for (index, key) in keys.iter().enumerate() {
            assert!(!keys[index + 1..].contains(key), "{key:?}");
        }
        assert_eq!(action(Key::Right), Action::Jog(PanelAction::JogPlus));
        assert_eq!(action(Key::F(1)), Action::Select(0), "no key of the table moves nothing");
    }
}
