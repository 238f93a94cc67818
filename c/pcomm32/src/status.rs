//! The board's reports from the segment: no access to the board, no Host-Busy.
//!
//! Old data are an error: a number that a program cannot tell from a live one would be taken for it.

use pmac_dpram::client::{Motor, Snapshot, Staleness, View, identity};
use pmac_dpram::decode::{BackgroundData, CoordinateSystem, Quantity, ServoData};
use pmac_dpram::map::{Family, Generation};

use crate::config::Units;
use crate::device::Device;
use crate::fault::Fault;
use crate::process::{self, with};
use crate::{memory, variables};

/// What makes the board send its reports.
const TO_ENABLE: &str = "pmacctl setup enable servo background, once";

fn live<'a, T>(view: Option<&'a View<T>>, snapshot: &Snapshot, report: &str) -> Result<&'a T, Fault> {
    let stale = match view {
        Some(View { stale: None, data, .. }) => return Ok(data),
        Some(view) => view.stale,
        None => snapshot.stale,
    };
    let why = match stale {
        Some(Staleness::Off) => format!("pmacd does not use it: {TO_ENABLE}"),
        Some(stale) => stale.to_string(),
        None => format!("the board has sent none: {TO_ENABLE}"),
    };
    Err(Fault::refused(format!("the {report} report is not live: {why}")))
}

/// The number of a motor or coordinate system, from 1, that a program calls `index`.
fn numbered(index: i32) -> Result<usize, Fault> {
    let first = process::config()?.first_motor;
    let number = i64::from(index) - i64::from(first) + 1;
    let number = usize::try_from(number).ok().filter(|number| *number > 0);
    number.ok_or_else(|| {
        Fault::argument(format!("{index}: the first is {first} (first_motor in docs/pcomm32.md)"))
    })
}

fn snapshot<T>(number: u32, work: impl FnOnce(&Snapshot) -> Result<T, Fault>) -> Result<T, Fault> {
    with(number, |device| work(&device.read(|board| Ok(board.snapshot()?))?))
}

fn family(snapshot: &Snapshot) -> Result<&'static Family, Fault> {
    identity::family(&snapshot.identity).ok_or_else(|| Fault::refused("the board's family is not known here"))
}

/// What `pick` finds about a motor.
pub(crate) fn motor<T>(
    number: u32,
    index: i32,
    pick: impl FnOnce(&Motor, &Snapshot) -> Option<T>,
) -> Result<T, Fault> {
    snapshot(number, |snapshot| {
        let wanted = numbered(index)?;
        let servo = live(snapshot.servo.as_ref(), snapshot, "servo")?;
        let background = live(snapshot.background.as_ref(), snapshot, "background").ok();
        let motors = Motor::all(servo, background, &snapshot.identity, family(snapshot)?);
        let motor = motors.iter().find(|motor| motor.servo.motor == wanted);
        let motor = motor.ok_or_else(|| Fault::refused(format!("the reports have no motor {wanted}")))?;
        pick(motor, snapshot)
            .ok_or_else(|| Fault::refused(format!("motor {wanted}: the live reports have no such word")))
    })
}

/// What `pick` finds about a coordinate system.
pub(crate) fn system<T>(
    number: u32,
    index: i32,
    pick: impl FnOnce(&CoordinateSystem) -> Option<T>,
) -> Result<T, Fault> {
    snapshot(number, |snapshot| {
        let wanted = numbered(index)?;
        let background = live(snapshot.background.as_ref(), snapshot, "background")?;
        let system = background.coordinate_systems.iter().find(|system| system.coordinate_system == wanted);
        let missing =
            || Fault::refused(format!("the reports have no such word of coordinate system {wanted}"));
        system.and_then(pick).ok_or_else(missing)
    })
}

/// Whether the flag called `name` of a motor is set.
pub(crate) fn flag(number: u32, index: i32, name: &str) -> Result<bool, Fault> {
    motor(number, index, |motor, _| motor.has(name))
}

/// A position in the program's unit.
fn scaled(quantity: Option<Quantity>, units: f64) -> Option<f64> {
    let quantity = quantity?;
    let value = match process::config().ok()?.units {
        Units::Counts => quantity.value?,
        Units::Raw => quantity.raw as f64,
    };
    Some(value * units)
}

/// A motor's position by `pick`.
pub(crate) fn position(
    number: u32,
    index: i32,
    units: f64,
    pick: impl FnOnce(&Motor, Option<&BackgroundData>) -> Option<Quantity>,
) -> Result<f64, Fault> {
    motor(number, index, |motor, snapshot| {
        let background = snapshot.background.as_ref().filter(|view| view.is_fresh()).map(|view| &view.data);
        scaled(pick(motor, background), units)
    })
}

/// The commanded position. A Turbo board reports the actual position and the following error instead.
pub(crate) fn commanded(number: u32, index: i32, units: f64) -> Result<f64, Fault> {
    motor(number, index, |motor, _| {
        let servo = motor.servo;
        scaled(servo.commanded_position, units)
            .or_else(|| Some(scaled(servo.actual_position, units)? + scaled(servo.following_error, units)?))
    })
}

/// The offset from `PSET` and axis definitions, by the report that has it.
pub(crate) fn bias(motor: &Motor, background: Option<&BackgroundData>) -> Option<Quantity> {
    let of_background =
        || background?.motors.iter().find(|other| other.motor == motor.servo.motor)?.position_bias;
    motor.servo.position_bias.or_else(of_background)
}

/// The register of the velocity of the last servo cycle, or of the averaged one where the report has no other.
pub(crate) fn velocity(motor: &Motor) -> Option<f64> {
    let quantity = motor.servo.actual_velocity.or(motor.servo.filtered_velocity)?;
    Some(quantity.raw as f64)
}

/// The register of the averaged velocity.
pub(crate) fn averaged(motor: &Motor, snapshot: &Snapshot) -> Option<f64> {
    let background = snapshot.background.as_ref().filter(|view| view.is_fresh());
    let of_background =
        || background?.data.motors.iter().find(|other| other.motor == motor.servo.motor)?.average_velocity;
    motor.servo.filtered_velocity.or_else(of_background).map(|quantity| quantity.raw as f64)
}

/// The velocity of several motors together, in counts a minute.
pub(crate) fn vector_velocity(number: u32, motors: &[i32], units: &[f64]) -> Result<f64, Fault> {
    let mut squares = 0.0;
    for (index, units) in motors.iter().zip(units) {
        let per_second = motor(number, *index, |motor, _| motor.servo.velocity?.value)?;
        squares += (per_second * 60.0 * units).powi(2);
    }
    Ok(squares.sqrt())
}

/// The servo timer of the latest servo report.
pub(crate) fn servo_timer(number: u32) -> Result<u32, Fault> {
    snapshot(number, |snapshot| Ok(live(snapshot.servo.as_ref(), snapshot, "servo")?.servo_timer))
}

/// The words of `???` in the order of the vendor's structures: the second word first.
pub(crate) fn global(number: u32) -> Result<[u32; 2], Fault> {
    snapshot(number, |snapshot| {
        let servo = live(snapshot.servo.as_ref(), snapshot, "servo")
            .ok()
            .and_then(|data: &ServoData| data.global_status);
        let words = match servo {
            Some(words) => Some(words),
            None => live(snapshot.background.as_ref(), snapshot, "background")?.global_status,
        };
        let [first, second] = words.ok_or_else(|| Fault::refused("no live report has the global status"))?;
        Ok([second, first])
    })
}

/// Whether the daemon uses the function, so that its reports come.
pub(crate) fn is_used(number: u32, function: &str, wanted: bool) -> Result<(), Fault> {
    with(number, |device| {
        let is_on = variables::info(device)?.enabled.iter().any(|name| name == function);
        match wanted && !is_on {
            true => Err(Fault::refused(format!("pmacd does not use the {function} report: {TO_ENABLE}"))),
            false => Ok(()),
        }
    })
}

/// A motor's words in the servo report of a board of this generation.
pub(crate) fn servo_block<const LONGS: usize>(
    number: u32,
    index: i32,
    generation: Generation,
) -> Result<[u32; LONGS], Fault> {
    let at = with(number, |device: &Device| {
        let family = variables::family(device)?;
        let other = || Fault::refused(format!("a {} has another servo report", family.title));
        let motors =
            Some(family.servo.motors).filter(|_| family.generation == generation).ok_or_else(other)?;
        let wanted = numbered(index)?;
        motors.at(wanted).ok_or_else(|| Fault::argument(format!("there is no motor {wanted}")))
    })?;
    let bytes = memory::read(number, at.bytes(), 4 * LONGS, true)?;
    Ok(std::array::from_fn(|long| {
        bytes
            .get(4 * long..)
            .and_then(|bytes| bytes.first_chunk())
            .map_or(0, |bytes| u32::from_le_bytes(*bytes))
    }))
}
