//! Clients by TCP: a thread each, and never more than there are places.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::os::fd::AsFd;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use log::{info, warn};
use nix::libc::POLLRDHUP;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::socket::{setsockopt, sockopt};
use pmac_dpram::format::Visible;

use crate::client::Client;
use crate::packet::Packet;
use crate::places::{Places, Taken};
use crate::session::{Rules, Session};

/// The most clients. Each has two connections to `pmacd` while it stops something beside a line, and those by UDP, too: `pmacd` gives
/// a user 64.
pub const CLIENTS_MAX: usize = 22;
/// How long a client may take for a request that he has begun, and for fetching an answer.
const PATIENCE: Duration = Duration::from_secs(5);
/// How often a client is looked after who has sent half a request.
const LOOK: Duration = Duration::from_secs(1);
/// How long accepting pauses when the system has nothing left.
const PAUSE: Duration = Duration::from_millis(200);
/// What a client's thread needs.
const STACK: usize = 256 * 1024;
/// A client who acknowledges nothing for so long is gone: neither an answer, nor the question whether he is still there.
const GONE_AFTER: Duration = Duration::from_secs(6);
/// When a client that says nothing is asked that, in seconds, and how often.
const ALIVE: (u32, u32, u32) = (3, 1, 3);

/// The clients, each by a number that is never used again.
type Clients = Places<u64, TcpStream>;

/// Serves whoever comes, for ever.
pub fn serve(listener: &TcpListener, rules: &Rules) {
    let clients = Arc::new(Clients::new(CLIENTS_MAX));
    let mut is_full = false;
    for id in 0.. {
        let (stream, peer) = match listener.accept() {
            Ok(accepted) => accepted,
            Err(error) if error.kind() == ErrorKind::Interrupted => continue,
            Err(error) => {
                warn!("accepting a client: {error}");
                thread::sleep(PAUSE);
                continue;
            }
        };
        match begin(&clients, id, stream, peer, rules.clone()) {
            Ok(true) => is_full = false,
            Ok(false) if is_full => {}
            Ok(false) => {
                is_full = true;
                warn!(
                    "{CLIENTS_MAX} clients are served, and none has long been silent: others are sent away, the first is {peer}"
                );
            }
            Err(error) => warn!("{peer}: sent away: {error}"),
        }
    }
}

/// Gives a client his thread. Whether there is a place for him.
fn begin(
    clients: &Arc<Clients>,
    id: u64,
    stream: TcpStream,
    peer: SocketAddr,
    rules: Rules,
) -> io::Result<bool> {
    notice_the_end(&stream)?;
    match clients.take(id, stream.try_clone()?, PATIENCE, Instant::now()) {
        Taken::Free => {}
        Taken::InsteadOf(other, silence) => {
            if let Ok(silent) = other.peer_addr() {
                info!(
                    "{silent}: silent for {} s: his connection ends, {peer} has his place",
                    silence.as_secs()
                );
            }
            // His thread reads the end then.
            drop(other.shutdown(Shutdown::Both));
        }
        Taken::Full => return Ok(false),
    }
    let own = Arc::clone(clients);
    let run = move || {
        let why = match stream.try_clone() {
            Ok(to_client) => {
                let own_address = stream.local_addr().ok().map(|address| address.ip());
                let is_gone = move || has_ended(&to_client);
                let session = Session::new(peer.to_string(), rules).watching(is_gone).reached_at(own_address);
                attend(&own, id, stream, Client::new(session))
            }
            Err(error) => Some(error.to_string()),
        };
        own.leave(&id);
        if let Some(why) = why {
            info!("{peer}: his connection ends: {}", Visible(why));
        }
    };
    let started = thread::Builder::new().name("client".to_owned()).stack_size(STACK).spawn(run);
    if started.is_err() {
        clients.leave(&id);
    }
    started.map(|_| true)
}

/// Has the system end `stream` when its other end is gone without a word: a cable is pulled, a machine has no power. While an
/// answer is not acknowledged, nothing is asked, and TCP would send that again for a quarter of an hour.
fn notice_the_end(stream: &TcpStream) -> io::Result<()> {
    let (idle, between, times) = ALIVE;
    let gone_after = u32::try_from(GONE_AFTER.as_millis()).unwrap_or(u32::MAX);
    stream.set_nodelay(true)?;
    setsockopt(stream, sockopt::KeepAlive, &true)?;
    setsockopt(stream, sockopt::TcpKeepIdle, &idle)?;
    setsockopt(stream, sockopt::TcpKeepInterval, &between)?;
    setsockopt(stream, sockopt::TcpKeepCount, &times)?;
    setsockopt(stream, sockopt::TcpUserTimeout, &gone_after)?;
    Ok(())
}

/// Whether the client has ended his side of `stream`, or the system has. What he has sent before that may still lie there.
fn has_ended(stream: &TcpStream) -> bool {
    // nix has no name for the first one.
    let gone = PollFlags::from_bits_retain(POLLRDHUP) | PollFlags::POLLHUP | PollFlags::POLLERR;
    let mut looked = [PollFd::new(stream.as_fd(), gone)];
    poll(&mut looked, PollTimeout::ZERO).is_ok_and(|found| found > 0)
}

/// Answers a client until he leaves, or why he has to.
fn attend(clients: &Clients, id: u64, mut stream: TcpStream, mut client: Client) -> Option<String> {
    let (mut bytes, mut chunk) = (Vec::new(), [0; 2048]);
    let mut half_since = None;
    loop {
        match Packet::take(&bytes) {
            Err(malformed) => return Some(malformed.to_string()),
            Ok(Some((packet, taken))) => {
                bytes.drain(..taken);
                half_since = None;
                // Nobody has his place while he is answered.
                clients.asks(&id, None, Instant::now());
                match client.answer(&packet) {
                    Ok(reply) => {
                        if let Err(error) = send(&mut stream, &reply) {
                            return Some(format!("he does not fetch his answer: {error}"));
                        }
                    }
                    Err(why) => return Some(why),
                }
                clients.asks(&id, client.gives_way(), Instant::now());
                continue;
            }
            Ok(None) => {}
        }
        if !bytes.is_empty() && half_since.get_or_insert_with(Instant::now).elapsed() >= PATIENCE {
            return Some("he has sent half a request".to_owned());
        }
        let was_at_work = client.is_at_work();
        if let Err(why) = client.renew() {
            return Some(why);
        }
        if was_at_work {
            clients.keeps(&id, client.gives_way());
        }
        let half = (!bytes.is_empty()).then_some(LOOK);
        if let Err(error) = stream.set_read_timeout(client.renews_in().or(half)) {
            return Some(error.to_string());
        }
        match stream.read(&mut chunk) {
            Ok(0) => return None,
            Ok(count) => bytes.extend_from_slice(&chunk[..count]),
            Err(error) => match error.kind() {
                ErrorKind::WouldBlock | ErrorKind::Interrupted => {}
                // Of a client who acknowledges nothing, too.
                _ => return Some(error.to_string()),
            },
        }
    }
}

/// Sends a whole answer, in one piece if there is room: some clients take what comes first for all of it.
fn send(stream: &mut TcpStream, mut reply: &[u8]) -> io::Result<()> {
    let deadline = Instant::now() + PATIENCE;
    while !reply.is_empty() {
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(ErrorKind::TimedOut.into());
        }
        stream.set_write_timeout(Some(left))?;
        match stream.write(reply) {
            Ok(count) => reply = &reply[count..],
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nix::sys::socket::getsockopt;

    #[test]
    fn a_client_whose_cable_is_pulled_is_gone_whether_an_answer_is_under_way_or_not() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let stream = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        notice_the_end(&stream).unwrap();
        assert_eq!(getsockopt(&stream, sockopt::TcpUserTimeout).unwrap(), 6000);
        assert!(getsockopt(&stream, sockopt::KeepAlive).unwrap());
        let idle = getsockopt(&stream, sockopt::TcpKeepIdle).unwrap();
        let between = getsockopt(&stream, sockopt::TcpKeepInterval).unwrap();
        let times = getsockopt(&stream, sockopt::TcpKeepCount).unwrap();
        assert_eq!(idle + between * times, 6, "seconds");
    }
}
