//! Whether segment and socket exist, and the conclusions if one is missing.

use std::path::Path;

use nix::sys::statvfs::statvfs;

use super::report::Report;
use crate::cli::context::Context;
use crate::client::{Board, ClientError, Staleness};
use crate::protocol::BoardInfo;
use crate::segment::{DIRECTORY, SegmentError};

/// Warn below this free space in /dev/shm. A segment takes a few MiB.
const ROOM: u64 = 16 << 20;

pub fn shared_memory(report: &mut Report) {
    const WHAT: &str = "shared memory";
    match statvfs(DIRECTORY) {
        Err(errno) => {
            let text = format!("cannot examine {DIRECTORY}: {}; mount a tmpfs there", errno.desc());
            report.fail(WHAT, text);
        }
        Ok(room) => {
            // A 32-bit host has these numbers with 32 bits.
            #[allow(clippy::unnecessary_cast)]
            let free = room.blocks_available() as u64 * room.fragment_size() as u64;
            let mib = free >> 20;
            if free < ROOM {
                let text = format!("{DIRECTORY} has only {mib} MiB left; remove unneeded files there");
                report.warn(WHAT, text);
            } else {
                report.ok(WHAT, format!("{DIRECTORY} has {mib} MiB left"));
            }
        }
    }
}

pub fn segment(report: &mut Report, context: &Context) -> Result<Board, ClientError> {
    let board = match context.attach() {
        Ok(board) => board,
        Err(error) => {
            report.fail("segment", error.to_string());
            return Err(error);
        }
    };
    let subscriber = board.subscriber();
    let header = subscriber.header();
    let path = subscriber.path().display();
    report.ok("segment", format!("{path} is there, layout 1.{}", header.abi_minor));
    let pid = header.owner_pid;
    let now_ns = subscriber.now_ns();
    match Staleness::of_segment(subscriber.condition(), &header, now_ns) {
        Some(Staleness::DaemonGone) => {
            let text = format!("nobody writes the segment that process {pid} made; start pmacd");
            report.fail("daemon", text);
        }
        Some(why @ (Staleness::DaemonStopped { .. } | Staleness::OtherClock { .. })) => {
            report.fail("daemon", format!("process {pid}: {why}"));
        }
        _ => {
            let age_ms = now_ns.saturating_sub(header.heartbeat_ns) / 1_000_000;
            report.ok("daemon", format!("process {pid} runs, last heartbeat {age_ms} ms ago"));
        }
    }
    Ok(board)
}

/// The conclusions if only one of the daemon's two names, segment and socket, leads to the daemon.
pub fn conclude(
    report: &mut Report,
    attached: &Result<Board, ClientError>,
    info: Option<&BoardInfo>,
    socket: &Path,
) {
    let text = match (attached, info) {
        (Err(ClientError::Segment(error)), Some(info)) if is_lost(error) => segment_lost(info),
        (Ok(board), Some(info)) if board.subscriber().condition().is_over() => segment_lost(info),
        (Ok(board), None) if !board.subscriber().condition().is_over() && !socket.exists() => {
            socket_lost(board)
        }
        _ => return,
    };
    report.fail("names", text);
}

/// Whether no daemon's segment exists.
fn is_lost(error: &SegmentError) -> bool {
    matches!(
        error,
        SegmentError::NotFound { .. } | SegmentError::Malformed { .. } | SegmentError::ForeignOwner { .. }
    )
}

fn segment_lost(info: &BoardInfo) -> String {
    format!(
        "pmacd (process {}) runs, and {DIRECTORY}{} does not lead to its segment: a program has removed or replaced the file, as \
         SharedMemory of Python does when it ends (give it track=False), or this program sees another {DIRECTORY} than pmacd (a \
         container). pmacd publishes it again within a second; where something is in its way, remove that; its log names it",
        info.pid, info.segment
    )
}

/// The conclusion if the daemon publishes but its socket has no file.
fn socket_lost(board: &Board) -> String {
    format!(
        "pmacd (process {}) runs, and no socket is at that path: it has another (give --socket), or somebody has removed the file. \
         pmacd makes it again within a second; where it cannot, its log says why",
        board.subscriber().header().owner_pid
    )
}
