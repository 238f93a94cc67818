//! Lines for an open buffer: the board collects the statements of a line and stores them as one program line at its
//! end.
//!
//! The board executes every other command at once, as without a buffer (User Manual p. 29; Software Reference p. 273).

use crate::sim::board::error::CommandError;
use crate::sim::language::interpreter::Line;
use crate::sim::language::reply::Outcome;
use crate::sim::program::item::Item;
use crate::sim::program::parse::{self, BufferKind};
use crate::sim::program::store::{Open, TableKind};

impl Line<'_, '_> {
    /// Takes a program statement if a buffer is open for it; returns whether it took a statement.
    pub(super) fn program_statement(&mut self) -> Result<bool, CommandError> {
        let kind = match self.programs.store.open() {
            // While binary lines come in, no text enters (Software Reference p. 271).
            None | Some(Open::BinaryRotary) => return Ok(false),
            Some(Open::Program(_)) => BufferKind::Motion,
            Some(Open::Rotary) => BufferKind::Rotary,
            Some(Open::Plc(_) | Open::Kinematics { .. }) => BufferKind::Plc,
        };
        let Some(item) = parse::item(&mut self.scanner, self.board, kind)? else { return Ok(false) };
        if kind == BufferKind::Rotary && self.programs.store.rotary(self.interpreter.cs).is_none() {
            return Err(CommandError::NO_OPEN_BUFFER);
        }
        self.items.push(item);
        Ok(true)
    }

    /// Stores the statements collected so far as a program line.
    pub(super) fn store_items(&mut self) -> Outcome {
        if self.items.is_empty() {
            return Ok(());
        }
        let mut items = std::mem::take(&mut self.items);
        let cs = self.interpreter.cs;
        // The board lists a loop on one line, `WHILE(…) ENDWHILE`, as two lines.
        while let Some(end) =
            items.windows(2).position(|pair| matches!(pair, [Item::While(_), Item::EndWhile]))
        {
            let rest = items.split_off(end + 1);
            let free = self.programs.free_memory(self.board);
            self.programs.store.append(cs, std::mem::replace(&mut items, rest), free)?;
        }
        let free = self.programs.free_memory(self.board);
        self.programs.store.append(cs, items, free)?;
        if self.programs.store.rotary_is_open() {
            self.programs.note_rotary(self.board, cs);
        }
        Ok(())
    }

    /// Enters `value` in the table that is not full; returns whether such a table is open.
    pub(super) fn table_entry(&mut self, value: f64) -> bool {
        let tables = &mut self.programs.store.tables;
        let open = tables.iter_mut().rev().find(|table| table.takes_entries());
        if let Some(table) = open {
            table.entries.push(value);
            return true;
        }
        false
    }

    /// The table of `kind` of the addressed motor.
    pub(super) fn table(&self, kind: TableKind) -> Option<&crate::sim::program::store::Table> {
        let tables = &self.programs.store.tables;
        tables.iter().find(|table| table.kind == kind && table.owner == self.interpreter.motor)
    }
}
