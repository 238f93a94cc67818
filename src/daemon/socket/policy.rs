//! Who may ask the board for what.
//!
//! Whoever may connect to the socket may observe. Groups named in the settings raise a user to operate or engineer;
//! root and the daemon's own user are engineers.

use std::ffi::CString;
use std::fmt;
use std::os::unix::net::UnixStream;

use nix::sys::socket::{getsockopt, sockopt::PeerCredentials};
use nix::unistd::{Gid, Group, Uid, User, geteuid, getgrouplist};

/// What a peer may do; each role includes those before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Role {
    /// Look: information, words of the DPRAM, watched registers, texts that programs send.
    Observe,
    /// Move the machine: the panel's keys (jog, home, start, step, stop, hold), feed rate override, every control character
    /// (`^A` and `^K` stop, `^R` starts programs).
    Operate,
    /// Do everything: send any command line, write the DPRAM, gather, stream.
    Engineer,
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Observe => "observe",
            Self::Operate => "operate",
            Self::Engineer => "engineer",
        })
    }
}

/// The settings: the names of the groups that raise a user's role.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Roles {
    /// Members operate.
    pub operate: Vec<String>,
    /// Members are engineers.
    pub engineer: Vec<String>,
}

/// A group in the settings cannot be looked up.
#[derive(Debug, thiserror::Error)]
pub enum PolicyError {
    /// The system does not know it.
    #[error("group {0:?} does not exist; create it or correct the settings")]
    NoSuchGroup(String),
    /// The group data base cannot be read.
    #[error("looking up group {group:?}")]
    Lookup {
        /// The group.
        group: String,
        /// What the system said.
        source: nix::Error,
    },
}

/// The number of the group called `name`.
///
/// # Errors
/// [`PolicyError`] when the system does not know it.
pub fn group_id(name: &str) -> Result<Gid, PolicyError> {
    match Group::from_name(name) {
        Ok(Some(group)) => Ok(group.gid),
        Ok(None) => Err(PolicyError::NoSuchGroup(name.to_owned())),
        Err(source) => Err(PolicyError::Lookup { group: name.to_owned(), source }),
    }
}

/// The other end of a connection, as the kernel vouches for it at the time of `connect`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Peer {
    /// Its user.
    pub uid: Uid,
    /// Its primary group.
    pub gid: Gid,
    /// Its process.
    pub pid: i32,
}

impl Peer {
    /// Who is at the other end of `stream`.
    ///
    /// # Errors
    /// When the kernel does not say.
    pub fn of(stream: &UnixStream) -> nix::Result<Self> {
        let credentials = getsockopt(stream, PeerCredentials)?;
        Ok(Self {
            uid: Uid::from_raw(credentials.uid()),
            gid: Gid::from_raw(credentials.gid()),
            pid: credentials.pid(),
        })
    }

    /// Every group its user is in. May ask a name service, so it belongs on the socket's thread only.
    fn groups(&self) -> Vec<Gid> {
        let name = User::from_uid(self.uid).ok().flatten().and_then(|user| CString::new(user.name).ok());
        name.and_then(|name| getgrouplist(&name, self.gid).ok()).unwrap_or_else(|| vec![self.gid])
    }
}

/// The settings with group names turned into numbers.
#[derive(Debug, Clone, Default)]
pub struct Policy {
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
        Ok(Self { operate: all(&roles.operate)?, engineer: all(&roles.engineer)? })
    }

    /// What `peer` may do.
    #[must_use]
    pub fn role_of(&self, peer: &Peer) -> Role {
        if peer.uid.is_root() || peer.uid == geteuid() {
            return Role::Engineer;
        }
        if self.operate.is_empty() && self.engineer.is_empty() {
            return Role::Observe;
        }
        self.role_by_groups(&peer.groups())
    }

    fn role_by_groups(&self, groups: &[Gid]) -> Role {
        let in_any = |wanted: &[Gid]| wanted.iter().any(|gid| groups.contains(gid));
        if in_any(&self.engineer) {
            Role::Engineer
        } else if in_any(&self.operate) {
            Role::Operate
        } else {
            Role::Observe
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_raise_the_role_and_the_highest_counts() {
        let gid = Gid::from_raw;
        let policy = Policy { operate: vec![gid(10), gid(11)], engineer: vec![gid(20)] };
        assert_eq!(policy.role_by_groups(&[]), Role::Observe);
        assert_eq!(policy.role_by_groups(&[gid(9), gid(11)]), Role::Operate);
        assert_eq!(policy.role_by_groups(&[gid(10), gid(20)]), Role::Engineer);
    }

    #[test]
    fn a_stranger_observes_and_the_own_user_is_an_engineer() {
        let peer = |uid: Uid| Peer { uid, gid: Gid::from_raw(65_500), pid: 1 };
        let policy = Policy { operate: vec![Gid::from_raw(65_501)], ..Policy::default() };
        assert_eq!(policy.role_of(&peer(Uid::from_raw(4_000_000_001))), Role::Observe);
        assert_eq!(policy.role_of(&peer(geteuid())), Role::Engineer);
        let by_primary_group = Peer { gid: Gid::from_raw(65_501), ..peer(Uid::from_raw(4_000_000_001)) };
        assert_eq!(policy.role_of(&by_primary_group), Role::Operate);
    }

    #[test]
    fn an_unknown_group_is_named() {
        let roles = Roles { operate: vec!["no-such-group-here".to_owned()], ..Roles::default() };
        assert!(Policy::new(&roles).unwrap_err().to_string().contains("no-such-group-here"));
    }
}
