//! The board's reports: positions, velocities, status.

use std::ffi::c_char;

use super::{BOOL, DWORD, FALSE, Words, int, truth};
use crate::border::{Place, Unit, exports};
use crate::fault::Fault;
use crate::status::{self, flag, is_used, motor, position, system};
use pmac_dpram::decode::Quantity;
use pmac_dpram::map::Generation;

/// A number, or none: a program that computes with it sees that.
fn number_of(value: Result<f64, Fault>) -> f64 {
    value.unwrap_or(f64::NAN)
}

fn is(flag: Result<bool, Fault>) -> BOOL {
    BOOL::from(flag.unwrap_or(false))
}

fn raw(quantity: Option<Quantity>) -> Option<int> {
    int::try_from(quantity?.raw).ok()
}

fn all_of<T>(outcome: Result<[u32; 2], T>) -> [u32; 2] {
    outcome.unwrap_or([0; 2])
}

exports! {
    /// TRUE if the daemon uses the servo report: `pmacctl setup` switches it, for everybody.
    PmacDPRRealTime(number: DWORD, _period: DWORD, on: int) -> BOOL = FALSE => truth(is_used(number, "servo", on != 0));
    /// As `PmacDPRRealTime`.
    PmacDPRRealTimeEx(number: DWORD, _mask: int, _period: DWORD, on: int) -> BOOL = FALSE =>
        truth(is_used(number, "servo", on != 0));
    /// Whether the servo report is live; it needs no update by the program.
    PmacDPRUpdateRealTime(number: DWORD) -> BOOL = FALSE => truth(status::servo_timer(number));
    /// TRUE if the daemon uses the background report.
    PmacDPRBackground(number: DWORD, on: int) -> BOOL = FALSE => truth(is_used(number, "background", on != 0));
    /// As `PmacDPRBackground`.
    PmacDPRBackgroundEx(number: DWORD, on: int, _period: DWORD, _systems: DWORD) -> BOOL = FALSE =>
        truth(is_used(number, "background", on != 0));
    /// The daemon has the motors of its configuration.
    PmacDPRSetMotors(number: DWORD, _mask: DWORD) -> () = () => drop(is_used(number, "servo", false));
    /// The daemon has the motors of its configuration.
    PmacDPRRealTimeSetMotor(number: DWORD, _mask: int) -> () = () => drop(is_used(number, "servo", false));
    /// The servo timer of the latest servo report.
    PmacDPRGetServoTimer(number: DWORD) -> int = 0 => status::servo_timer(number).unwrap_or(0) as int;

    /// Commanded position.
    PmacDPRGetCommandedPos(number: DWORD, index: int, units: f64) -> f64 = f64::NAN =>
        number_of(status::commanded(number, index, units));
    /// Actual position.
    PmacDPRPosition(number: DWORD, index: int, units: f64) -> f64 = f64::NAN =>
        number_of(position(number, index, units, |motor, _| motor.servo.actual_position));
    /// Following error.
    PmacDPRFollowError(number: DWORD, index: int, units: f64) -> f64 = f64::NAN =>
        number_of(position(number, index, units, |motor, _| motor.servo.following_error));
    /// Following error.
    PmacFollowError(number: DWORD, index: int, units: f64) -> f64 = f64::NAN =>
        number_of(position(number, index, units, |motor, _| motor.servo.following_error));
    /// Offset from `PSET` and axis definitions.
    PmacDPRGetBiasPos(number: DWORD, index: int, units: f64) -> f64 = f64::NAN =>
        number_of(position(number, index, units, status::bias));
    /// The end of the present move.
    PmacDPRGetTargetPos(number: DWORD, index: int, units: f64) -> f64 = f64::NAN =>
        number_of(position(number, index, units, |motor, _| motor.target()));
    /// Position of the motor's master.
    PmacDPRGetMasterPos(number: DWORD, index: int, units: f64, place: Place<f64>) -> () = () =>
        place.put(number_of(position(number, index, units, |motor, _| motor.servo.master_position)));
    /// Leadscrew and backlash compensation.
    PmacDPRGetCompensationPos(number: DWORD, index: int, units: f64, place: Place<f64>) -> () = () =>
        place.put(number_of(position(number, index, units, |motor, _| motor.servo.compensation_position)));
    /// Velocity: `units` times the register, 1/(Ix09*32) count a servo cycle.
    PmacDPRGetVel(number: DWORD, index: int, units: f64) -> f64 = f64::NAN =>
        number_of(motor(number, index, |motor, _| status::velocity(motor)).map(|raw| raw * units));
    /// Averaged velocity: `units` times the register.
    PmacDPRVelocity(number: DWORD, index: int, units: f64) -> f64 = f64::NAN =>
        number_of(motor(number, index, status::averaged).map(|raw| raw * units));
    /// The velocity of motors together: counts a minute, each motor's times its `units`.
    PmacDPRVectorVelocity(number: DWORD, count: int, motors: Place<int>, units: Place<f64>) -> f64 = f64::NAN => {
        let count = usize::try_from(count).unwrap_or(0).min(32);
        match (motors.copy(count), units.copy(count)) {
            (Some(motors), Some(units)) => number_of(status::vector_velocity(number, &motors, &units)),
            _ => f64::NAN,
        }
    };
    /// The register of the time left in the move.
    PmacDPRGetMoveTime(number: DWORD, index: int) -> DWORD = 0 =>
        motor(number, index, |motor, _| raw(motor.servo.time_left)).unwrap_or(0) as DWORD;
    /// The register of the previous output.
    PmacDPRGetPrevDAC(number: DWORD, index: int) -> DWORD = 0 =>
        motor(number, index, |motor, _| raw(motor.servo.previous_dac)).unwrap_or(0) as DWORD;

    /// The motor is activated.
    PmacDPRMotorEnabled(number: DWORD, index: int) -> BOOL = FALSE => is(flag(number, index, "motor_activated"));
    /// The motor's loop is open.
    PmacDPROpenLoop(number: DWORD, index: int) -> BOOL = FALSE => is(flag(number, index, "open_loop"));
    /// The flag of the negative limit, as the vendor's headers call bit 22.
    PmacDPROnNegativeLimit(number: DWORD, index: int) -> BOOL = FALSE => is(flag(number, index, "negative_limit_set"));
    /// The flag of the positive limit, bit 21.
    PmacDPROnPositiveLimit(number: DWORD, index: int) -> BOOL = FALSE => is(flag(number, index, "positive_limit_set"));
    /// The motor has stopped on a position limit.
    PmacDPROnPositionLimit(number: DWORD, index: int) -> BOOL = FALSE =>
        is(flag(number, index, "stopped_on_position_limit"));
    /// The motor follows a master.
    PmacDPRHandwheelEnabled(number: DWORD, index: int) -> BOOL = FALSE => is(motor(number, index, |motor, _| {
        Some(motor.has("handwheel_enabled")? || motor.has("following_enabled").unwrap_or(false))
    }));
    /// PMAC commutates the motor.
    PmacDPRPhasedMotor(number: DWORD, index: int) -> BOOL = FALSE => is(flag(number, index, "phased_motor"));
    /// The motor waited for data of its move.
    PmacDPRDataBlock(number: DWORD, index: int) -> BOOL = FALSE => is(flag(number, index, "data_block_error"));
    /// The amplifier is enabled.
    PmacDPRAmpEnabled(number: DWORD, index: int) -> BOOL = FALSE => is(flag(number, index, "amplifier_enabled"));
    /// The amplifier has a fault.
    PmacDPRAmpFault(number: DWORD, index: int) -> BOOL = FALSE => is(flag(number, index, "amplifier_fault"));
    /// The following error exceeds the fatal limit.
    PmacDPRFatalFError(number: DWORD, index: int) -> BOOL = FALSE =>
        is(flag(number, index, "fatal_following_error"));
    /// The following error exceeds the warning limit.
    PmacDPRWarnFError(number: DWORD, index: int) -> BOOL = FALSE =>
        is(flag(number, index, "warning_following_error"));
    /// The motor has homed.
    PmacDPRHomeComplete(number: DWORD, index: int) -> BOOL = FALSE => is(flag(number, index, "home_complete"));
    /// The motor is in position.
    PmacDPRInposition(number: DWORD, index: int) -> BOOL = FALSE => is(flag(number, index, "in_position"));
    /// As `PmacDPRAmpEnabled`.
    PmacAmpEnabled(number: DWORD, index: int) -> BOOL = FALSE => is(flag(number, index, "amplifier_enabled"));
    /// As `PmacDPRAmpFault`.
    PmacAmpFault(number: DWORD, index: int) -> BOOL = FALSE => is(flag(number, index, "amplifier_fault"));
    /// As `PmacDPRFatalFError`.
    PmacFatalFError(number: DWORD, index: int) -> BOOL = FALSE => is(flag(number, index, "fatal_following_error"));
    /// As `PmacDPROnNegativeLimit`.
    PmacOnNegativeLimit(number: DWORD, index: int) -> BOOL = FALSE => is(flag(number, index, "negative_limit_set"));
    /// As `PmacDPROnPositiveLimit`.
    PmacOnPositiveLimit(number: DWORD, index: int) -> BOOL = FALSE => is(flag(number, index, "positive_limit_set"));
    /// As `PmacDPRPhasedMotor`.
    PmacPhasedMotor(number: DWORD, index: int) -> BOOL = FALSE => is(flag(number, index, "phased_motor"));

    /// The target of an axis of a coordinate system, in user units.
    PmacDPRCommanded(number: DWORD, index: int, axis: c_char) -> f64 = f64::NAN => {
        let axis = char::from(axis.byte().to_ascii_uppercase()).to_string();
        number_of(system(number, index, |system| system.axis_targets.axis(&axis)))
    };
    /// Where the coordinate system executes its program, as `PE`; -1 after a failure.
    PmacDPRPe(number: DWORD, index: int) -> int = -1 =>
        system(number, index, |system| system.program_address_offset).map_or(-1, |offset| offset as int);
    /// Program lines left, as `PR`; -1 after a failure.
    PmacDPRProgRemaining(number: DWORD, index: int) -> int = -1 =>
        system(number, index, |system| system.lines_remaining).unwrap_or(-1);
    /// The register of the time left in the move.
    PmacDPRTimeRemInMove(number: DWORD, index: int) -> int = -1 =>
        system(number, index, |system| raw(system.time_left_in_move)).unwrap_or(-1);
    /// The register of the time left in acceleration.
    PmacDPRTimeRemInTATS(number: DWORD, index: int) -> int = -1 =>
        system(number, index, |system| raw(system.time_left_in_acceleration)).unwrap_or(-1);
    /// All motors of the coordinate system are in position.
    PmacDPRSysInposition(number: DWORD, index: int) -> BOOL = FALSE =>
        is(system(number, index, |system| Some(system.program_status?.has("in_position"))));

    /// The words of `???`, the second first.
    PmacDPRGlobalStatus(number: DWORD) -> Words<2> = Words([0; 2]) => Words(all_of(status::global(number)));
    /// The words of `???`, the second first.
    PmacDPRGetGlobalStatus(number: DWORD, place: Place<[u32; 2]>) -> () = () =>
        place.put(all_of(status::global(number)));
    /// The words of `???`, the second first.
    PmacDPRGetGlobalStatusTurbo(number: DWORD, place: Place<[u32; 2]>) -> () = () =>
        place.put(all_of(status::global(number)));
    /// The first word of `?`.
    PmacDPRMotorServoStatusTurbo(number: DWORD, index: int) -> Words<1> = Words([0]) =>
        Words([motor(number, index, |motor, _| motor.status_words()[0]).map_or(0, |flags| flags.word)]);
    /// The second word of `?`.
    PmacDPRMotorStatusTurbo(number: DWORD, index: int) -> Words<1> = Words([0]) =>
        Words([motor(number, index, |motor, _| motor.status_words()[1]).map_or(0, |flags| flags.word)]);
    /// A motor's words in the servo report of PMAC and PMAC2.
    PmacDPRMotorRealtimeStruct(number: DWORD, index: int) -> Words<15> = Words([0; 15]) =>
        Words(status::servo_block(number, index, Generation::Pmac).unwrap_or([0; 15]));
    /// A motor's words in the servo report of a Turbo board.
    PmacDPRMotorRealtimeStructTurbo(number: DWORD, index: int) -> Words<12> = Words([0; 12]) =>
        Words(status::servo_block(number, index, Generation::Turbo).unwrap_or([0; 12]));
}
