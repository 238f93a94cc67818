//! What `pmacd` tells the service manager, and when.

use std::cell::RefCell;
use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram, UnixStream};
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;

use crate::support::{PATIENCE, Site, wait_until};

/// The service manager's end.
struct Manager {
    socket: UnixDatagram,
    /// The last status it was told.
    status: RefCell<String>,
}

impl Manager {
    fn at(path: &Path) -> Self {
        Self::on(UnixDatagram::bind(path).unwrap())
    }

    fn on(socket: UnixDatagram) -> Self {
        Self { socket, status: RefCell::default() }
    }

    /// The next message within `patience`.
    fn next(&self, patience: Duration) -> Option<String> {
        self.socket.set_read_timeout(Some(patience)).unwrap();
        let mut message = [0; 4096];
        match self.socket.recv(&mut message) {
            Ok(length) => {
                let message = String::from_utf8(message[..length].to_vec()).unwrap();
                if let Some(status) = message.lines().find_map(|line| line.strip_prefix("STATUS=")) {
                    status.clone_into(&mut self.status.borrow_mut());
                }
                Some(message)
            }
            Err(error) if [io::ErrorKind::WouldBlock, io::ErrorKind::TimedOut].contains(&error.kind()) => {
                None
            }
            Err(error) => panic!("{error}"),
        }
    }

    /// The next message with this assignment in it.
    fn wait_for(&self, assignment: &str) -> String {
        let deadline = Instant::now() + PATIENCE;
        while Instant::now() < deadline {
            if let Some(message) = self.next(PATIENCE)
                && message.lines().any(|line| line.starts_with(assignment))
            {
                return message;
            }
        }
        panic!("waited in vain for {assignment}");
    }
}

#[test]
fn the_service_manager_is_told_of_start_state_life_and_end() {
    let mut site = Site::new();
    site.start_simulator(&["--dpram-startup"]);
    let manager = Manager::at(&site.path("notify"));
    let mut daemon = site.daemon_command(&[]);
    daemon.env("NOTIFY_SOCKET", site.path("notify")).env("WATCHDOG_USEC", "400000");
    let mut daemon = site.adopt(daemon.stderr(Stdio::null()).spawn().unwrap());
    let ready = manager.wait_for("READY=1");
    // When it says so, it is so: no waiting here.
    assert!(UnixStream::connect(daemon.socket()).is_ok());
    assert_eq!(daemon.attach().header().owner_pid, u64::from(daemon.daemon_pid()));
    assert!(ready.lines().nth(1).is_some_and(|line| line.starts_with("STATUS=file:")), "{ready}");
    manager.wait_for("WATCHDOG=1");
    manager.wait_for("WATCHDOG=1");
    wait_until("a status with state and rate", || {
        manager.next(Duration::from_millis(100));
        let status = manager.status.borrow();
        status.contains(": live, PMAC1") && status.contains("firmware 1.16D") && status.contains("2258.8 Hz")
    });
    // Stopped, it gives no sign of life. What it had said before is read first.
    daemon.signal_daemon(Signal::SIGSTOP);
    while manager.next(Duration::from_millis(50)).is_some() {}
    assert_eq!(manager.next(Duration::from_millis(1500)), None, "a stopped daemon starves the watchdog");
    daemon.signal_daemon(Signal::SIGCONT);
    manager.wait_for("WATCHDOG=1");
    daemon.signal_daemon(Signal::SIGTERM);
    manager.wait_for("STOPPING=1");
    assert_eq!(daemon.stop_daemon(), 0);
}

#[test]
fn an_abstract_address_is_one_too_and_a_watchdog_of_another_process_none() {
    let mut site = Site::new();
    site.start_simulator(&["--dpram-startup"]);
    let name = format!("pmac-test-{}", site.name);
    let address = SocketAddr::from_abstract_name(&name).unwrap();
    let manager = Manager::on(UnixDatagram::bind_addr(&address).unwrap());
    let mut daemon = site.daemon_command(&[]);
    daemon.env("NOTIFY_SOCKET", format!("@{name}")).env("WATCHDOG_USEC", "100000").env("WATCHDOG_PID", "1");
    let site = site.adopt(daemon.stderr(Stdio::null()).spawn().unwrap());
    manager.wait_for("READY=1");
    let until = Instant::now() + Duration::from_millis(700);
    while Instant::now() < until {
        let message = manager.next(Duration::from_millis(100)).unwrap_or_default();
        assert!(!message.contains("WATCHDOG"), "{message}");
    }
    drop(site);
}
