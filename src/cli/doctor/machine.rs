//! `pmacctl doctor --boards` and `--probe`: finds devices that may be boards, and reports the content of a window.

use super::report::{Check, Level, Report};
use crate::cli::context::Failure;
use crate::device::board::memory;
use crate::device::machine::candidates::{Candidate, Certainty, candidates};
use crate::device::machine::probe::{Probe, Verdict, probe};
use crate::device::system::kernel::{Configuration, Lockdown, is_iomem_relaxed, release};
use crate::device::{Board, BoardSpec, FileBoard, System};
use crate::map::{DEFAULT_FAMILY, Family, TURBO2};

/// A way to a board: how its specification begins, and the options of the kernel that it needs.
type Way = (&'static str, &'static [&'static str]);
/// The kinds of boards, each with the ways to one. docs/install.md has the same table.
const KINDS: [(&str, &[Way]); 3] = [
    ("PCI", &[("uio:", &["UIO", "UIO_PCI_GENERIC"]), ("pci:", &[])]),
    ("ISA", &[("mem:", &["DEVMEM"]), ("uio:", &["UIO"])]),
    // Of the VME bus and vme_user, which Debian leaves out, DKMS builds modules beside ours.
    ("VME", &[("vme:", &["UIO"]), ("mem:", &["DEVMEM"])]),
];
/// What these refuse of `mem:` and `pci:`: main memory, and what a driver has claimed.
const REFUSING: [&str; 2] = ["STRICT_DEVMEM", "IO_STRICT_DEVMEM"];
/// The usual addresses of an ISA board's DPRAM: the factory's (Turbo User Manual p. 399), and the address that a
/// Windows program for both families sets (I93=$D, I94=$5).
const USUAL_ISA: [&str; 2] = ["mem:0xD4000", "mem:0xD0000"];

/// Looks for boards without opening any.
pub fn boards(report: &mut Report, system: &System) {
    kernel(report, system);
    let memory = memory::may_open(system);
    match &memory {
        Ok(()) => report.ok("memory", "you may open /dev/mem, if the board is at a fixed address (ISA, VME)"),
        Err(why) => report.warn("memory", format!("you may not open /dev/mem: {why}")),
    }
    let found = candidates(system);
    if found.is_empty() {
        let text =
            "no UIO, PCI or VME device looks like one; is the board's driver loaded, and the board powered?";
        report.warn("candidate", text);
    }
    for mut candidate in found {
        let rule = candidate.rule.take();
        report.0.push(candidate_check(candidate));
        if let Some(rule) = rule {
            // Alone in its line, so that the user can copy it.
            report.ok("udev rule", rule);
        }
    }
    let [first, second] = USUAL_ISA;
    let text = format!(
        "an ISA board cannot be detected; its DPRAM usually lies at {first} or {second}: look with pmacctl doctor --probe (see pmacctl setup isa)"
    );
    report.ok("ISA", text);
}

fn kernel(report: &mut Report, system: &System) {
    let release = release(system).unwrap_or_else(|| "unknown".to_owned());
    let configuration = Configuration::of(system);
    let states = |options: &[&str]| {
        let state = |option: &&str| format!("{option}={}", configuration.value(option).unwrap_or("?"));
        options.iter().map(state).collect::<Vec<_>>().join(" ")
    };
    let relaxed = if is_iomem_relaxed(system) { ", iomem=relaxed" } else { "" };
    let options = states(&REFUSING);
    let lockdown = Lockdown::of(system);
    match &lockdown {
        Lockdown::On(mode) => {
            let text = format!(
                "{release}, locked down ({mode}): only UIO devices can be mapped, and uio_pci_generic gives no interrupts; {options}{relaxed}"
            );
            report.warn("kernel", text);
        }
        Lockdown::Off => report.ok("kernel", format!("{release}, not locked down; {options}{relaxed}")),
        Lockdown::Unknown => {
            report.ok("kernel", format!("{release}, without lockdown support; {options}{relaxed}"));
        }
    }
    let is_open = |(way, options): &Way| {
        let is_there = |option: &&str| configuration.value(option) != Some("n");
        options.iter().all(is_there) && (lockdown.mode().is_none() || !["mem:", "pci:"].contains(way))
    };
    for (kind, ways) in KINDS {
        let told = |(way, options): &Way| {
            format!("{way} {}", if options.is_empty() { "no option".to_owned() } else { states(options) })
        };
        let text = format!("{kind} board: {}", ways.iter().map(told).collect::<Vec<_>>().join("; "));
        if ways.iter().any(is_open) {
            report.ok("kernel", text);
        } else {
            report.warn(
                "kernel",
                format!(
                    "{text}; none of these is open on this kernel: see \"Kernel options\" in docs/install.md"
                ),
            );
        }
    }
}

fn candidate_check(candidate: Candidate) -> Check {
    let certainty = match candidate.certainty {
        Certainty::Likely => "likely",
        Certainty::Maybe => "maybe",
    };
    let mut text = format!("{certainty} {}: {}", candidate.spec, candidate.what);
    for hint in &candidate.hints {
        text += "; ";
        text += hint;
    }
    let may = candidate.reserved || candidate.usable;
    let level = if may && !candidate.exposed { Level::Ok } else { Level::Warn };
    Check { candidate: Some(candidate), ..Check::new(level, "candidate", text) }
}

/// Opens the window of a board of `family`, reads it, and reports the likely device. Never writes to the board.
pub fn probe_board(
    report: &mut Report,
    spec: &BoardSpec,
    text: &str,
    family: Option<&'static Family>,
    system: &System,
) -> Result<(), Failure> {
    let family = family.map_or_else(|| family_by_size(spec), |family| of_size(family, spec));
    let dpram = family.length as usize;
    let mut bus: Box<dyn Board> = match spec {
        BoardSpec::Simulator(_) => {
            return Err(Failure::Request(
                "sim has no window to read; start pmac-sim and probe file: with its path".to_owned(),
            ));
        }
        BoardSpec::Replay { .. } => {
            return Err(Failure::Request(
                "replay has no window to read; see the files of the recording".to_owned(),
            ));
        }
        BoardSpec::File { path, .. } => match FileBoard::open(path, dpram) {
            Ok(board) => Box::new(board),
            Err(error) => return refused(report, error),
        },
        BoardSpec::Window(window) => match crate::device::board::open::open_window(window, dpram, system) {
            Ok(board) => Box::new(board),
            Err(error) => return refused(report, error),
        },
    };
    let seen = probe(&mut bus, family).map_err(Failure::request)?;
    report.0.push(probe_check(text, seen, family));
    Ok(())
}

/// A Turbo PMAC2, if the board is a file of a size that only its DPRAM has.
fn family_by_size(spec: &BoardSpec) -> &'static Family {
    if spec.file_bytes() == Some(TURBO2.length) { &TURBO2 } else { DEFAULT_FAMILY }
}

/// `family` with the DPRAM size of a board that is a file.
fn of_size(family: &'static Family, spec: &BoardSpec) -> &'static Family {
    spec.file_bytes().and_then(|bytes| family.with_length(bytes)).unwrap_or(family)
}

fn refused(report: &mut Report, error: impl std::fmt::Display) -> Result<(), Failure> {
    report.fail("probe", error.to_string());
    Ok(())
}

fn probe_check(spec: &str, seen: Probe, family: &Family) -> Check {
    let Probe { words, ones, zeros, changed, timer_moves, servo_hz, .. } = seen;
    let counts = format!(
        "of {words} words {ones} read 0xFFFF, {zeros} read 0, {changed} changed; the servo timer advanced at {timer_moves} reads"
    );
    let (level, text) = match seen.verdict {
        Verdict::Absent => (
            Level::Fail,
            "every word reads 0xFFFF: no board answers; check its address and power, that the DPRAM is enabled, and the VME page"
                .to_owned(),
        ),
        Verdict::Reporting => (
            Level::Ok,
            format!(
                "a timer counts {:.0} a second where a {} counts servo cycles in its servo report; nothing else of a report was looked at",
                servo_hz.unwrap_or(0.0),
                family.title
            ),
        ),
        Verdict::Changing => (
            Level::Warn,
            "some words change, but not like servo data: a PMAC with I48=0, or another device".to_owned(),
        ),
        Verdict::Still => (
            Level::Warn,
            "no word changes: a PMAC that reports nothing (I48=0), or another device"
                .to_owned(),
        ),
    };
    Check { probe: Some(seen), ..Check::new(level, "probe", format!("{spec}: {text}; {counts}")) }
}
