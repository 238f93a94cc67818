//! The command line.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::Parser;
use pmac_dpram::protocol::socket_place;
use pmac_dpram::segment::{SegmentError, SegmentName};

use crate::board::Place;
use crate::session::Rules;
use crate::texts::Texts;

/// The board's name without --name and --socket.
const DEFAULT_NAME: &str = "pmac0";

/// Speaks PMAC's Ethernet protocol (TCP and UDP) in front of a board that pmacd drives, so that PMAC's network tools work with it
#[derive(Debug, Parser)]
#[command(name = "pmac-gateway", version)]
#[command(
    after_help = "The protocol has no encryption and no password: whoever reaches the address moves the machine. Listen on a \
    loopback address and let clients in by ssh (ssh -L 1025:127.0.0.1:1025 HOST) or WireGuard.\n\
    Exit status: 0 ended by a signal; 2 the request could not be made."
)]
pub struct Options {
    /// The board's name [default: that of --socket, else pmac0]
    #[arg(long, value_name = "NAME")]
    name: Option<String>,
    /// The daemon's socket [default: /run/pmacd/NAME.sock, else $XDG_RUNTIME_DIR/pmacd/NAME.sock]
    #[arg(long, value_name = "PATH")]
    socket: Option<PathBuf>,
    /// The address to listen on, by TCP and UDP
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:1025")]
    listen: SocketAddr,
    /// Send the board nothing but questions. What a client sets of I3, I4 and I6 is answered as ever
    #[arg(long)]
    read_only: bool,
    /// A jog without an end (J+, J-) goes on when its client, or this program, is gone, as on a PMAC; otherwise pmacd stops it
    #[arg(long)]
    keep_jogs: bool,
    /// Answer VERSION and VER with this text, not with the board's, for clients that insist on a Turbo's. Such a client may
    /// take a classic board's status bits for others
    #[arg(long, value_name = "TEXT", value_parser = version_text)]
    version_as: Option<String>,
}

/// Accepts one short line of ASCII.
fn version_text(text: &str) -> Result<String, String> {
    const LONGEST: usize = 40;
    let is_text =
        (1..=LONGEST).contains(&text.len()) && text.bytes().all(|byte| (b' '..=b'~').contains(&byte));
    if is_text { Ok(text.to_owned()) } else { Err(format!("write 1 to {LONGEST} ASCII characters")) }
}

impl Options {
    /// The address to listen on.
    #[must_use]
    pub fn listen(&self) -> SocketAddr {
        self.listen
    }

    /// The rules for every client.
    ///
    /// # Errors
    /// The board's name is invalid.
    pub fn rules(&self) -> Result<Rules, SegmentError> {
        let (socket, name) = self.place()?;
        Ok(Rules {
            place: Place::new(socket, name),
            read_only: self.read_only,
            keep_jogs: self.keep_jogs,
            version: self.version_as.clone(),
            texts: Texts::default(),
        })
    }

    /// The daemon's socket, and the name that its board must have.
    fn place(&self) -> Result<(PathBuf, Option<SegmentName>), SegmentError> {
        let told = self.name.as_deref();
        let socket = self.socket.clone();
        let name = match (told, &socket) {
            // The socket alone says which board is meant.
            (None, Some(_)) => None,
            (told, _) => Some(SegmentName::new(told.unwrap_or(DEFAULT_NAME))?),
        };
        let socket = socket.unwrap_or_else(|| socket_place::socket_path(told.unwrap_or(DEFAULT_NAME)));
        Ok((socket, name))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_sound_and_says_what_the_protocol_lacks() {
        Options::command().debug_assert();
        let help = Options::command().render_help().to_string();
        assert!(help.contains("no encryption and no password") && help.contains("ssh"), "{help}");
    }

    #[test]
    fn a_socket_alone_says_which_board_is_meant() {
        let place = |line: &str| {
            let options = Options::try_parse_from(line.split(' ')).unwrap();
            let (socket, name) = options.place().unwrap();
            (socket.to_string_lossy().into_owned(), name.map(|name| name.as_str().to_owned()))
        };
        assert_eq!(place("pmac-gateway --socket /x.sock"), ("/x.sock".to_owned(), None));
        let rig = Some("rig".to_owned());
        assert_eq!(place("pmac-gateway --socket /x.sock --name rig"), ("/x.sock".to_owned(), rig));
        assert!(place("pmac-gateway").0.ends_with("pmacd/pmac0.sock"));
        for wrong in ["--listen nowhere", "--version-as ", "--listen 127.0.0.1"] {
            assert!(Options::try_parse_from(["pmac-gateway"].into_iter().chain(wrong.split(' '))).is_err());
        }
    }
}
