//! The register table of Turbo PMAC and Turbo PMAC2, built from the addresses in [`super::turbo`].
//!
//! The identifiers are stable: `pmacctl board map --json` and other programs use them. Every row says how sure it is.

use super::turbo as at;
use crate::map::functions::rotary_header;
use crate::map::table::{Bits, Block, Confidence, Format, NumberKind, POSITION, Register, Source, Writer};
use crate::map::{HostOffset, PANEL_REQUEST_BITS, PmacAddress, Space};

use Confidence::{High, Low, Medium};
use Format::{
    Any, Ascii, Bits0To7, Bits16, Bits24, Bits32, Fixed48, Float48, Signed24, StartOffset, Unsigned15,
    Unsigned16, Unsigned24,
};
use NumberKind::{CoordinateSystem, Motor, MotorOrCoordinateSystem};
use Writer::{Host, HostSetsPmacClears, Pmac, PmacSetsHostClears};

const LONGS: &str = "32-bit DPRAM words";
const HALF_MS: &str = "1/2 msec";
const NOT_CONFIRMED: &str = "as on PMAC; whether any firmware acts on it is not confirmed";
const AS_ON_PMAC: &str = "value = 2*msec, as on PMAC";

const fn x(number: u32) -> PmacAddress {
    PmacAddress::new(Space::X, number)
}

const fn y(number: u32) -> PmacAddress {
    PmacAddress::new(Space::Y, number)
}

const fn d(number: u32) -> PmacAddress {
    PmacAddress::new(Space::D, number)
}

const fn l(number: u32) -> PmacAddress {
    PmacAddress::new(Space::L, number)
}

/// The register table of Turbo PMAC and Turbo PMAC2. It tiles 0x0000-0x113F without a gap.
pub const BLOCKS: &[Block] = &[
    Block::once(None, PANEL),
    Block::each(at::PANEL_NUMBERS, at::PANEL_STRIDE, None, PANEL_WORDS),
    Block::once(None, PANEL_RESERVED),
    Block::once(Some(402), SERVO),
    Block::each(at::MOTORS, at::SERVO_MOTOR_STRIDE, Some(402), SERVO_MOTOR),
    Block::once(Some(405), BACKGROUND),
    Block::each(at::SYSTEMS, at::BACKGROUND_SYSTEM_STRIDE, Some(405), SYSTEM),
    Block::once(Some(405), ASCII),
    Block::once(Some(407), VARIABLE_READ),
    Block::once(Some(410), VARIABLE_WRITE),
    Block::each(at::SYSTEMS, at::ROTARY_STRIDE, None, ROTARY),
    Block::once(None, UNASSIGNED),
    Block::once(None, GATHER),
    Block::once(Some(402), OPEN_USE),
];

const PANEL: &[Register] = &[
    Register::word("panel", "request_enable_mask", at::PANEL_REQUEST_ENABLE)
        .is("which numbers the request words are for", Bits16, "")
        .by(HostSetsPmacClears)
        .bits(&[Bits::range(7, 0, "motor_or_cs_8_to_1", HostSetsPmacClears)])
        .note(NOT_CONFIRMED)
        .sure(Low),
    Register::word("panel", "feedrate_override_enable_mask", at::PANEL_OVERRIDE_ENABLE)
        .is("which coordinate systems take their override from here", Bits16, "")
        .by(Host)
        .bits(&[Bits::range(7, 0, "cs_8_to_1", Host)])
        .note(NOT_CONFIRMED)
        .sure(Low),
];

const PANEL_WORDS: &[Register] = &[
    Register::word("panel", "request", at::PANEL_REQUEST)
        .is("control panel request", Bits16, "bits")
        .of(MotorOrCoordinateSystem)
        .by(Host)
        .bits(PANEL_REQUEST_BITS)
        .note(NOT_CONFIRMED)
        .sure(Low),
    Register::word("panel", "feedrate_override", at::PANEL_OVERRIDE)
        .is("feed rate override", Unsigned15, "1/32768 msec")
        .of(CoordinateSystem)
        .by(Host)
        .note("as on PMAC; it would go to X:$002000 + $100*(n-1), but whether any firmware acts on it is not confirmed")
        .sure(Low),
];

const PANEL_RESERVED: &[Register] =
    &[Register::longs("panel", "reserved", at::PANEL_RESERVED, at::PANEL_RESERVED_LENGTH)
        .is("no known use", Format::Unknown, "")
        .note("too small for the panel words of 32 motors")
        .sure(Medium)];

/// The first words of a report, but for the very first: each side's hold on the other, and the time of the copy.
macro_rules! handover {
    ($function:literal, $host:expr, $timer:expr, $pmac:expr) => {
        [
            Register::word($function, "host_status", $host)
                .is("host status", Bits16, "")
                .by(Host)
                .bits(&[Bits::bit(15, "host_busy", Host)])
                .note("while bit 15 is set PMAC skips its updates")
                .sure(High),
            Register::word($function, "servo_timer_low", $timer)
                .is("servo timer at the copy, bits 15-0", Unsigned16, "servo cycles")
                .by(Pmac)
                .from(Source::Fixed(x(0x00_0000)))
                .sure(High),
            Register::word($function, "servo_timer_high_and_ready", $pmac)
                .is("data ready, and servo timer bits 23-16", Bits16, "")
                .by(PmacSetsHostClears)
                .bits(&[
                    Bits::bit(15, "data_ready", PmacSetsHostClears),
                    Bits::range(7, 0, "servo_timer_23_to_16", Pmac),
                ])
                .note(
                    "clear while PMAC copies; with a period of 0 the host clears it to have the next report",
                )
                .sure(High),
        ]
    };
}

const SERVO_HANDOVER: [Register; 3] =
    handover!("servo", at::SERVO_HOST_STATUS, at::SERVO_TIMER, at::SERVO_PMAC_STATUS);

const SERVO: &[Register] = &[
    Register::word("servo", "spare", at::SERVO_SPARE).is("spare", Format::Unknown, "").sure(Medium),
    SERVO_HANDOVER[0],
    SERVO_HANDOVER[1],
    SERVO_HANDOVER[2],
    Register::long("servo", "motor_mask", at::SERVO_MASK)
        .is("which motors are reported, bit 0 for motor 1", Bits32, "")
        .by(Host)
        .sure(High),
];

const fn servo_motor(word: usize) -> HostOffset {
    at::SERVO_MOTOR.plus_words(word)
}

const SERVO_MOTOR: &[Register] = &[
    Register::pair("servo", "motor_following_error", servo_motor(at::servo_motor::FOLLOWING_ERROR))
        .is("following error", Fixed48, POSITION)
        .of(Motor)
        .by(Pmac)
        .from(Source::Motor(d(0x00_0091)))
        .sure(High),
    Register::long("servo", "motor_previous_dac", servo_motor(at::servo_motor::PREVIOUS_DAC))
        .is("previous servo output", Signed24, "1/256 of a 16-bit output's least bit")
        .of(Motor)
        .by(Pmac)
        .from(Source::Motor(x(0x00_00BF)))
        .sure(Medium),
    Register::long("servo", "motor_servo_status", servo_motor(at::servo_motor::SERVO_STATUS))
        .is("servo status, first word of ?", Bits24, "bits")
        .of(Motor)
        .by(Pmac)
        .from(Source::Motor(x(0x00_00B0)))
        .sure(High),
    Register::long("servo", "motor_background_status", servo_motor(at::servo_motor::BACKGROUND_STATUS))
        .is("motor status, second word of ?", Bits24, "bits")
        .of(Motor)
        .by(Pmac)
        .from(Source::Motor(y(0x00_00C0)))
        .sure(High),
    Register::pair("servo", "motor_position_bias", servo_motor(at::servo_motor::POSITION_BIAS))
        .is("position bias", Fixed48, POSITION)
        .of(Motor)
        .by(Pmac)
        .from(Source::Motor(d(0x00_00CC)))
        .sure(High),
    Register::long("servo", "motor_filtered_velocity", servo_motor(at::servo_motor::FILTERED_VELOCITY))
        .is("averaged actual velocity", Signed24, "1/(Ix09*32) count per servo cycle at the default I60 and I61")
        .of(Motor)
        .by(Pmac)
        .from(Source::Motor(d(0x00_00EF)))
        .note("over 16*(I60+1) servo cycles, shifted right by I61; which half of the register it is, no text tells")
        .sure(Medium),
    Register::longs("servo", "motor_spare", servo_motor(at::servo_motor::SPARE), 8)
        .is("spare", Format::Unknown, "")
        .of(Motor)
        .sure(High),
    Register::pair("servo", "motor_actual_position", servo_motor(at::servo_motor::ACTUAL_POSITION))
        .is("actual position", Fixed48, POSITION)
        .of(Motor)
        .by(Pmac)
        .from(Source::Motor(d(0x00_008B)))
        .note("what P answers adds bias and compensation")
        .sure(Medium),
];

const BACKGROUND_HANDOVER: [Register; 3] =
    handover!("background", at::BACKGROUND_HOST_STATUS, at::BACKGROUND_TIMER, at::BACKGROUND_PMAC_STATUS);

const BACKGROUND: &[Register] = &[
    Register::word("background", "cs_count", at::BACKGROUND_COUNT)
        .is("how many coordinate systems are reported, from 1", Bits0To7, "")
        .by(Host)
        .note("0 is none")
        .sure(High),
    BACKGROUND_HANDOVER[0],
    BACKGROUND_HANDOVER[1],
    BACKGROUND_HANDOVER[2],
    Register::long("background", "control_panel_port", at::BACKGROUND_PANEL_PORT)
        .is("control panel port, JPAN", Bits24, "")
        .by(Pmac)
        .sure(Medium),
    Register::long("background", "machine_io_port", at::BACKGROUND_MACHINE_PORT)
        .is("machine input and output port, JOPTO", Bits24, "")
        .by(Pmac)
        .note("on PMAC the thumbwheel port stands before it")
        .sure(Medium),
    Register::long("background", "thumbwheel_port", at::BACKGROUND_THUMBWHEEL_PORT)
        .is("thumbwheel port, JTHW", Bits24, "")
        .by(Pmac)
        .sure(Medium),
    Register::long("background", "global_status_y000006", at::BACKGROUND_GLOBAL_STATUS_Y)
        .is("global status, second word of ???", Bits24, "bits")
        .by(Pmac)
        .from(Source::Fixed(y(0x00_0006)))
        .sure(Medium),
    Register::long("background", "global_status_x000006", at::BACKGROUND_GLOBAL_STATUS_X)
        .is("global status, first word of ???", Bits24, "bits")
        .by(Pmac)
        .from(Source::Fixed(x(0x00_0006)))
        .sure(Medium),
    Register::longs("background", "global_spare", at::BACKGROUND_GLOBAL_SPARE, 12)
        .is("spare", Format::Unknown, "")
        .sure(High),
];

const fn system(word: usize) -> HostOffset {
    at::BACKGROUND_SYSTEM.plus_words(word)
}

/// The target of the axis with `index` in the order A B C U V W X Y Z; four words each, one source word each.
const fn axis_target(index: usize, name: &'static str, title: &'static str) -> Register {
    Register::pair("background", name, system(at::system::AXIS_TARGETS + 4 * index))
        .is(title, Float48, "user axis units")
        .of(CoordinateSystem)
        .by(Pmac)
        .from(Source::System(l(0x00_2041 + index as u32)))
        .note("where the move ends that is calculated")
        .sure(Medium)
}

const SYSTEM: &[Register] = &[
    Register::pair("background", "cs_feedrate_or_time", system(at::system::FEEDRATE_OR_TIME))
        .is("feed rate, F, or move time, TM", Float48, "user units per Isx90 time units (F) or msec (TM)")
        .of(CoordinateSystem)
        .by(Pmac)
        .note("TM where the first word of ?? says move by time; no text tells of what register it is a copy")
        .sure(Medium),
    Register::long("background", "cs_feedpot", system(at::system::FEEDPOT))
        .is("present time base", Signed24, "1/8388608 msec, as I10")
        .of(CoordinateSystem)
        .by(Pmac)
        .from(Source::System(x(0x00_2002)))
        .note("100 % is I10")
        .sure(Medium),
    Register::long("background", "cs_feedpot_pointer", system(at::system::FEEDPOT_POINTER))
        .is("time base pointer, Isx93, and feed hold", Bits24, "PMAC address")
        .of(CoordinateSystem)
        .by(Pmac)
        .note("bit 22: feed hold in progress; bit 21: slewing, by one header alone")
        .sure(Medium),
    Register::long("background", "cs_status_word_3", system(at::system::STATUS_3))
        .is("lookahead status, third word of ??", Bits24, "bits")
        .of(CoordinateSystem)
        .by(Pmac)
        .from(Source::System(y(0x00_2040)))
        .sure(High),
    Register::long("background", "cs_status_word_1", system(at::system::STATUS_1))
        .is("coordinate system status, first word of ??", Bits24, "bits")
        .of(CoordinateSystem)
        .by(Pmac)
        .from(Source::System(x(0x00_2040)))
        .sure(High),
    axis_target(0, "cs_a_target_position", "A axis target position"),
    axis_target(1, "cs_b_target_position", "B axis target position"),
    axis_target(2, "cs_c_target_position", "C axis target position"),
    axis_target(3, "cs_u_target_position", "U axis target position"),
    axis_target(4, "cs_v_target_position", "V axis target position"),
    axis_target(5, "cs_w_target_position", "W axis target position"),
    axis_target(6, "cs_x_target_position", "X axis target position"),
    axis_target(7, "cs_y_target_position", "Y axis target position"),
    axis_target(8, "cs_z_target_position", "Z axis target position"),
    Register::long("background", "cs_program_status", system(at::system::PROGRAM_STATUS))
        .is("program execution status, second word of ??", Bits24, "bits")
        .of(CoordinateSystem)
        .by(Pmac)
        .from(Source::System(y(0x00_203F)))
        .sure(High),
    Register::long("background", "cs_program_lines_remaining", system(at::system::LINES_REMAINING))
        .is("program lines remaining, as PR", Signed24, "lines")
        .of(CoordinateSystem)
        .by(Pmac)
        .sure(High),
    Register::long("background", "cs_time_left_in_move", system(at::system::TIME_LEFT_IN_MOVE))
        .is("time left in the move segment", Signed24, HALF_MS)
        .of(CoordinateSystem)
        .by(Pmac)
        .note(AS_ON_PMAC)
        .sure(Medium),
    Register::long(
        "background",
        "cs_time_left_in_acceleration",
        system(at::system::TIME_LEFT_IN_ACCELERATION),
    )
    .is("time left in acceleration or deceleration", Signed24, HALF_MS)
    .of(CoordinateSystem)
    .by(Pmac)
    .note(AS_ON_PMAC)
    .sure(Medium),
    Register::long("background", "cs_program_address_offset", system(at::system::ADDRESS_OFFSET))
        .is("program execution address offset, as PE", Unsigned24, "program buffer offset")
        .of(CoordinateSystem)
        .by(Pmac)
        .sure(High),
    Register::longs("background", "cs_spare", system(at::system::SPARE), 12)
        .is("spare", Format::Unknown, "")
        .of(CoordinateSystem)
        .sure(High),
];

const ASCII: &[Register] = &[
    Register::word("ascii", "host_output_control", at::ASCII_OUTPUT_CONTROL)
        .is("command control", Bits16, "")
        .by(HostSetsPmacClears)
        .bits(&[Bits::bit(0, "command_loaded", HostSetsPmacClears)])
        .sure(High),
    Register::word("ascii", "host_output_control_character", at::ASCII_CONTROL_CHARACTER)
        .is("control character", Bits0To7, "")
        .by(HostSetsPmacClears)
        .note("needs no line")
        .sure(High),
    Register::longs("ascii", "host_output_buffer", at::ASCII_COMMAND, at::ASCII_COMMAND_BYTES as u32)
        .is("command line", Ascii, "")
        .by(Host)
        .note("159 characters and a NUL")
        .sure(High),
    Register::word("ascii", "host_input_control", at::ASCII_INPUT_CONTROL)
        .is("response control", Bits16, "")
        .by(PmacSetsHostClears)
        .note(
            "0 free, 0x000D line, 0x010D COMMAND response, 0x020D SEND message, 0x0006 end, 0x8ddd error in BCD",
        )
        .sure(High),
    Register::word("ascii", "host_input_count", at::ASCII_INPUT_COUNT)
        .is("response length", Unsigned16, "characters + 1")
        .by(Pmac)
        .sure(High),
    Register::longs("ascii", "host_input_buffer", at::ASCII_RESPONSE, at::ASCII_RESPONSE_BYTES)
        .is("response line", Ascii, "")
        .by(Pmac)
        .note("255 characters and a NUL")
        .sure(High),
];

const VARIABLE_READ: &[Register] = &[
    Register::word("variable_read", "control", at::VARIABLE_READ_CONTROL)
        .is("control", Bits16, "")
        .by(PmacSetsHostClears)
        .bits(&[Bits::bit(8, "multi_user", Host), Bits::bit(0, "data_ready", PmacSetsHostClears)])
        .sure(High),
    Register::word("variable_read", "servo_timer", at::VARIABLE_READ_TIMER)
        .is("servo timer at the update", Unsigned16, "servo cycles")
        .by(Pmac)
        .from(Source::Fixed(x(0x00_0000)))
        .sure(High),
    Register::word("variable_read", "entry_count", at::VARIABLE_READ_COUNT)
        .is("entries to read", Unsigned16, "entries, 1-128")
        .by(Host)
        .note("0 stops the function")
        .sure(High),
    Register::word("variable_read", "table_start", at::VARIABLE_READ_START)
        .is("start of the entries", StartOffset, "longs")
        .by(Host)
        .note("on PMAC an address")
        .sure(High),
];

const VARIABLE_WRITE: &[Register] = &[
    Register::word("variable_write", "entry_count", at::VARIABLE_WRITE_COUNT)
        .is("records to write", Unsigned16, "records, 1-32")
        .by(HostSetsPmacClears)
        .sure(High),
    Register::word("variable_write", "table_start", at::VARIABLE_WRITE_START)
        .is("start of the records", StartOffset, "longs")
        .by(Host)
        .note("$0000-$0BAF with 8K x 16, $0000-$3BAF with 32K x 16")
        .sure(High),
];

/// A word of a rotary header.
const fn header(name: &'static str, word: usize) -> Register {
    Register::word("rotary", name, at::ROTARY.plus_words(word))
}

const ROTARY: &[Register] = &[
    header("status", rotary_header::STATUS)
        .is("rotary buffer status", Bits16, "")
        .of(CoordinateSystem)
        .by(Pmac)
        .bits(&[
            Bits::bit(15, "error", Pmac),
            Bits::bit(14, "internal_buffer_full", Pmac),
            Bits::range(7, 0, "error_code", Pmac),
        ])
        .sure(Medium),
    header("cs", rotary_header::COORDINATE_SYSTEM)
        .is("rotary buffer coordinate system", Unsigned16, "")
        .of(CoordinateSystem)
        .by(Host)
        .note("says nothing new: the header's place names the coordinate system")
        .sure(Low),
    header("host_index", rotary_header::HOST_INDEX)
        .is("rotary buffer host index", Unsigned16, LONGS)
        .of(CoordinateSystem)
        .by(Host)
        .sure(Medium),
    header("pmac_index", rotary_header::PMAC_INDEX)
        .is("rotary buffer PMAC index", Unsigned16, LONGS)
        .of(CoordinateSystem)
        .by(Pmac)
        .note("the host writes 0 at the start, as on PMAC")
        .sure(Medium),
    header("size", rotary_header::SIZE)
        .is("rotary buffer size", Unsigned16, LONGS)
        .of(CoordinateSystem)
        .by(Host)
        .note("even, at least 6, as on PMAC")
        .sure(Medium),
    header("start", rotary_header::START)
        .is("rotary buffer start", StartOffset, "longs")
        .of(CoordinateSystem)
        .by(Host)
        .note("on PMAC an address")
        .sure(Medium),
];

const UNASSIGNED: &[Register] =
    &[Register::longs("unassigned", "reserved_060444", at::UNASSIGNED, at::UNASSIGNED_LENGTH)
        .is("no known use", Format::Unknown, "")
        .note("left over behind 16 headers of 3 longs")
        .sure(Medium)];

const GATHER: &[Register] = &[
    Register::word("gather", "buffer_size", at::GATHER_SIZE)
        .is("gather buffer size", Unsigned16, LONGS)
        .by(Pmac)
        .note("set by DEFINE GATHER while I5000 is 2 or 3")
        .sure(High),
    Register::word("gather", "storage_index", at::GATHER_INDEX)
        .is("where the next item is stored", Unsigned16, LONGS)
        .by(Pmac)
        .note("from the buffer's start; a site's program calls this word the size")
        .sure(High),
];

const OPEN_USE: &[Register] = &[Register::longs("open_use", "free_area", at::USER_START, 0)
    .is("gather buffer, other buffers of variable size, free use", Any, "")
    .note("the gather buffer begins here while I5000 is 2 or 3")
    .sure(High)];
