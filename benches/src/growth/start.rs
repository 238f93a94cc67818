//! How long the daemon takes from its start to its first data, and a client to its first snapshot.

use std::os::unix::net::{UnixDatagram, UnixStream};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use pmac_dpram::client::Board;
use pmac_dpram::segment::{Condition, RegionId, SegmentName, Subscriber, monotonic_ns};

use super::Report;
use crate::rig::{Rig, Setup, program};
use crate::table::spread;

const STARTS: usize = 20;
const ATTACHES: usize = 200;
const LOOK: Duration = Duration::from_micros(100);
const PATIENCE: Duration = Duration::from_secs(10);

/// Measures and tells both.
pub fn measure(report: &mut Report) {
    report.say("");
    report.say("start-up, ms: least, median, greatest");
    let tell = |report: &mut Report, what: &str, ms: Vec<f64>| {
        let count = ms.len();
        let [least, median, greatest] = spread(ms);
        report.say(&format!("{what:<70} {least:>8.3} {median:>8.3} {greatest:>8.3}  ({count} times)"));
    };
    let mut rig = Rig::simulator_alone(&Setup::default());
    let starts: Vec<[f64; 4]> = (0..STARTS).map(|_| start(&mut rig)).collect();
    for (index, what) in [
        "pmacd: start of the process to its socket accepting",
        "pmacd: to READY=1 for the service manager",
        "pmacd: to the first servo sample in the segment",
        "pmacd: to a segment that says it is live",
    ]
    .into_iter()
    .enumerate()
    {
        tell(report, what, starts.iter().map(|times| times[index]).collect());
    }
    rig.start_daemon(&Setup::default());
    std::thread::sleep(Duration::from_millis(500));
    let attach = || {
        let mut board = Board::attach(&rig.name).expect("the segment");
        let snapshot = board.snapshot().expect("a snapshot");
        assert!(snapshot.servo.is_some() && snapshot.stale.is_none());
    };
    tell(report, "client library: attach and first snapshot", (0..ATTACHES).map(|_| ms(attach)).collect());
    for arguments in [&["motors"] as &[&str], &["status"], &["send", "I122"]] {
        let run = || {
            let mut command = Command::new(program("pmacctl"));
            command.args(["--name", &rig.name, "--socket"]).arg(rig.socket()).args(arguments);
            let status = command.stdin(Stdio::null()).stdout(Stdio::null()).status().expect("pmacctl");
            assert!(status.success(), "{arguments:?}");
        };
        let what = format!("pmacctl {}, the whole command", arguments.join(" "));
        tell(report, &what, (0..STARTS).map(|_| ms(run)).collect());
    }
}

fn ms(work: impl FnOnce()) -> f64 {
    let start = Instant::now();
    work();
    start.elapsed().as_secs_f64() * 1e3
}

/// Starts the daemon once, and ends it. Ms until each of what [`measure`] tells.
fn start(rig: &mut Rig) -> [f64; 4] {
    let notify = rig.socket().with_file_name("notify");
    let _ = std::fs::remove_file(&notify);
    let manager = UnixDatagram::bind(&notify).expect("a socket");
    manager.set_nonblocking(true).expect("a socket");
    let name = SegmentName::new(&rig.name).expect("a name");
    let begun = Instant::now();
    rig.spawn_daemon_of("pmacd", &Setup::default(), &[("NOTIFY_SOCKET", &notify)]);
    let mut times = [None; 4];
    let mut subscriber = None;
    while times.iter().any(Option::is_none) {
        assert!(begun.elapsed() < PATIENCE, "the daemon has come to {times:?} of 4");
        subscriber = subscriber.take().or_else(|| Subscriber::attach(&name).ok());
        let mut message = [0; 256];
        let ready = times[1].is_some()
            || manager.recv(&mut message).is_ok_and(|length| message[..length].starts_with(b"READY=1"));
        let accepts = times[0].is_some() || UnixStream::connect(rig.socket()).is_ok();
        let servo =
            subscriber.as_ref().is_some_and(|segment| segment.published(RegionId::Servo).unwrap_or(0) > 0);
        let live = subscriber
            .as_ref()
            .is_some_and(|segment| segment.header_condition(monotonic_ns()) == Condition::Live);
        for (time, reached) in times.iter_mut().zip([accepts, ready, servo, live]) {
            if reached {
                time.get_or_insert_with(|| begun.elapsed().as_secs_f64() * 1e3);
            }
        }
        std::thread::sleep(LOOK);
    }
    rig.stop_daemon();
    times.map(|time| time.unwrap_or(f64::NAN))
}
