//! The leases: how long a client may be silent until the daemon ends the client's jog, sequence or trace. Every call of
//! the client renews its lease.

use std::time::Duration;

/// The lease of a held jog, which only the calls for that jog renew. When it is over, the daemon stops the motors
/// (`daemon/motion/ledger.rs`). The client of a jog by command line names the time itself.
pub const HOLD_LEASE: Duration = Duration::from_millis(200);
/// The lease of a sequence, while the daemon does nothing for it. When it is over, the sequence comes to its end
/// (`daemon/socket/sequences.rs`).
pub const SEQUENCE_LEASE: Duration = Duration::from_secs(5);
/// The lease of the trace of bus accesses, which only the calls for the trace renew. When it is over, the daemon ends
/// the trace (`daemon/socket/tracing.rs`).
pub const TRACE_LEASE: Duration = Duration::from_secs(5);
