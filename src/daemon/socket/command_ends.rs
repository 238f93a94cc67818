//! What a command ends that goes to the board: programs, motions or a gather.

use super::stop_target::Target;
use crate::daemon::shared::job::Job;
use crate::daemon::shared::queue::Command;
use crate::function::panel::PanelAction;
use crate::protocol::control;
use crate::protocol::line_ends::LineEnds;

/// What `command` ends. What stops in the place of a panel request counts as that.
pub(super) fn ends_of(command: &Command) -> Option<LineEnds> {
    match command {
        Command::Send { line, .. } => LineEnds::of(line),
        Command::Control { character, .. } => ended_by_character(*character),
        Command::Job { job, .. } => match &**job {
            Job::Panel(request) => ended_by_panel(request.action()?, request.mask()),
            _ => None,
        },
        Command::First { .. } | Command::ReadWords { .. } => None,
    }
}

/// The motors that `command` sets in motion by the control panel, bit 0 being motor 1.
pub(super) fn jogged_by(command: &Command) -> u32 {
    let Command::Job { job, .. } = command else { return 0 };
    let Job::Panel(request) = &**job else { return 0 };
    let jogs = |action: PanelAction| action.is_for_motors() && action != PanelAction::JogStop;
    if request.action().is_some_and(jogs) { request.mask() } else { 0 }
}

/// What the stop of `target` ends.
pub(super) fn ended_by_stop(target: Target) -> Option<LineEnds> {
    match target {
        Target::Motors(motors) => ended_by_panel(PanelAction::JogStop, motors),
        Target::Systems(..) => ended_by_panel(PanelAction::Stop, target.aborted()),
    }
}

fn ended_by_panel(action: PanelAction, mask: u32) -> Option<LineEnds> {
    let what = format!("panel {action}");
    match action {
        PanelAction::Start | PanelAction::Hold => None,
        _ if mask == 0 => None,
        _ if action.is_for_motors() => Some(LineEnds { what, motors: mask, ..LineEnds::default() }),
        _ => Some(LineEnds { what, systems: mask, ..LineEnds::default() }),
    }
}

fn ended_by_character(character: u8) -> Option<LineEnds> {
    let ends = LineEnds { what: control::name(character), ..LineEnds::default() };
    let all = u32::MAX;
    match character {
        control::ABORT | control::KILL => Some(LineEnds { systems: all, motors: all, ..ends }),
        control::QUIT | control::STEP => Some(LineEnds { systems: all, ..ends }),
        _ => None,
    }
}
