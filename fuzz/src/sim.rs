//! The simulator reads what others wrote, too: lines of its control socket and of hosts, the serial line, and the memory.

use std::cell::Cell;

use pmac_dpram::sim::control::{self, Answer};
use pmac_dpram::sim::judge::Judge;
use pmac_dpram::sim::language::{Interpreter, SerialPort, family};
use pmac_dpram::sim::machine::{Board, Machine, Statistics};
use pmac_dpram::sim::{STARTUP, process};

use super::tape::Tape;

/// Most servo cycles of one input.
const CYCLES: u32 = 64;

/// A board, switched on with its functions (first byte odd), and pieces with a letter before each: what is done with them.
pub fn body(data: &[u8]) {
    let Some((&way, rest)) = data.split_first() else { return };
    let kind = if way & 2 == 0 { &family::PMAC } else { &family::PMAC2 };
    let mut board = match BOARD.take() {
        Some((which, board)) if which == kind.name => fresh(board),
        _ => Board { machine: Machine::alone(kind).unwrap(), interpreter: Interpreter::new() },
    };
    if way & 1 != 0 {
        process::load(&mut board, "startup", STARTUP).unwrap();
    }
    let mut serial = SerialPort::new();
    let mut cycles = CYCLES;
    let mut lasts = false;
    let mut tape = Tape::new(rest);
    while !tape.is_over() {
        let what = tape.u8();
        match what % 6 {
            0 | 1 => line(&mut board, tape.piece()),
            2 => {
                lasts = true;
                let text = String::from_utf8_lossy(tape.piece()).into_owned();
                match control::execute(&mut board, &text, true) {
                    Answer::Step(steps) => {
                        run(&mut board, u32::try_from(steps).unwrap_or(CYCLES), &mut cycles)
                    }
                    Answer::Line(answer) => assert!(!answer.contains('\n')),
                    Answer::Exit => return,
                }
            }
            3 => {
                let mut output = Vec::new();
                let bytes = tape.piece();
                for &byte in bytes {
                    serial.receive(&mut board.machine, &mut board.interpreter, byte, &mut output);
                }
                assert!(output.len() <= 1 << 20, "{} bytes in answer to {}", output.len(), bytes.len());
            }
            4 => {
                // The host's words: most of what it writes is ASCII, rotary and variable buffers.
                let offset = tape.u16() & 0x3FFE;
                for (word, at) in tape.piece().chunks(2).zip(0..) {
                    let value = u16::from_le_bytes([word[0], word.get(1).copied().unwrap_or(0)]);
                    board.machine.memory.dpram.write16((offset + 2 * at) & 0x3FFE, value);
                }
            }
            _ => run(&mut board, u32::from(what / 6) % 16 + 1, &mut cycles),
        }
    }
    run(&mut board, 4, &mut cycles);
    // What a control socket does outlasts a reset: faults, limit switches, a held shaft.
    if !lasts {
        BOARD.set(Some((kind.name, board)));
    }
}

thread_local! {
    /// The board of the last input, because a new one takes ten times as long as most inputs.
    static BOARD: Cell<Option<(&'static str, Board)>> = const { Cell::new(None) };
}

/// As new.
fn fresh(mut board: Board) -> Board {
    let machine = &mut board.machine;
    for offset in (0..0x4000).step_by(2) {
        machine.memory.dpram.write16(offset, 0);
    }
    machine.reset(true);
    machine.judge = Judge::default();
    machine.stats = Statistics::default();
    machine.serial_output.clear();
    board.interpreter = Interpreter::new();
    board
}

fn line(board: &mut Board, line: &[u8]) {
    match line {
        &[character @ 1..32] => drop(board.interpreter.control(&mut board.machine, character)),
        _ => {
            let reply = board.interpreter.execute(&mut board.machine, line);
            assert!(reply.lines.iter().map(String::len).sum::<usize>() <= 1 << 20);
        }
    }
}

fn run(board: &mut Board, count: u32, left: &mut u32) {
    let count = count.min(*left);
    *left -= count;
    for _ in 0..count {
        board.step();
    }
    assert!(board.machine.serial_output.len() <= 1 << 20);
    board.machine.serial_output.clear();
}
