//! The board's family, by the settings.

use super::replay;
use crate::device::{BoardSpec, Place, WindowSpec};
use crate::map::{DEFAULT_FAMILY, Family, PMAC, TURBO2};

/// How many bytes of the DPRAM such a board shows at a time.
const WINDOW: u32 = 0x4000;
/// The end of the memory of ISA cards.
const ISA_END: u64 = 0x10_0000;
/// The configuration's word that has the daemon recognise the board.
const AUTO: &str = "auto";

/// The source of the family.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FamilyKnown {
    /// The default of a board that is a file, or the simulator's own family.
    Assumed,
    /// The configuration names it.
    Written,
    /// The daemon has yet to recognise the board, before it writes anything.
    Sought,
    /// The daemon has recognised the board.
    Recognised,
    /// The daemon could not recognise the board: it writes nothing to the board.
    Unknown,
}

/// The result of the look at the board: its family, if the words show it.
pub type Recognised = Option<&'static Family>;

/// The possible families of the board, the likeliest first, and their source. `written` is the configuration's
/// `family`, `seen` the recognised family.
///
/// # Errors
/// The setting that is wrong, and why: an unknown family; a simulator of another family than is written, or with a
/// DPRAM that no board of the family has.
pub(super) fn candidates(
    board: &BoardSpec,
    written: Option<&str>,
    seen: Option<Recognised>,
) -> Result<(Vec<&'static Family>, FamilyKnown), (&'static str, String)> {
    let sought = written.is_some_and(|written| written.eq_ignore_ascii_case(AUTO));
    let named = written.filter(|_| !sought).map(Family::by_name).transpose();
    let named = named.map_err(|error| ("family", format!("{error}; or write \"{AUTO}\"")))?;
    if let Some(directory) = board.recording() {
        return Ok((vec![replay::family(directory, named)?], FamilyKnown::Assumed));
    }
    match (board, named, seen) {
        (BoardSpec::Simulator(simulator), ..) => {
            let started = simulator.family.map(Family::by_name).transpose();
            let started = started.map_err(|error| ("board", error.to_string()))?;
            if let (Some(started), Some(named)) = (started, named)
                && started != named
            {
                let text = format!(
                    "the board is sim,family={}, but family = \"{}\" in the configuration says otherwise; remove one of the two",
                    started.name, named.name
                );
                return Err(("board", text));
            }
            let family = started.or(named).unwrap_or(DEFAULT_FAMILY);
            let family = simulator.dpram.map_or(Ok(family), |size| family.with_dpram(size));
            Ok((vec![family.map_err(|reason| ("board", reason))?], FamilyKnown::Assumed))
        }
        (_, Some(named), _) => Ok((vec![in_window(board, named)], FamilyKnown::Written)),
        (_, None, Some(Some(seen))) => Ok((vec![seen], FamilyKnown::Recognised)),
        (BoardSpec::File { .. }, ..) if !sought => Ok((vec![DEFAULT_FAMILY], FamilyKnown::Assumed)),
        (_, None, Some(None)) => Ok((vec![&PMAC, &TURBO2], FamilyKnown::Unknown)),
        // One family of each generation: a setting that only the other family knows is no mistake.
        (_, None, None) => Ok((vec![&PMAC, &TURBO2], FamilyKnown::Sought)),
    }
}

/// `family` with as much DPRAM as `board` shows. A file is as long as its DPRAM. A VME board shows 16 KiB at a time,
/// and an ISA board has a window of 16 KiB unless it is set up otherwise (Turbo User Manual pp. 399, 400): the memory
/// behind that belongs to another card. All functions lie in these 16 KiB. A length in the configuration says that the
/// board shows more.
fn in_window(board: &BoardSpec, family: &'static Family) -> &'static Family {
    match board {
        BoardSpec::Window(WindowSpec { place, length: None, .. }) if is_small(place) => {
            family.with_length(WINDOW).unwrap_or(family)
        }
        _ => board.file_bytes().and_then(|bytes| family.with_length(bytes)).unwrap_or(family),
    }
}

/// Whether a board there shows 16 KiB.
const fn is_small(place: &Place) -> bool {
    match place {
        Place::Vme(_) => true,
        Place::Memory(address) => *address < ISA_END,
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::{PMAC2, TURBO, TURBO_32K, TURBO2_8K};

    fn known(
        board: &str,
        written: Option<&str>,
        seen: Option<Recognised>,
    ) -> (Vec<&'static Family>, FamilyKnown) {
        candidates(&board.parse().unwrap(), written, seen).unwrap()
    }

    #[test]
    fn a_vme_or_isa_board_shows_16_kib_unless_a_length_is_written() {
        for (name, shown, all) in
            [("turbo2", &TURBO2_8K, &TURBO2), ("turbo", &TURBO, &TURBO), ("pmac", &PMAC, &PMAC)]
        {
            assert_eq!(known("vme:/dev/bus/vme/m0", Some(name), None).0, [shown], "{name}");
            assert_eq!(known("vme:/dev/bus/vme/m0,length=0x10000", Some(name), None).0, [all], "{name}");
            assert_eq!(known("mem:0xD4000", Some(name), None).0, [shown], "{name}");
            assert_eq!(known("mem:0xC0000,length=0x10000", Some(name), None).0, [all], "{name}");
            assert_eq!(known("mem:0xFEBD0000", Some(name), None).0, [all], "a PCI board: {name}");
        }
    }

    #[test]
    fn a_file_is_of_the_size_of_its_familys_dpram() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let board = format!("file:{}", file.path().display());
        for (length, turbo, turbo2) in [(0x4000, &TURBO, &TURBO2_8K), (0x1_0000, &TURBO_32K, &TURBO2)] {
            file.as_file().set_len(length).unwrap();
            assert_eq!(known(&board, Some("turbo"), None).0, [turbo], "{length:#x}");
            assert_eq!(known(&board, Some("turbo2"), None).0, [turbo2], "{length:#x}");
            // The daemon refuses a file that does not fit when it opens the file.
            assert_eq!(known(&board, Some("pmac"), None).0, [&PMAC], "{length:#x}");
        }
    }

    #[test]
    fn a_board_in_a_slot_is_recognised_unless_its_family_is_written() {
        let slots = ["mem:0xD4000", "uio:/dev/uio0", "pci:03:00.0", "vme:/dev/bus/vme/m0"];
        for (board, written) in slots.map(|slot| (slot, None)).into_iter().chain([("file:m", Some("auto"))]) {
            assert_eq!(known(board, written, None).1, FamilyKnown::Sought, "{board}");
            assert_eq!(known(board, Some("turbo"), None), (vec![&TURBO], FamilyKnown::Written), "{board}");
            let seen = known(board, written, Some(Some(&TURBO2)));
            assert_eq!(seen, (vec![&TURBO2], FamilyKnown::Recognised), "{board}");
            assert_eq!(known(board, written, Some(None)).1, FamilyKnown::Unknown, "{board}");
        }
        for (board, family) in [("file:m", &PMAC), ("sim", &PMAC), ("sim,family=pmac2", &PMAC2)] {
            assert_eq!(known(board, None, None), (vec![family], FamilyKnown::Assumed), "{board}");
        }
    }
}
