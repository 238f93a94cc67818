//! ^A and ^K as keys at the prompt of `pmacctl terminal`. On an empty line they reach the board, as in a terminal
//! program on its serial port. On a line with text they do nothing: a user who edits the line means the editor's keys
//! of that name.

use std::sync::{Arc, Mutex, PoisonError};

use rustyline::{
    Cmd, ConditionalEventHandler, DefaultEditor, Event, EventContext, EventHandler, KeyEvent, RepeatCount,
};

use crate::protocol::control;

/// The keys.
const KEYS: [(char, u8); 2] = [('A', control::ABORT), ('K', control::KILL)];

/// A key that ended the editing of a line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pressed {
    /// The control character.
    pub character: u8,
    /// The line before and behind the cursor.
    pub line: (String, String),
}

/// The last pressed key, until the terminal takes it.
#[derive(Debug, Clone, Default)]
pub struct ControlKeys(Arc<Mutex<Option<Pressed>>>);

impl ControlKeys {
    /// Makes the keys end the editing in `editor`, as ^C does.
    pub fn bind(editor: &mut DefaultEditor) -> Self {
        let keys = Self::default();
        for (letter, character) in KEYS {
            let handler = Key { character, keys: keys.clone() };
            editor.bind_sequence(KeyEvent::ctrl(letter), EventHandler::Conditional(Box::new(handler)));
        }
        keys
    }

    /// The key that has ended the editing; `None` if it was ^C.
    pub fn take(&self) -> Option<Pressed> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

struct Key {
    character: u8,
    keys: ControlKeys,
}

impl ConditionalEventHandler for Key {
    fn handle(&self, _: &Event, _: RepeatCount, _: bool, context: &EventContext<'_>) -> Option<Cmd> {
        let (before, behind) = context.line().split_at_checked(context.pos()).unwrap_or((context.line(), ""));
        let pressed = Pressed { character: self.character, line: (before.to_owned(), behind.to_owned()) };
        *self.keys.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(pressed);
        Some(Cmd::Interrupt)
    }
}
