//! Clients that mean harm. An honest client is answered meanwhile, memory stays bounded, and the mirror does not notice.

use std::io::Write;
use std::process::Stdio;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use pmac_dpram::segment::{Counter, RegionId, Sample, SegmentName, Subscriber};

use super::site::{Client, PATIENCE, Setup, Site, get_response, listening, packet, wait_until};

/// What a process may grow by, in KiB: the places of all clients, with what each of them has not fetched.
const GROWTH_MAX: u64 = 32 * 1024;

/// The most memory that a process has had, in KiB.
fn peak(pid: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
    line.trim().trim_end_matches(" kB").parse().unwrap()
}

/// Follows every servo update until `stop`: how many there were, and how many this reader has lost.
fn follow(subscriber: &Subscriber, stop: &AtomicBool) -> (u64, u64) {
    let first = subscriber.published(RegionId::Servo).unwrap() + 1;
    let mut cursor = subscriber.cursor(RegionId::Servo, first).unwrap();
    let (mut sample, mut seen) = (Sample::new(), 0);
    while !stop.load(Ordering::Relaxed) {
        match subscriber.next(&mut cursor, &mut sample).unwrap() {
            true => seen += 1,
            false => std::thread::sleep(Duration::from_millis(1)),
        }
    }
    (seen, cursor.lost())
}

/// Sets a flag when it is dropped, in a panic, too.
struct OnDrop<'a>(&'a AtomicBool);

impl Drop for OnDrop<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// A thousand connections of each kind of harm that one of them can do.
fn attack(site: &Site) {
    let half = &get_response("P1")[..9];
    let mut too_long = packet(0x40, 0xB0, 0, 0, u16::MAX, &[]);
    too_long.extend([b'P'; 4096]);
    let shorter = packet(0x40, 0xBF, 0, 0, 1, b"P1P1P1P1");
    let unread = packet(0xC0, 0xB4, 0x1000, 0, 1400, &[]).repeat(3000);
    let kinds: [&[u8]; 7] =
        [b"", half, &too_long, &shorter, &unread, b"GET / HTTP/1.1\r\n\r\n", &[0xC0, 0xB4, 0, 0]];
    let mut held = Vec::new();
    for number in 0..1000 {
        let mut client = site.client();
        client.stream.set_write_timeout(Some(Duration::from_millis(50))).unwrap();
        // Who was sent away cannot write, and who is not read may not.
        let _ = client.stream.write_all(kinds[number % kinds.len()]);
        held.push(client);
        // They go in their own time, and never all.
        if held.len() > 300 {
            held.drain(..100);
        }
    }
}

#[test]
fn a_thousand_hostile_clients_leave_honest_ones_and_the_mirror_alone() {
    // Slow enough for a busy machine to read every update in time.
    let site = Site::set_up(Setup { simulator: &["--servo-hz", "100"], ..Setup::default() });
    let mut honest = site.client();
    honest.line("P0..1023=1234567");
    let subscriber = Subscriber::attach(&SegmentName::new(site.name()).unwrap()).unwrap();
    let updates = || subscriber.counter(Counter::Updates);
    let first = updates();
    wait_until("servo data", || updates() > first + 10);
    let (missed, memory) = (subscriber.counter(Counter::Missed), peak(site.gateway_pid()));
    let (stop, answered) = (AtomicBool::new(false), AtomicBool::new(false));
    std::thread::scope(|scope| {
        // Whatever fails, the follower ends.
        let _end = OnDrop(&stop);
        let follower = scope.spawn(|| follow(&subscriber, &stop));
        let attacker = scope.spawn(|| attack(&site));
        while !attacker.is_finished() {
            let began = Instant::now();
            assert_eq!(honest.line("P7 P8"), "1234567\r1234567\r\x06");
            assert!(began.elapsed() < PATIENCE);
            answered.store(true, Ordering::Relaxed);
        }
        stop.store(true, Ordering::Relaxed);
        let (seen, lost) = follower.join().unwrap();
        assert!(seen > 0 && lost == 0, "seen {seen}, lost {lost}");
    });
    assert!(answered.into_inner());
    assert_eq!(subscriber.counter(Counter::Missed), missed, "updates that were not read in time");
    let grown = peak(site.gateway_pid()) - memory;
    assert!(grown < GROWTH_MAX, "grown by {grown} KiB");
    // Their places are free again: those of the silent ones, too.
    wait_until("a place", || {
        let mut late = site.client();
        late.stream.write_all(&get_response("P9")).unwrap();
        late.answer() == b"1234567\r\x06"
    });
}

#[test]
fn a_gateway_killed_at_any_moment_leaves_no_queue_blocked_and_no_buffer_open() {
    let site = Site::new(&[]);
    for round in 0..12 {
        let mut gateway = site.another_gateway(&[]).stderr(Stdio::piped()).spawn().unwrap();
        let (mut writer, _log) = listening(&mut gateway);
        let address = writer.stream.peer_addr().unwrap();
        let (mut asker, mut mover) = (Client::of(address), Client::of(address));
        // Requests without end, whose answers nobody reads, from clients of every kind.
        for line in ["OPEN PROG 7 CLEAR", "X1", "Y2 Z3", "X1"] {
            writer.stream.write_all(&get_response(line)).unwrap();
        }
        for _ in 0..20 {
            asker.stream.write_all(&get_response("P0..99 I100..150")).unwrap();
            mover.stream.write_all(&get_response("#1J=500 #1J/")).unwrap();
        }
        std::thread::sleep(Duration::from_millis(7 * round));
        gateway.kill().unwrap();
        gateway.wait().unwrap();
        let began = Instant::now();
        let mut connection = site.connection();
        // A line is refused while the buffer is somebody's.
        wait_until("the queue", || connection.send("P1", PATIENCE).is_ok());
        assert!(began.elapsed() < Duration::from_secs(15), "round {round}: {:?}", began.elapsed());
        assert!(connection.info().unwrap().open_buffer.is_none(), "round {round}");
        connection.send("#1J/", PATIENCE).unwrap();
    }
    let mut client = site.client();
    assert_eq!(client.line("OPEN PROG 8 CLEAR"), "\x06");
    assert_eq!(client.line("CLOSE"), "\x06");
}

/// The speed of motor 1.
fn speed(site: &Site) -> f64 {
    site.ask("#1V").concat().parse::<f64>().unwrap().abs()
}

fn stands(site: &Site) -> bool {
    (0..10).all(|_| speed(site) < 0.5)
}

/// Whether motor 1 jogs on, for longer than `pmacd` and the motor take to stop it.
fn jogs_on(site: &Site) -> bool {
    let end = Instant::now() + Duration::from_secs(3);
    while Instant::now() < end {
        if stands(site) {
            return false;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    true
}

/// Has a client jog motor 1, and waits until it goes.
fn jog(site: &Site, client: &mut Client, line: &str) {
    assert_eq!(client.line(line), "\x06");
    until_it_moves(site);
}

fn until_it_moves(site: &Site) {
    wait_until("motion", || speed(site) > 1.0);
}

/// A board of `family`. On a busy machine its motors take long to stop, which is no reason for ^A.
fn slow_to_stop<'a>(family: &'a str, gateway: &'a [&'a str]) -> Site {
    Site::set_up(Setup { family, gateway, config: "stop_all_after_ms = 60000\n", ..Setup::default() })
}

#[test]
fn a_gateway_killed_or_a_client_gone_leaves_no_jog_running() {
    for family in ["pmac", "turbo2"] {
        let site = slow_to_stop(family, &[]);
        let mut gateway = site.another_gateway(&[]).stderr(Stdio::piped()).spawn().unwrap();
        let (mut client, _log) = listening(&mut gateway);
        // Without a word of which motor it is, too.
        client.line("#1");
        jog(&site, &mut client, "J+");
        gateway.kill().unwrap();
        gateway.wait().unwrap();
        wait_until(&format!("{family}: the gateway was killed"), || stands(&site));
        let mut client = site.client();
        jog(&site, &mut client, "#1J-");
        drop(client);
        wait_until(&format!("{family}: the client is gone"), || stands(&site));
        // What the client has not begun, or others have taken over, goes on.
        let mut client = site.client();
        jog(&site, &mut client, "J+");
        let mut other = site.client();
        jog(&site, &mut other, "#1J-");
        drop(client);
        assert!(jogs_on(&site), "{family}: another client's jog");
        drop(other);
        wait_until(&format!("{family}: the other client is gone"), || stands(&site));
        // At once: what has just been stopped may jog again.
        site.ask("#1J+");
        until_it_moves(&site);
        assert!(jogs_on(&site), "{family}: a jog beside the gateway");
    }
}

#[test]
fn a_gateway_that_hangs_leaves_no_jog_running() {
    let site = slow_to_stop("pmac", &[]);
    let mut gateway = site.another_gateway(&[]).stderr(Stdio::piped()).spawn().unwrap();
    let (mut client, _log) = listening(&mut gateway);
    jog(&site, &mut client, "#1J+");
    assert!(jogs_on(&site), "the gateway says that it is there, however silent its client is");
    let pid = nix::unistd::Pid::from_raw(gateway.id().cast_signed());
    nix::sys::signal::kill(pid, nix::sys::signal::Signal::SIGSTOP).unwrap();
    wait_until("the stop", || stands(&site));
    gateway.kill().unwrap();
    gateway.wait().unwrap();
}

#[test]
fn a_gateway_that_keeps_jogs_leaves_them_running() {
    let site = Site::new(&["--keep-jogs"]);
    let mut client = site.client();
    jog(&site, &mut client, "#1J+");
    drop(client);
    assert!(jogs_on(&site));
}

#[test]
fn a_line_that_opens_or_closes_a_buffer_jogs_nothing_and_a_program_has_its_arcs() {
    let site = Site::new(&[]);
    let mut client = site.client();
    assert_eq!(client.line("#1J+ OPEN PROG 7"), "\x07ERR001\r");
    assert_eq!(client.line("OPEN PROG 7 CLEAR"), "\x06");
    assert_eq!(client.line("CIRCLE1 X10 Y10 I5 J-5"), "\x06");
    assert_eq!(client.line("CLOSE #1J+"), "\x07ERR001\r");
    assert_eq!(client.line("CLOSE"), "\x06");
    assert!(stands(&site));
}

#[test]
fn a_client_who_is_gone_in_the_middle_of_his_request_leaves_no_jog_running() {
    let site = slow_to_stop("pmac", &[]);
    for (request, separator) in [(0xBF, "\r"), (0xC6, "\0"), (0xB0, "\r")] {
        // Each line takes its time; the whole takes minutes.
        let mut lines = vec!["#1J+"];
        lines.extend(["P0..1023"; 100]);
        let text = lines.join(separator);
        let mut client = site.client();
        let length = u16::try_from(text.len()).unwrap();
        client.stream.write_all(&packet(0x40, request, 0, 0, length, text.as_bytes())).unwrap();
        until_it_moves(&site);
        drop(client);
        wait_until(&format!("{request:02X}: the client is gone"), || stands(&site));
    }
}
