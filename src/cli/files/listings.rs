//! Readings of a board other than its variables: variables of MACRO stations, axis definitions, and programs as the
//! board lists them.

use std::collections::BTreeMap;

use super::sequence::{ask, try_ask};
use super::settings_file::{Item, keep_address, read_variables};
use crate::cli::context::Failure;
use crate::client::command::lines::LineSequence;

/// How many axis definitions to ask for in one question.
const AXES_A_LINE: usize = 16;
/// The board's error for a program that it does not have.
const MISSING: u16 = 3;
/// ERR002: the board's password protects the program (Software Reference p. 25).
const PROTECTED: u16 = 2;

/// Reads `items`, variables and others.
///
/// # Errors
/// The board refuses a question or gives an unexpected answer.
pub fn read(
    sequence: &mut LineSequence<'_>,
    items: impl IntoIterator<Item = Item>,
) -> Result<BTreeMap<Item, String>, Failure> {
    let mut items: Vec<Item> = items.into_iter().collect();
    items.sort_unstable();
    items.dedup();
    keep_address(sequence, items.iter().copied())?;
    let is_variable = |item: &Item| !item.is_axis() && !item.is_program() && !item.is_of_station();
    let (variables, others): (Vec<Item>, Vec<Item>) = items.into_iter().partition(is_variable);
    let mut held = read_variables(sequence, &variables)?;
    held.extend(read_others(sequence, &others)?);
    Ok(held)
}

/// Reads `items`, which are sorted and no variables of the board. A program that the board does not have reads as
/// empty; a station's variable is absent if the board does not tell it. The sequence must go on after a line that the
/// board refuses.
///
/// # Errors
/// The board keeps a program under its password, refuses a question for another reason, or gives an unexpected answer.
fn read_others(sequence: &mut LineSequence<'_>, items: &[Item]) -> Result<BTreeMap<Item, String>, Failure> {
    let (axes, others): (Vec<Item>, Vec<Item>) = items.iter().partition(|item| item.is_axis());
    let mut held = BTreeMap::new();
    for of_system in axes.chunk_by(|one, other| one.system() == other.system()) {
        for some in of_system.chunks(AXES_A_LINE) {
            let questions: Vec<String> = some.iter().map(|item| format!("{}->", item.short())).collect();
            let system = some.first().and_then(|item| item.system()).unwrap_or(1);
            let line = format!("&{system}{}", questions.join(" "));
            let replies = ask(sequence, &[&line])?.into_iter().flatten().collect::<Vec<_>>();
            if replies.len() != some.len() {
                let (wanted, got) = (some.len(), replies.len());
                return Err(Failure::Refused(format!(
                    "{line}: the board answered {got} lines instead of {wanted}"
                )));
            }
            held.extend(some.iter().zip(replies).map(|(item, line)| (*item, item.told(&line))));
        }
    }
    let lines: Vec<String> = others.iter().map(|item| item.own_question()).collect();
    for (item, reply) in others.into_iter().zip(try_ask(sequence, &lines)?) {
        let text = match reply {
            Ok(lines) if item.is_of_station() => item.told(&lines.join(" ")),
            Err(_) if item.is_of_station() => continue,
            Ok(lines) => lines.join("\n"),
            Err(failure) if failure.code == Some(MISSING) => String::new(),
            Err(failure) if failure.code == Some(PROTECTED) => {
                return Err(Failure::Refused(format!(
                    "the board's password protects {item}, which cannot be listed: give it first (pmacctl terminal, \
                     PASSWORD=...), or leave the programs out (--what I,P,Q,M,AXES)"
                )));
            }
            Err(failure) => return Err(Failure::Refused(format!("{item}: {}", failure.message))),
        };
        held.insert(item, text);
    }
    Ok(held)
}
