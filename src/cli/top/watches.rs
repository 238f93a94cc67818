//! The registers and variables that `top` shows the values of.
//!
//! PMAC copies registers in its background (I55=1). Variables are asked for by command line, which needs the role engineer.

use std::time::Duration;

use crate::cli::act::watch_values::{Copied, board_variable};
use crate::cli::context::{Context, Failure};
use crate::cli::layout::board_layout;
use crate::client::number::NOT_READ;
use crate::client::{Board, Connection, VariableWatch};
use crate::protocol::LINE_MAX;

/// How long the board may take for the variables.
const ANSWER: Duration = Duration::from_secs(2);

/// What is watched now, by name and value, and why some have no value.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Watched {
    pub values: Vec<(String, String)>,
    pub fault: Option<String>,
}

#[derive(Default)]
pub struct Watches {
    names: Vec<String>,
    /// While there are registers among them, and a daemon that has them copied.
    registers: Option<Registers>,
}

/// A value that was found.
struct Found {
    name: String,
    /// The coordinate system that it belongs to.
    system: Option<String>,
    text: String,
}

impl Found {
    fn label(&self) -> String {
        let system = self.system.as_ref();
        system.map_or_else(|| self.name.clone(), |system| format!("&{system} {}", self.name))
    }
}

struct Registers {
    board: Board,
    wanted: Vec<(String, Copied)>,
    held: VariableWatch,
}

/// Whether it belongs to a coordinate system.
fn is_of_system(name: &str) -> bool {
    name.starts_with(['Q', 'q'])
}

impl Watches {
    /// From now on these.
    pub fn set(&mut self, names: Vec<String>) {
        *self = Self { names, registers: None };
    }

    /// Their values now.
    pub fn look(&mut self, context: &Context) -> Watched {
        let variables: Vec<&str> =
            self.names.iter().map(String::as_str).filter(|name| board_variable(name).is_some()).collect();
        let asked = if variables.is_empty() { Ok(Vec::new()) } else { ask(context, &variables) };
        let copied = self.copied(context);
        let value = |name: &String| {
            let mut found = asked.iter().chain(&copied).flatten();
            let found = found.find(|value| value.name == *name);
            found.map_or_else(
                || (name.clone(), NOT_READ.to_owned()),
                |value| (value.label(), value.text.clone()),
            )
        };
        let values = self.names.iter().map(value).collect();
        let fault = asked.err().or(copied.err()).map(|failure| failure.to_string());
        Watched { values, fault }
    }

    /// The registers' values.
    fn copied(&mut self, context: &Context) -> Result<Vec<Found>, Failure> {
        let names: Vec<String> =
            self.names.iter().filter(|name| board_variable(name).is_none()).cloned().collect();
        if names.is_empty() {
            return Ok(Vec::new());
        }
        // Another daemon holds none of the last one's.
        let mut registers = match self.registers.take() {
            Some(registers) => registers,
            None => Registers::begin(context, names)?,
        };
        registers.held.check()?;
        // It stays held while the board has not copied anything yet.
        self.registers.insert(registers).values()
    }
}

impl Registers {
    fn begin(context: &Context, names: Vec<String>) -> Result<Self, Failure> {
        let mut board = context.board()?;
        let (layout, scales, _) = board_layout(&mut board)?;
        let parse = |name: String| {
            let wanted = Copied::parse(&name, &layout, &scales)?;
            Ok((name, wanted))
        };
        let wanted = names.into_iter().map(parse).collect::<Result<Vec<_>, Failure>>()?;
        let names: Vec<_> = wanted.iter().map(|(_, wanted)| wanted.name()).collect();
        let held = board.watch_variables(&names)?;
        Ok(Self { board, wanted, held })
    }

    fn values(&mut self) -> Result<Vec<Found>, Failure> {
        let Some(view) = self.board.variables()? else { return Ok(Vec::new()) };
        if let Some(stale) = view.stale {
            return Err(Failure::Refused(format!("STALE: {stale}")));
        }
        let is_new = view.data.has_come_to(self.held.table());
        let text = |wanted: &Copied| wanted.text(&view.data).filter(|_| is_new);
        let found = |(name, wanted): &(String, Copied)| {
            Some(Found { name: name.clone(), system: None, text: text(wanted)? })
        };
        Ok(self.wanted.iter().filter_map(found).collect())
    }
}

/// Asks the board for the variables. A line of the reply for each.
fn ask(context: &Context, names: &[&str]) -> Result<Vec<Found>, Failure> {
    let mut connection = context.connection()?;
    let system = match names.iter().any(|name| is_of_system(name)) {
        // Q-variables are those of the coordinate system that is addressed.
        true => one_line(&mut connection, "&")?.into_iter().next(),
        false => None,
    };
    let mut values = Vec::new();
    for line in lines_of(names) {
        let replies = one_line(&mut connection, &line)?;
        for (name, text) in line.split(' ').zip(replies) {
            let system = system.clone().filter(|_| is_of_system(name));
            values.push(Found { name: name.to_owned(), system, text });
        }
    }
    Ok(values)
}

fn one_line(connection: &mut Connection, line: &str) -> Result<Vec<String>, Failure> {
    Ok(connection.question(line, ANSWER)?)
}

/// The names in as few command lines as they fit into.
fn lines_of(names: &[&str]) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for name in names {
        match lines.last_mut().filter(|line| line.len() + 1 + name.len() <= LINE_MAX) {
            Some(line) => *line += &format!(" {name}"),
            None => lines.push((*name).to_owned()),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_never_too_long_for_the_board() {
        let names = vec!["P1023"; 100];
        let lines = lines_of(&names);
        assert!(lines.iter().all(|line| line.len() <= LINE_MAX), "{lines:?}");
        assert_eq!(lines.join(" ").split(' ').count(), 100);
        assert_eq!(lines_of(&["P1", "M2"]), ["P1 M2"]);
    }
}
