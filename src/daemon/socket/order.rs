//! Orders: requests that the daemon words as a command line, and sends for clients that may send no line of their own.
//!
//! The control panel has no request for a jog to a position or for a new position, Turbo boards have no panel, and on the
//! others it may be off. All senders share the address that `#n` and `&n` change (User Manual p. 29), so the daemon asks
//! for the address first, and the line puts it back.

use super::policy::Role;
use crate::daemon::motion::effect::Starts;
use crate::daemon::shared::info::Info;
use crate::daemon::shared::parameters::check_number;
use crate::daemon::shared::queue::LINE_MAX;
use crate::format::Text;
use crate::function::panel::PanelAction;
use crate::map::m_definition::MDefinition;
use crate::map::{Family, Layout, Motors, PmacAddress, SourceAt, Systems};
use crate::protocol::{CallError, calls};

/// The limit of PMAC's software limits: 2^35 counts (Software Reference p. 72).
const FARTHEST: f64 = 34_359_738_368.0;

/// The most bytes of an address: `&16`.
pub(super) const ADDRESS_MAX: usize = 8;

/// A client's request, for one motor or one coordinate system: of a line with more commands nobody knows which of them a
/// board has refused.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Order {
    /// Jog a motor to a position, in counts.
    JogTo(usize, f64),
    /// Search for the home of a motor.
    Home(usize),
    /// Run the program of a coordinate system, or one step of it, by this on-line command. `confirmed`: lines that a
    /// rotary stream left run, too.
    Run { system: usize, confirmed: bool, letter: char },
    /// Tell a motor that it stands at this position, in counts.
    SetPosition(usize, f64),
}

impl Order {
    /// Jogs a motor.
    ///
    /// # Errors
    /// `family` has no such motor, or a motor does not count so far.
    pub(super) fn jog_to(call: &calls::MotorPosition, family: &Family) -> Result<Self, CallError> {
        check(call, family)?;
        Ok(Self::JogTo(call.motor, call.position))
    }

    /// Sets a motor's position.
    ///
    /// # Errors
    /// As [`Self::jog_to`].
    pub(super) fn set_position(call: &calls::MotorPosition, family: &Family) -> Result<Self, CallError> {
        check(call, family)?;
        Ok(Self::SetPosition(call.motor, call.position))
    }

    /// The order for `action` of the control panel, if a line can stand for it and the daemon has no other way to do it
    /// by line. The `number` is known to exist.
    pub(super) const fn of_panel(action: PanelAction, number: usize, confirmed: bool) -> Option<Self> {
        match action {
            PanelAction::Home => Some(Self::Home(number)),
            PanelAction::Start => Some(Self::Run { system: number, confirmed, letter: 'R' }),
            PanelAction::Step => Some(Self::Run { system: number, confirmed, letter: 'S' }),
            _ => None,
        }
    }

    /// The role that a client needs.
    pub(super) const fn role(self) -> Role {
        if let Self::SetPosition(..) = self { Role::Engineer } else { Role::Operate }
    }

    /// The motors that move, or whose position changes.
    pub(super) fn motors(self) -> Motors {
        match self {
            Self::JogTo(motor, _) | Self::SetPosition(motor, _) | Self::Home(motor) => Motors::of(motor),
            Self::Run { .. } => Motors::NONE,
        }
    }

    /// The programs that start.
    pub(super) fn starts(self) -> Starts {
        match self {
            Self::Run { system, confirmed, .. } => Starts { systems: Systems::of(system), confirmed },
            _ => Starts::default(),
        }
    }

    /// The question to the board before the line: which motor or coordinate system it addresses, and where the
    /// M-variable points that should be the motor's actual position.
    pub(super) fn question(self) -> String {
        match self {
            Self::JogTo(..) | Self::Home(_) => "#".to_owned(),
            Self::Run { .. } => "&".to_owned(),
            Self::SetPosition(motor, _) => format!("#M{motor}62->"),
        }
    }

    /// The line for the board, after its `answers` to [`Self::question`], and the address that the line puts back.
    ///
    /// # Errors
    /// Why the daemon sends no line.
    pub(super) fn line(
        self,
        answers: &[String],
        info: &Info,
    ) -> Result<(Text<LINE_MAX>, Text<ADDRESS_MAX>), CallError> {
        let addressed: Option<u32> = answers.first().and_then(|line| line.trim().parse().ok());
        let (what, sign) =
            if let Self::Run { .. } = self { ("coordinate system", '&') } else { ("motor", '#') };
        let addressed = addressed.ok_or_else(|| {
            CallError::refused(format_args!(
                "the board does not say which {what} is addressed; nothing was sent"
            ))
        })?;
        let line: String = match self {
            Self::JogTo(motor, position) => format!("#{motor}J={}", constant(position)),
            Self::Home(motor) => format!("#{motor}HM"),
            Self::Run { system, letter, .. } => format!("&{system}{letter}"),
            Self::SetPosition(motor, position) => sets_position(motor, position, answers.get(1), info)?,
        };
        let back = Text::of(&format_args!("{sign}{addressed}"));
        Ok((Text::of(&format_args!("{line}{back}")), back))
    }
}

fn check(call: &calls::MotorPosition, family: &Family) -> Result<(), CallError> {
    check_number(call.motor, family.motors, "motor")?;
    if call.position.is_nan() || call.position.abs() >= FARTHEST {
        return Err(CallError::invalid(
            "position",
            format_args!("less than {FARTHEST} counts either way: a motor counts no farther"),
        ));
    }
    Ok(())
}

/// The commands that set the position of a motor that stands; `defined` is the definition of its M-variable.
///
/// In a closed loop, commanded and actual position have to change together, or the motor leaps. A board does not carry
/// out two assignments in the same servo cycle, so the only such command is `HMZ`, which makes the commanded position 0.
/// While the loop is open, the board copies the actual position into the commanded one (Turbo Software Reference p.
/// 275), and drivers in production write the register. The line opens the loop once more, so that the register is never
/// written in a loop that another sender has just closed.
fn sets_position(
    motor: usize,
    position: f64,
    defined: Option<&String>,
    info: &Info,
) -> Result<String, CallError> {
    if !info.loops_left_open().contains(motor) {
        return match constant(position).as_str() {
            "0" => Ok(format!("#{motor}HMZ")),
            _ => Err(CallError::refused(format_args!(
                "the loop of motor {motor} is closed, where only 0 can be set (#{motor}HMZ): at another position the motor would \
                 leap; nothing was sent; pmacctl send '#{motor}K' opens the loop (a vertical axis without a brake falls), \
                 '#{motor}J/' closes it afterwards"
            ))),
        };
    }
    let register = actual_position(motor, info.family());
    let points = defined.and_then(|text| MDefinition::parse(text));
    let wanted =
        register.map(|PmacAddress { space, number }| MDefinition::Register { space, address: number });
    if wanted.is_none() || points != wanted {
        let register = register.map_or_else(String::new, |register| register.to_string());
        let points = defined.map_or("nowhere", |text| text.as_str());
        return Err(CallError::refused(format_args!(
            "M{motor}62 points to {points}, not to the actual position of motor {motor} ({register}), so pmacd cannot write \
             there; nothing was sent; if no program of yours uses M{motor}62, pmacctl send 'M{motor}62->{register}' points it there"
        )));
    }
    Ok(format!("#{motor}K M{motor}62={}*32*I{motor}08 ", constant(position)))
}

/// The register of the motor's actual position, which the servo report copies.
fn actual_position(motor: usize, family: &'static Family) -> Option<PmacAddress> {
    let entry = Layout::new(family, None).find("servo", "motor_actual_position", Some(motor))?;
    if let SourceAt::One(address) = entry.source(family) { Some(address) } else { None }
}

/// The position as the board takes it: to 1/32 of a count, without an exponent.
fn constant(counts: f64) -> String {
    ((counts * 32.0).round() / 32.0 + 0.0).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::shared::status::{BoardStatus, MotorsStatus};
    use crate::map::{PMAC, TURBO2};
    use crate::protocol::{BoardInfo, BoardSettings};

    fn answers(texts: &[&str]) -> Vec<String> {
        texts.iter().copied().map(str::to_owned).collect()
    }

    /// What the daemon knows of a board whose motors 1 and 12 are killed.
    fn info(family: &'static Family) -> Info {
        let mut info = Info::new(family, BoardInfo::default(), BoardSettings::default());
        let motors =
            MotorsStatus { loops_left_open: Motors::of(1).and(Motors::of(12)), ..MotorsStatus::default() };
        info.take(BoardStatus { motors, ..BoardStatus::default() });
        info
    }

    fn line(order: Order, texts: &[&str], family: &'static Family) -> Result<String, String> {
        let line = order.line(&answers(texts), &info(family));
        let line = line.map_err(|error| error.to_string())?;
        assert!(line.0.ends_with(&*line.1), "{line:?}");
        Ok(line.0.to_string())
    }

    #[test]
    fn a_position_is_sent_to_a_32nd_of_a_count() {
        for (counts, text) in [
            (5000.0, "5000"),
            (-0.001, "0"),
            (0.1, "0.09375"),
            (-34_359_738_367.9, "-34359738367.90625"),
            (1e10, "10000000000"),
        ] {
            let jog = Order::jog_to(&calls::MotorPosition { motor: 3, position: counts }, &PMAC).unwrap();
            assert_eq!((&*jog.question(), jog.motors()), ("#", Motors::of(3)));
            assert_eq!(line(jog, &["2"], &PMAC), Ok(format!("#3J={text}#2")));
            assert!(
                line(jog, &[], &PMAC).unwrap_err().contains("which motor is addressed; nothing was sent")
            );
        }
    }

    #[test]
    fn a_motor_that_the_board_has_not_and_a_position_too_far_are_refused() {
        for (motor, position, name) in [
            (0, 1.0, "motor"),
            (9, 1.0, "motor"),
            (1, 4e10, "position"),
            (1, -FARTHEST, "position"),
            (1, f64::NAN, "position"),
        ] {
            let call = calls::MotorPosition { motor, position };
            for refused in [Order::jog_to(&call, &PMAC), Order::set_position(&call, &PMAC)] {
                let refused = refused.unwrap_err();
                assert!(
                    matches!(&refused, CallError::InvalidParameter { parameter, .. } if parameter == name),
                    "{refused}"
                );
            }
        }
    }

    #[test]
    fn the_keys_of_a_panel_have_lines_that_put_the_address_back() {
        let of = |action, number| Order::of_panel(action, number, false);
        let home = of(PanelAction::Home, 12).unwrap();
        assert_eq!(line(home, &["5"], &TURBO2).unwrap(), "#12HM#5");
        for (action, text) in [(PanelAction::Start, "&3R&2"), (PanelAction::Step, "&3S&2")] {
            let run = of(action, 3).unwrap();
            assert_eq!((&*run.question(), run.starts().systems.bits()), ("&", 0b100));
            assert_eq!(line(run, &["2"], &PMAC).unwrap(), text);
            let unsaid = line(run, &["x"], &PMAC).unwrap_err();
            assert!(unsaid.contains("which coordinate system is addressed"), "{unsaid}");
        }
        let stops = [PanelAction::JogStop, PanelAction::Stop, PanelAction::Hold];
        assert!(stops.into_iter().all(|action| of(action, 1).is_none()), "stops have a way of their own");
    }

    #[test]
    fn a_position_is_set_by_the_register_in_an_open_loop_and_by_a_home_of_zero_in_a_closed_one() {
        let set = |motor, position| Order::SetPosition(motor, position);
        assert_eq!(set(12, 0.0).question(), "#M1262->");
        assert_eq!(
            line(set(1, 5000.0), &["2", "D:$2B"], &PMAC).unwrap(),
            "#1K M162=5000*32*I108 #2",
            "the kill opens a loop that somebody has just closed"
        );
        assert_eq!(line(set(12, -0.5), &["1", "D:$00060B"], &TURBO2).unwrap(), "#12K M1262=-0.5*32*I1208 #1");
        for definition in ["D:$28", "*", "X:$2B,0,24", "D:$8B"] {
            let refused = line(set(1, 5000.0), &["2", definition], &PMAC).unwrap_err();
            let told =
                format!("M162 points to {definition}, not to the actual position of motor 1 (D:$002B)");
            assert!(refused.contains(&told) && refused.contains("nothing was sent"), "{refused}");
        }
        assert_eq!(line(set(2, 0.0), &["1", "*"], &PMAC).unwrap(), "#2HMZ#1");
        let refused = line(set(2, 1.0), &["1", "D:$67"], &PMAC).unwrap_err();
        assert!(refused.contains("the motor would leap; nothing was sent"), "{refused}");
    }
}
