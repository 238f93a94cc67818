//! Clients by TCP: a thread each, and never more than there are places.

use std::collections::BTreeMap;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use log::{info, warn};
use nix::sys::socket::{setsockopt, sockopt};
use pmac_dpram::format::Visible;

use crate::packet::Packet;
use crate::quota::Quota;
use crate::session::{Answer, Rules, Session};

/// The most clients. Less than the connections that `pmacd` gives one user.
pub const CLIENTS_MAX: usize = 40;
/// How long a client may take for a request that he has begun, and for fetching an answer.
const PATIENCE: Duration = Duration::from_secs(5);
/// How often a client is looked after of whom something is under way.
const LOOK: Duration = Duration::from_secs(1);
/// How long accepting pauses when the system has nothing left.
const PAUSE: Duration = Duration::from_millis(200);
/// What a client's thread needs.
const STACK: usize = 256 * 1024;
/// When a client that says nothing is asked whether he is still there, and how often: he is gone after a minute and a half.
const ALIVE: (u32, u32, u32) = (60, 10, 3);

/// A client, as the others see him.
struct Place {
    stream: TcpStream,
    since: Instant,
    has_spoken: bool,
}

/// The places of the clients, each by a number that is never used again.
#[derive(Default)]
struct Places {
    taken: Mutex<BTreeMap<u64, Place>>,
    log: Quota,
}

impl Places {
    fn taken(&self) -> MutexGuard<'_, BTreeMap<u64, Place>> {
        self.taken.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A place for `stream`. When all are taken, who has asked nothing for a while gives his up.
    fn take(&self, id: u64, stream: &TcpStream, now: Instant) -> io::Result<bool> {
        let mut taken = self.taken();
        if taken.len() >= CLIENTS_MAX {
            let is_silent = |place: &Place| !place.has_spoken && now.duration_since(place.since) >= PATIENCE;
            let silent = taken.iter().find(|(_, place)| is_silent(place)).map(|(id, _)| *id);
            match silent.and_then(|id| taken.remove(&id)) {
                // His thread reads the end then.
                Some(place) => drop(place.stream.shutdown(Shutdown::Both)),
                None => return Ok(false),
            }
        }
        taken.insert(id, Place { stream: stream.try_clone()?, since: now, has_spoken: false });
        Ok(true)
    }

    fn has_spoken(&self, id: u64) {
        if let Some(place) = self.taken().get_mut(&id) {
            place.has_spoken = true;
        }
    }

    fn leave(&self, id: u64) {
        self.taken().remove(&id);
    }
}

/// Serves whoever comes, for ever.
pub fn serve(listener: &TcpListener, rules: &Rules) {
    let places = Arc::new(Places::default());
    for id in 0.. {
        let now = Instant::now();
        let (stream, peer) = match listener.accept() {
            Ok(accepted) => accepted,
            Err(error) if error.kind() == ErrorKind::Interrupted => continue,
            Err(error) => {
                if places.log.allows(now) {
                    warn!("accepting a client: {error}");
                }
                thread::sleep(PAUSE);
                continue;
            }
        };
        if let Err(error) = begin(&places, id, stream, peer, rules.clone())
            && places.log.allows(now)
        {
            warn!("{peer}: sent away: {error}");
        }
    }
}

/// Gives a client his thread.
fn begin(places: &Arc<Places>, id: u64, stream: TcpStream, peer: SocketAddr, rules: Rules) -> io::Result<()> {
    let (idle, between, times) = ALIVE;
    stream.set_nodelay(true)?;
    setsockopt(&stream, sockopt::KeepAlive, &true)?;
    setsockopt(&stream, sockopt::TcpKeepIdle, &idle)?;
    setsockopt(&stream, sockopt::TcpKeepInterval, &between)?;
    setsockopt(&stream, sockopt::TcpKeepCount, &times)?;
    if !places.take(id, &stream, Instant::now())? {
        return Err(io::Error::other(format!("{CLIENTS_MAX} clients are served already")));
    }
    let own = Arc::clone(places);
    let run = move || {
        let why = attend(&own, id, stream, Session::new(peer.to_string(), rules));
        own.leave(id);
        if let Some(why) = why
            && own.log.allows(Instant::now())
        {
            info!("{peer}: his connection ends: {}", Visible(why));
        }
    };
    let started = thread::Builder::new().name("client".to_owned()).stack_size(STACK).spawn(run);
    if started.is_err() {
        places.leave(id);
    }
    started.map(drop)
}

/// Answers a client until he leaves, or why he has to.
fn attend(places: &Places, id: u64, mut stream: TcpStream, mut session: Session) -> Option<String> {
    let (mut bytes, mut chunk) = (Vec::new(), [0; 2048]);
    let (mut half_since, mut has_spoken) = (None, false);
    loop {
        match Packet::take(&bytes) {
            Err(malformed) => return Some(malformed.to_string()),
            Ok(Some((packet, taken))) => {
                bytes.drain(..taken);
                half_since = None;
                if !std::mem::replace(&mut has_spoken, true) {
                    places.has_spoken(id);
                }
                match session.answer(&packet) {
                    Answer::Reply(reply) => {
                        if let Err(error) = send(&mut stream, &reply) {
                            return Some(format!("he does not fetch his answer: {error}"));
                        }
                    }
                    Answer::End(why) => return Some(why),
                }
                continue;
            }
            Ok(None) => {}
        }
        if !bytes.is_empty() && half_since.get_or_insert_with(Instant::now).elapsed() >= PATIENCE {
            return Some("he has sent half a request".to_owned());
        }
        if session.wants_renewal()
            && let Err(why) = session.renew()
        {
            return Some(why);
        }
        let is_looked_after = !bytes.is_empty() || session.wants_renewal();
        if let Err(error) = stream.set_read_timeout(is_looked_after.then_some(LOOK)) {
            return Some(error.to_string());
        }
        match stream.read(&mut chunk) {
            Ok(0) => return None,
            Ok(count) => bytes.extend_from_slice(&chunk[..count]),
            Err(error) => match error.kind() {
                ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted => {}
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
