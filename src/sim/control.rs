//! The control socket's commands: what tests and demonstrations do to the simulated world. One line in, one line out.
//!
//! | command | effect |
//! |---|---|
//! | `step N` | with `--virtual`: N servo cycles, each with its background pass |
//! | `status` | one line of JSON with the counts |
//! | `fault NAME on\|off\|N` | see [`super::fault::Faults`] |
//! | `reset` | as the reset switch |
//! | `send TEXT`, `cmd TEXT` | as a program's `SEND"TEXT"`, `CMD"TEXT"` |
//! | `limit MOTOR +\|-\|0` | opens the limit switch at one end, or closes both |
//! | `trigger MOTOR` | a trigger pulse for homing or a jog until trigger |
//! | `index MOTOR on\|off` | connects the encoder's index channel, the usual trigger of a homing search |
//! | `stall MOTOR on\|off` | holds the shaft |
//! | `poke OFFSET VALUE` | puts a word into the DPRAM as if PMAC had: a wild index, a count that is wrong |
//! | `timer STEP` | the servo counter jumps by so many cycles, back if negative |
//! | `tag on\|off` | the servo report carries its update's number in every field |
//! | `time on\|off` | it carries its update's time, CLOCK_MONOTONIC in ns, as motor 1's compensation position |
//! | `exit` | ends the simulator |

use serde::Serialize;

use crate::map::HostOffset;
use crate::sim::board::Board;
use crate::sim::board::motor::Inputs;
use crate::sim::program::message::send_message;
use crate::sim::world::World;

/// The most cycles of one `step`.
const MOST_STEPS: u64 = 100_000_000;

/// What a command asks of the process around the board.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Answer {
    /// The line to send back.
    Line(String),
    /// Run so many cycles, then answer.
    Step(u64),
    /// Answer, then end.
    Exit,
}

#[derive(Serialize)]
struct Status<'a> {
    servo_cycles: u64,
    servo_timer: u32,
    servo_period_us: f64,
    updates: u64,
    skipped: u64,
    late: u64,
    background_updates: u64,
    commands: u64,
    violations: &'a [String],
    violations_total: u64,
    resets: u64,
    watchdog: bool,
}

/// The answer to `status`: a JSON object on one line.
#[must_use]
pub fn status(world: &World) -> String {
    let board = &world.board;
    let status = Status {
        servo_cycles: board.stats.servo_cycles,
        servo_timer: board.servo_counter(),
        servo_period_us: board.cycle_ms() * 1000.0,
        updates: world.report.updates,
        skipped: world.report.skipped,
        late: board.stats.late,
        background_updates: board.stats.background_updates,
        commands: world.ascii.commands,
        violations: board.judge.violations(),
        violations_total: board.judge.total(),
        resets: board.stats.resets,
        watchdog: board.watchdog,
    };
    serde_json::to_string(&status).unwrap_or_else(|error| format!("error: {error}"))
}

/// Carries out one command line in virtual time, the cycles of a `step` included; gives the line that answers it.
pub fn carry_out(world: &mut World, line: &str) -> String {
    match execute(world, line, true) {
        Answer::Line(line) => line,
        Answer::Step(cycles) => {
            for _ in 0..cycles {
                world.step();
            }
            "ok".into()
        }
        Answer::Exit => "ok".into(),
    }
}

/// Carries out one command line. `virtual_time` says whether `step` is allowed.
pub fn execute(world: &mut World, line: &str, virtual_time: bool) -> Answer {
    answer(world, line.trim(), virtual_time).unwrap_or_else(|error| Answer::Line(format!("error: {error}")))
}

fn answer(world: &mut World, line: &str, virtual_time: bool) -> Result<Answer, String> {
    let (word, rest) = line.split_once(' ').unwrap_or((line, ""));
    let arguments: Vec<&str> = rest.split_whitespace().collect();
    let board = &mut world.board;
    match (word, arguments.as_slice()) {
        ("step", _) if !virtual_time => {
            return Err("step needs a simulator started with --virtual".into());
        }
        ("step", [count]) => {
            let steps = count.parse().ok().filter(|steps| (0..=MOST_STEPS).contains(steps));
            return steps
                .map(Answer::Step)
                .ok_or(format!("step takes 0 to {MOST_STEPS} cycles, not {count:?}"));
        }
        ("status", []) => return Ok(Answer::Line(status(world))),
        ("fault", [name, value]) => {
            let ms = board.cycle_ms();
            board.faults.set(name, value, ms)?;
        }
        ("reset", []) => {
            world.reset();
        }
        ("send", _) => send_message(board, rest),
        ("cmd", _) => world.command_message(rest),
        ("limit", [motor, end @ ("+" | "-" | "0")]) => {
            let inputs = inputs(board, motor)?;
            inputs.positive_limit = *end == "+";
            inputs.negative_limit = *end == "-";
        }
        ("trigger", [motor]) => inputs(board, motor)?.trigger = true,
        ("index", [motor, state]) => inputs(board, motor)?.no_index = !on(state)?,
        ("stall", [motor, state]) => inputs(board, motor)?.stalled = on(state)?,
        ("poke", [offset, value]) => {
            let number = |text: &str| u16::from_str_radix(text.trim_start_matches("0x"), 16);
            let (Ok(offset), Ok(value)) = (number(offset), number(value)) else {
                return Err(format!("poke takes two hexadecimal words, not {rest:?}"));
            };
            board.memory.dpram.write16(HostOffset::new((offset & !1).into()), value);
        }
        ("timer", [step]) => {
            let step: i32 =
                step.parse().map_err(|_| format!("timer takes a number of cycles, not {step:?}"))?;
            let count = board.servo_counter().wrapping_add_signed(step);
            board.memory.write(board.memory.registers().servo_counter, count);
        }
        ("tag", [state]) => world.report.tag = on(state)?,
        ("time", [state]) => world.report.time = on(state)?,
        ("exit", []) => return Ok(Answer::Exit),
        _ => {
            return Err(format!(
                "cannot do {line:?}; commands: step N, status, fault NAME on|off|N, reset, send TEXT, cmd TEXT, \
                 limit MOTOR +|-|0, trigger MOTOR, index MOTOR on|off, stall MOTOR on|off, poke OFFSET VALUE, timer STEP, tag on|off, time on|off, exit"
            ));
        }
    }
    Ok(Answer::Line("ok".into()))
}

fn on(state: &str) -> Result<bool, String> {
    match state {
        "on" => Ok(true),
        "off" => Ok(false),
        _ => Err(format!("on or off, not {state:?}")),
    }
}

fn inputs<'a>(board: &'a mut Board, motor: &str) -> Result<&'a mut Inputs, String> {
    let number: Option<usize> = motor.parse().ok();
    number
        .and_then(|number| number.checked_sub(1))
        .and_then(|index| board.inputs(index))
        .ok_or_else(|| format!("no motor {motor:?}"))
}
