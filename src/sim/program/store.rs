//! The program and table buffers and their memory (Software Reference, `OPEN`, `DEFINE`, `DELETE`, `SIZE`).

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::sim::board::error::CommandError;
use crate::sim::program::item::{Item, Line};
use crate::sim::program::rotary::Rotary;
use crate::sim::program::structure::Tracker;

/// Number of PLC programs.
pub const PLCS: usize = 32;
/// The highest number of a motion program.
pub const LAST_PROGRAM: usize = 32_767;
/// The password protects programs from this number on, and all PLCs.
pub const PROTECTED: usize = 1000;

type Result<T> = std::result::Result<T, CommandError>;

/// A fixed program: motion or PLC.
#[derive(Debug, Clone, Default)]
pub struct Program {
    lines: Vec<Arc<Line>>,
    words: usize,
}

impl Program {
    /// Line `number`, from 0.
    #[must_use]
    pub fn line(&self, number: u64) -> Option<&Arc<Line>> {
        self.lines.get(usize::try_from(number).ok()?)
    }

    /// The lines, in order.
    #[must_use]
    pub fn all(&self) -> Vec<Arc<Line>> {
        self.lines.clone()
    }

    /// The lines as a board lists them: `RETURN` ends them, whether a user entered it or not. Two tools in use rely on
    /// that `RETURN`: dls-pmacanalyse adds it to files before it compares them with listings, and dPMAC turns it into
    /// the `CLOSE` of the files that it writes. A program that was just cleared stays empty.
    #[must_use]
    pub fn listed(&self) -> Vec<Arc<Line>> {
        self.lines.iter().cloned().chain(self.end()).collect()
    }

    /// The `RETURN` that the board adds.
    fn end(&self) -> Option<Arc<Line>> {
        let last = self.lines.last().filter(|line| line.items.last() != Some(&Item::Return))?;
        Some(Arc::new(Line { items: vec![Item::Return], offset: last.offset + last.words() }))
    }

    /// The program's long words.
    #[must_use]
    pub fn words(&self) -> usize {
        self.words + self.end().map_or(0, |line| line.words())
    }

    /// The number of the line with label `label`; line 0 for label 0 if no line has it.
    #[must_use]
    pub fn label(&self, label: u32) -> Option<u64> {
        let found = self.lines.iter().position(|line| line.items.contains(&Item::Label(label)));
        found.map(|line| line as u64).or((label == 0).then_some(0))
    }

    /// Whether all its blocks are closed.
    #[must_use]
    pub fn is_structured(&self) -> bool {
        let mut tracker = Tracker::default();
        self.lines.iter().all(|line| tracker.line(line).is_ok()) && tracker.depth() == 0
    }
}

/// Which buffer is open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Open {
    /// A motion program.
    Program(u32),
    /// All rotary buffers, for text; on PMAC for binary lines, too.
    Rotary,
    /// All rotary buffers, for binary lines.
    BinaryRotary,
    /// A PLC program.
    Plc(usize),
    /// The kinematic program of the 0-based coordinate system.
    Kinematics {
        /// `OPEN INVERSE`, else `OPEN FORWARD`.
        inverse: bool,
        /// The coordinate system.
        cs: usize,
    },
}

/// A kind of table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TableKind {
    /// `COMP`: leadscrew compensation.
    Leadscrew,
    /// `TCOMP`: torque compensation.
    Torque,
    /// `BLCOMP`: backlash compensation.
    Backlash,
    /// `UBUFFER`.
    User,
    /// `TBUF`: transformation matrices.
    Transformation,
    /// `CCBUF`: cutter compensation.
    Cutter,
    /// `LOOKAHEAD`, which no program here makes use of.
    Lookahead,
}

/// A table, or a buffer without entries of its own.
#[derive(Debug, Clone)]
pub struct Table {
    /// Its kind.
    pub kind: TableKind,
    /// The 0-based motor or coordinate system of the table's definition.
    pub owner: usize,
    /// Entries, or long words.
    pub size: usize,
    /// Its span in counts.
    pub span: f64,
    /// Leadscrew compensation: the 0-based motor whose position selects the entry, and the motor that the table
    /// corrects.
    pub motors: [usize; 2],
    /// Whether the desired position selects the entry, not the actual position.
    pub desired: bool,
    /// The entries made so far.
    pub entries: Vec<f64>,
}

impl Table {
    /// The value for `position` counts from home, interpolated between entries.
    ///
    /// The first entry is for one spacing from zero; the last entry is for the whole span, and so for zero too: the
    /// table repeats beyond its span in both directions. Missing entries are zero.
    #[must_use]
    pub fn at(&self, position: f64) -> f64 {
        if self.span <= 0.0 {
            return 0.0;
        }
        let place = position.rem_euclid(self.span) / self.span * self.size as f64;
        let entry = |k: usize| self.entries.get((k + self.size - 1) % self.size).copied().unwrap_or(0.0);
        let (below, part) = (place.floor() as usize, place.fract());
        entry(below) * (1.0 - part) + entry(below + 1) * part
    }

    /// Whether lines with a constant add entries to the table.
    #[must_use]
    pub fn takes_entries(&self) -> bool {
        matches!(self.kind, TableKind::Leadscrew | TableKind::Torque | TableKind::Backlash)
            && self.entries.len() < self.size
    }
}

/// All buffers.
#[derive(Debug, Clone)]
pub struct Store {
    programs: BTreeMap<u32, Program>,
    plcs: Vec<Program>,
    /// By 0-based coordinate system, and whether the program is the inverse program.
    kinematics: BTreeMap<(usize, bool), Program>,
    /// By 0-based coordinate system; shorter when the last systems have no buffer.
    rotary: Vec<Option<Rotary>>,
    /// The tables, in order of definition.
    pub tables: Vec<Table>,
    open: Option<Open>,
    blocks: Tracker,
}

impl Default for Store {
    fn default() -> Self {
        Self {
            programs: BTreeMap::new(),
            plcs: vec![Program::default(); PLCS],
            kinematics: BTreeMap::new(),
            rotary: Vec::new(),
            tables: Vec::new(),
            open: None,
            blocks: Tracker::default(),
        }
    }
}

impl Store {
    /// The buffers that a reset keeps: fixed programs and tables, no rotary buffer and no lookahead buffer (Turbo
    /// Software Reference p. 315).
    #[must_use]
    pub fn kept(&self) -> Self {
        let mut kept = Self { rotary: Vec::new(), open: None, ..self.clone() };
        kept.tables.retain(|table| table.kind != TableKind::Lookahead);
        kept
    }

    /// The open buffer.
    #[must_use]
    pub fn open(&self) -> Option<Open> {
        self.open
    }

    /// Whether the rotary buffers are open.
    #[must_use]
    pub fn rotary_is_open(&self) -> bool {
        matches!(self.open, Some(Open::Rotary | Open::BinaryRotary))
    }

    /// Opens a buffer.
    ///
    /// # Errors
    /// ERR007 while a buffer is open; ERR003 for rotary buffers when none is defined.
    pub fn open_buffer(&mut self, which: Open) -> Result<()> {
        if self.open.is_some() {
            return Err(CommandError::BUFFER_IN_USE);
        }
        self.blocks = Tracker::default();
        match which {
            Open::Rotary | Open::BinaryRotary if self.rotary.iter().all(Option::is_none) => {
                return Err(CommandError::SYNTAX);
            }
            Open::Rotary | Open::BinaryRotary => {}
            Open::Program(number) => {
                self.programs.entry(number).or_default();
            }
            Open::Plc(_) => {}
            Open::Kinematics { inverse, cs } => {
                self.kinematics.entry((cs, inverse)).or_default();
            }
        }
        self.open = Some(which);
        if let Some(program) = self.open_program() {
            let mut blocks = Tracker::default();
            let _ = program.lines.iter().try_for_each(|line| blocks.line(line));
            self.blocks = blocks;
        }
        Ok(())
    }

    /// Closes the open buffer. An empty program is removed.
    pub fn close(&mut self) {
        if let Some(Open::Program(number)) = self.open.take()
            && self.programs.get(&number).is_some_and(|program| program.lines.is_empty())
        {
            self.programs.remove(&number);
        }
    }

    /// The fixed program that is open.
    #[must_use]
    pub fn open_program(&self) -> Option<&Program> {
        self.fixed(self.open?)
    }

    /// The fixed program `which`.
    #[must_use]
    pub fn fixed(&self, which: Open) -> Option<&Program> {
        match which {
            Open::Program(number) => self.programs.get(&number),
            Open::Plc(number) => self.plcs.get(number),
            Open::Kinematics { inverse, cs } => self.kinematics(cs, inverse),
            Open::Rotary | Open::BinaryRotary => None,
        }
    }

    /// Erases the open buffer; `cs` selects the rotary buffer.
    ///
    /// # Errors
    /// ERR005 without an open buffer.
    pub fn clear(&mut self, cs: usize) -> Result<()> {
        self.blocks = Tracker::default();
        match self.open.ok_or(CommandError::NO_OPEN_BUFFER)? {
            Open::Program(number) => *self.programs.entry(number).or_default() = Program::default(),
            Open::Plc(number) => {
                if let Some(plc) = self.plcs.get_mut(number) {
                    *plc = Program::default();
                }
            }
            Open::Kinematics { inverse, cs } => {
                self.kinematics.insert((cs, inverse), Program::default());
            }
            Open::Rotary | Open::BinaryRotary => {
                self.rotary_mut(cs).ok_or(CommandError::NO_OPEN_BUFFER)?.clear();
            }
        }
        Ok(())
    }

    /// Stores a line in the open buffer, with `free` long words free; `cs` selects the rotary buffer.
    ///
    /// # Errors
    /// ERR005 without a suitable open buffer, ERR006 without room, ERR009 for the end of a block that was not begun.
    pub fn append(&mut self, cs: usize, items: Vec<Item>, free: i64) -> Result<()> {
        let open = self.open.ok_or(CommandError::NO_OPEN_BUFFER)?;
        if open == Open::Rotary {
            return self.rotary_mut(cs).ok_or(CommandError::NO_OPEN_BUFFER)?.append(items);
        }
        let program = match open {
            Open::Program(number) => self.programs.get_mut(&number),
            Open::Plc(number) => self.plcs.get_mut(number),
            Open::Kinematics { inverse, cs } => self.kinematics.get_mut(&(cs, inverse)),
            Open::Rotary | Open::BinaryRotary => None,
        };
        let program = program.ok_or(CommandError::NO_OPEN_BUFFER)?;
        let line = Line { items, offset: program.words };
        let words = line.words();
        if words as i64 > free {
            return Err(CommandError::NO_ROOM);
        }
        let mut blocks = self.blocks.clone();
        blocks.line(&line).map_err(|_| CommandError::STRUCTURE)?;
        self.blocks = blocks;
        program.words += words;
        program.lines.push(Arc::new(line));
        Ok(())
    }

    /// Motion program `number`.
    #[must_use]
    pub fn program(&self, number: u32) -> Option<&Program> {
        self.programs.get(&number)
    }

    /// PLC program `number`; empty when no user has entered it.
    #[must_use]
    pub fn plc(&self, number: usize) -> Option<&Program> {
        self.plcs.get(number)
    }

    /// The inverse or the forward kinematic program of the 0-based `cs`.
    #[must_use]
    pub fn kinematics(&self, cs: usize, inverse: bool) -> Option<&Program> {
        self.kinematics.get(&(cs, inverse))
    }

    /// The rotary buffer of the 0-based `cs`.
    #[must_use]
    pub fn rotary(&self, cs: usize) -> Option<&Rotary> {
        self.rotary.get(cs)?.as_ref()
    }

    /// The rotary buffer of the 0-based `cs`.
    pub fn rotary_mut(&mut self, cs: usize) -> Option<&mut Rotary> {
        self.rotary.get_mut(cs)?.as_mut()
    }

    /// Whether a coordinate system before the 0-based `cs` has a lookahead buffer.
    #[must_use]
    pub fn has_lookahead_before(&self, cs: usize) -> bool {
        self.tables.iter().any(|table| table.kind == TableKind::Lookahead && table.owner < cs)
    }

    /// Whether a coordinate system before the 0-based `cs` has a rotary buffer.
    #[must_use]
    pub fn has_rotary_before(&self, cs: usize) -> bool {
        self.rotary.iter().take(cs).any(Option::is_some)
    }

    /// `DEFINE ROT`; the highest coordinate system must come first.
    ///
    /// # Errors
    /// ERR003 for no words, or when the buffer of this or of a lower coordinate system is defined; ERR006 without room;
    /// ERR007 while the rotary buffers are open.
    pub fn define_rotary(&mut self, cs: usize, words: usize, free: i64) -> Result<()> {
        if self.rotary_is_open() {
            return Err(CommandError::BUFFER_IN_USE);
        }
        if words == 0 || self.has_rotary_before(cs + 1) {
            return Err(CommandError::SYNTAX);
        }
        if words as i64 > free {
            return Err(CommandError::NO_ROOM);
        }
        self.rotary.resize(self.rotary.len().max(cs + 1), None);
        self.rotary[cs] = Some(Rotary::new(words));
        Ok(())
    }

    /// Whether a buffer is open that takes the statements of a line.
    #[must_use]
    pub fn takes_text(&self) -> bool {
        !matches!(self.open, None | Some(Open::BinaryRotary))
    }

    /// `DELETE ROT`: the buffer of a higher coordinate system keeps its place.
    ///
    /// # Errors
    /// ERR003 without such a buffer, ERR007 while the rotary buffers are open.
    pub fn delete_rotary(&mut self, cs: usize) -> Result<()> {
        if self.rotary_is_open() {
            return Err(CommandError::BUFFER_IN_USE);
        }
        self.rotary.get_mut(cs).and_then(Option::take).map(|_| ()).ok_or(CommandError::SYNTAX)
    }

    /// `DELETE ALL`: rotary buffers and tables.
    pub fn delete_all(&mut self) {
        self.rotary.clear();
        self.tables.clear();
    }

    /// Long words of all buffers.
    #[must_use]
    pub fn words(&self) -> usize {
        let fixed: usize = self
            .programs
            .values()
            .chain(&self.plcs)
            .chain(self.kinematics.values())
            .map(Program::words)
            .sum();
        let rotary: usize = self.rotary.iter().flatten().map(|rotary| rotary.size).sum();
        fixed + rotary + self.tables.iter().map(|table| table.size).sum::<usize>()
    }
}
