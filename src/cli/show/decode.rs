//! `pmacctl board decode`: decodes a raw image of the DPRAM from a file, with the code that decodes live data.

use std::path::PathBuf;

use clap::Args;
use serde_json::{Value, json};

use crate::cli::args::values::{Float48, Order, family};
use crate::cli::console::input::read_some;
use crate::cli::context::{Context, Failure, Verdict};
use crate::cli::show::buffers;
use crate::cli::show::coordinates::{self, Overrides};
use crate::cli::show::global_status;
use crate::cli::show::motors;
use crate::client::motor::Motor;
use crate::decode::{BackgroundData, Buffers, Image, ImageError, Scales, ServoData};
use crate::map::{FAMILIES, Family, Firmware, Layout};
use crate::segment::Identity;

#[derive(Debug, Args)]
pub struct Decode {
    /// The image, as long as the family's DPRAM (16 KiB; Turbo boards also 64 KiB); - is stdin
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// The board's family
    #[arg(long, value_name = "FAMILY", default_value = "pmac", value_parser = family)]
    pub family: &'static Family,
    /// The board's firmware, as VERSION answers; the gather buffer's place depends on it
    #[arg(long, value_name = "VERSION")]
    pub firmware: Option<Firmware>,
    /// PMAC, PMAC2: the number of reported motors and coordinate systems [default: all]. A Turbo board's image tells it
    #[arg(long, value_name = "N")]
    pub motors: Option<usize>,
    /// The byte order of the image's 16-bit words
    #[arg(long, value_name = "ORDER", default_value = "little")]
    pub word_order: Order,
    /// The layout of L: values
    #[arg(long, value_name = "LAYOUT", default_value = "register")]
    pub float48: Float48,
}

pub fn run(context: &mut Context, options: &Decode) -> Result<Verdict, Failure> {
    // One byte more than the largest image is enough to refuse the file.
    let bytes = read_some(&options.file, largest() as u64 + 1);
    let bytes = bytes.map_err(|error| Failure::Request(format!("{}: {error}", options.file.display())))?;
    let fault =
        |error: &dyn std::fmt::Display| Failure::Request(format!("{}: {error}", options.file.display()));
    let image = Image::from_bytes(&bytes, options.family, options.word_order.into()).map_err(|error| {
        if bytes.len() > largest() {
            // The program has read only one byte more, so the file's length is unknown.
            let ImageError { family, expected, .. } = &error;
            let most = largest();
            return fault(&format_args!(
                "an image of the DPRAM of a {family} has {expected} bytes, and this one has more than {most}"
            ));
        }
        let other =
            FAMILIES.iter().find(|family| family.lengths().any(|length| length as usize == bytes.len()));
        let other = other.map_or(String::new(), |other| {
            format!("; if it is a {}'s: --family {}", other.title, other.name)
        });
        fault(&format_args!("{error}{other}"))
    })?;
    let count = options.motors.unwrap_or(options.family.motors);
    if count > options.family.motors {
        let most = options.family.motors;
        return Err(Failure::Request(format!("--motors {count}: a {} has {most}", options.family.title)));
    }
    let family = image.family();
    let (scales, float48) = (Scales::default(), options.float48.into());
    let servo = image.servo(count, &scales).map_err(|e| fault(&e))?;
    let background =
        image.background(family.background.reported(count), &scales, float48).map_err(|e| fault(&e))?;
    let buffers = Buffers::of(&image, &Layout::new(family, options.firmware), float48);
    if context.output.is_json() {
        context.output.json(&document(&servo, &background, &buffers, family))?;
    } else {
        let identity = Identity::default();
        let motors = Motor::activated(Motor::all(&servo, Some(&background), &identity, family));
        if motors.is_empty() {
            context.output.line("no motor is reported")?;
        } else {
            context.output.text(motors::table(&motors))?;
        }
        context.output.line("")?;
        context.output.text(coordinates::table(&background, &Overrides::default()))?;
        context.output.text(buffers::text(&buffers, family))?;
        let global = global_status::document(Some(&servo), Some(&background));
        if let Some(text) = global_status::text(&global) {
            context.output.line(format_args!("global status: {text}"))?;
        }
    }
    Ok(Verdict::Yes)
}

/// The bytes of the largest image of any family.
fn largest() -> usize {
    FAMILIES.iter().flat_map(|family| family.lengths()).max().map_or(0, |bytes| bytes as usize)
}

/// The documents of `motors` and `coordinates` together, with the other functions' words. An image has no time and is
/// never live.
fn document(
    servo: &ServoData,
    background: &BackgroundData,
    buffers: &Buffers,
    family: &'static Family,
) -> Value {
    let identity = Identity::default();
    let motors = Motor::activated(Motor::all(servo, Some(background), &identity, family));
    let stamp = |timer: u32| json!({ "time": null, "servo_timer": timer, "sequence": null, "fresh": false });
    let mut document = json!({
        "servo": stamp(servo.servo_timer),
        "motors": motors.iter().map(Motor::document).collect::<Vec<_>>(),
        "background": stamp(background.servo_timer),
    });
    document["servo"]["pmac_busy"] = json!(servo.pmac_busy);
    document["background"]["ready"] = json!(background.ready);
    document["global_status"] = global_status::document(Some(servo), Some(background));
    document["buffers"] = json!(buffers);
    coordinates::add(&mut document, Some(background));
    document
}
