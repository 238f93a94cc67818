//! What the test programs share.
//!
//! [`Site`] is a simulated board and its daemon as real processes, in real time. [`VirtualSite`] is the same two in the
//! process of the test, in virtual time. A test wants the second one, unless real time is what it is about.

#![allow(dead_code, unused_imports, reason = "each test program uses a part of this")]

pub mod bench;
pub mod gather_rig;
pub mod jogs;
mod place;
pub mod raw;
pub mod rig;
pub mod sim;
mod site;
mod virtual_site;
mod wait;
mod weight;
mod world;

pub use place::{Control, Place};
pub use site::Site;
pub use virtual_site::VirtualSite;
pub use wait::{Ended, PATIENCE, joined, output_within, status_within, wait_until};
pub use weight::{Weight, own_kib};
pub use world::World;

use pmac_dpram::segment::{Counter, RegionId, RegionState, Subscriber};

/// Whether the data of `region` are live.
pub fn is_live(subscriber: &Subscriber, region: RegionId) -> bool {
    subscriber.region(region).is_ok_and(|info| info.state == RegionState::Live)
}

/// What the daemon has counted.
pub fn counter(subscriber: &Subscriber, counter: Counter) -> u64 {
    subscriber.counter(counter)
}
