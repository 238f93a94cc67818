//! What others do on a board while a rotary stream goes: `OPEN BINARY ROTARY` shuts nobody out, `OPEN ROT` does.

use std::io::Write;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread::JoinHandle;

use pmac_dpram::client::RotaryPlace;
use pmac_dpram::protocol::board::RotaryStopReply;
use pmac_dpram::protocol::calls::Offset;
use serde_json::{Value, json};

use crate::support::raw::Raw;
use crate::support::{VirtualSite, joined};

/// The words of line `number`: the lines move by one and back.
pub fn words(number: u32) -> [u32; 2] {
    [0x00_0E22 + number % 2, 0x50_0000]
}

pub fn place() -> RotaryPlace {
    RotaryPlace {
        buffer: 1,
        size_longs: Some(40),
        coordinate_system: 1,
        coordinate_system_base: 1,
        define_longs: Some(100),
        run: true,
        modes: vec!["ABS(X)".to_owned()],
        ..RotaryPlace::default()
    }
}

pub fn running(family: &str) -> VirtualSite {
    let site = VirtualSite::configured(&["--family", family], &format!("family = {family:?}\n"));
    site.wait_until("a board that takes commands", || site.pmacctl(&["send", "#1J/"]).0 == 0);
    site.ask("&1 #1->X");
    site
}

/// The client of a stream. It feeds line after line from a thread of its own, and waits long for the daemon: on a busy
/// machine the world is slow.
pub struct Client {
    /// How many lines are in.
    inside: Arc<AtomicU32>,
    is_over: Arc<AtomicBool>,
    thread: JoinHandle<Option<RotaryStopReply>>,
}

impl Client {
    /// Begins a stream, and feeds it. Returns when its program runs and both of its buffers are full.
    pub fn of(site: &VirtualSite, place: RotaryPlace) -> Self {
        let run = format!("sends \"&{}R\"", place.coordinate_system);
        let runs = site.log().matches(&run).count();
        let mut raw = Raw::at(&site.socket());
        let start = json!({
            "buffer": place.buffer,
            "start": place.start.map(Offset),
            "size_longs": place.size_longs,
            "coordinate_system": place.coordinate_system,
            "coordinate_system_base": place.coordinate_system_base,
            "define_longs": place.define_longs,
            "left": place.left,
            "run": place.run,
            "modes": place.modes,
        });
        raw.call("RotaryStart", start);
        let begun = raw.receive().unwrap();
        assert!(begun["error"].is_null(), "{begun}");
        let (inside, is_over) = (Arc::new(AtomicU32::new(0)), Arc::new(AtomicBool::new(false)));
        let (count, ends) = (Arc::clone(&inside), Arc::clone(&is_over));
        let thread = std::thread::spawn(move || {
            for number in 0.. {
                let lines = json!([{ "words": words(number) }]);
                let send =
                    json!({"buffer": place.buffer, "lines": lines, "first": number, "timeout_ms": 60_000});
                raw.try_call("RotarySend", send)?;
                if !raw.receive()?["error"].is_null() || ends.load(Ordering::Relaxed) {
                    break;
                }
                count.store(number + 1, Ordering::Relaxed);
            }
            raw.try_call("RotaryStop", json!({"buffer": place.buffer}))?;
            serde_json::from_value(raw.receive()?["parameters"].clone()).ok()
        });
        site.wait_until("a program that runs", || site.log().matches(&run).count() > runs);
        let mut other = site.connection();
        site.wait_until("lines that wait", || {
            other.rotary_state(place.buffer).is_ok_and(|state| state.ahead_lines > 10)
        });
        Self { inside, is_over, thread }
    }

    /// Waits until lines go in.
    #[track_caller]
    pub fn goes_on(&self, site: &VirtualSite) {
        let before = self.inside.load(Ordering::Relaxed);
        site.wait_until("lines that go in", || self.inside.load(Ordering::Relaxed) > before);
    }

    /// Ends the stream, or hears how it has ended; `None` if the daemon is gone.
    pub fn end(self, site: &VirtualSite) -> Option<RotaryStopReply> {
        self.is_over.store(true, Ordering::Relaxed);
        site.hurried(|| joined(self.thread))
    }

    /// Ends the stream, or hears how it has ended.
    pub fn stop(self, site: &VirtualSite) -> RotaryStopReply {
        self.end(site).unwrap()
    }
}

#[test]
fn lines_gathers_and_jogs_of_others_go_on_while_a_binary_stream_goes() {
    for (family, flag) in [("pmac", 1 << 6), ("turbo2", 1 << 20)] {
        let site = running(family);
        let stream = Client::of(&site, place());
        assert!(site.log().contains("sends \"&1ABS(X)\""), "{}", site.log());
        let second = u32::from_str_radix(&site.ask("???")[0][6..12], 16).unwrap();
        assert_eq!(second & (0b111 << 17 | flag), flag, "{family}: {second:06X}");
        // A question would be a line of the program, and an assignment, where text was let in.
        for (line, reply) in [("P5=7", &[][..]), ("P5", &["7"]), ("#2J+", &[]), ("#2J/", &[])] {
            assert_eq!(site.ask(line), reply, "{family} {line}");
        }
        let gathered = site.run(&["gather", "--source", "servo_timer", "--seconds", "0.1", "-o", "-"]);
        assert!(
            gathered.code == Some(0) || gathered.stderr.contains("DEFINE GATHER"),
            "{family}: {gathered:?}"
        );
        // The board itself refuses a line that only a program can have.
        let refused = site.run(&["send", "X10"]);
        assert!(refused.code == Some(1) && refused.stderr.starts_with("ERR005"), "{family}: {refused:?}");
        let file = site.file("other.pmc", "OPEN PROG 9 CLEAR\nX1\nCLOSE\n");
        let download = site.run(&["download", &file]);
        assert_eq!(download.code, Some(1));
        assert!(download.stderr.contains("has had BINARY ROTARY open"), "{family}: {download:?}");
        // Nobody is told that a program buffer is open.
        let status: Value = site.run(&["status", "--json"]).json();
        assert!(status["socket"]["open_buffer"].is_null(), "{status}");
        stream.goes_on(&site);
        assert_eq!(stream.stop(&site).reason, None, "{family}");
        let second = u32::from_str_radix(&site.ask("???")[0][6..12], 16).unwrap();
        assert_eq!(second & flag, 0, "{family}: closed");
        site.assert_no_violations();
    }
}

#[test]
fn a_board_without_binary_entry_is_streamed_to_by_open_rot_which_shuts_others_out() {
    let site = running("pmac");
    site.control("fault no_binary_rotary on");
    let stream = Client::of(&site, place());
    let log = site.log();
    let [binary, text] =
        ["OPEN BINARY ROTARY", "OPEN ROT"].map(|line| log.find(&format!("sends {line:?}")).unwrap());
    assert!(binary < text, "{log}");
    let refused = site.run(&["send", "P5=7"]);
    assert!(refused.code == Some(1) && refused.stderr.contains("has had ROT open"), "{refused:?}");
    assert_eq!(site.ask("#1P").len(), 1, "what is on-line only goes");
    assert_eq!(stream.stop(&site).reason, None);
    assert_eq!(site.ask("I57"), ["0"]);
    site.assert_no_violations();
}

#[test]
fn a_turbo_board_whose_binary_entry_somebody_left_open_is_not_set_up() {
    let site = running("turbo2");
    site.ask("&1DEFINE ROT 100");
    UnixStream::connect(site.path("serial")).unwrap().write_all(b"OPEN BINARY ROTARY\r").unwrap();
    site.wait_until("binary entry", || {
        u32::from_str_radix(&site.ask("???")[0][6..12], 16).unwrap() >> 20 & 1 == 1
    });
    let start = || site.connection().rotary_start(RotaryPlace { define_longs: None, ..place() });
    let error = start().unwrap_err().to_string();
    assert!(
        error.contains("by another host or by a pmacd that was killed") && error.contains("CLOSE"),
        "{error}"
    );
    site.ask("CLOSE");
    start().unwrap();
}

/// The modes that a client gives are nothing else.
#[test]
fn no_other_line_goes_before_a_stream() {
    let site = running("pmac");
    for modes in [vec!["X10"], vec!["ABS &2INC"], vec!["#1J+"], vec!["ABS INC"], vec![""], vec!["ABS"; 17]] {
        let modes = modes.into_iter().map(str::to_owned).collect();
        let error = site.connection().rotary_start(RotaryPlace { modes, ..place() }).unwrap_err().to_string();
        assert!(error.contains("ABS, INC or FRAX each, 16 at most"), "{error}");
    }
    assert!(!site.log().contains("DEFINE"), "nothing was sent");
}

/// Between two looks of the stream there is time for both.
#[test]
fn a_close_and_an_open_of_somebody_else_leave_no_stream_that_feeds_on() {
    for family in ["pmac", "turbo2"] {
        let site = running(family);
        let stream = Client::of(&site, place());
        for line in ["CLOSE", "OPEN ROT"] {
            assert_eq!(site.run(&["send", line]).code, Some(0), "{family} {line}");
        }
        site.wait_until("the stream's end", || site.log().contains("ends the rotary stream"));
        let reason = stream.stop(&site).reason.unwrap_or_default();
        assert!(reason.contains("closed the rotary buffers"), "{family}: {reason}");
        assert_eq!(site.run(&["send", "CLOSE"]).code, Some(0));
        // Where the buffer was open before the daemon could end the program, the end comes behind this CLOSE.
        site.wait_until("the program's end", || site.log().contains("(rotary stream) sends \"&1Q\""));
    }
}

/// On a Turbo board a line with an address would be one for everybody.
#[test]
fn a_stream_leaves_alone_what_others_have_addressed() {
    let site = running("turbo2");
    let stream = Client::of(&site, place());
    site.ask("&2");
    site.run_for(std::time::Duration::from_secs(2));
    stream.goes_on(&site);
    assert_eq!(site.ask("&"), ["2"]);
    assert_eq!(stream.stop(&site).reason, None);
}
