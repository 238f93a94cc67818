//! `pmacd --board replay:DIR`: a recording gives the daemon its board again.

use std::path::Path;
use std::time::Duration;

use pmac_dpram::client::CommandError;
use pmac_dpram::protocol::CallError;

use crate::support::VirtualSite;
use crate::support::tape::record;

const TIME: Duration = Duration::from_millis(200);
/// A daemon on the replay of `directory`, which has come to its end.
pub fn replayed(directory: &Path) -> VirtualSite {
    let site = VirtualSite::new();
    site.start_daemon_on(&format!("replay:{}", directory.display()), &[]);
    site.wait_until("the end of the recording", || site.log().contains("the recording is over"));
    site.run_for(Duration::from_millis(300));
    site
}

fn moving(family: &str) -> VirtualSite {
    let site = VirtualSite::configured(&["--family", family], &format!("family = \"{family}\"\n"));
    site.wait_for_axes();
    site.wait_for_identity();
    site.ask("#1J+");
    site.ask("#2J-");
    site.run_for(Duration::from_millis(400));
    site
}

#[test]
fn e6_nothing_can_be_moved_in_a_replay_and_every_difference_is_told() {
    let recorded = moving("pmac");
    // Of what the daemon asks for, a part.
    let (directory, _) = record(&recorded, &["TYPE", "VERSION", "SIZE"], TIME);
    let site = replayed(&directory);
    let mut connection = site.connection().confirming(true);
    let refused = |result: Result<(), CommandError>| match result {
        Err(CommandError::Refused(CallError::Refused { reason })) => {
            assert!(reason.starts_with("this is a replay of a recording, no board:"), "{reason}");
        }
        other => panic!("{other:?}"),
    };
    let patience = Duration::from_secs(5);
    for line in ["#1J+", "I100", "P1=3", "$$$", "#1J+ #2J/"] {
        refused(connection.send(line, patience).map(drop));
    }
    refused(connection.control(b'R' - 64).map(drop));
    refused(connection.control(b'A' - 64).map(drop));
    refused(connection.jog_to(1, 10.0));
    refused(connection.panel("jog+", &[1]));
    let differences = || site.connection().info().unwrap().replay.unwrap().differences;
    site.wait_until("a difference", || differences() > 0);
    site.stop_daemon();
    let log = site.log();
    let told =
        log.lines().find(|line| line.contains("lines that the recording has no answer to: `")).unwrap();
    assert!(!told.contains("J+"), "what a client asks is no difference of the driver's: {told}");
}
