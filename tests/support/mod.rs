//! Support for the test programs.
//!
//! [`Site`] runs a simulated board and its daemon as real processes, in real time. [`VirtualSite`] runs both in the
//! test's process, in virtual time. Use the second one, unless the test is about real time.

#![allow(dead_code, unused_imports, reason = "each test program uses a part of this")]

pub mod bench;
mod dump;
pub mod gather_rig;
pub mod jogs;
mod place;
pub mod raw;
pub mod rig;
pub mod sim;
mod site;
pub mod tape;
mod virtual_site;
mod wait;
mod weight;
mod world;

pub use dump::Dump;
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

/// The value of a counter of the daemon.
pub fn counter(subscriber: &Subscriber, counter: Counter) -> u64 {
    subscriber.counter(counter)
}
