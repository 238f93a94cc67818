//! Date and time as `TODAY` and `TIME` report them. A board without the clock option takes the time of its reset for midnight
//! of January 1, 2000, a Saturday (Turbo Software Reference pp. 397-398).

const DAY: u64 = 24 * 60 * 60;
const WEEK: [&str; 7] = ["SAT", "SUN", "MON", "TUE", "WED", "THU", "FRI"];

/// `{day} {mm}/{dd}/{yyyy}`, so many seconds after the reset.
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
}
