//! The status bits that people see, each with the word that stands for it, worst first. [`crate::map::status`] has all
//! bits and their names.

use super::number::NOT_READ;
use crate::decode::Flags;

/// A flag's name in [`crate::map::status`], and the word to show for it.
type Shown = (&'static str, &'static str);

/// Flags of a motor's servo status.
const MOTOR_SERVO: [Shown; 10] = [
    ("negative_limit_set", "-limit"),
    ("positive_limit_set", "+limit"),
    ("data_block_error", "data-error"),
    ("abort_deceleration", "aborting"),
    ("open_loop", "open-loop"),
    ("home_search_in_progress", "homing"),
    ("dwell_in_progress", "dwell"),
    ("definite_time_move", "timed-move"),
    ("handwheel_enabled", "following"),
    ("following_enabled", "following"),
];

/// Flags of a motor's background status.
const MOTOR_BACKGROUND: [Shown; 11] = [
    ("fatal_following_error", "fatal-error"),
    ("integrated_fatal_following_error", "integrated-fatal-error"),
    ("amplifier_fault", "amplifier-fault"),
    ("i2t_amplifier_fault", "i2t-fault"),
    ("phasing_search_error", "phasing-error"),
    ("phasing_reference_error", "phasing-error"),
    ("stopped_on_position_limit", "limit-stop"),
    ("stopped_on_desired_position_limit", "limit-stop"),
    ("warning_following_error", "warning-error"),
    ("home_complete", "homed"),
    ("in_position", "in-position"),
];

/// Flags of a coordinate system's status words: errors first, then the state.
const SYSTEM: [Shown; 12] = [
    ("run_time_error", "run-time-error"),
    ("circle_radius_error", "radius-error"),
    ("radius_error", "radius-error"),
    ("resume_error", "resume-error"),
    ("desired_position_limit_stop", "limit-stop"),
    ("amplifier_fault", "amplifier-fault"),
    ("fatal_following_error", "fatal-error"),
    ("warning_following_error", "warning-error"),
    ("running_program", "running"),
    ("program_hold_stop", "hold"),
    ("single_step_mode", "single-step"),
    ("in_position", "in-position"),
];

/// The flags for which `word` stands.
pub fn named(word: &str) -> impl Iterator<Item = &'static str> {
    let all = MOTOR_SERVO.iter().chain(&MOTOR_BACKGROUND).chain(&SYSTEM);
    all.filter(move |(_, shown)| *shown == word).map(|(name, _)| *name)
}

fn shown(table: &[Shown], is_set: impl Fn(&str) -> bool) -> Vec<&'static str> {
    table.iter().filter(|(name, _)| is_set(name)).map(|(_, word)| *word).collect()
}

/// The words for a motor's flags that are not ordinary.
pub(super) fn of_motor(servo: Option<Flags>, background: Option<Flags>) -> Vec<&'static str> {
    let mut words = match servo {
        None => vec![NOT_READ],
        Some(status) => {
            let moves = !status.has("desired_velocity_zero") && !status.has("open_loop");
            let mut words = shown(&MOTOR_SERVO, |name| status.has(name));
            words.extend(moves.then_some("moving"));
            words
        }
    };
    words.extend(background.iter().flat_map(|status| shown(&MOTOR_BACKGROUND, |name| status.has(name))));
    words
}

/// The words for a coordinate system's flags, from the status words that are known.
pub fn of_system(words: &[Option<Flags>]) -> Vec<&'static str> {
    shown(&SYSTEM, |name| words.iter().flatten().any(|word| word.has(name)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::FAMILIES;

    #[test]
    fn every_shown_word_stands_for_a_flag_there_is() {
        for (table, word) in [(&MOTOR_SERVO[..], 0), (&MOTOR_BACKGROUND[..], 1)] {
            for (name, _) in table {
                let mut flags = FAMILIES.iter().flat_map(|family| family.status.motor[word].flags);
                assert!(flags.any(|(_, flag)| flag == name), "{name}");
            }
        }
        for (family, name) in FAMILIES
            .iter()
            .flat_map(|family| ["desired_velocity_zero", "open_loop"].map(|name| (family, name)))
        {
            assert!(family.status.motor[0].flags.iter().any(|(_, flag)| *flag == name), "{name}");
        }
        for (name, _) in SYSTEM {
            let tables = FAMILIES.iter().flat_map(|family| family.status.coordinate_system);
            let mut flags = tables.flat_map(|table| table.flags);
            assert!(flags.any(|(_, flag)| *flag == name), "{name}");
        }
    }
}
