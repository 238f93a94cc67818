//! `pmacctl set-position`: tells a motor, which stands, at which position it is.

use clap::Args;

use crate::cli::act::jog::{counts, motors, number_and_unit};
use crate::cli::act::lines::LineError;
use crate::cli::act::wait::{Watch, place_of, see_position};
use crate::cli::console::confirm;
use crate::cli::context::{Context, Failure, Verdict, check_numbers};
use crate::client::number::fixed;
use crate::segment::UserUnit;

/// `set-position`.
#[derive(Debug, Args)]
pub struct SetPosition {
    /// The motor, by number or by its name in the configuration
    #[arg(value_name = "MOTOR")]
    pub motor: String,
    /// The position at which the motor is from now on, in counts (=5000) or, if the motor has a unit, in that (=12.5deg;
    /// counts are =5000counts then)
    #[arg(value_name = "=VALUE", value_parser = value, allow_hyphen_values = true)]
    pub position: (f64, Option<String>),
    /// Set the position without asking
    #[arg(long)]
    pub yes: bool,
}

fn value(text: &str) -> Result<(f64, Option<String>), String> {
    number_and_unit(text.strip_prefix('=').ok_or("write a position as =5000 or =12.5deg")?)
}

pub fn run(context: &mut Context, options: &SetPosition) -> Result<Verdict, Failure> {
    let SetPosition { motor, position: (value, unit), yes } = options;
    let not_set = |failure: Failure| failure.at("not set");
    let [number] = motors(context, std::slice::from_ref(motor))?[..] else {
        return Err(Failure::request("the position of one motor is set at a time; nothing was sent"));
    };
    let mut connection = context.connection()?;
    check_numbers(Context::family(None, &mut connection)?, true, &[number])?;
    let snapshot = context.board()?.snapshot()?;
    let has = snapshot.identity.units.get(usize::from(number) - 1).copied().flatten();
    let target = counts(*value, unit.as_deref(), has, number)?;
    let place = place_of(&snapshot, number).map_err(not_set)?;
    let told = told(target, has);
    if !confirm(&format!("Motor {number} is at {place}. Say that it is at {told}? Nothing moves."), *yes)? {
        return Ok(Verdict::No);
    }
    // The watch begins after the question, because from then on ^C ends only the watch.
    let mut watch = Watch::begin(context, &mut connection).map_err(not_set)?;
    let before = watch.rests_at(number).map_err(not_set)?;
    match connection.set_position(number, target).map_err(LineError::from) {
        Ok(()) => see_position(context, &mut connection, &mut watch, number, [before, target]),
        Err(LineError::Uncertain { failure, .. }) => {
            Err(failure.at(format_args!("the position of motor {number} MAY HAVE CHANGED")))
        }
        Err(error) => Err(error.into()),
    }
}

/// A position in counts and in the user's unit.
fn told(counts: f64, unit: Option<UserUnit>) -> String {
    let user = unit.map_or_else(String::new, |unit| {
        format!(" ({} {})", fixed(unit.of_counts(counts), unit.places()), &unit.name[..])
    });
    format!("{} counts{user}", fixed(counts, 1))
}
