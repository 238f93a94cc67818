//! Other hosts' activity and changes on the board, as sentences.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde_json::{Value, json};

use crate::cli::console::rfc3339;
use crate::protocol::board::Elsewhere;

/// Each of them as JSON, with its sentence as `text`.
pub fn documents(all: &[Elsewhere]) -> Vec<Value> {
    let now = SystemTime::now();
    let document = |one: &Elsewhere| {
        let Elsewhere { what, was, is, ago_ms } = one;
        json!({ "what": what, "was": was, "is": is, "ago_ms": ago_ms, "text": sentence(one, now) })
    };
    all.iter().map(document).collect()
}

/// The fact, and the time of its begin.
fn sentence(one: &Elsewhere, now: SystemTime) -> String {
    let since = one.ago_ms.and_then(|ago| clock(now.checked_sub(Duration::from_millis(ago))?));
    let since = since.map_or_else(String::new, |time| format!(" since {time}"));
    match (one.what.as_str(), one.was, one.is) {
        ("program_buffer", ..) => {
            "a program buffer is open: opened by another host, or before pmacd started; CLOSE by an engineer closes it".to_owned()
        }
        ("gather", ..) => {
            "the board gathers: begun by hand or by another host; pmacctl gather --stop ends it".to_owned()
        }
        ("command_lines", ..) => format!(
            "no command line has been answered{since}, though the board lives: it may still come up after a reset, or another host may \
             have set I58 to 0; pmacctl doctor names the cure"
        ),
        (variable, Some(was), Some(is)) => {
            format!("{variable} is {is}, was {was}: changed{since} by another host, or by a program of the board")
        }
        (what, ..) => format!("{what}: changed{since} by another host"),
    }
}

/// The time of day.
fn clock(time: SystemTime) -> Option<String> {
    let ns = i64::try_from(time.duration_since(UNIX_EPOCH).ok()?.as_nanos()).ok()?;
    rfc3339(ns).get(11..19).map(|clock| format!("{clock} UTC"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_others_have_changed_is_said_with_the_time() {
        let now = UNIX_EPOCH + Duration::from_secs(951_827_696);
        let say = |what: &str, values: Option<(i64, i64)>, ago_ms| {
            let (was, is) = values.unzip();
            sentence(&Elsewhere { what: what.to_owned(), was, is, ago_ms }, now)
        };
        let told = say("I2", Some((3, 1)), Some(56_000));
        assert_eq!(
            told,
            "I2 is 1, was 3: changed since 12:34:00 UTC by another host, or by a program of the board"
        );
        let told = say("command_lines", None, Some(56_000));
        assert!(told.starts_with("no command line has been answered since 12:34:00 UTC"), "{told}");
        assert!(say("program_buffer", None, None).contains("opened by another host"));
        assert!(say("gather", None, None).contains("gather --stop"));
        assert_eq!(say("something", None, None), "something: changed by another host");
    }
}
