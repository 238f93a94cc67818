//! A whole trajectory scan: a program of the board moves from point to point by PVT, while the host fills one of its two buffers with the
//! points that come next, 17 in a line, longer than the board takes lines by its DPRAM.

use std::f64::consts::TAU;
use std::fmt::Write;

use pmac_dpram::client::Board;
use pmac_dpram::format::float48;

use super::site::{Client, Site, wait_until};

/// Points in a buffer, buffers in a scan, and the time from point to point in ms.
const POINTS: u32 = 17;
const BUFFERS: u32 = 4;
const STEP_MS: f64 = 75.0;
/// The way there and back again, in counts.
const WAY: f64 = 1500.0;
/// Where variable P0 lies in the memory of a Turbo.
const P: u32 = 0x6000;
/// How far a position may be from the profile, in counts.
const NEAR: f64 = 1.0;

/// P3 counts the points, P4 has their number, P5 says which buffer is at work, and P10 and P11 that a buffer is full.
const PROGRAM: [&str; 14] = [
    "&1#1->X",
    "OPEN PROG 9 CLEAR",
    "ABS PVT75",
    "P2=0 P3=0 P5=0",
    "WHILE(P3<P4)",
    "X(P(1000+100*P5+P2)):(P(1020+100*P5+P2))",
    "P2=P2+1 P3=P3+1",
    "IF(P2=17)",
    "P(10+P5)=0",
    "P5=1-P5",
    "P2=0",
    "ENDIF",
    "ENDWHILE",
    "CLOSE",
];

/// The profile: the position at `ms`, and the velocity in counts a second.
fn profile(ms: f64) -> (f64, f64) {
    let turn = TAU / (STEP_MS * f64::from(POINTS * BUFFERS));
    (WAY / 2.0 * (1.0 - (turn * ms).cos()), WAY / 2.0 * turn * (turn * ms).sin() * 1000.0)
}

/// Writes `values` as variables from P`first` on, in one line.
fn write(client: &mut Client, first: u32, values: impl Iterator<Item = f64>) {
    let mut line = format!("WL:${:X}", P + first);
    for value in values {
        let [y, x] = float48::encode(value).map(|half| half & 0xFF_FFFF);
        write!(line, ",${x:06X}{y:06X}").unwrap();
    }
    assert!((201..=255).contains(&line.len()), "{line}");
    assert_eq!(client.line(&line), "\x06", "{line}");
}

/// Fills the buffer that `number` comes into, counted from 0.
fn fill(client: &mut Client, number: u32) {
    let buffer = number % 2;
    let points = || (1..=POINTS).map(|point| profile(f64::from(number * POINTS + point) * STEP_MS));
    write(client, 1000 + 100 * buffer, points().map(|(position, _)| position));
    write(client, 1020 + 100 * buffer, points().map(|(_, velocity)| velocity));
    assert_eq!(client.line(&format!("P{}=1", 10 + buffer)), "\x06");
}

/// Starts a scan, and fills buffers up to number `last`. Where the motor is meanwhile.
fn scan(site: &Site, client: &mut Client, last: u32) -> Positions {
    let mut positions = Positions::new(site);
    assert_eq!(client.line(&format!("P4={}", POINTS * BUFFERS)), "\x06");
    fill(client, 0);
    fill(client, 1);
    assert_eq!(client.line("&1B9R"), "\x06");
    for number in 2..=last {
        let flag = format!("P{}", 10 + number % 2);
        wait_until("a buffer", || {
            positions.look();
            client.line(&flag) == "0\r\x06"
        });
        fill(client, number);
    }
    positions
}

/// The first motor's positions, each with the servo cycle it is of.
struct Positions {
    board: Board,
    next: u64,
    seen: Vec<(f64, f64)>,
}

impl Positions {
    fn new(site: &Site) -> Self {
        let board = Board::attach(site.name()).unwrap();
        let next = board.servo_sequence().unwrap() + 1;
        Self { board, next, seen: Vec::new() }
    }

    /// Adds those since the last look.
    fn look(&mut self) {
        let history = self.board.history(self.next, usize::MAX).unwrap();
        self.next = history.next;
        for view in history.samples {
            let position = view.data.motors[0].actual_position.unwrap().value.unwrap();
            self.seen.push((view.servo_timer as f64, position));
        }
    }
}

/// The position at `cycle`, between the two samples beside it.
fn at(positions: &[(f64, f64)], cycle: f64) -> f64 {
    let after = positions.partition_point(|(time, _)| *time < cycle).clamp(1, positions.len() - 1);
    let ((t0, p0), (t1, p1)) = (positions[after - 1], positions[after]);
    p0 + (p1 - p0) * (cycle - t0) / (t1 - t0)
}

/// How far `positions` are from the profile at its points, at most, if it began at the cycle that suits it best.
fn distance(positions: &[(f64, f64)], cycle_ms: f64) -> f64 {
    let first = positions.iter().find(|(_, position)| position.abs() > 1.0).expect("no motion").0;
    let of = |start: f64| {
        let points = (0..=POINTS * BUFFERS).map(|point| f64::from(point) * STEP_MS);
        points.map(|ms| (at(positions, start + ms / cycle_ms) - profile(ms).0).abs()).fold(0.0, f64::max)
    };
    (0..1000).map(|back| of(first - f64::from(back))).fold(f64::INFINITY, f64::min)
}

#[test]
fn a_scan_follows_its_points_and_another_follows_it_and_an_abort() {
    let site = Site::of("turbo2", &[]);
    let mut client = site.client();
    for line in PROGRAM {
        assert_eq!(client.line(line), "\x06", "{line}");
    }
    wait_until("the servo cycle to be known", || site.connection().info().unwrap().servo_period_ns.is_some());
    let cycle_ms = site.connection().info().unwrap().servo_period_ns.unwrap() as f64 / 1e6;
    let stands = |client: &mut Client| client.line("#1V") == "0\r\x06";
    let is_back = |client: &mut Client| (0..5).all(|_| client.line("#1P") == "0\r\x06" && stands(client));
    for is_aborted in [false, true, false, false] {
        assert_eq!(client.line("#1J=0"), "\x06");
        wait_until("the motor at its place", || is_back(&mut client));
        if is_aborted {
            let mut positions = scan(&site, &mut client, 2);
            assert_eq!(client.request(0x40, 0xB6, 1, 0), b"@", "^A");
            // The program has ended, and comes to no further point.
            let ended = client.line("P3");
            wait_until("the motor to stand", || stands(&mut client));
            assert_eq!(client.line("P3"), ended);
            positions.look();
            assert!(positions.seen.last().unwrap().1 > WAY / 10.0);
            continue;
        }
        let mut positions = scan(&site, &mut client, BUFFERS - 1);
        let all = format!("{}\r\x06", POINTS * BUFFERS);
        wait_until("the end of the scan", || {
            positions.look();
            client.line("P3") == all && is_back(&mut client)
        });
        positions.look();
        let distance = distance(&positions.seen, cycle_ms);
        assert!(distance <= NEAR, "{distance} counts from the profile");
    }
}
