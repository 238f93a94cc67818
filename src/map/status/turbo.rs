//! The status words of Turbo PMAC and Turbo PMAC2, firmware 1.94x. `??` has three words.

use super::pmac::SYSTEM_STATUS;
use super::{Field, StatusTable, StatusTables};

/// The status words of Turbo PMAC.
pub static TURBO: StatusTables = StatusTables {
    motor: &[SERVO_STATUS, BACKGROUND_STATUS],
    coordinate_system: &[SYSTEM_STATUS, PROGRAM_STATUS, LOOKAHEAD_STATUS],
    global: &[GLOBAL_X, GLOBAL_Y],
};

/// First word of `?`, X:$0000B0 + $80*(n-1).
const SERVO_STATUS: StatusTable = StatusTable {
    name: "servo_status",
    flags: &[
        (23, "motor_activated"),
        (22, "negative_limit_set"),
        (21, "positive_limit_set"),
        (20, "extended_servo_on"),
        (19, "amplifier_enabled"),
        (18, "open_loop"),
        (17, "move_timer_active"),
        (16, "integration_mode"),
        (15, "dwell_in_progress"),
        (14, "data_block_error"),
        (13, "desired_velocity_zero"),
        (12, "abort_deceleration"),
        (11, "block_request"),
        (10, "home_search_in_progress"),
        (9, "user_written_phase"),
        (8, "user_written_servo"),
        (7, "alternate_source_or_destination"),
        (6, "phased_motor"),
        (5, "following_offset_mode"),
        (4, "following_enabled"),
        (3, "error_trigger"),
        (2, "software_position_capture"),
        (1, "alternate_command_output_mode"),
        (0, "maximum_rapid_speed"),
    ],
    fields: &[],
    reserved: 0,
};

/// Second word of `?`, Y:$0000C0 + $80*(n-1). Axis: 0 none, 1 A, 2 B, 3 C, 4 UVW, 5 I (inverse kinematic), 7 XYZ.
const BACKGROUND_STATUS: StatusTable = StatusTable {
    name: "motor_status",
    flags: &[
        (15, "assigned_to_coordinate_system"),
        (13, "foreground_in_position"),
        (12, "stopped_on_desired_position_limit"),
        (11, "stopped_on_position_limit"),
        (10, "home_complete"),
        (9, "phasing_search_active"),
        (8, "phasing_reference_error"),
        (7, "trigger_move"),
        (6, "integrated_fatal_following_error"),
        (5, "i2t_amplifier_fault"),
        (4, "backlash_direction"),
        (3, "amplifier_fault"),
        (2, "fatal_following_error"),
        (1, "warning_following_error"),
        (0, "in_position"),
    ],
    fields: &[
        Field { high: 23, low: 20, name: "coordinate_system_less_one" },
        Field { high: 19, low: 16, name: "axis" },
    ],
    reserved: 0x4000,
};

/// Second word of `??`, Y:$00203F + $100*(n-1). Bits 4, 1 and 0 together: [`super::MotionMode`].
const PROGRAM_STATUS: StatusTable = StatusTable {
    name: "program_status",
    flags: &[
        (23, "lookahead_in_progress"),
        (22, "run_time_error"),
        (21, "move_in_stack"),
        (20, "amplifier_fault"),
        (19, "fatal_following_error"),
        (18, "warning_following_error"),
        (17, "in_position"),
        (16, "rotary_buffer_request"),
        (15, "delayed_calculation"),
        (14, "end_of_block_stop"),
        (13, "synchronous_m_one_shot"),
        (12, "dwell_buffered"),
        (11, "cutter_compensation_outside_corner"),
        (10, "cutter_compensation_stop_request"),
        (9, "cutter_compensation_move_buffered"),
        (8, "pre_jog_move"),
        (7, "segmented_move"),
        (6, "segmented_acceleration"),
        (5, "segmented_stop_request"),
        (4, "pvt_or_spline_mode"),
        (3, "cutter_compensation_left_or_3d_on"),
        (2, "cutter_compensation_on"),
        (1, "counterclockwise_or_rapid_mode"),
        (0, "circle_or_spline_mode"),
    ],
    fields: &[],
    reserved: 0,
};

/// Third word of `??`, Y:$002040 + $100*(n-1); older firmware has PMATCH at bit 18 and nothing below.
const LOOKAHEAD_STATUS: StatusTable = StatusTable {
    name: "lookahead_status",
    flags: &[
        (23, "lookahead_wrapped"),
        (22, "lookahead_lookback_active"),
        (21, "lookahead_buffer_end"),
        (20, "lookahead_synchronous_m"),
        (19, "lookahead_synchronous_m_overflow"),
        (18, "lookahead_direction_reverse"),
        (17, "lookahead_stopping"),
        (16, "lookahead_changing"),
        (15, "lookahead_last_segment"),
        (14, "lookahead_recalculating"),
        (13, "lookahead_flush"),
        (12, "lookahead_last_move"),
        (11, "single_segment_request"),
        (10, "change_request"),
        (9, "movement_request"),
        (8, "direction_request"),
        (3, "radius_error"),
        (2, "resume_error"),
        (1, "desired_position_limit_stop"),
        (0, "in_program_position_match"),
    ],
    fields: &[],
    reserved: 0xF0,
};

/// First word of `???`, X:$000006.
const GLOBAL_X: StatusTable = StatusTable {
    name: "global_status_x",
    flags: &[
        (22, "real_time_interrupt_reentry"),
        (21, "cpu_type_bit_1"),
        (20, "servo_error"),
        (19, "data_gathering_on"),
        (17, "gather_starts_on_trigger"),
        (16, "servo_request"),
        (15, "watchdog"),
        (14, "leadscrew_compensation_on"),
        (13, "checksum_error"),
        (12, "firmware_checksum_error"),
        (11, "dpram_error"),
        (10, "flash_error"),
        (9, "real_time_interrupt_warning"),
        (8, "illegal_l_variable"),
        (7, "configuration_error"),
        (6, "tws_parity_error"),
        (5, "macro_auxiliary_error"),
        (4, "macro_ring_check"),
        (3, "phase_clock_missing"),
        (1, "all_cards_addressed"),
        (0, "this_card_addressed"),
    ],
    fields: &[],
    reserved: 0x80_0000 | 0x04_0000 | 0x4,
};

/// Second word of `???`, Y:$000006.
const GLOBAL_Y: StatusTable = StatusTable {
    name: "global_status_y",
    flags: &[
        (23, "ultralite"),
        (22, "vme_board"),
        (21, "cpu_type_bit_0"),
        (20, "binary_rotary_buffer_open"),
        (19, "motion_buffer_open"),
        (18, "rotary_buffer_open"),
        (17, "plc_buffer_open"),
        (16, "umac_system"),
        (13, "ring_master_communication"),
        (12, "master_to_ring_master_communication"),
        (11, "fixed_buffer_full"),
    ],
    fields: &[Field { high: 15, low: 14, name: "kinematics_active" }],
    reserved: 0x07FF,
};
