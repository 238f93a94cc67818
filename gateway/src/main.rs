//! PMAC's Ethernet protocol in front of a board behind its dual-ported RAM.

use std::io::{self, Write};
use std::net::{SocketAddr, TcpListener, UdpSocket};
use std::process::ExitCode;
use std::sync::Arc;
use std::thread;

use clap::Parser;
use log::{info, warn};
use pmac_dpram::client::CommandError;
use pmac_dpram::process::abort_on_panic;
use pmac_dpram::usage::usage;
use pmac_gateway::options::Options;
use pmac_gateway::session::Rules;
use pmac_gateway::{journal, tcp, udp};
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

fn main() -> ExitCode {
    abort_on_panic();
    let options = match Options::try_parse() {
        Ok(options) => options,
        Err(error) => return usage("pmac-gateway", &error),
    };
    let ended = journal::start().map_err(|error| format!("the log: {error}")).and_then(|log| {
        let ended = run(&options);
        log.finish();
        ended
    });
    match ended {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            let _ = writeln!(io::stderr(), "pmac-gateway: {why}");
            ExitCode::from(2)
        }
    }
}

/// Serves until a signal comes. Then this process's connections to `pmacd` end, and `pmacd` closes the clients' program
/// buffers.
fn run(options: &Options) -> Result<(), String> {
    let rules = options.rules().map_err(|error| error.to_string())?;
    let mut signals = Signals::new([SIGINT, SIGTERM]).map_err(|error| format!("signals: {error}"))?;
    look_at_daemon(&rules)?;
    let address = options.listen();
    let refuse = |error| format!("{address}: {error}; choose another --listen");
    let listener = TcpListener::bind(address).map_err(refuse)?;
    // With port 0 the system chooses the port.
    let address = listener.local_addr().map_err(refuse)?;
    let socket = Arc::new(UdpSocket::bind(address).map_err(refuse)?);
    warn_of(address, &rules);
    let start = |name: &str, run: Box<dyn FnOnce() + Send>| {
        let started = thread::Builder::new().name(name.to_owned()).spawn(run);
        started.map(drop).map_err(|error| format!("a thread: {error}"))
    };
    let (place, texts) = (rules.place.clone(), rules.texts.clone());
    start("texts", Box::new(move || texts.hear(&place)))?;
    let own = rules.clone();
    start("tcp", Box::new(move || tcp::serve(&listener, &own)))?;
    start("udp", Box::new(move || udp::serve(&socket, &rules)))?;
    info!("listening on {address}");
    signals.forever().next();
    Ok(())
}

/// Refuses a daemon with another board than the configured one. A daemon that does not run yet is no error.
fn look_at_daemon(rules: &Rules) -> Result<(), String> {
    match rules.place.connect() {
        Ok(_) => Ok(()),
        Err(error @ CommandError::OtherBoard { .. }) => Err(error.to_string()),
        // `Place::connect` has logged it.
        Err(_) => Ok(()),
    }
}

fn warn_of(address: SocketAddr, rules: &Rules) {
    if !address.ip().is_loopback() {
        warn!(
            "{address} is no loopback address: the protocol has no encryption and no password, and whoever reaches the address \
             {}; use ssh or WireGuard",
            if rules.read_only { "reads the board" } else { "moves the machine" }
        );
    }
    if let Some(version) = &rules.version {
        warn!(
            "VERSION is answered {version:?}, whatever the board is: a client may take its status bits for others"
        );
    }
}
