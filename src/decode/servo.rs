//! The servo report: the motors' positions, velocities and status words (DPRAM manual p. 14-17, Turbo User Manual p.
//! 402).
//!
//! The family's register table says which fields a motor's block has, and where; a field of [`ServoMotor`] that the
//! family lacks is `None`.
//!
//! PMAC and PMAC2 report no following error. The loop closes on actual position and compensation, as `P` adds them
//! (Software Reference, `P`), so the following error is the commanded position minus that sum. While a motor follows a
//! master this module computes none: no manual says whether the commanded position holds the master's share.

use serde::ser::{Serialize, SerializeMap, Serializer};

use super::quantity::{Flags, MotorScales, Quantity, Scales};
use super::{Block, TooShort, blocks, global_flags};
use crate::format::join32;
use crate::map::{Family, Selection, StatusTable, block_fields};

/// The content of the servo report.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct ServoData {
    /// The low bits of the servo counter at PMAC's update, 15 or 24 of them.
    pub servo_timer: u32,
    /// Whether PMAC was updating the buffer; the motors' values are then not of one instant.
    pub pmac_busy: bool,
    /// Whether the host held PMAC off.
    pub host_busy: bool,
    /// The board's status words in the order of `???`; `None` if the report has none, or no manual says which is
    /// which.
    pub global_status: Option<[u32; 2]>,
    /// The motors that the daemon read and whose blocks the board fills ([`ServoDecoder::decode`]), ascending.
    pub motors: Vec<ServoMotor>,
    #[serde(skip)]
    global: &'static [StatusTable],
}

/// One motor in the servo report; a field is `None` if the daemon did not read it or the family does not report it.
/// Serialises as an object with the fields that the family reports.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ServoMotor {
    /// The motor's number, from 1.
    pub motor: usize,
    /// Commanded position.
    pub commanded_position: Option<Quantity>,
    /// Actual position. `P` reports it with bias and compensation added.
    pub actual_position: Option<Quantity>,
    /// Position of the master that the motor follows.
    pub master_position: Option<Quantity>,
    /// Leadscrew and backlash compensation.
    pub compensation_position: Option<Quantity>,
    /// The previous servo cycle's output.
    pub previous_dac: Option<Quantity>,
    /// The servo status word, the first word of `?`.
    pub servo_status: Option<Quantity>,
    /// Actual velocity of the last servo cycle, not averaged.
    pub actual_velocity: Option<Quantity>,
    /// The same in counts a second.
    pub velocity: Option<Quantity>,
    /// Time left in the move segment at 100 % feed rate override.
    pub time_left: Option<Quantity>,
    /// A PMAC address of doubtful meaning; see the register table.
    pub handwheel_pointer: Option<Quantity>,
    /// Following error: Turbo reports it; for other boards this module computes it while the motor follows no master.
    pub following_error: Option<Quantity>,
    /// Turbo: offset from `PSET` and axis definitions.
    pub position_bias: Option<Quantity>,
    /// Turbo: actual velocity, averaged over 16*(I60+1) servo cycles.
    pub filtered_velocity: Option<Quantity>,
    /// Turbo: the background status word, the second word of `?`.
    pub background_status: Option<Quantity>,
    /// The flags of the servo status word.
    pub status: Option<Flags>,
    /// Those of [`FIELDS`] that the family has, bit 0 for the first.
    fields: u16,
}

impl Serialize for ServoMotor {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut motor = serializer.serialize_map(None)?;
        motor.serialize_entry("motor", &self.motor)?;
        let mut copy = *self;
        for (index, field) in FIELDS.iter().enumerate() {
            if self.fields >> index & 1 != 0 {
                motor.serialize_entry(field.name, (field.value)(&mut copy))?;
            }
        }
        motor.serialize_entry("status", &self.status)?;
        motor.end()
    }
}

/// A field that a motor's block may have: its name in the register table, how to read it, where its value goes.
struct Field {
    name: &'static str,
    read: fn(&Block, usize, MotorScales) -> Option<Quantity>,
    value: fn(&mut ServoMotor) -> &mut Option<Quantity>,
}

const FIELDS: [Field; 14] = [
    Field { name: "commanded_position", read: position, value: |motor| &mut motor.commanded_position },
    Field { name: "actual_position", read: position, value: |motor| &mut motor.actual_position },
    Field { name: FOLLOWING_ERROR, read: position, value: |motor| &mut motor.following_error },
    Field { name: "master_position", read: master, value: |motor| &mut motor.master_position },
    Field { name: "compensation_position", read: position, value: |motor| &mut motor.compensation_position },
    Field { name: "position_bias", read: position, value: |motor| &mut motor.position_bias },
    Field { name: "previous_dac", read: dac, value: |motor| &mut motor.previous_dac },
    Field { name: "servo_status", read: bits, value: |motor| &mut motor.servo_status },
    Field { name: ACTUAL_VELOCITY, read: velocity, value: |motor| &mut motor.actual_velocity },
    Field { name: VELOCITY, read: |_, _, _| None, value: |motor| &mut motor.velocity },
    Field { name: "filtered_velocity", read: averaged, value: |motor| &mut motor.filtered_velocity },
    Field { name: "background_status", read: bits, value: |motor| &mut motor.background_status },
    Field { name: "time_left", read: time, value: |motor| &mut motor.time_left },
    Field { name: "handwheel_pointer", read: address, value: |motor| &mut motor.handwheel_pointer },
];
/// Turbo boards report it; for others this module computes it.
const FOLLOWING_ERROR: &str = "following_error";
const ACTUAL_VELOCITY: &str = "actual_velocity";
/// Computed from [`ACTUAL_VELOCITY`].
const VELOCITY: &str = "velocity";

fn position(block: &Block, at: usize, scales: MotorScales) -> Option<Quantity> {
    block.fixed(at).map(|raw| Quantity::position(raw, scales))
}

fn master(block: &Block, at: usize, scales: MotorScales) -> Option<Quantity> {
    block.fixed(at).map(|raw| Quantity::master(raw, scales))
}

fn velocity(block: &Block, at: usize, scales: MotorScales) -> Option<Quantity> {
    block.signed(at).map(|raw| Quantity::velocity(raw, scales))
}

fn averaged(block: &Block, at: usize, _: MotorScales) -> Option<Quantity> {
    block.signed(at).map(Quantity::averaged_velocity)
}

fn dac(block: &Block, at: usize, _: MotorScales) -> Option<Quantity> {
    block.signed(at).map(Quantity::dac)
}

fn time(block: &Block, at: usize, _: MotorScales) -> Option<Quantity> {
    block.signed(at).map(Quantity::time)
}

fn bits(block: &Block, at: usize, _: MotorScales) -> Option<Quantity> {
    block.unsigned(at).map(Quantity::bits)
}

fn address(block: &Block, at: usize, _: MotorScales) -> Option<Quantity> {
    block.unsigned(at).map(Quantity::address)
}

/// Whether the report of some family has a field called `name`.
#[must_use]
pub fn is_field(name: &str) -> bool {
    FIELDS.iter().any(|field| field.name == name)
}

/// How many fields a motor's block may have.
pub const MOTOR_FIELDS: usize = FIELDS.len();

impl ServoMotor {
    /// The place in [`ServoMotor::quantities`] of the field called `name` in the register table; `None` if the family
    /// lacks it.
    #[must_use]
    pub fn place(&self, name: &str) -> Option<usize> {
        let place = FIELDS.iter().position(|field| field.name == name)?;
        (self.fields >> place & 1 != 0).then_some(place)
    }

    /// The names of the fields that the family has.
    pub fn names(&self) -> impl Iterator<Item = &'static str> + use<> {
        let fields = self.fields;
        (0..).zip(&FIELDS).filter(move |(place, _)| fields >> *place & 1 != 0).map(|(_, field)| field.name)
    }

    /// Whether the motor is activated (Ix00=1); `true` also if the daemon does not read its status.
    #[must_use]
    pub fn is_activated(&self) -> bool {
        self.status.is_none_or(|status| status.has("motor_activated"))
    }

    /// The values of all fields.
    #[must_use]
    pub fn quantities(&self) -> [Option<Quantity>; MOTOR_FIELDS] {
        let mut copy = *self;
        FIELDS.each_ref().map(|field| *(field.value)(&mut copy))
    }
}

impl ServoData {
    /// The flags of the board's status words, in the order of `???`; `None` where the report has none.
    #[must_use]
    pub fn global_flags(&self) -> Option<[Flags; 2]> {
        global_flags(self.global_status?, self.global)
    }
}

/// Decodes the servo reports of one family.
#[derive(Debug, Clone)]
pub struct ServoDecoder {
    family: &'static Family,
    /// Those of [`FIELDS`] that the family has, each with its first word in the block.
    fields: Vec<(&'static Field, usize)>,
    /// Those of [`FIELDS`] that a motor of the family has, computed or reported, bit 0 for the first.
    has: u16,
}

impl std::fmt::Debug for Field {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name)
    }
}

impl ServoDecoder {
    /// The decoder for boards of `family`.
    #[must_use]
    pub fn new(family: &'static Family) -> Self {
        let known = |name: &str| FIELDS.iter().find(|field| field.name == name);
        let fields = block_fields(family, "servo").filter_map(|at| Some((known(at.name)?, at.words.start)));
        let fields: Vec<_> = fields.collect();
        let reports = |name: &str| fields.iter().any(|(field, _)| field.name == name);
        let has = |field: &Field| match field.name {
            FOLLOWING_ERROR => true,
            VELOCITY => reports(ACTUAL_VELOCITY),
            name => reports(name),
        };
        let has = (0..).zip(&FIELDS).fold(0, |all, (index, field)| all | u16::from(has(field)) << index);
        Self { family, fields, has }
    }

    /// Decodes the report of `motors` motors, but no more than the family has, from its words, which begin at the
    /// region's start. `selection` says which parts of the blocks the daemon read; the report's mask, if it has one,
    /// which motors.
    ///
    /// # Errors
    /// [`TooShort`] when the words of a motor asked for are missing.
    pub fn decode(
        &self,
        words: &[u16],
        motors: usize,
        scales: &Scales,
        selection: Selection,
    ) -> Result<ServoData, TooShort> {
        let report = &self.family.servo;
        let selection = match report.mask.and_then(|mask| words.get(report.index(mask)..)?.first_chunk()) {
            Some(&[low, high]) => selection.among(join32(low, high)),
            None => selection,
        };
        let (head, motors) = blocks(report.region, &report.motors, words, motors, selection)?;
        let flag = |flag: crate::map::Flag| flag.is_set(head[report.index(flag.word)]);
        Ok(ServoData {
            servo_timer: report.timer.read(head, report.region.start),
            pmac_busy: report.busy.is_busy(flag(report.pmac_status)),
            host_busy: flag(report.host_busy),
            global_status: (report.global_status.as_ref())
                .and_then(|status| status.words(head, report.region.start)),
            motors: motors.map(|(number, block)| self.motor(number, &block, scales)).collect(),
            global: self.family.status.global,
        })
    }

    fn motor(&self, number: usize, block: &Block, board: &Scales) -> ServoMotor {
        let scales = board.motor(number);
        let mut motor = ServoMotor { motor: number, fields: self.has, ..ServoMotor::default() };
        for (field, word) in &self.fields {
            *(field.value)(&mut motor) = (field.read)(block, *word, scales);
        }
        let table = self.family.status.motor.first();
        motor.status = motor
            .servo_status
            .zip(table)
            .and_then(|(status, table)| Some(Flags { word: u32::try_from(status.raw).ok()?, table }));
        motor.velocity = motor
            .actual_velocity
            .and_then(|velocity| i32::try_from(velocity.raw).ok())
            .map(|raw| Quantity::velocity_per_second(raw, scales, board.servo_period_ns()));
        if motor.following_error.is_none() {
            motor.following_error = motor.worked_out_error(scales);
        }
        motor
    }
}

impl ServoMotor {
    /// The commanded position minus actual position and compensation, unless the motor follows a master.
    fn worked_out_error(&self, scales: MotorScales) -> Option<Quantity> {
        let follows = self.status?.has("handwheel_enabled");
        let positions = [self.commanded_position, self.actual_position, self.compensation_position];
        let [commanded, actual, compensation] = positions.map(|position| Some(position?.raw));
        let raw = commanded?.wrapping_sub(actual?).wrapping_sub(compensation?);
        (!follows).then(|| Quantity::position(raw, scales))
    }
}

/// Decodes a whole servo report of `motors` motors of a board of `family`. See [`ServoDecoder::decode`].
///
/// # Errors
/// [`TooShort`] when the words of a motor asked for are missing.
pub fn servo(
    family: &'static Family,
    words: &[u16],
    motors: usize,
    scales: &Scales,
) -> Result<ServoData, TooShort> {
    ServoDecoder::new(family).decode(words, motors, scales, Selection::ALL)
}
