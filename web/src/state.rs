//! The board's state as the page shows it, as JSON.

use std::sync::Arc;

use pmac_dpram::client::{Board, ClientError, Motor, Staleness, View, identity};
use pmac_dpram::decode::{BackgroundData, ServoData};
use pmac_dpram::map::DEFAULT_FAMILY;
use pmac_dpram::protocol::board::REPLAY_OVER;
use serde_json::{Map, Value, json};

use crate::watch::Watched;

/// The state without a board: `why` says what to do.
#[must_use]
pub fn absent(name: &str, why: &str) -> Arc<str> {
    text(&json!({ "name": name, "condition": "absent", "reason": why }))
}

/// The state of `board`. Values that are not live stand beside `"fresh": false`.
///
/// # Errors
/// [`ClientError`].
pub fn of(board: &mut Board, watched: &Watched) -> Result<Arc<str>, ClientError> {
    let snapshot = board.snapshot()?;
    let identity = &snapshot.identity;
    let known = identity::family(identity);
    let background = snapshot.background.as_ref().filter(|view| view.is_fresh()).map(|view| &view.data);
    let servo = snapshot.servo.as_ref();
    let motors = servo.map_or_else(Vec::new, |servo| {
        Motor::activated(Motor::all(&servo.data, background, identity, known.unwrap_or(DEFAULT_FAMILY)))
    });
    let motors: Vec<Value> = motors.iter().map(motor).collect();
    let words = snapshot.user.iter().flat_map(|view| &view.data.words);
    let words: Vec<Value> = words.map(|values| values.document(known.unwrap_or(DEFAULT_FAMILY))).collect();
    let systems = snapshot.background.as_ref().map(|view| &view.data.coordinate_systems);
    let subscriber = board.subscriber();
    let (condition, header, now_ns) = (subscriber.condition(), subscriber.header(), subscriber.now_ns());
    let regions: Map<String, Value> = subscriber
        .regions()
        .map(|region| {
            let about = json!({ "state": region.state_at(condition).name(), "published": region.published,
                "period_ns": region.period_ns });
            (region.id.name().to_owned(), about)
        })
        .collect();
    let counters: Map<String, Value> =
        subscriber.counters().map(|(counter, count)| (counter.name().to_owned(), json!(count))).collect();
    let old = snapshot.old().map(|(name, stale)| format!("{name} data: {stale}"));
    let reason = snapshot.stale.map(|stale| stale.to_string()).or(old);
    let is_over = identity.replay && matches!(snapshot.stale, Some(Staleness::BoardSilent));
    let reason = if is_over { Some(REPLAY_OVER.to_owned()) } else { reason };
    Ok(text(&json!({
        "name": board.name().as_str(),
        "condition": if reason.is_some() { "stale" } else { "live" },
        "reason": reason,
        "replay": identity.replay,
        "family": identity.family.and(known).map(|family| family.name),
        "type": identity.board_type,
        "firmware": identity.firmware,
        "servo_period_ns": identity::scales(identity).servo_period_ns(),
        "uptime_s": now_ns.saturating_sub(header.created_ns) as f64 / 1e9,
        "global_flags": global_flags(servo.map(|view| &view.data), background),
        "servo": stamp(snapshot.servo.as_ref()),
        "background": stamp(snapshot.background.as_ref()),
        "user": stamp(snapshot.user.as_ref()),
        "motors": motors,
        "coordinate_systems": systems,
        "words": words,
        "watched": watched.document(),
        "regions": regions,
        "counters": counters,
    })))
}

fn text(document: &Value) -> Arc<str> {
    document.to_string().into()
}

/// The document of `pmacctl motors --json`, and the words of its last column.
fn motor(motor: &Motor<'_>) -> Value {
    let mut document = motor.document();
    document["words"] = json!(motor.flags());
    document
}

fn stamp<T>(view: Option<&View<T>>) -> Value {
    json!({
        "fresh": view.is_some_and(View::is_fresh),
        "stale": view.and_then(|view| view.stale).map(|stale| stale.to_string()),
        "age_ms": view.map(|view| view.age_ns as f64 / 1e6),
        "unix_s": view.map(|view| view.realtime_ns as f64 / 1e9),
        "sequence": view.map(|view| view.sequence),
    })
}

fn global_flags(servo: Option<&ServoData>, background: Option<&BackgroundData>) -> Value {
    let flags = servo.and_then(ServoData::global_flags);
    let flags = flags.or_else(|| background.and_then(BackgroundData::global_flags));
    flags.map_or(Value::Null, |flags| flags.iter().flat_map(|word| word.names()).collect())
}
