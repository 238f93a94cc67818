//! Date and time as `TODAY` and `TIME` report and set them. A board without the clock option takes the time of its
//! reset for midnight of January 1, 2000, a Saturday, and forgets at the next reset the time that a host has set (Turbo
//! Software Reference pp. 397-398).

const DAY: u64 = 24 * 60 * 60;
const WEEK: [&str; 7] = ["SAT", "SUN", "MON", "TUE", "WED", "THU", "FRI"];

/// The clock: how many seconds it shows beyond those since the reset.
#[derive(Debug, Clone, Copy, Default)]
pub struct Clock {
    beyond: i64,
}

impl Clock {
    /// Seconds since the year 2000 began, `up` seconds after the reset.
    #[must_use]
    pub fn now(self, up: u64) -> u64 {
        up.saturating_add_signed(self.beyond)
    }

    /// Sets the time of the day, in seconds.
    pub fn set_time(&mut self, up: u64, of_day: u64) {
        self.set(up, self.now(up) / DAY * DAY + of_day);
    }

    /// Sets the date, in days since the year 2000 began. The time of the day goes on.
    pub fn set_date(&mut self, up: u64, days: u64) {
        self.set(up, days * DAY + self.now(up) % DAY);
    }

    fn set(&mut self, up: u64, now: u64) {
        self.beyond = now.cast_signed() - up.cast_signed();
    }
}

/// The second of the day at this time; `None` for a time that no clock shows.
#[must_use]
pub fn second([hours, minutes, seconds]: [u64; 3]) -> Option<u64> {
    (hours < 24 && minutes < 60 && seconds < 60).then_some(hours * 3600 + minutes * 60 + seconds)
}

/// Days from the beginning of the year 2000 to this date, up to the year 9999; `None` for a date that no calendar has.
#[must_use]
pub fn day([month, day, year]: [u64; 3]) -> Option<u64> {
    let exists = (2000..10_000).contains(&year) && (1..=12).contains(&month) && day >= 1;
    if !exists || day > length(year, month) {
        return None;
    }
    let months = (2000..year).flat_map(|year| (1..=12).map(move |month| (year, month)));
    let before = months.chain((1..month).map(|month| (year, month)));
    Some(before.map(|(year, month)| length(year, month)).sum::<u64>() + day - 1)
}

/// `{day} {mm}/{dd}/{yyyy}`, `seconds` after the year 2000 began.
#[must_use]
pub fn date(seconds: u64) -> String {
    let days = seconds / DAY;
    let (mut year, mut month, mut left) = (2000, 1, days);
    while left >= length(year, month) {
        left -= length(year, month);
        (year, month) = if month == 12 { (year + 1, 1) } else { (year, month + 1) };
    }
    format!("{} {month:02}/{:02}/{year}", WEEK[(days % 7) as usize], left + 1)
}

/// `{hh}:{mm}:{ss}`.
#[must_use]
pub fn time(seconds: u64) -> String {
    format!("{:02}:{:02}:{:02}", seconds % DAY / 3600, seconds / 60 % 60, seconds % 60)
}

/// Days of a month.
const fn length(year: u64, month: u64) -> u64 {
    match month {
        2 if year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400)) => 29,
        2 => 28,
        4 | 6 | 9 | 11 => 30,
        _ => 31,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_clock_begins_with_the_year_2000() {
        assert_eq!((date(0).as_str(), time(0).as_str()), ("SAT 01/01/2000", "00:00:00"));
        assert_eq!(date(59 * DAY + DAY - 1), "TUE 02/29/2000");
        assert_eq!(time(59 * DAY + DAY - 1), "23:59:59");
        assert_eq!(date(366 * DAY), "MON 01/01/2001");
    }

    #[test]
    fn dates_are_counted_both_ways() {
        for (parts, text) in [
            ([1, 1, 2000], "SAT 01/01/2000"),
            ([2, 29, 2024], "THU 02/29/2024"),
            ([12, 31, 2099], "THU 12/31/2099"),
            ([3, 1, 2100], "MON 03/01/2100"),
        ] {
            assert_eq!(date(day(parts).unwrap() * DAY), text);
        }
        for parts in [[2, 29, 2023], [2, 29, 2100], [0, 1, 2000], [13, 1, 2000], [1, 0, 2000], [1, 1, 1999]] {
            assert_eq!(day(parts), None, "{parts:?}");
        }
        assert_eq!(
            (second([23, 59, 59]), second([24, 0, 0]), second([0, 60, 0])),
            (Some(DAY - 1), None, None)
        );
    }
}
