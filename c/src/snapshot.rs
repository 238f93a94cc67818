//! Data of one moment: a snapshot or an update, with motors and coordinate systems by their numbers.

use driver::client::{Gap, Snapshot as Found, Staleness, UserData, View};
use driver::decode::{
    BackgroundData, BackgroundMotor, CoordinateSystem, Flags, Quantity, ServoData, ServoMotor, Value,
};
use driver::map::FAMILIES;
use driver::map::status::StatusTable;

use crate::failure::{Failure, Status};
use crate::types::{
    KNOWN_LINES_REMAINING, KNOWN_RAW_POSITION, KNOWN_STATUS_1, KNOWN_STATUS_2, KNOWN_STATUS_3, Moment, Motor,
    Stale, System,
};

/// The board's data at one moment. Nothing changes in it: threads may share it.
pub struct Snapshot {
    servo: View<ServoData>,
    background: Option<View<BackgroundData>>,
    user: Option<View<UserData>>,
    /// The missing updates between the one before and this one.
    gap: Option<Gap>,
}

impl Snapshot {
    /// The data in `found`. Without `stale_ok`, servo data that are not live are an error, and others are left out.
    pub fn of(found: Found, stale_ok: bool) -> Result<Self, Failure> {
        let Found { servo, background, user, stale, .. } = found;
        let servo = servo.ok_or(stale.unwrap_or(Staleness::Off))?;
        if let Some(why) = servo.stale.filter(|_| !stale_ok) {
            return Err(why.into());
        }
        let background = background.filter(|view| stale_ok || view.stale.is_none());
        let user = user.filter(|view| stale_ok || view.stale.is_none());
        Ok(Self { servo, background, user, gap: None })
    }

    /// One servo update, behind `gap`.
    pub const fn of_update(servo: View<ServoData>, gap: Option<Gap>) -> Self {
        Self { servo, background: None, user: None, gap }
    }

    /// When it was, and of what.
    pub fn moment(&self) -> Moment {
        let Self { servo, background, gap, .. } = self;
        let gap = gap.unwrap_or_default();
        let pause = gap.pause.map_or(0, |pause| pause.as_nanos());
        let motors = || servo.data.motors.iter();
        let systems = background.iter().flat_map(|view| &view.data.coordinate_systems);
        Moment {
            sequence: servo.sequence,
            time_ns: servo.time_ns,
            realtime_ns: servo.realtime_ns,
            age_ns: servo.age_ns,
            servo_timer: servo.servo_timer,
            missed: gap.missed,
            lost: gap.lost,
            pause_ns: u64::try_from(pause).unwrap_or(u64::MAX),
            activated_motors: mask(motors().filter(|motor| motor.is_activated()).map(|motor| motor.motor)),
            motors: mask(motors().map(|motor| motor.motor)),
            systems: mask(systems.map(|system| system.coordinate_system)),
            stale: stale(servo.stale) as u32,
            background_stale: stale(background.as_ref().and_then(|view| view.stale)) as u32,
            reserved: 0,
        }
    }

    fn servo_motor(&self, number: u32) -> Result<&ServoMotor, Failure> {
        let found = self.servo.data.motors.iter().find(|motor| motor.motor == number as usize);
        found.ok_or_else(|| Failure::argument(format!("motor {number} is not reported")))
    }

    fn background_motor(&self, number: u32) -> Option<&BackgroundMotor> {
        let motors = &self.background.as_ref()?.data.motors;
        motors.iter().find(|motor| motor.motor == number as usize)
    }

    /// The two words of `?`, with the meaning of their bits. A Turbo board has both in the servo report.
    fn motor_words(&self, motor: &ServoMotor) -> [Option<Flags>; 2] {
        let of_turbo = || {
            let word = u32::try_from(motor.background_status?.raw).ok()?;
            let family = FAMILIES
                .iter()
                .find(|family| Some(&family.status.motor[0]) == motor.status.map(|flags| flags.table))?;
            Some(Flags { word, table: family.status.motor.get(1)? })
        };
        let number = u32::try_from(motor.motor).unwrap_or(0);
        [motor.status, self.background_motor(number).and_then(|motor| motor.status).or_else(of_turbo)]
    }

    /// Motor `number`.
    pub fn motor(&self, number: u32) -> Result<Motor, Failure> {
        let motor = self.servo_motor(number)?;
        let background = self.background_motor(number);
        let words = self.motor_words(motor);
        let raw = motor.actual_position.map(|position| position.raw);
        Ok(Motor {
            number,
            known: known(&words) | if raw.is_some() { KNOWN_RAW_POSITION } else { 0 },
            status: words.map(|word| word.map_or(0, |flags| flags.word)),
            coordinate_system: background.and_then(|motor| motor.coordinate_system).unwrap_or_default(),
            activated: motor.is_activated().into(),
            position: value(motor.actual_position),
            commanded_position: value(motor.commanded_position),
            following_error: value(motor.following_error),
            velocity: value(motor.velocity),
            master_position: value(motor.master_position),
            target_position: value(background.and_then(|motor| motor.target_position)),
            raw_position: raw.unwrap_or_default(),
        })
    }

    fn coordinate_system(&self, number: u32) -> Result<&CoordinateSystem, Failure> {
        let systems = self.background.iter().flat_map(|view| &view.data.coordinate_systems);
        let found = systems.into_iter().find(|system| system.coordinate_system == number as usize);
        found.ok_or_else(|| {
            let why = "; only a snapshot has them, while the background report (I49) is live";
            Failure::argument(format!("coordinate system {number} is not reported{why}"))
        })
    }

    /// Coordinate system `number`.
    pub fn system(&self, number: u32) -> Result<System, Failure> {
        let system = self.coordinate_system(number)?;
        let words = system.status_words();
        let lines = system.lines_remaining;
        Ok(System {
            number,
            known: known(&words) | if lines.is_some() { KNOWN_LINES_REMAINING } else { 0 },
            status: words.map(|word| word.map_or(0, |flags| flags.word)),
            lines_remaining: lines.unwrap_or_default(),
            axis_targets: system.axis_targets.0.map(|target| target.unwrap_or(f64::NAN)),
        })
    }

    /// Whether the flag `name` of motor `number` is set; `None`: the board does not report its word.
    pub fn motor_flag(&self, number: u32, name: &str) -> Result<Option<bool>, Failure> {
        flag(&self.motor_words(self.servo_motor(number)?), name)
    }

    /// Whether the flag `name` of coordinate system `number` is set; `None`: the board does not report its word.
    pub fn system_flag(&self, number: u32, name: &str) -> Result<Option<bool>, Failure> {
        flag(&self.coordinate_system(number)?.status_words(), name)
    }

    /// The values of the site's own word `name`.
    pub fn word(&self, name: &str) -> Result<Vec<f64>, Failure> {
        let found = self.user.as_ref().and_then(|view| view.data.get(name));
        let found = found.ok_or_else(|| {
            let why = "pmac_board_word lists the names; an update and stale data have none";
            Failure::argument(format!("there is no word {name:?}; {why}"))
        })?;
        let not_whole = || {
            let text = format!("the board was writing {name} each time the daemon read it");
            Failure::new(Status::Stale, text)
        };
        let values = found.values.as_ref().ok_or_else(not_whole)?;
        Ok(values.iter().copied().map(Value::number).collect())
    }
}

fn mask(numbers: impl Iterator<Item = usize>) -> u32 {
    numbers.collect::<driver::map::masks::Motors>().bits()
}

fn value(quantity: Option<Quantity>) -> f64 {
    quantity.and_then(|quantity| quantity.value).unwrap_or(f64::NAN)
}

fn known(words: &[Option<Flags>]) -> u32 {
    let bits = words.iter().zip([KNOWN_STATUS_1, KNOWN_STATUS_2, KNOWN_STATUS_3]);
    bits.filter(|(word, _)| word.is_some()).fold(0, |all, (_, bit)| all | bit)
}

const fn stale(why: Option<Staleness>) -> Stale {
    match why {
        None => Stale::Live,
        Some(Staleness::DaemonGone) => Stale::DaemonGone,
        Some(Staleness::DaemonStopped { .. }) => Stale::DaemonStopped,
        Some(Staleness::OtherClock { .. }) => Stale::OtherClock,
        Some(Staleness::Starting) => Stale::Starting,
        Some(Staleness::BoardSilent) => Stale::BoardSilent,
        Some(Staleness::Off) => Stale::Off,
        Some(Staleness::NoUpdates { .. }) => Stale::NoUpdates,
        Some(Staleness::NotWhole) => Stale::NotWhole,
    }
}

fn has(table: &StatusTable, name: &str) -> bool {
    table.flags.iter().any(|(_, flag)| *flag == name)
}

/// Whether the flag `name` is set in one of `words`.
fn flag(words: &[Option<Flags>], name: &str) -> Result<Option<bool>, Failure> {
    if let Some(word) = words.iter().flatten().find(|word| has(word.table, name)) {
        return Ok(Some(word.has(name)));
    }
    let mut tables =
        FAMILIES.iter().flat_map(|family| family.status.motor.iter().chain(family.status.coordinate_system));
    if words.iter().any(Option::is_none) && tables.any(|table| has(table, name)) {
        return Ok(None);
    }
    Err(Failure::argument(format!("there is no flag {name:?}; pmacctl explain tells the names")))
}
