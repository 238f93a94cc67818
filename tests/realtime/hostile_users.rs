//! Users of the machine who try what is not theirs, or take more than their share. Needs root, to be several users.

use std::fs::Permissions;
use std::io::{Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::Duration;

use pmac_dpram::map::{Family, PMAC, TURBO2};
use serde_json::json;

use crate::hostile::{call, connect, flood};
use crate::hostile_witness::{attacked, print_head, watch};
use crate::support::{PATIENCE, Site, wait_until};

const ROLE: &str = "PMAC_HOSTILE_TEST_ROLE";
const SOCKET: &str = "PMAC_HOSTILE_TEST_SOCKET";
/// A user whom the daemon knows nothing of, and one whose group may do everything.
const STRANGER: u32 = 4_000_001;
const SECOND_STRANGER: u32 = 4_000_002;
const ENGINEER: u32 = 4_000_003;
const ENGINEERS: u32 = 65_534;

#[test]
#[ignore = "no test of its own: a process that the others start"]
fn another_user() {
    let (role, socket) = (std::env::var(ROLE).unwrap(), PathBuf::from(std::env::var(SOCKET).unwrap()));
    let mut streams: Vec<_> = (0..300).map(|_| connect(&socket)).collect();
    if role == "crowd" {
        let held = streams.iter_mut().filter_map(|stream| is_served(stream).then_some(())).count();
        println!("held={held}");
        // Until the test has seen enough.
        let _ = std::io::stdin().read(&mut [0]);
    } else {
        flood(&mut streams, &call("Send", json!({"line": "P78"})), true, Duration::from_secs(1));
    }
}

/// Whether there was a place for it.
fn is_served(stream: &mut UnixStream) -> bool {
    stream.set_nonblocking(false).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    let _ = stream.write_all(&call("GetInfo", json!({})));
    let mut reply = Vec::new();
    let mut byte = [0];
    // One refused may find its connection reset before it has read why.
    while let Ok(1) = stream.read(&mut byte) {
        if byte == [0] {
            break;
        }
        reply.push(byte[0]);
    }
    String::from_utf8(reply).unwrap().contains("\"firmware\"")
}

struct Users {
    site: Site,
    /// Copies of the programs that other users can reach.
    programs: tempfile::TempDir,
}

impl Users {
    /// A board of `family`, a daemon with a socket for everybody, and one group of engineers.
    fn of(family: &'static Family) -> Self {
        let group = nix::unistd::Group::from_gid(nix::unistd::Gid::from_raw(ENGINEERS)).unwrap();
        let group = group.expect("a group of this number").name;
        let mut site = Site::new();
        let everybody = Permissions::from_mode(0o755);
        std::fs::set_permissions(site.directory.path(), everybody.clone()).unwrap();
        let board = attacked(family);
        println!("{board}");
        board.power_up(&mut site, &["--servo-hz", "1000"]);
        let roles = format!("socket_mode = \"0666\"\n[roles]\nengineer = [\"{group}\"]\n");
        board.start_daemon(&mut site, &roles);
        site.wait_for_live_servo();
        site.control("time on");
        let programs = tempfile::tempdir().unwrap();
        std::fs::set_permissions(programs.path(), everybody).unwrap();
        for (from, to) in [
            (PathBuf::from(env!("CARGO_BIN_EXE_pmacctl")), "pmacctl"),
            (std::env::current_exe().unwrap(), "another"),
        ] {
            std::fs::copy(from, programs.path().join(to)).unwrap();
        }
        Self { site, programs }
    }

    fn command(&self, program: &str, uid: u32) -> Command {
        let mut command = Command::new(self.programs.path().join(program));
        let gid = if uid == ENGINEER { ENGINEERS } else { uid };
        command.uid(uid).gid(gid).current_dir(Path::new("/")).stdin(Stdio::null());
        command
    }

    fn pmacctl(&self, uid: u32, arguments: &[&str]) -> Output {
        let mut command = self.command("pmacctl", uid);
        command.args(["--name", &self.site.name]).arg("--socket").arg(self.site.socket());
        command.args(arguments).output().unwrap()
    }

    fn other(&self, uid: u32, role: &str) -> Other {
        let mut command = self.command("another", uid);
        command.args(["hostile_users::another_user", "--exact", "--ignored", "--nocapture"]);
        command.env(ROLE, role).env(SOCKET, self.site.socket());
        Other(command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap())
    }
}

struct Other(Child);

impl Other {
    /// How many connections it holds, once it knows.
    fn held(&mut self) -> usize {
        let mut text = String::new();
        let mut byte = [0];
        let stdout = self.0.stdout.as_mut().unwrap();
        while !(text.contains("held=") && text.ends_with('\n')) {
            assert_eq!(stdout.read(&mut byte).unwrap(), 1, "{text}");
            text.push(char::from(byte[0]));
        }
        text.rsplit("held=").next().unwrap().trim().parse().unwrap()
    }
}

impl Drop for Other {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
#[ignore = "needs root, to be another user"]
fn as_root_a_stranger_may_look_and_nothing_else() {
    [&PMAC, &TURBO2].into_iter().for_each(a_stranger_may_look_and_nothing_else);
}

fn a_stranger_may_look_and_nothing_else(family: &'static Family) {
    let mut users = Users::of(family);
    let looked = users.pmacctl(STRANGER, &["read", "0x0024"]);
    assert!(looked.status.success(), "{looked:?}");
    for (arguments, method) in [
        (&["send", "#1J+"][..], "Send"),
        (&["send", "^K"], "SendControl"),
        (&["panel", "stop", "1"], "Panel"),
        (&["write", "0x3000", "7"], "Write"),
    ] {
        let refused = users.pmacctl(STRANGER, arguments);
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(!refused.status.success() && said.contains("not permitted"), "{arguments:?}: {refused:?}");
        let refused = format!("refused \"io.github.pmac-dpram.Board.{method}\" of uid {STRANGER} pid ");
        wait_until("the refusal in the log", || users.site.log().contains(&refused));
    }
    let log = users.site.log();
    assert!(!log.contains(&format!("[INFO ] uid {STRANGER} ")), "something of his was sent: {log}");
    // What only asks is logged at level debug.
    let engineer = users.pmacctl(ENGINEER, &["send", "P1=1 P1"]);
    assert_eq!(String::from_utf8_lossy(&engineer.stdout), "1\n", "{engineer:?}");
    let sent = format!("[INFO ] uid {ENGINEER} pid ");
    wait_until("the line in the log", || users.site.log().contains(&sent));
    assert_eq!(users.site.stop_daemon(), 0);
}

#[test]
#[ignore = "needs root, to be another user"]
fn as_root_no_user_keeps_the_others_out() {
    [&PMAC, &TURBO2].into_iter().for_each(no_user_keeps_the_others_out);
}

fn no_user_keeps_the_others_out(family: &'static Family) {
    let mut users = Users::of(family);
    print_head();
    watch(&users.site, "a stranger's 300 connections", || {
        let mut crowd = users.other(STRANGER, "crowd");
        assert_eq!(crowd.held(), 64);
        for uid in [SECOND_STRANGER, ENGINEER, 0] {
            let looked = users.pmacctl(uid, &["read", "0x0024"]);
            assert!(looked.status.success(), "uid {uid}: {looked:?}");
        }
    });
    watch(&users.site, "the daemon's own user's 300", || {
        let mut crowd = users.other(0, "crowd");
        // The last eighth is not for him; the honest client is one of his. One that is idle gives way to his next one.
        assert_eq!(crowd.held(), 256 - 32 - 1);
        for uid in [0, STRANGER, SECOND_STRANGER, ENGINEER] {
            let looked = users.pmacctl(uid, &["read", "0x0024"]);
            assert!(looked.status.success(), "uid {uid}: {looked:?}");
        }
    });
    watch(&users.site, "another engineer's flood of lines", || {
        let mut flood = users.other(ENGINEER, "flood");
        assert!(flood.0.wait().unwrap().success());
    });
    wait_until("room for all again", || users.pmacctl(0, &["read", "0x0024"]).status.success());
    assert_eq!(users.site.stop_daemon(), 0);
}
