//! Descriptors handed over by the service manager: `pmacd` on a board whose memory it could not open itself.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::os::fd::AsRawFd;
use std::os::unix::fs::FileExt;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

use crate::support::{PATIENCE, joined, output_within, status_within, wait_until};

/// Starts `pmacd` as systemd does with `OpenFile=…:mem`: `file` as descriptor 3, announced to the very process.
fn handed_over(file: &File, board: &str, socket: &std::path::Path, name: &str) -> Child {
    handed_over_as("mem", file, board, socket, name, &[])
}

fn handed_over_as(
    what: &str,
    file: &File,
    board: &str,
    socket: &std::path::Path,
    name: &str,
    options: &[&str],
) -> Child {
    let number = file.as_raw_fd();
    // A duplicate on descriptor 3 has no close-on-exec; the shell keeps its process number when it becomes pmacd.
    let script = format!(
        "exec 3<>/proc/$PPID/fd/{number}; LISTEN_PID=$$ LISTEN_FDS=1 LISTEN_FDNAMES={what} exec \"$0\" \"$@\""
    );
    Command::new("sh")
        .arg("-c")
        .arg(script)
        .arg(env!("CARGO_BIN_EXE_pmacd"))
        .args(["--board", board, "--name", name, "--socket"])
        .arg(socket)
        .args(options)
        .args(["--with-parent", &std::process::id().to_string()])
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// In good order: a killed daemon leaves its segment for the next one, and here there is none.
fn end(mut daemon: Child) {
    let pid = nix::unistd::Pid::from_raw(daemon.id().cast_signed());
    nix::sys::signal::kill(pid, nix::sys::signal::Signal::SIGTERM).unwrap();
    assert!(status_within(&mut daemon, PATIENCE).success());
}

#[test]
fn memory_handed_over_is_mapped_and_the_descriptor_closed() {
    let directory = tempfile::tempdir().unwrap();
    let memory = directory.path().join("memory");
    File::create(&memory).unwrap().set_len(0x8000).unwrap();
    let file = File::options().read(true).write(true).open(&memory).unwrap();
    let socket = directory.path().join("socket");
    let name = format!("pmac-test-handed-{}", std::process::id());
    let mut daemon = handed_over(&file, "mem:0x4000", &socket, &name);
    wait_until("the socket", || {
        assert!(daemon.try_wait().unwrap().is_none(), "pmacd ended");
        socket.exists()
    });
    let own = format!("/proc/{}", daemon.id());
    let maps = std::fs::read_to_string(format!("{own}/maps")).unwrap();
    let mapped = maps.lines().find(|line| line.ends_with("/memory")).unwrap();
    assert!(mapped.contains("rw-s 00004000"), "{mapped}");
    let open = open_files(&daemon);
    assert!(!open.contains(&memory), "{open:?}");
    end(daemon);
}

fn open_files(daemon: &Child) -> Vec<PathBuf> {
    let open = std::fs::read_dir(format!("/proc/{}/fd", daemon.id())).unwrap().flatten();
    open.filter_map(|fd| std::fs::read_link(fd.path()).ok()).collect()
}

#[test]
fn the_request_for_processors_that_wake_fast_is_held_while_the_daemon_runs() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    std::fs::write(at("memory"), vec![0; 0x4000]).unwrap();
    std::fs::write(at("config"), "cpu_latency_us = 3\n").unwrap();
    let node = File::options().read(true).write(true).create(true).truncate(true).open(at("node")).unwrap();
    let board = format!("file:{}", at("memory").display());
    let name = format!("pmac-test-latency-{}", std::process::id());
    let config = at("config");
    let options = ["--config", config.to_str().unwrap()];
    let mut daemon = handed_over_as("cpu_latency", &node, &board, &at("socket"), &name, &options);
    wait_until("the socket", || {
        assert!(daemon.try_wait().unwrap().is_none(), "pmacd ended");
        at("socket").exists()
    });
    assert_eq!(std::fs::read(at("node")).unwrap(), 3_i32.to_ne_bytes());
    assert!(open_files(&daemon).contains(&at("node")));
    end(daemon);
}

#[test]
fn a_slot_that_reads_as_ones_is_told_once_and_so_is_the_board_that_comes() {
    let directory = tempfile::tempdir().unwrap();
    let memory = directory.path().join("memory");
    std::fs::write(&memory, vec![0xFF; 0x4000]).unwrap();
    let file = File::options().read(true).write(true).open(&memory).unwrap();
    let name = format!("pmac-test-silent-{}", std::process::id());
    let mut daemon = handed_over(&file, "mem:0", &directory.path().join("socket"), &name);
    let mut stderr = daemon.stderr.take().unwrap();
    let (say, said) = std::sync::mpsc::channel();
    let reader = std::thread::spawn(move || {
        for line in BufReader::new(&mut stderr).lines().map_while(Result::ok) {
            let _ = say.send(line);
        }
    });
    let mut log = String::new();
    let mut logged = |text: &str| {
        log.extend(said.try_iter().map(|line| line + "\n"));
        log.matches(text).count()
    };
    // An empty slot keeps nothing of what is written to it, as this file would.
    wait_until("an empty slot to be told", || {
        file.write_all_at(&[0xFF; 0x4000], 0).unwrap();
        logged("reads 0xFFFF: nothing answers on the bus") > 0
    });
    file.write_all_at(&[0; 0x4000], 0).unwrap();
    wait_until("the board to be told", || logged("the board answers on the bus again") > 0);
    end(daemon);
    joined(reader);
}

#[test]
fn memory_handed_over_that_is_too_short_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let memory = directory.path().join("memory");
    File::create(&memory).unwrap().set_len(0x4000).unwrap();
    let file = File::options().read(true).write(true).open(&memory).unwrap();
    let name = format!("pmac-test-short-{}", std::process::id());
    let mut daemon = handed_over(&file, "mem:0x4000", &directory.path().join("socket"), &name);
    let ended = output_within(&mut daemon, PATIENCE);
    let stderr = String::from_utf8_lossy(&ended.stderr);
    assert_eq!(ended.status.code(), Some(69), "{stderr}");
    assert!(stderr.contains("ends at 0x4000, before the window does at 0x8000"), "{stderr}");
}
