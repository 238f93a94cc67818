//! What a client makes of a daemon's answers, when the daemon is somebody else: replies of any content to every method.

use std::io::Write;
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::{Duration, Instant};

use pmac_dpram::client::{CommandError, Connection, RotaryFeed};
use pmac_dpram::map::HostOffset;
use pmac_dpram::protocol::BOARD;

/// Nobody listens there, so a connection that broke stays broken.
const NOWHERE: &str = "/nonexistent/pmac0.sock";

/// First byte: the method that is called first; second: whether the rest is the stream as it comes, or the parameters of one
/// reply.
pub fn body(data: &[u8]) {
    let [method, way, rest @ ..] = data else { return };
    let stream = match way % 4 {
        0 => rest.to_vec(),
        1 => [b"{\"error\":\"", BOARD.as_bytes(), b".", rest, b"}\0"].concat(),
        2 => [b"{\"continues\":true,\"parameters\":{", rest, b"}}\0"].concat(),
        _ => [b"{\"parameters\":{", rest, b"}}\0"].concat(),
    };
    let (mut theirs, ours) = UnixStream::pair().unwrap();
    // What does not fit into the socket at once never comes.
    theirs.set_nonblocking(true).unwrap();
    let sent = theirs.write(&stream).unwrap_or(0);
    theirs.shutdown(Shutdown::Write).unwrap();
    let began = Instant::now();
    let mut connection = Connection::over(ours, Path::new(NOWHERE));
    let timeout = Duration::from_secs(2);
    match method % 8 {
        0 => drop(told(connection.info())),
        1 => drop(told(connection.settings())),
        2 => {
            if let Some(lines) = told(connection.send("#1J+", timeout)) {
                assert!(lines.iter().map(String::len).sum::<usize>() <= sent);
            }
        }
        3 => {
            let words = usize::from(way >> 2) + 1;
            if let Some((_, found)) = told(connection.read(HostOffset::new(0x24), words)) {
                assert_eq!(found.len(), words);
            }
        }
        4 => {
            if let Some(mut messages) = told(connection.messages()) {
                for _ in 0..stream.len() + 2 {
                    drop(told(messages.next_within(timeout)));
                }
                assert!(messages.ended());
            }
            return;
        }
        5 => {
            if let Some(mut watch) = told(connection.watch_variables(&["X:$0000".parse().unwrap()])) {
                assert!(watch.check().is_err(), "the other side has hung up");
            }
            return;
        }
        6 => {
            // One batch, or three, two of which are under way at once.
            let lines = vec![vec![(0x00_0E23, 0x50_0000)]; if way >> 2 == 63 { 2100 } else { 4 }];
            let mut feed = RotaryFeed::new(connection, 1, &lines);
            while let Some(Some(_) | None) = told(feed.step()) {
                assert!(feed.inside() <= lines.len());
                if feed.is_done() {
                    break;
                }
            }
            assert!(feed.inside() <= lines.len());
            return;
        }
        _ => {
            let _ = told(connection.feed_override(1, Some(7)));
            let _ = told(connection.rotary_state(1));
            let _ = told(connection.write(HostOffset::new(0x3000), &[(1, 2)], false));
        }
    }
    // Whatever the other side sent, it has ended, and a client says so, in time.
    for _ in 0..stream.iter().filter(|&&byte| byte == 0).count() + 1 {
        drop(told(connection.info()));
    }
    assert!(connection.info().is_err());
    assert!(began.elapsed() < Duration::from_secs(2));
}

fn told<T>(result: Result<T, CommandError>) -> Option<T> {
    result.inspect_err(|error| assert!(!error.to_string().is_empty())).ok()
}
