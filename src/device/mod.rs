//! The bus to the board (layer 2).
//!
//! Lowest first: a module uses only modules above its row (`tests/it/architecture.rs` keeps that).
//!
//! | module | holds |
//! |---|---|
//! | `bus` | how a host reaches the words of a board ([`Bus`], [`Board`]) and byte registers ([`ByteBus`]) |
//! | `decorators` | a bus that counts, swaps bytes, or keeps a trace of another bus |
//! | [`mapping`] | the only mapping of hardware |
//! | [`system`] | the kernel's files, inherited descriptors, rights, the processors' sleep |
//! | [`refusal`] | why a board cannot be opened, and the cure |
//! | [`uio`] | UIO devices: their memory, and how their interrupt is armed again |
//! | [`interrupt`] | where a board's interrupts come from |
//! | [`board`] | the boards: mapped memory, byte ports, recordings; [`open`] opens the board of a [`BoardSpec`] |
//! | [`machine`] | which boards this machine has, and how the daemon recognises one |

pub mod board;
mod bus;
mod decorators;
pub mod interrupt;
pub mod machine;
pub mod mapping;
pub mod refusal;
pub mod system;
#[cfg(test)]
mod testing;
pub mod uio;

pub use board::byte::{EvenLane, PortRegisters};
pub use board::byte_spec::{ByteSpec, open_bytes, open_host_port, open_mailbox};
pub use board::file::FileBoard;
pub use board::open::{OpenedBoard, open};
pub use board::replay::{OpenedReplay, ReplayBoard};
pub use board::spec::{BoardSpec, Place, WindowSpec, without_paths};
pub use board::vme_card::VmeCard;
pub use board::window::WindowBoard;
pub use bus::{Access, Board, Bus, BusError, ByteBus, ByteBusError, Presence};
pub use decorators::counted::Counted;
pub use decorators::swapped::WordSwapped;
pub use decorators::traced::{Trace, Traced, TracedAccess, TracedKind};
pub use interrupt::{Interrupt, InterruptSource};
pub use refusal::OpenError;
pub use system::System;
pub use system::cpu_latency::CpuLatency;
pub use system::inherited::Inherited;
