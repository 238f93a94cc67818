//! `pmacctl doctor`: checks everything between this user and live data, and says what to do.

mod machine;
mod memory;
mod names;
mod parcel;
mod report;

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use nix::unistd::{AccessFlags, Gid, Group, access};
use serde_json::json;

use self::report::{Level, Report};
use crate::cli::args::values;
use crate::cli::console::note;
use crate::cli::context::{Context, Failure, Verdict};
use crate::client::{Board, CommandError, Connection, View, identity};
use crate::device::System;
use crate::map::{Family, LACKS_DPRAM, ReportStart, lacks_dpram};
use crate::protocol::board::REPLAY_OVER;
use crate::protocol::function::{NO_FAMILY, UNKNOWN_FAMILY};
use crate::protocol::program_words::waits_for;
use crate::protocol::{
    BackgroundSettings, BoardInfo, BoardSettings, CommandPort, CommandState, Function, HostPortCounts,
    HostPortInfo, ServoSettings, State,
};
use crate::segment::{Condition, Identity, RegionId, RegionState};

#[derive(Debug, Args)]
pub struct Doctor {
    /// Look for boards in this machine without opening them, and print the SPEC for pmacd --board
    #[arg(long)]
    pub boards: bool,
    /// Open this board, read its window without writing, and say what kind of device answers
    #[arg(long, value_name = "SPEC")]
    pub probe: Option<String>,
    /// The family of that board [default: pmac; turbo2 for a file of 64 KiB]
    #[arg(long, value_name = "FAMILY", value_parser = values::family, requires = "probe")]
    pub family: Option<&'static Family>,
    /// Ask the board for its M-variables, and print which parts of the DPRAM they and pmacd use
    #[arg(long)]
    pub memory: bool,
    /// Write the output of doctor and status and a short capture to a new file to send: a tar of text files, without your
    /// names and paths
    #[arg(long, value_name = "FILE", conflicts_with_all = ["boards", "probe", "memory"])]
    pub report: Option<PathBuf>,
    /// The directory with the machine's /dev, /proc and /sys
    #[arg(long, value_name = "DIRECTORY", hide = true)]
    pub root: Option<PathBuf>,
}

/// The time that a board has to come up after a reset. A large board that has saved much takes seconds, and `pmacd`
/// asks a silent board again after 10 s.
const COMES_UP: Duration = Duration::from_secs(15);
/// Data seen within this time may be from before the reset.
const GONE: Duration = Duration::from_secs(3);
const CHECK_EVERY: Duration = Duration::from_millis(250);
/// How long doctor mentions a reset.
const LATELY: Duration = Duration::from_secs(60);

/// Checks whether the board takes command lines.
fn commands(report: &mut Report, info: &BoardInfo) {
    let (port, enabled) = match (info.lines.command_port, info.known_family()) {
        (CommandPort::Dpram, Ok(family)) => ("the DPRAM", format!("I{}=1", family.i.ascii_enable)),
        (CommandPort::Dpram, Err(_)) => ("the DPRAM", "ASCII communication switched on".to_owned()),
        (CommandPort::Mailbox, _) => ("the VME mailboxes", "I3=2".to_owned()),
    };
    let answers = info.enabled.iter().any(|name| name == "ascii");
    let (level, text) = match info.lines.command_state {
        _ if answers => (Level::Ok, format!("the board takes command lines through {port}")),
        CommandState::Silent => {
            let cure = format!(
                "check {enabled}: ^Z or I58=0 ends command lines for everybody. pmacctl setup enable ascii --send --port PATH \
                 sets it over the serial port; so does a reset of a board that has it saved"
            );
            (Level::Warn, format!("the last command line through {port} was not answered; {cure}"))
        }
        CommandState::Unknown | CommandState::Answers => (
            Level::Ok,
            format!("not known yet: no command line has gone through {port}; try pmacctl send TYPE"),
        ),
    };
    report.add(level, "commands", text);
    for fault in info.lines.port_faults() {
        report.warn("commands", fault.to_owned());
    }
    if let Some(open) = &info.open_buffer {
        let cure =
            "lines of others are refused, and the daemon's questions wait; CLOSE by an engineer closes it";
        report.warn("commands", format!("open: {open}; {cure}"));
    }
}

pub fn run(context: &mut Context, options: &Doctor) -> Result<Verdict, Failure> {
    let mut report = Report::default();
    let system = options.root.as_ref().map_or_else(System::here, System::below);
    if let Some(text) = &options.probe {
        let spec = text.parse().map_err(Failure::request)?;
        machine::probe_board(&mut report, &spec, text, options.family, &system)?;
    }
    if options.boards {
        machine::boards(&mut report, &system);
    }
    if options.memory {
        memory::memory(&mut report, context)?;
    }
    if !options.boards && !options.memory && options.probe.is_none() {
        context.agree()?;
        report.0.extend(once_up(context, &system).0);
    }
    if let Some(path) = &options.report {
        let is_whole = parcel::write(context, &report, path)?;
        for check in report.0.iter().filter(|check| check.level == Level::Fail) {
            context.output.line(check)?;
        }
        return Ok((report.is_passed() && is_whole).into());
    }
    tell(context, &report)
}

/// Checks everything. After a reset of the board, repeats the checks until the board is up or its time is over.
fn once_up(context: &Context, system: &System) -> Report {
    let mut is_told = false;
    loop {
        let mut report = Report::default();
        let Some(ago) = everything(&mut report, context, system) else { return report };
        if ago >= COMES_UP || ago >= GONE && report.is_well() {
            report.ok("board", format!("it was reset {} s ago", ago.as_secs()));
            return report;
        }
        if !std::mem::replace(&mut is_told, true) {
            note(format_args!(
                "the board was reset {} s ago; waiting for it to come up, until {} s after the reset",
                ago.as_secs(),
                COMES_UP.as_secs()
            ));
        }
        std::thread::sleep(CHECK_EVERY);
    }
}

/// Checks everything between this user and live data. Returns the time since the board's reset, if there was a recent
/// reset.
fn everything(report: &mut Report, context: &Context, system: &System) -> Option<Duration> {
    names::shared_memory(report);
    let attached = names::segment(report, context);
    let (info, settings) = socket(report, &context.socket()).unzip();
    let settings = settings.flatten();
    names::conclude(report, &attached, info.as_ref(), &context.socket());
    let mut board = attached.ok();
    let known = settings.clone().unwrap_or_default();
    if let Some(board) = &mut board {
        let reads = |function: Function| {
            known.functions.has(function) && info.as_ref().is_none_or(|info| info.leaves_free(function))
        };
        let is_over = info.as_ref().is_some_and(BoardInfo::is_over);
        data(report, board, is_over, reads);
        not_activated(report, board);
    }
    if let Some(info) = &info {
        functions(report, info, &known);
        if let Some(board) = &mut board
            && info.enabled.iter().any(|name| name == "ascii")
        {
            unscaled(report, board);
        }
        if let (Some(settings), Ok(family)) = (&settings, info.known_family()) {
            left_out(report, family, settings);
        }
    }
    if let (Some(board), Some(info)) = (&board, &info) {
        same_daemon(report, board, info);
    }
    if board.is_none() && info.is_none() {
        // Without a daemon, the next step is to choose the board that it opens.
        machine::boards(report, system);
    }
    let ago = Duration::from_millis(info?.reset_ago_ms?);
    (ago < LATELY).then_some(ago)
}

fn tell(context: &mut Context, report: &Report) -> Result<Verdict, Failure> {
    if context.output.is_json() {
        context.output.json(&report.0)?;
    } else {
        report.0.iter().try_for_each(|check| context.output.line(check))?;
    }
    Ok(report.is_passed().into())
}

/// The daemon's information, and its settings if the daemon gives them.
fn socket(report: &mut Report, path: &Path) -> Option<(BoardInfo, Option<BoardSettings>)> {
    let asked = Connection::open(path)
        .and_then(|mut connection| Ok((connection.info()?, connection.settings().ok())));
    match asked {
        Ok((info, settings)) => {
            report.ok("socket", format!("{} answers, pmacd {}", path.display(), info.version));
            role(report, &info);
            Some((info, settings))
        }
        Err(error @ CommandError::Connect { .. }) => {
            report.fail("socket", unreachable(path, &error));
            None
        }
        Err(error) => {
            report.fail("socket", error.to_string());
            None
        }
    }
}

/// The rights of this user.
fn role(report: &mut Report, info: &BoardInfo) {
    let may = match info.role.as_deref() {
        Some("observe") => "look at the DPRAM",
        Some("stop") => "stop the machine (a kill opens every loop: a vertical axis without a brake falls)",
        Some("operate") => "MOVE the machine",
        Some("engineer") => "do everything",
        _ => return,
    };
    let role = info.role.as_deref().unwrap_or_default();
    let text = format!("{role}: you may {may}; groups you have joined count after a new login");
    report.ok("role", text);
}

/// Why the socket cannot be reached. Names the group to join if permission is missing.
fn unreachable(path: &Path, error: &CommandError) -> String {
    let found = match fs::metadata(path) {
        Ok(found) if access(path, AccessFlags::W_OK).is_err() => found,
        _ => return error.to_string(),
    };
    if found.gid() == 0 {
        // A member of that group gets much more than a board.
        let place = path.display();
        return format!(
            "{place} is for root alone; name another group by socket_group in the daemon's configuration"
        );
    }
    let group = Group::from_gid(Gid::from_raw(found.gid())).ok().flatten();
    let group = group.map_or_else(|| found.gid().to_string(), |group| group.name);
    format!("{} is for the group {group}; have yourself added to it", path.display())
}

/// Checks the reports that the daemon `reads`. The reports of a recording that `is_over` do not come again.
fn data(report: &mut Report, board: &mut Board, is_over: bool, reads: impl Fn(Function) -> bool) {
    let condition = board.subscriber().condition();
    if condition.is_over() {
        // The data are old because the daemon is gone. The daemon check has reported that.
        return;
    }
    let identity = board.identity().unwrap_or_default();
    for (region, function) in
        [(RegionId::Servo, Function::Servo), (RegionId::Background, Function::Background)]
    {
        let what = region.name();
        if !reads(function) {
            continue;
        }
        let Ok(about) = board.subscriber().region(region) else {
            report.warn(what, "the daemon does not mirror these data; see its configuration");
            continue;
        };
        let published = about.published;
        match about.state {
            RegionState::Live if condition == Condition::Live => {
                report.ok(what, format!("live, {published} updates"));
            }
            RegionState::Off if is_over => report.warn(what, format!("off; {REPLAY_OVER}")),
            RegionState::Off => {
                report.warn(what, format!("off on the board; {}", missing(region, &identity)));
            }
            RegionState::Live | RegionState::Stale => {
                // If the whole board is silent, its variables may still be right.
                let why = match condition {
                    _ if is_over => REPLAY_OVER.to_owned(),
                    Condition::Live => missing(region, &identity),
                    _ => "so are all others: check that the board runs".to_owned(),
                };
                report.fail(what, format!("stale after {published} updates; {why}"));
            }
        }
    }
}

/// Motors that the board reports, but that pmacctl hides because they are not activated.
fn not_activated(report: &mut Report, board: &mut Board) {
    let servo = board.snapshot().ok().and_then(|snapshot| snapshot.servo).filter(View::is_fresh);
    let motors = servo.iter().flat_map(|servo| &servo.data.motors);
    let left = motors.filter(|motor| !motor.is_activated()).map(|motor| format!("#{}", motor.motor));
    let left: Vec<_> = left.collect();
    if !left.is_empty() {
        let text = format!("not activated (Ix00=0), and so not shown: {}", left.join(", "));
        report.ok(RegionId::Servo.name(), text);
    }
}

/// Motors whose scales the board has not told although it answers questions.
fn unscaled(report: &mut Report, board: &mut Board) {
    let Ok(identity) = board.identity() else { return };
    let servo = board.snapshot().ok().and_then(|snapshot| snapshot.servo).filter(View::is_fresh);
    let motors = servo.iter().flat_map(|servo| servo.data.motors.iter().map(|motor| motor.motor));
    let is_told = |motor: &usize| identity.ix08.get(motor - 1).is_none_or(Option::is_some);
    let left: Vec<_> = motors.filter(|motor| !is_told(motor)).map(|motor| format!("#{motor}")).collect();
    if !left.is_empty() {
        let text = format!(
            "the board has not told Ix08 of {}, so their positions are raw numbers; pmacd asks again every 10 s, unless ask_board \
             is false",
            left.join(", ")
        );
        report.warn("scales", text);
    }
}

/// The settings that a missing report needs, and the board's own settings, if known.
fn missing(region: RegionId, identity: &Identity) -> String {
    let Some(family) = identity::family(identity) else {
        return "the board's family is not known to this program".to_owned();
    };
    let i = &family.i;
    let needs_gather = region == RegionId::Servo && family.servo.start == ReportStart::Gather;
    let reported = i.reported.map(|variable| (variable, identity.reported_motors(), family.motors));
    let mut needed = match region {
        RegionId::Servo if family.servo.start == ReportStart::Enable => {
            vec![(i.servo_enable, identity.servo_report, 1)]
        }
        RegionId::Servo => vec![
            (i.servo_enable, identity.servo_report, 1),
            (i.servo_period, identity.servo_report_cycles, 1),
        ],
        _ => vec![(i.background_enable, identity.background_report, 1)],
    };
    needed.extend(reported);
    let off: Vec<_> = needed.iter().filter(|(_, value, _)| *value == Some(0)).collect();
    if !off.is_empty() {
        let names: Vec<_> = off.iter().map(|(variable, ..)| format!("I{variable}=0")).collect();
        let lines: Vec<_> = off.iter().map(|(variable, _, on)| format!("I{variable}={on}")).collect();
        return format!(
            "the board has {}; switch it on: pmacctl send '{}'",
            names.join(", "),
            lines.join(" ")
        );
    }
    let name = |(variable, ..): &(u16, Option<u32>, usize)| format!("I{variable}");
    let unknown: Vec<_> = needed.iter().filter(|(_, value, _)| value.is_none()).map(name).collect();
    if !unknown.is_empty() {
        let names: Vec<_> = needed.iter().map(name).collect();
        let gather = if needs_gather { ", and GATHER" } else { "" };
        return format!(
            "{} not known; the report needs {} above 0{gather}",
            unknown.join(" and "),
            names.join(" and ")
        );
    }
    if let Some(in_background) = i.servo_in_background
        && region == RegionId::Servo
        && identity.servo_report_cycles == Some(0)
    {
        let enable = i.servo_enable;
        return format!(
            "the board has I{enable}=1 or I{in_background}=1, which is enough; where it is I{in_background}, the board may not mark the \
             reports that it makes so: try I{in_background}=0 I{enable}=1"
        );
    }
    let told: Vec<_> =
        needed.iter().filter_map(|(variable, value, _)| Some(format!("I{variable}={}", (*value)?))).collect();
    let told = told.join(", ");
    if needs_gather {
        return format!(
            "the board has {told} but no GATHER, which a reset or ENDGATHER ends; start it: pmacctl send GATHER"
        );
    }
    let what = if region == RegionId::Servo { "servo interrupt" } else { "background cycle" };
    let setting = family.dpram_setting();
    let other = setting.map_or_else(String::new, |setting| {
        format!(", and that it has {setting}: with another value no report comes into this DPRAM")
    });
    format!("the board has {told}, which is enough; check that its {what} runs{other}")
}

/// Functions that the configuration switches off, and reports that the daemon reads in part.
fn left_out(report: &mut Report, family: &Family, settings: &BoardSettings) {
    let off = Function::ALL.into_iter().filter(|function| !settings.functions.has(*function));
    let (off, not_there): (Vec<_>, Vec<_>) = off.partition(|function| family.functions.contains(function));
    let names = |functions: &[Function]| functions.iter().map(|f| f.name()).collect::<Vec<_>>().join(", ");
    if !off.is_empty() {
        let text = format!("{} switched off by the daemon's configuration", names(&off));
        report.ok("functions", text);
    }
    if !not_there.is_empty() {
        let text = format!("pmacd does not use {} on a {}", names(&not_there), family.title);
        report.ok("functions", text);
    }
    let BoardSettings { servo, background, .. } = settings;
    let parts = [
        ("servo", *servo != ServoSettings::all(family), json!(servo)),
        ("background", *background != BackgroundSettings::all(family), json!(background)),
    ];
    for (report_name, _, part) in parts.into_iter().filter(|(_, differs, _)| *differs) {
        let text = format!("the configuration reads only part of the {report_name} report: {part}");
        report.ok("reading", text);
    }
}

/// The text for a board that shows no sign of life.
fn no_answer(info: &BoardInfo) -> String {
    let text = format!(
        "{} does not answer; check its power, cable and address; one with I48, I49 and I58 off looks alike",
        info.board
    );
    let setting = info.known_family().ok().and_then(Family::dpram_setting);
    setting.map_or(text.clone(), |setting| {
        format!("{text}, and one without {setting}, which uses another DPRAM")
    })
}

fn functions(report: &mut Report, info: &BoardInfo, settings: &BoardSettings) {
    let who = [info.board_type.as_deref(), Some(info.family.as_str()), info.firmware.as_deref()];
    let who: Vec<_> = who.into_iter().flatten().collect();
    if let Some(replay) = &info.replay {
        report.ok("replay", replay.to_string());
    }
    match info.state {
        State::Live => report.ok("board", format!("{}, {}", info.board, who.join(", "))),
        State::Init => report.warn("board", format!("{} is being identified; wait", info.board)),
        State::Stale if info.is_over() => {
            report.ok("board", format!("{}, {}", info.board, who.join(", ")));
        }
        State::Stale | State::Dead => {
            report.fail("board", no_answer(info));
        }
    }
    if info.family == NO_FAMILY {
        report.fail("family", UNKNOWN_FAMILY);
    }
    if let (Some(answer), Ok(family)) = (&info.board_type, info.known_family())
        && let Some(other) = family.contradicted_by_type(answer)
    {
        let level = if other.is_laid_out_otherwise() { Level::Fail } else { Level::Ok };
        report.add(level, "family", other.to_string());
    }
    if info.board_type.as_deref().is_some_and(lacks_dpram) {
        report.fail("board", LACKS_DPRAM);
    }
    if !info.waiting.is_empty() {
        let names: Vec<_> = info.waiting.iter().map(|function| function.name()).collect();
        let why = waits_for(info.open_buffer.is_some(), &info.lines.definitions);
        report.warn("functions", format!("not used yet: {}: {why}", names.join(", ")));
    }
    for words in &info.program_words {
        report.add(if words.used { Level::Ok } else { Level::Warn }, "functions", words.to_string());
    }
    if !settings.functions.has(Function::Ascii) {
        return;
    }
    commands(report, info);
    if info.enabled.iter().any(|name| name == "interrupt") {
        report.ok("interrupt", "connected, and announces the board's replies");
    } else {
        report.ok("interrupt", "none comes: replies are polled for, at least every 20 ms");
    }
    if let Some(host_port) = &info.host_port {
        let HostPortInfo { controller, line, counts: HostPortCounts { served, old, unannounced } } =
            host_port;
        let counts =
            format!("{controller} line {line}, {served} interrupts served, {old} of them without a response");
        if *unannounced == 0 {
            report.ok("host port", counts);
        } else {
            let text = format!(
                "{counts}; {unannounced} responses came without an interrupt; check I56=1 and the line's jumper"
            );
            report.warn("host port", text);
        }
    }
}

/// Checks that socket and segment belong to the same daemon. A wrong `--socket` is hard to notice otherwise.
fn same_daemon(report: &mut Report, board: &Board, info: &BoardInfo) {
    let header = board.subscriber().header();
    if u64::from(info.pid) != header.owner_pid {
        let text = format!(
            "the socket belongs to process {} ({}), the segment to process {}; check --name and --socket",
            info.pid, info.segment, header.owner_pid
        );
        report.fail("same daemon", text);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::{PMAC, TURBO2};

    #[test]
    fn a_turbo_board_that_reports_nothing_may_use_another_dpram() {
        // Turbo User Manual p. 45: I24 is the base of the one DPRAM that serves all automatic functions.
        let told = |family: &Family| Identity {
            family: Some(family.number),
            servo_report: Some(1),
            servo_report_cycles: Some(1),
            background_report: Some(1),
            motor_mask: Some(1),
            ..Identity::default()
        };
        for region in [RegionId::Servo, RegionId::Background] {
            let why = missing(region, &told(&TURBO2));
            assert!(why.contains("which is enough") && why.contains("I24=$60000"), "{why}");
            assert!(!missing(region, &told(&PMAC)).contains("I24"));
        }
        let silent =
            |family: &str| no_answer(&BoardInfo { family: family.to_owned(), ..BoardInfo::default() });
        assert!(silent("turbo").ends_with("and one without I24=$60000, which uses another DPRAM"));
        for other in ["pmac2", NO_FAMILY] {
            assert!(silent(other).ends_with("I58 off looks alike"), "{other}");
        }
    }

    #[test]
    fn a_report_in_the_background_is_not_called_the_other_one() {
        let told = Identity {
            family: Some(TURBO2.number),
            servo_report: Some(1),
            servo_report_cycles: Some(0),
            ..Identity::default()
        };
        let why = missing(RegionId::Servo, &told);
        assert!(why.starts_with("the board has I48=1 or I57=1, which is enough"), "{why}");
    }
}
