//! How the kernel schedules this process. The unit or `chrt` sets that; this module only reports it.

use std::fs;

/// The calling process's policy and, where it has one, its real-time priority: `other`, `fifo 20`.
///
/// From fields 40 and 41 of its `stat` (proc(5)); `unknown` where that cannot be read.
#[must_use]
pub fn scheduling() -> String {
    let stat = fs::read_to_string("/proc/self/stat").unwrap_or_default();
    parse(&stat).unwrap_or_else(|| "unknown".to_owned())
}

fn parse(stat: &str) -> Option<String> {
    // The second field, a name in brackets, may contain anything; the third begins behind the last bracket.
    let mut fields = stat.rsplit_once(") ")?.1.split_whitespace().skip(40 - 3);
    let (priority, policy) = (fields.next()?, fields.next()?);
    Some(match policy {
        "0" => "other".to_owned(),
        "1" => format!("fifo {priority}"),
        "2" => format!("round-robin {priority}"),
        "3" => "batch".to_owned(),
        "5" => "idle".to_owned(),
        "6" => "deadline".to_owned(),
        other => format!("policy {other}"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stat(priority: u32, policy: u32) -> String {
        let before = (4..40).map(|field| field.to_string()).collect::<Vec<_>>().join(" ");
        format!("17 (a) S 9 (pmacd) S {before} {priority} {policy} 0 0")
    }

    #[test]
    fn policy_and_priority_are_told() {
        assert_eq!(parse(&stat(0, 0)).as_deref(), Some("other"));
        assert_eq!(parse(&stat(20, 1)).as_deref(), Some("fifo 20"));
        assert_eq!(parse(&stat(0, 9)).as_deref(), Some("policy 9"));
        assert_eq!(parse("17 (pmacd) S 1"), None);
        assert_ne!(scheduling(), "unknown");
    }
}
