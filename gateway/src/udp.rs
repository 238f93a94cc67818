//! Clients by UDP: a datagram is a request, and its answer is one.
//!
//! Each address is a client with a thread of its own, so that none waits for another's line. Who asks nothing for a while is forgotten.

use std::collections::HashMap;
use std::net::{SocketAddr, UdpSocket};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Weak};
use std::thread;
use std::time::{Duration, Instant};

use log::{info, warn};
use pmac_dpram::format::Visible;

use crate::packet::{DATA_MAX, HEADER, Packet};
use crate::quota::Quota;
use crate::session::{Answer, Rules, Session};

/// The most clients.
pub const CLIENTS_MAX: usize = 8;
/// Requests of a client that may wait. What comes beside them is lost, as datagrams are.
const WAITING_MAX: usize = 4;
/// How long a client is remembered that asks nothing.
const REMEMBERED: Duration = Duration::from_secs(30);
/// How often a client is looked after.
const LOOK: Duration = Duration::from_secs(1);
/// How long receiving pauses when the system refuses it.
const PAUSE: Duration = Duration::from_millis(200);

/// A client, as the receiver sees him.
struct Client {
    requests: SyncSender<Packet>,
    /// His thread holds the other end.
    lives: Weak<()>,
}

/// Serves whoever sends something, for ever.
pub fn serve(socket: &Arc<UdpSocket>, rules: &Rules) {
    let (mut clients, log) = (HashMap::new(), Arc::new(Quota::default()));
    let mut bytes = [0; HEADER + DATA_MAX];
    loop {
        let (count, peer) = match socket.recv_from(&mut bytes) {
            Ok(received) => received,
            Err(error) => {
                // An answer that reached nobody is told here, too.
                if error.kind() != std::io::ErrorKind::ConnectionRefused {
                    if log.allows(Instant::now()) {
                        warn!("receiving: {error}");
                    }
                    thread::sleep(PAUSE);
                }
                continue;
            }
        };
        let Ok(Some((packet, _))) = Packet::take(&bytes[..count]) else {
            if log.allows(Instant::now()) {
                info!("{peer}: a datagram of {count} bytes is no request");
            }
            continue;
        };
        if let Err(why) = hand_over(&mut clients, socket, peer, packet, rules, &log)
            && log.allows(Instant::now())
        {
            info!("{peer}: a request is dropped: {why}");
        }
    }
}

/// Gives `packet` to the thread of its client.
fn hand_over(
    clients: &mut HashMap<SocketAddr, Client>,
    socket: &Arc<UdpSocket>,
    peer: SocketAddr,
    packet: Packet,
    rules: &Rules,
    log: &Arc<Quota>,
) -> Result<(), String> {
    let packet = match clients.get(&peer).map(|client| client.requests.try_send(packet.clone())) {
        Some(Ok(())) => return Ok(()),
        Some(Err(TrySendError::Full(_))) => return Err(format!("{WAITING_MAX} wait already")),
        // He is forgotten.
        Some(Err(TrySendError::Disconnected(packet))) => packet,
        None => packet,
    };
    clients.retain(|_, client| client.lives.strong_count() > 0);
    if clients.len() >= CLIENTS_MAX {
        return Err(format!("{CLIENTS_MAX} clients are served already"));
    }
    let (sender, requests) = sync_channel(WAITING_MAX);
    let _ = sender.try_send(packet);
    let session = Session::new(format!("{peer} (UDP)"), rules.clone());
    let (socket, log) = (Arc::clone(socket), Arc::clone(log));
    let life = Arc::new(());
    let lives = Arc::downgrade(&life);
    let run = move || {
        let _life = life;
        if let Some(why) = attend(&socket, peer, &requests, session)
            && log.allows(Instant::now())
        {
            info!("{peer} (UDP): forgotten, without an answer: {}", Visible(why));
        }
    };
    thread::Builder::new().name("udp".to_owned()).spawn(run).map_err(|error| error.to_string())?;
    clients.insert(peer, Client { requests: sender, lives });
    Ok(())
}

/// Answers a client until he is forgotten, or why he has to be.
fn attend(
    socket: &UdpSocket,
    peer: SocketAddr,
    requests: &Receiver<Packet>,
    mut session: Session,
) -> Option<String> {
    let mut last = Instant::now();
    loop {
        match requests.recv_timeout(LOOK) {
            Ok(packet) => match session.answer(&packet) {
                Answer::Reply(reply) => {
                    last = Instant::now();
                    // An answer may get lost; the client asks again.
                    let _ = socket.send_to(&reply, peer);
                }
                Answer::End(why) => return Some(why),
            },
            Err(RecvTimeoutError::Disconnected) => return None,
            Err(RecvTimeoutError::Timeout) if last.elapsed() >= REMEMBERED => return None,
            Err(RecvTimeoutError::Timeout) => {
                if let Err(why) = session.renew() {
                    return Some(why);
                }
            }
        }
    }
}
