//! Families for tests: those there are, and Turbo PMAC2 as far as its DPRAM is known, which no program offers yet.
//!
//! The numbers of [`TURBO`] are those of the Turbo User Manual (TUM) and the Turbo Software Reference (TSRM) as the fact
//! sheet FACTS-TURBO collects them; each line names its section there. What the sheet leaves open stands here as its
//! proposal and is no promise.

use super::{Family, Generation, PMAC, PMAC2};
use crate::map::functions::{
    AsciiPort, BackgroundBlock, Blocks, BusyRule, Controller, EntryBits, Flag, IVariables, RecordBits,
    RotaryHeaders, Run, ServoBlock, StartRule, Timer, VariableRead, VariableWrite,
};
use crate::map::table::{Block, Format, NumberKind, Register, Source, Writer};
use crate::map::{GatherPlace, HostOffset, PmacAddress, Region, Space, status};

/// The families on which the tests of a function run.
pub static TESTED: [&Family; 3] = [&PMAC, &PMAC2, &TURBO];

const fn at(bytes: u32) -> HostOffset {
    HostOffset::new(bytes)
}

/// Section 4: X:$06001A to $06019C, the motors' report.
const SERVO: Region = Region::new("servo", at(0x0068), at(0x0674));
/// Section 5: $06019D on, the board and its coordinate systems.
const BACKGROUND: Region = Region::new("background", at(0x0674), at(0x0E9C));
/// Section 9: the user area begins at $060450. Section 1: with 32K x 16 the last long lies at 0xFFFC.
const USER: Region = Region::new("user", at(0x1140), at(0x1_0000));

/// Section 4, "motor n at host 0x0074 + 0x30*(n-1)": the first word of motor 1.
const MOTOR: u32 = 0x0074;

const fn motor(space: Space, number: u32) -> Source {
    Source::Motor(PmacAddress::new(space, number))
}

/// Section 4, the table of a motor's block. A location is 4 bytes.
const MOTOR_BLOCK: &[Register] = &[
    Register::pair("servo", "motor_following_error", at(MOTOR))
        .is("following error", Format::Fixed48, "1/(Ix08*32) count")
        .of(NumberKind::Motor)
        .by(Writer::Pmac)
        .from(motor(Space::D, 0x91)),
    Register::long("servo", "motor_previous_dac", at(MOTOR + 8))
        .is("servo output", Format::Signed24, "1/256 DAC bit")
        .of(NumberKind::Motor)
        .by(Writer::Pmac)
        .from(motor(Space::X, 0xBF)),
    Register::long("servo", "motor_servo_status", at(MOTOR + 12))
        .is("first word of ?", Format::Bits24, "bits")
        .of(NumberKind::Motor)
        .by(Writer::Pmac)
        .from(motor(Space::X, 0xB0)),
    Register::long("servo", "motor_background_status", at(MOTOR + 16))
        .is("second word of ?", Format::Bits24, "bits")
        .of(NumberKind::Motor)
        .by(Writer::Pmac)
        .from(motor(Space::Y, 0xC0)),
    Register::pair("servo", "motor_position_bias", at(MOTOR + 20))
        .is("position bias", Format::Fixed48, "1/(Ix08*32) count")
        .of(NumberKind::Motor)
        .by(Writer::Pmac)
        .from(motor(Space::D, 0xCC)),
    Register::long("servo", "motor_filtered_velocity", at(MOTOR + 28))
        .is("averaged velocity", Format::Signed24, "1/(Ix09*32) count per servo cycle")
        .of(NumberKind::Motor)
        .by(Writer::Pmac)
        .from(motor(Space::D, 0xEF)),
    Register::longs("servo", "motor_spare", at(MOTOR + 32), 8).is("spare", Format::Unknown, ""),
    Register::pair("servo", "motor_actual_position", at(MOTOR + 40))
        .is("actual position", Format::Fixed48, "1/(Ix08*32) count")
        .of(NumberKind::Motor)
        .by(Writer::Pmac)
        .from(motor(Space::D, 0x8B)),
];

/// Section 5, "C.S. n at 0x069C + 0x80*(n-1)": the first word of coordinate system 1.
const SYSTEM: u32 = 0x069C;

const fn system(name: &'static str, word: u32, format: Format) -> Register {
    Register::long("background", name, at(SYSTEM + 4 * word))
        .is("", format, "")
        .of(NumberKind::CoordinateSystem)
        .by(Writer::Pmac)
}

const fn axis(name: &'static str, word: u32) -> Register {
    Register::pair("background", name, at(SYSTEM + 4 * word))
        .is("axis target position", Format::Float48, "user units")
        .of(NumberKind::CoordinateSystem)
        .by(Writer::Pmac)
}

/// Section 5, the table of a coordinate system's block, in locations.
const SYSTEM_BLOCK: &[Register] = &[
    axis("cs_feedrate_or_time", 0),
    system("cs_feedpot", 2, Format::Signed24),
    system("cs_feedpot_pointer", 3, Format::Bits24),
    system("cs_status_word_3", 4, Format::Bits24),
    system("cs_status_word_1", 5, Format::Bits24),
    axis("cs_a_target_position", 6),
    axis("cs_b_target_position", 8),
    axis("cs_c_target_position", 10),
    axis("cs_u_target_position", 12),
    axis("cs_v_target_position", 14),
    axis("cs_w_target_position", 16),
    axis("cs_x_target_position", 18),
    axis("cs_y_target_position", 20),
    axis("cs_z_target_position", 22),
    system("cs_program_status", 24, Format::Bits24),
    system("cs_program_lines_remaining", 25, Format::Signed24),
    system("cs_time_left_in_move", 26, Format::Signed24),
    system("cs_time_left_in_acceleration", 27, Format::Signed24),
    system("cs_program_address_offset", 28, Format::Unsigned24),
    Register::longs("background", "cs_spare", at(SYSTEM + 4 * 29), 12).is("spare", Format::Unknown, ""),
];

/// Section 8: "host 0x1050 + 12*(n-1), n = 1..16".
const ROTARY: [HostOffset; 16] = {
    let mut headers = [at(0x1050); 16];
    let mut index = 0;
    while index < headers.len() {
        headers[index] = at(0x1050 + 12 * index as u32);
        index += 1;
    }
    headers
};

/// A Turbo PMAC2 with 32K x 16 of DPRAM.
pub static TURBO: Family = Family {
    name: "turbo2",
    title: "Turbo PMAC2",
    number: 4,
    generation: Generation::Turbo,
    // Section 1: "host offset = 4*(pmac-$060000) + (X ? 2 : 0)", 32K x 16.
    base: 0x06_0000,
    length: 0x1_0000,
    // The sheet does not say; less than there is.
    memory_end: 0x1_0000,
    // Section 2, "motors / C.S.": 32 and 16.
    motors: 32,
    coordinate_systems: 16,
    address_digits: 6,
    // Section 3, I5001: "19-bit address".
    address_bits: 19,
    // Section 17: "motor source stride $80, C.S. source stride $100".
    motor_source_stride: 0x80,
    system_source_stride: 0x100,
    // Section 13: 3713991 on Turbo PMAC2.
    default_i10: 3_713_991,
    // Section 3; a control panel is not known to exist (section 18, question 3).
    i: IVariables {
        panel: None,
        servo_period: 47,
        servo_enable: 48,
        background_enable: 49,
        reported: None,
        variables_enable: 55,
        interrupt: 56,
        rotary_enable: None,
        ascii_enable: 58,
        gather_period: 5049,
        gather_mode: 5000,
        gather_masks: &[5050, 5051],
        gather_sources: 5001,
        time_base: 5193,
    },
    regions: &[
        Region::new("unused", at(0), at(0x0068)),
        SERVO,
        BACKGROUND,
        Region::new("ascii", at(0x0E9C), at(0x1044)),
        Region::new("pointers", at(0x1044), at(0x1140)),
        USER,
    ],
    user_area: USER,
    blocks: &[Block::each(32, 0x30, Some(402), MOTOR_BLOCK), Block::each(16, 0x80, Some(405), SYSTEM_BLOCK)],
    status: &status::TURBO,
    servo: ServoBlock {
        region: SERVO,
        // Section 4: "0x006A bit 15 host busy; 0x006C timer low; 0x006E bits 0-7 timer high, bit 15 data ready; 0x0070 mask".
        host_busy: Flag { word: at(0x006A), mask: 1 << 15 },
        pmac_status: Flag { word: at(0x006E), mask: 1 << 15 },
        // Section 2: "1 = data ready (inverted meaning)".
        busy: BusyRule::ClearWhileWriting,
        timer: Timer { low: at(0x006C), low_bits: 16, high: Some((at(0x006E), 8)) },
        mask: Some(at(0x0070)),
        // The board's own words are in the background report (section 5).
        global: Run { first: at(0x0070), words: 0 },
        global_status: None,
        program_buffer_open: None,
        gathering: None,
        // Section 4: "+12 X:$0000B0"; bit 18 of that word.
        open_loop: Flag { word: at(MOTOR + 14), mask: 1 << 2 },
        activated: Flag { word: at(MOTOR + 14), mask: 1 << 7 },
        standing: Flag { word: at(MOTOR + 12), mask: 1 << 13 },
        motors: Blocks { count: 32, first: at(MOTOR), words: 24 },
    },
    background: BackgroundBlock {
        region: BACKGROUND,
        // Section 5: "0x0674 bits 0-7 highest C.S., 0x0676 bit 15 host busy, 0x0678/0x067A as in section 4".
        ready: Flag { word: at(0x067A), mask: 1 << 15 },
        host_busy: Some(Flag { word: at(0x0676), mask: 1 << 15 }),
        count: Some(at(0x0674)),
        timer: Timer { low: at(0x0678), low_bits: 16, high: Some((at(0x067A), 8)) },
        global: Run { first: at(0x067C), words: 10 },
        // Section 5: panel $06019F, machine I/O $0601A0, thumbwheel $0601A1.
        ports: [at(0x067C), at(0x0684), at(0x0680)],
        numbers: NumberKind::CoordinateSystem,
        // Section 5: "C.S. n at 0x069C + 0x80*(n-1)".
        blocks: Blocks { count: 16, first: at(0x069C), words: 64 },
    },
    // Section 6.
    ascii: AsciiPort {
        command_loaded: Flag { word: at(0x0E9C), mask: 1 },
        control_character: at(0x0E9E),
        command: at(0x0EA0),
        command_bytes: 160,
        // "Long lines: as classic", which is known as K alone.
        line_limit: 200,
        response_control: at(0x0F40),
        response_count: at(0x0F42),
        response: at(0x0F44),
    },
    panel: None,
    // The sheet does not say; as on a PMAC2.
    host_port: Controller::Pmac2,
    // Section 2, "variable tables start word": an offset from $060450.
    start: StartRule { from: at(0x1140), word: 0 },
    // Section 7.1: ready, mode, timer, count, start; "bits 5-4: type", "bits 2-0: address bits 18-16".
    variable_read: VariableRead {
        ready: Flag { word: at(0x1044), mask: 1 },
        multi_user: Flag { word: at(0x1044), mask: 1 << 8 },
        timer: at(0x1046),
        count: at(0x1048),
        start: at(0x104A),
        entry: EntryBits { kind: 4, address: 19 },
    },
    // Section 7.2, the layout it proposes (not confirmed).
    variable_write: VariableWrite {
        count: at(0x104C),
        start: at(0x104E),
        record: RecordBits { kind: 4, width: 6, offset: 11, address: 19 },
    },
    rotary: RotaryHeaders { headers: &ROTARY },
    // Section 9: "always starts at 0x1140 ($060450)", with size and index at $06044F.
    gather: GatherPlace { size: at(0x113C), index: at(0x113E), buffer: at(0x1140) },
    gather_moved_in: &[],
    gather_shift: 0,
};
