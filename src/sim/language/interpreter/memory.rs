//! Memory commands: `RX`, `RHX`, `WX` and the like.

use crate::format::{fixed48, int24};
use crate::sim::board::error::CommandError;
use crate::sim::language::interpreter::Line;
use crate::sim::language::reply::Outcome;
use crate::sim::language::scanner::{HEX_24, HEX_48};
use crate::sim::language::words::{Form, Space};

/// Most words of one read command.
const LONGEST_READ: usize = 16;

impl Line<'_, '_> {
    pub(super) fn read_memory(&mut self, form: Form) -> Outcome {
        let address = self.memory_address()?;
        let count = if self.scanner.take(b',') { self.scanner.integer()? } else { 1 };
        if !(1..=LONGEST_READ).contains(&count) {
            return Err(CommandError::SYNTAX);
        }
        let values = self.addresses(address, count)?.map(|address| self.register_text(form, address));
        let text = values.collect::<Vec<_>>().join(" ");
        self.answer(text)
    }

    pub(super) fn write_memory(&mut self, space: Space) -> Outcome {
        let address = self.memory_address()?;
        let hex_digits = if space == Space::L { HEX_48 } else { HEX_24 };
        let mut values = Vec::new();
        while self.scanner.take(b',') {
            values.push(self.scanner.register(hex_digits)?);
        }
        if values.is_empty() {
            return Err(CommandError::SYNTAX);
        }
        let addresses = self.addresses(address, values.len())?;
        for (address, value) in addresses.zip(values) {
            let memory = &mut self.board.memory;
            let [y, x] = fixed48::encode(value).map(|word| word & int24::MASK);
            match space {
                Space::X => memory.write_x(address, y),
                Space::Y => memory.write_y(address, y),
                Space::L => {
                    memory.write_y(address, y);
                    memory.write_x(address, x);
                }
                Space::Program => continue,
            }
            self.board.register_written(address);
        }
        Ok(())
    }

    /// The address after the command word, with an optional colon before it.
    fn memory_address(&mut self) -> Result<u32, CommandError> {
        self.scanner.take(b':');
        let last = self.board.family().last_address();
        self.scanner.address(last)
    }

    /// `count` addresses from `first` on.
    fn addresses(&self, first: u32, count: usize) -> Result<impl Iterator<Item = u32> + use<>, CommandError> {
        let last = self.board.family().last_address();
        let end = first as usize + count;
        if end > last as usize + 1 { Err(CommandError::SYNTAX) } else { Ok((first..=last).take(count)) }
    }

    fn register_text(&self, form: Form, address: u32) -> String {
        let memory = &self.board.memory;
        let (y, x) = (memory.read_y(address) & int24::MASK, memory.read_x(address) & int24::MASK);
        match (form.space, form.hex) {
            (Space::Program, _) => String::new(),
            (Space::X, true) => format!("{x:06X}"),
            (Space::Y, true) => format!("{y:06X}"),
            (Space::L, true) => format!("{x:06X}{y:06X}"),
            (Space::X, false) => int24::signed(x).to_string(),
            (Space::Y, false) => int24::signed(y).to_string(),
            (Space::L, false) => fixed48::decode(y, x).to_string(),
        }
    }
}
