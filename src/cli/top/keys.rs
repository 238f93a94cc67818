//! The effect of each key of `top`: the table that `?` shows.

use ratatui::termion::event::Key;

use crate::function::panel::PanelAction;

/// The action of a key.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Action {
    /// Selects the motor this many rows further down.
    Select(isize),
    /// Shows the coordinate systems from this many rows further down.
    Scroll(isize),
    Arm,
    /// Jogs while the user holds the key down.
    Jog(PanelAction),
    Abort,
    Kill,
    /// Begins the entry of a line.
    Prompt,
    Status,
    Help,
    /// Returns to the motors, or only ends another key's entry.
    Back,
    Suspend,
    Quit,
}

/// A line of the table.
pub struct Binding {
    keys: &'static [Key],
    /// The keys as the help shows them.
    pub shown: &'static str,
    action: Action,
    pub does: &'static str,
}

const fn binding(keys: &'static [Key], shown: &'static str, action: Action, does: &'static str) -> Binding {
    Binding { keys, shown, action, does }
}

/// Rows of a page.
const PAGE: isize = 8;

/// Every key. Any key but the jog keys also stops a jog and disarms.
pub const BINDINGS: &[Binding] = &[
    binding(&[Key::Up, Key::Char('k')], "up, k", Action::Select(-1), "select the motor above"),
    binding(&[Key::Down, Key::Char('j')], "down, j", Action::Select(1), "select the motor below"),
    binding(&[Key::PageUp], "page up", Action::Select(-PAGE), "select a motor further up"),
    binding(&[Key::PageDown], "page down", Action::Select(PAGE), "select a motor further down"),
    binding(&[Key::Char('[')], "[", Action::Scroll(-1), "show the coordinate systems further up"),
    binding(&[Key::Char(']')], "]", Action::Scroll(1), "show the coordinate systems further down"),
    binding(&[Key::Char('a')], "a", Action::Arm, "arm the jog keys for the selected motor"),
    binding(
        &[Key::Left, Key::Char('-')],
        "left, -",
        Action::Jog(PanelAction::JogMinus),
        "armed and held down: jog in the negative direction",
    ),
    binding(
        &[Key::Right, Key::Char('+')],
        "right, +",
        Action::Jog(PanelAction::JogPlus),
        "armed and held down: jog in the positive direction",
    ),
    binding(&[Key::Ctrl('a')], "^A", Action::Abort, "abort all motion, as pmacctl abort"),
    binding(&[Key::Ctrl('k')], "^K", Action::Kill, "kill every motor, as pmacctl kill"),
    binding(&[Key::Char(':')], ":", Action::Prompt, "type watch NAME..., unwatch [NAME...] or quit"),
    binding(&[Key::Char('s')], "s", Action::Status, "show the status of the daemon and the board"),
    binding(&[Key::Char('?')], "?", Action::Help, "show the keys"),
    binding(&[Key::Esc], "esc", Action::Back, "disarm; go back to the motors"),
    binding(&[Key::Ctrl('z')], "^Z", Action::Suspend, "suspend, until fg"),
    binding(&[Key::Char('q'), Key::Ctrl('c'), Key::Ctrl('d')], "q, ^C", Action::Quit, "end"),
];

/// The action of `key`; a key that the table lacks only ends a jog.
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
