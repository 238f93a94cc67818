//! Where CODE2 of a binary rotary command stands: what users see.

use crate::support::{PATIENCE, VirtualSite};

/// A board whose CODE2 stands at `code2`, and its daemon with `config`.
fn configured(code2: &str, config: &str) -> VirtualSite {
    let site = VirtualSite::configured(&["--rotary-code2", code2], config);
    site.wait_for_identity();
    assert_eq!(site.pmacctl(&["send", "&1 #1->X #2->Y"]).0, 0);
    site
}

#[test]
fn an_inc_that_the_board_takes_for_an_abs_is_found_out_before_it_moves() {
    let check = ["rotary", "check", "--define", "200"];
    for (is, told) in [("bit16", "bit12"), ("bit12", "bit16")] {
        let found = format!(
            "the board reads ABS, INC and FRAX by rotary_code2 = {is:?}: write it under [readings] in pmacd's configuration"
        );
        // The other one is told, then none, then the right one.
        let site = configured(is, &format!("[readings]\nrotary_code2 = {told:?}\n"));
        let (status, _, stderr) = site.pmacctl(&check);
        assert!(status == 1 && stderr.contains("sample:2: sent INC(X,Y), the board lists "), "{stderr}");
        assert!(stderr.contains(&found), "{stderr}");
        assert_eq!(site.connection().send("&1PR", PATIENCE).unwrap(), ["0"], "nothing is left to run");
        drop(site);
        let site = configured(is, "");
        let (status, stdout, stderr) = site.pmacctl(&check);
        assert!(format!("{stdout}{stderr}").contains(&found), "{status} {stdout} {stderr}");
        // ABS goes before the stream, INC between moves not before that is told.
        let program = site.file("program.pmc", "RAPID ABS X20\nX10\n");
        let between = site.file("between.pmc", "RAPID ABS X20\nINC X10\n");
        let (status, _, stderr) = site.pmacctl(&["rotary", "stream", &between, "--run"]);
        assert!(status == 1 && stderr.contains("between.pmc:2:1: INC cannot be sent"), "{stderr}");
        assert_eq!(site.pmacctl(&["rotary", "stream", &program, "--run"]).0, 0);
        assert!(site.log().contains("(rotary stream) sends \"&1ABS\""), "{}", site.log());
        site.wait_until("motor 1 at 10", || site.connection().send("#1P", PATIENCE).unwrap() == ["10"]);
        site.assert_no_violations();
        drop(site);
        let site = configured(is, &format!("[readings]\nrotary_code2 = {is:?}\n"));
        let (status, stdout, stderr) = site.pmacctl(&check);
        assert!(status == 0 && stdout == "the board lists 7 lines as they were sent\n", "{stdout}{stderr}");
        // The program runs as meant: 10 on, not to 10.
        let between = site.file("between.pmc", "RAPID ABS X20\nINC X10\n");
        assert_eq!(site.pmacctl(&["rotary", "stream", &between, "--run"]).0, 0);
        site.wait_until("motor 1 at 30", || site.connection().send("#1P", PATIENCE).unwrap() == ["30"]);
        site.assert_no_violations();
    }
}
