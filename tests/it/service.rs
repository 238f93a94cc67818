//! `pmacd` as a system service: what it tells the service manager, how it ends, and what it holds; unit files and udev rules,
//! checked by the tools that will read them.

use std::fs;
use std::io::{self, Read};
use std::os::unix::fs::MetadataExt;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use pmac_dpram::client::Connection;

use crate::support::{PATIENCE, Site, status_within, wait_until};

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn every_failure_has_the_exit_status_that_the_unit_acts_on() {
    let mut site = Site::new();
    site.start_simulator(&[]);
    let status = |site: &Site, options: &[&str]| {
        let output = site.daemon_command(options).output().unwrap();
        (output.status.code().unwrap_or(-1), String::from_utf8(output.stderr).unwrap())
    };
    let configuration = |text: &str| {
        let path = site.path("configuration");
        fs::write(&path, text).unwrap();
        path.display().to_string()
    };
    let unknown_group = configuration("[roles]\noperate = [\"no-such-group-here\"]\n");
    let (code, error) = status(&site, &["--config", &unknown_group]);
    assert!(code == 78 && error.contains("no-such-group-here"), "{code} {error}");
    let group_of_segment = configuration("segment_group = \"no-such-group-here\"\n");
    let (code, error) = status(&site, &["--config", &group_of_segment]);
    assert!(code == 78 && error.contains("no-such-group-here"), "{code} {error}");
    // What lies where the socket should be is not ours.
    fs::write(site.socket(), "precious").unwrap();
    assert_eq!(status(&site, &[]).0, 78);
    fs::remove_file(site.socket()).unwrap();
    let unit = fs::read_to_string(root().join("systemd/pmacd@.service")).unwrap();
    assert!(unit.contains("RestartPreventExitStatus=64 77 78"));
    // Nothing is left of the failed attempts.
    site.start_daemon(&[]);
    assert_eq!(site.stop_daemon(), 0);
}

#[test]
fn too_few_open_files_are_told_at_the_start_and_a_soft_limit_is_raised() {
    let mut site = Site::new();
    site.start_simulator(&[]);
    let limited = |limit: &str| {
        let daemon = site.daemon_command(&[]);
        let mut shell = Command::new("sh");
        shell.args(["-c", &format!("ulimit {limit}; exec \"$0\" \"$@\"")]);
        shell.arg(daemon.get_program()).args(daemon.get_args()).stdin(Stdio::null()).stderr(Stdio::piped());
        shell
    };
    for files in [6, 14, 15, 16, 17, 20, 30, 50] {
        let mut child = limited(&format!("-n {files}")).spawn().unwrap();
        let status = status_within(&mut child, PATIENCE);
        let mut error = String::new();
        child.stderr.take().unwrap().read_to_string(&mut error).unwrap();
        assert_eq!(status.code(), Some(71), "{files}: {error}");
        assert!(error.contains("raise the limit (LimitNOFILE= of the unit, ulimit -n)"), "{files}: {error}");
    }
    let child = limited("-S -n 14").stderr(Stdio::null()).spawn().unwrap();
    let mut site = site.adopt(child);
    wait_until("an answer", || {
        Connection::open(&site.socket()).is_ok_and(|mut connection| connection.info().is_ok())
    });
    assert_eq!(site.stop_daemon(), 0);
}

#[test]
fn a_full_file_limit_is_told_by_every_program() {
    let mut site = Site::new();
    site.start_simulator(&[]);
    let limited = |command: &Command| {
        let mut shell = Command::new("sh");
        shell
            .args(["-c", "ulimit -f 1; exec \"$0\" \"$@\""])
            .arg(command.get_program())
            .args(command.get_args());
        shell.stdin(Stdio::null()).output().unwrap()
    };
    let memory = site.path("another").display().to_string();
    let mut simulator = Command::new(env!("CARGO_BIN_EXE_pmac-sim"));
    simulator.args(["--memory", &memory]);
    let written = site.path("image").display().to_string();
    let mut backup = Command::new("sh");
    backup.args(["-c", "exec \"$0\" map >\"$1\"", env!("CARGO_BIN_EXE_pmacctl"), &written]);
    for (command, said) in [
        (&site.daemon_command(&[]), "ulimit -f"),
        (&simulator, "File too large"),
        (&backup, "File too large"),
    ] {
        let output = limited(command);
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code().is_some_and(|code| code > 0) && error.contains(said), "{output:?}");
    }
}

/// A line of a process's status, of each of its threads.
fn of_each_thread(pid: u32, field: &str) -> Vec<String> {
    let threads = fs::read_dir(format!("/proc/{pid}/task")).unwrap();
    let value = |thread: fs::DirEntry| {
        let status = fs::read_to_string(thread.path().join("status")).unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix(field)?.strip_prefix(':'));
        line.unwrap().split_whitespace().collect::<Vec<_>>().join(" ")
    };
    threads.flatten().map(value).collect()
}

#[test]
fn no_thread_of_the_running_daemon_holds_a_capability() {
    let site = Site::running(&[], &[]);
    site.wait_for_live_servo();
    let pid = site.daemon_pid();
    for field in ["CapEff", "CapPrm", "CapInh", "CapAmb"] {
        let sets = of_each_thread(pid, field);
        assert!(sets.len() >= 5 && sets.iter().all(|set| set == "0000000000000000"), "{field}: {sets:?}");
    }
    assert!(of_each_thread(pid, "NoNewPrivs").iter().all(|flag| flag == "1"));
    // Said once everything runs, which may be after the first servo data.
    wait_until("what it holds to be told", || {
        let log = site.log();
        log.contains("no capabilities") && log.contains("memory ") && log.contains(", scheduling other")
    });
}

#[test]
#[ignore = "needs root"]
fn as_root_it_becomes_another_user_in_every_thread_and_leaves_nothing_behind() {
    let user = nix::unistd::User::from_name("nobody").unwrap().unwrap();
    let mut site = Site::new();
    // A place that the user may use; the board as it opens it.
    let owner = (Some(user.uid.as_raw()), Some(user.gid.as_raw()));
    std::os::unix::fs::chown(site.directory.path(), owner.0, owner.1).unwrap();
    site.start_simulator(&["--dpram-startup"]);
    for name in ["dpram", "interrupt"] {
        std::os::unix::fs::chown(site.path(name), owner.0, owner.1).unwrap();
    }
    let daemon = site.daemon_command(&["--user", "nobody"]).stderr(Stdio::null()).spawn().unwrap();
    // (A client would not believe a segment of this user's.)
    let mut site = site.adopt(daemon);
    wait_until("the daemon's socket", || UnixStream::connect(site.socket()).is_ok());
    let pid = site.daemon_pid();
    let (uid, gid) = (user.uid.to_string(), user.gid.to_string());
    assert!(of_each_thread(pid, "Uid").iter().all(|line| line.split(' ').all(|each| each == uid)));
    assert!(of_each_thread(pid, "Gid").iter().all(|line| line.split(' ').all(|each| each == gid)));
    for field in ["CapEff", "CapPrm", "CapInh", "CapAmb", "CapBnd"] {
        assert!(of_each_thread(pid, field).iter().all(|set| set == "0000000000000000"), "{field}");
    }
    let segment = Path::new("/dev/shm").join(&site.name);
    assert_eq!(fs::metadata(&segment).unwrap().uid(), user.uid.as_raw());
    assert_eq!(site.stop_daemon(), 0);
    assert!(!segment.exists() && !site.socket().exists());
}

#[test]
fn questions_fill_no_log_and_passwords_stay_out_of_it() {
    let site = Site::running(&[], &[]);
    let mut connection = site.connection();
    let refused = (0..200).filter(|_| connection.rotary_state(1).is_err()).count();
    assert_eq!(refused, 200, "no buffer is open");
    let _ = connection.send("PASSWORD=\"OpenSesame\"", PATIENCE);
    wait_until("the password's line", || site.log().contains("sends \"PASSWORD=***\""));
    let log = site.log();
    assert!(log.lines().filter(|line| line.contains("refused that of")).count() <= 20, "{log}");
    assert!(!log.contains("OpenSesame"), "{log}");
}

#[test]
fn the_state_directory_keeps_where_definitions_were_found() {
    let mut site = Site::new();
    site.start_simulator(&["--dpram-startup"]);
    let state = site.path("state");
    fs::create_dir(&state).unwrap();
    let file = state.join(format!("{}.m_variables", site.name));
    fs::write(&file, "broken").unwrap();
    let log = fs::File::create(site.path("log")).unwrap();
    let daemon = site.daemon_command(&[]).env("STATE_DIRECTORY", &state).stderr(log).spawn().unwrap();
    let site = site.adopt(daemon);
    wait_until("a line taken", || {
        Connection::open(&site.socket())
            .is_ok_and(|mut connection| connection.send("M500->DP:$D7F0", PATIENCE).is_ok())
    });
    wait_until("the file", || {
        fs::read_to_string(&file).is_ok_and(|text| text.lines().any(|line| line == "M384"))
    });
    assert_eq!(fs::read_dir(&state).unwrap().count(), 1, "the new file took the old one's place");
    let log = fs::read_to_string(site.path("log")).unwrap();
    assert!(log.contains("is broken and not used"), "{log}");
}

#[test]
fn the_journal_gets_levels_and_a_terminal_words() {
    let run = |journal: bool| {
        let (mut reader, writer) = io::pipe().unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_pmacd"));
        command.args(["--board", "boat"]).stdin(Stdio::null());
        if journal {
            let stat = nix::sys::stat::fstat(&writer).unwrap();
            command.env("JOURNAL_STREAM", format!("{}:{}", stat.st_dev, stat.st_ino));
        }
        command.stderr(writer).status().unwrap();
        drop(command);
        let mut text = String::new();
        reader.read_to_string(&mut text).unwrap();
        text
    };
    assert!(run(true).starts_with("<3>"), "{}", run(true));
    assert!(run(false).starts_with("pmacd: "), "{}", run(false));
}

/// A tree as the package lays it out, as far as unit files are concerned.
fn installed() -> tempfile::TempDir {
    let tree = tempfile::tempdir().unwrap();
    let put = |from: &str, to: &str, mode: u32| {
        let to = tree.path().join(to);
        fs::create_dir_all(to.parent().unwrap()).unwrap();
        fs::copy(root().join(from), &to).unwrap();
        fs::set_permissions(&to, std::os::unix::fs::PermissionsExt::from_mode(mode)).unwrap();
    };
    put("systemd/pmacd@.service", "usr/lib/systemd/system/pmacd@.service", 0o644);
    put("systemd/pmac-gateway@.service", "usr/lib/systemd/system/pmac-gateway@.service", 0o644);
    put("systemd/pmac-web@.service", "usr/lib/systemd/system/pmac-web@.service", 0o644);
    for program in ["usr/lib/pmacd/pci-prepare", "usr/sbin/pmacd", "usr/bin/pmac-gateway", "usr/bin/pmac-web"]
    {
        put("systemd/pci-prepare", program, 0o755);
    }
    tree
}

/// The unit of the page, which has no drop-in.
const PAGE: &str = "pmac-web";

/// The service that a drop-in is for.
fn service_of(drop_in: &str) -> &'static str {
    match drop_in {
        PAGE => "pmac-web@pmac0.service",
        _ if drop_in.starts_with("gateway") => "pmac-gateway@pmac0.service",
        _ => "pmacd@pmac0.service",
    }
}

fn with_drop_in(tree: &Path, name: &str) {
    let directory = tree.join("etc/systemd/system").join(format!("{}.d", service_of(name)));
    fs::create_dir_all(&directory).unwrap();
    fs::copy(root().join("systemd/dropins").join(name), directory.join(name)).unwrap();
}

#[test]
#[ignore = "needs systemd-analyze"]
fn with_systemd_it_finds_nothing_to_say_about_the_units() {
    let drop_ins = fs::read_dir(root().join("systemd/dropins")).unwrap().flatten();
    let names = drop_ins.map(|entry| entry.file_name().into_string().unwrap());
    let names: Vec<String> = names.filter(|name| name.ends_with(".conf")).collect();
    assert!(names.len() >= 6);
    for name in names.iter().map(String::as_str).chain(["", PAGE]) {
        let tree = installed();
        // The targets that any unit wants, from this machine's own systemd.
        let units = tree.path().join("usr/lib/systemd/system");
        for unit in [
            "sysinit.target",
            "basic.target",
            "shutdown.target",
            "multi-user.target",
            "network.target",
            "-.slice",
        ] {
            let _ = fs::copy(Path::new("/usr/lib/systemd/system").join(unit), units.join(unit));
        }
        if name.ends_with(".conf") {
            with_drop_in(tree.path(), name);
        }
        let output = Command::new("systemd-analyze")
            .args(["verify", "--man=no", "--recursive-errors=no", "--root"])
            .arg(tree.path())
            .arg(service_of(name))
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned();
        // Debian 12's systemd does not know the setting that its successors have.
        let said: Vec<&str> = said.lines().filter(|line| !line.contains("Unknown key 'OpenFile'")).collect();
        assert!(said.is_empty(), "{name}: {said:?}");
        let takes_open_file = ["dev-mem-openfile.conf", "wake-up.conf"].contains(&name);
        assert!(output.status.success() || takes_open_file, "{name}");
    }
}

#[test]
#[ignore = "needs systemd-analyze"]
fn with_systemd_the_units_expose_no_more_than_they_promise() {
    // (drop-in, ten times the highest exposure)
    for (name, threshold) in [
        ("", 10),
        ("simulator.conf", 10),
        ("device.conf", 10),
        ("dev-mem.conf", 15),
        ("dev-mem-openfile.conf", 10),
        ("pci.conf", 10),
        ("real-time.conf", 10),
        ("wake-up.conf", 10),
        ("gateway-writes.conf", 15),
        (PAGE, 15),
    ] {
        let tree = installed();
        if name.ends_with(".conf") {
            with_drop_in(tree.path(), name);
        }
        let output = Command::new("systemd-analyze")
            .args(["security", "--offline=true", &format!("--threshold={threshold}"), "--root"])
            .arg(tree.path())
            .arg(service_of(name))
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        let verdict = said.lines().find(|line| line.contains("Overall exposure level"));
        assert!(verdict.is_some() && output.status.success(), "{name}: {verdict:?}");
    }
}

#[test]
fn what_would_break_the_service_stays_out_of_the_unit() {
    let unit = fs::read_to_string(root().join("systemd/pmacd@.service")).unwrap();
    let settings: Vec<&str> = unit.lines().filter(|line| !line.starts_with('#')).collect();
    for needed in ["RemoveIPC=no", "RuntimeDirectoryPreserve=yes", "NotifyAccess=main", "Type=notify"] {
        assert!(settings.contains(&needed), "{needed}");
    }
    for breaks in ["PrivateUsers=", "DynamicUser=", "PrivateIPC=", "SystemCallErrorNumber="] {
        assert!(!settings.iter().any(|line| line.starts_with(breaks)), "{breaks}");
    }
}

/// What a file's lines that begin with `key` say.
fn values(path: &str, key: &str) -> Vec<String> {
    let text = fs::read_to_string(root().join(path)).unwrap();
    text.lines().filter_map(|line| line.strip_prefix(key)).map(str::to_owned).collect()
}

#[test]
fn the_gateways_process_may_ask_and_its_user_may_no_more_than_look() {
    const UNIT: &str = "systemd/pmac-gateway@.service";
    let group = values(UNIT, "SupplementaryGroups=");
    // What pmacd's shipped configuration gives the role to that a command line takes.
    assert_eq!(values("systemd/sim.toml", "engineer = "), [format!("[\"{}\"]", group.concat())]);
    assert_eq!(values(UNIT, "Group="), ["pmac"], "to reach the socket");
    assert_eq!(values(UNIT, "Environment=MODE="), ["--read-only"]);
    let made = values("systemd/sysusers.d/pmacd.conf", "g ");
    assert!(made.contains(&format!("{} -", group.concat())), "{made:?}");
    // Nobody is made a member: a login as the gateway's user has no right but to look.
    assert_eq!(values("systemd/sysusers.d/pmacd.conf", "m "), [""; 0]);
    let drop_in = values("systemd/dropins/gateway-writes.conf", "");
    let settings = drop_in.iter().filter(|line| !line.starts_with(['#', '[']));
    assert_eq!(settings.collect::<Vec<_>>(), ["Environment=MODE="]);
}

#[test]
fn the_service_has_bounds_and_one_node() {
    let unit = fs::read_to_string(root().join("systemd/pmacd@.service")).unwrap();
    let value = |name: &str| unit.lines().find_map(|line| line.strip_prefix(name)).unwrap_or_default();
    let megabytes: u64 = value("MemoryMax=").strip_suffix('M').unwrap().parse().unwrap();
    // What was measured at most with every place taken: daemon, segment and simulator; and the trace's ring.
    assert!(megabytes >= 4 * (46 + 4), "{megabytes}");
    assert!((16..=64).contains(&value("TasksMax=").parse::<u32>().unwrap()));
    let drop_in = fs::read_to_string(root().join("systemd/dropins/device.conf")).unwrap();
    let allowed: Vec<&str> = drop_in.lines().filter_map(|line| line.strip_prefix("DeviceAllow=")).collect();
    assert_eq!(allowed, ["", "/dev/%i rw"], "the unit's list begins anew");
}

#[test]
fn the_udev_rules_start_the_service_and_run_nothing() {
    let path = root().join("udev/60-pmacd.rules");
    let rules = fs::read_to_string(&path).unwrap();
    let rules: Vec<&str> = rules.lines().filter(|line| !line.starts_with('#')).collect();
    let rules = rules.join("\n");
    for forbidden in ["RUN", "uaccess", "0666", "/dev/mem", "KERNEL==\"mem\""] {
        assert!(!rules.contains(forbidden), "{forbidden}");
    }
    let acting = rules.lines().find(|line| line.contains("SYSTEMD_WANTS")).unwrap();
    for part in ["SYMLINK+=\"pmac%n\"", "TAG+=\"systemd\"", "pmacd@pmac%n.service"] {
        assert!(acting.contains(part), "{part}");
    }
    let card = rules.lines().find(|line| line.starts_with("ATTR{name}==\"pmac-vme[0-9]\"")).unwrap();
    for part in ["SYMLINK+=\"$attr{name}\"", "TAG+=\"systemd\"", "pmacd@$attr{name}.service"] {
        assert!(card.contains(part), "{part}");
    }
    assert!(acting.starts_with("ATTR{name}!=\"pmac-vme*\""), "a card's devices have no number of their own");
    // Whoever opens a node writes to the board past every role: no group, and no owner by an id that other boards have too.
    let owned: Vec<&str> = rules.lines().filter(|line| line.contains("OWNER=")).collect();
    assert!(matches!(owned[..], [line] if line.starts_with("ATTR{name}==\"pmac*\"")), "{owned:?}");
    assert!(owned[0].contains("OWNER=\"pmacd\", GROUP=\"root\", MODE=\"0600\""), "{owned:?}");
    assert_eq!((rules.matches("MODE=").count(), rules.matches("GROUP=").count()), (1, 1));
    // Labels that are jumped to exist.
    for label in rules.split("GOTO=\"").skip(1).filter_map(|rest| rest.split('"').next()) {
        assert!(rules.contains(&format!("LABEL=\"{label}\"")), "{label}");
    }
}

#[test]
#[ignore = "needs udevadm of systemd 254 or later"]
fn with_udevadm_nothing_is_found_to_say_about_the_rules() {
    let path = root().join("udev/60-pmacd.rules");
    let output =
        Command::new("udevadm").args(["verify", "--resolve-names=never"]).arg(&path).output().unwrap();
    let said = [output.stdout, output.stderr].concat();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&said));
}

#[test]
fn the_shipped_simulator_configuration_is_accepted() {
    // The package makes the groups it names; here one has to do that is there.
    let shipped = std::fs::read_to_string(root().join("systemd/sim.toml")).unwrap();
    let group = nix::unistd::Group::from_gid(nix::unistd::getgid()).unwrap();
    let group = group.map_or("root".to_owned(), |group| group.name);
    let here = shipped
        .replace("pmac-stop", &group)
        .replace("pmac-operator", &group)
        .replace("pmac-engineer", &group);
    assert_ne!(here, shipped);
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("sim.toml");
    std::fs::write(&path, here).unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_pmacd"))
        .args(["--check", "--name", "sim", "--config"])
        .arg(path)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn a_pci_device_is_prepared_only_if_it_can_be_the_board() {
    let sysfs = tempfile::tempdir().unwrap();
    let device = sysfs.path().join("0000:03:00.0");
    fs::create_dir(&device).unwrap();
    for (name, text) in [("class", "0x068000\n"), ("enable", "0\n"), ("config", ""), ("resource0", "")] {
        fs::write(device.join(name), text).unwrap();
    }
    let run = |arguments: &[&str]| {
        let output = Command::new("sh")
            .arg(root().join("systemd/pci-prepare"))
            .args(arguments)
            .env("PMAC_PCI_DEVICES", sysfs.path())
            .output()
            .unwrap();
        (output.status.code().unwrap_or(-1), String::from_utf8(output.stderr).unwrap())
    };
    for (arguments, status, reason) in [
        (&[] as &[&str], 64, "usage"),
        (&["0000:03:00.0", "0", "1"], 64, "usage"),
        (&["../../../etc"], 64, "no PCI address"),
        (&["0000:03:00.0/.."], 64, "no PCI address"),
        (&["0000:03:00.0\n0000:04:00.0"], 64, "no PCI address"),
        (&["0000:03:00.0", "6"], 64, "no BAR"),
        (&["0000:03:00.0", "0 config"], 64, "no BAR"),
        (&["0000:04:00.0"], 69, "no PCI device"),
        (&["0000:03:00.0", "1"], 78, "has no BAR 1"),
    ] {
        let (code, error) = run(arguments);
        assert!(code == status && error.contains(reason), "{arguments:?}: {code} {error}");
    }
    fs::write(device.join("class"), "0x010802\n").unwrap();
    assert_eq!(run(&["0000:03:00.0"]).0, 78, "a disk is no PMAC");
    fs::write(device.join("class"), "0x068000\n").unwrap();
    std::os::unix::fs::symlink("../../bus/pci/drivers/other", device.join("driver")).unwrap();
    let (code, error) = run(&["0000:03:00.0", "0"]);
    assert!(code == 78 && error.contains("driver other"), "{error}");
    fs::remove_file(device.join("driver")).unwrap();
    assert_eq!(fs::read_to_string(device.join("enable")).unwrap(), "0\n", "nothing has been done so far");
    // The driver that only passes interrupts on owns no memory.
    std::os::unix::fs::symlink("../../bus/pci/drivers/uio_pci_generic", device.join("driver")).unwrap();
    // Whether the user exists depends on the machine; what is done before it is looked up does not.
    let (code, error) = run(&["0000:03:00.0", "0"]);
    assert_eq!(fs::read_to_string(device.join("enable")).unwrap(), "1\n");
    assert!(code == 0 || (code == 71 && error.contains("user pmacd")), "{code} {error}");
    let mode = fs::metadata(device.join("config")).unwrap().mode() & 0o777;
    assert_eq!(mode, 0o600, "nobody else's, even where the user is missing");
    // Such a driver has enabled it, and the kernel refuses (EBUSY) to be told so again.
    fs::write(device.join("enable"), "2\n").unwrap();
    run(&["0000:03:00.0", "0"]);
    assert_eq!(fs::read_to_string(device.join("enable")).unwrap(), "2\n");
}
