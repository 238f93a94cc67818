//! What a command does to programs, motions and a gather, as far as its text tells: the one place of these rooms that reads it.

use std::time::Duration;

use super::target::Target;
use crate::daemon::shared::job::Job;
use crate::daemon::shared::queue::Command;
use crate::function::panel::PanelAction;
use crate::map::{Motors, Systems};
use crate::protocol::buffer_line::WhileOpen;
use crate::protocol::line_ends::LineEnds;
use crate::protocol::moved_motors::{EndlessJogs, motors_moved};
use crate::protocol::tokens::{self, Kind, Needs};
use crate::protocol::{control, i_lines, line};

/// The programs that a call starts, and whether its caller means what is left too.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Starts {
    /// Their coordinate systems.
    pub systems: Systems,
    /// The caller says that what is left is to run.
    pub confirmed: bool,
}

impl Starts {
    /// Of a control character: every program, or none.
    pub const fn of_character(character: u8, confirmed: bool) -> Self {
        let starts = matches!(character, control::RUN | control::STEP);
        Self { systems: if starts { Systems::ALL } else { Systems::NONE }, confirmed }
    }
}

/// What a command on its way to the board does, if the board carries it out.
#[derive(Debug, Default)]
pub struct CommandEffect {
    /// What it ends. What stops in the place of a panel request counts as that.
    pub ends: Option<LineEnds>,
    /// This control character stops every motor: no jog is held any more.
    pub stops_all: Option<u8>,
    /// The motors that it sets in motion by the control panel.
    pub jogs: Motors,
}

impl CommandEffect {
    /// Of `command`.
    pub fn of(command: &Command) -> Self {
        match command {
            Command::Send { line, .. } => Self { ends: LineEnds::of(line), ..Self::default() },
            Command::Control { character, .. } => Self {
                ends: ended_by_character(*character),
                stops_all: matches!(*character, control::ABORT | control::KILL).then_some(*character),
                jogs: Motors::NONE,
            },
            Command::Job { job, .. } => match &**job {
                Job::Panel(request) => request.action().map_or_else(Self::default, |action| Self {
                    ends: ended_by_panel(action, request.mask()),
                    stops_all: None,
                    jogs: match action.is_for_motors() && action != PanelAction::JogStop {
                        true => Motors::from_bits(request.mask()),
                        false => Motors::NONE,
                    },
                }),
                _ => Self::default(),
            },
            Command::First { .. } | Command::ReadWords { .. } => Self::default(),
        }
    }
}

/// What the stop of `target` ends.
pub fn ended_by_stop(target: Target) -> Option<LineEnds> {
    match target {
        Target::Motors(motors) => ended_by_panel(PanelAction::JogStop, motors.bits()),
        Target::Systems(..) => ended_by_panel(PanelAction::Stop, target.aborted().bits()),
    }
}

fn ended_by_panel(action: PanelAction, mask: u32) -> Option<LineEnds> {
    let ends = LineEnds { what: format!("panel {action}"), ..LineEnds::default() };
    match action {
        PanelAction::Start | PanelAction::Hold => None,
        _ if mask == 0 => None,
        _ if action.is_for_motors() => Some(LineEnds { motors: mask, ..ends }),
        _ => Some(LineEnds { systems: mask, ..ends }),
    }
}

fn ended_by_character(character: u8) -> Option<LineEnds> {
    let ends = LineEnds { what: control::name(character), systems: u32::MAX, ..LineEnds::default() };
    match character {
        control::ABORT | control::KILL => Some(LineEnds { motors: u32::MAX, ..ends }),
        control::QUIT | control::STEP => Some(ends),
        _ => None,
    }
}

/// The motors that `line` names and moves.
pub fn moved_by(line: &str) -> Motors {
    Motors::from_bits(motors_moved(line))
}

/// What a command line does to the programs of the coordinate systems it names, to the control panel, and to motors.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LineEffect {
    /// It starts them.
    pub starts: Systems,
    /// It points them elsewhere, or takes away what their rotary buffers hold.
    pub forgets: Systems,
    /// It ends them, or points them at their rotary buffers.
    pub aborts: Systems,
    /// It switches the control panel off.
    pub ends_panel: bool,
    /// What it comes to where a program buffer is open.
    pub while_open: WhileOpen,
    /// The motors that jog on, and are to stop when its sender is gone: if the board carries it out, and if it refuses it.
    pub jogs: [Motors; 2],
    /// How long their sender may be silent meanwhile, if that ends them, too.
    pub silence: Option<Duration>,
}

impl LineEffect {
    /// Of `line`, while the rotary buffers are open or not, on a board whose I-variable `panel` is 3 while it reads the control
    /// panel. Which coordinate system a line means that names none is not known.
    pub fn of(line: &str, rotary_is_open: bool, panel: Option<u16>) -> Self {
        let is_off = |setting: i_lines::Setting| {
            panel.is_some_and(|panel| setting.numbers.has(panel.into())) && setting.value != Some(3)
        };
        let ends_panel = i_lines::settings(line.as_bytes()).any(is_off);
        let plain = line::plain(line);
        // CLEAR empties the buffer that is open, which this line may have opened itself.
        let clears = match plain.find("OPEN") {
            Some(at) => plain[at..].starts_with("OPENROT"),
            None => rotary_is_open,
        };
        let takes_away = |commands: &str| {
            let is_cleared = clears && ["CLEAR", "CLR"].iter().any(|word| commands.contains(word));
            is_cleared || ["DELETEROT", "DELROT"].iter().any(|word| commands.contains(word))
        };
        let before = plain.split('&').next().unwrap_or_default();
        let all = takes_away(before) || line::resets(line.as_bytes());
        let forgets = if all { Systems::ALL } else { Systems::NONE };
        let mut effect =
            Self { forgets, ends_panel, while_open: WhileOpen::of(line.as_bytes()), ..Self::default() };
        let text = line::commands(line).collect::<Vec<_>>().join(" ").to_ascii_uppercase();
        for ((bit, commands), spaced) in line::addressed(&plain, '&').zip(text.split('&').skip(1)) {
            let system = Systems::from_bits(bit);
            if takes_away(commands) {
                effect.forgets.add(system);
            }
            effect.add_starts(system, commands);
            effect.add_starts(
                system,
                spaced.trim_start_matches(|c: char| c.is_ascii_digit() || c.is_whitespace()),
            );
        }
        effect
    }

    /// The jogs of `line` end with its sender, and when the sender is silent for so long.
    pub fn ends_jogs(&mut self, line: &str, silence: Option<Duration>) {
        let jogs = [EndlessJogs::of(line), EndlessJogs::of_refused(line)];
        self.jogs = jogs.map(|jogs| Motors::from_bits(jogs.motors));
        self.silence = silence;
    }

    /// Adds whether `commands` start or abort the coordinate system that is addressed, or point it elsewhere. An `&` may be an
    /// operator, and `P R` one word or two: a start that is asked about once too often harms nobody.
    fn add_starts(&mut self, system: Systems, commands: &str) {
        let mut elsewhere = false;
        for token in tokens::of_known(commands) {
            let said = &commands[token.span];
            match (token.kind, said.as_bytes().first()) {
                (Kind::Moves(Needs::System), Some(b'B')) => {
                    let program = said[1..].trim_start_matches('0');
                    elsewhere = program.starts_with(|c: char| c.is_ascii_digit());
                    if elsewhere { &mut self.forgets } else { &mut self.aborts }.add(system);
                }
                (Kind::Moves(Needs::System), Some(b'R' | b'S')) if !elsewhere => self.starts.add(system),
                (Kind::Moves(Needs::System), Some(b'A' | b'Q')) => self.aborts.add(system),
                _ => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn b1_5_a_line_tells_which_programs_it_starts_and_which_lines_may_be_gone() {
        for (line, starts, forgets) in [
            ("&1R", 0b1, 0),
            ("& 2 b0 s", 0b10, 0),
            ("&1R&2R", 0b11, 0),
            ("R", 0, 0),
            ("&1PR", 0, 0),
            ("&1B5R", 0, 0b1),
            ("&1R#1P", 0b1, 0),
            ("&1 R P1", 0b1, 0),
            ("&1#1P R", 0b1, 0),
            ("P1=5 &1R", 0b1, 0),
            ("#1->X &3R", 0b100, 0),
            ("&1B0P1=3S", 0b1, 0),
            ("&1B5B0R", 0b1, 0b1),
            ("&1RX$700", 0, 0),
            ("&1SAVE", 0, 0),
            ("&1B0", 0, 0),
            ("&1B0.5", 0, 0),
            ("&3DELETE ROT", 0, 0b100),
            ("&3DELETE GATHER", 0, 0),
            ("&3CLEAR", 0, 0),
            ("OPEN ROT CLEAR", 0, u32::MAX),
            ("&2 OPEN ROTARY CLEAR", 0, 0b10),
            ("OPEN PLC 3 CLEAR", 0, 0),
            ("OPEN PROG 3 CLEAR", 0, 0),
            ("SEND\"DELROT &1R $$$\"", 0, 0),
            ("$$$", 0, u32::MAX),
            ("&0R", 0, 0),
            ("&99R", 0, 0),
            ("&1A", 0, 0),
            ("#1J+", 0, 0),
        ] {
            let aborts = match line {
                "&1A" | "&1B0" | "&1B0.5" | "&1B0P1=3S" | "&1B5B0R" => 1,
                "& 2 b0 s" => 2,
                _ => 0,
            };
            let found = LineEffect::of(line, false, Some(2));
            let found = [found.starts, found.forgets, found.aborts].map(Systems::bits);
            assert_eq!(found, [starts, forgets, aborts], "{line}");
        }
        for (line, forgets) in [("CLEAR", u32::MAX), ("&3clr", 0b100), ("OPEN PLC 3 CLEAR", 0)] {
            let LineEffect { starts, forgets: found, aborts, .. } = LineEffect::of(line, true, Some(2));
            assert_eq!([starts, found, aborts].map(Systems::bits), [0, forgets, 0], "{line}");
        }
    }

    #[test]
    fn b2_6_a_line_tells_whether_it_switches_the_panel_off() {
        for (line, ends) in [
            ("I2=0", true),
            ("I1..5=0", true),
            ("i 2 = P1", true),
            ("I2=3", false),
            ("I2", false),
            ("I22=0", false),
        ] {
            assert_eq!(LineEffect::of(line, false, Some(2)).ends_panel, ends, "{line}");
            assert!(!LineEffect::of(line, false, None).ends_panel, "{line}");
        }
    }
}
