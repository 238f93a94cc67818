//! `poll`: what gateway and daemon add to a poll of a program with a window, as `dls-pmaccontrol` asks it: one line of 131 characters,
//! 52 lines of reply.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::process::Command;
use std::time::{Duration, Instant};

use pmac_dpram::map::TURBO2;

use crate::bare_board::{BareBoard, Pauses};
use crate::clock::{Figures, Series};
use crate::machine;
use crate::rig::{Program, Rig, Setup, program};
use crate::table::{Bar, Table};

const POLLS: usize = 150;
const ANSWERS: usize = 52;
const ACK: u8 = 6;
/// How long a started daemon asks the board itself: a Turbo board for 8192 M-variables, 25 at a time, which takes the port for 12 ms
/// each time.
const ASKED: Duration = Duration::from_secs(15);

/// `rounds` times: on the bare memory, through the daemon, through gateway and daemon.
pub fn run(rounds: usize) -> bool {
    machine::introduce("poll");
    let line = line();
    assert_eq!(line.len(), 131);
    let mut table = Table::default();
    let mut is_met = 0;
    for round in 0..rounds {
        let start = Instant::now();
        let setup = Setup { family: "turbo2", ..Setup::default() };
        let mut rig = Rig::simulator_alone(&setup);
        let mut board = BareBoard::open(&rig, &TURBO2);
        let bare = polls(|| board.ask(&line).len());
        drop(board);
        rig.start_daemon(&setup);
        std::thread::sleep(ASKED);
        let mut connection = rig.connection();
        let daemon = polls(|| connection.send(&line, Duration::from_secs(5)).expect("an answer").len());
        let (_gateway, mut client) = gateway(&rig);
        let gateway = polls(|| over_tcp(&mut client, &line));
        let ms = |ours: f64, peer: f64| [ours / 1e6, peer / 1e6];
        let what = "GUI poll, by TCP, gateway and daemon / bare DPRAM, median";
        table.add("7", what, "ms", Bar::AtMost(1.3), ms(gateway.median, bare.median));
        table.add("7", "- p99", "ms", Bar::None, ms(gateway.p99, bare.p99));
        let what = "GUI poll, by socket and daemon / bare DPRAM, median";
        table.add("7d", what, "ms", Bar::None, ms(daemon.median, bare.median));
        table.add("7d", "- p99", "ms", Bar::None, ms(daemon.p99, bare.p99));
        is_met += usize::from(gateway.median <= 1.3 * bare.median);
        println!("round {round}: {:.1} s", start.elapsed().as_secs_f64());
    }
    println!("\n{}", table.text());
    2 * is_met > rounds
}

fn line() -> String {
    let motors = (1..=8).map(|motor| format!("#{motor}?PVF m{motor}90 p99"));
    format!("i65???&1??%{}", motors.collect::<String>())
}

fn polls(mut ask: impl FnMut() -> usize) -> Figures {
    let mut pauses = Pauses::default();
    let times = (0..POLLS).map(|_| {
        pauses.pause();
        let start = Instant::now();
        assert_eq!(ask(), ANSWERS);
        crate::clock::ticks(start.elapsed().as_nanos() as f64)
    });
    times.collect::<Series>().figures()
}

/// A gateway to the board of `rig`, and a client of it.
fn gateway(rig: &Rig) -> (Program, TcpStream) {
    let free = || TcpListener::bind("127.0.0.1:0")?.local_addr();
    let address: SocketAddr = free().expect("a port");
    let mut command = Command::new(program("pmac-gateway"));
    command.args(["--listen", &address.to_string(), "--socket"]).arg(rig.socket());
    let gateway = Program::start(&mut command);
    let end = Instant::now() + Duration::from_secs(5);
    loop {
        match TcpStream::connect(address) {
            Ok(client) => {
                client.set_nodelay(true).expect("an option");
                return (gateway, client);
            }
            Err(error) if Instant::now() > end => panic!("{address}: {error}"),
            Err(_) => std::thread::sleep(Duration::from_millis(5)),
        }
    }
}

/// Sends `line` as GETRESPONSE, and counts the lines of the answer.
fn over_tcp(client: &mut TcpStream, line: &str) -> usize {
    let [high, low] = u16::try_from(line.len()).expect("a short line").to_be_bytes();
    let request = [&[0x40, 0xBF, 0, 0, 0, 0, high, low], line.as_bytes()].concat();
    client.write_all(&request).expect("sent");
    let (mut answer, mut part) = (Vec::new(), [0; 2048]);
    while answer.last() != Some(&ACK) {
        let count = client.read(&mut part).expect("an answer");
        assert!(count > 0, "the gateway has ended the connection");
        answer.extend_from_slice(&part[..count]);
    }
    answer.iter().filter(|byte| **byte == b'\r').count()
}
