//! What no document decides: the daemon's settings for it, and that both programs work by them.

use pmac_dpram::protocol::BoardSettings;

use crate::support::{PATIENCE, VirtualSite};

/// A board whose daemon is configured with `text`, and takes commands.
fn configured(simulator: &[&str], text: &str) -> VirtualSite {
    let site = VirtualSite::configured(simulator, text);
    site.wait_for_axes();
    site
}

#[test]
fn the_example_shows_the_defaults() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("systemd/pmacd.toml.example");
    let text = std::fs::read_to_string(path).unwrap();
    let (_, tables) = text.split_once("# Settings for what no document decides").unwrap();
    // A site's own names are no such settings, and rotary_code2 has no default.
    let has_default =
        |part: &&str| ["[[motor]]", "[readings]", "[[user]]"].iter().all(|table| !part.contains(table));
    let tables: String = tables.split_inclusive("\n\n").filter(has_default).collect();
    let lines = tables.lines().filter_map(|line| line.strip_prefix("# "));
    let written = lines.filter(|line| line.starts_with('[') || line.contains(" = ") && !line.contains(','));
    let written: String = written.map(|line| format!("{line}\n")).collect();
    for list in ["rotary_longs = [512, 512]\n", "rotary_start = [0, 0]\n"] {
        assert!(tables.contains(list));
    }
    let settings: BoardSettings =
        toml::from_str(&written).unwrap_or_else(|error| panic!("{error}\n{written}"));
    assert_eq!(settings, BoardSettings::default());
    let keys = |value: &serde_json::Value| value.as_object().unwrap().len();
    let all = serde_json::to_value(&settings).unwrap();
    let expected: usize = ["plan", "variables", "rotary"].iter().map(|table| keys(&all[table])).sum();
    assert_eq!(written.lines().filter(|line| line.contains(" = ")).count(), expected - 2, "{written}");
}

#[test]
fn the_daemon_and_the_command_line_work_by_them() {
    let site = configured(
        &["--rotary-cs-base", "0"],
        "[plan]\nrotary_longs = [64, 0]\nrotary_start = [0xD900, 0]\ngather_longs = 600\n\
         [variables]\nmode = \"multi-user\"\n[rotary]\ncoordinate_system_base = 0\n",
    );
    let settings = site.connection().settings().unwrap();
    assert_eq!((settings.plan.gather_longs, settings.rotary.coordinate_system_base), (600, 0));

    let program = site.path("program.pmc");
    std::fs::write(&program, "RAPID X10 Y-5\nX20\n").unwrap();
    let file = program.to_str().unwrap();
    let (status, stdout, stderr) = site.pmacctl(&["rotary", "stream", file, "--define", "200", "--run"]);
    assert_eq!(status, 0, "{stderr}");
    assert!(stdout.starts_with("lines=2 commands=4 "), "{stdout}");
    site.wait_until("the motors where the text says", || {
        let lines = site.connection().send("#1P #2P", PATIENCE).unwrap();
        lines == ["20", "-5"]
    });
    assert_eq!(site.word("0x07F2"), 0, "the header's coordinate system");
    assert_eq!((site.word("0x07F8"), site.word("0x07FA")), (64, 0xD900), "size and start");
    let (status, _, stderr) = site.pmacctl(&["rotary", "stream", file, "--buffer", "2"]);
    assert!(status == 2 && stderr.contains("no room for rotary buffer 2"), "{stderr}");

    let (status, stdout, stderr) =
        site.pmacctl(&["variable", "watch", "X:$0000", "--count", "2", "--seconds", "10"]);
    assert_eq!((status, stdout.lines().count()), (0, 2), "{stderr}");
    std::thread::scope(|scope| {
        scope.spawn(|| site.pmacctl(&["variable", "watch", "X:$0000", "--seconds", "2"]));
        site.wait_until("the variable buffer in multi-user mode", || site.word("0x07E8") & 0x100 != 0);
    });

    // 600 longs hold 300 samples of a long register, whole.
    let csv = site.path("data.csv");
    let gather = ["gather", "--source", "D:$0028", "--once", "-o", csv.to_str().unwrap()];
    let (status, stdout, stderr) = site.pmacctl(&gather);
    assert!(status == 0 && stdout.starts_with("samples=300 lost=0 "), "{stdout}{stderr}");
    // The board's firmware has moved gathering by 64 longs, which the daemon knows by now.
    let end = 0xD240 + 600;
    let open = |address: u32| site.pmacctl(&["write", &format!("Y:${address:X}"), "7"]);
    assert_eq!(open(end).0, 0);
    let (status, _, stderr) = open(end - 1);
    assert!(status != 0 && stderr.contains("belongs to the gather buffer"), "{stderr}");
    site.assert_no_violations();
}

#[test]
fn the_exponent_in_a_stream_has_the_daemons_bias_unless_told_otherwise() {
    let site = configured(&[], "[rotary]\nexponent_bias = 30\n[plan]\nrotary_start = [0xD900, 0]\n");
    let program = site.path("program.pmc");
    std::fs::write(&program, "X10\n").unwrap();
    let file = program.to_str().unwrap();
    for (options, expected) in
        [(&["--define", "200"][..], 0x0E22), (&["--set", "exponent_bias=31", "--clear"], 0x0E23)]
    {
        let (status, _, stderr) = site.pmacctl(&[&["rotary", "stream", file], options].concat());
        assert_eq!(status, 0, "{stderr}");
        assert_eq!(site.word("0x2400"), expected, "{options:?}");
    }
    let (status, _, stderr) = site.pmacctl(&["rotary", "stream", file, "--set", "exponent_bias=64"]);
    assert!(status == 2 && stderr.contains("0 to 63"), "{stderr}");
    site.assert_no_violations();
}

/// The simulated board has its buffer where real ones have it, by the table of a production driver.
#[test]
fn every_firmware_gathers_without_a_setting() {
    for (firmware, index) in [
        ("1.13", "0x07FE"),
        ("1.16B", "0x07FE"),
        ("1.16C", "0x08FE"),
        ("1.16E", "0x08FE"),
        ("1.16H", "0x08FE"),
        ("1.17A", "0x08FE"),
        ("1.18", "0x08FE"),
    ] {
        let site = configured(&["--firmware", firmware], "");
        let gather = ["gather", "--source", "servo_timer", "--once", "--buffer", "50", "-o", "-"];
        let (status, stdout, stderr) = site.pmacctl(&gather);
        assert_eq!((status, stdout.lines().count()), (0, 51), "{firmware}: {stderr}");
        assert_eq!(site.word(index), 50, "{firmware}");
        site.assert_no_violations();
    }
}

/// The daemon is told an older firmware than the board's, whose buffer and words are elsewhere.
#[test]
fn a_board_that_keeps_its_gather_words_elsewhere_is_refused_with_the_page() {
    let site = configured(&["--firmware", "1.18"], "ask_board = false\nfirmware = \"1.15\"\n");
    let gather = ["gather", "--source", "servo_timer", "--once", "--buffer", "50", "-o", "-"];
    let (status, _, stderr) = site.pmacctl(&gather);
    let told = "DEFINE GATHER 50 should have left 50 at 0x07FC and 0 at 0x07FE";
    assert!(status == 1 && stderr.contains(told) && stderr.contains("see docs/evidence.md"), "{stderr}");
    site.assert_no_violations();
}
