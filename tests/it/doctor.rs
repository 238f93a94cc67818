//! `pmacctl doctor` on machines made of ordinary files, and its probe into a simulated board.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::time::Duration;

use crate::support::rig::pmacctl;
use crate::support::{PATIENCE, VirtualSite};

fn file(root: &Path, path: &str, content: &str) {
    let path = root.join(path);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(&path, content).unwrap();
    fs::set_permissions(path, fs::Permissions::from_mode(0o600)).unwrap();
}

fn uio(root: &Path, device: &str, name: &str, size: &str) {
    let class = format!("sys/class/uio/{device}");
    file(root, &format!("{class}/name"), name);
    file(root, &format!("{class}/maps/map0/addr"), "0xd4000");
    file(root, &format!("{class}/maps/map0/size"), size);
    file(root, &format!("dev/{device}"), "");
}

#[test]
fn boards_are_found_with_what_to_write_and_what_is_in_the_way() {
    let root = tempfile::tempdir().unwrap();
    let look = |arguments: &str| pmacctl(&format!("doctor {arguments} --root {}", root.path().display()));
    let ran = look("--boards");
    assert_eq!(ran.code, Some(0), "{ran:?}");
    assert!(ran.stdout.contains("warn  candidate     no UIO, PCI or VME device"), "{ran:?}");

    uio(root.path(), "uio0", "pmac-dpram", "0x4000");
    file(root.path(), "sys/kernel/security/lockdown", "none [integrity] confidentiality\n");
    let ran = look("--boards");
    assert!(
        ran.stdout.contains("ok    candidate     likely uio:/dev/uio0: UIO device pmac-dpram"),
        "{ran:?}"
    );
    assert!(ran.stdout.contains("unknown, locked down (integrity)"), "{ran:?}");
    for usual in ["mem:0xD4000", "mem:0xD0000"] {
        assert!(ran.stdout.contains(usual), "an ISA board cannot be detected: {ran:?}");
    }

    let report = look("--boards --json").json();
    let found = report.as_array().unwrap().iter().find_map(|check| check.get("candidate")).unwrap();
    assert_eq!((&found["spec"], &found["certainty"]), (&"uio:/dev/uio0".into(), &"likely".into()));
    assert_eq!((&found["usable"], &found["exposed"]), (&true.into(), &false.into()));

    let mode =
        |bits| fs::set_permissions(root.path().join("dev/uio0"), fs::Permissions::from_mode(bits)).unwrap();
    mode(0o660);
    let ran = look("--boards");
    assert!(ran.stdout.contains("warn  candidate     likely uio:/dev/uio0"), "{ran:?}");
    assert!(ran.stdout.contains("others than root and pmacd may open /dev/uio0 (mode 0660"), "{ran:?}");
}

#[test]
fn the_kernels_options_stand_beside_the_kind_of_board_that_needs_them() {
    let root = tempfile::tempdir().unwrap();
    let kernel = || {
        let ran = pmacctl(&format!("doctor --boards --root {}", root.path().display()));
        let lines = ran.stdout.lines().filter(|line| line[6..].starts_with("kernel "));
        lines.map(|line| format!("{line}\n")).collect::<String>()
    };
    assert_eq!(
        kernel(),
        "ok    kernel        unknown, without lockdown support; STRICT_DEVMEM=? IO_STRICT_DEVMEM=?\n\
         ok    kernel        PCI board: uio: UIO=? UIO_PCI_GENERIC=?; pci: no option\n\
         ok    kernel        ISA board: mem: DEVMEM=?; uio: UIO=?\n\
         ok    kernel        VME board: vme: UIO=?; mem: DEVMEM=?\n"
    );
    // Debian's.
    file(root.path(), "sys/kernel/security/lockdown", "[none] integrity confidentiality\n");
    file(root.path(), "proc/sys/kernel/osrelease", "6.1.0-9-amd64\n");
    file(root.path(), "proc/cmdline", "BOOT_IMAGE=/vmlinuz quiet iomem=relaxed\n");
    file(
        root.path(),
        "boot/config-6.1.0-9-amd64",
        "CONFIG_DEVMEM=y\nCONFIG_STRICT_DEVMEM=y\nCONFIG_IO_STRICT_DEVMEM=y\nCONFIG_UIO=m\nCONFIG_UIO_PCI_GENERIC=m\n",
    );
    assert_eq!(
        kernel(),
        "ok    kernel        6.1.0-9-amd64, not locked down; STRICT_DEVMEM=y IO_STRICT_DEVMEM=y, iomem=relaxed\n\
         ok    kernel        PCI board: uio: UIO=m UIO_PCI_GENERIC=m; pci: no option\n\
         ok    kernel        ISA board: mem: DEVMEM=y; uio: UIO=m\n\
         ok    kernel        VME board: vme: UIO=m; mem: DEVMEM=y\n"
    );
    // docs/install.md has the same options.
    let page = fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/install.md")).unwrap();
    for option in kernel().split_whitespace().filter_map(|word| Some(word.split_once('=')?.0)) {
        assert!(page.contains(&format!("`{option}=")) || page.contains(&format!("`{option}`")), "{option}");
    }
    // Locked down, and with UIO alone.
    file(root.path(), "sys/kernel/security/lockdown", "none [integrity] confidentiality\n");
    file(root.path(), "proc/cmdline", "quiet\n");
    file(root.path(), "boot/config-6.1.0-9-amd64", "CONFIG_UIO=y\n");
    let shut = "none of these is open on this kernel: see \"Kernel options\" in docs/install.md";
    assert_eq!(
        kernel(),
        format!(
            "warn  kernel        6.1.0-9-amd64, locked down (integrity): only UIO devices can be mapped, and \
             uio_pci_generic gives no interrupts; STRICT_DEVMEM=n IO_STRICT_DEVMEM=n\n\
             warn  kernel        PCI board: uio: UIO=y UIO_PCI_GENERIC=n; pci: no option; {shut}\n\
             ok    kernel        ISA board: mem: DEVMEM=n; uio: UIO=y\n\
             ok    kernel        VME board: vme: UIO=y; mem: DEVMEM=n\n"
        )
    );
}

#[test]
fn a_board_in_a_slot_gets_a_rule_of_its_own_alone_in_its_line() {
    let root = tempfile::tempdir().unwrap();
    let device = "sys/bus/pci/devices/0000:03:00.0";
    for (name, content) in [
        ("vendor", "0x1172\n"),
        ("device", "0x0001\n"),
        ("resource", "0xfea00000 0xfea03fff 0x40200\n"),
        ("resource0", ""),
        ("uio/uio2/name", "uio_pci_generic\n"),
    ] {
        file(root.path(), &format!("{device}/{name}"), content);
    }
    uio(root.path(), "uio2", "uio_pci_generic", "0x100");
    let ran = pmacctl(&format!("doctor --boards --root {}", root.path().display()));
    let rule = "SUBSYSTEM==\"uio\", SUBSYSTEMS==\"pci\", KERNELS==\"0000:03:00.0\", ATTRS{vendor}==\"0x1172\", \
                ATTRS{device}==\"0x0001\", OWNER=\"pmacd\", GROUP=\"root\", MODE=\"0600\", ENV{ID_PMAC}=\"1\"";
    assert!(ran.stdout.lines().any(|line| line == format!("ok    udev rule     {rule}")), "{ran:?}");
    assert!(ran.stdout.contains("put the udev rule below into /etc/udev/rules.d/59-pmacd.rules"), "{ran:?}");
    assert!(ran.stdout.contains("pci.conf and write 0000:03:00.0 0 in it"), "{ran:?}");
}

#[test]
fn without_a_daemon_the_doctor_looks_for_boards_by_itself() {
    let root = tempfile::tempdir().unwrap();
    let look = |name: &str| {
        pmacctl(&format!("doctor --name {name} --socket /nonexistent/x --root {}", root.path().display()))
    };
    let ran = look("pmac-test-nobody");
    assert_eq!(ran.code, Some(1));
    assert!(ran.stdout.contains("candidate") && ran.stdout.contains("ISA"), "{ran:?}");
}

#[test]
fn a_probe_tells_a_board_from_memory_and_from_nothing() {
    let site = VirtualSite::new();
    site.start_simulator(&["--dpram-startup"]);
    let board = format!("file:{}", site.path("dpram").display());
    let probe = |spec: &str| {
        let (code, stdout, stderr) = site.pmacctl(&["doctor", "--json", "--probe", spec]);
        let report: serde_json::Value = serde_json::from_str(&stdout).unwrap_or_else(|_| panic!("{stderr}"));
        (code, report[0]["probe"]["verdict"].as_str().map(str::to_owned), report[0]["text"].to_string())
    };
    let (code, verdict, text) = probe(&board);
    assert_eq!((code, verdict.as_deref()), (0, Some("reporting")), "{text}");
    assert!(text.contains("a timer counts") && !text.contains("servo data"), "no more than was seen: {text}");
    let other = site.path("other");
    for (byte, code, verdict) in [(0, 0, "still"), (0xFF, 1, "absent")] {
        fs::write(&other, vec![byte; 0x4000]).unwrap();
        let seen = probe(&format!("file:{}", other.display()));
        assert_eq!((seen.0, seen.1.as_deref()), (code, Some(verdict)), "{}", seen.2);
    }
    // A file that only a Turbo PMAC2's memory fits is taken for one.
    fs::write(&other, vec![0; 0x1_0000]).unwrap();
    let seen = probe(&format!("file:{}", other.display()));
    assert_eq!((seen.0, seen.1.as_deref()), (0, Some("still")), "{}", seen.2);
    let (code, verdict, text) = probe("uio:/dev/uio63");
    assert_eq!((code, verdict), (1, None));
    assert!(text.contains("/dev/uio63"), "{text}");
    let (code, _, stderr) = site.pmacctl(&["doctor", "--probe", "boat"]);
    assert!(code == 2 && stderr.contains("no board kind `boat`"), "{stderr}");
}

#[test]
fn a_report_that_was_ended_is_told_with_what_is_missing() {
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    let line = |check: &str| {
        let stdout = site.pmacctl(&["doctor"]).1;
        stdout.lines().find(|line| line[6..].starts_with(check)).unwrap_or_default().to_owned()
    };
    site.wait_until("a board that has been asked", || line("commands").contains("takes command lines"));
    site.wait_until("all the board is set to", || site.has_scales());
    let send = |text: &str| assert_eq!(site.pmacctl(&["send", text]).0, 0, "{text}");
    send("ENDGATHER");
    site.wait_until("GATHER to be missed", || {
        let servo = line("servo");
        servo.starts_with("FAIL")
            && servo.contains("I48=1, I19=1, I59=8 but no GATHER")
            && servo.contains("pmacctl send GATHER")
    });
    send("I48=0");
    site.wait_until("I48 to be missed", || {
        line("servo").contains("the board has I48=0; switch it on: pmacctl send 'I48=1'")
    });
    send("I48=1");
    send("GATHER");
    site.wait_until("servo data", || line("servo").starts_with("ok"));
}

#[test]
fn a_port_that_was_not_used_is_told_as_unknown() {
    let site = VirtualSite::new();
    let config = site.path("pmacd.toml");
    fs::write(&config, "ask_board = false\n").unwrap();
    site.start_simulator(&["--dpram-startup"]);
    site.start_daemon(&["--config", config.to_str().unwrap()]);
    site.wait_for_live_servo();
    site.run_for(Duration::from_secs(5));
    assert_eq!(site.status()["commands"], 0, "the board was not to be asked");
    let commands = || {
        let stdout = site.pmacctl(&["doctor"]).1;
        stdout.lines().find(|line| line.contains("commands ")).unwrap_or_default().to_owned()
    };
    assert!(commands().starts_with("ok    commands      not known yet"), "{}", commands());
    assert_eq!(site.pmacctl(&["send", "I48=1"]).0, 0);
    site.wait_until("an answer to be told of", || commands().contains("the board takes command lines"));
    // What the board was not asked is not known either.
    site.connection().send("ENDGATHER", PATIENCE).unwrap();
    site.wait_until("what it takes to be told", || {
        let stdout = site.pmacctl(&["doctor"]).1;
        stdout.contains(
            "I48 and I19 and I59 not known; the report needs I48 and I19 and I59 above 0, and GATHER",
        )
    });
}

#[test]
fn the_doctor_waits_for_a_board_that_comes_up_after_a_reset() {
    let site = VirtualSite::configured(&["--family", "turbo2"], "family = \"turbo2\"\n");
    site.wait_for_live_servo();
    site.wait_for_identity();
    site.wait_until("a board that is well", || site.run(&["doctor"]).code == Some(0));
    site.wait_until("the board's answers", || site.run(&["send", "SAVE"]).code == Some(0));
    site.run(&["send", "$$$"]);
    let ran = site.hurried(|| site.run(&["doctor"]));
    assert_eq!(ran.code, Some(0), "{ran:?}");
    assert!(ran.stdout.contains("it was reset ") && !ran.stdout.contains("FAIL"), "{ran:?}");
    assert!(ran.stderr.contains("waiting for it to come up"), "{ran:?}");
    // What a reset has really ended is told when the time is over.
    let site = VirtualSite::running(&[], &[]);
    site.wait_for_live_servo();
    site.wait_for_identity();
    site.wait_until("a board that is well", || site.run(&["doctor"]).code == Some(0));
    site.run(&["send", "$$$"]);
    let ran = site.hurried(|| site.run(&["doctor"]));
    let waited = ran.stdout.split("it was reset ").nth(1).and_then(|told| told.split(' ').next());
    let waited = waited.map(|seconds| seconds.parse::<u32>().unwrap());
    assert!(ran.code == Some(1) && waited.is_some_and(|seconds| seconds >= 14), "{ran:?}");
}
