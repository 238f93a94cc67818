//! The moves by which a user tunes a motor, as jogs: the settings of the motor's jog variables for each move, and the
//! obstacles to the move.
//!
//! A jog takes Ix20 ms, or 2*Ix21 if that is more, to come to its speed Ix22, of which Ix21 at both ends are S-curve; Ix19
//! bounds the acceleration. Ix20=1 with Ix21=0 is the shortest (Software Reference pp. 75-76). A jog needs no axis, no
//! program and no coordinate system of the site's.

use crate::map::IVariables;

/// A move of the motor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TuneMove {
    /// The commanded position goes to its end in 2 ms: the motor begins to slow down as soon as it has come to its
    /// speed.
    Step,
    /// The move takes this time, in ms. Its velocity is made of parabolas: up in one half of the time, down in the
    /// other.
    Parabolic(u32),
}

/// I-variables of the motor, in the order of the questions: fatal limit, software limits, fastest and steepest of
/// programs, and of jogs.
pub const ASKED: [usize; 9] = [11, 13, 14, 16, 17, 19, 20, 21, 22];
/// The asked variables that a move sets.
pub const SET: [usize; 5] = [11, 19, 20, 21, 22];
/// Parts of a count in Ix11.
const PER_COUNT: f64 = 16.0;
/// The largest Ix11. The board turns a larger value into another number, even 0, at which it never kills the motor.
const LARGEST_IX11: f64 = 8_388_607.0;

/// The board's answers, in the order of [`ASKED`].
#[derive(Debug, Clone, PartialEq)]
pub struct Settings([String; ASKED.len()]);

impl Settings {
    /// The board's reply; `None` unless it is a number for each question.
    pub fn of(reply: Vec<String>) -> Option<Self> {
        let settings = Self(reply.try_into().ok()?);
        ASKED.iter().all(|number| settings.value(*number).is_some()).then_some(settings)
    }

    fn text(&self, number: usize) -> &str {
        ASKED.iter().position(|asked| *asked == number).map_or("", |place| self.0[place].trim())
    }

    fn value(&self, number: usize) -> Option<f64> {
        let text = self.text(number);
        match text.strip_prefix('$') {
            Some(hex) => u32::from_str_radix(hex, 16).ok().map(f64::from),
            None => text.parse().ok().filter(|value: &f64| value.is_finite()),
        }
    }

    /// A variable above 0.
    fn bound(&self, number: usize) -> Option<f64> {
        self.value(number).filter(|value| *value > 0.0)
    }

    /// Which variables of motor `motor` differ in `now`.
    pub fn changes(&self, now: &Self, motor: u8) -> String {
        let is_other = |number: &&usize| self.text(**number) != now.text(**number);
        let changed = ASKED.iter().filter(is_other).map(|number| {
            let name = IVariables::motor(motor.into(), *number);
            format!("I{name} was {}, and is {} now", self.text(*number), now.text(*number))
        });
        changed.collect::<Vec<_>>().join("; ")
    }

    /// The lines that restore the variables set by [`Plan::lines`].
    pub fn put_back(&self, motor: u8) -> Vec<String> {
        SET.map(|number| line(motor, number, self.text(number))).into()
    }
}

/// A move without an obstacle.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// How long the commanded position takes, in seconds.
    pub time_s: f64,
    /// The following error in counts at which the board kills the motor meanwhile.
    pub limit: f64,
    values: [f64; SET.len()],
}

impl Plan {
    /// A move by `size` counts from `start`, on a motor with `settings`. `limit` is the following error in counts at
    /// which the board is to kill the motor, unless the motor's own limit (Ix11) is smaller.
    ///
    /// # Errors
    /// The obstacle to the move, and its cure.
    pub fn new(
        what: TuneMove,
        motor: u8,
        (start, size): (f64, f64),
        limit: Option<f64>,
        settings: &Settings,
    ) -> Result<Self, String> {
        let x = |number| format!("I{}", IVariables::motor(motor.into(), number));
        let length = size.abs();
        let own = settings.bound(11).map(|limit| limit / PER_COUNT);
        let asked = limit.or(own.map(|_| 2.0 * length));
        let limit = match (asked, own) {
            (Some(asked), Some(own)) => asked.min(own),
            (Some(asked), None) => asked,
            (None, _) => {
                let why =
                    "the board would follow any error; say with --limit at which one it is to kill the motor";
                return Err(format!("{}=0: {why}", x(11)));
            }
        };
        if limit * PER_COUNT > LARGEST_IX11 {
            let most = (LARGEST_IX11 / PER_COUNT).floor();
            return Err(format!(
                "{limit} counts are more than {} can hold; choose a --limit up to {most}",
                x(11)
            ));
        }
        // At a step, the following error is the whole length at once.
        if what == TuneMove::Step && length >= limit {
            return Err(format!(
                "a step of {length} counts would be a fatal following error: the limit is {limit} counts ({}); choose a smaller --size",
                x(11)
            ));
        }
        let end = start + size;
        let beyond = |number, is_beyond: fn(f64, f64) -> bool| {
            settings.value(number).filter(|limit| *limit != 0.0 && is_beyond(end, *limit))
        };
        let software =
            [(13, beyond(13, |end, limit| end > limit)), (14, beyond(14, |end, limit| end < limit))];
        if let Some((number, Some(limit))) = software.into_iter().find(|(_, limit)| limit.is_some()) {
            return Err(format!("{end} counts lie beyond the software limit of {limit} ({})", x(number)));
        }
        let limit_sixteenths = (limit * PER_COUNT).floor().max(1.0);
        let (time_ms, values) = match what {
            // Fast enough that half of the way is speeding up.
            TuneMove::Step => (2.0, [limit_sixteenths, 2.0 * length, 1.0, 0.0, length]),
            TuneMove::Parabolic(time_ms) => {
                // Whole milliseconds.
                let quarter = f64::from(time_ms.div_ceil(4).max(1));
                let time = 4.0 * quarter;
                let (speed, steepest) = (2.0 * length / time, 8.0 * length / (time * time));
                let bounds = [(16, speed, "counts/ms"), (17, steepest, "counts/ms^2")];
                for (number, needed, unit) in bounds {
                    if let Some(most) = settings.bound(number).filter(|most| needed > *most) {
                        return Err(format!(
                            "the move needs {needed:.4} {unit}, more than programs may ask of the motor ({}={most}); \
                             choose a smaller --size or a longer --time",
                            x(number)
                        ));
                    }
                }
                (time, [limit_sixteenths, 2.0 * steepest, 2.0 * quarter, quarter, speed])
            }
        };
        Ok(Self { time_s: time_ms / 1e3, limit: limit_sixteenths / PER_COUNT, values })
    }

    /// The lines that set the motor's jog variables.
    pub fn lines(&self, motor: u8) -> Vec<String> {
        SET.iter().zip(self.values).map(|(number, value)| line(motor, *number, value)).collect()
    }
}

fn line(motor: u8, number: usize, value: impl std::fmt::Display) -> String {
    format!("I{}={value}", IVariables::motor(motor.into(), number))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(fatal: &str, positive: &str, negative: &str) -> Settings {
        let reply = [fatal, positive, negative, "32", "0.5", "0.015625", "0", "50", "32"];
        Settings::of(reply.map(str::to_owned).into()).unwrap()
    }

    fn plan(
        what: TuneMove,
        size: f64,
        limit: Option<f64>,
        settings: &Settings,
    ) -> Result<Vec<String>, String> {
        Plan::new(what, 3, (100.0, size), limit, settings).map(|plan| plan.lines(3))
    }

    #[test]
    fn a_move_is_a_jog_with_variables_of_its_own() {
        let factory = settings("32000", "0", "0");
        let lines = |what, size, limit| plan(what, size, limit, &factory).unwrap().join(" ");
        assert_eq!(lines(TuneMove::Step, -100.0, None), "I311=3200 I319=200 I320=1 I321=0 I322=100");
        assert_eq!(lines(TuneMove::Step, 0.5, Some(1.0)), "I311=16 I319=1 I320=1 I321=0 I322=0.5");
        assert_eq!(lines(TuneMove::Step, 1000.0, Some(1e9)), "I311=32000 I319=2000 I320=1 I321=0 I322=1000");
        assert_eq!(
            lines(TuneMove::Parabolic(500), 1000.0, None),
            "I311=32000 I319=0.064 I320=250 I321=125 I322=4"
        );
        assert_eq!(factory.put_back(3), ["I311=32000", "I319=0.015625", "I320=0", "I321=50", "I322=32"]);
    }

    #[test]
    fn what_speaks_against_a_move_is_told_before_it() {
        let (factory, unlimited) = (settings("32000", "0", "0"), settings("0", "0", "0"));
        let why = |what, size, limit, settings| plan(what, size, limit, settings).unwrap_err();
        assert!(why(TuneMove::Step, 2000.0, None, &factory).contains("the limit is 2000 counts (I311)"));
        assert!(why(TuneMove::Step, 100.0, Some(100.0), &factory).contains("choose a smaller --size"));
        assert!(why(TuneMove::Step, 100.0, None, &unlimited).starts_with("I311=0: "));
        assert!(plan(TuneMove::Step, 100.0, Some(200.0), &unlimited).is_ok());
        assert!(why(TuneMove::Step, 100.0, Some(524_288.0), &unlimited).contains("a --limit up to 524287"));
        let lines = plan(TuneMove::Step, 100.0, Some(524_287.0), &unlimited).unwrap();
        assert_eq!(lines[0], "I311=8388592");
        assert!(why(TuneMove::Parabolic(10), 1000.0, None, &factory).contains("I316=32"));
        assert!(why(TuneMove::Parabolic(100), 1000.0, None, &factory).contains("I317=0.5"));
        let fenced = settings("$7D00", "150", "-20");
        assert!(
            why(TuneMove::Step, 60.0, None, &fenced)
                .contains("160 counts lie beyond the software limit of 150 (I313)")
        );
        assert!(why(TuneMove::Step, -130.0, None, &fenced).contains("limit of -20 (I314)"));
        assert!(plan(TuneMove::Step, 50.0, None, &fenced).is_ok());
    }

    #[test]
    fn a_reply_that_is_no_number_is_none() {
        let reply = |text: &str| Settings::of(vec![text.to_owned(); ASKED.len()]);
        assert!(reply("1").is_some() && reply("$FF").is_some());
        assert!(reply("").is_none() && reply("ERR003").is_none() && Settings::of(Vec::new()).is_none());
    }
}
