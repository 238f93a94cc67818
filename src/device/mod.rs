//! The bus to the board (layer 2).
//!
//! | module | holds |
//! |---|---|
//! | `bus` | how the words of a board are reached: [`Bus`], [`Board`], and what can go wrong |
//! | [`machine`] | the machine: what `/sys` and `/proc` tell, inherited descriptors, rights, the processors' sleep |
//! | [`board`] | the boards: memory that is mapped, byte ports, recordings; [`open`] opens the one of a [`BoardSpec`] |
//! | [`interrupt`] | where a board's interrupt comes from, and how a UIO device is armed again |
//! | `decorators` | a bus that counts, swaps bytes, or keeps a trace of another one |

pub mod board;
mod bus;
mod decorators;
pub mod interrupt;
pub mod machine;
#[cfg(test)]
mod testing;

pub use board::byte::{ByteBus, ByteBusError, EvenLane, PortRegisters};
pub use board::byte_spec::{ByteSpec, open_bytes, open_host_port, open_mailbox};
pub use board::file::FileBoard;
pub use board::open::{OpenedBoard, open};
pub use board::refusal::OpenError;
pub use board::replay::{OpenedReplay, ReplayBoard};
pub use board::spec::{BoardSpec, Place, WindowSpec, without_paths};
pub use board::window::WindowBoard;
pub use bus::{Access, Board, Bus, BusError, Presence};
pub use decorators::counted::Counted;
pub use decorators::swapped::WordSwapped;
pub use decorators::traced::{Trace, Traced, TracedAccess, TracedKind};
pub use interrupt::{Interrupt, InterruptSource};
pub use machine::cpu_latency::CpuLatency;
pub use machine::inherited::Inherited;
pub use machine::system::System;
