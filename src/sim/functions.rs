//! The automatic functions that the background pass serves by flags in the DPRAM: control panel, variable read, variable
//! write, binary rotary transfer; and who has which stretch of the open part.

use super::claims::Claims;
use super::machine::Machine;
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
pub fn pass(machine: &mut Machine) {
    let mut functions = std::mem::take(&mut machine.functions);
    functions.panel.pass(machine);
    functions.variable_write.pass(machine);
    if !machine.watchdog {
        functions.variable_read.pass(machine);
        for (number, rotary) in functions.rotary.iter_mut().enumerate() {
            rotary.pass(number, machine);
        }
        let spans = [
            ("the variable read table", functions.variable_read.span()),
            ("the variable write records", functions.variable_write.span()),
            ("the first rotary buffer", functions.rotary[0].span()),
            ("the second rotary buffer", functions.rotary[1].span()),
        ];
        functions.claims.pass(&spans, machine);
    }
    machine.functions = functions;
}
