//! Commands to MACRO stations: `MS`, `MSR`, `MSW`.

use crate::sim::board::number::decimal;
use crate::sim::language::interpreter::Line;
use crate::sim::language::reply::Outcome;
use crate::sim::language::scanner::HEX_48;
use crate::sim::language::station;

impl Line<'_, '_> {
    /// `MS0,I996` reports, `MS0,I996=$0FB333` sets; a value has up to 48 bits. `MSSAVE0` and the like are carried out.
    pub(super) fn station(&mut self) -> Outcome {
        if let Some(command) = station::command(&mut self.scanner) {
            let node = station::node(&mut self.scanner)?;
            return self.board.command_station(command, node);
        }
        let variable = station::variable(&mut self.scanner)?;
        if self.scanner.take(b'=') {
            let value = self.scanner.register(HEX_48)?;
            return self.board.set_station_variable(variable, value as f64);
        }
        let value = self.board.station_variable(variable)?;
        // The board does not know a station's variables one by one: it lists all of them as I9 lists addresses. A
        // driver in use (DiamondLightSource/pmac) takes `$` before each value.
        let text = if self.board.variables.hex_listing() {
            format!("${:X}", value as i64 & 0xFFFF_FFFF_FFFF)
        } else {
            decimal(value, self.board.variables.tables().decimals)
        };
        self.answer(text)
    }

    /// `MSR0,MI4,P1`, `MSW16,MI124,P1`.
    pub(super) fn station_transfer(&mut self, write: bool) -> Outcome {
        let transfer = station::operands(&mut self.scanner, self.board, write)?;
        let cs = self.interpreter.cs;
        self.board.transfer(&transfer, cs)
    }
}
