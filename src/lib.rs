//! A Linux driver for the dual-ported RAM (DPRAM) of Delta Tau PMAC motion controllers.
//!
//! A PMAC board shares 8K or 32K x 16 bit of memory with its host. One daemon (`pmacd`) owns the board; every other process
//! reads coherent live data from a POSIX shared-memory segment and sends commands through a socket.
//!
//! ```text
//! read      device → function → mirror → segment ⇒ client → cli / your program
//! command   cli / your program → client ⇒ daemon → function → device
//! firmware  sim ⇄ the same bytes that device::file maps                    (⇒ = process boundary)
//! ```
//!
//! # Where to begin
//! * To read a board from a program of your own: [`client`].
//! * To read a board from C, Python or anything else: [`segment::layout`], which needs no code of ours.
//! * To send commands from another language: [`protocol::BOARD_DESCRIPTION`], the socket's interface.
//! * To look up a register: [`map::pmac`]; a number format: [`mod@format`]; a status bit: [`map::status`]; the bits
//!   that people see: [`client::shown_flags`].
//! * To see a handshake: the host's half in [`function`], PMAC's half in [`sim`].
//! * To follow the daemon from its start to its end: [`daemon::bring_up`], then [`daemon::bus::board_loop`].
//! * To see which client moves and stops which motor: `daemon/motion` keeps the ledger, `daemon/socket/server` sends.
//!   The lines of a download, a gather or a stream: `daemon/scripts`.
//!
//! # Layers
//! Lowest first. A module uses only lower layers and, in its own layer, only the modules that stand before it:
//!
//! | layer | modules |
//! |---|---|
//! | 0 | [`mod@format`]: numbers and text as DPRAM holds them · [`clock`]: the time, real or a test's · [`usage`]: how programs refuse a command line · [`process`]: their end with their parent or by a panic, their log, paths through a descriptor |
//! | 1 | [`map`]: the place of every word · [`language`]: the meaning of a command line · [`decode`]: words to named values · [`setup`]: calculators of the lines that set up a board · [`rotary`]: motion programs as binary commands · [`table`]: tables of numbers in files · [`gather`]: the sources and samples of a gather · [`protocol`]: the command socket's messages · [`preprocess`]: program files to lines · [`recording`]: captures of boards |
//! | 2 | [`device`]: the bus, its kinds and decorators, the interrupt |
//! | 3 | [`function`]: the host's half of each automatic function |
//! | 4 | [`segment`]: the shared-memory ABI · [`mirror`]: which words to read, and when |
//! | 5 | [`daemon`] · [`client`] · [`sim`] |
//! | 6 | [`cli`] and the programs |
//!
//! # Features
//! All are on by default; each builds alone. `client`: the client library. `daemon`: `pmacd`. `sim`: `pmac-sim`.
//! `cli`: `pmacctl`. `serial`: [`client`] on a serial line. `usage`: [`mod@usage`]. A program that reads a board links 15 crates:
//! `pmac-dpram = { version = "0.1", default-features = false, features = ["client"] }`
//!
//! # Invariants
//! Kept by `tests/it/architecture.rs`, which reads the source:
//! * The table above is the truth about which module uses which. Besides: of the driver the simulator sees
//!   [`mod@format`], [`map`], [`rotary::codes`], [`process`], [`recording`] and a mapping, and only its own program
//!   sees the simulator; the client sees no device; the modules that mirror words ([`device`] to [`daemon`]) do not
//!   decode them.
//! * `unsafe` lives in `device/mapping.rs`, `segment/memory.rs` and `segment/wide_copy.rs`, and, of the libraries for C, in
//!   the files of `c/src/border` and in `c/pcomm32/src/border.rs`; besides, a macro of `nix` in
//!   `daemon/socket/peer_groups.rs` expands to some. Only `memmap2::MmapRaw` maps memory that another agent writes, so that
//!   no reference or slice into that memory can exist.
//! * Only [`map`] knows an address in the DPRAM. Only [`device`] knows a path in `/dev`, `/sys` or `/proc`, but for the
//!   directory of shared-memory objects, [`segment::DIRECTORY`], and that of open files, [`process::DESCRIPTORS`].
//! * Outside tests no line has `unwrap()`, `expect("`, `panic!`, `unreachable!`, `todo!`, `unimplemented!` or `dbg!`.
//!   An index out of bounds and an overflow of a debug build still panic. No file has more than 600 lines.
//!
//! Kept by the named tests:
//! * The host reads device words by one 16-bit access each, ascending, each once: [`device::Bus`] has no other way,
//!   except for data, which it may read two words at a time if the configuration says that the board takes that;
//!   [`device::Counted`] counts, and the tests of [`function`] check the count.
//! * A word that the daemon does not read from the board is never shown as a value: the segment names the unread words,
//!   [`decode`] gives `None` (`tests/it/fields.rs`).
//! * Servo data: the host reads PMAC's status word again after the data, and discards the copy unless both readings are
//!   equal and not busy ([`function::servo`]). Fields of two updates never mix (`tests/realtime/mixing.rs`, with the
//!   update's number in every field).
//! * No reader can slow or stop the daemon, and no writer, stopped or killed in mid-write, blocks a reader: every
//!   region is a ring with a sequence number a slot ([`segment::ring`], model-checked in `tests/it/segment_loom.rs`).
//! * No failure returns zeros, or old data as if they were new ([`client::View`] carries age and [`client::Staleness`];
//!   `tests/realtime/processes.rs` kills, stops and restarts both sides).
//! * On a board, the bus thread allocates no memory after it has used everything once (`tests/allocation.rs`, an
//!   allocator that counts).
//! * Three counts never mix: *skipped* (the board held off an update because Host-Busy was set), *missed* (the board
//!   made an update that the daemon did not read in time; the board's timer tells), *lost* (the writer overran a reader
//!   in the ring).
//! * The host writes only its own bits, data before flag, and clears them at its start and on the way out; the
//!   simulator's [`sim::judge`] records every breach, and the tests of whole systems assert that there was none.
//!
//! Kept by shape:
//! * One thread owns the bus ([`daemon::bus::board_loop`]), so no lock guards it. After start it waits for no client.
//! * Every wait for a board or a client is bounded, with one exception: the daemon does not ask for M-variables while a
//!   client has a program buffer open. [`function`]s never wait: they do what they can do now and return.
//! * Addresses and formats are data of a family; firmware, DPRAM size, byte and text order are settings. Code asks for
//!   the generation only where the boards answer differently or the host must ask differently.

#[cfg(feature = "cli")]
pub mod cli;
#[cfg(feature = "client")]
pub mod client;
pub mod clock;
#[cfg(feature = "daemon")]
pub mod daemon;
pub mod decode;
#[cfg(any(feature = "cli", feature = "daemon", feature = "sim"))]
pub mod device;
pub mod format;
#[cfg(any(feature = "cli", feature = "daemon"))]
pub mod function;
pub mod gather;
pub mod language;
pub mod map;
#[cfg(feature = "daemon")]
pub mod mirror;
pub mod preprocess;
pub mod process;
pub mod protocol;
#[cfg(any(feature = "cli", feature = "daemon", feature = "sim"))]
pub mod recording;
pub mod rotary;
pub mod segment;
pub mod setup;
#[cfg(feature = "sim")]
pub mod sim;
pub mod table;
#[cfg(feature = "usage")]
pub mod usage;
