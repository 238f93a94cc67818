//! Commands on program and table buffers: open, close, clear, define, delete, PLC switches, `PC`, `PE`, `PR`, `LEARN`
//! (Software Reference, on-line commands; Turbo Software Reference p. 381 for the commands that an open program
//! forbids).

use crate::map::Generation;
use crate::sim::board::error::CommandError;
use crate::sim::board::number::decimal;
use crate::sim::language::interpreter::Line;
use crate::sim::language::reply::Outcome;
use crate::sim::language::words::BufferCommand;
use crate::sim::program::item::{AXES, Data, Item, PlcSwitch};
use crate::sim::program::parse::numbers;
use crate::sim::program::store::{LAST_PROGRAM, Open, PLCS, PROTECTED, Table, TableKind};

/// A buffer as `OPEN`, `LIST`, `DEFINE` and `DELETE` name it.
#[derive(Debug, Clone, Copy)]
pub(super) enum Buffer {
    Program,
    Plc,
    Rotary,
    /// `BINARY`, before `ROTARY`.
    Binary,
    /// With `true` the inverse kinematic program of the addressed coordinate system, else the forward program.
    Kinematics(bool),
    Table(TableKind),
    Gather,
    /// Every buffer but the fixed programs.
    All,
    /// The lines from the next line to be calculated.
    Calculated,
    /// The lines from the line in execution.
    Executed,
    /// The board has nothing to list.
    Empty,
    /// In the manual, but without effect here.
    Nothing,
}

const BUFFERS: &[(&str, Buffer)] = &[
    ("PROG", Buffer::Program),
    ("PROGRAM", Buffer::Program),
    ("PLC", Buffer::Plc),
    ("ROT", Buffer::Rotary),
    ("ROTARY", Buffer::Rotary),
    ("BINARY", Buffer::Binary),
    ("BIN", Buffer::Binary),
    ("FORWARD", Buffer::Kinematics(false)),
    ("INVERSE", Buffer::Kinematics(true)),
    ("UBUFFER", Buffer::Table(TableKind::User)),
    ("UBUF", Buffer::Table(TableKind::User)),
    ("TBUF", Buffer::Table(TableKind::Transformation)),
    ("COMP", Buffer::Table(TableKind::Leadscrew)),
    ("TCOMP", Buffer::Table(TableKind::Torque)),
    ("BLCOMP", Buffer::Table(TableKind::Backlash)),
    ("CCBUF", Buffer::Table(TableKind::Cutter)),
    ("LOOKAHEAD", Buffer::Table(TableKind::Lookahead)),
    ("GATHER", Buffer::Gather),
    ("GAT", Buffer::Gather),
    ("ALL", Buffer::All),
    ("PC", Buffer::Calculated),
    ("PE", Buffer::Executed),
    ("LINK", Buffer::Empty),
    ("LDS", Buffer::Empty),
    ("TRACE", Buffer::Nothing),
    ("TEMPS", Buffer::Nothing),
];

impl Line<'_, '_> {
    pub(super) fn buffer_command(&mut self, command: BufferCommand) -> Outcome {
        self.store_items()?;
        let cs = self.interpreter.cs;
        match command {
            BufferCommand::Open => self.open(),
            BufferCommand::CloseAll => {
                if self.scanner.take_text(b"ALL") || !self.board.faults.close_ignored {
                    self.programs.store.close();
                }
                Ok(())
            }
            BufferCommand::Close => {
                self.programs.store.close();
                Ok(())
            }
            BufferCommand::Clear => self.clear(),
            BufferCommand::Learn => self.learn(),
            BufferCommand::List => self.list(),
            BufferCommand::Calculated => {
                let text = self.calculated_text().ok_or(CommandError::SYNTAX)?;
                self.answer(text)
            }
            BufferCommand::Executed => {
                let (program, _, offset) = self.executed().ok_or(CommandError::SYNTAX)?;
                self.answer(format!("P{program}:{offset}"))
            }
            BufferCommand::RotaryRemaining => {
                let lines = self.programs.rotary_remaining(cs).ok_or(CommandError::SYNTAX)?;
                self.answer(lines.to_string())
            }
            BufferCommand::Plc(switch) => {
                if !self.scanner.take_text(b"PLC") {
                    return Err(CommandError::SYNTAX);
                }
                if self.scanner.take_tight(b"C") {
                    // Compiled PLCs come from a compiler on the host; this board has none to enable.
                    numbers(&mut self.scanner, 0, PLCS - 1)?;
                    return Ok(());
                }
                let plcs = numbers(&mut self.scanner, 0, PLCS - 1)?;
                self.programs.switch_plcs(plcs as u32, switch);
                Ok(())
            }
            BufferCommand::Match => self.programs.match_positions(self.board, cs),
        }
    }

    /// The buffer that the words at the scanner name; `None`, with the scanner unmoved, where they name none.
    pub(super) fn buffer(&mut self) -> Option<Buffer> {
        self.scanner.keyword(&[BUFFERS])
    }

    fn is_turbo(&self) -> bool {
        self.board.family().generation == Generation::Turbo
    }

    fn open(&mut self) -> Outcome {
        let open = match self.buffer() {
            Some(Buffer::Rotary) => Open::Rotary,
            Some(Buffer::Binary)
                if !self.board.faults.no_binary_rotary && matches!(self.buffer(), Some(Buffer::Rotary)) =>
            {
                Open::BinaryRotary
            }
            Some(Buffer::Program) => {
                self.scanner.take_text(b"RAM");
                match self.scanner.integer()? {
                    number @ 1..=LAST_PROGRAM => Open::Program(number as u32),
                    _ => return Err(CommandError::SYNTAX),
                }
            }
            Some(Buffer::Plc) => match self.scanner.integer()? {
                number if number < PLCS => Open::Plc(number),
                _ => return Err(CommandError::SYNTAX),
            },
            Some(Buffer::Kinematics(inverse)) if self.is_turbo() => {
                Open::Kinematics { inverse, cs: self.interpreter.cs }
            }
            _ => return Err(CommandError::SYNTAX),
        };
        if self.programs.store.open().is_some() {
            return Err(CommandError::BUFFER_IN_USE);
        }
        match open {
            Open::Program(number) => {
                self.accessible(number as usize >= PROTECTED)?;
                if self.programs.any_runs() {
                    return Err(CommandError::RUNNING);
                }
                self.programs.reset_pointers();
            }
            Open::Plc(number) => {
                self.accessible(true)?;
                self.programs.switch_plcs(1 << number, PlcSwitch::Disable);
            }
            // Turbo Software Reference p. 379.
            Open::Kinematics { .. } if self.programs.any_runs() => return Err(CommandError::RUNNING),
            Open::Kinematics { .. } => self.accessible(true)?,
            Open::Rotary | Open::BinaryRotary => {}
        }
        self.programs.store.open_buffer(open)
    }

    /// ERR002 for a buffer that the password protects.
    pub(super) fn accessible(&self, protected: bool) -> Outcome {
        if protected && !self.board.variables.password.is_open() {
            return Err(CommandError::PASSWORD);
        }
        Ok(())
    }

    fn clear(&mut self) -> Outcome {
        let cs = self.interpreter.cs;
        let rotary = self.programs.store.rotary_is_open();
        if rotary && self.programs.systems.get(cs).is_some_and(|system| system.running) {
            return Err(CommandError::RUNNING);
        }
        self.programs.store.clear(cs)?;
        if rotary {
            // The pointer was to a deleted line.
            if self.programs.systems[cs].cursor.is_some_and(|cursor| cursor.program == 0) {
                self.programs.begin(self.board, cs, 0.0)?;
            }
            self.programs.note_rotary(self.board, cs);
        }
        Ok(())
    }

    /// `LEARN`, with or without axes in parentheses: appends a line with the present commanded positions.
    fn learn(&mut self) -> Outcome {
        let list = crate::sim::language::axis::parse_list(&mut self.scanner)?;
        if self.programs.store.open().is_none() {
            return Err(CommandError::NO_OPEN_BUFFER);
        }
        let cs = self.interpreter.cs;
        let mut axes = [0.0; AXES.len()];
        self.board.axis_positions(cs, &mut axes);
        for (index, letter) in AXES.iter().enumerate() {
            let wanted = match &list {
                Some(list) => list.contains(&char::from(*letter)),
                None => !self.board.motors_on(cs, index).is_empty(),
            };
            if wanted {
                let position = decimal(axes[index], self.board.variables.tables().decimals);
                let position = position.parse().unwrap_or(axes[index]);
                self.items.push(Item::Axis(index, Data::Constant(position), None));
            }
        }
        self.store_items()
    }

    /// A size, which sites also give in hex. A size beyond any board's memory need only stay so.
    fn size(&mut self) -> Result<usize, CommandError> {
        Ok(self.scanner.unsigned()?.min(1e8) as usize)
    }

    /// `DEFINE` of any buffer but the gather buffer: sizes in long words, entries or counts.
    pub(super) fn define_buffer(&mut self, buffer: Buffer) -> Outcome {
        let size = self.size()?;
        let (cs, motor) = (self.interpreter.cs, self.interpreter.motor);
        let free = self.programs.free_memory(self.board);
        if self.board.gather_is_defined() {
            return Err(CommandError::SYNTAX);
        }
        let kind = match buffer {
            Buffer::Rotary => return self.programs.store.define_rotary(cs, size, free),
            Buffer::Table(kind) if self.has(kind) => kind,
            _ => return Err(CommandError::SYNTAX),
        };
        let (mut motors, mut desired, mut outputs) = ([motor; 2], false, 0);
        let (owner, span) = match kind {
            TableKind::Leadscrew | TableKind::Torque | TableKind::Backlash => {
                self.scanner.expect(b',')?;
                if kind == TableKind::Leadscrew {
                    (motors, desired) = self.compensated_motors()?;
                }
                (motor, self.scanner.unsigned()?)
            }
            TableKind::Cutter => (cs, 0.0),
            TableKind::Lookahead => {
                self.scanner.expect(b',')?;
                outputs = self.size()?;
                (cs, 0.0)
            }
            TableKind::User | TableKind::Transformation => (0, 0.0),
        };
        if size == 0 {
            return Err(CommandError::SYNTAX);
        }
        // Two words for each output of the lookahead (Software Reference p. 215). No manual seen gives the words of its
        // segments.
        let size = size + 2 * outputs;
        if size as i64 > free {
            return Err(CommandError::NO_ROOM);
        }
        let store = &mut self.programs.store;
        let is_defined = store.tables.iter().any(|table| table.kind == kind && table.owner == owner);
        if is_defined || kind == TableKind::Lookahead && store.has_lookahead_before(cs) {
            return Err(CommandError::SYNTAX);
        }
        store.tables.push(Table { kind, owner, size, span, motors, desired, entries: Vec::new() });
        Ok(())
    }

    /// A PMAC needs Option 6L for lookahead, which no board here has.
    fn has(&self, kind: TableKind) -> bool {
        kind != TableKind::Lookahead || self.is_turbo()
    }

    /// `[#source[D],][#target,]` of `DEFINE COMP`; each defaults to the addressed motor.
    fn compensated_motors(&mut self) -> Result<([usize; 2], bool), CommandError> {
        let (mut motors, mut desired) = ([self.interpreter.motor; 2], false);
        for (index, motor) in motors.iter_mut().enumerate() {
            if !self.scanner.take(b'#') {
                break;
            }
            *motor = match self.scanner.integer()? {
                number if (1..=self.board.family().motors).contains(&number) => number - 1,
                _ => return Err(CommandError::SYNTAX),
            };
            desired |= index == 0 && self.scanner.take(b'D');
            self.scanner.expect(b',')?;
        }
        Ok((motors, desired))
    }

    /// `DELETE` of any buffer but the gather buffer.
    pub(super) fn delete_buffer(&mut self, buffer: Buffer) -> Outcome {
        let (cs, motor) = (self.interpreter.cs, self.interpreter.motor);
        match buffer {
            Buffer::Nothing => Ok(()),
            Buffer::Rotary => {
                if self.programs.systems.get(cs).is_some_and(|system| system.running) {
                    return Err(CommandError::RUNNING);
                }
                // A Turbo board deletes upwards (Turbo Software Reference p. 315). No page seen says so of PMAC.
                if self.is_turbo() && self.programs.store.has_rotary_before(cs) {
                    return Err(CommandError::SYNTAX);
                }
                self.programs.store.delete_rotary(cs)?;
                self.programs.forget_rotary(self.board, cs);
                Ok(())
            }
            Buffer::Table(kind) if self.has(kind) => {
                let store = &self.programs.store;
                // These must be deleted before a lookahead buffer (Turbo Software Reference p. 315).
                let has_others = store.has_lookahead_before(cs)
                    || store.has_rotary_before(self.board.coordinate_systems())
                    || self.board.gather_is_defined();
                if kind == TableKind::Lookahead && has_others {
                    return Err(CommandError::SYNTAX);
                }
                let owner = match kind {
                    TableKind::Leadscrew | TableKind::Torque | TableKind::Backlash => motor,
                    TableKind::Cutter | TableKind::Lookahead => cs,
                    TableKind::User | TableKind::Transformation => 0,
                };
                // A site's backup deletes the tables of all motors, whether they have any or not.
                self.programs.store.tables.retain(|table| table.kind != kind || table.owner != owner);
                Ok(())
            }
            _ => Err(CommandError::SYNTAX),
        }
    }

    /// `DELETE ALL`: every buffer except programs.
    pub(super) fn delete_all(&mut self) -> Outcome {
        if self.programs.any_runs() {
            return Err(CommandError::RUNNING);
        }
        if self.programs.store.rotary_is_open() {
            return Err(CommandError::BUFFER_IN_USE);
        }
        self.board.delete_gather()?;
        self.programs.store.delete_all();
        for cs in 0..self.board.family().coordinate_systems {
            self.programs.forget_rotary(self.board, cs);
        }
        Ok(())
    }
}
