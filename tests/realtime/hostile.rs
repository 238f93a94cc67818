//! Clients that mean harm, against a real daemon and a real (simulated) board: whatever they do, others are served and the servo data
//! go on; afterwards the daemon is as before.
//!
//! Short among the other tests. For long, in a release build:
//! `PMAC_HOSTILE_MS=10000 PMAC_HOSTILE_FLOODERS=200 PMAC_HOSTILE_CYCLES=20000 cargo test --release --test it hostile -- --nocapture
//! --test-threads=1`. It prints what the servo data and an honest client noticed, with and without each attack.
//! `PMAC_HOSTILE_BOARD=n` draws another board: how it reads the manual, how slow it is, what it powers up with.

use std::io::{ErrorKind, IoSlice, Read, Write};
use std::net::Shutdown;
use std::os::fd::AsRawFd;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use nix::sys::resource::{Resource, getrlimit, setrlimit};
use nix::sys::socket::{ControlMessage, MsgFlags, sendmsg};
use pmac_dpram::client::Connection;
use pmac_dpram::map::{Family, PMAC, TURBO2};
use pmac_dpram::protocol::BOARD;
use serde_json::json;

use crate::hostile_witness::{print_head, processor_time, site, watch};
use crate::support::bench::Bench;
use crate::support::raw::Raw;
use crate::support::{PATIENCE, Site, Weight, wait_until};

fn setting(name: &str, short: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(short)
}

/// How long an attack that has no end of its own goes on.
fn time() -> Duration {
    Duration::from_millis(setting("PMAC_HOSTILE_MS", 300))
}

/// Connections of the largest attacks.
fn crowd() -> usize {
    setting("PMAC_HOSTILE_CLIENTS", 1000) as usize
}

/// Connections that one attacker floods.
pub fn flooders() -> usize {
    setting("PMAC_HOSTILE_FLOODERS", 40) as usize
}

/// A call of the board's interface, with its NUL.
pub fn call(method: &str, parameters: serde_json::Value) -> Vec<u8> {
    let call = json!({"method": format!("{BOARD}.{method}"), "parameters": parameters});
    format!("{call}\0").into_bytes()
}

/// A connection on which nothing waits.
pub fn connect(socket: &Path) -> UnixStream {
    let stream = pmac_dpram::protocol::transport::connect(socket, Instant::now() + PATIENCE).unwrap();
    stream.set_nonblocking(true).unwrap();
    stream
}

fn many(site: &Site, count: usize) -> Vec<UnixStream> {
    (0..count).map(|_| connect(&site.socket())).collect()
}

/// Whether the other end is there still. What has arrived is thrown away.
pub fn is_open(stream: &mut UnixStream) -> bool {
    let mut sink = [0; 4096];
    loop {
        match stream.read(&mut sink) {
            Ok(0) => return false,
            Ok(_) => {}
            Err(error) => return error.kind() == ErrorKind::WouldBlock,
        }
    }
}

/// How many of them are not closed.
fn open(streams: &mut [UnixStream]) -> usize {
    streams.iter_mut().map(|stream| usize::from(is_open(stream))).sum()
}

/// Writes `message` again and again into every stream, as much as goes, and reads what comes if `hears`.
pub fn flood(streams: &mut [UnixStream], message: &[u8], hears: bool, time: Duration) {
    let block = message.repeat(65_536 / message.len() + 1);
    let mut at = vec![0; streams.len()];
    let end = Instant::now() + time;
    while Instant::now() < end {
        let mut all_full = true;
        for (stream, at) in streams.iter_mut().zip(&mut at) {
            if let Ok(count) = stream.write(&block[*at..]) {
                *at = (*at + count) % block.len();
                all_full = false;
            }
            if hears {
                is_open(stream);
            }
        }
        if all_full {
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

/// The test's own connections must not be what runs out first.
fn allow_many_descriptors() {
    let (soft, hard) = getrlimit(Resource::RLIMIT_NOFILE).unwrap();
    if soft < hard {
        setrlimit(Resource::RLIMIT_NOFILE, hard, hard).unwrap();
    }
    let wanted = 2 * crowd() as u64;
    assert!(hard > wanted, "{hard} descriptors are not enough for {wanted} connections");
}

#[test]
fn attackers_are_not_noticed_by_others() {
    attackers_are_not_noticed_on(&PMAC);
}

#[test]
fn attackers_are_not_noticed_by_others_on_a_turbo_board() {
    attackers_are_not_noticed_on(&TURBO2);
}

fn attackers_are_not_noticed_on(family: &'static Family) {
    allow_many_descriptors();
    let mut site = site(family);
    let pid = site.daemon_pid();
    let socket = site.socket();
    print_head();
    watch(&site, "nobody attacks", || std::thread::sleep(time()));

    watch(&site, &format!("{} connections, idle", crowd()), || {
        let mut held = many(&site, crowd());
        wait_until("the refused are gone", || (200..256).contains(&open(&mut held)));
        let used = processor_time(pid, "socket");
        std::thread::sleep(time());
        let used = processor_time(pid, "socket") - used;
        assert!(used < time() / 2, "the socket's thread is busy with nothing: {used:?}");
        // Room as soon as there is any.
        drop(held);
        wait_until("a place", || Connection::open(&socket).unwrap().info().is_ok());
    });

    watch(&site, "half-open", || {
        let description = json!({"method": "org.varlink.service.GetInterfaceDescription", "parameters": {"interface": BOARD}});
        let long_replies = format!("{description}\0").repeat(50).into_bytes();
        let whole = call("GetInfo", json!({}));
        let mut held = Vec::new();
        for number in 0..200 {
            let mut stream = connect(&socket);
            match number % 4 {
                0 => drop(stream.write(&whole[..20])),
                1 => {
                    let _ = stream.write(&whole[..20]);
                    let _ = stream.shutdown(Shutdown::Write);
                }
                2 => {
                    // Goes in the middle of the replies.
                    let _ = stream.write(&long_replies);
                    let _ = stream.read(&mut [0; 100]);
                    continue;
                }
                _ => {
                    let _ = stream.write(&call("Send", json!({"line": "1"})).repeat(3));
                    let _ = stream.shutdown(if number % 8 == 3 { Shutdown::Both } else { Shutdown::Read });
                }
            }
            held.push(stream);
        }
        std::thread::sleep(time());
    });

    watch(&site, "slow writers", || {
        let mut slow = many(&site, 100);
        let message = call("GetInfo", json!({}));
        let end = Instant::now() + time();
        let mut at = 0;
        while Instant::now() < end {
            for stream in &mut slow {
                let _ = stream.write(&message[at..=at]);
            }
            at = (at + 1) % message.len();
            std::thread::sleep(Duration::from_millis(50));
        }
    });

    for (what, message, hears) in [
        ("asking and never reading", call("GetSettings", json!({})), false),
        ("flood of questions", call("GetInfo", json!({})), true),
        ("flood of command lines", call("Send", json!({"line": "P78"})), true),
        ("flood of words", call("Read", json!({"host_offset": 0, "words": 64})), true),
        ("flood of control characters", call("SendControl", json!({"character": "^T"})), true),
        ("flood of nonsense", call("Nothing\n[INFO ] uid 0 pid 1 sends \"#1K\"", json!({})), true),
        ("flood of tables", call("WatchVariables", json!({"registers": vec!["Y:$0"; 9000]})), true),
    ] {
        watch(&site, what, || flood(&mut many(&site, flooders()), &message, hears, time()));
    }

    watch(&site, "huge and malformed messages", || huge_messages(&socket));
    watch(&site, "descriptors sent along", || descriptors_sent_along(&site));
    watch(&site, "coming and going", || {
        for number in 0..setting("PMAC_HOSTILE_CYCLES", 5000) {
            let mut stream = connect(&socket);
            if number % 2 == 0 {
                let _ = stream.write(&call("GetInfo", json!({})));
            }
        }
    });
    watch(&site, "watches that come and go", || {
        let end = Instant::now() + time();
        for number in 0.. {
            let call = json!({"method": format!("{BOARD}.WatchVariables"), "more": true,
                "parameters": {"registers": [format!("Y:${:X}", number % 1000)]}});
            let _ = connect(&socket).write(format!("{call}\0").as_bytes());
            if Instant::now() > end {
                break;
            }
        }
    });
    watch(&site, "nobody attacks any more", || std::thread::sleep(time()));

    site.assert_no_violations();
    assert_eq!(site.stop_daemon(), 0);
    let log = site.log();
    let refusals = log.lines().filter(|line| line.contains("refused") || line.contains("dropped")).count();
    assert!((1..400).contains(&refusals), "{refusals} lines of refusals");
    assert!(log.contains(" more of uid "), "what was not logged is counted");
    assert!(!log.contains("\n[INFO ] uid 0 pid 1 "), "nobody writes into the log by himself");
    assert!(!log.contains("panicked"), "{log}");
}

fn huge_messages(socket: &Path) {
    // Longer than any message may be, for as long as the daemon listens.
    let mut endless = pmac_dpram::protocol::transport::connect(socket, Instant::now() + PATIENCE).unwrap();
    endless.set_write_timeout(Some(PATIENCE)).unwrap();
    let mut written = 0;
    let megabyte = vec![b'x'; 1 << 20];
    while let Ok(count) = endless.write(&megabyte) {
        written += count;
        assert!(written < 100 << 20, "the daemon takes in whatever comes");
    }
    let deep = |open: &str, close: &str, depth: usize| {
        let method = format!("{{\"method\":\"{BOARD}.GetInfo\",\"parameters\":{{\"a\":");
        format!("{method}{}{}}}}}\0", open.repeat(depth), close.repeat(depth)).into_bytes()
    };
    let number = |digits: String| {
        format!("{{\"method\":\"{BOARD}.Read\",\"parameters\":{{\"host_offset\":{digits},\"words\":1}}}}\0")
            .into_bytes()
    };
    let messages = [
        deep("[", "]", 30_000),
        deep("{\"a\":", "}", 9_000),
        deep("[", "", 60_000),
        deep("[[],", "]", 12_000),
        number("9".repeat(60_000)),
        number(format!("1e{}", "9".repeat(1000))),
        number(format!("-0.{}1", "0".repeat(50_000))),
        vec![0; 1 << 20],
        b"\xff\xfe\xc0\xaf\xed\xa0\x80\0".repeat(1000),
        format!("{{\"method\":\"{}\"}}\0", "\\u0000".repeat(10_000)).into_bytes(),
        format!("{{\"method\":\"{}\"}}\0", "\\n".repeat(30_000)).into_bytes(),
        format!("{{\"method\":\"{}.x\"}}\0", "\u{10ffff}".repeat(16_000)).into_bytes(),
        vec![b'"'; 65_000],
    ];
    for message in &messages {
        let mut stream = pmac_dpram::protocol::transport::connect(socket, Instant::now() + PATIENCE).unwrap();
        stream.set_write_timeout(Some(PATIENCE)).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        // The daemon may close before all of it is out.
        let _ = stream.write_all(message);
        let _ = stream.shutdown(Shutdown::Write);
        let mut reply = Vec::new();
        match stream.read_to_end(&mut reply) {
            Ok(_) => {}
            Err(error) => assert_eq!(error.kind(), ErrorKind::ConnectionReset, "{error}"),
        }
        assert!(reply.is_empty() || reply.last() == Some(&0), "a reply is whole");
    }
}

/// Descriptors in a message are not the daemon's to keep: who gets them could be made to run out of them.
fn descriptors_sent_along(site: &Site) {
    let before = Weight::of(site.daemon_pid()).descriptors;
    let message = call("GetInfo", json!({}));
    for _ in 0..50 {
        let mut stream =
            pmac_dpram::protocol::transport::connect(&site.socket(), Instant::now() + PATIENCE).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let (mut reader, writer) = std::io::pipe().unwrap();
        let sent = [writer.as_raw_fd(); 200];
        let control = [ControlMessage::ScmRights(&sent)];
        sendmsg::<()>(stream.as_raw_fd(), &[IoSlice::new(&message)], &control, MsgFlags::empty(), None)
            .unwrap();
        drop(writer);
        assert!(stream.read(&mut [0; 100]).unwrap() > 0);
        // Nobody holds the other end any more, so this is the end and no wait.
        assert_eq!(reader.read(&mut [0; 1]).unwrap(), 0);
        assert!(Weight::of(site.daemon_pid()).descriptors < before + 20);
    }
}

/// A daemon that may open little keeps its clients to fewer places, and never runs out itself.
#[test]
fn few_descriptors_are_few_places() {
    let mut site = Site::new();
    site.start_simulator(&["--dpram-startup", "--servo-hz", "1000"]);
    let daemon = site.daemon_command(&[]);
    let log = site.path("log");
    let child = Command::new("sh")
        .args(["-c", "ulimit -n 64; exec \"$0\" \"$@\""])
        .arg(daemon.get_program())
        .args(daemon.get_args())
        .stdin(Stdio::null())
        .stderr(std::fs::File::create(&log).unwrap())
        .spawn()
        .unwrap();
    let mut site = site.adopt(child);
    wait_until("the daemon's socket", || UnixStream::connect(site.socket()).is_ok());
    site.wait_for_live_servo();
    site.control("time on");
    watch(&site, "64 descriptors", || {
        let mut held = many(&site, 100);
        wait_until("the refused are gone", || (10..48).contains(&open(&mut held)));
        std::thread::sleep(time());
        // What the daemon opens for itself is still to be had: an interrupt that comes back, for one.
        assert!(Weight::of(site.daemon_pid()).descriptors < 64 - 8);
    });
    let text = std::fs::read_to_string(&log).unwrap();
    assert!(text.contains("LimitNOFILE"), "{text}");
    assert!(!text.contains("accepting a connection"), "{text}");
    assert_eq!(site.stop_daemon(), 0);
}

/// When the system gives no descriptor at all, that is said once and does not keep a processor busy; it passes.
#[test]
fn no_descriptor_at_all_is_waited_out() {
    let mut site = site(&PMAC);
    let pid = site.daemon_pid();
    let limit = |soft: usize| {
        let program =
            Command::new("prlimit").args([format!("--pid={pid}"), format!("--nofile={soft}:")]).status();
        program.is_ok_and(|status| status.success())
    };
    let mut honest = site.connection();
    honest.info().unwrap();
    assert!(limit(Weight::of(pid).descriptors), "prlimit(1)");
    let mut waiting = many(&site, 20);
    let used = processor_time(pid, "socket");
    std::thread::sleep(Duration::from_secs(1));
    let used = processor_time(pid, "socket") - used;
    assert!(used < Duration::from_millis(500), "the socket's thread is busy with nothing: {used:?}");
    assert_eq!(honest.send("P77=7", PATIENCE).unwrap().len(), 0);
    assert_eq!(site.log().matches("accepting a connection").count(), 1, "{}", site.log());
    // One who goes makes room for one who waits.
    for stream in &mut waiting {
        let _ = stream.write(&call("GetInfo", json!({})));
    }
    drop(honest);
    let mut answered = 0;
    wait_until("the first who waits", || {
        answered += waiting.iter_mut().filter_map(|stream| stream.read(&mut [0; 4096]).ok()).count();
        answered > 0
    });
    assert!(limit(1024));
    wait_until("all who wait", || {
        answered += waiting.iter_mut().filter_map(|stream| stream.read(&mut [0; 4096]).ok()).count();
        answered >= 20
    });
    assert_eq!(site.stop_daemon(), 0);
}

/// A place is for who uses it.
#[test]
fn the_silent_give_way_when_places_are_needed() {
    let bench = Bench::with(|options| options.max_clients = 8);
    let mut spoken = Raw::new(&bench);
    spoken.call("GetInfo", json!({}));
    assert!(spoken.receive().is_some());
    let mut silent: Vec<_> = (0..6).map(|_| Raw::new(&bench)).collect();
    // The last eighth is for others.
    let mut newcomer = Raw::new(&bench);
    newcomer.call("GetInfo", json!({}));
    assert_eq!(newcomer.receive().unwrap()["parameters"]["name"], "pmac0");
    assert_eq!(silent.remove(0).receive(), None, "the oldest goes");
    spoken.call("GetInfo", json!({}));
    assert!(spoken.receive().is_some());
    for mut client in silent {
        client.call("GetInfo", json!({}));
        assert!(client.receive().is_some(), "no more go than needed");
    }
}
