//! Limits how long processors take to wake up, by the kernel's PM QoS request `/dev/cpu_dma_latency`, which holds
//! while a file is open.
//!
//! A driver that sleeps until just after each servo update is late by the time in which the processor leaves its idle
//! state: a microsecond for the shallowest, more than a hundred for the deepest, some ten with a hypervisor. The
//! request keeps all processors of the machine in states with at most the requested exit time (Linux, "PM Quality Of
//! Service Interface"), at the price of power. It ends with the process that holds it. Where the kernel has no idle
//! driver, as in many virtual machines, it changes nothing.

use std::fs::{File, OpenOptions};
use std::io::{self, Write};

use crate::device::{Inherited, System};

/// The kernel's node for the request.
pub const NODE: &str = "/dev/cpu_dma_latency";
/// The name of the descriptor from the service manager: `OpenFile=/dev/cpu_dma_latency:cpu_latency`.
pub const HANDED_OVER: &str = "cpu_latency";

/// A request in force until it is dropped.
#[derive(Debug)]
#[must_use = "the request ends when this is dropped"]
pub struct CpuLatency {
    _request: File,
}

impl CpuLatency {
    /// Asks for processors that wake within `latency_us` microseconds; 0: that poll instead of sleeping, where the
    /// kernel can. Uses the inherited descriptor, or else opens the node.
    ///
    /// # Errors
    /// The kernel's error: usually only root may open the node.
    pub fn hold(latency_us: u32, system: &System, inherited: &Inherited) -> io::Result<Self> {
        let latency_us = i32::try_from(latency_us).map_err(io::Error::other)?;
        let mut request = match inherited.find(HANDED_OVER) {
            Some(file) => file,
            None => OpenOptions::new().write(true).open(system.path(NODE))?,
        };
        request.write_all(&latency_us.to_ne_bytes())?;
        Ok(Self { _request: request })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Read, Seek};

    fn asked(mut file: File) -> Vec<u8> {
        let mut bytes = Vec::new();
        file.rewind().unwrap();
        file.read_to_end(&mut bytes).unwrap();
        bytes
    }

    #[test]
    fn the_kernel_gets_a_number_of_32_bits_by_whichever_way_there_is() {
        let root = tempfile::tempdir().unwrap();
        std::fs::create_dir(root.path().join("dev")).unwrap();
        let node = root.path().join("dev/cpu_dma_latency");
        std::fs::write(&node, []).unwrap();
        let system = System::below(root.path());
        let _held = CpuLatency::hold(7, &system, &Inherited::default()).unwrap();
        assert_eq!(asked(File::open(&node).unwrap()), 7_i32.to_ne_bytes());

        let handed_over = tempfile::tempfile().unwrap();
        let kept = handed_over.try_clone().unwrap();
        let inherited = Inherited::of(vec![(HANDED_OVER.to_owned(), handed_over.into())]);
        let _held = CpuLatency::hold(0, &system, &inherited).unwrap();
        assert_eq!(asked(kept), 0_i32.to_ne_bytes());
        assert_eq!(asked(File::open(&node).unwrap()), 7_i32.to_ne_bytes());
    }

    #[test]
    fn where_there_is_no_node_that_is_said() {
        let root = tempfile::tempdir().unwrap();
        let refused = CpuLatency::hold(0, &System::below(root.path()), &Inherited::default());
        assert_eq!(refused.unwrap_err().kind(), io::ErrorKind::NotFound);
    }
}
