//! Who gets one of the places for connections, which are few.
//!
//! No single user can take them all, not even root or the daemon's own user: the last eighth is for users who hold
//! hardly any, and half of that for those who may operate. Other users have a limit of their own besides. Where a
//! newcomer would be refused, a connection that never asked anything for as long as a client may keep the daemon
//! waiting gives its place up. There are never more places than descriptors, so that running out of these is the
//! system's fault, and passes; nothing that runs in the daemon is refused one because of clients.

use std::collections::HashMap;
use std::io;
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use log::warn;
use nix::unistd::{Gid, Uid, geteuid};

use super::{ServeOptions, Service};
use crate::daemon::socket::connection::Client;
use crate::daemon::socket::policy::{Peer, Policy, Role};
use crate::device::machine::descriptors::descriptors_left;
use crate::protocol::{CallError, Reply};

/// How long accepting pauses when the system has no more descriptors or memory.
const ACCEPT_PAUSE: Duration = Duration::from_millis(200);
/// How often that is said while it lasts.
const SAY_AGAIN: Duration = Duration::from_secs(60);
/// The most connections accepted in one go.
const ACCEPT_MAX: usize = 64;
/// Who holds fewer than this gets a place of the reserve.
const FEW: usize = 4;
/// Descriptors that are kept for the daemon itself: interrupts that come back, the name service, the log.
const KEPT: usize = 16;
/// How long a user's role is remembered. Whoever connects again and again does not make the daemon ask the name service
/// each time, which may be slow.
const ROLE_LASTS: Duration = Duration::from_secs(5);
/// Users whose role is remembered.
const ROLES_MAX: usize = 256;

/// How many places there are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Places {
    all: usize,
    of_user: usize,
}

/// Why there is none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Full {
    /// The user has his share.
    User,
    /// All that this user may have are taken.
    All,
}

impl Places {
    fn new(options: &ServeOptions, descriptors: usize) -> Self {
        let all = options.max_clients.min(descriptors).max(1);
        Self { all, of_user: options.max_clients_per_user.min(all) }
    }

    /// Whether one more connection may stay, with `taken` there already, `held` of the same user.
    fn room(&self, taken: usize, held: usize, uid: Uid, role: Role) -> Result<(), Full> {
        let reserve = self.all / 8;
        let kept_from = match (held < FEW, role) {
            (true, Role::Operate | Role::Engineer) => 0,
            (true, Role::Observe) => reserve / 2,
            (false, _) => reserve,
        };
        if held >= self.of_user && !is_trusted(uid) {
            Err(Full::User)
        } else if taken + kept_from >= self.all {
            Err(Full::All)
        } else {
            Ok(())
        }
    }
}

fn is_trusted(uid: Uid) -> bool {
    uid.is_root() || uid == geteuid()
}

/// What is known of places and of those who want one.
#[derive(Debug)]
pub(super) struct Admission {
    places: Places,
    roles: HashMap<(Uid, Gid), (Role, Instant)>,
    /// Until when nobody is accepted.
    pub(super) pause: Option<Instant>,
    said: Option<Instant>,
}

impl Admission {
    /// As many places as `options` and the limit of descriptors allow now.
    pub(super) fn new(options: &ServeOptions) -> Self {
        let places = Places::new(options, descriptors_left().saturating_sub(KEPT));
        if places.all < options.max_clients {
            warn!(
                "room for {} connections, not {}: the limit of open files (LimitNOFILE) is too low",
                places.all, options.max_clients
            );
        }
        Self { places, roles: HashMap::new(), pause: None, said: None }
    }

    fn role_of(&mut self, peer: &Peer, policy: &Policy, now: Instant) -> Role {
        if let Some((role, until)) = self.roles.get(&(peer.uid, peer.gid))
            && now < *until
        {
            return *role;
        }
        if self.roles.len() >= ROLES_MAX {
            self.roles.clear();
        }
        let role = policy.role_of(peer);
        self.roles.insert((peer.uid, peer.gid), (role, now + ROLE_LASTS));
        role
    }

    fn failed(&mut self, error: &io::Error, now: Instant) {
        self.pause = Some(now + ACCEPT_PAUSE);
        if self.said.is_none_or(|said| now >= said + SAY_AGAIN) {
            warn!("accepting a connection: {error}; trying again until it can be");
            self.said = Some(now);
        }
    }
}

impl Service {
    pub(super) fn accept(&mut self, now: Instant) {
        // Whoever connects faster than this still leaves time for everybody else.
        for _ in 0..ACCEPT_MAX {
            match self.listener.accept() {
                Ok(stream) => self.admit(stream, now),
                Err(error) => match error.kind() {
                    io::ErrorKind::WouldBlock => return,
                    io::ErrorKind::Interrupted | io::ErrorKind::ConnectionAborted => {}
                    _ => return self.admission.failed(&error, now),
                },
            }
        }
    }

    fn admit(&mut self, stream: UnixStream, now: Instant) {
        let Ok(peer) = Peer::of(&stream) else { return };
        let role = self.admission.role_of(&peer, &self.policy, now);
        self.enter(stream, peer, role, now);
    }

    /// Gives the connection a place, if there is one.
    pub(super) fn enter(&mut self, stream: UnixStream, peer: Peer, role: Role, now: Instant) {
        let client = Client::new(stream, peer, role, now);
        let room = self.admission.places.room(self.clients.len(), self.held_by(peer.uid), peer.uid, role);
        if let Err(full) = room
            && !self.make_room(full, &peer, now)
        {
            return self.turn_away(client, now);
        }
        self.clients.insert(self.next_client, client);
        self.next_client += 1;
    }

    fn held_by(&self, uid: Uid) -> usize {
        self.clients.values().filter(|client| client.peer.uid == uid).count()
    }

    /// Takes the place of the one that has been silent longest, from its first moment on: of the same user, or of one
    /// who holds more, where that helps.
    fn make_room(&mut self, full: Full, newcomer: &Peer, now: Instant) -> bool {
        let held = self.held_by(newcomer.uid);
        let patience = self.options.patience;
        let silent = self.clients.iter().find(|(_, client)| {
            let uid = client.peer.uid;
            client.is_silent(now, patience)
                && (uid == newcomer.uid || full == Full::All && self.held_by(uid) > held)
        });
        let Some((&id, _)) = silent else { return false };
        if let Some(Peer { uid, pid, .. }) = self.clients.remove(&id).map(|client| client.peer) {
            let what =
                format_args!("dropped a connection of uid {uid} pid {pid}: silent, and its place is needed");
            self.audit.tell(uid, what, now);
        }
        true
    }

    fn turn_away(&mut self, mut client: Client, now: Instant) {
        let Peer { uid, pid, .. } = client.peer;
        let what = format_args!("refused a connection of uid {uid} pid {pid}: too many");
        self.audit.tell(uid, what, now);
        let reason = "too many connections; close some".to_owned();
        client.reply(&Reply::of_error(&CallError::Unavailable { reason }), now);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn places(all: usize, of_user: usize) -> Places {
        let options = ServeOptions {
            max_clients: all,
            max_clients_per_user: of_user,
            ..ServeOptions::new("unused".into())
        };
        Places::new(&options, usize::MAX)
    }

    /// Places that one user gets by asking again and again, when `taken` are taken by others.
    fn gets(places: &Places, taken: usize, uid: Uid, role: Role) -> usize {
        (0..).take_while(|held| places.room(taken + held, *held, uid, role).is_ok()).count()
    }

    #[test]
    fn no_user_takes_the_last_places() {
        let places = places(256, 64);
        let stranger = |number: u32| Uid::from_raw(4_000_000_000 + number);
        assert_eq!(gets(&places, 0, stranger(0), Role::Engineer), 64);
        for trusted in [Uid::from_raw(0), geteuid()] {
            assert_eq!(gets(&places, 0, trusted, Role::Engineer), 224);
        }
        // Then others still get in, whoever they are: users of whom each takes what he gets.
        let mut taken = 224;
        let mut observers = 0;
        loop {
            let got = gets(&places, taken, stranger(observers), Role::Observe);
            if got == 0 {
                break;
            }
            taken += got;
            observers += 1;
        }
        assert_eq!((taken, observers), (240, 4));
        assert_eq!(places.room(taken, 0, stranger(9), Role::Observe), Err(Full::All));
        assert_eq!(gets(&places, taken, stranger(9), Role::Operate), FEW);
        assert_eq!(places.room(256, 0, Uid::from_raw(0), Role::Engineer), Err(Full::All));
        assert_eq!(places.room(100, 64, stranger(9), Role::Operate), Err(Full::User));
    }

    #[test]
    fn there_are_no_more_places_than_descriptors() {
        let options = ServeOptions::new("unused".into());
        assert_eq!(Places::new(&options, 20), Places { all: 20, of_user: 20 });
        assert_eq!(Places::new(&options, 0).all, 1);
        assert_eq!(Places::new(&options, 10_000), Places { all: 256, of_user: 64 });
    }
}
