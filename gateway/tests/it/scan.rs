//! A whole trajectory scan, as an EPICS driver and its program for the board make them: the program moves from point to point by PVT with
//! M-variables whose definitions it moves on in memory, while the host fills one of its two buffers with the points that come next, 17 in a
//! line, longer than the board takes lines by its DPRAM.

use std::f64::consts::TAU;
use std::fmt::Write;

use pmac_dpram::client::Board;
use pmac_dpram::format::float48;

use super::site::{Client, Site, wait_until};

/// Points in a buffer, buffers in a scan, and the time from point to point in ms.
const POINTS: u32 = 17;
const BUFFERS: u32 = 4;
const STEP_MS: f64 = 75.0;
/// The way there and back again of the two motors, in counts.
const WAYS: [f64; 2] = [1500.0, -900.0];
/// Where the buffers begin, in the memory of a Turbo. Each has rows of 17 words: times, then positions and velocities of X and Y.
const BUFFER: u32 = 0xB850;
const ROWS: u32 = 5;
/// How far a position may be from the profile, in counts.
const NEAR: f64 = 1.0;

/// The program moves the definitions of M4000 (time), M4007 and M4008 (positions), M4016 and M4017 (velocities) from word
/// to word: it writes them in memory, where M0's is at $4000. M4042 and M4043 say that a buffer is full, M4044 counts the
/// points, M4045 says which buffer is at work.
const PROGRAM: &str = "
M4000->Y:$B850,0,24 M4007->L:$B850 M4008->L:$B850 M4016->L:$B850 M4017->L:$B850
M4020->Y:$4FA0,0,24 M4027->Y:$4FA7,0,24 M4028->Y:$4FA8,0,24 M4036->Y:$4FB0,0,24 M4037->Y:$4FB1,0,24
M4040->Y:$B800,0,24 M4042->Y:$B802,0,24 M4043->Y:$B803,0,24 M4044->Y:$B804,0,24 M4045->Y:$B805,0,24
&1#1->X
&1#2->Y
DEL GAT
CLOSE
OPEN PROGRAM 9
CLEAR
ABS
FRAX(A,B,C,U,V,W,X,Y,Z)
M4040=1 M4044=0 M4045=0 P2=0
WHILE(M4044<P4)
GOSUB101
PVT(M4000*0.001)
GOSUB(P6)
M4044=M4044+1
P2=P2+1
IF(P2=17)
GOSUB108
END IF
END WHILE
DWELL0
IF(M4040=1)
M4040=2
END IF
DWELL200
RETURN
N101
P3=$B850+85*M4045+P2
M4020=P3
M4027=M4020+17
M4028=M4027+17
M4036=M4028+17
M4037=M4036+17
RETURN
N108
IF(M4045=0)
M4045=1
M4042=0
ELSE
M4045=0
M4043=0
END IF
P2=0
RETURN
N111
A(Q71):(Q1)B(Q72):(Q1)C(Q73):(Q1)X(M4007):(M4016)Y(M4008):(M4017)
RETURN
CLOSE
P6=111";

/// The profile of a motor with the way `way`: the position at `ms`, and the velocity in counts a second.
fn profile(way: f64, ms: f64) -> (f64, f64) {
    let turn = TAU / (STEP_MS * f64::from(POINTS * BUFFERS));
    (way / 2.0 * (1.0 - (turn * ms).cos()), way / 2.0 * turn * (turn * ms).sin() * 1000.0)
}

/// Writes a row of words from `address` on, in one line.
fn write(client: &mut Client, address: u32, words: impl Iterator<Item = String>) {
    let mut line = format!("WL:${address:X}");
    for word in words {
        write!(line, ",${word}").unwrap();
    }
    assert!(line.len() <= 255, "{line}");
    assert_eq!(client.line(&line), "\x06", "{line}");
}

/// Fills the buffer that `number` comes into, counted from 0.
fn fill(client: &mut Client, number: u32) {
    let (buffer, ms) = (number % 2, |point| f64::from(number * POINTS + point) * STEP_MS);
    let row = |row| BUFFER + (buffer * ROWS + row) * POINTS;
    let float = |value| {
        let [y, x] = float48::encode(value).map(|half| half & 0xFF_FFFF);
        format!("{x:06X}{y:06X}")
    };
    // No user subroutine, and the time in microseconds.
    write(client, row(0), (1..=POINTS).map(|_| format!("{:07X}", (STEP_MS * 1000.0) as u32)));
    for (motor, way) in (0..).zip(WAYS) {
        write(client, row(1 + motor), (1..=POINTS).map(|point| float(profile(way, ms(point)).0)));
        write(client, row(3 + motor), (1..=POINTS).map(|point| float(profile(way, ms(point)).1)));
    }
    assert_eq!(client.line(&format!("M{}=17", 4042 + buffer)), "\x06");
}

/// Starts a scan, and fills buffers up to number `last`. Where the motor is meanwhile.
fn scan(site: &Site, client: &mut Client, last: u32) -> Positions {
    let mut positions = Positions::new(site);
    assert_eq!(client.line(&format!("P4={}", POINTS * BUFFERS)), "\x06");
    fill(client, 0);
    fill(client, 1);
    for line in ["&1e", "M4040=1", "&1B9R"] {
        assert_eq!(client.line(line), "\x06", "{line}");
    }
    for number in 2..=last {
        let flag = format!("M{}", 4042 + number % 2);
        wait_until("a buffer", || {
            positions.look();
            client.line(&flag) == "0\r\x06"
        });
        fill(client, number);
    }
    positions
}

/// The motors' positions, each with the servo cycle it is of.
struct Positions {
    board: Board,
    next: u64,
    seen: [Vec<(f64, f64)>; 2],
}

impl Positions {
    fn new(site: &Site) -> Self {
        let board = Board::attach(site.name()).unwrap();
        let next = board.servo_sequence().unwrap() + 1;
        Self { board, next, seen: Default::default() }
    }

    /// Adds those since the last look.
    fn look(&mut self) {
        let history = self.board.history(self.next, usize::MAX).unwrap();
        self.next = history.next;
        for view in history.samples {
            for (seen, motor) in self.seen.iter_mut().zip(&view.data.motors) {
                seen.push((view.servo_timer as f64, motor.actual_position.unwrap().value.unwrap()));
            }
        }
    }
}

/// The position at `cycle`, between the two samples beside it.
fn at(positions: &[(f64, f64)], cycle: f64) -> f64 {
    let after = positions.partition_point(|(time, _)| *time < cycle).clamp(1, positions.len() - 1);
    let ((t0, p0), (t1, p1)) = (positions[after - 1], positions[after]);
    p0 + (p1 - p0) * (cycle - t0) / (t1 - t0)
}

/// How far `positions` of the motor with the way `way` are from the profile at its points, at most, if it began at the
/// cycle that suits it best.
fn distance(positions: &[(f64, f64)], way: f64, cycle_ms: f64) -> f64 {
    let first = positions.iter().find(|(_, position)| position.abs() > 1.0).expect("no motion").0;
    let of = |start: f64| {
        let points = (0..=POINTS * BUFFERS).map(|point| f64::from(point) * STEP_MS);
        points.map(|ms| (at(positions, start + ms / cycle_ms) - profile(way, ms).0).abs()).fold(0.0, f64::max)
    };
    (0..1000).map(|back| of(first - f64::from(back))).fold(f64::INFINITY, f64::min)
}

#[test]
fn a_scan_follows_its_points_and_another_follows_it_and_an_abort() {
    let site = Site::of("turbo2", &[]);
    let mut client = site.client();
    for line in PROGRAM.trim().lines() {
        assert_eq!(client.line(line), "\x06", "{line}");
    }
    wait_until("the servo cycle to be known", || site.connection().info().unwrap().servo_period_ns.is_some());
    let cycle_ms = site.connection().info().unwrap().servo_period_ns.unwrap() as f64 / 1e6;
    let stands = |client: &mut Client| client.line("#1V#2V") == "0\r0\r\x06";
    let is_back =
        |client: &mut Client| (0..5).all(|_| client.line("#1P#2P") == "0\r0\r\x06" && stands(client));
    for is_aborted in [false, true, false, false] {
        // The program dwells at its end.
        wait_until("the program's end", || client.line("#1J=0#2J=0") == "\x06");
        wait_until("the motor at its place", || is_back(&mut client));
        if is_aborted {
            let mut positions = scan(&site, &mut client, 2);
            assert_eq!(client.request(0x40, 0xB6, 1, 0), b"@", "^A");
            // The program has ended, and comes to no further point.
            let ended = client.line("M4044");
            wait_until("the motor to stand", || stands(&mut client));
            assert_eq!(client.line("M4044"), ended);
            positions.look();
            assert!(positions.seen[0].last().unwrap().1 > WAYS[0] / 10.0);
            continue;
        }
        let mut positions = scan(&site, &mut client, BUFFERS - 1);
        let all = format!("{}\r\x06", POINTS * BUFFERS);
        wait_until("the end of the scan", || {
            positions.look();
            client.line("M4044") == all && is_back(&mut client)
        });
        positions.look();
        assert_eq!(client.line("M4040"), "2\r\x06");
        for (seen, way) in positions.seen.iter().zip(WAYS) {
            let distance = distance(seen, way, cycle_ms);
            assert!(distance <= NEAR, "{distance} counts from the profile");
        }
    }
}
