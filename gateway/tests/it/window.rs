//! Clients that command by the words of the DPRAM that carry lines and responses, as a beamline's program does.

use std::time::{Duration, Instant};

use pmac_dpram::client::Board;
use pmac_dpram::map::HostOffset;

use super::site::{Client, Setup, Site, packet, wait_until};

/// Where the words are: those of a Turbo's window, and of a PMAC's.
const TURBO: Place = Place { flag: 0x0E9C, response: 0x0F40 };
const PMAC: Place = Place { flag: 0x062C, response: 0x06D0 };
const CANCEL: u8 = 0x18;

#[derive(Clone, Copy)]
struct Place {
    flag: u16,
    response: u16,
}

/// A client at its window. It sends its requests for memory as uploads, and has each answered before the next.
struct Driver {
    client: Client,
    place: Place,
}

impl Driver {
    fn new(site: &Site, place: Place) -> Self {
        Self { client: site.client(), place }
    }

    fn set(&mut self, offset: u16, data: &[u8]) {
        let length = u16::try_from(data.len()).unwrap();
        assert_eq!(self.client.ask(&packet(0xC0, 0xB5, offset, 0, length, data)), b"@");
    }

    /// A control character, in two bytes or four.
    fn control(&mut self, bytes: &[u8]) {
        self.set(self.place.flag + 2, bytes);
    }

    /// Clears both control words, writes the line with its NUL, and sets the bit of the flag.
    fn load(&mut self, line: &str) {
        self.set(self.place.response, &[0; 4]);
        self.set(self.place.flag, &[0; 4]);
        self.set(self.place.flag + 4, &[line.as_bytes(), &[0]].concat());
        assert_eq!(self.client.ask(&packet(0xC0, 0xBA, self.place.flag, 1, 4, &[1, 0, 0, 0])), b"@");
    }

    /// Everything from the flag to the end of the response, in one.
    fn get(&mut self) -> Vec<u8> {
        let all = self.client.ask(&packet(0xC0, 0xB4, self.place.flag, 0, 424, &[]));
        assert_eq!(all.len(), 424);
        all
    }

    /// The next response: its control word and text. As long as there is none, the client clears the word, and looks again.
    fn response(&mut self) -> (u16, String) {
        let end = Instant::now() + Duration::from_secs(30);
        loop {
            let all = self.get();
            let word = |at: usize| u16::from_le_bytes([all[at], all[at + 1]]);
            self.set(self.place.response, &[0; 4]);
            if word(0xA4) != 0 {
                let length = all[0xA8..].iter().position(|byte| *byte == 0).unwrap();
                assert_eq!(usize::from(word(0xA6)), length + 1, "the count has the NUL in it");
                return (word(0xA4), String::from_utf8(all[0xA8..0xA8 + length].to_vec()).unwrap());
            }
            assert!(Instant::now() < end, "no response");
        }
    }

    /// A line and all of its responses: the lines of data, and the word at the end.
    fn line(&mut self, line: &str) -> (Vec<String>, u16) {
        self.load(line);
        self.rest()
    }

    fn rest(&mut self) -> (Vec<String>, u16) {
        let mut lines = Vec::new();
        loop {
            match self.response() {
                (0x000D, text) => lines.push(text),
                (end, text) => {
                    assert_eq!(text, "");
                    return (lines, end);
                }
            }
        }
    }
}

#[test]
fn a_beamlines_program_commands_by_its_window_as_at_a_board() {
    for (family, place) in [("turbo2", TURBO), ("pmac", PMAC)] {
        let site = Site::of(family, &[]);
        let mut driver = Driver::new(&site, place);
        // Its first words: nothing, and ^X, four bytes each.
        driver.control(&[0; 4]);
        driver.control(&[CANCEL, 0, 0, 0]);
        for line in ["I5=0", "P1=25 P2=50", "OPEN PLC 3 CLEAR", "P3=P3+1", "CLOSE", "#1J/"] {
            assert_eq!(driver.line(line), (vec![], 0x0006), "{family}: {line}");
        }
        assert_eq!(driver.line("P1 P2"), (vec!["25".to_owned(), "50".to_owned()], 0x0006));
        assert_eq!(driver.line("P1 UUU").1, 0x8003, "{family}");
        assert_eq!(driver.line("#1J^20000"), (vec![], 0x0006));
        // ^A in two bytes, while the motor moves.
        driver.control(&[1, 0]);
        let mut board = Board::attach(site.name()).unwrap();
        wait_until("the motor to stand", || stands(&mut board));
        let at: f64 = site.ask("#1P")[0].parse().unwrap();
        assert!(at < 19000.0, "{family}: {at}");
        assert!(site.log("pmac-gateway").contains(": ^A"), "{}", site.log("pmac-gateway"));
        // A report of ^P: a line of data, and the acknowledgement.
        driver.control(&[16, 0]);
        let (lines, end) = driver.rest();
        assert_eq!((lines.len(), end), (1, 0x0006), "{lines:?}");
    }
}

#[test]
fn windows_of_two_clients_know_nothing_of_each_other() {
    let site = Site::of("turbo2", &[]);
    let (mut one, mut two) = (Driver::new(&site, TURBO), Driver::new(&site, TURBO));
    assert_eq!(one.line("P1=1 #2"), (vec![], 6));
    one.load("P1");
    assert_eq!(two.get(), vec![0; 424], "another's line and response");
    assert_eq!(two.line("#3"), (vec![], 6));
    assert_eq!(one.rest(), (vec!["1".to_owned()], 6));
    assert_eq!(one.line("#"), (vec!["2".to_owned()], 6), "whom it addressed is its own");
    // The board's own words are another user's.
    let (_, words) = site.connection().read(HostOffset::new(0x0EA0), 1).unwrap();
    assert_ne!(words, [u16::from_le_bytes(*b"#\0")]);
    // Lines by the other way are the same client's, and their replies stay apart.
    assert_eq!(one.client.ask(&packet(0x40, 0xB0, 0, 0, 2, b"P1")), b"@");
    assert_eq!(one.line("P1=7"), (vec![], 6));
    assert_eq!(one.client.get_buffer(), b"1\r\x06");
    // What lies beside the window comes from the board.
    let all = one.client.ask(&packet(0xC0, 0xB4, 0x1000, 0, 0x80, &[]));
    assert_eq!(all.len(), 0x80);
}

#[test]
fn a_reply_of_many_lines_comes_line_by_line_and_a_cancel_ends_it() {
    let site = Site::of("turbo2", &[]);
    site.ask("P0..1023=7");
    let mut driver = Driver::new(&site, TURBO);
    let (lines, end) = driver.line("P0..199");
    assert_eq!((lines, end), (vec!["7".to_owned(); 200], 6));
    driver.load("P0..1023");
    assert_eq!(driver.response(), (0x0D, "7".to_owned()));
    driver.control(&[CANCEL, 0]);
    assert_eq!(driver.get()[..4], [0; 4]);
    assert_eq!(driver.line("P1=8"), (vec![], 6), "nothing of it comes any more");
}

/// How a client sends a line, or a stop.
type Sends = fn(&mut Driver);

/// By the words of its window, and by the requests for lines and control characters.
const LINES: [Sends; 2] = [
    |driver| driver.load(QUESTION),
    |driver| assert_eq!(driver.client.ask(&packet(0x40, 0xB0, 0, 0, 6, QUESTION.as_bytes())), b"@"),
];
const STOPS: [Sends; 4] = [
    |driver| driver.control(&[1, 0]),
    |driver| assert_eq!(driver.client.ask(&packet(0x40, 0xB6, 1, 0, 0, &[])), b"@"),
    |driver| assert_eq!(driver.client.line("\x01"), "\x06"),
    |driver| assert_eq!(driver.client.ask(&packet(0x40, 0xB0, 0, 0, 2, b"\x01\r")), b"@"),
];
const QUESTION: &str = "P0..49";

/// Whether the first motor stands: its position in two servo reports that are some cycles apart.
fn stands(board: &mut Board) -> bool {
    let mut servo = || board.snapshot().unwrap().servo.unwrap();
    let one = servo();
    let mut two = servo();
    while two.servo_timer < one.servo_timer + 20 {
        two = servo();
    }
    one.data.motors[0].actual_position == two.data.motors[0].actual_position
}

#[test]
fn a_line_is_acknowledged_at_once_and_a_stop_does_not_wait_for_it() {
    for (way, line) in LINES.iter().enumerate() {
        for (stopped, stop) in STOPS.iter().enumerate() {
            // A daemon without questions of its own, which a slow board would not answer in time.
            let site =
                Site::set_up(Setup { family: "turbo2", config: "ask_board = false", ..Setup::default() });
            let mut board = Board::attach(site.name()).unwrap();
            let mut driver = Driver::new(&site, TURBO);
            assert_eq!(driver.line("#1J^2000000"), (vec![], 6));
            wait_until("motion", || !stands(&mut board));
            // The reply takes ten seconds, and the line is acknowledged at once.
            site.simulate("fault ascii_slow_lines 200ms");
            line(&mut driver);
            wait_until("the board to have the line", || {
                let (_, words) = site.connection().read(HostOffset::new(u32::from(TURBO.flag)), 4).unwrap();
                words[..2] == [0; 2] && words[2..] == [*b"P0", *b".."].map(u16::from_le_bytes)
            });
            assert!(!stands(&mut board));
            stop(&mut driver);
            wait_until("the motor to stand", || stands(&mut board));
            let (_, end) = site.connection().read(HostOffset::new(u32::from(TURBO.response)), 1).unwrap();
            assert_ne!(end, [6], "the board is at the line yet");
            assert_eq!(driver.client.request(0xC0, 0xC2, 0, 2), [0, 0], "nothing is there to be fetched yet");
            site.simulate("fault ascii_slow_lines off");
            match (way, stopped) {
                (0, _) => assert_eq!(driver.rest(), (vec!["0".to_owned(); 50], 6)),
                (_, 0 | 3) => {
                    wait_until("the reply", || driver.client.request(0xC0, 0xC2, 0, 2) == [1, 0]);
                    assert_eq!(driver.client.get_buffer(), [&b"0\r".repeat(50)[..], b"\x06"].concat());
                    let of_stop: &[u8] = if stopped == 3 { &[6] } else { &[0] };
                    assert_eq!(driver.client.get_buffer(), of_stop, "behind the line's");
                }
                // What sends a control character alone, or asks, empties what there is to be fetched, and what comes of the line, too.
                _ => assert_eq!(driver.client.get_buffer(), [0]),
            }
        }
    }
}

#[test]
fn a_client_who_leaves_a_line_at_work_leaves_no_place_taken() {
    let site = Site::of("turbo2", &[]);
    for _ in 0..60 {
        site.client().ask(&packet(0x40, 0xB0, 0, 0, 8, b"I0..1023"));
    }
    wait_until("a place", || site.client().ask(&super::site::get_response("P1")) == b"0\r\x06");
}

#[test]
fn the_address_is_told_in_four_bytes_by_tcp_and_udp() {
    let site = Site::new(&[]);
    let mut client = site.client();
    let question = packet(0xC0, 0xE0, 0, 0, 4, &[]);
    assert_eq!(client.ask(&question), [127, 0, 0, 1]);
    let socket = site.udp();
    socket.send(&question).unwrap();
    let mut answer = [0; 16];
    assert_eq!(socket.recv(&mut answer).unwrap(), 4);
    assert_eq!(answer[..4], [127, 0, 0, 1]);
}

#[test]
fn a_reader_asks_by_its_window_and_what_it_may_not_is_an_error_or_the_end() {
    let site = Site::of("turbo2", &["--read-only"]);
    let mut driver = Driver::new(&site, TURBO);
    assert_eq!(driver.line("P1"), (vec!["0".to_owned()], 6));
    assert_eq!(driver.line("P1=5"), (vec![], 0x8002));
    let stop = packet(0xC0, 0xB5, TURBO.flag + 2, 0, 2, &[1, 0]);
    assert_eq!(driver.client.ask(&stop), [0; 0], "a refused ^A has no error word");
}
