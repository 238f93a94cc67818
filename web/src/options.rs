//! The command line.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::Parser;
use pmac_dpram::segment::{SegmentError, SegmentName};

use crate::board::Place;
use crate::hosts::Hosts;
use crate::watch::variable;

/// The board that the program shows if the user names none.
const DEFAULT_NAME: &str = "pmac0";

/// Shows a board that pmacd drives in a browser: motors, a live scope, coordinate systems, health. /metrics is for Prometheus
#[derive(Debug, Parser)]
#[command(name = "pmac-web", version)]
#[command(
    after_help = "It only reads, and commands nothing. There is no encryption and no password: whoever reaches the address sees \
    the machine. Listen on a loopback address and let browsers in by ssh (ssh -L 8025:127.0.0.1:8025 HOST), WireGuard or a \
    proxy that asks for a password.\n\
    Exit status: 0 ended by a signal; 2 the request could not be made."
)]
pub struct Options {
    /// The board's name [default: that of --socket, else pmac0]
    #[arg(long, value_name = "NAME")]
    name: Option<String>,
    /// The daemon's socket, which tells the board
    #[arg(long, value_name = "PATH")]
    socket: Option<PathBuf>,
    /// The address to listen on
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:8025")]
    listen: SocketAddr,
    /// A name by which browsers and Prometheus ask, without the port; may be given several times. Addresses and localhost need
    /// no naming; by any other name nothing is answered, for that may be a page that has its own name lead here
    #[arg(long, value_name = "NAME")]
    host: Vec<String>,
    /// I-, P- and Q-variables to show, as P1,Q5: pmac-web asks the board for them once a second. Q belongs to the coordinate
    /// system that is addressed
    #[arg(long, value_name = "VARIABLE", value_delimiter = ',', value_parser = variable)]
    watch: Vec<String>,
}

impl Options {
    /// Where to listen.
    #[must_use]
    pub fn listen(&self) -> SocketAddr {
        self.listen
    }

    /// The names by which browsers may ask for the page.
    #[must_use]
    pub fn hosts(&self) -> Hosts {
        Hosts::new(&self.host)
    }

    /// The variables to show.
    #[must_use]
    pub fn watch(&self) -> &[String] {
        &self.watch
    }

    /// Which board to show.
    ///
    /// # Errors
    /// The name is not a segment's name.
    pub fn place(&self) -> Result<Place, SegmentError> {
        Ok(match (&self.name, &self.socket) {
            (None, Some(socket)) => Place::At(socket.clone()),
            (name, socket) => {
                let name = name.as_deref().unwrap_or(DEFAULT_NAME);
                Place::Named(SegmentName::new(name)?, socket.clone())
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_sound_and_says_what_it_lacks() {
        Options::command().debug_assert();
        let help = Options::command().render_help().to_string();
        assert!(help.contains("no encryption and no password") && help.contains("ssh"), "{help}");
    }

    #[test]
    fn a_socket_alone_says_which_board_is_meant() {
        let label = |line: &str| Options::try_parse_from(line.split(' ')).unwrap().place().unwrap().label();
        assert_eq!(label("pmac-web --socket /x.sock"), "/x.sock");
        assert_eq!(label("pmac-web --socket /x.sock --name rig"), "rig");
        assert_eq!(label("pmac-web"), DEFAULT_NAME);
        let options = Options::try_parse_from(["pmac-web", "--watch", "p1,Q5", "--watch", "I122"]).unwrap();
        assert_eq!(options.watch(), ["P1", "Q5", "I122"]);
        for wrong in ["--listen nowhere", "--listen 127.0.0.1", "--read-only", "--watch M1", "--watch P1,,P2"]
        {
            assert!(Options::try_parse_from(["pmac-web"].into_iter().chain(wrong.split(' '))).is_err());
        }
    }
}
