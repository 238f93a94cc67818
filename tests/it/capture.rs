//! The trace of the daemon's bus accesses, and captures of a board.

use std::time::Duration;

use pmac_dpram::client::{CommandError, Connection};
use pmac_dpram::protocol::CallError;
use pmac_dpram::segment::Counter;

use crate::support::VirtualSite;

/// Longer than a client may be silent.
const SILENT: Duration = Duration::from_secs(6);

/// Accesses that are left, four numbers each.
fn rest(connection: &mut Connection) -> Vec<u64> {
    let mut all = Vec::new();
    loop {
        let reply = connection.trace(true).unwrap();
        assert_eq!(reply.dropped, 0);
        if reply.accesses.is_empty() {
            return all;
        }
        all.extend(reply.accesses);
    }
}

fn refusal(connection: &mut Connection) -> String {
    match connection.trace(false) {
        Err(CommandError::Refused(CallError::Refused { reason })) => reason,
        other => panic!("{other:?}"),
    }
}

#[test]
fn e6_every_access_to_the_bus_is_traced_while_an_engineer_wants_it() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_until("servo data", || site.attach().counter(Counter::Updates) > 0);
    site.hold();
    let (mut connection, mut other) = (site.connection(), site.connection());
    assert_eq!(connection.trace(true).unwrap().accesses, [0; 0], "nothing to end");
    assert_eq!(connection.trace(false).unwrap().accesses, [0; 0]);
    assert!(site.log().contains("traces the bus accesses"), "{}", site.log());
    assert!(refusal(&mut other).contains(&format!("(pid {}) traces the bus accesses", std::process::id())));
    let accesses = || site.attach().counter(Counter::BusAccesses);
    // The count is published with the heartbeat.
    let before = accesses();
    site.step(200);
    let counted = accesses() - before;
    let traced = rest(&mut connection).len() as u64 / 4;
    assert!(counted > 0 && traced >= counted, "{traced} of {counted}");
    // Whoever comes next has it, and begins with nothing.
    site.step(10);
    assert_eq!(other.trace(false).unwrap().accesses, [0; 0]);
    drop(other);
    site.step(10);
    assert_eq!(connection.trace(false).unwrap().accesses, [0; 0], "the client before is gone");
    site.run_for(SILENT);
    let mut third = site.connection();
    assert_eq!(third.trace(false).unwrap().accesses, [0; 0], "the client before was silent too long");
}

#[test]
fn e6_a_trace_that_nobody_fetches_counts_what_it_drops() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_until("servo data", || site.attach().counter(Counter::Updates) > 0);
    site.hold();
    let mut connection = site.connection();
    connection.trace(false).unwrap();
    site.run_for(Duration::from_secs(3));
    let reply = connection.trace(false).unwrap();
    assert_eq!(reply.accesses.len(), 4 * 4096);
    assert!(reply.dropped > 0);
    // Times go up, offsets are those of the DPRAM.
    for access in reply.accesses.chunks(4).skip(1) {
        assert!(access[0] < 1_000_000_000 && access[1] < 2 && access[2] < 0x4000 && access[3] < 0x10000);
    }
}
