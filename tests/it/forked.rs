//! A connection ends with the process that made it, though a process forked from it has its descriptor and lives on.

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};

use nix::fcntl::{FcntlArg, FdFlag, fcntl};
use nix::sys::signal::kill;
use nix::unistd::Pid;
use pmac_dpram::protocol::BOARD;
use serde_json::json;

use crate::support::VirtualSite;
use crate::support::jogs::until;
use crate::support::raw::Raw;

const SOCKET: &str = "PMAC_DPRAM_TEST_SOCKET";
const LINE: &str = "PMAC_DPRAM_TEST_LINE";

/// Sends a line over a connection whose descriptor a child has, too, and says that child's number. It ends at once, or, after a jog,
/// waits for its end.
#[test]
#[ignore = "no test of its own: a process that the others start"]
#[expect(clippy::zombie_processes, reason = "the child is to outlive this process")]
fn a_parent() {
    let mut connection = Raw::at(Path::new(&std::env::var(SOCKET).unwrap()));
    // As a child that was forked and runs no other program has it.
    fcntl(&connection.stream, FcntlArg::F_SETFD(FdFlag::empty())).unwrap();
    // It ends when the test does.
    let heir = Command::new("cat").stdout(Stdio::null()).spawn().unwrap();
    let line = std::env::var(LINE).unwrap();
    let ends_at_once = !line.contains("J+");
    let parameters = json!({"line": line, "while_connected": !ends_at_once});
    let method = format!("{BOARD}.Send");
    let call = json!({"method": method, "parameters": parameters, "oneway": ends_at_once});
    connection.send(format!("{call}\0").as_bytes());
    if ends_at_once {
        println!("\nheir {}", heir.id());
        std::process::exit(0);
    }
    let reply = connection.receive().unwrap();
    assert!(reply.get("error").is_none(), "{reply}");
    println!("\nheir {}", heir.id());
    std::thread::park();
}

/// A process as [`a_parent`] is, and its child.
struct Family {
    parent: Child,
    heir: Pid,
    _output: BufReader<ChildStdout>,
}

impl Family {
    fn sending(line: &str, site: &VirtualSite) -> Self {
        let mut parent = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "forked::a_parent", "--ignored", "--nocapture"])
            .envs([(SOCKET, site.socket().as_os_str()), (LINE, line.as_ref())])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut output = BufReader::new(parent.stdout.take().unwrap());
        let heir = output.by_ref().lines().find_map(|line| line.unwrap().strip_prefix("heir ")?.parse().ok());
        Self { parent, heir: Pid::from_raw(heir.expect("the child's number")), _output: output }
    }

    fn heir_lives(&self) -> bool {
        kill(self.heir, None).is_ok()
    }
}

/// In whatever way the test ends.
impl Drop for Family {
    fn drop(&mut self) {
        let _ = self.parent.kill();
        let _ = self.parent.wait();
    }
}

#[test]
fn a_jog_ends_with_the_process_that_asked_for_it_while_a_forked_child_has_its_descriptor() {
    let site = VirtualSite::configured(&[], "");
    site.wait_for_live_servo();
    site.wait_until("a board that takes commands", || site.pmacctl(&["send", "I2=3"]).0 == 0);
    let mut board = site.connection();
    let mut family = Family::sending("#1J+", &site);
    until(&mut board, "#1V", "it goes", |speed| speed > 1.0);
    family.parent.kill().unwrap();
    until(&mut board, "#1V", "it stands", |speed| speed.abs() < 0.1);
    assert!(family.heir_lives());
    site.assert_no_violations();
}

#[test]
fn what_a_process_has_sent_before_its_end_is_carried_out_and_its_child_is_not_heard() {
    let site = VirtualSite::configured(&[], "");
    site.wait_for_live_servo();
    let mut board = site.connection();
    for number in 1..=5 {
        let mut family = Family::sending(&format!("P100={number}"), &site);
        assert!(family.parent.wait().unwrap().success());
        until(&mut board, "P100", "it is set", |value| value == f64::from(number));
        assert!(family.heir_lives());
    }
}
