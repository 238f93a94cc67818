//! The simulated firmware of Turbo PMAC and Turbo PMAC2, beyond the family's DPRAM.
//!
//! Registers: the vendor's suggested M-variables for Turbo PMAC2, public drivers, Turbo Software Reference pp. 284-290.

use crate::map::{self, Family, PmacAddress, Space};
use crate::sim::board::firmware::{Addressing, Card, Controller, DpramHandshake, FirmwareTables, NumberRule};
use crate::sim::board::i_rows::{self, Row};
use crate::sim::board::number::Resolution;
use crate::sim::board::register_table::{self, Each, RegisterTable};
use crate::sim::board::settings::{Setting, Settings};
use crate::sim::board::{status_bits, turbo_rows};

/// Address of P0, and of the Q0 of coordinate system 1. No manual seen gives these addresses.
const P: u32 = 0x6000;
const Q: u32 = 0x8000;
/// The sets of 16 coordinate systems in one run of registers, in PMAC's order: each further set begins half way between
/// two earlier sets. (User Manual p. 151 shows eight.)
const Q_SETS: [u32; 16] = {
    let mut sets = [Q; 16];
    let mut index = 0;
    while index < 16 {
        sets[index] = Q + 0x200 * ((index as u32).reverse_bits() >> 28);
        index += 1;
    }
    sets
};

const fn motor(space: Space, number: u32) -> Each {
    Each::new(map::TURBO.motor_source_stride, PmacAddress::new(space, number))
}

const fn system(space: Space, number: u32) -> Each {
    Each::new(map::TURBO.system_source_stride, PmacAddress::new(space, number))
}

const fn registers(family: &'static Family) -> RegisterTable {
    RegisterTable {
        timers: &[],
        global_status: PmacAddress::new(Space::X, 0x0006),
        global_buffers: PmacAddress::new(Space::Y, 0x0006),
        machine_inputs: PmacAddress::new(Space::Y, 0x7_8402),
        conversion_table: PmacAddress::new(Space::Y, 0x3501),
        bus_setup: None,
        bus_active: PmacAddress::new(Space::X, 0x7_0006),
        // Turbo User Manual p. 402.
        dpram_end: Some(PmacAddress::new(Space::Y, 0x3F)),
        hardware: 0x7_8000..0x7_9000,
        end: 0x4000,

        time_left: motor(Space::X, 0xA0),
        desired_velocity: motor(Space::X, 0x86),
        commanded: motor(Space::D, 0x88),
        feedback_address: motor(Space::X, 0x89),
        master_address: motor(Space::X, 0x8A),
        actual: motor(Space::D, 0x8B),
        following_error: Some(motor(Space::D, 0x91)),
        velocity: motor(Space::X, 0x9D),
        dac: motor(Space::X, 0xBF),
        servo_status: motor(Space::X, 0xB0),
        compensation: motor(Space::D, 0x90),

        time_base_commanded: system(Space::X, 0x2000),
        time_base_present: system(Space::X, 0x2002),
        target: motor(Space::D, 0xC7),
        bias: motor(Space::D, 0xCC),
        background_status: motor(Space::Y, 0xC0),
        home_capture: motor(Space::Y, 0xCE),
        program_status: system(Space::Y, 0x203F),
        coordinate_status: system(Space::X, 0x2040),
        coordinate_status_3: Some(system(Space::Y, 0x2040)),
        coordinate_motors: None,
        axis_targets: system(Space::L, 0x2041),
        segmented_axis_targets: system(Space::L, 0x204A),
        average_velocity: motor(Space::X, 0xEF),
        reported_velocity: motor(Space::X, 0xEF),
        jog_variable: motor(Space::L, 0xD7),
        lines_remaining: system(Space::Y, 0x2053),
        ..register_table::pmac(family)
    }
}

const fn turbo(
    family: &'static Family,
    i_rows: &'static [&'static [Row]],
    controller: Controller,
    type_text: &'static str,
) -> FirmwareTables {
    FirmwareTables {
        family,
        // A board of 2026 that answers TYPE with `TURBO2, X4`.
        firmware: "1.947",
        variables: 8192,
        numbers: NumberRule::Wrapped,
        p_address: P,
        m_address: PmacAddress::new(Space::L, 0x4000),
        q_addresses: &Q_SETS,
        i_rows,
        settings: Settings {
            in_position_scans: Setting::Motor(88),
            segmentation: Setting::System(13),
            flag_mode: Setting::Motor(24),
            error_trigger: (Setting::Motor(97), 1 << 1),
            has_channels: true,
            rapid_speed: Setting::Motor(90),
            hold_slew: Setting::System(52),
            step_mode: Setting::System(53),
            minimum_arc: Setting::System(97),
            backlash_hysteresis: Setting::Motor(87),
            timers: &[11, 12],
            line_from_dpram: None,
            dpram_base: Some(24),
        },
        registers: registers(family),
        status_bits: status_bits::TURBO,
        decimals: 10,
        positions: Resolution::ThirtySeconds,
        group: 8,
        dpram_handshake: DpramHandshake::Untouched,
        addressing: Addressing::EachPort,
        controller,
        type_text,
        // 602413 is a UMAC's, and is seen as "Turbo PMAC2-VME" too; of a Turbo PMAC of the first generation no text tells.
        card: Some(Card { part: "602413", vendor: "1" }),
        startup: include_str!("../dpram-startup-turbo.pmc"),
    }
}

const fn first(family: &'static Family) -> FirmwareTables {
    const ROWS: &[&[Row]] = &[
        i_rows::MOTOR,
        i_rows::COORDINATE,
        turbo_rows::GLOBAL,
        turbo_rows::MOTOR,
        turbo_rows::COORDINATE,
        turbo_rows::TURBO,
    ];
    turbo(family, ROWS, Controller::Intel8259, "TURBO1, X4")
}

const fn second(family: &'static Family) -> FirmwareTables {
    const ROWS: &[&[Row]] = &[
        i_rows::MOTOR,
        i_rows::COORDINATE,
        turbo_rows::GLOBAL,
        turbo_rows::MOTOR,
        turbo_rows::COORDINATE,
        turbo_rows::TURBO2,
    ];
    turbo(family, ROWS, Controller::Pmac2, "TURBO2, X4")
}

/// Turbo PMAC, firmware 1.94x.
pub static TURBO: FirmwareTables = first(&map::TURBO);
/// The same with 32K x 16 bits.
pub static TURBO_32K: FirmwareTables = first(&map::TURBO_32K);
/// Turbo PMAC2, firmware 1.94x.
pub static TURBO2: FirmwareTables = second(&map::TURBO2);
/// The same with 8K x 16 bits.
pub static TURBO2_8K: FirmwareTables = second(&map::TURBO2_8K);
