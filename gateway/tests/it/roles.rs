//! What the gateway's user needs. Needs root, to be another user.

use std::fs::Permissions;
use std::os::unix::fs::PermissionsExt;
use std::process::{Command, Stdio};

use super::site::{Setup, Site, listening};

/// A user whom the daemon knows nothing of.
const USER: &str = "4000001";

/// Two groups that every system has, by name and number.
const GROUPS: [(&str, &str); 2] = [("daemon", "1"), ("bin", "2")];

#[test]
#[ignore = "needs root"]
fn as_root_d2_a_gateway_asks_with_the_role_engineer_and_not_without() {
    let [(connects, connects_id), (engineers, engineers_id)] = GROUPS;
    let config = format!(
        "socket_mode = \"0660\"\nsocket_group = \"{connects}\"\n[roles]\nengineer = [\"{engineers}\"]\n"
    );
    let site = Site::set_up(Setup { config: &config, ..Setup::default() });
    std::fs::set_permissions(site.directory(), Permissions::from_mode(0o755)).unwrap();
    // Where this user can reach it.
    let reached = tempfile::tempdir().unwrap();
    std::fs::set_permissions(reached.path(), Permissions::from_mode(0o755)).unwrap();
    let ours = site.another_gateway(&["--read-only"]);
    let copy = reached.path().join("pmac-gateway");
    std::fs::copy(ours.get_program(), &copy).unwrap();
    for (groups, answer) in [("", "\x07ERR002\r"), (engineers_id, "0\r\x06")] {
        let mut command = Command::new("setpriv");
        command.args(["--reuid", USER, "--regid", connects_id]);
        match groups {
            "" => command.arg("--clear-groups"),
            groups => command.args(["--groups", groups]),
        };
        command.arg(&copy).args(ours.get_args()).stdin(Stdio::null()).stderr(Stdio::piped());
        let mut gateway = command.spawn().unwrap();
        let (mut client, _log) = listening(&mut gateway);
        assert_eq!(client.line("P1"), "0\r\x06", "any role asks for values");
        assert_eq!(client.line("#1P"), answer, "groups {groups:?}");
        assert_eq!(client.line("P1=5"), "\x07ERR002\r", "it only reads");
        gateway.kill().unwrap();
        gateway.wait().unwrap();
    }
}
