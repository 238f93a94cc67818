//! Gives up for good every right that only the opening of the board needs.
//!
//! Each thread has its own rights, so this happens while there is only one thread. It changes to another user and its
//! groups, empties every capability set, and prevents new rights from running other programs. Then it reads the result
//! back from the kernel.

use std::ffi::CString;
use std::fmt;

use caps::CapSet;
use nix::sys::mman::{MlockAllFlags, mlockall};
use nix::sys::prctl;
use nix::sys::resource::{RLIM_INFINITY, Resource, getrlimit, rlim_t, setrlimit};
use nix::unistd::{
    Gid, Group, Uid, User, getegid, geteuid, getresgid, getresuid, initgroups, setresgid, setresuid,
};

use crate::process::capabilities::{self, CapabilityError, SETS};

/// Locking fails below this limit, because the kernel counts the whole address space.
const ENOUGH_BYTES: rlim_t = 1 << 30;

/// The process could not give up a right, or could not look up the new user.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PrivilegeError {
    /// The system does not know the user.
    #[error("user {0:?} does not exist; create it or correct --user")]
    NoSuchUser(String),
    /// The process cannot read the user data base.
    #[error("looking up user {user:?}: {source}")]
    Lookup {
        /// The user.
        user: String,
        /// The system's error.
        source: nix::Error,
    },
    /// Only root can change to another user.
    #[error("cannot become user {user:?}: only root can; this is user {uid}")]
    NotRoot {
        /// The new user.
        user: String,
        /// The current user.
        uid: Uid,
    },
    /// The kernel refused.
    #[error("giving up privileges: {what}: {reason}")]
    Refused {
        /// The failed step.
        what: &'static str,
        /// The kernel's error.
        reason: String,
    },
    /// The process could not give up a capability.
    #[error(transparent)]
    Capabilities(#[from] CapabilityError),
    /// The kernel reported success, but a right is left.
    #[error("giving up privileges succeeded, but {0}")]
    Left(String),
}

fn refused(what: &'static str) -> impl FnOnce(nix::Error) -> PrivilegeError {
    move |errno| PrivilegeError::Refused { what, reason: errno.to_string() }
}

/// The new user.
#[derive(Debug, Clone)]
pub struct Account {
    name: CString,
    /// Its number.
    pub uid: Uid,
    /// Its primary group.
    pub gid: Gid,
}

impl Account {
    /// Looks up the user `name`, and checks that this process is root or already that user.
    ///
    /// # Errors
    /// [`PrivilegeError`] if the user does not exist, or if only root can change to it.
    pub fn named(name: &str) -> Result<Self, PrivilegeError> {
        let user = User::from_name(name);
        let user = user.map_err(|source| PrivilegeError::Lookup { user: name.to_owned(), source })?;
        let user = user.ok_or_else(|| PrivilegeError::NoSuchUser(name.to_owned()))?;
        let uid = geteuid();
        if !uid.is_root() && uid != user.uid {
            return Err(PrivilegeError::NotRoot { user: name.to_owned(), uid });
        }
        let c_name = CString::new(name).map_err(|_| PrivilegeError::NoSuchUser(name.to_owned()))?;
        Ok(Self { name: c_name, uid: user.uid, gid: user.gid })
    }

    /// Changes every user and group id, and the groups. If the process is already that user, it changes nothing: the
    /// unit chose the groups.
    fn assume(&self) -> Result<(), PrivilegeError> {
        if !geteuid().is_root() {
            return Ok(());
        }
        initgroups(&self.name, self.gid).map_err(refused("setgroups"))?;
        setresgid(self.gid, self.gid, self.gid).map_err(refused("setgid"))?;
        setresuid(self.uid, self.uid, self.uid).map_err(refused("setuid"))?;
        let user = getresuid().map_err(refused("getresuid"))?;
        let group = getresgid().map_err(refused("getresgid"))?;
        if [user.real, user.effective, user.saved] != [self.uid; 3] {
            return Err(PrivilegeError::Left(format!("the users are {user:?}")));
        }
        if [group.real, group.effective, group.saved] != [self.gid; 3] {
            return Err(PrivilegeError::Left(format!("the groups are {group:?}")));
        }
        Ok(())
    }
}

/// Changes to `account`, if one is given, then gives up every capability for good. The process must have one thread.
///
/// # Errors
/// [`PrivilegeError`] if a step fails, or if the kernel then still shows a right.
pub fn give_up(account: Option<&Account>) -> Result<(), PrivilegeError> {
    // This needs a right that goes next. If it fails, the log line about the remaining rights shows it.
    capabilities::empty_bounding();
    if let Some(account) = account {
        account.assume()?;
    }
    capabilities::give_up()?;
    Ok(())
}

/// Raises the limit of locked memory for [`lock_memory`]: to infinity as root, else to the hard limit. The unit already
/// sets infinity, and then this makes no call that the unit forbids.
pub fn allow_locking() {
    let Ok((soft, hard)) = getrlimit(Resource::RLIMIT_MEMLOCK) else { return };
    if soft != RLIM_INFINITY && setrlimit(Resource::RLIMIT_MEMLOCK, RLIM_INFINITY, RLIM_INFINITY).is_err() {
        let _ = setrlimit(Resource::RLIMIT_MEMLOCK, hard, hard);
    }
}

/// Locks everything that is mapped now in memory, and describes the result. Call it after the threads start, so that it
/// includes their stacks. Memory allocated later for clients is not locked; the bus thread does not use it.
#[must_use]
pub fn lock_memory() -> String {
    match (mlockall(MlockAllFlags::MCL_CURRENT), getrlimit(Resource::RLIMIT_MEMLOCK)) {
        (Ok(()), _) => "memory locked".to_owned(),
        (Err(_), Ok((limit, _))) if limit < ENOUGH_BYTES => {
            format!("memory not locked (LimitMEMLOCK is {} KiB, too little)", limit / 1024)
        }
        (Err(errno), _) => format!("memory not locked ({errno})"),
    }
}

/// The rights of the calling thread, from the kernel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Holdings {
    /// The effective user.
    pub uid: Uid,
    /// The effective group.
    pub gid: Gid,
    /// The capabilities in all sets except the bounding set.
    pub capabilities: Vec<String>,
    /// The size of the bounding set: the most capabilities that a child program could get.
    pub bounding: usize,
    /// Whether other programs run without new rights.
    pub no_new_privileges: bool,
}

impl Holdings {
    /// Reads the rights from the kernel.
    #[must_use]
    pub fn read() -> Self {
        let of = |set| caps::read(None, set).unwrap_or_default();
        let mut capabilities: Vec<String> =
            SETS.into_iter().flat_map(of).map(|capability| capability.to_string()).collect();
        capabilities.sort_unstable();
        capabilities.dedup();
        Self {
            uid: geteuid(),
            gid: getegid(),
            capabilities,
            bounding: of(CapSet::Bounding).len(),
            no_new_privileges: prctl::get_no_new_privs().unwrap_or(false),
        }
    }
}

impl fmt::Display for Holdings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = User::from_uid(self.uid).ok().flatten().map(|user| user.name);
        let group = Group::from_gid(self.gid).ok().flatten().map(|group| group.name);
        write!(f, "user {} ({})", name.as_deref().unwrap_or("?"), self.uid)?;
        write!(f, ", group {} ({})", group.as_deref().unwrap_or("?"), self.gid)?;
        match self.capabilities.as_slice() {
            [] => write!(f, ", no capabilities")?,
            some => write!(f, ", capabilities {}", some.join(" "))?,
        }
        write!(f, " (bounding set {})", self.bounding)?;
        f.write_str(if self.no_new_privileges { ", no new privileges" } else { ", new privileges possible" })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thread_that_gave_up_holds_nothing() {
        // Capabilities are a thread's own: the other tests keep theirs.
        let holdings = std::thread::spawn(|| {
            give_up(None).unwrap();
            Holdings::read()
        });
        let holdings = holdings.join().unwrap();
        assert_eq!(holdings.capabilities, [""; 0]);
        assert!(holdings.no_new_privileges);
        let text = holdings.to_string();
        assert!(
            text.contains("no capabilities (bounding set ") && text.ends_with("no new privileges"),
            "{text}"
        );
    }

    #[test]
    fn who_one_cannot_become_is_named() {
        let error = Account::named("no-such-user-here").unwrap_err();
        assert!(
            matches!(error, PrivilegeError::NoSuchUser(_)) && error.to_string().contains("no-such-user-here")
        );
        let own = User::from_uid(geteuid()).unwrap().unwrap();
        assert_eq!(Account::named(&own.name).unwrap().uid, geteuid());
    }
}
