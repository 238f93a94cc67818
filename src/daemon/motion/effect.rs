//! A command's effect on programs, motions and a gather.

use std::time::Duration;

use super::target::Target;
use crate::daemon::shared::job::Job;
use crate::daemon::shared::queue::Command;
use crate::format::Text;
use crate::function::panel::PanelAction;
use crate::language::{LineEnds, Meaning, WhileOpen};
use crate::map::{Motors, Systems};
use crate::protocol::control;

/// The programs that a call starts, and whether its caller also means the lines left in their rotary buffers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Starts {
    /// Their coordinate systems.
    pub systems: Systems,
    /// The caller confirms that the lines left are to run.
    pub confirmed: bool,
}

impl Starts {
    /// Of a control character: every program, or none.
    pub const fn of_character(character: u8, confirmed: bool) -> Self {
        let starts = matches!(character, control::RUN | control::STEP);
        Self { systems: if starts { Systems::ALL } else { Systems::NONE }, confirmed }
    }
}

/// The effect of a command on its way to the board, if the board carries it out.
#[derive(Debug, Default)]
pub struct CommandEffect {
    /// The programs, motions or gather that the command ends. A stop sent in place of a panel request counts as that
    /// panel request.
    pub ends: Option<LineEnds>,
    /// The command resets the board.
    pub resets: bool,
    /// The control character that stops every motor, and so ends every hold.
    pub stops_all: Option<u8>,
    /// The motors that the command sets in motion by the control panel.
    pub jogs: Motors,
}

impl CommandEffect {
    /// Of `command`.
    pub fn of(command: &Command) -> Self {
        match command {
            Command::Send { line, .. } => {
                Self { ends: line.meaning.ends(), resets: line.meaning.resets, ..Self::default() }
            }
            Command::Control { character, .. } => Self {
                ends: ended_by_character(*character),
                stops_all: matches!(*character, control::ABORT | control::KILL).then_some(*character),
                ..Self::default()
            },
            Command::Job { job, .. } => match &**job {
                Job::Panel(request) => request.action().map_or_else(Self::default, |action| Self {
                    ends: ended_by_panel(action, request.mask()),
                    jogs: match action.is_for_motors() && action != PanelAction::JogStop {
                        true => Motors::from_bits(request.mask()),
                        false => Motors::NONE,
                    },
                    ..Self::default()
                }),
                _ => Self::default(),
            },
            Command::First { .. } | Command::ReadWords { .. } => Self::default(),
        }
    }
}

/// The programs or motions that the stop of `target` ends.
pub fn ended_by_stop(target: Target) -> Option<LineEnds> {
    match target {
        Target::Motors(motors) => ended_by_panel(PanelAction::JogStop, motors.bits()),
        Target::Systems(..) => ended_by_panel(PanelAction::Stop, target.aborted().bits()),
    }
}

fn ended_by_panel(action: PanelAction, mask: u32) -> Option<LineEnds> {
    let ends = LineEnds { what: Text::of(&format_args!("panel {action}")), ..LineEnds::default() };
    match action {
        PanelAction::Start | PanelAction::Hold => None,
        _ if mask == 0 => None,
        _ if action.is_for_motors() => Some(LineEnds { motors: Motors::from_bits(mask), ..ends }),
        _ => Some(LineEnds { systems: Systems::from_bits(mask), ..ends }),
    }
}

fn ended_by_character(character: u8) -> Option<LineEnds> {
    let what = Text::of(&control::name(character));
    let ends = LineEnds { what, systems: Systems::ALL, ..LineEnds::default() };
    match character {
        control::ABORT | control::KILL => Some(LineEnds { motors: Motors::ALL, ..ends }),
        control::QUIT | control::STEP => Some(ends),
        _ => None,
    }
}

/// The effect of a command line, once the board has carried it out, on the daemon's knowledge.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LineEffect {
    /// The coordinate systems that the line points elsewhere, or whose rotary buffers it empties.
    pub forgets: Systems,
    /// The coordinate systems whose programs the line ends, or that it points at their rotary buffers.
    pub aborts: Systems,
    /// The line switches the control panel off.
    pub ends_panel: bool,
    /// The line's effect while a program buffer is open.
    pub while_open: WhileOpen,
    /// The motors that jog on, and that the daemon stops when the sender is gone: if the board carries out the line,
    /// and if the board refuses it.
    pub jogs: [Motors; 2],
    /// How long the sender may be silent, if silence ends these jogs, too.
    pub silence: Option<Duration>,
}

impl LineEffect {
    /// The effect of `line`, with the rotary buffers open or not. The board reads the control panel while its
    /// I-variable `panel` is 3.
    pub fn of(line: &Meaning, rotary_is_open: bool, panel: Option<u16>) -> Self {
        let clears = if rotary_is_open { line.clears } else { Systems::NONE };
        Self {
            forgets: line.takes_away.and(line.points_elsewhere).and(clears),
            aborts: line.aborts,
            ends_panel: panel.is_some_and(|panel| line.settings.has_not_3(panel)),
            while_open: line.while_open,
            ..Self::default()
        }
    }

    /// The jogs of the line end with its sender, and when the sender is silent for as long as `silence`.
    pub fn ends_jogs(&mut self, line: &Meaning, silence: Option<Duration>) {
        self.jogs = [line.jogs, line.jogs_if_refused].map(|jogs| jogs.motors);
        self.silence = silence;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_may_take_away_what_is_left_or_switch_the_panel_off() {
        for (line, while_open, forgets) in [
            ("CLEAR", false, Systems::NONE),
            ("CLEAR", true, Systems::ALL),
            ("&3clr", true, Systems::of(3)),
            ("OPEN PLC 3 CLEAR", true, Systems::NONE),
            ("OPEN ROT CLEAR", false, Systems::ALL),
            ("$$$", false, Systems::ALL),
        ] {
            assert_eq!(LineEffect::of(&Meaning::of(line), while_open, None).forgets, forgets, "{line}");
        }
        for (line, ends) in
            [("I2=0", true), ("I1..5=0", true), ("I2=P1", true), ("I2=3", false), ("I22=0", false)]
        {
            let meaning = Meaning::of(line);
            assert_eq!(LineEffect::of(&meaning, false, Some(2)).ends_panel, ends, "{line}");
            assert!(!LineEffect::of(&meaning, false, None).ends_panel, "{line}");
        }
    }
}
