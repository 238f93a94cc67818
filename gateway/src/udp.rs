//! Clients by UDP: a datagram is a request, and its answer is one.
//!
//! Each address is a client with a thread of its own, so no client waits for another's line. A client that is silent
//! for long loses the thread and its open buffer; the gateway remembers its address words and its port's settings.

use std::collections::{BTreeMap, VecDeque};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use log::{info, warn};
use pmac_dpram::format::Visible;

use crate::client::Client;
use crate::packet::{DATA_MAX, HEADER, Packet};
use crate::places::{Places, Taken};
use crate::session::{Port, Rules, Session};

/// Most clients.
pub const CLIENTS_MAX: usize = 8;
/// Waiting requests of a client. The gateway drops further requests, as a network drops datagrams.
const WAITING_MAX: usize = 4;
/// A silent client keeps his thread for `KEPT`; after `SILENT` another client may take it.
const KEPT: Duration = Duration::from_secs(600);
const SILENT: Duration = Duration::from_secs(30);
/// How many clients without a thread the gateway remembers.
const REMEMBERED_MAX: usize = 256;
/// How often the gateway looks after a client.
const LOOK: Duration = Duration::from_secs(1);
/// How long the gateway pauses after a failed receive.
const PAUSE: Duration = Duration::from_millis(200);

/// The clients, each under a number that is never used again: a client that lost its place may come back to another
/// place while its first thread still runs.
struct Clients {
    places: Places<u64, SyncSender<Packet>>,
    known: Mutex<Known>,
}

/// The clients' numbers and memories.
#[derive(Debug, Default)]
struct Known {
    /// The number of each address's last thread, while that thread runs.
    numbers: BTreeMap<SocketAddr, u64>,
    /// The last number given out.
    last: u64,
    /// The ports of clients without a thread.
    remembered: VecDeque<(SocketAddr, Port)>,
}

impl Known {
    /// A new number, for a client that asks for a place.
    fn number(&mut self) -> u64 {
        self.last += 1;
        self.last
    }

    /// The client at `peer` has the place `number`: returns his remembered port.
    fn comes(&mut self, peer: SocketAddr, number: u64) -> Option<Port> {
        self.numbers.insert(peer, number);
        let at = self.remembered.iter().position(|(other, _)| *other == peer)?;
        self.remembered.remove(at).map(|(_, port)| port)
    }

    /// The thread of client `number` has ended. The gateway remembers its port, unless the client has come back and has
    /// another thread.
    fn leaves(&mut self, peer: SocketAddr, number: u64, port: Port) {
        if self.numbers.get(&peer) != Some(&number) {
            return;
        }
        self.numbers.remove(&peer);
        if self.remembered.len() >= REMEMBERED_MAX {
            self.remembered.pop_front();
        }
        self.remembered.push_back((peer, port));
    }
}

impl Clients {
    fn known(&self) -> MutexGuard<'_, Known> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Serves all clients, for ever.
pub fn serve(socket: &Arc<UdpSocket>, rules: &Rules) {
    let clients = Arc::new(Clients { places: Places::new(CLIENTS_MAX), known: Mutex::default() });
    let mut bytes = [0; HEADER + DATA_MAX];
    loop {
        let (count, peer) = match socket.recv_from(&mut bytes) {
            Ok(received) => received,
            Err(error) => {
                // The system also reports here that an earlier answer reached nobody.
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

/// Gives `packet` to its client's thread, and starts the thread if there is none.
fn hand_over(
    clients: &Arc<Clients>,
    socket: &Arc<UdpSocket>,
    peer: SocketAddr,
    packet: Packet,
    rules: &Rules,
) -> Result<(), String> {
    let number = clients.known().numbers.get(&peer).copied();
    let hand = |number| clients.places.with(&number, |requests| requests.try_send(packet.clone()));
    let packet = match number.and_then(hand) {
        Some(Ok(())) => return Ok(()),
        Some(Err(TrySendError::Full(_))) => return Err(format!("{WAITING_MAX} wait already")),
        Some(Err(TrySendError::Disconnected(packet))) => packet,
        None => packet,
    };
    let (sender, requests) = sync_channel(WAITING_MAX);
    let _ = sender.try_send(packet);
    let number = clients.known().number();
    match clients.places.take(number, sender, SILENT, Instant::now()) {
        // The other client's thread ends: its sender is gone.
        Taken::Free | Taken::InsteadOf(..) => {}
        Taken::Full => return Err(format!("{CLIENTS_MAX} clients are served already")),
    }
    let port = clients.known().comes(peer, number);
    let session = Session::again(format!("{peer} (UDP)"), rules.clone(), port).reached_at(own_address(peer));
    let (socket, own, place) = (Arc::clone(socket), Arc::clone(clients), rules.place.clone());
    let run = move || {
        let mut served = Client::new(session);
        let client = (peer, number);
        let why = attend(&own, &socket, client, &requests, &mut served);
        own.known().leaves(peer, number, served.into_port());
        own.places.leave(&number);
        if let Some(why) = why {
            place.tell(&format!("{peer} (UDP): without an answer: {}", Visible(why)));
        }
    };
    let started = thread::Builder::new().name("udp".to_owned()).spawn(run);
    if started.is_err() {
        clients.known().numbers.remove(&peer);
        clients.places.leave(&number);
    }
    started.map(drop).map_err(|error| error.to_string())
}

/// This machine's address towards `peer`: the socket may listen on all addresses.
fn own_address(peer: SocketAddr) -> Option<IpAddr> {
    let any: IpAddr =
        if peer.is_ipv4() { Ipv4Addr::UNSPECIFIED.into() } else { Ipv6Addr::UNSPECIFIED.into() };
    let way = UdpSocket::bind((any, 0)).ok()?;
    way.connect(peer).ok()?;
    Some(way.local_addr().ok()?.ip())
}

/// Answers a client until the client has long been silent, or returns why a request gets no answer.
fn attend(
    clients: &Clients,
    socket: &UdpSocket,
    (peer, number): (SocketAddr, u64),
    requests: &Receiver<Packet>,
    served: &mut Client,
) -> Option<String> {
    let mut last = Instant::now();
    loop {
        match requests.recv_timeout(served.renews_in().unwrap_or(LOOK)) {
            Ok(packet) => {
                clients.places.asks(&number, None, Instant::now());
                match served.answer(&packet) {
                    // An answer may get lost; the client asks again.
                    Ok(reply) => drop(socket.send_to(&reply, peer)),
                    Err(why) => return Some(why),
                }
                last = Instant::now();
                clients.places.asks(&number, served.gives_way().map(|_| SILENT), last);
            }
            Err(RecvTimeoutError::Disconnected) => return None,
            Err(RecvTimeoutError::Timeout) if last.elapsed() >= KEPT => return None,
            Err(RecvTimeoutError::Timeout) => {
                let was_at_work = served.is_at_work();
                if let Err(why) = served.renew() {
                    return Some(why);
                }
                if was_at_work {
                    clients.places.keeps(&number, served.gives_way().map(|_| SILENT));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::addressed::Addressed;

    #[test]
    fn a_thread_whose_client_is_back_takes_neither_his_place_nor_his_memory() {
        let peer = "127.0.0.1:4711".parse().unwrap();
        let port =
            |motor| Port { addressed: Addressed { motor: Some(motor), system: None }, ..Port::default() };
        let mut known = Known::default();
        let (first, second) = (known.number(), known.number());
        assert!(known.comes(peer, first).is_none());
        // Another client took his place, and he comes back before his first thread has ended.
        assert!(known.comes(peer, second).is_none());
        known.leaves(peer, first, port(3));
        assert_eq!(known.numbers.get(&peer), Some(&second));
        known.leaves(peer, second, port(5));
        let third = known.number();
        let remembered = known.comes(peer, third).unwrap();
        assert_eq!(remembered.addressed.motor, Some(5), "what he said last");
        assert!(known.remembered.is_empty());
    }
}
