//! The register table of PMAC(1) and PMAC2, built from the addresses in [`super::pmac`].
//!
//! The identifiers are stable: `pmacctl board map --json` and other programs use them.

use super::pmac as at;
use crate::map::functions::rotary_header;
use crate::map::table::{Bits, Block, Format, NumberKind, POSITION, Register, Source, Writer};
use crate::map::{HostOffset, PmacAddress, Space};

use Format::{
    Address, Ascii, Bits0To7, Bits16, Bits24, Bits24Pair, Fixed48, Float48, Gather, Signed24, Unsigned15,
    Unsigned16, Unsigned24,
};
use NumberKind::{CoordinateSystem, Motor, MotorOrCoordinateSystem};
use Writer::{Host, HostSetsPmacClears, Pmac, PmacSetsHostClears};

const VELOCITY: &str = "1/(Ix09*32) count per servo cycle";
const HALF_MS: &str = "1/2 msec";
const LONGS: &str = "32-bit DPRAM words";
const TIME_LEFT_NOTE: &str = "at 100 % override; value = 2*msec";

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

/// The register table of PMAC(1) and PMAC2. It tiles 0x0000-0x07FF without a gap.
pub const BLOCKS: &[Block] = &[
    Block::once(Some(13), PANEL),
    Block::each(at::MOTORS, at::PANEL_STRIDE, Some(13), PANEL_WORDS),
    Block::once(Some(15), SERVO),
    Block::each(at::MOTORS, at::SERVO_MOTOR_STRIDE, Some(15), SERVO_MOTOR),
    Block::once(Some(17), BACKGROUND),
    Block::each(at::MOTORS, at::BACKGROUND_BLOCK_STRIDE, Some(18), BACKGROUND_BLOCK),
    Block::once(Some(29), ASCII),
    Block::once(Some(25), VARIABLE_WRITE),
    Block::once(None, UNASSIGNED),
    Block::once(None, ROTARY_2),
    Block::once(Some(23), VARIABLE_READ),
    Block::once(Some(30), ROTARY_1),
    Block::once(Some(26), GATHER),
];

const PANEL: &[Register] = &[
    Register::word("panel", "request_enable_mask", at::PANEL_REQUEST_ENABLE)
        .is("which numbers the request words are for", Bits16, "")
        .by(HostSetsPmacClears)
        .bits(&[Bits::range(7, 0, "motor_or_cs_8_to_1", HostSetsPmacClears)])
        .note("PMAC clears all bits when it acts"),
    Register::word("panel", "feedrate_override_enable_mask", at::PANEL_OVERRIDE_ENABLE)
        .is("which coordinate systems take their override from here", Bits16, "")
        .by(Host)
        .bits(&[Bits::range(7, 0, "cs_8_to_1", Host)])
        .note("acts as long as it is set; PMAC never clears it"),
];

const PANEL_WORDS: &[Register] = &[
    Register::word("panel", "request", at::PANEL_REQUEST)
        .is("control panel request", Bits16, "bits")
        .of(MotorOrCoordinateSystem)
        .by(Host)
        .bits(PANEL_REQUEST_BITS)
        .note("jog minus and jog plus together stop the motor"),
    Register::word("panel", "feedrate_override", at::PANEL_OVERRIDE)
        .is("feed rate override", Unsigned15, "1/32768 msec")
        .of(CoordinateSystem)
        .by(Host)
        .note("PMAC copies it times 256 to X:$0806 + $C0*(n-1); 14507 is 100 % at the default I10"),
];

/// The bits of a control panel request word, lowest first.
pub const PANEL_REQUEST_BITS: &[Bits] = &[
    Bits::bit(8, "jog_minus", Host),
    Bits::bit(9, "jog_plus", Host),
    Bits::bit(10, "pre_jog", Host),
    Bits::bit(11, "start", Host),
    Bits::bit(12, "step", Host),
    Bits::bit(13, "stop", Host),
    Bits::bit(14, "home", Host),
    Bits::bit(15, "feed_hold", Host),
];

const SERVO: &[Register] = &[
    Register::word("servo", "host_status", at::SERVO_HOST_STATUS)
        .is("host status", Bits16, "")
        .by(Host)
        .bits(&[Bits::bit(0, "host_busy", Host)])
        .note("while bit 0 is set PMAC skips its updates"),
    Register::word("servo", "pmac_status", at::SERVO_PMAC_STATUS)
        .is("PMAC status and servo timer", Bits16, "servo cycles")
        .by(Pmac)
        .bits(&[Bits::bit(15, "pmac_busy", Pmac), Bits::range(14, 0, "servo_timer", Pmac)]),
    Register::long("servo", "global_status_y0003", at::SERVO_GLOBAL_STATUS_Y)
        .is("global status, second word of ???", Bits24, "bits")
        .by(Pmac)
        .from(Source::Fixed(y(0x0003)))
        .note("the manual calls it the first word"),
    Register::long("servo", "global_status_x0003", at::SERVO_GLOBAL_STATUS_X)
        .is("global status, first word of ???", Bits24, "bits")
        .by(Pmac)
        .from(Source::Fixed(x(0x0003)))
        .note("the manual calls it the second word"),
    Register::longs("servo", "global_spare", at::SERVO_GLOBAL_SPARE, 24).is("spare", Format::Unknown, ""),
];

const fn servo_motor(word: usize) -> HostOffset {
    at::SERVO_MOTOR.plus_words(word)
}

const SERVO_MOTOR: &[Register] = &[
    Register::pair("servo", "motor_commanded_position", servo_motor(at::servo_motor::COMMANDED_POSITION))
        .is("commanded position", Fixed48, POSITION)
        .of(Motor)
        .by(Pmac)
        .from(Source::Motor(d(0x0028))),
    Register::pair("servo", "motor_actual_position", servo_motor(at::servo_motor::ACTUAL_POSITION))
        .is("actual position", Fixed48, POSITION)
        .of(Motor)
        .by(Pmac)
        .from(Source::Motor(d(0x002B))),
    Register::pair("servo", "motor_master_position", servo_motor(at::servo_motor::MASTER_POSITION))
        .is("master position", Fixed48, "1/(Ix07*32) count of the master; 1/(Ix08*32) count of the motor")
        .of(Motor)
        .by(Pmac)
        .from(Source::Motor(d(0x002D))),
    Register::pair(
        "servo",
        "motor_compensation_position",
        servo_motor(at::servo_motor::COMPENSATION_POSITION),
    )
    .is("compensation position", Fixed48, POSITION)
    .of(Motor)
    .by(Pmac)
    .from(Source::Motor(d(0x0046))),
    Register::long("servo", "motor_previous_dac", servo_motor(at::servo_motor::PREVIOUS_DAC))
        .is("previous DAC output", Signed24, "1/256 DAC bit")
        .of(Motor)
        .by(Pmac)
        .from(Source::Motor(x(0x003A))),
    Register::long("servo", "motor_servo_status", servo_motor(at::servo_motor::SERVO_STATUS))
        .is("servo status, first word of ?", Bits24, "bits")
        .of(Motor)
        .by(Pmac)
        .from(Source::Motor(x(0x003D))),
    Register::long("servo", "motor_actual_velocity", servo_motor(at::servo_motor::ACTUAL_VELOCITY))
        .is("actual velocity", Signed24, VELOCITY)
        .of(Motor)
        .by(Pmac)
        .from(Source::Motor(x(0x0033)))
        .note("not averaged"),
    Register::long("servo", "motor_time_left", servo_motor(at::servo_motor::TIME_LEFT))
        .is("time left in the move segment", Signed24, HALF_MS)
        .of(Motor)
        .by(Pmac)
        .from(Source::Motor(x(0x0020)))
        .note(TIME_LEFT_NOTE),
    Register::long("servo", "motor_handwheel_pointer", servo_motor(at::servo_motor::HANDWHEEL_POINTER))
        .is("handwheel pointer", Bits24, "PMAC address")
        .of(Motor)
        .by(Pmac)
        .from(Source::Motor(x(0x0029)))
        .note(
            "X:$0029 is the Ix03 feedback address; the handwheel address Ix05 is X:$002A. Do not rely on it",
        ),
    Register::pair("servo", "motor_spare", servo_motor(at::servo_motor::SPARE))
        .is("spare", Format::Unknown, "")
        .of(Motor),
];

const BACKGROUND: &[Register] = &[
    Register::word("background", "data_ready", at::BACKGROUND_DATA_READY)
        .is("buffer status", Bits16, "")
        .by(PmacSetsHostClears)
        .bits(&[Bits::bit(0, "data_ready", PmacSetsHostClears)]),
    Register::word("background", "servo_timer", at::BACKGROUND_SERVO_TIMER)
        .is("servo timer when the data became ready", Unsigned16, "servo cycles")
        .by(Pmac)
        .from(Source::Fixed(x(0x0000))),
    Register::long("background", "control_panel_port", at::BACKGROUND_PANEL_PORT)
        .is("control panel port, JPAN", Bits24, "")
        .by(Pmac)
        .from(Source::Fixed(y(0xFFC0))),
    Register::long("background", "thumbwheel_port", at::BACKGROUND_THUMBWHEEL_PORT)
        .is("thumbwheel port, JTHW", Bits24, "")
        .by(Pmac)
        .from(Source::Fixed(y(0xFFC1))),
    Register::long("background", "machine_io_port", at::BACKGROUND_MACHINE_PORT)
        .is("machine input and output port, JOPTO", Bits24, "")
        .by(Pmac)
        .from(Source::Fixed(y(0xFFC2))),
    Register::longs("background", "global_spare", at::BACKGROUND_GLOBAL_SPARE, 20).is(
        "spare",
        Format::Unknown,
        "",
    ),
];

const fn block(word: usize) -> HostOffset {
    at::BACKGROUND_BLOCK.plus_words(word)
}

/// The target of the axis with `index` in the order A B C U V W X Y Z; four words each, one source word each.
const fn axis_target(index: usize, name: &'static str, title: &'static str) -> Register {
    let step = index as u32;
    Register::pair("background", name, block(at::background_block::AXIS_TARGETS + 4 * index))
        .is(title, Float48, "user axis units")
        .of(CoordinateSystem)
        .by(Pmac)
        .from(Source::Choice([l(0x0876 + step), l(0x0896 + step), l(0x0819 + step)]))
        .note("source by the program status: A if bit 7 set and bit 5 clear, else B if bit 9 set, else C")
}

const BACKGROUND_BLOCK: &[Register] = &[
    Register::pair("background", "motor_target_position", block(at::background_block::TARGET_POSITION))
        .is("target position", Fixed48, POSITION)
        .of(Motor)
        .by(Pmac)
        .from(Source::System(d(0x080B))),
    Register::pair("background", "motor_position_bias", block(at::background_block::POSITION_BIAS))
        .is("position bias", Fixed48, POSITION)
        .of(Motor)
        .by(Pmac)
        .from(Source::System(d(0x0813))),
    Register::long("background", "motor_background_status", block(at::background_block::MOTOR_STATUS))
        .is("motor status, second word of ?", Bits24, "bits")
        .of(Motor)
        .by(Pmac)
        .from(Source::System(y(0x0814))),
    Register::pair(
        "background",
        "cs_status_and_motor_definition",
        block(at::background_block::MOTOR_DEFINITION),
    )
    .is("motor definition word, then coordinate system status, first word of ??", Bits24Pair, "bits")
    .of(CoordinateSystem)
    .by(Pmac)
    .from(Source::System(d(0x0818)))
    .note("the definition word's bits are not documented"),
    axis_target(0, "cs_a_target_position", "A axis target position"),
    axis_target(1, "cs_b_target_position", "B axis target position"),
    axis_target(2, "cs_c_target_position", "C axis target position"),
    axis_target(3, "cs_u_target_position", "U axis target position"),
    axis_target(4, "cs_v_target_position", "V axis target position"),
    axis_target(5, "cs_w_target_position", "W axis target position"),
    axis_target(6, "cs_x_target_position", "X axis target position"),
    axis_target(7, "cs_y_target_position", "Y axis target position"),
    axis_target(8, "cs_z_target_position", "Z axis target position"),
    Register::long("background", "cs_program_status", block(at::background_block::PROGRAM_STATUS))
        .is("program execution status, second word of ??", Bits24, "bits")
        .of(CoordinateSystem)
        .by(Pmac)
        .from(Source::System(y(0x0817))),
    Register::long("background", "cs_program_lines_remaining", block(at::background_block::LINES_REMAINING))
        .is("program lines remaining, as PR", Signed24, "lines")
        .of(CoordinateSystem)
        .by(Pmac)
        .from(Source::System(y(0x08AE))),
    Register::long("background", "cs_time_left_in_move", block(at::background_block::TIME_LEFT_IN_MOVE))
        .is("time left in the move", Signed24, HALF_MS)
        .of(CoordinateSystem)
        .by(Pmac)
        .from(Source::Motor(x(0x0020)))
        .note("value = 2*msec; sources contradict whether it holds with I13 at 0 or above 0"),
    Register::long(
        "background",
        "cs_time_left_in_acceleration",
        block(at::background_block::TIME_LEFT_IN_ACCELERATION),
    )
    .is("time left in acceleration or deceleration", Signed24, HALF_MS)
    .of(CoordinateSystem)
    .by(Pmac)
    .note("value = 2*msec; no source register is documented"),
    Register::long("background", "cs_program_address_offset", block(at::background_block::ADDRESS_OFFSET))
        .is("program execution address offset, as PE", Unsigned24, "program buffer offset")
        .of(CoordinateSystem)
        .by(Pmac)
        .note("no source register is documented"),
    Register::long("background", "motor_average_velocity", block(at::background_block::AVERAGE_VELOCITY))
        .is("averaged actual velocity", Signed24, VELOCITY)
        .of(Motor)
        .by(Pmac)
        .from(Source::System(y(0x082A))),
];

const ASCII: &[Register] = &[
    Register::word("ascii", "host_output_control", at::ASCII_OUTPUT_CONTROL)
        .is("command control", Bits16, "")
        .by(HostSetsPmacClears)
        .bits(&[Bits::bit(0, "command_loaded", HostSetsPmacClears)]),
    Register::word("ascii", "host_output_control_character", at::ASCII_CONTROL_CHARACTER)
        .is("control character", Bits0To7, "")
        .by(HostSetsPmacClears)
        .note("firmware 1.15 and later; needs no line"),
    Register::longs("ascii", "host_output_buffer", at::ASCII_COMMAND, at::ASCII_COMMAND_BYTES as u32)
        .is("command line", Ascii, "")
        .by(Host)
        .note("159 characters and a NUL; a line up to 200 goes in two parts, the first without a NUL"),
    Register::word("ascii", "host_input_control", at::ASCII_INPUT_CONTROL)
        .is("response control", Bits16, "")
        .by(PmacSetsHostClears)
        .note(
            "0 free, 0x000D line, 0x010D CMD response, 0x020D SEND message, 0x0006 end, 0x8ddd error in BCD",
        ),
    Register::word("ascii", "host_input_count", at::ASCII_INPUT_COUNT)
        .is("response length", Unsigned16, "characters + 1")
        .by(Pmac),
    Register::longs("ascii", "host_input_buffer", at::ASCII_RESPONSE, at::ASCII_RESPONSE_BYTES as u32)
        .is("response line", Ascii, "")
        .by(Pmac)
        .note("255 characters and a NUL"),
];

const VARIABLE_WRITE: &[Register] = &[
    Register::word("variable_write", "entry_count", at::VARIABLE_WRITE_COUNT)
        .is("records to write", Unsigned16, "records, 1-32")
        .by(HostSetsPmacClears)
        .note("misprinted as 0x07E6"),
    Register::word("variable_write", "table_start", at::VARIABLE_WRITE_START)
        .is("start of the records", Address, "")
        .by(Host)
        .note("$D200-$DFFD; misprinted as 0x07E8"),
];

const UNASSIGNED: &[Register] =
    &[Register::long("unassigned", "unknown_d1f6", at::UNKNOWN_D1F6).is("no known use", Format::Unknown, "")];

const ROTARY_STATUS_BITS: &[Bits] = &[
    Bits::bit(15, "error", Pmac),
    Bits::bit(14, "internal_buffer_full", Pmac),
    Bits::range(7, 0, "error_code", Pmac),
];

/// The six rows of a rotary header; the two headers differ in place and number only.
macro_rules! rotary_header {
    ($number:literal, $start:expr) => {
        &[
            Register::word(
                "rotary",
                concat!("buffer", $number, "_status"),
                $start.plus_words(rotary_header::STATUS),
            )
            .is(concat!("rotary buffer ", $number, " status"), Bits16, "")
            .by(Pmac)
            .bits(ROTARY_STATUS_BITS),
            Register::word(
                "rotary",
                concat!("buffer", $number, "_cs"),
                $start.plus_words(rotary_header::COORDINATE_SYSTEM),
            )
            .is(concat!("rotary buffer ", $number, " coordinate system"), Unsigned16, "")
            .by(Host)
            .note("whether numbers start at 0 or 1 is not confirmed"),
            Register::word(
                "rotary",
                concat!("buffer", $number, "_host_index"),
                $start.plus_words(rotary_header::HOST_INDEX),
            )
            .is(concat!("rotary buffer ", $number, " host index"), Unsigned16, LONGS)
            .by(Host),
            Register::word(
                "rotary",
                concat!("buffer", $number, "_pmac_index"),
                $start.plus_words(rotary_header::PMAC_INDEX),
            )
            .is(concat!("rotary buffer ", $number, " PMAC index"), Unsigned16, LONGS)
            .by(Pmac)
            .note("the host writes 0 at the start"),
            Register::word(
                "rotary",
                concat!("buffer", $number, "_size"),
                $start.plus_words(rotary_header::SIZE),
            )
            .is(concat!("rotary buffer ", $number, " size"), Unsigned16, LONGS)
            .by(Host)
            .note("even, at least 6"),
            Register::word(
                "rotary",
                concat!("buffer", $number, "_start"),
                $start.plus_words(rotary_header::START),
            )
            .is(concat!("rotary buffer ", $number, " start"), Address, "")
            .by(Host)
            .note("$D200 or above"),
        ]
    };
}

const ROTARY_1: &[Register] = rotary_header!("1", at::ROTARY_1);
const ROTARY_2: &[Register] = rotary_header!("2", at::ROTARY_2);

const VARIABLE_READ: &[Register] = &[
    Register::word("variable_read", "control", at::VARIABLE_READ_CONTROL)
        .is("control", Bits16, "")
        .by(PmacSetsHostClears)
        .bits(&[Bits::bit(8, "multi_user", Host), Bits::bit(0, "data_ready", PmacSetsHostClears)]),
    Register::word("variable_read", "servo_timer", at::VARIABLE_READ_SERVO_TIMER)
        .is("servo timer at the update", Unsigned16, "servo cycles")
        .by(Pmac)
        .from(Source::Fixed(x(0x0000))),
    Register::word("variable_read", "entry_count", at::VARIABLE_READ_COUNT)
        .is("entries to read", Unsigned16, "entries, 1-128")
        .by(Host)
        .note("0 stops the function"),
    Register::word("variable_read", "table_start", at::VARIABLE_READ_START)
        .is("start of the entries", Address, "")
        .by(Host)
        .note("$D200-$DFFD"),
];

const GATHER: &[Register] = &[
    Register::word("gather", "buffer_size", at::GATHER_SIZE)
        .is("gather buffer size", Unsigned16, LONGS)
        .by(Pmac)
        .note("set by DEFINE GATHER"),
    Register::word("gather", "storage_index", at::GATHER_INDEX)
        .is("where the next item is stored", Unsigned16, LONGS)
        .by(Pmac)
        .note("from the buffer's start; misprinted as 0x07FC"),
    Register::longs("gather", "buffer", at::GATHER_BUFFER, 0)
        .is("gather buffer", Gather, "")
        .by(Pmac)
        .note("length by DEFINE GATHER, rounded up to whole samples"),
];
