//! Gathering from a simulated board in its own process, as planned, read, decoded and written by the library.

use std::fs::OpenOptions;
use std::io::{BufRead, BufReader, Cursor, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{Child, Command};
use std::time::{Duration, Instant};

use pmac_dpram::decode::{MotorScales, Scales};
use pmac_dpram::device::{Bus, FileBoard};
use pmac_dpram::function::gather::{GatherBuffer, GatherLook, GatherReader, GatherStart, report_cycles};
use pmac_dpram::function::servo_timer::ServoTimer;
use pmac_dpram::gather::{
    CsvWriter, GatherMode, GatherPlan, GatherRequest, NpyWriter, SampleClock, ServoReport, Source, column,
    plan,
};
use pmac_dpram::map::classic::{
    ASCII_COMMAND, ASCII_INPUT_CONTROL, ASCII_OUTPUT_CONTROL, RESPONSE_ACKNOWLEDGE,
};
use pmac_dpram::map::{Layout, PMAC};
use serde_json::Value;

const PATIENCE: Duration = Duration::from_secs(20);
const SOURCES: [&str; 4] = ["servo_timer", "1.actual_position", "1.commanded_position", "1.actual_velocity"];

/// A simulated board and the host's way to its memory.
struct Rig {
    child: Child,
    control: BufReader<UnixStream>,
    bus: FileBoard,
    layout: Layout,
    in_steps: bool,
    _directory: tempfile::TempDir,
}

fn connect(path: &Path) -> UnixStream {
    let start = Instant::now();
    loop {
        match UnixStream::connect(path) {
            Ok(stream) => return stream,
            Err(error) if start.elapsed() > PATIENCE => panic!("{}: {error}", path.display()),
            Err(_) => std::thread::sleep(Duration::from_millis(5)),
        }
    }
}

impl Rig {
    fn start(firmware: &str, options: &[&str]) -> Self {
        let directory = tempfile::tempdir_in("/dev/shm").unwrap();
        let at = |name: &str| directory.path().join(name);
        let child = Command::new(env!("CARGO_BIN_EXE_pmac-sim"))
            .arg("--memory")
            .arg(at("dpram"))
            .arg(format!("--control=unix:{}", at("control").display()))
            .args(["--dpram-startup", "--firmware", firmware])
            .args(options)
            .spawn()
            .unwrap();
        let control = connect(&at("control"));
        control.set_read_timeout(Some(PATIENCE)).unwrap();
        // The file is there, and set up, once the control socket is.
        OpenOptions::new().read(true).write(true).open(at("dpram")).unwrap();
        let bus = FileBoard::open(&at("dpram"), 0x4000).unwrap();
        let layout = Layout::new(&PMAC, Some(firmware.parse().unwrap()));
        let in_steps = options.contains(&"--virtual");
        Self { child, control: BufReader::new(control), bus, layout, in_steps, _directory: directory }
    }

    fn ask(&mut self, command: &str) -> String {
        self.control.get_mut().write_all(format!("{command}\n").as_bytes()).unwrap();
        let mut answer = String::new();
        self.control.read_line(&mut answer).unwrap();
        answer.trim_end().to_owned()
    }

    fn pass(&mut self, cycles: u32) {
        if self.in_steps {
            assert_eq!(self.ask(&format!("step {cycles}")), "ok");
        }
    }

    /// Sends a line that only acknowledges.
    fn send(&mut self, line: &str) {
        let mut bytes = line.as_bytes().to_vec();
        bytes.resize(bytes.len() / 2 * 2 + 2, 0);
        for (n, pair) in bytes.as_chunks::<2>().0.iter().enumerate() {
            self.bus.write16(ASCII_COMMAND.plus_words(n), u16::from_le_bytes(*pair)).unwrap();
        }
        self.bus.order_writes();
        self.bus.write16(ASCII_OUTPUT_CONTROL, 1).unwrap();
        let start = Instant::now();
        loop {
            self.pass(1);
            match self.bus.read16(ASCII_INPUT_CONTROL).unwrap() {
                0 => assert!(start.elapsed() < PATIENCE, "no answer to {line}"),
                RESPONSE_ACKNOWLEDGE => break,
                other => panic!("{line}: 0x{other:04X}"),
            }
        }
        self.bus.write16(ASCII_INPUT_CONTROL, 0).unwrap();
    }

    fn plan(&self, mode: GatherMode, buffer_longs: Option<u32>) -> GatherPlan {
        let request = GatherRequest {
            sources: SOURCES.iter().map(|name| Source::parse(name, &self.layout).unwrap()).collect(),
            period: 1,
            mode,
            buffer_longs,
            // The start-up lines have started it.
            servo_report: ServoReport::Running,
            gathering: false,
        };
        plan(&request, &self.layout, &scales()).unwrap()
    }

    fn begin(&mut self, plan: &GatherPlan, timer: &mut ServoTimer) -> GatherReader {
        for line in &plan.prepare {
            self.send(line);
        }
        let buffer = GatherBuffer::planned(plan, &self.layout);
        let mut reader = GatherReader::new(buffer, GatherStart::Defined).unwrap();
        let look = reader.step(&mut self.bus, |bus| report_cycles(bus, timer)).unwrap();
        assert_eq!(look, GatherLook::Idle);
        for line in &plan.start {
            self.send(line);
        }
        reader
    }

    fn finish(mut self) {
        let status: Value = serde_json::from_str(&self.ask("status")).unwrap();
        assert_eq!(status["violations_total"], 0, "{status}");
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn scales() -> Scales {
    let motor =
        MotorScales { position_scale: Some(96.0), velocity_scale: Some(96.0), master_scale: Some(96.0) };
    Scales { motors: vec![motor], i10: Some(PMAC.default_i10) }
}

/// Takes what there is; every sample's number and values. The look that ended it.
fn take(
    rig: &mut Rig,
    reader: &mut GatherReader,
    timer: &mut ServoTimer,
    plan: &GatherPlan,
    mut row: impl FnMut(u64, &[f64]),
) -> GatherLook {
    let mut values = Vec::new();
    loop {
        match reader.step(&mut rig.bus, |bus| report_cycles(bus, timer)).unwrap() {
            GatherLook::Samples { first, .. } => {
                for (number, sample) in (first..).zip(reader.longs().chunks(reader.sample_longs())) {
                    values.clear();
                    column::decode(&plan.columns, sample, &mut values);
                    row(number, &values);
                }
            }
            look => return look,
        }
    }
}

#[test]
fn a_minute_of_every_servo_cycle_loses_nothing() {
    for (firmware, seconds) in [("1.16D", 60.0), ("1.16B", 1.0)] {
        let mut rig = Rig::start(firmware, &["--virtual"]);
        let mut timer = ServoTimer::new(15);
        let plan = rig.plan(GatherMode::Wrap, None);
        let mut reader = rig.begin(&plan, &mut timer);
        rig.send("#1J+");
        let clock = SampleClock { period: plan.period, servo_period_ns: scales().servo_period_ns() };
        let mut csv = CsvWriter::new(Vec::new(), &plan.columns, clock).unwrap();
        let mut npy = NpyWriter::new(Cursor::new(Vec::new()), &plan.columns, clock).unwrap();
        let (mut next, mut begin, mut last) = (0, None, 0.0);
        while clock.at(next) < seconds {
            rig.pass(400);
            let look = take(&mut rig, &mut reader, &mut timer, &plan, |number, values| {
                assert_eq!(number, next, "in order, without a gap");
                next += 1;
                // The board's own counter says that no servo cycle is missing between two samples.
                let begin = *begin.get_or_insert(values[0]);
                assert_eq!(values[0], begin + number as f64);
                assert!(values[1] >= last - 1.0 && values[1] < last + 20.0, "{} after {last}", values[1]);
                assert!((values[1] - values[2]).abs() < 200.0, "it follows");
                last = values[1];
                csv.row(number, values).unwrap();
                npy.row(number, values).unwrap();
            });
            assert_eq!(look, GatherLook::Idle);
        }
        assert_eq!((reader.lost(), reader.written()), (0, next));
        // 32 counts a millisecond, less the time to get there.
        assert!(last > (seconds - 0.5) * 32_000.0 * 0.99, "{last}");

        rig.send(&plan.stop);
        reader.stopped();
        let look = take(&mut rig, &mut reader, &mut timer, &plan, |_, _| {});
        assert_eq!(look, GatherLook::Ended);
        rig.pass(5000);
        assert_eq!(take(&mut rig, &mut reader, &mut timer, &plan, |_, _| {}), GatherLook::Ended);

        let csv = String::from_utf8(csv.finish().unwrap()).unwrap();
        let head = "sample,time_s,servo_timer [servo cycles],1.actual_position [count],\
                    1.commanded_position [count],1.actual_velocity [count per servo cycle]";
        assert_eq!(csv.lines().next(), Some(head));
        assert_eq!(csv.lines().count() as u64, next + 1);
        let npy = npy.finish().unwrap().into_inner();
        assert!(npy.len() as u64 - next * 6 * 8 < 1024);
        rig.finish();
    }
}

#[test]
fn laps_of_the_board_are_counted_exactly() {
    let mut rig = Rig::start("1.16D", &["--virtual"]);
    let mut timer = ServoTimer::new(15);
    // 40 samples of 6 longs.
    let plan = rig.plan(GatherMode::Wrap, Some(240));
    let mut reader = rig.begin(&plan, &mut timer);
    let (mut begin, mut taken) = (None, 0);
    for pause in [1, 39, 40, 41, 80, 1000, 7, 12_345] {
        rig.pass(pause);
        let look = take(&mut rig, &mut reader, &mut timer, &plan, |number, values| {
            let begin = *begin.get_or_insert(values[0] - number as f64);
            assert_eq!(values[0], begin + number as f64, "numbered as the board counts");
            taken += 1;
        });
        assert_eq!(look, GatherLook::Idle);
        assert_eq!(taken + reader.lost(), reader.written());
    }
    assert!(reader.lost() > 13_000);
    rig.finish();
}

#[test]
fn a_buffer_that_stops_at_its_end_is_read_whole() {
    let mut rig = Rig::start("1.16D", &["--virtual"]);
    let mut timer = ServoTimer::new(15);
    let plan = rig.plan(GatherMode::Stop, Some(1000));
    assert_eq!(plan.buffer_longs, 1002);
    let mut reader = rig.begin(&plan, &mut timer);
    rig.pass(1000);
    let mut numbers = Vec::new();
    let look = take(&mut rig, &mut reader, &mut timer, &plan, |number, _| numbers.push(number));
    assert_eq!((look, numbers.len(), reader.lost()), (GatherLook::Ended, 167, 0));
    rig.send("DEFINE GATHER 1002");
    let look = take(&mut rig, &mut reader, &mut timer, &plan, |_, _| {});
    assert!(matches!(look, GatherLook::Redefined { size: 1002, index: 0 }));
    rig.finish();
}

#[test]
fn in_real_time_what_was_missed_is_exact() {
    const SAMPLES: u64 = 4000;
    let mut rig = Rig::start("1.16D", &[]);
    let mut timer = ServoTimer::new(15);
    let plan = rig.plan(GatherMode::Wrap, Some(600));
    let mut reader = rig.begin(&plan, &mut timer);
    let (mut begin, mut taken) = (None, 0);
    let start = Instant::now();
    while reader.written() < SAMPLES {
        assert!(start.elapsed() < PATIENCE, "{}", reader.written());
        let look = take(&mut rig, &mut reader, &mut timer, &plan, |number, values| {
            let begin = *begin.get_or_insert(values[0] - number as f64);
            assert_eq!(values[0], begin + number as f64);
            taken += 1;
            if number % 997 == 0 {
                // The board goes round several times meanwhile.
                std::thread::sleep(Duration::from_millis(130));
            }
        });
        assert!(matches!(look, GatherLook::Idle | GatherLook::Disturbed), "{look:?}");
    }
    // What a disturbed look left behind is neither taken nor lost yet.
    assert_eq!(taken + reader.lost() + reader.waiting(), reader.written());
    assert!(taken > 0);
    rig.finish();
}
