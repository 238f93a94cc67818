//! Gathers from a simulated board in its own process, with the library's reader and decoder.

use std::time::Instant;

use pmac_dpram::decode::{MotorScales, Scales};
use pmac_dpram::device::{Bus, FileBoard};
use pmac_dpram::function::gather::{GatherBuffer, GatherPoll, GatherReader, GatherStart, report_cycles};
use pmac_dpram::function::servo_timer::ServoTimer;
use pmac_dpram::gather::{GatherMode, GatherPlan, GatherRequest, Source, column, gather_lines, plan};
use pmac_dpram::map::functions::response;
use pmac_dpram::map::pmac::{ASCII_COMMAND, ASCII_INPUT_CONTROL, ASCII_OUTPUT_CONTROL};
use pmac_dpram::map::{Layout, PMAC};

use super::PATIENCE;
use super::sim::Sim;

/// The registers to gather: three longs and a word.
pub const SOURCES: [&str; 4] =
    ["servo_timer", "1.actual_position", "1.commanded_position", "1.actual_velocity"];

/// A simulated board, and the host's access to its memory.
pub struct GatherRig {
    sim: Sim,
    pub bus: FileBoard,
    layout: Layout,
    in_steps: bool,
}

impl GatherRig {
    pub fn start(firmware: &str, options: &[&str]) -> Self {
        let sim = Sim::start(&[&["--dpram-startup", "--firmware", firmware], options].concat());
        let bus = FileBoard::open(&sim.path("dpram"), 0x4000).unwrap();
        let layout = Layout::new(&PMAC, Some(firmware.parse().unwrap()));
        Self { sim, bus, layout, in_steps: options.contains(&"--virtual") }
    }

    /// Runs this many servo cycles, if time does not pass by itself.
    pub fn pass(&mut self, cycles: u32) {
        if self.in_steps {
            self.sim.ok(&format!("step {cycles}"));
        }
    }

    /// Sends a line that the board only acknowledges.
    pub fn send(&mut self, line: &str) {
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
                response::ACKNOWLEDGE => break,
                other => panic!("{line}: 0x{other:04X}"),
            }
        }
        self.bus.write16(ASCII_INPUT_CONTROL, 0).unwrap();
    }

    pub fn plan(&self, mode: GatherMode, buffer_longs: Option<u32>) -> GatherPlan {
        let request = GatherRequest {
            sources: SOURCES.iter().map(|name| Source::parse(name, &self.layout).unwrap()).collect(),
            period: 1,
            mode,
            buffer_longs,
        };
        plan(&request, &self.layout, &scales()).unwrap()
    }

    pub fn begin(&mut self, plan: &GatherPlan, timer: &mut ServoTimer) -> GatherReader {
        let codes: Vec<u32> = plan.registers.iter().map(|register| register.gather_code()).collect();
        for line in gather_lines(&PMAC.i, &codes, plan.period, plan.mode, plan.buffer_longs) {
            self.send(&line);
        }
        let place = self.layout.gather();
        let buffer = GatherBuffer {
            place,
            room_longs: (PMAC.length - place.buffer.bytes()) / 4,
            size_longs: plan.buffer_longs,
            sample_longs: plan.sample_longs,
            longest_sample: PMAC.i.longest_gather_sample(),
            mode: plan.mode,
            period: plan.period,
        };
        let mut reader = GatherReader::new(buffer, GatherStart::Defined).unwrap();
        let look = reader.poll(&mut self.bus, |bus| report_cycles(bus, &PMAC.servo, timer)).unwrap();
        assert_eq!(look, GatherPoll::Idle);
        // The start-up lines have started the servo report.
        self.send("GATHER");
        reader
    }

    /// Checks that the board has seen no broken handshake.
    pub fn finish(mut self) {
        assert_eq!(self.sim.status("violations_total"), 0);
    }
}

/// The scales of motor 1.
pub fn scales() -> Scales {
    let motor = MotorScales {
        position_scale: Some(96.0),
        velocity_scale: Some(96.0),
        master_scale: Some(96.0),
        ..Default::default()
    };
    Scales { motors: vec![motor], i10: Some(PMAC.default_i10) }
}

/// Takes the available samples, each with its number and values. Returns the result of the last poll.
pub fn take(
    rig: &mut GatherRig,
    reader: &mut GatherReader,
    timer: &mut ServoTimer,
    plan: &GatherPlan,
    mut row: impl FnMut(u64, &[f64]),
) -> GatherPoll {
    let mut values = Vec::new();
    loop {
        match reader.poll(&mut rig.bus, |bus| report_cycles(bus, &PMAC.servo, timer)).unwrap() {
            GatherPoll::Samples { first, .. } => {
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
