//! The registers and variables whose values `top` shows.
//!
//! PMAC copies registers in its background (I55=1). The program asks for variables by command line, for M-variables with the
//! role engineer.

use std::time::Duration;

use crate::cli::act::watch_values::Copied;
use crate::cli::context::{Context, Failure};
use crate::cli::layout::board_layout;
use crate::client::command::variables::board_variable;
use crate::client::number::NOT_READ;
use crate::client::{Board, VariableWatch};

/// How long the board may take for the variables.
const VARIABLES_WITHIN: Duration = Duration::from_secs(2);

/// The watched names and values, and the reasons for missing values.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Watched {
    pub values: Vec<(String, String)>,
    pub fault: Option<String>,
}

#[derive(Default)]
pub struct Watches {
    names: Vec<String>,
    /// The watched registers, while a daemon has them copied.
    registers: Option<Registers>,
}

/// A name in the user's spelling, and with its value for the screen.
type Found = (String, (String, String));

struct Registers {
    board: Board,
    wanted: Vec<(String, Copied)>,
    held: VariableWatch,
}

impl Watches {
    /// Watches these names from now on.
    pub fn set(&mut self, names: Vec<String>) {
        *self = Self { names, registers: None };
    }

    /// The present values.
    pub fn look(&mut self, context: &Context) -> Watched {
        let is_variable = |name: &String| board_variable(name).is_some();
        let (variables, registers): (Vec<_>, Vec<_>) = self.names.iter().cloned().partition(is_variable);
        let asked = ask(context, &variables);
        let copied = self.copied(context, registers);
        let value = |name: &String| {
            let found = asked.iter().chain(&copied).flatten().find(|(typed, _)| typed == name);
            found.map_or_else(|| (name.clone(), NOT_READ.to_owned()), |(_, shown)| shown.clone())
        };
        let values = self.names.iter().map(value).collect();
        let fault = asked.err().or(copied.err()).map(|failure| failure.to_string());
        Watched { values, fault }
    }

    /// The registers' values.
    fn copied(&mut self, context: &Context, names: Vec<String>) -> Result<Vec<Found>, Failure> {
        if names.is_empty() {
            return Ok(Vec::new());
        }
        // A new daemon holds no registers of the last daemon.
        let mut registers = match self.registers.take() {
            Some(registers) => registers,
            None => Registers::begin(context, names)?,
        };
        registers.held.check()?;
        // The watch stays held while the board has not copied any register yet.
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
        let found = |(name, wanted): &(String, Copied)| Some((name.clone(), (name.clone(), text(wanted)?)));
        Ok(self.wanted.iter().filter_map(found).collect())
    }
}

/// Asks the board for the variables. Q-variables belong to the addressed coordinate system.
fn ask(context: &Context, names: &[String]) -> Result<Vec<Found>, Failure> {
    if names.is_empty() {
        return Ok(Vec::new());
    }
    let is_of_system = |name: &String| name.starts_with(['Q', 'q']);
    let mut connection = context.connection()?;
    let system = match names.iter().any(is_of_system) {
        // Only an engineer may ask this. The values come without it.
        true => connection.question("&", VARIABLES_WITHIN).ok().and_then(|said| said.into_iter().next()),
        false => None,
    };
    let answers = connection.ask_variables(names, VARIABLES_WITHIN)?;
    let found = |(name, answer): (&String, String)| {
        let system = system.as_ref().filter(|_| is_of_system(name));
        (name.clone(), (system.map_or_else(|| name.clone(), |system| format!("&{system} {name}")), answer))
    };
    Ok(names.iter().zip(answers).map(found).collect())
}
