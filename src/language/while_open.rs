//! How the board treats a line while a program buffer is open.

use super::command::{Does, Kind, Token};

/// The effects of a line while a program buffer is open. `J+` and similar commands are on-line only, and "cannot be
/// entered into a program buffer" (User Manual p. 29): the board carries them out at once, as it does `&1R` (Software
/// Reference p. 273).
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct WhileOpen {
    /// A part of the line is a statement of a program, or may be one.
    pub enters: bool,
    /// The line opens, closes, empties or adds to program buffers.
    pub changes: bool,
    /// The board carries out a command of the line at once.
    pub acts: bool,
    /// The board may do so: no manual says how it treats the command.
    pub may_act: bool,
}

impl WhileOpen {
    /// Whether the line leaves the program buffers alone.
    #[must_use]
    pub const fn passes(self) -> bool {
        !self.enters && !self.changes
    }

    /// Adds the command `token` of `line`.
    pub(super) fn add(&mut self, line: &[u8], token: &Token) {
        let said = &line[token.span.clone()];
        let behind = line[token.span.end..].trim_ascii_start().first().copied().unwrap_or(b' ');
        // `R5`, `HM1`: a program's letter or word has a number behind it, an on-line command's has none.
        let has_number = said[0].is_ascii_alphabetic() && b"0123456789.($-+".contains(&behind);
        match token.kind {
            Kind::Motor(_) | Kind::System(_) | Kind::AxisOf(_) | Kind::Group(..) | Kind::Version => {}
            Kind::Asks(_) | Kind::Lists(_) => self.enters |= has_number && said.len() <= 2,
            Kind::Variables(_, _, Does::Defines) => self.may_act = true,
            // `M1->`, too: `M1` alone is a statement, and no manual says how the board treats the arrow behind it.
            Kind::Variables(..)
            | Kind::Statement(_)
            | Kind::StartsPlcs
            | Kind::StationSaves
            | Kind::Quoted
            | Kind::Unknown => {
                self.enters = true;
            }
            Kind::Buffer(_) | Kind::Clears | Kind::Learns => self.changes = true,
            // A sign alone jogs; a sign with a number is a vector.
            Kind::Moves(_, b'+' | b'-') if has_number => self.enters = true,
            Kind::Moves(_, b'+' | b'-' | b'!' | b'=' | b':' | b'^') => self.acts = true,
            Kind::Moves(_, b'/') if said.len() > 1 => self.acts = true,
            Kind::Moves(_, b'B') => self.enters = true,
            Kind::Moves(_, b'$') if line.get(token.span.end).is_some_and(u8::is_ascii_hexdigit) => {
                self.enters = true;
            }
            Kind::Moves(_, letter) if has_number && letter != b'O' => self.enters = true,
            Kind::Moves(_, b'R') => self.acts = true,
            _ => self.may_act = true,
        }
    }
}
