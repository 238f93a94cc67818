//! The status words of PMAC(1) and PMAC2. Bits 7-5 of the second motor word came with later firmware.

use super::{Field, StatusTable, StatusTables};

/// The status words of PMAC(1) and PMAC2.
pub static PMAC: StatusTables = StatusTables {
    motor: &[SERVO_STATUS, BACKGROUND_STATUS],
    coordinate_system: &[SYSTEM_STATUS, PROGRAM_STATUS],
    global: &[GLOBAL_X, GLOBAL_Y],
};

/// First word of `?`, X:$003D + $3C*(n-1). An input +LIM sets bit 22, -LIM bit 21.
const SERVO_STATUS: StatusTable = StatusTable {
    name: "servo_status",
    flags: &[
        (23, "motor_activated"),
        (22, "negative_limit_set"),
        (21, "positive_limit_set"),
        (20, "handwheel_enabled"),
        (19, "phased_motor"),
        (18, "open_loop"),
        (17, "definite_time_move"),
        (16, "integration_mode"),
        (15, "dwell_in_progress"),
        (14, "data_block_error"),
        (13, "desired_velocity_zero"),
        (12, "abort_deceleration"),
        (11, "block_request"),
        (10, "home_search_in_progress"),
    ],
    fields: &[Field { high: 9, low: 0, name: "internal_pointer" }],
    reserved: 0,
};

/// Second word of `?`, Y:$0814 + $C0*(n-1).
const BACKGROUND_STATUS: StatusTable = StatusTable {
    name: "motor_status",
    flags: &[
        (23, "assigned_to_coordinate_system"),
        (14, "amplifier_enabled"),
        (11, "stopped_on_position_limit"),
        (10, "home_complete"),
        (8, "phasing_search_error"),
        (7, "trigger_move"),
        (6, "integrated_fatal_following_error"),
        (5, "i2t_amplifier_fault"),
        (4, "backlash_direction"),
        (3, "amplifier_fault"),
        (2, "fatal_following_error"),
        (1, "warning_following_error"),
        (0, "in_position"),
    ],
    fields: &[Field { high: 22, low: 20, name: "coordinate_system_less_one" }],
    reserved: 0x0F_8000 | 0x3000 | 0x0200,
};

/// First word of `??`, X:$0818 + $C0*(n-1). An axis has a bit "in the vector feed rate" and a bit "incremental".
pub(super) const SYSTEM_STATUS: StatusTable = StatusTable {
    name: "coordinate_system_status",
    flags: &[
        (23, "z_feedrate"),
        (22, "z_incremental"),
        (21, "y_feedrate"),
        (20, "y_incremental"),
        (19, "x_feedrate"),
        (18, "x_incremental"),
        (17, "w_feedrate"),
        (16, "w_incremental"),
        (15, "v_feedrate"),
        (14, "v_incremental"),
        (13, "u_feedrate"),
        (12, "u_incremental"),
        (11, "c_feedrate"),
        (10, "c_incremental"),
        (9, "b_feedrate"),
        (8, "b_incremental"),
        (7, "a_feedrate"),
        (6, "a_incremental"),
        (5, "radius_vector_incremental"),
        (4, "continuous_motion_request"),
        (3, "move_by_time"),
        (2, "continuous_motion_mode"),
        (1, "single_step_mode"),
        (0, "running_program"),
    ],
    fields: &[],
    reserved: 0,
};

/// Second word of `??`, PSTATUS, Y:$0817 + $C0*(n-1). Bits 4, 1 and 0 together: [`super::MotionMode`].
const PROGRAM_STATUS: StatusTable = StatusTable {
    name: "program_status",
    flags: &[
        (23, "program_hold_stop"),
        (22, "run_time_error"),
        (21, "circle_radius_error"),
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
        (3, "cutter_compensation_left"),
        (2, "cutter_compensation_on"),
        (1, "counterclockwise_or_rapid_mode"),
        (0, "circle_or_spline_mode"),
    ],
    fields: &[],
    reserved: 0,
};

/// First word of `???`, X:$0003. The names of bits 12-7 rest on one source; bit 7 has two meanings there.
const GLOBAL_X: StatusTable = StatusTable {
    name: "global_status_x",
    flags: &[
        (23, "real_time_interrupt_active"),
        (22, "real_time_interrupt_reentry"),
        (21, "servo_active"),
        (20, "servo_error"),
        (19, "data_gathering_on"),
        (18, "gather_starts_on_servo"),
        (17, "gather_starts_on_trigger"),
        (14, "leadscrew_compensation_on"),
        (13, "checksum_error"),
        (12, "prom_checksum_error"),
        (11, "dpram_error"),
        (10, "earom_error"),
        (9, "real_time_interrupt_warning"),
        (8, "illegal_l_variable"),
        (7, "configuration_error_or_end_gather"),
        (6, "tws_parity_error"),
        (5, "macro_auxiliary_error"),
        (4, "macro_ring_check"),
        (1, "all_cards_addressed"),
        (0, "this_card_addressed"),
    ],
    fields: &[],
    reserved: 0x1_8000 | 0xC,
};

/// Second word of `???`, Y:$0003.
const GLOBAL_Y: StatusTable = StatusTable {
    name: "global_status_y",
    flags: &[
        (22, "host_communication_mode"),
        (19, "motion_buffer_open"),
        (18, "rotary_buffer_open"),
        (17, "plc_buffer_open"),
        (16, "plc_command"),
        (15, "vme_or_dpram_response_mode"),
        (11, "fixed_buffer_full"),
        (6, "binary_rotary_buffer_open"),
    ],
    fields: &[],
    reserved: 0x80_0000 | 0x30_0000 | 0x7000 | 0x07BF,
};
