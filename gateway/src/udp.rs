//! Clients by UDP: a datagram is a request, and its answer is one.
//!
//! Each address is a client with a thread of its own, so that none waits for another's line. Who asks nothing for long loses it, and
//! what he has open; whom he addressed and what his port is like is remembered.

use std::collections::VecDeque;
use std::net::{SocketAddr, UdpSocket};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use log::{info, warn};
use pmac_dpram::format::Visible;

use crate::packet::{DATA_MAX, HEADER, Packet};
use crate::places::{Places, Taken};
use crate::session::{Answer, Port, Rules, Session};

/// The most clients.
pub const CLIENTS_MAX: usize = 8;
/// Requests of a client that may wait. What comes beside them is lost, as datagrams are.
const WAITING_MAX: usize = 4;
/// How long a client keeps his thread who asks nothing, and after how long another may have it who needs it.
const KEPT: Duration = Duration::from_secs(600);
const SILENT: Duration = Duration::from_secs(30);
/// Clients without a thread of whom is remembered whom they addressed.
const REMEMBERED_MAX: usize = 256;
/// How often a client is looked after.
const LOOK: Duration = Duration::from_secs(1);
/// How long receiving pauses when the system refuses it.
const PAUSE: Duration = Duration::from_millis(200);

/// The clients, and of those who have lost their thread what is remembered.
struct Clients {
    places: Places<SocketAddr, SyncSender<Packet>>,
    remembered: Mutex<VecDeque<(SocketAddr, Port)>>,
}

impl Clients {
    fn forget(&self, peer: SocketAddr, port: Port) {
        let mut remembered = self.remembered.lock().unwrap_or_else(PoisonError::into_inner);
        if remembered.len() >= REMEMBERED_MAX {
            remembered.pop_front();
        }
        remembered.push_back((peer, port));
    }

    fn recall(&self, peer: SocketAddr) -> Option<Port> {
        let mut remembered = self.remembered.lock().unwrap_or_else(PoisonError::into_inner);
        let at = remembered.iter().position(|(other, _)| *other == peer)?;
        remembered.remove(at).map(|(_, port)| port)
    }
}

/// Serves whoever sends something, for ever.
pub fn serve(socket: &Arc<UdpSocket>, rules: &Rules) {
    let clients = Arc::new(Clients { places: Places::new(CLIENTS_MAX), remembered: Mutex::default() });
    let mut bytes = [0; HEADER + DATA_MAX];
    loop {
        let (count, peer) = match socket.recv_from(&mut bytes) {
            Ok(received) => received,
            Err(error) => {
                // An answer that reached nobody is told here, too.
                if error.kind() != std::io::ErrorKind::ConnectionRefused {
                    warn!("receiving: {error}");
                    thread::sleep(PAUSE);
                }
                continue;
            }
        };
        let Ok(Some((packet, _))) = Packet::take(&bytes[..count]) else {
            info!("{peer}: a datagram of {count} bytes is no request");
            continue;
        };
        if let Err(why) = hand_over(&clients, socket, peer, packet, rules) {
            info!("{peer}: a request is dropped: {why}");
        }
    }
}

/// Gives `packet` to the thread of its client.
fn hand_over(
    clients: &Arc<Clients>,
    socket: &Arc<UdpSocket>,
    peer: SocketAddr,
    packet: Packet,
    rules: &Rules,
) -> Result<(), String> {
    let packet = match clients.places.with(&peer, |requests| requests.try_send(packet.clone())) {
        Some(Ok(())) => return Ok(()),
        Some(Err(TrySendError::Full(_))) => return Err(format!("{WAITING_MAX} wait already")),
        Some(Err(TrySendError::Disconnected(packet))) => packet,
        None => packet,
    };
    let (sender, requests) = sync_channel(WAITING_MAX);
    let _ = sender.try_send(packet);
    match clients.places.take(peer, sender, SILENT, Instant::now()) {
        // The thread of the other reads that nobody sends to it any more.
        Taken::Free | Taken::InsteadOf(..) => {}
        Taken::Full => return Err(format!("{CLIENTS_MAX} clients are served already")),
    }
    let session = Session::again(format!("{peer} (UDP)"), rules.clone(), clients.recall(peer));
    let (socket, own) = (Arc::clone(socket), Arc::clone(clients));
    let run = move || {
        let mut session = session;
        if let Some(why) = attend(&own, &socket, peer, &requests, &mut session) {
            info!("{peer} (UDP): without an answer: {}", Visible(why));
        }
        own.forget(peer, session.into_port());
        own.places.leave(&peer);
    };
    let started = thread::Builder::new().name("udp".to_owned()).spawn(run);
    if started.is_err() {
        clients.places.leave(&peer);
    }
    started.map(drop).map_err(|error| error.to_string())
}

/// Answers a client until he has long been silent, or why he gets no answer.
fn attend(
    clients: &Clients,
    socket: &UdpSocket,
    peer: SocketAddr,
    requests: &Receiver<Packet>,
    session: &mut Session,
) -> Option<String> {
    let mut last = Instant::now();
    loop {
        match requests.recv_timeout(session.renews_in().unwrap_or(LOOK)) {
            Ok(packet) => {
                clients.places.asks(&peer, None, Instant::now());
                match session.answer(&packet) {
                    // An answer may get lost; the client asks again.
                    Answer::Reply(reply) => drop(socket.send_to(&reply, peer)),
                    Answer::End(why) => return Some(why),
                }
                last = Instant::now();
                clients.places.asks(&peer, session.gives_way().map(|_| SILENT), last);
            }
            Err(RecvTimeoutError::Disconnected) => return None,
            Err(RecvTimeoutError::Timeout) if last.elapsed() >= KEPT => return None,
            Err(RecvTimeoutError::Timeout) => session.renew(),
        }
    }
}
