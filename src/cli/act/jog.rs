//! `pmacctl jog`: moves motors by hand: to a position, in a direction, or to a stop.
//!
//! Directions and stops are keys of the control panel; without a panel pmacctl sends them by command line. A position
//! always goes by command line; the daemon writes the line.

use clap::Args;

use crate::cli::act::hold::{Hold, hold};
use crate::cli::act::lines::LineError;
use crate::cli::act::panel::{Press, press};
use crate::cli::act::wait::{Goal, Wait, Watch, wait_for_motors};
use crate::cli::context::{Context, Failure, Verdict, check_numbers};
use crate::client::Connection;
use crate::client::number::short;
use crate::function::panel::PanelAction;
use crate::segment::{Identity, UserUnit};

/// The unit of every motor.
const COUNTS: &str = "counts";

/// `jog`.
#[derive(Debug, Args)]
pub struct Jog {
    /// The motor, by number or by its name in the configuration. Several motors, as 1,3, go in a direction or to a stop
    #[arg(value_name = "MOTOR", value_delimiter = ',', required = true, num_args = 1)]
    pub motors: Vec<String>,
    /// A position in counts (=5000) or, if the motor has a unit, in that (=12.5deg; counts are =5000counts then); a
    /// direction, + or -; or stop
    #[arg(value_name = "=POSITION|+|-|stop", value_parser = destination, allow_hyphen_values = true)]
    pub to: Destination,
    #[command(flatten)]
    pub hold: Hold,
    #[command(flatten)]
    pub wait: Wait,
}

/// The goal of a motor.
#[derive(Debug, Clone, PartialEq)]
pub enum Destination {
    /// To a position, in a unit if one is given.
    Position(f64, Option<String>),
    /// By a key of the control panel: on and on, or to a stop.
    Key(PanelAction),
}

fn destination(text: &str) -> Result<Destination, String> {
    let position = match text {
        "+" => return Ok(Destination::Key(PanelAction::JogPlus)),
        "-" => return Ok(Destination::Key(PanelAction::JogMinus)),
        "stop" => return Ok(Destination::Key(PanelAction::JogStop)),
        _ => text.strip_prefix('=').ok_or("write a position as =5000, or +, - or stop")?,
    };
    number_and_unit(position).map(|(value, unit)| Destination::Position(value, unit))
}

/// A number, and the unit behind it if there is one.
pub fn number_and_unit(position: &str) -> Result<(f64, Option<String>), String> {
    let position = position.trim();
    let (number, unit) = position.split_at(number_length(position));
    let value = number.parse().ok().filter(|value: &f64| value.is_finite());
    let value = value.ok_or_else(|| format!("{position:?}: write a number first, as =5000 or =12.5deg"))?;
    let unit = unit.trim();
    Ok((value, (!unit.is_empty()).then(|| unit.to_owned())))
}

/// The length of the number at the begin of `text`, with an exponent if one follows: `-1e3`, and of `1eV` only `1`.
fn number_length(text: &str) -> usize {
    let digits = |text: &str| text.bytes().take_while(u8::is_ascii_digit).count();
    let is_number = |character: char| character.is_ascii_digit() || "+-.".contains(character);
    let end = text.find(|character| !is_number(character)).unwrap_or(text.len());
    let Some(exponent) = text[end..].strip_prefix(['e', 'E']) else { return end };
    let sign = usize::from(exponent.starts_with(['+', '-']));
    match digits(&exponent[sign..]) {
        0 => end,
        count => end + 1 + sign + count,
    }
}

pub fn run(context: &mut Context, options: &Jog) -> Result<Verdict, Failure> {
    let Jog { motors, to, hold, wait } = options;
    let numbers = self::motors(context, motors)?;
    match to {
        Destination::Key(action @ (PanelAction::JogPlus | PanelAction::JogMinus))
            if hold.hold && !wait.wait =>
        {
            self::hold(context, *action, &numbers, hold.seconds)
        }
        _ if hold.hold => {
            Err(Failure::request("--hold goes with + or -, and not with --wait; nothing was sent"))
        }
        Destination::Key(action) => press(context, Press::of(*action), &numbers, *wait),
        Destination::Position(value, unit) => match numbers[..] {
            [number] => move_to(context, number, *value, unit.as_deref(), *wait),
            _ => Err(Failure::request("one motor goes to a position at a time; nothing was sent")),
        },
    }
}

fn move_to(
    context: &mut Context,
    number: u8,
    value: f64,
    unit: Option<&str>,
    wait: Wait,
) -> Result<Verdict, Failure> {
    let mut connection = context.connection()?;
    check_numbers(Context::family(None, &mut connection)?, true, &[number])?;
    let not_sent = |failure: Failure| failure.at("not sent");
    let mut watch = Watch::begin(context, &mut connection).map_err(not_sent)?;
    let units = watch.snapshot()?.identity.units;
    let target = counts(value, unit, units.get(usize::from(number) - 1).copied().flatten(), number)?;
    watch.check_motors(&[number]).map_err(not_sent)?;
    send(&mut connection, number, target)?;
    if !wait.wait {
        return Ok(Verdict::Yes);
    }
    wait_for_motors(context, &mut connection, &mut watch, &[number], Goal::At(target), wait.timeout)
}

/// The numbers of the motors that the user means.
///
/// # Errors
/// As [`motor`].
pub fn motors(context: &Context, texts: &[String]) -> Result<Vec<u8>, Failure> {
    texts.iter().map(|text| motor(text, || Ok(context.board()?.identity()?))).collect()
}

/// The number of the motor that the user means. `identity` knows the names.
///
/// # Errors
/// [`Failure::Request`] for a name that no motor has.
pub fn motor(text: &str, identity: impl FnOnce() -> Result<Identity, Failure>) -> Result<u8, Failure> {
    if text.starts_with(|first: char| first.is_ascii_digit()) {
        let number = text.parse().ok().filter(|number| *number > 0);
        return number.ok_or_else(|| Failure::Request(format!("there is no motor {text}")));
    }
    let named = |name: &Option<_>| name.as_deref() == Some(text);
    let index = identity()?.names.iter().position(named).and_then(|index| u8::try_from(index).ok());
    index.map(|index| index + 1).ok_or_else(|| {
        Failure::Request(format!(
            "no motor is called {text:?}; write its number, or give it a name under [[motor]] in pmacd's configuration"
        ))
    })
}

/// The position in counts. Refuses a number alone where the user could mean either of two units.
pub fn counts(value: f64, unit: Option<&str>, has: Option<UserUnit>, number: u8) -> Result<f64, Failure> {
    let (typed, has_name) = (short(value), has.as_ref().map(|unit| &unit.name[..]));
    match (unit, has) {
        (Some(COUNTS), _) | (None, None) => Ok(value),
        (Some(unit), Some(has)) if unit == &has.name[..] => Ok(value * has.counts_per_unit),
        (None, Some(has)) => {
            let name = &has.name[..];
            let why = format!(
                "motor {number} has the unit {name}: write ={typed}{name} or ={typed}{COUNTS}; nothing was sent"
            );
            Err(Failure::Request(why))
        }
        (Some(unit), _) => {
            let known = has_name.map_or_else(String::new, |name| format!("{name} and "));
            let why =
                format!("motor {number} has no unit {unit:?}: it knows {known}{COUNTS}; nothing was sent");
            Err(Failure::Request(why))
        }
    }
}

/// Has the daemon jog motor `number` to `target`, in counts.
///
/// # Errors
/// [`Failure`] says if the motor may be moving all the same.
pub fn send(connection: &mut Connection, number: u8, target: f64) -> Result<(), Failure> {
    match connection.jog_to(number, target).map_err(LineError::from) {
        Ok(()) => Ok(()),
        Err(LineError::Uncertain { failure, .. }) => {
            Err(failure.at(format_args!("motor {number} MAY BE MOVING")))
        }
        Err(error) => Err(error.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DEGREES: fn() -> UserUnit = || UserUnit { name: "deg".into(), counts_per_unit: -1000.0 };

    #[test]
    fn a_destination_is_typed_as_a_position_a_direction_or_stop() {
        for (text, value, unit) in [
            ("=5000", 5000.0, None),
            ("=-12.5deg", -12.5, Some("deg")),
            ("= 0.25 counts", 0.25, Some("counts")),
            ("=+3e", 3.0, Some("e")),
            ("=1°", 1.0, Some("°")),
            ("=-1e3", -1000.0, None),
            ("=1.5E+2deg", 150.0, Some("deg")),
            ("=25e-1 counts", 2.5, Some("counts")),
            ("=1eV", 1.0, Some("eV")),
        ] {
            assert_eq!(
                destination(text),
                Ok(Destination::Position(value, unit.map(str::to_owned))),
                "{text}"
            );
        }
        assert_eq!(destination("-"), Ok(Destination::Key(PanelAction::JogMinus)));
        assert_eq!(destination("stop"), Ok(Destination::Key(PanelAction::JogStop)));
        for text in
            ["", "5000", "=", "=deg", "=nan", "=inf", "=--1", "=1-2", "=1.2.3", "=1e999", "++", "halt"]
        {
            assert!(destination(text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_number_alone_is_not_taken_in_the_wrong_unit() {
        let of = |value, unit, has: Option<UserUnit>| {
            counts(value, unit, has, 1).map_err(|error| error.to_string())
        };
        assert_eq!(of(5.0, None, None), Ok(5.0));
        assert_eq!(of(5.0, Some("counts"), Some(DEGREES())), Ok(5.0));
        assert_eq!(of(-2.5, Some("deg"), Some(DEGREES())), Ok(2500.0));
        let told = of(90.0, None, Some(DEGREES())).unwrap_err();
        assert!(told.contains("write =90deg or =90counts; nothing was sent"), "{told}");
        assert!(of(1.0, Some("mm"), Some(DEGREES())).unwrap_err().contains("it knows deg and counts"));
        assert!(of(1.0, Some("deg"), None).unwrap_err().contains("it knows counts"));
    }

    #[test]
    fn a_motor_goes_by_number_or_name() {
        let identity = || {
            let mut identity = Identity::default();
            identity.names[2] = Some("focus".into());
            Ok(identity)
        };
        assert_eq!(motor("12", identity).unwrap(), 12);
        assert_eq!(motor("focus", identity).unwrap(), 3);
        for text in ["0", "1x", "256", "fokus", "", "#1"] {
            assert!(motor(text, identity).is_err(), "{text}");
        }
    }
}
