//! `pmacctl status`: the state of the daemon, its board and its data.

use serde_json::{Map, Value, json};

use super::elsewhere;
use crate::cli::context::{Context, Failure, Verdict};
use crate::cli::show::{global_status, programs};
use crate::client::{Board, ClientError, CommandError, Staleness, View};
use crate::format::Visible;
use crate::map::{Family, LACKS_DPRAM, lacks_dpram};
use crate::protocol::board::REPLAY_OVER;
use crate::protocol::function::UNKNOWN_FAMILY;
use crate::protocol::program_words::waits_for;
use crate::protocol::{Function, OpenBufferInfo, ProgramWords};
use crate::segment::{Condition, Identity, SegmentError, SegmentName, UserUnit};

pub fn run(context: &mut Context) -> Result<Verdict, Failure> {
    let document = look(context)?;
    context.output.show(&document, || text(&document))?;
    Ok((document["condition"] == "live").into())
}

/// The document of `status --json`.
pub fn look(context: &Context) -> Result<Value, Failure> {
    let mut board = match context.attach() {
        Ok(board) => board,
        Err(
            error @ (ClientError::Segment(SegmentError::NotFound { .. })
            | ClientError::Socket(CommandError::Connect { .. })),
        ) => return Ok(absent(context, &error)),
        Err(error) => return Err(error.into()),
    };
    let identity = board.identity()?;
    Ok(document(context, &mut board, &identity))
}

/// A daemon that does not run is a valid answer.
fn absent(context: &Context, error: &ClientError) -> Value {
    let name = context.name().ok();
    let name = name.as_ref().map(SegmentName::as_str);
    json!({ "name": name, "condition": ABSENT, "reason": error.to_string() })
}

const ABSENT: &str = "absent";

/// The board's global status, and the programs of its coordinate systems, from fresh data; null and none without fresh
/// data.
fn reported(board: &mut Board) -> (Value, Vec<Value>) {
    let (servo, background) =
        board.snapshot().ok().map(|snapshot| (snapshot.servo, snapshot.background)).unzip();
    let servo = servo.flatten().filter(View::is_fresh).map(|view| view.data);
    let background = background.flatten().filter(View::is_fresh).map(|view| view.data);
    let programs = programs::documents(background.as_ref());
    let global_status = global_status::document(servo.as_ref(), background.as_ref());
    (global_status, programs)
}

/// The first part that is not live, and the reason; `None` if all parts are live. A report that no setting asks the
/// board for is no fault.
fn fault(
    board: &mut Board,
    condition: Condition,
    identity: &Identity,
    socket: &Value,
) -> Option<(&'static str, String)> {
    let subscriber = board.subscriber();
    if condition != Condition::Live {
        let staleness = Staleness::of_segment(condition, &subscriber.header(), subscriber.now_ns());
        return Some((condition_name(condition), staleness.map(|why| why.to_string()).unwrap_or_default()));
    }
    if identity.family.is_none() {
        return Some(("family_unknown", UNKNOWN_FAMILY.to_owned()));
    }
    if let Some((name, stale)) = board.snapshot().ok().and_then(|snapshot| snapshot.old()) {
        return Some(("stale", format!("{name} data: {stale}")));
    }
    let unreachable = socket["reachable"] == false;
    unreachable.then(|| ("unreachable", socket["reason"].as_str().unwrap_or_default().to_owned()))
}

fn condition_name(condition: Condition) -> &'static str {
    match condition {
        Condition::Init => "init",
        Condition::Live => "live",
        Condition::Stale => "stale",
        Condition::Dead => "dead",
        Condition::OwnerGone => "daemon_gone",
        Condition::Replaced => "replaced",
    }
}

fn document(context: &Context, board: &mut Board, identity: &Identity) -> Value {
    let socket = socket(context, board);
    let subscriber = board.subscriber();
    let header = subscriber.header();
    // Read once, so that the whole document agrees.
    let condition = subscriber.condition();
    let now_ns = subscriber.now_ns();
    let age_ms = |since_ns: u64| now_ns.saturating_sub(since_ns) as f64 / 1e6;
    // A daemon that is gone has no uptime.
    let end_ns = if condition.is_over() { header.heartbeat_ns } else { now_ns };
    let regions: Map<String, Value> = subscriber
        .regions()
        .map(|region| {
            let about = json!({
                "state": region.state_at(condition).name(), "published": region.published, "period_ns": region.period_ns, "slots": region.slots,
            });
            (region.id.name().to_owned(), about)
        })
        .collect();
    let counters: Map<String, Value> =
        subscriber.counters().map(|(counter, value)| (counter.name().to_owned(), json!(value))).collect();
    let segment = subscriber.path().to_owned();
    let (fault, mut reason) = fault(board, condition, identity, &socket).unzip();
    if fault == Some("stale") && socket["replay"]["over"] == true {
        reason = Some(REPLAY_OVER.to_owned());
    }
    let (global_status, programs) = reported(board);
    let family = identity.family.and_then(Family::by_number).map(|family| family.name);
    json!({
        "name": board.name().as_str(),
        "segment": segment,
        "condition": fault.unwrap_or("live"),
        "reason": reason,
        "generation": header.generation,
        "owner_pid": header.owner_pid,
        "owner_uid": header.owner_uid,
        "heartbeat_age_ms": age_ms(header.heartbeat_ns),
        "family": family,
        "uptime_s": end_ns.saturating_sub(header.created_ns) as f64 / 1e9,
        "board": {
            "family": family,
            "type": identity.board_type,
            "firmware": identity.firmware,
            "motors": identity.motors,
            "reported_motors": identity.reported_motors(),
            "motors_of_reports": identity.motor_mask.map(in_mask),
            "servo_period_ns": identity.servo_period_ps.map(|ps| ps as f64 / 1e3),
            "servo_report_cycles": identity.servo_report_cycles,
            "named_motors": named_motors(identity),
        },
        "global_status": global_status,
        "programs": programs,
        "regions": regions,
        "counters": counters,
        "socket": socket,
    })
}

/// The motors of a mask, bit 0 for motor 1.
fn in_mask(mask: u32) -> Vec<usize> {
    (1..=u32::BITS as usize).filter(|motor| mask >> (motor - 1) & 1 == 1).collect()
}

/// The number of reported motors, and their numbers unless they are the first motors.
fn reports(motors: &[Value]) -> String {
    let plural = if motors.len() == 1 { "" } else { "s" };
    let count = format!("{} motor{plural}", motors.len());
    if (1..).zip(motors).all(|(number, motor)| *motor == number) {
        return count;
    }
    let numbers: Vec<_> = motors.iter().map(Value::to_string).collect();
    format!("{count}: {}", numbers.join(", "))
}

/// The motors that the configuration gives a name or a unit.
fn named_motors(identity: &Identity) -> Vec<Value> {
    let motors = (1..).zip(identity.names.iter().zip(&identity.units));
    let named = motors.filter(|(_, (name, unit))| name.is_some() || unit.is_some());
    let document = |(motor, (name, unit)): (usize, (&Option<_>, &Option<UserUnit>))| {
        json!({ "motor": motor, "name": name, "unit": unit.map(|unit| unit.name),
            "counts_per_unit": unit.map(|unit| unit.counts_per_unit) })
    };
    named.map(document).collect()
}

/// The daemon's answer over its socket.
fn socket(context: &Context, board: &mut Board) -> Value {
    let path = context.socket();
    let asked = board
        .connection()
        .and_then(|connection| Ok((connection.info()?, connection.settings().unwrap_or_default())));
    match asked {
        Ok((info, settings)) => json!({ "path": path, "reachable": true, "version": info.version,
            "board": info.board, "enabled": info.enabled, "functions": settings.functions,
            "command_port": info.lines.command_port, "port_faults": info.lines.port_faults(),
            "control_characters": info.lines.control_characters, "open_buffer": open_buffer(info.open_buffer.as_ref()),
            "open_buffer_unsaid": info.lines.open_buffer_unsaid,
            "replay": info.replay.map(|replay| json!({ "over": replay.over,
                "differences": replay.differences, "text": replay.to_string() })),
            "host_port": info.host_port, "unfinished": info.unfinished, "notes": info.notes,
            "elsewhere": elsewhere::documents(&info.elsewhere), "waiting": info.waiting, "definitions": info.lines.definitions,
            "program_words": info.program_words.iter().map(program_words).collect::<Vec<_>>() }),
        Err(error) => json!({ "path": path, "reachable": false, "reason": error.to_string() }),
    }
}

/// M-variables that point into a function's words: the fields, and their text.
fn program_words(words: &ProgramWords) -> Value {
    let mut document = json!(words);
    document["text"] = words.to_string().into();
    document
}

/// The open program buffer: its fields, and its text.
fn open_buffer(open: Option<&OpenBufferInfo>) -> Value {
    open.map_or(Value::Null, |open| {
        json!({ "name": open.name, "uid": open.uid, "pid": open.pid, "sequence": open.sequence,
            "text": open.to_string() })
    })
}

/// The document as text: a line for each known fact.
fn text(document: &Value) -> String {
    if document["condition"] == ABSENT {
        let [name, reason] = ["name", "reason"].map(|key| document[key].as_str());
        let name = name.map_or_else(String::new, |name| format!("{name}: "));
        return format!("{}\n", Visible(name + reason.unwrap_or_default()));
    }
    let lines = lines(document);
    lines.into_iter().map(|(what, value)| format!("{what:<15} {value}\n")).collect()
}

/// Each known fact of the document: its subject, and its text.
pub fn lines(document: &Value) -> Vec<(String, String)> {
    let mut lines = Vec::new();
    let mut say = |what: &str, value: String| lines.push((what.to_owned(), Visible(value).to_string()));
    say("name", plain(&document["name"]));
    let reason = document["reason"].as_str().map_or_else(String::new, |reason| format!(": {reason}"));
    say("condition", plain(&document["condition"]) + &reason);
    if document["condition"] == ABSENT {
        return lines;
    }
    let pid = plain(&document["owner_pid"]);
    let age = document["heartbeat_age_ms"].as_f64().unwrap_or_default();
    let uptime = document["uptime_s"].as_f64().unwrap_or_default();
    let gone = ["dead", "daemon_gone", "replaced"].iter().any(|name| document["condition"] == *name);
    let up = if gone { "gone after" } else { "up" };
    say("daemon", format!("process {pid}, {up} {uptime:.0} s, last heartbeat {age:.0} ms ago"));
    let board = &document["board"];
    let known = ["type", "family", "firmware"].map(|key| &board[key]);
    let known: Vec<_> = known.into_iter().filter(|value| !value.is_null()).map(plain).collect();
    say("board", if known.is_empty() { "not identified".to_owned() } else { known.join(", ") });
    if board["type"].as_str().is_some_and(lacks_dpram) {
        say("warning", LACKS_DPRAM.to_owned());
    }
    if let Some(motors) = board["motors_of_reports"].as_array() {
        say("reports", reports(motors));
    }
    for motor in board["named_motors"].as_array().into_iter().flatten() {
        let name = motor["name"].as_str().map_or_else(String::new, |name| format!(" {name}"));
        let unit = motor["unit"].as_str();
        let unit =
            unit.map_or_else(String::new, |unit| format!(", {} counts a {unit}", motor["counts_per_unit"]));
        say("motor", format!("#{}{name}{unit}", motor["motor"]));
    }
    if let Some(period) = board["servo_period_ns"].as_f64() {
        say("servo", format!("{:.3} us, {:.1} Hz", period / 1e3, 1e9 / period));
    }
    if let Some(text) = global_status::text(&document["global_status"]) {
        say("global status", text);
    }
    for program in document["programs"].as_array().into_iter().flatten() {
        say("program", programs::text(program));
    }
    for (name, region) in document["regions"].as_object().into_iter().flatten() {
        let live = region["state"] == "live";
        let period = region["period_ns"].as_f64().filter(|period| live && *period > 0.0);
        let rate = period.map_or_else(String::new, |period| format!(", {:.1} Hz", 1e9 / period));
        let text = format!("{}, {} published{rate}", plain(&region["state"]), region["published"]);
        say(&format!("{name} data"), text);
    }
    let counters = &document["counters"];
    let counts = ["updates", "lost", "missed", "skipped", "retries", "bus_errors"];
    say("counters", counts.map(|name| format!("{name}={}", counters[name])).join(" "));
    let socket = &document["socket"];
    match socket["reachable"] == true {
        true => socket_lines(socket, say),
        false => say("socket", plain(&socket["reason"])),
    }
    lines
}

fn plain(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

/// Prints the daemon's answer over its socket.
fn socket_lines(socket: &Value, mut say: impl FnMut(&str, String)) {
    if let Some(text) = socket["replay"]["text"].as_str() {
        say("replay", text.to_owned());
    }
    let enabled: Vec<_> = socket["enabled"].as_array().into_iter().flatten().map(plain).collect();
    say("socket", plain(&socket["path"]));
    say("enabled", enabled.join(" "));
    let functions = socket["functions"].as_array();
    let used: Vec<_> = functions.into_iter().flatten().map(plain).collect();
    if used.is_empty() {
        say("functions", format!("none: {UNKNOWN_FAMILY}"));
    } else if used.len() < Function::ALL.len() {
        say("functions", used.join(" "));
    }
    let taken = functions.is_some_and(|functions| functions.iter().any(|name| name == "ascii"));
    let port = match &socket["command_port"] {
        _ if !taken => "off by the daemon's configuration",
        Value::String(port) if port == "mailbox" => "through the VME mailboxes",
        _ if enabled.iter().any(|name| name == "interrupt") => "through the DPRAM",
        _ => "through the DPRAM; no interrupt comes, so replies are polled for",
    };
    say("command lines", port.to_owned());
    for fault in socket["port_faults"].as_array().into_iter().flatten() {
        say("warning", plain(fault));
    }
    if let Some(text) = socket["open_buffer"]["text"].as_str() {
        say("open buffer", text.to_owned());
    } else if socket["open_buffer_unsaid"] == true {
        say("open buffer", "not known: no report tells, and the board refuses SIZE".to_owned());
    }
    let host_port = &socket["host_port"];
    if !host_port.is_null() {
        let count = |name: &str| plain(&host_port[name]);
        let (name, line) = (plain(&host_port["controller"]), count("line"));
        let counts = ["served", "old", "unannounced"].map(|name| format!("{name}={}", count(name)));
        say("host port", format!("{name} line {line}: {}", counts.join(" ")));
    }
    for change in socket["elsewhere"].as_array().into_iter().flatten() {
        say("elsewhere", plain(&change["text"]));
    }
    let waiting: Vec<_> = socket["waiting"].as_array().into_iter().flatten().map(plain).collect();
    if !waiting.is_empty() {
        let definitions = serde_json::from_value(socket["definitions"].clone()).unwrap_or_default();
        let why = waits_for(!socket["open_buffer"].is_null(), &definitions);
        say("not used yet", format!("{}: {why}", waiting.join(", ")));
    }
    for words in socket["program_words"].as_array().into_iter().flatten() {
        say("programs' words", plain(&words["text"]));
    }
    for sentence in socket["unfinished"].as_array().into_iter().flatten() {
        say("unfinished", plain(sentence));
    }
    for note in socket["notes"].as_array().into_iter().flatten() {
        say("note", plain(note));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_board_that_has_no_dpram_by_its_type_is_warned_of() {
        let warnings = |board_type: Option<&str>| {
            let document = json!({ "condition": "live", "board": { "type": board_type } });
            lines(&document).into_iter().filter(|(what, _)| what == "warning").collect::<Vec<_>>()
        };
        let told = warnings(Some("PMAC1, STD, BATTERY, PID, CLK X1"));
        assert!(told.len() == 1 && told[0].1.contains("PMAC STD"), "{told:?}");
        assert!(warnings(Some("PMAC1, ISA, FLASH")).is_empty() && warnings(None).is_empty());
    }

    #[test]
    fn replies_without_an_interrupt_are_told_as_polled() {
        let told = |enabled: &[&str]| {
            let mut said = String::new();
            let socket = json!({"enabled": enabled, "functions": ["ascii"], "command_port": "dpram"});
            socket_lines(&socket, |title, text| said += &format!("{title}: {text}\n"));
            said
        };
        let port = "command lines: through the DPRAM";
        assert!(told(&["ascii", "interrupt"]).contains(&format!("{port}\n")));
        assert!(
            told(&["ascii"]).contains(&format!("{port}; no interrupt comes, so replies are polled for\n"))
        );
    }
}
