//! Which motors a command line moves by name: nobody but its holder moves a motor whose jog is held.

use super::line;

/// The motors that `line` names (`#n`) and moves: by `J+ J- J= J: J^`, `HM`, `O` or `$`; bit 0 is motor 1. What stops a motor,
/// `J/` or `K`, does not count. Of a motor that is addressed already, by an earlier line, nothing is known.
#[must_use]
pub fn motors_moved(line: &str) -> u32 {
    let line = line::plain(line);
    let of_a_motor = line::addressed(&line, '#').map(|(bit, commands)| if moves(commands) { bit } else { 0 });
    of_a_motor.fold(0, |mask, bit| mask | bit)
}

/// Whether `commands`, to one motor, move it.
fn moves(commands: &str) -> bool {
    // Of another coordinate system, or a definition.
    let commands = commands.split('&').next().unwrap_or_default();
    if commands.starts_with("->") {
        return false;
    }
    let jogs =
        commands.match_indices('J').any(|(at, _)| commands[at + 1..].starts_with(['+', '-', '=', ':', '^']));
    jogs || commands.contains("HM") || commands.starts_with(['O', '$'])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn b2_6_a_line_tells_which_motors_it_moves() {
        for (line, motors) in [
            ("#1J+", 0b1),
            ("# 2 j -", 0b10),
            ("#3J=5000#1", 0b100),
            ("#1J+#2J/#4HM", 0b1001),
            ("#32HMZ", 1 << 31),
            ("#2O10", 0b10),
            ("#2$", 0b10),
            ("#1J/", 0),
            ("#1K", 0),
            ("#1P#2V", 0),
            ("&1 #1->X #2->Y", 0),
            ("J+", 0),
            ("#0J+", 0),
            ("#33J+", 0),
            ("#99999999999J+", 0),
            ("I122=32", 0),
            ("#1&1H", 0),
            ("SEND\"#1J+\"", 0),
        ] {
            assert_eq!(motors_moved(line), motors, "{line}");
        }
    }
}
