//! One simulated motor: its servo loop, its drive and its shaft.
//!
//! The drive is a velocity amplifier: output of full scale gives [`FULL_SPEED`]. The loop is proportional, so the
//! following error is proportional to velocity: [`LAG_MS`] ms of it at Ix30=2000. Positions are in counts of the
//! encoder; each servo cycle writes them to the motor's registers in 1/(Ix08*32) counts. The encoder has an index
//! pulse every [`INDEX_PERIOD`] counts, the trigger of homing searches at factory settings.
//!
//! Jog and home: Software Reference pp. 72-76, 190-194, 241; User Manual pp. 127-135.

pub mod backlash;
pub mod flags;
mod following_error;

use crate::sim::board::motor::backlash::Backlash;
use crate::sim::board::motor::flags::{Capture, PLACES, STOP};
use crate::sim::board::profile::{Profile, Ramp};
use crate::sim::board::variables::Variables;
use crate::sim::board::written::Shown;

/// The most motors that a board of any family has.
pub const MOST_MOTORS: usize = 32;
/// One number for each motor of any family, so that a servo cycle allocates no memory.
pub type Motors = [f64; MOST_MOTORS];
/// Zero for every motor.
pub const STILL: Motors = [0.0; MOST_MOTORS];

/// Counts/ms at the output's full scale of 32767.
pub const FULL_SPEED: f64 = 400.0;
/// Following error divided by velocity, in ms, at Ix30=2000.
pub const LAG_MS: f64 = 3.0;
/// Counts from one index pulse to the next.
pub const INDEX_PERIOD: f64 = 8000.0;

/// The milliseconds of an abort with Ix15=0: a sudden stop.
const SUDDEN_MS: f64 = 1e-3;

/// The state of the servo loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Loop {
    /// Output zero, amplifier disabled.
    Killed,
    /// Amplifier enabled with a fixed output in percent of Ix69.
    Open(f64),
    /// Position loop closed.
    Closed,
}

/// The purpose of a move.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Purpose {
    Jog,
    /// A homing search, until the trigger.
    Search,
    /// A jog until trigger; after it, the motor goes on to the captured position plus this many counts.
    Trigger(f64),
    /// Stopping at Ix15: abort, or on a limit.
    Abort,
}

#[derive(Debug, Clone)]
struct Move {
    profile: Profile,
    purpose: Purpose,
}

/// Events of a motor in one servo cycle that concern other parts of the board.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Events {
    /// A homing search has found its trigger: the position's zero is new.
    pub homed: bool,
    /// It ran into a limit.
    pub limit: bool,
    /// The following error was fatal, so the board killed the motor.
    pub fatal: bool,
}

/// The world around the motor, as the control socket sets it.
#[derive(Debug, Clone, Copy, Default)]
pub struct Inputs {
    /// The shaft positions, from and to, of each of [`PLACES`].
    pub places: [[f64; 2]; PLACES.len()],
    /// A trigger pulse is due.
    pub trigger: bool,
    /// The shaft is held fast.
    pub stalled: bool,
    /// The encoder's index channel is not connected.
    pub no_index: bool,
    /// Counts by which a hand turns the shaft in the next servo cycle.
    pub turned: f64,
}

/// One motor.
#[derive(Debug, Clone)]
pub struct Motor {
    /// The flags of the world.
    pub inputs: Inputs,
    /// The loop.
    pub servo: Loop,
    motion: Option<Move>,
    commanded: f64,
    desired_velocity: f64,
    /// Where the shaft is.
    shaft: f64,
    /// Where the shaft is when the motor's position is zero.
    reference: f64,
    /// Where the shaft was when the encoder counter was zero.
    encoder_zero: f64,
    actual: f64,
    /// Counts in the last servo cycle, by the encoder.
    moved: f64,
    /// Output in DAC bits.
    output: f64,
    pre_jog: f64,
    /// Homed.
    pub home_complete: bool,
    /// `?` word 2 bit 7.
    pub trigger_move: bool,
    /// Stopped on a limit.
    pub on_limit: bool,
    /// Software or hardware limit reached, positive and negative end.
    pub limits: [bool; 2],
    /// Fatal following error since the loop was closed last.
    pub fatal: bool,
    /// Warning following error now.
    pub warning: bool,
    /// Background passes in a row in which the motor was in position.
    pub in_position_scans: u32,
    /// Encoder count captured by the last home.
    pub captured: f64,
    /// A program's move: its end, and the milliseconds left when the move has an end in time.
    program: Option<(f64, Option<f64>)>,
    /// A program's dwell.
    pub dwelling: bool,
    /// A program's run-time error.
    pub data_error: bool,
    /// Counts that leadscrew and backlash compensation add to the actual position.
    pub(super) compensation: f64,
    /// Take-up of backlash.
    pub(super) backlash: Backlash,
    pub(super) shown: Shown,
    pub(super) capture: Capture,
}

impl Motor {
    /// At rest and killed, shaft at zero.
    #[must_use]
    pub fn new() -> Self {
        Self {
            inputs: Inputs::default(),
            servo: Loop::Killed,
            motion: None,
            commanded: 0.0,
            desired_velocity: 0.0,
            shaft: 0.0,
            reference: 0.0,
            encoder_zero: 0.0,
            actual: 0.0,
            moved: 0.0,
            output: 0.0,
            pre_jog: 0.0,
            home_complete: false,
            trigger_move: false,
            on_limit: false,
            limits: [false; 2],
            fatal: false,
            warning: false,
            in_position_scans: 0,
            captured: 0.0,
            program: None,
            dwelling: false,
            data_error: false,
            compensation: 0.0,
            backlash: Backlash::default(),
            shown: Shown::default(),
            capture: Capture::default(),
        }
    }

    /// A board reset: killed, counters at zero; the shaft stays where it is.
    pub fn reset(&mut self) {
        let (shaft, inputs) = (self.shaft, self.inputs);
        *self = Self { shaft, inputs, reference: shaft, encoder_zero: shaft, ..Self::new() };
    }

    /// Commanded position in counts.
    #[must_use]
    pub fn commanded(&self) -> f64 {
        self.commanded
    }

    /// Actual position in counts, to 1/32 count.
    #[must_use]
    pub fn actual(&self) -> f64 {
        self.actual
    }

    /// Actual position with compensation, in counts: the servo loop closes on this position.
    #[must_use]
    pub fn corrected(&self) -> f64 {
        self.actual + self.compensation
    }

    /// Counts moved in the last servo cycle.
    #[must_use]
    pub fn moved(&self) -> f64 {
        self.moved
    }

    /// Output in DAC bits.
    #[must_use]
    pub fn output(&self) -> f64 {
        self.output
    }

    /// The position that `J=` goes to.
    #[must_use]
    pub fn pre_jog(&self) -> f64 {
        self.pre_jog
    }

    /// Makes `position` the target of `J=`.
    pub fn set_pre_jog(&mut self, position: f64) {
        self.pre_jog = position;
    }

    /// Desired velocity in counts/ms.
    #[must_use]
    pub fn desired_velocity(&self) -> f64 {
        self.desired_velocity
    }

    /// Where the present move ends, or the commanded position.
    #[must_use]
    pub fn target(&self) -> f64 {
        let program = self.program.map_or(self.commanded, |(target, _)| target);
        self.motion.as_ref().map_or(program, |motion| motion.profile.end().unwrap_or(self.commanded))
    }

    /// Milliseconds left in a definite move, `None` otherwise.
    #[must_use]
    pub fn time_left(&self) -> Option<f64> {
        let program = self.program.and_then(|(_, time)| time);
        self.motion.as_ref().map_or(program, |motion| motion.profile.time_left())
    }

    /// Whether a move is under way.
    #[must_use]
    pub fn moving(&self) -> bool {
        self.motion.is_some() || self.program.is_some()
    }

    /// Whether a homing search or a jog until trigger waits for its trigger.
    #[must_use]
    pub fn searching(&self) -> bool {
        self.motion
            .as_ref()
            .is_some_and(|motion| matches!(motion.purpose, Purpose::Search | Purpose::Trigger(_)))
    }

    /// Whether the motor is decelerating for an abort or a limit.
    #[must_use]
    pub fn aborting(&self) -> bool {
        self.motion.as_ref().is_some_and(|motion| motion.purpose == Purpose::Abort)
    }

    /// Closes an open loop at the motor's present position. Clears the faults.
    pub fn close_loop(&mut self) {
        if self.servo != Loop::Closed {
            self.servo = Loop::Closed;
            self.commanded = self.corrected();
            self.desired_velocity = 0.0;
            self.motion = None;
        }
        self.fatal = false;
        self.on_limit = false;
    }

    /// Opens the loop.
    pub fn open(&mut self, servo: Loop) {
        self.servo = servo;
        self.motion = None;
        self.program = None;
        self.desired_velocity = 0.0;
    }

    /// A program wants the motor at `position`, going at `velocity` counts/ms, on the way to `target` for `time_left`
    /// ms.
    pub fn follow(&mut self, position: f64, velocity: f64, target: f64, time_left: Option<f64>) {
        if self.motion.is_none() && self.servo == Loop::Closed {
            self.commanded = position;
            self.desired_velocity = velocity;
            self.program = Some((target, time_left));
        }
    }

    /// No program moves the motor now.
    pub fn rest(&mut self) {
        if self.program.take().is_some() {
            self.desired_velocity = 0.0;
        }
    }

    /// Goes on at `speed` counts/ms until stopped; zero stops.
    pub fn jog_at(&mut self, speed: f64, ramp: &Ramp) {
        self.close_loop();
        if speed == 0.0 && self.motion.is_none() {
            return;
        }
        self.plan(Profile::to_velocity(self.commanded, self.desired_velocity, speed, ramp), Purpose::Jog);
    }

    /// Goes to `target`; with `after`, looks for the trigger on the way and ends that many counts from the trigger.
    pub fn jog_to(&mut self, target: f64, speed: f64, ramp: &Ramp, after: Option<f64>) {
        self.close_loop();
        let profile = Profile::to_target(self.commanded, self.desired_velocity, target, speed, ramp);
        self.trigger_move = after.is_some();
        self.plan(profile, after.map_or(Purpose::Jog, Purpose::Trigger));
    }

    /// Starts a homing search at `speed` counts/ms with its sign.
    pub fn home(&mut self, speed: f64, ramp: &Ramp) {
        self.close_loop();
        self.home_complete = false;
        self.trigger_move = true;
        let profile = Profile::to_velocity(self.commanded, self.desired_velocity, speed, ramp);
        self.plan(profile, Purpose::Search);
    }

    /// Stops at `rate` counts/ms^2; closes an open loop.
    pub fn abort(&mut self, rate: f64) {
        let program = self.program.take().is_some();
        self.dwelling = false;
        if self.servo != Loop::Closed || self.motion.is_none() && !program {
            self.close_loop();
            return;
        }
        let ramp = Ramp { time: SUDDEN_MS, s_time: 0.0, limit: rate };
        let profile = Profile::to_velocity(self.commanded, self.desired_velocity, 0.0, &ramp);
        self.plan(profile, Purpose::Abort);
    }

    /// Makes the present commanded position plus `offset` counts the home position, without motion.
    pub fn home_here(&mut self, offset: f64) {
        self.captured = self.shaft - self.encoder_zero;
        self.re_reference(self.commanded + offset);
        self.home_complete = true;
    }

    /// Sets the position that an absolute sensor reads, or zero without a sensor; leaves the motor killed.
    pub fn absolute(&mut self, sensed: Option<f64>) {
        self.open(Loop::Killed);
        let position = sensed.unwrap_or(0.0);
        self.reference = self.shaft - position;
        self.actual = position;
        self.commanded = position;
        self.home_complete = sensed.is_some();
    }

    /// The shaft's own position.
    #[must_use]
    pub const fn shaft(&self) -> f64 {
        self.shaft
    }

    /// Rounds the commanded position of a motor at rest to a whole count.
    pub fn round_commanded(&mut self) {
        if self.motion.is_none() && self.servo == Loop::Closed {
            self.commanded = self.commanded.round();
        }
    }

    fn plan(&mut self, profile: Profile, purpose: Purpose) {
        self.program = None;
        self.motion = Some(Move { profile, purpose });
    }

    /// Moves the zero of the position by `shift` counts.
    pub fn re_reference(&mut self, shift: f64) {
        self.reference += shift;
        self.commanded -= shift;
        self.actual -= shift;
        self.backlash.shift(-shift);
        if let Some(motion) = &mut self.motion {
            motion.profile.shift(-shift);
        }
    }

    /// Calls the shaft's present position `actual` counts. A closed loop then turns the shaft to the commanded
    /// position, which does not change.
    pub fn set_actual(&mut self, actual: f64) {
        let shift = actual - self.actual;
        self.reference -= shift;
        self.actual = actual;
        if self.servo != Loop::Closed {
            self.commanded = self.corrected();
            self.backlash.shift(shift);
        }
    }

    /// A closed loop goes to `commanded` counts, and a move goes on from there. An open loop has its own: the actual position.
    pub fn set_commanded(&mut self, commanded: f64) {
        if self.servo == Loop::Closed {
            let shift = commanded - self.commanded;
            self.commanded = commanded;
            self.backlash.shift(shift);
            if let Some(motion) = &mut self.motion {
                motion.profile.shift(shift);
            }
        }
    }

    /// One servo cycle of `ms` milliseconds, with the trajectory going at `time_base`. `x` is 100 times the motor's
    /// number, `noise` counts of encoder noise.
    pub fn cycle(&mut self, x: usize, variables: &Variables, ms: f64, time_base: f64, noise: f64) -> Events {
        if let Some(motion) = &mut self.motion {
            let sample = motion.profile.advance(ms * time_base);
            self.commanded = sample.position;
            self.desired_velocity = sample.velocity;
            if sample.done {
                self.motion = None;
            }
        }
        let before = self.shaft;
        self.drive(x, variables, ms);
        let actual = ((self.shaft - self.reference + noise) * 32.0).round() / 32.0;
        self.moved = actual - self.actual;
        self.actual = actual;
        if self.servo != Loop::Closed {
            self.commanded = self.corrected();
        }
        Events {
            homed: self.poll_trigger(x, variables, before),
            limit: self.watch_limits(x, variables),
            fatal: self.watch_following_error(x, variables),
        }
    }

    fn drive(&mut self, x: usize, variables: &Variables, ms: f64) {
        const COUNTS_PER_BIT: f64 = FULL_SPEED / 32767.0;
        let most = variables.i(x + 69);
        self.output = match self.servo {
            Loop::Killed => 0.0,
            Loop::Open(percent) => percent / 100.0 * most,
            Loop::Closed => {
                let error = self.commanded - self.compensation - (self.shaft - self.reference);
                // The part of the error made good in this cycle; exact for any period, so never unstable.
                let part = 1.0 - (-ms * variables.i(x + 30) / 2000.0 / LAG_MS).exp();
                (error * part / ms / COUNTS_PER_BIT).clamp(-most, most)
            }
        };
        self.shaft += std::mem::take(&mut self.inputs.turned);
        let next = self.shaft + self.output * COUNTS_PER_BIT * ms;
        if !self.inputs.stalled && !self.inputs.is_on(STOP, next) {
            self.shaft = next;
        }
    }
}

impl Default for Motor {
    fn default() -> Self {
        Self::new()
    }
}

/// The jog ramp of the motor whose variables start at `x`.
#[must_use]
pub fn ramp(x: usize, variables: &Variables) -> Ramp {
    Ramp::new(variables.i(x + 19), variables.i(x + 20), variables.i(x + 21))
}
