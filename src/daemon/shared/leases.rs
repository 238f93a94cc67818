//! The leases: how long a client may be silent until the daemon ends what the client has. Every call of the client renews its lease.

use std::time::Duration;

/// Of a held jog, which only the calls for that renew. Then the motors are stopped (`daemon/motion/ledger.rs`). The client of a jog
/// by command line names the time itself.
pub const HOLD_LEASE: Duration = Duration::from_millis(200);
/// Of a sequence, while the daemon does nothing for it. Then the sequence comes to its end (`daemon/socket/sequences.rs`).
pub const SEQUENCE_LEASE: Duration = Duration::from_secs(5);
/// Of the trace of bus accesses, which only the calls for that renew. Then the trace ends (`daemon/socket/tracing.rs`).
pub const TRACE_LEASE: Duration = Duration::from_secs(5);
