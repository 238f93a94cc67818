//! Gives places to connections, whose number is limited.
//!
//! No user can take all places, not even root or the daemon's own user. The last eighth is for users who hold fewer
//! than four, and half of that eighth for users who may do more than observe. Every user except root and the daemon's
//! own has a limit as well. If a user has no place left, an idle connection of that user gives up its place: the next
//! connection may bring a stop. If all places are taken, another user's connection that has made no call since its
//! arrival gives up its place, too. The daemon has fewer places than descriptors, so clients can never take the
//! descriptors that the daemon itself needs.

use std::io;
use std::os::fd::AsFd;
use std::time::{Duration, Instant};

use log::warn;
use nix::poll::{PollFd, PollFlags};
use nix::unistd::{Uid, geteuid};

use super::audit::AuditLimit;
use super::clients::Clients;
use super::connection::Client;
use super::listener::Listener;
use super::options::ServeOptions;
use super::peer_process::peer_process;
use super::policy::{Peer, Policy, PolicyError, Role};
use crate::daemon::shared::trouble::Trouble;
use crate::device::system::descriptors::descriptors_left;
use crate::protocol::{CallError, Reply};

/// How often the daemon checks the socket's path.
const PATH_LOOK: Duration = Duration::from_secs(1);
/// How long accepting pauses when the system has no more descriptors or memory.
const ACCEPT_PAUSE: Duration = Duration::from_millis(200);
/// How often the log repeats the failure to accept while it lasts.
const SAY_AGAIN: Duration = Duration::from_secs(60);
/// The most connections accepted in one go.
const ACCEPT_MAX: usize = 64;
/// A user who holds fewer than this gets a place of the reserve.
const FEW: usize = 4;
/// Descriptors kept for the daemon itself: interrupts that come back, the log.
const DESCRIPTORS_KEPT: usize = 16;
/// Descriptors of a connection: the socket's, and that of the process that connected.
const OF_CONNECTION: usize = 2;

/// The numbers of places.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Places {
    all: usize,
    of_user: usize,
}

/// Why a connection gets no place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Full {
    /// The user has as many places as a user may have.
    User,
    /// Other connections hold all places that this user may use.
    All,
}

impl Places {
    fn new(options: &ServeOptions, descriptors: usize) -> Self {
        let all = options.max_clients.min(descriptors);
        Self { all, of_user: options.max_clients_per_user.min(all) }
    }

    /// Checks that a place is free, with `taken` places taken, `held` of them by the same user.
    fn room(&self, taken: usize, held: usize, uid: Uid, role: Role) -> Result<(), Full> {
        let reserve = self.all / 8;
        let kept_from = match (held < FEW, role) {
            (true, Role::Stop | Role::Operate | Role::Engineer) => 0,
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

/// The listener, the places, and the policy for new connections.
pub(super) struct Admission {
    listener: Listener,
    policy: Policy,
    places: Places,
    /// Until when the server accepts no connection.
    pause: Option<Instant>,
    said: Option<Instant>,
    /// When to check again that the socket's path leads to the listener.
    look: Instant,
    trouble: Trouble,
}

impl Admission {
    /// As many places as `options` and the limit of descriptors allow now.
    ///
    /// # Errors
    /// [`PolicyError`] when a group is unknown.
    pub(super) fn new(options: &ServeOptions, listener: Listener) -> Result<Self, PolicyError> {
        let policy = Policy::new(&options.roles)?;
        let places =
            Places::new(options, descriptors_left().saturating_sub(DESCRIPTORS_KEPT) / OF_CONNECTION);
        if places.all < options.max_clients {
            warn!(
                "room for {} connections, not {}: the limit of open files (LimitNOFILE) is too low",
                places.all, options.max_clients
            );
        }
        Ok(Self {
            listener,
            policy,
            places,
            pause: None,
            said: None,
            look: Instant::now() + PATH_LOOK,
            trouble: Trouble::default(),
        })
    }

    /// The descriptor and the events to poll for.
    pub(super) fn interest(&self) -> PollFd<'_> {
        let flags = if self.pause.is_none() { PollFlags::POLLIN } else { PollFlags::empty() };
        PollFd::new(self.listener.as_fd(), flags)
    }

    /// When the pause is over, or the next check of the socket's path is due.
    pub(super) fn next_deadline(&self) -> Option<Instant> {
        Some(self.pause.map_or(self.look, |pause| pause.min(self.look)))
    }

    /// Ends a pause whose time is over, and restores the path of a socket that has lost it.
    pub(super) fn expire(&mut self, now: Instant) {
        self.pause = self.pause.filter(|until| *until > now);
        if self.look <= now {
            self.look = now + PATH_LOOK;
            self.trouble.note(self.listener.keep());
        }
    }

    /// A connection has ended, so a descriptor is free again.
    pub(super) fn resume(&mut self) {
        self.pause = None;
    }

    /// Accepts waiting connections, a limited number at a time, which leaves time for the connected clients.
    pub(super) fn accept(
        &mut self,
        clients: &mut Clients,
        holds: impl Fn(u64) -> bool,
        audit: &mut AuditLimit,
        now: Instant,
    ) {
        for _ in 0..ACCEPT_MAX {
            match self.listener.accept() {
                Ok(stream) => {
                    let Ok(peer) = Peer::of(&stream) else { continue };
                    let role = self.policy.role_of(&peer, &stream);
                    let process = peer_process(&stream, peer.pid).unwrap_or_else(|error| {
                        let Peer { uid, pid, .. } = peer;
                        let harm = "its jog ends with its connection, which a forked process can hold open";
                        audit.tell(
                            uid,
                            format_args!("uid {uid} pid {pid} is not watched: {error}; {harm}"),
                            now,
                        );
                        None
                    });
                    let client = Client::new(stream, peer, role, now).of_process(process);
                    self.admit(client, clients, &holds, audit, now);
                }
                Err(error) => match error.kind() {
                    io::ErrorKind::WouldBlock => return,
                    io::ErrorKind::Interrupted | io::ErrorKind::ConnectionAborted => {}
                    _ => return self.failed(&error, now),
                },
            }
        }
    }

    /// Gives the connection a place, if one is free or can be freed. `holds` tells whether a jog, a sequence or the
    /// like ends with another connection.
    pub(super) fn admit(
        &self,
        mut client: Client,
        clients: &mut Clients,
        holds: impl Fn(u64) -> bool,
        audit: &mut AuditLimit,
        now: Instant,
    ) {
        let Peer { uid, pid, .. } = client.peer();
        if let Err(full) = self.places.room(clients.count(), clients.held_by(uid), uid, client.role()) {
            let Some(idle) = clients.make_room(uid, full == Full::All, holds, now) else {
                audit.tell(uid, format_args!("refused a connection of uid {uid} pid {pid}: too many"), now);
                let reason = "too many connections; close some".to_owned();
                return client.reply(&Reply::of_error(&CallError::Unavailable { reason }), now);
            };
            let Peer { uid, pid, .. } = idle;
            let what =
                format_args!("dropped a connection of uid {uid} pid {pid}: idle, and its place is needed");
            audit.tell(uid, what, now);
        }
        clients.add(client);
    }

    fn failed(&mut self, error: &io::Error, now: Instant) {
        self.pause = Some(now + ACCEPT_PAUSE);
        if self.said.is_none_or(|said| now >= said + SAY_AGAIN) {
            warn!("accepting a connection: {error}; trying again until it can be");
            self.said = Some(now);
        }
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

    /// The places that one user gets by asking again and again, when other users hold `taken` places.
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
        // Other users still get in: each takes all the places that the daemon gives.
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
        assert_eq!(gets(&places, taken, stranger(9), Role::Stop), FEW);
        assert_eq!(places.room(256, 0, Uid::from_raw(0), Role::Engineer), Err(Full::All));
        assert_eq!(places.room(100, 64, stranger(9), Role::Operate), Err(Full::User));
    }

    #[test]
    fn there_are_no_more_places_than_descriptors() {
        let options = ServeOptions::new("unused".into());
        assert_eq!(Places::new(&options, 20), Places { all: 20, of_user: 20 });
        assert_eq!(Places::new(&options, 10_000), Places { all: 256, of_user: 64 });
    }
}
