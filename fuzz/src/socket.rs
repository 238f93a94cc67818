//! The command socket: messages as a hostile client writes them, cut out of the stream, read and judged as the daemon does
//! it before anything reaches the thread that owns the board.

use std::cell::RefCell;

use pmac_dpram::daemon::shared::info::Info;
use pmac_dpram::daemon::shared::job::Job;
use pmac_dpram::daemon::socket::jobs::JobAt;
use pmac_dpram::daemon::socket::methods::{Action, Ask, parse_call};
use pmac_dpram::daemon::socket::policy::{Characters, Role};
use pmac_dpram::map::pmac;
use pmac_dpram::map::{PMAC, TURBO2};
use pmac_dpram::protocol::message::encode;
use pmac_dpram::protocol::{
    BOARD, BoardInfo, BoardSettings, CALL_MAX, Call, Inbox, LINE_MAX, READ_MAX, Reply,
};

/// First byte: the caller's role and whether method and parameters are wrapped up; second: where the stream is cut.
pub fn body(data: &[u8]) {
    let [way, cut, rest @ ..] = data else { return };
    let role = Role::ALL[usize::from(way % 4)];
    if way & 0x80 != 0 {
        return one_call(rest, role);
    }
    let mut inbox = Inbox::new(CALL_MAX);
    let mut found = Vec::new();
    for chunk in rest.chunks(usize::from(*cut) + 1) {
        assert!(!inbox.is_full());
        inbox.push(chunk);
        while let Some(message) = inbox.next_message().expect("no input is as long as the limit") {
            found.push(message);
        }
    }
    let whole = rest.split(|&byte| byte == 0).count() - 1;
    assert_eq!(found.len(), whole);
    assert_eq!(inbox.is_half_sent(), rest.last().is_some_and(|&last| last != 0));
    for message in &found {
        assert!(!message.contains(&0));
        handle(message, role);
    }
}

/// The method's name, a line end, and the parameters: a call without its envelope, so that parameters are got at.
fn one_call(text: &[u8], role: Role) {
    let mut parts = text.splitn(2, |&byte| byte == b'\n');
    let method = String::from_utf8_lossy(parts.next().unwrap_or_default()).into_owned();
    let Ok(parameters) = serde_json::from_slice(parts.next().unwrap_or(b"{}")) else { return };
    let mut call = Call::new(format!("{BOARD}.{method}"), parameters);
    call.more = Some(true);
    judge(&call, role);
}

fn handle(message: &[u8], role: Role) {
    let Ok(call) = serde_json::from_slice::<Call>(message) else { return };
    let again: Call = serde_json::from_slice(encode(&call).strip_suffix(b"\0").unwrap()).unwrap();
    // A flag that is off is left out, and the last digit of a number with more than 15 may be another.
    let names =
        |call: &Call| call.parameters.iter().flatten().map(|(name, _)| name.clone()).collect::<Vec<_>>();
    assert_eq!((&again.method, names(&again)), (&call.method, names(&call)));
    judge(&call, role);
}

fn judge(call: &Call, role: Role) {
    thread_local!(static INFOS: RefCell<[Info; 2]> = RefCell::new(
        [&PMAC, &TURBO2].map(|family| Info::new(family, BoardInfo::default(), BoardSettings::default()))
    ));
    let which = call.method.len() % 2;
    let action = INFOS.with_borrow(|infos| parse_call(call, role, Characters::default(), &infos[which]));
    match action {
        Err(error) => {
            let reply = Reply::of_error(&error);
            assert_eq!(through_the_wire(&reply).error(), Some(error));
        }
        Ok(Action::Reply(reply)) => drop(through_the_wire(&reply)),
        Ok(
            Action::CheckReset
            | Action::Info
            | Action::Stream
            | Action::Renew
            | Action::RenewJogs
            | Action::Sequence(_),
        ) => {}
        Ok(Action::Trace(_) | Action::Note(_)) => assert_eq!(role, Role::Engineer),
        Ok(Action::StopByLine(..)) => assert!(role >= Role::Stop),
        Ok(Action::Watch(entries)) => assert!(!entries.is_empty()),
        Ok(Action::Ask(ask)) => within_bounds(&ask, role),
    }
}

fn through_the_wire(reply: &Reply) -> Reply {
    let bytes = encode(reply);
    let (end, message) = bytes.split_last().unwrap();
    assert!(*end == 0 && !message.contains(&0));
    let read: Reply = serde_json::from_slice(message).unwrap();
    assert_eq!(read.error, reply.error);
    read
}

/// What the thread that owns the board may rely on.
fn within_bounds(ask: &Ask, role: Role) {
    match ask {
        Ask::Send { line, timeout, .. } => {
            assert!(role == Role::Engineer && (1..=600_000).contains(&timeout.as_millis()));
            let line = line.as_bytes();
            assert!((1..=LINE_MAX).contains(&line.len()) && line.iter().all(|byte| (32..127).contains(byte)));
        }
        Ask::Order(_) => assert!(role >= Role::Operate),
        Ask::Control { character, .. } => assert!(role >= Role::Stop && (1..=31).contains(character)),
        Ask::Read { first, count } => {
            assert!((1..=READ_MAX).contains(count) && first.bytes() < 1 << 20 && first.bytes() % 2 == 0);
        }
        Ask::Job(call) => {
            assert!(call.timeout.as_secs() <= 3600);
            let JobAt::Wanted(wanted) = &call.at else { panic!("nothing has been done: {call:?}") };
            job(wanted, role);
        }
    }
}

fn job(job: &Job, role: Role) {
    match job {
        Job::Panel(_) | Job::Override { .. } => assert!(role >= Role::Stop),
        Job::WatchVariables(_) => panic!("the socket's thread alone makes tables"),
        Job::RotaryState(_) => {}
        Job::Write { first, words, .. } => {
            assert_eq!(role, Role::Engineer);
            assert!((1..=64).contains(&words.len()));
            assert!(u64::from(first.bytes()) + 2 * words.len() as u64 <= u64::from(pmac::LENGTH));
        }
        Job::WriteVariables(records) => {
            assert!((1..=1024).contains(&records.len()) && role == Role::Engineer)
        }
        Job::RotarySend { lines, .. } => {
            assert!(lines.iter().map(Vec::len).sum::<usize>() <= 4096 && role == Role::Engineer);
        }
        _ => assert_eq!(role, Role::Engineer),
    }
}
