//! Finds out what the board is before the daemon writes to its DPRAM, and checks that the configuration agrees.

use std::time::{Duration, Instant};

use log::{info, warn};

use super::ask_family;
use super::config::family::{FamilyKnown, Recognised};
use super::config::settings::Settings;
use super::exit::{self, Failure};
use super::options::Options;
use crate::daemon::bus::board;
use crate::device::machine::recognise::{WINDOW, recognise};
use crate::device::{BoardSpec, Inherited, System};
use crate::map::{Family, Generation, PMAC, TURBO2, TURBO2_8K};
use crate::protocol::function::UNKNOWN_FAMILY;

/// The pause between two looks: some milliseconds, and no multiple of a usual servo period.
pub const PAUSE: Duration = Duration::from_micros(5300);

/// How often the daemon looks at a board of unknown family at most.
const LOOKS: usize = 8;

/// The settings for this board: `settings`, or settings with the board's family if the daemon has to find the family
/// out. `pause` waits [`PAUSE`] and returns the time in nanoseconds.
///
/// # Errors
/// The daemon cannot open the board, the board is not the configuration's, or it lacks something that the configuration
/// names.
pub fn settled(
    settings: Settings,
    options: &Options,
    inherited: &Inherited,
    mut pause: impl FnMut() -> u64,
) -> Result<Settings, Failure> {
    let mut seen = |looks| match look(&settings, inherited, looks, &mut pause)? {
        None => ask(&settings, inherited, &mut pause),
        seen => Ok(seen),
    };
    match settings.family_known {
        FamilyKnown::Assumed | FamilyKnown::Recognised | FamilyKnown::Unknown => Ok(settings),
        FamilyKnown::Written => match contradiction(settings.family, seen(1)?) {
            Some(reason) => Err(Failure::new(exit::CONFIGURATION, reason)),
            None => Ok(settings),
        },
        FamilyKnown::Sought => {
            let seen = seen(LOOKS)?.map(|seen| of_size(seen, &settings.board));
            match seen {
                Some(family) => info!("the board is a {} by what it shows or answers", family.title),
                None => warn!("{UNKNOWN_FAMILY}"),
            }
            let settings = Settings::decide_seen(options, seen);
            settings.map_err(|error| Failure::new(exit::CONFIGURATION, error))
        }
    }
}

/// [`settled`] in real time.
///
/// # Errors
/// As [`settled`].
pub fn settled_now(
    settings: Settings,
    options: &Options,
    inherited: &Inherited,
) -> Result<Settings, Failure> {
    let begin = Instant::now();
    settled(settings, options, inherited, || {
        std::thread::sleep(PAUSE);
        u64::try_from(begin.elapsed().as_nanos()).unwrap_or(u64::MAX)
    })
}

/// The board's family by its size, if the size is certain, or else by its reports, in so many `looks` at most. `None`
/// if nothing shows the family, or the board's page is not selected yet.
fn look(
    settings: &Settings,
    inherited: &Inherited,
    looks: usize,
    mut pause: impl FnMut() -> u64,
) -> Result<Recognised, Failure> {
    // PMAC's DPRAM has 8K x 16 bits (so the DPRAM manual's title); 32K came with Turbo (Turbo User Manual p. 397).
    if settings.board.file_bytes().is_some_and(|length| length >= TURBO2.length) {
        return Ok(Some(&TURBO2));
    }
    let bus = board::open_to_look(settings, WINDOW, &System::here(), inherited);
    let mut bus = bus.map_err(|error| Failure::board(error.as_ref()))?;
    recognise(&mut bus, looks, |_| pause()).map_err(|error| Failure::board(&error))
}

/// The board's answer, if the daemon can ask without a write into the DPRAM.
fn ask(
    settings: &Settings,
    inherited: &Inherited,
    mut pause: impl FnMut() -> u64,
) -> Result<Recognised, Failure> {
    let Some(mailbox) = &settings.mailbox else { return Ok(None) };
    let begin = Instant::now();
    ask_family::by_mailbox(mailbox, inherited, || begin + Duration::from_nanos(pause()))
}

/// The family seen, with as much DPRAM as the board surely has. `TYPE` tells more within the generation.
fn of_size(seen: &'static Family, board: &BoardSpec) -> &'static Family {
    let length = match board {
        BoardSpec::Window(window) => window.length,
        _ => board.file_bytes().map(|bytes| bytes as usize),
    };
    match seen.generation {
        Generation::Pmac => &PMAC,
        Generation::Turbo if length.is_some_and(|length| length >= TURBO2.length as usize) => &TURBO2,
        Generation::Turbo => &TURBO2_8K,
    }
}

/// Why the configuration's family cannot be the board's. A board that shows no family contradicts nothing.
fn contradiction(written: &Family, seen: Recognised) -> Option<String> {
    let seen = seen.filter(|seen| seen.generation != written.generation)?;
    let right = match seen.generation {
        Generation::Pmac => "family = \"pmac\" or \"pmac2\"",
        Generation::Turbo => "family = \"turbo\" or \"turbo2\"",
    };
    Some(format!(
        "the configuration says family = \"{}\", but the board is a {} by what it shows or answers, and nothing was written to its DPRAM; write {right}",
        written.name, seen.title
    ))
}
