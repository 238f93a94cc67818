//! The command line of `pmacd`.

use std::path::PathBuf;

use clap::Parser;

/// Owns a PMAC's dual-ported RAM: mirrors it into shared memory, serves commands on a socket.
#[derive(Debug, Clone, Default, Parser)]
#[command(name = "pmacd", version, max_term_width = 100)]
#[command(
    after_help = "Exit status: 0 asked to end; 64 the command line; 69 board, name or socket unavailable; \
    70 a defect; 71 the system refused memory, a descriptor or a thread; \
    75 a motor may still move; 77 a right is missing; 78 the configuration."
)]
pub struct Options {
    /// The board, and how it is reached.
    #[arg(
        long,
        value_name = "SPEC",
        help = "The board: sim[,family=NAME][,dpram=8k|32k][,cpu=OPTION][,from=DIR], replay:DIR[,time=virtual], file:PATH, mem:0xADDRESS, \
                uio:/dev/uioN[,map=M], pci:0000:03:00.0[,bar=N] or vme:NODE, each but sim and replay with [,irq=uio:/dev/uioN] or \
                [,irq=unix:PATH], each but sim, replay and vme with [,access=32]"
    )]
    pub board: Option<String>,
    /// The name of the shared-memory segment and of the socket [default: pmac0]
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,
    /// The configuration file, TOML; the command line overrides it
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// The command socket [default: /run/pmacd/NAME.sock; where that cannot be made, $XDG_RUNTIME_DIR/pmacd/NAME.sock]
    #[arg(long, value_name = "PATH")]
    pub socket: Option<PathBuf>,
    /// Become this user, with its groups, once the board is open (started as root)
    #[arg(long, value_name = "NAME")]
    pub user: Option<String>,
    /// Check the configuration, say what is wrong with it, and exit
    #[arg(long)]
    pub check: bool,
    /// Exit when the parent process (PID) exits
    #[arg(long, value_name = "PID", hide = true)]
    pub with_parent: Option<u32>,
}
