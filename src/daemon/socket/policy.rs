//! The rights of clients: which calls each role may make.
//!
//! Any user who may connect to the socket may observe. Groups named in the settings raise a user to stop, operate or
//! engineer; root and the daemon's own user are engineers.
//!
//! The daemon looks up the groups' names once, at the start. The kernel tells a peer's groups. So no connection waits
//! for a name service, and no stop waits behind it.

use std::fmt;
use std::os::unix::net::UnixStream;

use nix::unistd::{Gid, Group, geteuid};

use super::peer_groups::peer_groups;
pub use crate::daemon::shared::peer::Peer;
use crate::protocol::control;

/// The rights of a peer; each role includes the roles before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Role {
    /// Look: information, words of the DPRAM, watched registers, texts that programs send.
    Observe,
    /// Stop the machine: abort, kill, hold, stop a jog, feed rate 0. A kill opens every loop, so a vertical axis
    /// without a brake falls; an abort and the stop of a jog close the loops of killed motors.
    Stop,
    /// Move the machine: the panel's keys (jog, home, start, step), feed rate override, and the control characters that
    /// the settings name.
    Operate,
    /// Do everything: send any command line and control character, write the DPRAM, gather, stream.
    Engineer,
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Observe => "observe",
            Self::Stop => "stop",
            Self::Operate => "operate",
            Self::Engineer => "engineer",
        })
    }
}

impl Role {
    /// Every role, from the least to the most.
    pub const ALL: [Self; 4] = [Self::Observe, Self::Stop, Self::Operate, Self::Engineer];
}

/// The control characters that the role operate may send, one bit each. The role stop may always send `^A`, `^K` and
/// `^O`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Characters(u32);

impl Characters {
    /// The characters that `names` lists, as `^R`.
    ///
    /// # Errors
    /// The place of the first name that is no character, or a character that only engineers may send, and why.
    pub fn named(names: &[String]) -> Result<Self, (usize, String)> {
        let mut characters = Self(0);
        for (index, name) in names.iter().enumerate() {
            match control::parse(name) {
                Some(control::SERIAL) => {
                    let why =
                        "^Z ends command lines for everybody, so only engineers may send it; leave it out";
                    return Err((index, why.to_owned()));
                }
                Some(character) => characters.0 |= 1 << character,
                None => {
                    return Err((index, format!("{name:?} is no control character; write \"^A\" to \"^_\"")));
                }
            }
        }
        Ok(characters)
    }

    /// The role that may send `character`.
    #[must_use]
    pub fn role_for(self, character: u8) -> Role {
        match character {
            _ if control::stops(character) => Role::Stop,
            character if self.0 >> (character & 0x1F) & 1 != 0 => Role::Operate,
            _ => Role::Engineer,
        }
    }
}

/// `^A ^K ^O ^Q ^R ^S`: the characters that stop, run and step every program.
impl Default for Characters {
    fn default() -> Self {
        let characters =
            [control::ABORT, control::KILL, control::HOLD, control::QUIT, control::RUN, control::STEP];
        Self(characters.iter().fold(0, |set, character| set | 1 << character))
    }
}

/// The settings: the names of the groups that raise a user's role.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Roles {
    /// Members may stop the machine.
    pub stop: Vec<String>,
    /// Members operate.
    pub operate: Vec<String>,
    /// Members are engineers.
    pub engineer: Vec<String>,
    /// The control characters that operators may send.
    pub operate_characters: Characters,
}

/// The daemon cannot look up a group in the settings.
#[derive(Debug, thiserror::Error)]
pub enum PolicyError {
    /// The system does not know the group.
    #[error("group {0:?} does not exist; create it or correct the settings")]
    NoSuchGroup(String),
    /// The daemon cannot read the group data base.
    #[error("looking up group {group:?}: {source}; see to the name service (/etc/nsswitch.conf)")]
    Lookup {
        /// The group.
        group: String,
        /// The system's error.
        source: nix::Error,
    },
}

impl PolicyError {
    /// Whether the settings are wrong. Otherwise the name service failed, which may pass.
    #[must_use]
    pub const fn is_of_settings(&self) -> bool {
        matches!(self, Self::NoSuchGroup(_))
    }
}

/// The number of the group called `name`.
///
/// # Errors
/// [`PolicyError`] when the system does not know the group.
pub fn group_id(name: &str) -> Result<Gid, PolicyError> {
    match Group::from_name(name) {
        Ok(Some(group)) => Ok(group.gid),
        Ok(None) => Err(PolicyError::NoSuchGroup(name.to_owned())),
        Err(source) => Err(PolicyError::Lookup { group: name.to_owned(), source }),
    }
}

/// The settings with group names turned into numbers.
#[derive(Debug, Clone, Default)]
pub struct Policy {
    stop: Vec<Gid>,
    operate: Vec<Gid>,
    engineer: Vec<Gid>,
}

impl Policy {
    /// Looks up the groups of `roles`.
    ///
    /// # Errors
    /// [`PolicyError`] naming a group that does not exist.
    pub fn new(roles: &Roles) -> Result<Self, PolicyError> {
        let all = |names: &[String]| names.iter().map(|name| group_id(name)).collect::<Result<Vec<_>, _>>();
        Ok(Self { stop: all(&roles.stop)?, operate: all(&roles.operate)?, engineer: all(&roles.engineer)? })
    }

    /// The role of `peer` at the other end of `stream`: by its groups when it connected, primary and others.
    #[must_use]
    pub fn role_of(&self, peer: &Peer, stream: &UnixStream) -> Role {
        if peer.uid.is_root() || peer.uid == geteuid() {
            return Role::Engineer;
        }
        // If the kernel does not tell the groups, the primary group alone counts.
        let mut groups = peer_groups(stream).unwrap_or_default();
        groups.push(peer.gid);
        self.role_by_groups(&groups)
    }

    fn role_by_groups(&self, groups: &[Gid]) -> Role {
        let in_any = |wanted: &[Gid]| wanted.iter().any(|gid| groups.contains(gid));
        if in_any(&self.engineer) {
            Role::Engineer
        } else if in_any(&self.operate) {
            Role::Operate
        } else if in_any(&self.stop) {
            Role::Stop
        } else {
            Role::Observe
        }
    }
}

#[cfg(test)]
mod tests {
    use nix::unistd::Uid;

    use super::*;

    fn gid(number: u32) -> Gid {
        Gid::from_raw(number)
    }

    #[test]
    fn groups_raise_the_role_and_the_highest_counts() {
        let policy = Policy { stop: vec![gid(5)], operate: vec![gid(10), gid(11)], engineer: vec![gid(20)] };
        assert_eq!(policy.role_by_groups(&[]), Role::Observe);
        assert_eq!(policy.role_by_groups(&[gid(5), gid(9)]), Role::Stop);
        assert_eq!(policy.role_by_groups(&[gid(9), gid(11)]), Role::Operate);
        assert_eq!(policy.role_by_groups(&[gid(5), gid(10), gid(20)]), Role::Engineer);
    }

    #[test]
    fn a_stranger_observes_and_the_own_user_is_an_engineer() {
        let (ours, _theirs) = UnixStream::pair().unwrap();
        let peer = |uid: Uid| Peer { uid, gid: gid(65_500), pid: 1 };
        let policy = Policy { operate: vec![gid(65_501)], ..Policy::default() };
        assert_eq!(policy.role_of(&peer(Uid::from_raw(4_000_000_001)), &ours), Role::Observe);
        assert_eq!(policy.role_of(&peer(geteuid()), &ours), Role::Engineer);
        let by_primary_group = Peer { gid: gid(65_501), ..peer(Uid::from_raw(4_000_000_001)) };
        assert_eq!(policy.role_of(&by_primary_group, &ours), Role::Operate);
    }

    #[test]
    fn by_default_operators_send_what_runs_steps_and_stops_programs() {
        let default = Characters::default();
        for (names, role) in [("AKO", Role::Stop), ("QRS", Role::Operate), ("BDFGXZ", Role::Engineer)] {
            for letter in names.bytes() {
                assert_eq!(default.role_for(letter - 64), role, "^{}", char::from(letter));
            }
        }
        let none = Characters::named(&[]).unwrap();
        assert_eq!((none.role_for(control::KILL), none.role_for(control::RUN)), (Role::Stop, Role::Engineer));
        let named = |name: &str| Characters::named(&["^R".to_owned(), name.to_owned()]);
        assert_eq!(named("^d").unwrap().role_for(4), Role::Operate);
        assert!(named("^Z").unwrap_err().1.contains("only engineers"));
        assert_eq!(named("R").unwrap_err().0, 1);
    }

    #[test]
    fn an_unknown_group_is_named() {
        let roles = Roles { operate: vec!["no-such-group-here".to_owned()], ..Roles::default() };
        assert!(Policy::new(&roles).unwrap_err().to_string().contains("no-such-group-here"));
    }
}
