//! The questions that identify a board.

use std::ops::RangeInclusive;

use crate::daemon::bus::scale_doubts::I10;
use crate::format::Text;
use crate::map::{Family, IVariables};
use crate::protocol::LINE_MAX;
use crate::segment::Identity;

/// The I-variable of the serial handshake, which sets how a reply ends, in every family.
const HANDSHAKE: u16 = 3;
/// The I-variables of PLC programs and of error reports.
pub(super) const PLC_CONTROL: u16 = 5;
pub(super) const ERROR_REPORT: u16 = 6;

/// The questions in order. Each question is one line; each value of its reply is one reply line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Question {
    /// The board's type.
    Type,
    /// The board's firmware.
    Version,
    /// The I-variables for the board's reports and for the functions switched on.
    Reports(Vec<(u16, Tells)>),
    /// Ix07, Ix08, Ix09, Ix60 of these motors, one after the other.
    Scales(RangeInclusive<usize>),
}

/// The meaning of an I-variable's value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Tells {
    /// I10.
    ServoPeriod,
    /// Servo cycles from one servo report to the next; 0: there is no such number.
    ReportCycles,
    /// The servo report is on.
    ServoReport,
    /// 1: the servo report is on, and the board makes it in the background, so that no number of servo cycles separates
    /// two reports.
    ServoInBackground,
    /// The background report is on.
    BackgroundReport,
    /// The highest motor in the report.
    Reported,
    /// 3: the control panel is the DPRAM's.
    Panel,
    /// 1: the board uses the variable tables.
    Variables,
    /// How replies end (I3); only watched here.
    Handshake,
    /// Which PLC programs may run (I5): 0, none.
    PlcControl,
    /// How the board reports errors (I6): 2, none of programs.
    ErrorReport,
}

/// The questions for a board of `family`. No line is longer than the board takes: the motors' scales take as many lines
/// as that needs.
pub(super) fn questions(family: &Family) -> Vec<Question> {
    let i = &family.i;
    let reports = [
        (Some(I10), Tells::ServoPeriod),
        (Some(i.servo_period), Tells::ReportCycles),
        (Some(i.servo_enable), Tells::ServoReport),
        (i.servo_in_background, Tells::ServoInBackground),
        (Some(i.background_enable), Tells::BackgroundReport),
        (i.reported, Tells::Reported),
        (i.panel, Tells::Panel),
        (Some(i.variables_enable), Tells::Variables),
        (Some(HANDSHAKE), Tells::Handshake),
    ];
    let reports = reports.into_iter().filter_map(|(number, meaning)| Some((number?, meaning)));
    let mut questions = vec![Question::Type, Question::Version, Question::Reports(reports.collect())];
    // A line must fit into one part: the daemon knows only some families that join two parts.
    let limit = (family.ascii.command_bytes - 1).min(LINE_MAX);
    let mut first = 1;
    for motor in 1..=family.motors {
        if Question::Scales(first..=motor).line().len() > limit {
            questions.push(Question::Scales(first..=motor - 1));
            first = motor;
        }
    }
    questions.push(Question::Scales(first..=family.motors));
    // These variables have a question of their own: old captures have no answer to it.
    questions
        .push(Question::Reports(vec![(PLC_CONTROL, Tells::PlcControl), (ERROR_REPORT, Tells::ErrorReport)]));
    questions
}

/// Takes note of the answer to `TYPE`. The answer tells the family, within the known generation.
pub(super) fn note_type(identity: &mut Identity, answer: &[u8]) {
    let family = identity.family.and_then(Family::by_number);
    let answer = Text::from_bytes(answer);
    identity.family = family.map(|family| family.told_by_type(&answer).number);
    identity.board_type = Some(answer);
}

impl Question {
    /// How many values the reply has, each in a line of its own.
    pub(super) fn values(&self) -> usize {
        match self {
            Self::Type | Self::Version => 1,
            Self::Reports(variables) => variables.len(),
            Self::Scales(motors) => motors.clone().count() * IVariables::SCALES.len(),
        }
    }

    /// The question split in two, with half of the motors each.
    pub(super) fn halves(&self) -> Option<[Self; 2]> {
        let Self::Scales(motors) = self else { return None };
        let (first, last) = (*motors.start(), *motors.end());
        let middle = first.midpoint(last);
        (first < last).then(|| [Self::Scales(first..=middle), Self::Scales(middle + 1..=last)])
    }

    /// The line that asks the question.
    pub(super) fn line(&self) -> String {
        match self {
            Self::Type => "TYPE".to_owned(),
            Self::Version => "VERSION".to_owned(),
            Self::Reports(variables) => {
                variables.iter().map(|(number, _)| format!("I{number}")).collect::<Vec<_>>().join(" ")
            }
            Self::Scales(motors) => {
                let scales = |motor| IVariables::SCALES.map(|which| IVariables::motor(motor, which));
                motors.clone().flat_map(scales).map(|number| format!("I{number}")).collect()
            }
        }
    }
}
