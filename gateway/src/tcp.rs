//! Clients by TCP: each has a thread and one of a fixed number of places.

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

/// Most clients. A client by TCP or UDP has two connections to `pmacd` while it stops something beside a running line;
/// `pmacd` gives a user 64.
pub const CLIENTS_MAX: usize = 22;
/// How long a client may take to complete a request, and to fetch an answer.
const PATIENCE: Duration = Duration::from_secs(5);
/// How often the gateway checks a client that has sent half a request.
const LOOK: Duration = Duration::from_secs(1);
/// How long the gateway pauses after a failed accept.
const PAUSE: Duration = Duration::from_millis(200);
/// Stack of a client's thread, in bytes.
const STACK: usize = 256 * 1024;
/// A client that acknowledges neither an answer nor a keep-alive for this long is gone.
const GONE_AFTER: Duration = Duration::from_secs(6);
/// Keep-alive: seconds of silence before the first probe, seconds between probes, and how many probes.
const ALIVE: (u32, u32, u32) = (3, 1, 3);

/// The clients, each under a number that is never used again.
type Clients = Places<u64, TcpStream>;

/// Serves all clients, for ever.
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

/// Starts a client's thread; false if no place is free.
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
            // The other client's thread then reads the end of its stream.
            drop(other.shutdown(Shutdown::Both));
        }
        Taken::Full => return Ok(false),
    }
    let (own, place) = (Arc::clone(clients), rules.place.clone());
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
            place.tell(&format!("{peer}: his connection ends: {}", Visible(why)));
        }
    };
    let started = thread::Builder::new().name("client".to_owned()).stack_size(STACK).spawn(run);
    if started.is_err() {
        clients.leave(&id);
    }
    started.map(|_| true)
}

/// Makes the system end `stream` when the client vanishes silently (a pulled cable, a machine without power). While an
/// answer is unacknowledged TCP sends no keep-alive probe, and would repeat the answer for a quarter of an hour.
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

/// Whether the client or the system has ended the client's side of `stream`. Data sent before the end may still be
/// unread.
fn has_ended(stream: &TcpStream) -> bool {
    // nix has no name for POLLRDHUP.
    let gone = PollFlags::from_bits_retain(POLLRDHUP) | PollFlags::POLLHUP | PollFlags::POLLERR;
    let mut looked = [PollFd::new(stream.as_fd(), gone)];
    poll(&mut looked, PollTimeout::ZERO).is_ok_and(|found| found > 0)
}

/// Answers a client until the client leaves, or returns why the connection ends.
fn attend(clients: &Clients, id: u64, mut stream: TcpStream, mut client: Client) -> Option<String> {
    let (mut bytes, mut chunk) = (Vec::new(), [0; 2048]);
    let mut half_since = None;
    loop {
        match Packet::take(&bytes) {
            Err(malformed) => return Some(malformed.to_string()),
            Ok(Some((packet, taken))) => {
                bytes.drain(..taken);
                half_since = None;
                // No other client takes the place while this client's request runs.
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
                // Also the end of a client that acknowledges nothing.
                _ => return Some(error.to_string()),
            },
        }
    }
}

/// Sends a whole answer, in one piece if the system has room: some clients take the first piece for the whole.
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
