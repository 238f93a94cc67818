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
    /// The move takes this time, in ms, or the shortest that the motor allows. Its velocity is made of parabolas: up in
    /// one half of the time, down in the other.
    Parabolic(Option<u32>),
}

/// The longest parabolic move, in ms.
pub const LONGEST_MS: u32 = 60_000;
/// The variables that bound what programs may ask of the motor: speed in counts/ms, acceleration in counts/ms^2.
const OF_PROGRAMS: [usize; 2] = [16, 17];
/// As [`OF_PROGRAMS`], with the speed and the acceleration of the motor's jogs.
const OF_JOGS: [usize; 4] = [16, 17, 19, 22];

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
            let name = name(motor, *number);
            format!("{name} was {}, and is {} now", self.text(*number), now.text(*number))
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
    /// A remark on the time of the move, for the user.
    pub remark: Option<String>,
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
        let x = |number| name(motor, number);
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
        let (time_ms, remark, values) = match what {
            // Fast enough that half of the way is speeding up.
            TuneMove::Step => (2.0, None, [limit_sixteenths, 2.0 * length, 1.0, 0.0, length]),
            TuneMove::Parabolic(asked) => {
                let parabola = Parabola::new(length, asked, motor, settings)?;
                let remark = parabola.remark(asked.is_none(), motor, settings);
                (parabola.time(), remark, parabola.values(limit_sixteenths))
            }
        };
        Ok(Self { time_s: time_ms / 1e3, remark, limit: limit_sixteenths / PER_COUNT, values })
    }

    /// The lines that set the motor's jog variables.
    pub fn lines(&self, motor: u8) -> Vec<String> {
        SET.iter().zip(self.values).map(|(number, value)| line(motor, *number, value)).collect()
    }
}

/// A parabolic move.
struct Parabola {
    length: f64,
    /// A quarter of its time, in whole ms.
    quarter: u32,
}

impl Parabola {
    /// A move by `length` counts that takes `time_ms`, or else the shortest time in which it is no faster and no steeper
    /// than the motor's jogs.
    fn new(length: f64, time_ms: Option<u32>, motor: u8, settings: &Settings) -> Result<Self, String> {
        let said = |number| format!("{}={}", name(motor, number), settings.text(number));
        let Some(time_ms) = time_ms else {
            if [17, 19].iter().all(|number| settings.bound(*number).is_none()) {
                let both = [17, 19].map(said).join(", ");
                return Err(format!("no acceleration is known that the motor keeps ({both}); give --time"));
            }
            return Self::shortest(length, settings, &OF_JOGS).ok_or_else(|| {
                let bounds = OF_JOGS.map(said).join(", ");
                format!("the motor needs more than {LONGEST_MS} ms ({bounds}); choose a smaller --size")
            });
        };
        let parabola = Self { length, quarter: time_ms.div_ceil(4).max(1) };
        let Some(number) = parabola.beyond(settings, &OF_PROGRAMS) else { return Ok(parabola) };
        let unit = if number == 16 { "counts/ms" } else { "counts/ms^2" };
        let shortest = Self::shortest(length, settings, &OF_PROGRAMS)
            .map_or(String::new(), |shortest| format!(" or --time {}, the shortest here", shortest.time()));
        Err(format!(
            "the move needs {:.4} {unit}, more than programs may ask of the motor ({}); choose a smaller --size{shortest}",
            parabola.needs(number),
            said(number)
        ))
    }

    /// The shortest move that keeps `bounds`.
    fn shortest(length: f64, settings: &Settings, bounds: &[usize]) -> Option<Self> {
        let mut all = (1..=LONGEST_MS / 4).map(|quarter| Self { length, quarter });
        all.find(|parabola| parabola.beyond(settings, bounds).is_none())
    }

    /// Tells a time that is `chosen` and the variable that forbids a shorter time; or that the user's time asks more than
    /// the motor's jogs.
    fn remark(&self, chosen: bool, motor: u8, settings: &Settings) -> Option<String> {
        let quarter = self.quarter - u32::from(chosen);
        let bound = Self { quarter, ..*self }.beyond(settings, &OF_JOGS).filter(|_| quarter > 0);
        let said = bound.map(|number| format!("{}={}", name(motor, number), settings.text(number)));
        match said {
            Some(said) if chosen => {
                Some(format!("the move takes {} ms, the shortest time that {said} allows", self.time()))
            }
            None if chosen => Some(format!("the move takes {} ms", self.time())),
            said => said.map(|said| format!("the move asks more of the motor than its jogs do ({said})")),
        }
    }

    /// The first of `bounds` that the move breaks.
    fn beyond(&self, settings: &Settings, bounds: &[usize]) -> Option<usize> {
        let breaks = |number: &usize| settings.bound(*number).is_some_and(|most| self.needs(*number) > most);
        bounds.iter().copied().find(breaks)
    }

    /// The speed or the largest acceleration of the move, whichever variable `number` bounds.
    fn needs(&self, number: usize) -> f64 {
        let speed = 2.0 * self.length / self.time();
        if [16, 22].contains(&number) { speed } else { 4.0 * speed / self.time() }
    }

    /// In ms.
    fn time(&self) -> f64 {
        4.0 * f64::from(self.quarter)
    }

    /// The values of [`SET`].
    fn values(&self, limit_sixteenths: f64) -> [f64; SET.len()] {
        let quarter = f64::from(self.quarter);
        [limit_sixteenths, 2.0 * self.needs(19), 2.0 * quarter, quarter, self.needs(22)]
    }
}

fn name(motor: u8, number: usize) -> String {
    format!("I{}", IVariables::motor(motor.into(), number))
}

fn line(motor: u8, number: usize, value: impl std::fmt::Display) -> String {
    format!("{}={value}", name(motor, number))
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
            lines(TuneMove::Parabolic(Some(500)), 1000.0, None),
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
        let why_not = |time, size| why(TuneMove::Parabolic(Some(time)), size, None, &factory);
        assert!(
            why_not(10, 1000.0)
                .contains("I316=32); choose a smaller --size or --time 128, the shortest here")
        );
        assert!(why_not(100, 1000.0).contains("I317=0.5); choose a smaller --size or --time 128"));
        assert!(plan(TuneMove::Parabolic(Some(128)), 1000.0, None, &factory).is_ok());
        assert!(why_not(60_000, 1e6).ends_with("choose a smaller --size"), "{}", why_not(60_000, 1e6));
        let fenced = settings("$7D00", "150", "-20");
        assert!(
            why(TuneMove::Step, 60.0, None, &fenced)
                .contains("160 counts lie beyond the software limit of 150 (I313)")
        );
        assert!(why(TuneMove::Step, -130.0, None, &fenced).contains("limit of -20 (I314)"));
        assert!(plan(TuneMove::Step, 50.0, None, &fenced).is_ok());
    }

    #[test]
    fn a_parabolic_move_takes_the_shortest_time_that_the_jogs_of_the_motor_allow() {
        let plan = |time, size, values: [&str; 4]| {
            let [speed, steepest, jog_steepest, jog_speed] = values;
            let reply =
                ["32000", "0", "0", speed, steepest, jog_steepest, "0", "50", jog_speed].map(str::to_owned);
            let settings = Settings::of(reply.into()).unwrap();
            Plan::new(TuneMove::Parabolic(time), 3, (100.0, size), None, &settings)
        };
        for (values, ms, bound) in [
            (["32", "0.5", "0.015625", "32"], 716.0, "I319=0.015625"),
            (["32", "0.5", "100", "32"], 128.0, "I317=0.5"),
            (["32", "0", "100", "2"], 1000.0, "I322=2"),
            (["0.5", "0", "100", "0"], 4000.0, "I316=0.5"),
        ] {
            let plan = plan(None, -1000.0, values).unwrap();
            assert_eq!(plan.time_s * 1e3, ms);
            let told = format!("the move takes {ms} ms, the shortest time that {bound} allows");
            assert_eq!(plan.remark, Some(told));
        }
        assert_eq!(
            plan(None, 0.001, ["32", "0.5", "1", "32"]).unwrap().remark.unwrap(),
            "the move takes 4 ms"
        );
        let remark = |time| plan(Some(time), 1000.0, ["32", "0.5", "0.015625", "32"]).unwrap().remark;
        assert_eq!(remark(716), None);
        assert!(remark(712).unwrap().ends_with("than its jogs do (I319=0.015625)"));
        let why = plan(None, 1000.0, ["32", "0", "0", "32"]).unwrap_err();
        assert_eq!(why, "no acceleration is known that the motor keeps (I317=0, I319=0); give --time");
        let why = plan(None, 1e6, ["32", "0.5", "0.001", "32"]).unwrap_err();
        assert!(why.starts_with("the motor needs more than 60000 ms (I316=32, "), "{why}");
    }

    #[test]
    fn a_reply_that_is_no_number_is_none() {
        let reply = |text: &str| Settings::of(vec![text.to_owned(); ASKED.len()]);
        assert!(reply("1").is_some() && reply("$FF").is_some());
        assert!(reply("").is_none() && reply("ERR003").is_none() && Settings::of(Vec::new()).is_none());
    }
}
