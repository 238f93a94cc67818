//! The groups of the process at the other end of a connection, as they were when it connected. The kernel tells them
//! (SO_PEERGROUPS, unix(7)), without a look at any data base.

use std::os::unix::net::UnixStream;

use nix::errno::Errno;
use nix::libc::{SO_PEERGROUPS, SOL_SOCKET, gid_t};
use nix::sys::socket::getsockopt;
use nix::sys::socket::sockopt::GetStruct;
use nix::unistd::Gid;

/// The question for the groups of a peer that is in just `N` groups.
#[derive(Debug, Clone, Copy)]
struct PeerGroups<const N: usize>;

/// `nix` reads options of a known size only. The kernel answers ERANGE while the room is too small, so the first size
/// that the kernel takes is the right one. A peer's groups never change.
macro_rules! peer_groups_of_sizes {
    ($($count:literal)*) => {
        $(const _: () = {
            type Sized = PeerGroups<$count>;
            nix::getsockopt_impl!(Sized, SOL_SOCKET, SO_PEERGROUPS, [gid_t; $count], GetStruct<[gid_t; $count]>);
        };)*

        /// The supplementary groups of the peer of `stream`.
        ///
        /// # Errors
        /// ERANGE if the peer has more than 64 groups; otherwise the kernel does not know the question (before Linux
        /// 4.13).
        pub(super) fn peer_groups(stream: &UnixStream) -> nix::Result<Vec<Gid>> {
            $(match getsockopt(stream, PeerGroups::<$count>) {
                Ok(groups) => return Ok(groups.map(Gid::from_raw).to_vec()),
                Err(Errno::ERANGE) => {}
                Err(errno) => return Err(errno),
            })*
            Err(Errno::ERANGE)
        }
    };
}

peer_groups_of_sizes! {
    0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21
    22 23 24 25 26 27 28 29 30 31 32 33 34 35 36 37 38 39 40 41 42 43
    44 45 46 47 48 49 50 51 52 53 54 55 56 57 58 59 60 61 62 63 64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kernel_tells_the_groups_of_a_peer() {
        let (ours, _theirs) = UnixStream::pair().unwrap();
        let mut told = peer_groups(&ours).unwrap();
        let mut own = nix::unistd::getgroups().unwrap();
        told.sort_by_key(|gid| gid.as_raw());
        own.sort_by_key(|gid| gid.as_raw());
        assert_eq!(told, own);
    }
}
