//! The simulator reads what others wrote, too: lines of its control socket and of hosts, the serial line, and the memory.

use std::cell::Cell;

use pmac_dpram::map::HostOffset;
use pmac_dpram::sim::board::Statistics;
use pmac_dpram::sim::board::families::SIMULATED;
use pmac_dpram::sim::control::{self, ControlAnswer};
use pmac_dpram::sim::judge::Judge;
use pmac_dpram::sim::world::World;

use super::tape::Tape;

/// Most servo cycles of one input.
const CYCLES: u32 = 64;

/// A board, switched on with its functions (first byte odd), and pieces with a letter before each: what is done with them.
pub fn body(data: &[u8]) {
    let Some((&way, rest)) = data.split_first() else { return };
    let kind = SIMULATED[usize::from(way >> 1) % SIMULATED.len()];
    let mut world = match BOARD.take() {
        Some((which, world)) if which == kind.family.name => fresh(world),
        _ => World::alone(kind).unwrap(),
    };
    if way & 1 != 0 {
        world.load("startup", kind.startup).unwrap();
    }
    let mut cycles = CYCLES;
    let mut lasts = false;
    let mut tape = Tape::new(rest);
    while !tape.is_over() {
        let what = tape.u8();
        match what % 6 {
            0 | 1 => line(&mut world, tape.piece()),
            2 => {
                lasts = true;
                let text = String::from_utf8_lossy(tape.piece()).into_owned();
                match control::execute(&mut world, &text, true) {
                    ControlAnswer::Step(steps) => {
                        run(&mut world, u32::try_from(steps).unwrap_or(CYCLES), &mut cycles)
                    }
                    ControlAnswer::Line(answer) => assert!(!answer.contains('\n')),
                    ControlAnswer::Exit => return,
                }
            }
            3 => {
                let bytes = tape.piece();
                let output = world.serial(bytes);
                assert!(output.len() <= 1 << 20, "{} bytes in answer to {}", output.len(), bytes.len());
            }
            4 => {
                // The host's words: most of what it writes is ASCII, rotary and variable buffers.
                let (offset, last) = (u32::from(tape.u16()), kind.family.length - 2);
                for (word, at) in tape.piece().chunks(2).zip(0..) {
                    let value = u16::from_le_bytes([word[0], word.get(1).copied().unwrap_or(0)]);
                    world.board.memory.dpram.write16(HostOffset::new((offset + 2 * at) & last), value);
                }
            }
            _ => run(&mut world, u32::from(what / 6) % 16 + 1, &mut cycles),
        }
    }
    run(&mut world, 4, &mut cycles);
    // What a control socket does outlasts a reset: faults, limit switches, a held shaft.
    if !lasts {
        BOARD.set(Some((kind.family.name, world)));
    }
}

thread_local! {
    /// The board of the last input, because a new one takes ten times as long as most inputs.
    static BOARD: Cell<Option<(&'static str, World)>> = const { Cell::new(None) };
}

/// As new.
fn fresh(world: World) -> World {
    let mut board = world.board;
    for offset in board.memory.dpram.words() {
        board.memory.dpram.write16(offset, 0);
    }
    // A board counts its time from its reset on.
    board.stats = Statistics::default();
    board.reset(true);
    board.judge = Judge::new(board.family());
    board.output.serial.clear();
    World::new(board)
}

fn line(world: &mut World, line: &[u8]) {
    match line {
        &[character @ 1..32] => drop(world.control_character(character)),
        _ => {
            let reply = world.execute(line);
            assert!(reply.lines.iter().map(String::len).sum::<usize>() <= 1 << 20);
        }
    }
}

fn run(world: &mut World, count: u32, left: &mut u32) {
    let count = count.min(*left);
    *left -= count;
    for _ in 0..count {
        world.step();
    }
    assert!(world.board.output.serial.len() <= 1 << 20);
    world.board.output.serial.clear();
}
