//! The automatic functions that the background pass serves by flags in the DPRAM: control panel, variable read, variable
//! write, binary rotary transfer; and who has which stretch of the open part.

use super::board::Board;
use super::claims::Claims;
use super::panel::Panel;
use super::rotary_transfer::RotaryTransfer;
use super::variable_read::VariableRead;
use super::variable_write::VariableWrite;

/// What the functions remember from pass to pass.
#[derive(Debug, Clone, Default)]
pub struct Functions {
    /// The control panel.
    pub panel: Panel,
    /// The background variable read.
    pub variable_read: VariableRead,
    /// The background variable write.
    pub variable_write: VariableWrite,
    /// The first and the second binary rotary buffer.
    pub rotary: [RotaryTransfer; 2],
    claims: Claims,
}

/// One background pass.
pub fn poll(board: &mut Board) {
    let mut functions = std::mem::take(&mut board.functions);
    functions.panel.poll(board);
    functions.variable_write.poll(board);
    if !board.watchdog {
        functions.variable_read.poll(board);
        for (number, rotary) in functions.rotary.iter_mut().enumerate() {
            rotary.poll(number, board);
        }
        let spans = [
            ("the variable read table", functions.variable_read.span()),
            ("the variable write records", functions.variable_write.span()),
            ("the first rotary buffer", functions.rotary[0].span()),
            ("the second rotary buffer", functions.rotary[1].span()),
        ];
        functions.claims.poll(&spans, board);
    }
    board.functions = functions;
}
