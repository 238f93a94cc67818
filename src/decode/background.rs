//! The background report: motors and coordinate systems as PMAC copies them between its PLC scans (DPRAM manual p.
//! 17-21, Turbo User Manual p. 405). The family's register table says which fields a block has, and where.
//!
//! On PMAC and PMAC2 an axis target is a copy of one of three registers (Note 1 on p. 21). The program status word
//! tells which one, so the word and the targets must come from one update. [`TargetSource`] names the register.

use serde::ser::{Serialize, SerializeMap, Serializer};

use super::quantity::{Flags, Quantity, Scales};
use super::turbo_system::{TurboFields, TurboSystem};
use super::{Block, TooShort, blocks, flags, global_flags, long};
use crate::format::{Float48Layout, int24};
use crate::map::status::{self, StatusTable};
use crate::map::{AXES, Family, MotionMode, NumberKind, Selection, TargetSource, block_fields};

/// The content of the background buffer.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct BackgroundData {
    /// Whether PMAC had marked the data as complete; without it the values are not of one instant.
    pub ready: bool,
    /// The low bits of the servo counter when the data became ready, 16 or 24 of them.
    pub servo_timer: u32,
    /// The board's ports.
    pub ports: Ports,
    /// The board's status words in the order of `???`; `None` where the report has none.
    pub global_status: Option<[u32; 2]>,
    /// The motors that the daemon read, ascending.
    pub motors: Vec<BackgroundMotor>,
    /// The coordinate systems that the daemon read, ascending.
    pub coordinate_systems: Vec<CoordinateSystem>,
    #[serde(skip)]
    global: &'static [StatusTable],
}

impl BackgroundData {
    /// The flags of the board's status words, in the order of `???`; `None` where the report has none.
    #[must_use]
    pub fn global_flags(&self) -> Option<[Flags; 2]> {
        global_flags(self.global_status?, self.global)
    }
}

/// The board's input and output ports, 24 bits each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct Ports {
    /// JPAN.
    pub control_panel: u32,
    /// JTHW.
    pub thumbwheel: u32,
    /// JOPTO.
    pub machine_io: u32,
}

/// One motor in the background buffer; a field is `None` if the daemon did not read it.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct BackgroundMotor {
    /// The motor's number, from 1.
    pub motor: usize,
    /// Where the present move ends.
    pub target_position: Option<Quantity>,
    /// Offset from `PSET` and axis definitions.
    pub position_bias: Option<Quantity>,
    /// Actual velocity, averaged.
    pub average_velocity: Option<Quantity>,
    /// The motor status word, the second word of `?`.
    pub motor_status: Option<Quantity>,
    /// The motor's coordinate system, from 1.
    pub coordinate_system: Option<u32>,
    /// The flags of the motor status word.
    pub status: Option<Flags>,
}

/// One coordinate system in the background buffer; a field is `None` if the daemon did not read it. Serialises as an
/// object with the fields that the family reports.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct CoordinateSystem {
    /// The coordinate system's number, from 1.
    pub coordinate_system: usize,
    /// The fields that only PMAC and PMAC2 report.
    #[serde(flatten)]
    pub pmac: Option<PmacSystem>,
    /// The fields that only Turbo boards report.
    #[serde(flatten)]
    pub turbo: Option<TurboSystem>,
    /// The status word, the first word of `??`.
    pub status_word: Option<u32>,
    /// The flags of the status word.
    pub status: Option<Flags>,
    /// The axis targets in user units.
    pub axis_targets: AxisTargets,
    /// The program status word (PSTATUS), the second word of `??`.
    pub program_status_word: Option<u32>,
    /// The flags of the program status word.
    pub program_status: Option<Flags>,
    /// The motion mode; `None` also for bits that no manual explains.
    pub motion_mode: Option<MotionMode>,
    /// Program lines that the board has still to execute, as `PR`.
    pub lines_remaining: Option<i32>,
    /// Time left in the move. Sources contradict each other on whether it holds with I13 at 0 or above 0.
    pub time_left_in_move: Option<Quantity>,
    /// Time left in acceleration or deceleration; the same doubt.
    pub time_left_in_acceleration: Option<Quantity>,
    /// Where in the program buffer the board executes, as `PE`.
    pub program_address_offset: Option<u32>,
}

impl CoordinateSystem {
    /// The words of `??`, with the meaning of their bits; `None` for a word that the daemon did not read.
    #[must_use]
    pub fn status_words(&self) -> [Option<Flags>; 3] {
        [self.status, self.program_status, self.turbo.and_then(|turbo| turbo.lookahead_status)]
    }
}

/// The fields of a coordinate system that only PMAC and PMAC2 report.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct PmacSystem {
    /// The motor definition word; no manual explains its bits.
    pub motor_definition: Option<u32>,
    /// The register that PMAC copied the axis targets from.
    pub source: Option<TargetSource>,
}

/// The targets of the nine axes, in the order of [`AXES`]; `None` if the daemon did not read the target. Serialises as
/// an object with the axes' letters as keys.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisTargets(pub [Option<f64>; AXES.len()]);

impl AxisTargets {
    /// The target of the axis called `letter` (capital), or `None` if PMAC has no such axis or the daemon did not read
    /// it.
    #[must_use]
    pub fn axis(&self, letter: &str) -> Option<f64> {
        AXES.iter().position(|axis| *axis == letter).and_then(|index| self.0[index])
    }
}

impl Serialize for AxisTargets {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut targets = serializer.serialize_map(Some(AXES.len()))?;
        for (axis, target) in AXES.iter().zip(self.0) {
            targets.serialize_entry(axis, &target)?;
        }
        targets.end()
    }
}

/// Decodes the background reports of one family.
#[derive(Debug, Clone)]
pub struct BackgroundDecoder {
    family: &'static Family,
    at: Fields,
}

/// Where the fields of a block begin, in 16-bit words; `None` for a field that the family lacks.
#[derive(Debug, Clone)]
struct Fields {
    target_position: Option<usize>,
    position_bias: Option<usize>,
    average_velocity: Option<usize>,
    motor_status: Option<usize>,
    motor_definition: Option<usize>,
    status: Option<usize>,
    axis_targets: [Option<usize>; AXES.len()],
    program_status: Option<usize>,
    lines_remaining: Option<usize>,
    time_left_in_move: Option<usize>,
    time_left_in_acceleration: Option<usize>,
    address_offset: Option<usize>,
    turbo: Option<TurboFields>,
}

impl Fields {
    fn of(family: &Family) -> Self {
        let field = |name: &str| {
            block_fields(family, "background").find(|field| field.name == name).map(|field| field.words.start)
        };
        // A pair of words: the definition, then the status.
        let pair = field("status_and_motor_definition");
        let axis = |letter: &str| field(&format!("{}_target_position", letter.to_ascii_lowercase()));
        Self {
            target_position: field("target_position"),
            position_bias: field("position_bias"),
            average_velocity: field("average_velocity"),
            motor_status: field("background_status"),
            motor_definition: pair,
            status: pair.map(|word| word + 2).or_else(|| field("status_word_1")),
            axis_targets: AXES.map(axis),
            program_status: field("program_status"),
            lines_remaining: field("program_lines_remaining"),
            time_left_in_move: field("time_left_in_move"),
            time_left_in_acceleration: field("time_left_in_acceleration"),
            address_offset: field("program_address_offset"),
            turbo: TurboFields::of(field),
        }
    }
}

impl BackgroundDecoder {
    /// The decoder for boards of `family`.
    #[must_use]
    pub fn new(family: &'static Family) -> Self {
        Self { family, at: Fields::of(family) }
    }

    /// Decodes the report of `count` motors and coordinate systems, but no more than the family has, from its words,
    /// which begin at the region's start. `selection` says which parts of the blocks the daemon read.
    ///
    /// # Errors
    /// [`TooShort`] when the words of a number asked for are missing.
    pub fn decode(
        &self,
        words: &[u16],
        count: usize,
        scales: &Scales,
        float48: Float48Layout,
        selection: Selection,
    ) -> Result<BackgroundData, TooShort> {
        let report = &self.family.background;
        let (head, blocks) = blocks(report.region, &report.blocks, words, count, selection)?;
        let [control_panel, thumbwheel, machine_io] =
            report.ports.map(|offset| int24::unsigned(long(head, report.index(offset))));
        let has_motors = report.numbers != NumberKind::CoordinateSystem;
        let has_systems = report.numbers != NumberKind::Motor;
        let motors = blocks.clone().filter(|_| has_motors);
        let systems = blocks.filter(|_| has_systems);
        let global_status = report.global_status.as_ref();
        Ok(BackgroundData {
            ready: report.ready.is_set(head[report.index(report.ready.word)]),
            servo_timer: report.timer.read(head, report.region.start),
            ports: Ports { control_panel, thumbwheel, machine_io },
            motors: motors.map(|(number, block)| self.motor(number, &block, scales)).collect(),
            global_status: global_status.and_then(|status| status.words(head, report.region.start)),
            coordinate_systems: systems
                .map(|(number, block)| self.system(number, &block, scales, float48))
                .collect(),
            global: self.family.status.global,
        })
    }

    fn motor(&self, number: usize, block: &Block, scales: &Scales) -> BackgroundMotor {
        let (at, tables) = (&self.at, self.family.status);
        let scales = scales.motor(number);
        let position = |word: Option<usize>| block.fixed(word?).map(|raw| Quantity::position(raw, scales));
        let velocity = at.average_velocity.and_then(|word| block.signed(word));
        let word = at.motor_status.and_then(|word| block.unsigned(word));
        BackgroundMotor {
            motor: number,
            target_position: position(at.target_position),
            position_bias: position(at.position_bias),
            average_velocity: velocity.map(|raw| Quantity::velocity(raw, scales)),
            motor_status: word.map(Quantity::bits),
            coordinate_system: word.and_then(|word| status::coordinate_system(word, tables)),
            status: flags(word, tables.motor.get(1)),
        }
    }

    fn system(
        &self,
        number: usize,
        block: &Block,
        scales: &Scales,
        float48: Float48Layout,
    ) -> CoordinateSystem {
        let (at, tables) = (&self.at, self.family.status.coordinate_system);
        let target = |word: Option<usize>| block.float(word?, float48);
        let signed = |word: Option<usize>| block.signed(word?);
        let unsigned = |word: Option<usize>| block.unsigned(word?);
        let status_word = unsigned(at.status);
        let program_status_word = unsigned(at.program_status);
        let status = flags(status_word, tables.first());
        CoordinateSystem {
            coordinate_system: number,
            pmac: at.motor_definition.map(|definition| PmacSystem {
                motor_definition: block.unsigned(definition),
                source: program_status_word.map(TargetSource::of),
            }),
            turbo: at.turbo.as_ref().map(|fields| fields.decode(block, status, tables, scales, float48)),
            status_word,
            status,
            axis_targets: AxisTargets(at.axis_targets.map(target)),
            program_status_word,
            program_status: flags(program_status_word, tables.get(1)),
            motion_mode: program_status_word.and_then(MotionMode::of),
            lines_remaining: signed(at.lines_remaining),
            time_left_in_move: signed(at.time_left_in_move).map(Quantity::time),
            time_left_in_acceleration: signed(at.time_left_in_acceleration).map(Quantity::time),
            program_address_offset: unsigned(at.address_offset),
        }
    }
}

/// Decodes a whole background report of `count` motors and coordinate systems of a board of `family`. See
/// [`BackgroundDecoder::decode`].
///
/// # Errors
/// [`TooShort`] when the words of a number asked for are missing.
pub fn background(
    family: &'static Family,
    words: &[u16],
    count: usize,
    scales: &Scales,
    float48: Float48Layout,
) -> Result<BackgroundData, TooShort> {
    BackgroundDecoder::new(family).decode(words, count, scales, float48, Selection::ALL)
}
