//! A board whose memory holds anything at power-on.

use pmac_dpram::map::HostOffset;

use crate::support::VirtualSite;

fn word(site: &VirtualSite, offset: &str) -> u64 {
    let (status, stdout, stderr) = site.pmacctl(&["read", offset, "--json"]);
    assert_eq!(status, 0, "{stderr}");
    let document: serde_json::Value = serde_json::from_str(&stdout).unwrap();
    document[0]["words"][0].as_u64().unwrap()
}

#[test]
fn b3_10_the_masks_of_the_panel_are_cleared_before_the_panel_is_enabled() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_identity();
    assert_eq!(site.pmacctl(&["send", "I2=0"]).0, 0);
    // As power-on may leave them: a request and a feed rate for everybody.
    for mask in [0x0000, 0x0002] {
        site.connection().write(HostOffset::new(mask), &[(0x7F7F, 0xFFFF)], true).unwrap();
    }
    let (status, _, stderr) = site.pmacctl(&["setup", "--send", "--yes", "enable", "panel"]);
    assert_eq!(status, 0, "{stderr}");
    assert_eq!([word(&site, "0x0000"), word(&site, "0x0002")], [0, 0]);
}

#[test]
fn b3_10_a_board_full_of_garbage_comes_up() {
    for seed in ["1", "2", "3"] {
        let site = VirtualSite::running(&["--garbage", seed], &[]);
        site.wait_for_identity();
        site.wait_for_live_servo();
        site.assert_no_violations();
    }
}

#[test]
fn b3_10_functions_that_are_saved_as_enabled_do_no_harm_once_the_daemon_runs() {
    let site = VirtualSite::running(&["--garbage", "4", "--saved-enables"], &[]);
    site.wait_for_identity();
    site.wait_for_live_servo();
    assert_eq!([word(&site, "0x0000"), word(&site, "0x0002")], [0, 0], "the masks of the panel");
    assert_eq!(word(&site, "0x07D4"), 0, "the records to write");
}
