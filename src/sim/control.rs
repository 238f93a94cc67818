//! The control socket's commands, by which tests and demonstrations change the simulated world. One line in, one line
//! out.
//! [`COMMANDS`] lists them.

use serde::Serialize;

use crate::map::HostOffset;
use crate::sim::board::motor::Inputs;
use crate::sim::board::motor::flags::{MINUS, PLACES, PLUS, everywhere};
use crate::sim::program::item::Message;
use crate::sim::program::message::{Outlet, send};
use crate::sim::world::World;

/// The most cycles of one `step`.
const MOST_STEPS: u64 = 100_000_000;

/// A command's request to the process around the board.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ControlAnswer {
    /// The line to send back.
    Line(String),
    /// Run this many cycles, then answer.
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
    notes: &'a [String],
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
        notes: &board.notes,
    };
    serde_json::to_string(&status).unwrap_or_else(|error| format!("error: {error}"))
}

/// Carries out one command line in virtual time, with the cycles of a `step`; gives the answering line.
pub fn carry_out(world: &mut World, line: &str) -> String {
    match execute(world, line, true) {
        ControlAnswer::Line(line) => line,
        ControlAnswer::Step(cycles) => {
            for _ in 0..cycles {
                world.step();
            }
            "ok".into()
        }
        ControlAnswer::Exit => "ok".into(),
    }
}

/// Carries out one command line. `virtual_time` says whether `step` is allowed.
pub fn execute(world: &mut World, line: &str, virtual_time: bool) -> ControlAnswer {
    answer(world, line.trim(), virtual_time)
        .unwrap_or_else(|error| ControlAnswer::Line(format!("error: {error}")))
}

/// A command line, taken apart.
struct Call<'a> {
    world: &'a mut World,
    arguments: &'a [&'a str],
    /// The text after the command's word.
    rest: &'a str,
    virtual_time: bool,
}

/// A command of the control socket.
pub struct Command {
    /// The command as a user types it.
    pub form: &'static str,
    /// The command's effect.
    pub effect: &'static str,
    /// `None`: the arguments do not have the form.
    carry_out: fn(Call) -> Option<Result<ControlAnswer, String>>,
}

impl Command {
    fn word(&self) -> &'static str {
        self.form.split(' ').next().unwrap_or(self.form)
    }
}

/// `ok`, or the error.
fn done(result: Result<(), String>) -> Option<Result<ControlAnswer, String>> {
    Some(result.map(|()| ControlAnswer::Line("ok".into())))
}

/// Every command.
pub static COMMANDS: &[Command] = &[
    Command {
        form: "step N",
        effect: "runs N servo cycles, each with its background pass; only with --virtual",
        carry_out: step,
    },
    Command {
        form: "status",
        effect: "answers the counts as one line of JSON",
        carry_out: |call| call.arguments.is_empty().then(|| Ok(ControlAnswer::Line(status(call.world)))),
    },
    Command {
        form: "fault NAME on|off|N",
        effect: "sets a fault or takes it back",
        carry_out: |call| {
            let &[name, value] = call.arguments else { return None };
            let ms = call.world.board.cycle_ms();
            done(call.world.board.faults.set(name, value, ms))
        },
    },
    Command {
        form: "reset",
        effect: "acts as the reset switch",
        carry_out: |call| {
            call.arguments.is_empty().then(|| call.world.reset())?;
            done(Ok(()))
        },
    },
    Command {
        form: "send TEXT",
        effect: "acts as SEND\"TEXT\" of a program",
        carry_out: |call| {
            send(&mut call.world.board, &Message::Text(call.rest.into()), Outlet::Active);
            done(Ok(()))
        },
    },
    Command {
        form: "cmd TEXT",
        effect: "acts as CMD\"TEXT\" of a program",
        carry_out: |call| {
            call.world.command_message(call.rest);
            done(Ok(()))
        },
    },
    Command {
        form: "limit MOTOR +|-|0",
        effect: "opens the limit switch at one end, or closes both",
        carry_out: |call| {
            let &[motor, end @ ("+" | "-" | "0")] = call.arguments else { return None };
            done(inputs(call.world, motor).map(|inputs| {
                inputs.places[PLUS] = everywhere(end == "+");
                inputs.places[MINUS] = everywhere(end == "-");
            }))
        },
    },
    Command {
        form: "place MOTOR home|plus|minus|user|stop FROM TO",
        effect: "puts a flag's switch, or a hard stop, between two positions of the shaft, in counts",
        carry_out: |call| {
            let &[motor, name, from, to] = call.arguments else { return None };
            let place = PLACES.iter().position(|place| *place == name)?;
            let between = [from.parse().ok()?, to.parse().ok()?];
            done(inputs(call.world, motor).map(|inputs| inputs.places[place] = between))
        },
    },
    Command {
        form: "trigger MOTOR",
        effect: "gives a trigger pulse for homing or a jog until trigger",
        carry_out: |call| {
            let &[motor] = call.arguments else { return None };
            done(inputs(call.world, motor).map(|inputs| inputs.trigger = true))
        },
    },
    Command {
        form: "index MOTOR on|off",
        effect: "connects the encoder's index channel, the usual trigger of a homing search",
        carry_out: |call| {
            let &[motor, state] = call.arguments else { return None };
            done(on(state).and_then(|on| inputs(call.world, motor).map(|inputs| inputs.no_index = !on)))
        },
    },
    Command {
        form: "stall MOTOR on|off",
        effect: "holds the shaft",
        carry_out: |call| {
            let &[motor, state] = call.arguments else { return None };
            done(on(state).and_then(|on| inputs(call.world, motor).map(|inputs| inputs.stalled = on)))
        },
    },
    Command {
        form: "turn MOTOR COUNTS",
        effect: "turns the shaft by hand; a closed loop turns it back",
        carry_out: |call| {
            let &[motor, counts] = call.arguments else { return None };
            let Ok(counts) = counts.parse::<i32>() else {
                return Some(Err(format!("turn takes a number of counts, not {counts:?}")));
            };
            done(inputs(call.world, motor).map(|inputs| inputs.turned += f64::from(counts)))
        },
    },
    Command {
        form: "poke OFFSET VALUE",
        effect: "puts a word into the DPRAM as if PMAC had: a wild index, a count that is wrong",
        carry_out: poke,
    },
    Command {
        form: "timer STEP",
        effect: "moves the servo counter by so many cycles, back if negative",
        carry_out: |call| {
            let &[step] = call.arguments else { return None };
            let Ok(step) = step.parse() else {
                return Some(Err(format!("timer takes a number of cycles, not {step:?}")));
            };
            let board = &mut call.world.board;
            let count = board.servo_counter().wrapping_add_signed(step);
            board.memory.write(board.memory.registers().servo_counter, count);
            done(Ok(()))
        },
    },
    Command {
        form: "tag on|off",
        effect: "puts the update's number into every field of the servo report",
        carry_out: |call| {
            let &[state] = call.arguments else { return None };
            done(on(state).map(|on| call.world.report.tag = on))
        },
    },
    Command {
        form: "time on|off",
        effect: "puts the update's time, CLOCK_MONOTONIC in ns, into motor 1's compensation position, or its position bias where the report has none",
        carry_out: |call| {
            let &[state] = call.arguments else { return None };
            done(on(state).map(|on| call.world.report.time = on))
        },
    },
    Command {
        form: "exit",
        effect: "ends the simulator",
        carry_out: |call| call.arguments.is_empty().then_some(Ok(ControlAnswer::Exit)),
    },
];

fn answer(world: &mut World, line: &str, virtual_time: bool) -> Result<ControlAnswer, String> {
    let (word, rest) = line.split_once(' ').unwrap_or((line, ""));
    let arguments: Vec<&str> = rest.split_whitespace().collect();
    let call = Call { world, arguments: &arguments, rest, virtual_time };
    let command = COMMANDS.iter().find(|command| command.word() == word);
    command.and_then(|command| (command.carry_out)(call)).unwrap_or_else(|| {
        let forms: Vec<_> = COMMANDS.iter().map(|command| command.form).collect();
        Err(format!("cannot do {line:?}; commands: {}", forms.join(", ")))
    })
}

fn step(call: Call) -> Option<Result<ControlAnswer, String>> {
    if !call.virtual_time {
        return Some(Err("step needs a simulator started with --virtual".into()));
    }
    let &[count] = call.arguments else { return None };
    let steps = count.parse().ok().filter(|steps| (0..=MOST_STEPS).contains(steps));
    Some(steps.map(ControlAnswer::Step).ok_or(format!("step takes 0 to {MOST_STEPS} cycles, not {count:?}")))
}

fn poke(call: Call) -> Option<Result<ControlAnswer, String>> {
    let &[offset, value] = call.arguments else { return None };
    let number = |text: &str| u16::from_str_radix(text.trim_start_matches("0x"), 16);
    let (Ok(offset), Ok(value)) = (number(offset), number(value)) else {
        return Some(Err(format!("poke takes two hexadecimal words, not {:?}", call.rest)));
    };
    call.world.board.memory.dpram.write16(HostOffset::new((offset & !1).into()), value);
    done(Ok(()))
}

fn on(state: &str) -> Result<bool, String> {
    match state {
        "on" => Ok(true),
        "off" => Ok(false),
        _ => Err(format!("on or off, not {state:?}")),
    }
}

fn inputs<'a>(world: &'a mut World, motor: &str) -> Result<&'a mut Inputs, String> {
    let number: Option<usize> = motor.parse().ok();
    number
        .and_then(|number| number.checked_sub(1))
        .and_then(|index| world.board.inputs(index))
        .ok_or_else(|| format!("no motor {motor:?}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::testing::Bench;

    #[test]
    fn each_command_of_the_list_is_taken_as_its_form_says() {
        for command in COMMANDS {
            let mut bench = Bench::started();
            let line = command
                .form
                .replace("NAME on|off|N", "servo_silent on")
                .replace("MOTOR", "1")
                .replace("home|plus|minus|user|stop FROM TO", "home 100 200")
                .replace("+|-|0", "+")
                .replace("on|off", "on")
                .replace("OFFSET VALUE", "0x0A00 5")
                .replace("STEP", "-3")
                .replace("COUNTS", "400")
                .replace(" N", " 2");
            let ControlAnswer::Line(answer) = execute(&mut bench.world, &line, true) else { continue };
            assert!(!answer.starts_with("error"), "{line}: {answer}");
            // Only texts may be empty.
            if command.form.contains(' ') && !command.form.ends_with("TEXT") {
                let ControlAnswer::Line(answer) = execute(&mut bench.world, command.word(), true) else {
                    panic!()
                };
                assert!(answer.contains(command.form), "{answer}");
            }
        }
    }
}
