//! Times as text: RFC 3339, UTC.

use std::time::{SystemTime, UNIX_EPOCH};

/// The time `ns` nanoseconds after the start of 1970, to the microsecond: `2026-11-21T09:30:00.000123Z`.
pub fn rfc3339(ns: i64) -> String {
    let moment = jiff::Timestamp::from_nanosecond(ns.into());
    // Every i64 of nanoseconds is within jiff's range (years -9999 to 9999).
    moment.unwrap_or_default().strftime("%Y-%m-%dT%H:%M:%S.%6fZ").to_string()
}

/// The time now, to the second: `2026-11-21T09:30:00.000000Z`.
pub fn rfc3339_now() -> String {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    rfc3339(i64::try_from(since).unwrap_or(0).saturating_mul(1_000_000_000))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_moments() {
        assert_eq!(rfc3339(0), "1970-01-01T00:00:00.000000Z");
        assert_eq!(rfc3339(-1), "1969-12-31T23:59:59.999999Z");
        assert_eq!(rfc3339(951_827_696_000_000_000), "2000-02-29T12:34:56.000000Z");
        assert_eq!(rfc3339(1_767_225_599_123_456_789), "2025-12-31T23:59:59.123456Z");
        assert_eq!(rfc3339(4_107_542_400_000_000_000), "2100-03-01T00:00:00.000000Z");
    }
}
