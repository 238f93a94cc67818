//! A board in a browser, and its numbers for Prometheus.

use std::io::{self, Write};
use std::process::ExitCode;

use clap::Parser;
use log::{LevelFilter, info, warn};
use pmac_dpram::process::abort_on_panic;
use pmac_dpram::usage::usage;
use pmac_web::feed::Feed;
use pmac_web::options::Options;
use pmac_web::{server, watch};
use tokio::net::TcpListener;
use tokio::signal::unix::{SignalKind, signal};

fn main() -> ExitCode {
    abort_on_panic();
    let options = match Options::try_parse() {
        Ok(options) => options,
        Err(error) => return usage("pmac-web", &error),
    };
    let gone = "pmac-web: SIGBUS, memory that was mapped is gone: somebody has truncated the segment in /dev/shm; see to pmacd, then start this again\n";
    let _ = pmac_dpram::segment::end_on_bus_error(gone, 2);
    env_logger::Builder::new()
        .filter_level(LevelFilter::Info)
        .format(|line, record| writeln!(line, "pmac-web: {}", record.args()))
        .init();
    match run(&options) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            let _ = writeln!(io::stderr(), "pmac-web: {why}");
            ExitCode::from(2)
        }
    }
}

/// Serves until a signal comes.
fn run(options: &Options) -> Result<(), String> {
    let place = options.place().map_err(|error| error.to_string())?;
    place.look().map_err(|error| error.to_string())?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let runtime = runtime.map_err(|error| format!("an event loop: {error}"))?;
    runtime.block_on(async {
        let address = options.listen();
        let refuse = |error| format!("{address}: {error}; choose another --listen");
        let listener = TcpListener::bind(address).await.map_err(refuse)?;
        // With port 0 the system chose the port.
        let address = listener.local_addr().map_err(refuse)?;
        let signals = |kind| signal(kind).map_err(|error| format!("signals: {error}"));
        let (mut interrupt, mut terminate) =
            (signals(SignalKind::interrupt())?, signals(SignalKind::terminate())?);
        let thread = |error| format!("a thread: {error}");
        let watched = watch::start(place.clone(), options.watch().to_vec()).map_err(thread)?;
        let feed = Feed::start(place.clone(), watched).map_err(thread)?;
        if !address.ip().is_loopback() {
            warn!(
                "{address} is no loopback address: there is no encryption and no password, and whoever reaches it sees the machine"
            );
        }
        info!("listening on http://{address}");
        tokio::select! {
            () = server::serve(listener, server::routes(feed, place, options.hosts())) => {}
            _ = interrupt.recv() => {}
            _ = terminate.recv() => {}
        }
        Ok(())
    })
}
