//! The binary rotary buffers of a Turbo board: one for each of its 16 coordinate systems.

use std::os::unix::fs::FileExt;
use std::path::PathBuf;

use pmac_dpram::client::{RotaryFeed, RotaryPlace};

use crate::support::{PATIENCE, VirtualSite};

/// The header of coordinate system n, 1 to 16, lies at 0x1050 + 12*(n-1): status, system, host index, PMAC index, size, start
/// (docs/evidence.md, "Binary rotary buffers").
const HEADERS: u64 = 0x1050;
const HEADER: u64 = 12;

fn running(simulator: &[&str]) -> VirtualSite {
    let site =
        VirtualSite::configured(&[&["--family", "turbo2"], simulator].concat(), "family = \"turbo2\"\n");
    site.wait_until("the board to be identified", || site.log().contains("the board is TURBO2"));
    site
}

fn program(site: &VirtualSite, text: &str) -> PathBuf {
    let path = site.path("program.pmc");
    std::fs::write(&path, text).unwrap();
    path
}

/// The six words of the header of coordinate system `cs`.
fn header(site: &VirtualSite, cs: u64) -> [u16; 6] {
    let memory = std::fs::File::open(site.path("dpram")).unwrap();
    let mut bytes = [0; HEADER as usize];
    memory.read_exact_at(&mut bytes, HEADERS + HEADER * (cs - 1)).unwrap();
    std::array::from_fn(|word| u16::from_le_bytes([bytes[2 * word], bytes[2 * word + 1]]))
}

#[test]
fn every_coordinate_system_of_a_turbo_board_has_a_rotary_buffer() {
    let site = running(&[]);
    let file = program(&site, "RAPID X10\nX250\n");
    let file = file.to_str().unwrap();
    // The highest first, as DEFINE ROT wants it.
    for (cs, motor) in [("16", 32), ("9", 20), ("1", 3)] {
        site.ask(&format!("&{cs}#{motor}->X"));
        let (status, stdout, stderr) =
            site.pmacctl(&["rotary", "stream", file, "--cs", cs, "--define", "100", "--run"]);
        assert_eq!(status, 0, "{cs}: {stdout}{stderr}");
        assert!(stdout.starts_with("lines=2 commands=3 "), "{stdout}");
        site.wait_until("the motor where the text says", || site.ask(&format!("#{motor}P")) == ["250"]);
        let number = cs.parse().unwrap();
        let [status, system, host, pmac, size, start] = header(&site, number);
        // The start counts from $060450, the DPRAM ends at $064000, and each buffer is 512 longs.
        let place = (0x06_4000 - 0x06_0450 - 512 * number) as u16;
        assert_eq!([status, system, size, start], [0, number as u16, 512, place], "{cs}");
        assert_eq!((host, pmac), (6, 6));
        site.ask(&format!("&{cs}Q"));
    }
    site.assert_no_violations();
}

#[test]
fn headers_full_of_garbage_are_not_in_use_when_binary_entry_opens() {
    let site = running(&["--garbage", "5"]);
    let memory = std::fs::File::options().write(true).open(site.path("dpram")).unwrap();
    memory.write_all_at(&[0x16; 16 * HEADER as usize], HEADERS).unwrap();
    let file = program(&site, "RAPID X1\n");
    let (status, _, stderr) =
        site.pmacctl(&["rotary", "stream", file.to_str().unwrap(), "--cs", "2", "--define", "100"]);
    assert_eq!(status, 0, "{stderr}");
    for cs in (1..=16).filter(|cs| *cs != 2) {
        assert_eq!(header(&site, cs)[4], 0, "coordinate system {cs}");
    }
    assert_eq!(header(&site, 2)[4], 512);
    site.assert_no_violations();
}

#[test]
fn a_turbo_board_lists_what_it_was_sent_home_of_motor_24_too() {
    let site = running(&[]);
    let check = site.run(&["rotary", "check", "--cs", "9", "--define", "500"]);
    assert_eq!(
        check.stdout,
        "the board lists 8 lines as they were sent\n\
        the board reads ABS, INC and FRAX by rotary_code2 = \"bit16\": write it under [readings] in pmacd's configuration\n",
        "{check:?}"
    );
    // Text entry is another one (Turbo Software Reference p. 290): nothing is left open.
    assert_eq!(site.ask("I58"), ["1"]);
    let beyond = site.run(&["rotary", "check", "--cs", "17"]);
    assert_eq!((beyond.code, beyond.stderr.as_str()), (Some(2), "pmacctl: --cs 17: the board has 1 to 16\n"));
    site.assert_no_violations();
}

#[test]
fn the_buffer_of_another_coordinate_system_is_refused() {
    let site = running(&[]);
    let file = program(&site, "X1\n");
    let stream = site.run(&[
        "rotary",
        "stream",
        file.to_str().unwrap(),
        "--cs",
        "3",
        "--buffer",
        "4",
        "--define",
        "9",
    ]);
    assert_eq!(
        (stream.code, stream.stderr.as_str()),
        (
            Some(2),
            "pmacctl: --buffer 4: on a Turbo PMAC2 buffer 4 is that of coordinate system 4; leave --buffer out\n"
        )
    );
    let place = RotaryPlace { buffer: 4, coordinate_system: 3, ..RotaryPlace::default() };
    let error = site.connection().rotary_start(place).unwrap_err().to_string();
    assert!(error.contains("3, the coordinate system's own"), "{error}");
    assert!(!site.log().contains("DEFINE"), "nothing was sent");
}

/// What the words have no room for is refused with its place, not sent to another motor or variable.
#[test]
fn motors_and_variables_without_a_bit_are_refused() {
    let site = VirtualSite::new();
    let encode = |text: &str, family: &str| {
        let file = program(&site, text);
        site.run(&["rotary", "encode", file.to_str().unwrap(), "--family", family])
    };
    // No text tells a difference from PMAC's commands (docs/evidence.md): bit n-1 is motor n.
    let home = encode("HOME1,9,24\n", "turbo2");
    assert_eq!((home.stdout.as_str(), home.code), ("000F83 800101  ; 1:1 HOME1,9,24\n", Some(0)));
    for (text, family, reason) in [
        (
            "HOME25\n",
            "turbo2",
            "1:5: 25: HOME takes whole numbers from 1 to 24; its binary command has no bit",
        ),
        ("HOME9\n", "pmac", "1:5: 9: HOME takes whole numbers from 1 to 8; its binary command has no bit"),
        ("P1024=1\n", "turbo2", "from 0 to 1023; a binary command has no room for others"),
    ] {
        let refused = encode(text, family);
        assert_eq!(refused.code, Some(1), "{refused:?}");
        assert!(refused.stderr.contains(reason), "{refused:?}");
    }
}

/// A stream into a high coordinate system sees that its program ended, though ^C tells of eight systems alone.
#[test]
fn a_stream_into_a_high_coordinate_system_ends_with_its_program() {
    let site = running(&[]);
    site.ask("&12#5->X");
    let line = vec![(0x00_0E23, 0x50_0000)];
    let lines: Vec<_> = std::iter::repeat_n(line, 400).collect();
    let mut owner = site.connection();
    let place = RotaryPlace {
        buffer: 12,
        coordinate_system: 12,
        coordinate_system_base: 1,
        define_longs: Some(50),
        run: true,
        ..RotaryPlace::default()
    };
    owner.rotary_start(place).unwrap();
    let mut feed = RotaryFeed::new(owner, 12, &lines);
    site.wait_until("a program that runs", || {
        feed.step().unwrap();
        // Bit 0 of the first word of `??`: a program runs.
        u32::from_str_radix(&site.ask("&12??")[0][..6], 16).unwrap() & 1 == 1
    });
    site.connection().send("&12A", PATIENCE).unwrap();
    let mut stopped = None;
    site.wait_until("the end of the stream", || {
        if feed.step().is_err() {
            stopped = feed.stop().ok();
        }
        stopped.is_some()
    });
    let reason = stopped.and_then(|stop| stop.reason).unwrap_or_default();
    assert!(reason.contains("&12 does not run its rotary program any more"), "{reason}");
}
