//! Which motors a command line moves by name, and which of them go on without an end.

use super::line;

/// The motors that `line` names (`#n`) and moves: by `J+ J- J= J: J^`, `HM`, `HOME`, `O` or `$`; bit 0 is motor 1. What stops a motor,
/// `J/` or `K`, does not count. Of a motor that is addressed already, by an earlier line, nothing is known.
#[must_use]
pub fn motors_moved(line: &str) -> u32 {
    let moved = |line: &String| {
        let of_a_motor =
            line::addressed(line, '#').map(|(bit, commands)| if moves(commands) { bit } else { 0 });
        of_a_motor.fold(0, |mask, bit| mask | bit)
    };
    readings(line).iter().map(moved).fold(0, |mask, bits| mask | bits)
}

/// The line's commands, in both ways in which boards read `##3`.
fn readings(line: &str) -> [String; 2] {
    let plain = line::plain(line);
    [line::without_questions(&plain), line::without_questions(&line::without_groups(&plain))]
}

/// Whether `commands`, to one motor, move it.
fn moves(commands: &str) -> bool {
    if commands.starts_with("->") {
        return false;
    }
    let has = |sign, wanted: fn(&str, &str) -> bool| {
        commands.match_indices(sign).any(|(at, _)| wanted(&commands[..at], &commands[at..]))
    };
    has('J', |_, from| from[1..].starts_with(['+', '-', '=', ':', '^']))
        || ["HM", "HOME"].iter().any(|word| commands.contains(word))
        || has('O', |_, from| opens_loop(from))
        || has('$', |before, _| !before.ends_with(is_before_number))
}

/// Whether `c` stands before the `$` of a hexadecimal number or address, and not before the `$` that phases a motor. `P$` and `F$`
/// report and phase; `RF$`, `DP:$` are addresses, and count for a command here.
fn is_before_number(c: char) -> bool {
    "=+-*/%&|^(,:XYLD".contains(c)
}

/// What follows the addresses that `commands` begin with.
fn behind_addresses(commands: &str) -> &str {
    commands.trim_start_matches(|c: char| c == '&' || c.is_ascii_digit())
}

/// Whether `commands` begin with `O` and an output: neither `OPEN` nor a word with an O in it.
fn opens_loop(commands: &str) -> bool {
    commands
        .strip_prefix('O')
        .is_some_and(|output| output.starts_with(|c: char| c.is_ascii_digit() || "-.$(".contains(c)))
}

/// The motors that jog on when a line has been carried out, until something stops them: by `J+` or `J-`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct EndlessJogs {
    /// Those that the line names; bit 0 is motor 1.
    pub motors: u32,
    /// It jogs a motor, too, that an earlier line has addressed.
    pub unnamed: bool,
}

impl EndlessJogs {
    /// Of `line`, which the board has carried out.
    #[must_use]
    pub fn of(line: &str) -> Self {
        let [one, other] = readings(line);
        Self::of_plain(&one).or(Self::of_plain(&other))
    }

    /// Of `line`, which the board has refused: what stands before the command that it refused is carried out (boards are known to
    /// do so, GRAMMAR 1). Which command that was nobody knows, so every jog counts, whatever stands behind it, but for the
    /// last command, which is not carried out in any case.
    #[must_use]
    pub fn of_refused(line: &str) -> Self {
        let is_last = line.trim_end().ends_with(['+', '-']);
        let [one, other] = readings(line);
        Self::of_refused_plain(&one, is_last).or(Self::of_refused_plain(&other, is_last))
    }

    fn of_refused_plain(line: &str, is_last: bool) -> Self {
        let last = line.strip_suffix("J+").or_else(|| line.strip_suffix("J-"));
        let line = last.filter(|_| is_last).unwrap_or(line);
        let unnamed = jogs(line.split('#').next().unwrap_or_default());
        let motors = line::addressed(line, '#').filter(|(_, commands)| jogs(commands));
        Self { motors: motors.fold(0, |motors, (bit, _)| motors | bit), unnamed }
    }

    /// Of `line`, whatever becomes of it: those that may jog on.
    #[must_use]
    pub fn possible(line: &str) -> Self {
        Self::of(line).or(Self::of_refused(line))
    }

    /// Those of both.
    #[must_use]
    pub const fn or(self, other: Self) -> Self {
        Self { motors: self.motors | other.motors, unnamed: self.unnamed || other.unnamed }
    }

    fn of_plain(line: &str) -> Self {
        let unnamed = jogs_on(line.split('#').next().unwrap_or_default()) == Some(true);
        let motors = line::addressed(line, '#').fold(0, |motors, (bit, commands)| match jogs_on(commands) {
            Some(true) => motors | bit,
            Some(false) => motors & !bit,
            None => motors,
        });
        Self { motors, unnamed }
    }

    /// Whether any motor jogs on.
    #[must_use]
    pub const fn any(self) -> bool {
        self.motors != 0 || self.unnamed
    }
}

/// Whether `commands` to a motor have a jog without an end in them.
fn jogs(commands: &str) -> bool {
    commands.contains("J+") || commands.contains("J-")
}

/// Whether a motor jogs on behind `commands` to it; `None` where they do not say. What is not known to end a jog does not.
fn jogs_on(commands: &str) -> Option<bool> {
    let jog = commands.rmatch_indices('J').find_map(|(at, _)| {
        let behind = &commands[at + 1..];
        let goes_on = behind.starts_with(['+', '-']);
        (goes_on || behind.starts_with(['/', '=', ':', '^']))
            .then(|| (goes_on, behind.get(1..).unwrap_or_default()))
    });
    let behind = behind_addresses(jog.map_or(commands, |(_, behind)| behind));
    // `HMZ` only says where the motor is.
    let homes = behind.strip_prefix("HM").is_some_and(|behind| !behind.starts_with('Z'));
    let does_otherwise = behind.starts_with('K') || homes || opens_loop(behind);
    if does_otherwise { Some(false) } else { jog.map(|(goes_on, _)| goes_on) }
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
            ("#1&2J+", 0b1),
            ("#2 &1 HM", 0b10),
            ("#3 HOME", 0b100),
            ("#3HOMEZ", 0b100),
            ("#1KO10", 0b1),
            ("#1 K O-5", 0b1),
            ("#1P$", 0b1),
            ("#1 F $ #2", 0b1),
            ("#1 RX$700", 0),
            ("#1 I122=$20", 0),
            ("#1 DEFINE ROT 5", 0),
            ("#2 OPEN PROG 5", 0),
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

    #[test]
    fn d7_a_line_tells_which_motors_jog_on() {
        for (line, motors, unnamed) in [
            ("#1J+", 0b1, false),
            ("# 2 j - #4 J+", 0b1010, false),
            ("#1&2J+", 0b1, false),
            ("#1J+#1J/", 0, false),
            ("#1J+J/", 0, false),
            ("#1J/J-#2J+K", 0b1, false),
            ("#1J+#1K", 0, false),
            ("#1J+#1&2O10", 0, false),
            ("#1J+ OPEN PLC 5", 0b1, false),
            ("#1J+ P1=5", 0b1, false),
            ("#1J=500", 0, false),
            ("#1J^-500", 0, false),
            ("#1HM", 0, false),
            ("#1J+HM", 0, false),
            ("#1J+HMZ", 0b1, false),
            ("##J+", 0, true),
            ("#2##J+", 0b10, false),
            ("##2J+", 0b10, true),
            ("#1##2J+", 0b11, false),
            ("##0J+", 0, true),
            ("J+", 0, true),
            ("J+#2J-", 0b10, true),
            ("#1->J", 0, false),
            ("#99J+", 0, false),
            ("SEND\"#1J+\"", 0, false),
        ] {
            assert_eq!(EndlessJogs::of(line), EndlessJogs { motors, unnamed }, "{line}");
        }
    }

    #[test]
    fn d7_every_jog_in_a_refused_line_counts_but_one_that_is_its_last_command() {
        for (line, motors, unnamed) in [
            ("#1J+", 0, false),
            ("#1 j -", 0, false),
            ("#1J+#2J-", 0b1, false),
            ("#1J+J+", 0b1, false),
            ("#2J/J+", 0, false),
            ("#1J+ FOO", 0b1, false),
            ("#1J+K5", 0b1, false),
            ("#1J-O200", 0b1, false),
            ("#1J+J^X", 0b1, false),
            ("#1J- J:X", 0b1, false),
            ("#1J+#1J/#3", 0b1, false),
            ("J+K5#2J-FOO", 0b10, true),
            ("SEND\"#1J+\" FOO", 0, false),
            ("#1J+\"", 0b1, false),
            ("#1J+ \"FOO", 0b1, false),
            ("##J+ FOO", 0, true),
        ] {
            assert_eq!(EndlessJogs::of_refused(line), EndlessJogs { motors, unnamed }, "{line}");
        }
        assert_eq!(EndlessJogs::possible("J+K5"), EndlessJogs { motors: 0, unnamed: true });
        assert_eq!(EndlessJogs::possible("#1J+#2J-K"), EndlessJogs { motors: 0b11, unnamed: false });
    }
}
