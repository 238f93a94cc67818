//! The block structure of `IF`, `ELSE`, `ENDIF`, `WHILE` and `ENDWHILE` (Software Reference, program commands).
//!
//! An `IF` or `ELSE` with statements behind it on its line governs only that line and has no `ENDIF`; an `IF` or `ELSE`
//! at the end of its line opens a block. An `ELSE` may follow the line of such a short `IF`. Lines with `AND` or `OR`
//! continue the condition of the line above that opens a block.

use crate::sim::program::item::{Item, Line};

/// ENDIF, ELSE or ENDWHILE without a matching begin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unmatched;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Block {
    If,
    Else,
    While,
}

/// The effect of an item on the blocks around it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effect {
    /// No effect, or the item opens a block.
    None,
    /// The item is the `ELSE` of the innermost block.
    Else,
    /// The item ends the innermost block.
    Ends,
}

/// The blocks open at a place in a program.
#[derive(Debug, Clone, Default)]
pub struct Tracker {
    blocks: Vec<Block>,
    /// The last line was a short `IF`.
    after_short_if: bool,
    short_if: bool,
    /// The line before ends with a condition, so that this line may continue the condition.
    after_condition: bool,
    condition: bool,
}

impl Tracker {
    /// The state after the line of an `IF` that opens a block.
    #[must_use]
    pub fn in_if() -> Self {
        Self { blocks: vec![Block::If], condition: true, ..Self::default() }
    }

    /// The state after the line of a `WHILE` that opens a block.
    #[must_use]
    pub fn in_while() -> Self {
        Self { blocks: vec![Block::While], condition: true, ..Self::default() }
    }

    /// How many blocks are open.
    #[must_use]
    pub fn depth(&self) -> usize {
        self.blocks.len()
    }

    /// Processes item `index` of `line`.
    ///
    /// # Errors
    /// [`Unmatched`].
    pub fn item(&mut self, line: &Line, index: usize) -> Result<Effect, Unmatched> {
        if index == 0 {
            self.after_short_if = std::mem::take(&mut self.short_if);
            self.after_condition = std::mem::take(&mut self.condition);
        }
        let last = index + 1 == line.items.len();
        self.condition =
            last && matches!(line.items.get(index), Some(Item::If(_) | Item::While(_) | Item::Also(..)));
        let top = self.blocks.last().copied();
        match line.items.get(index) {
            Some(Item::If(_)) if last => self.blocks.push(Block::If),
            Some(Item::If(_)) => self.short_if = true,
            Some(Item::While(_)) if last => self.blocks.push(Block::While),
            Some(Item::Also(..)) if index == 0 && self.after_condition => {}
            Some(Item::Also(..)) => return Err(Unmatched),
            Some(Item::Else) if index == 0 && self.after_short_if => {
                self.blocks.extend(last.then_some(Block::Else));
            }
            Some(Item::Else) => {
                if top != Some(Block::If) {
                    return Err(Unmatched);
                }
                self.blocks.pop();
                if last {
                    self.blocks.push(Block::Else);
                }
                return Ok(Effect::Else);
            }
            Some(Item::EndIf) => {
                if !matches!(top, Some(Block::If | Block::Else)) {
                    return Err(Unmatched);
                }
                self.blocks.pop();
                return Ok(Effect::Ends);
            }
            Some(Item::EndWhile) => {
                if top != Some(Block::While) {
                    return Err(Unmatched);
                }
                self.blocks.pop();
                return Ok(Effect::Ends);
            }
            _ => {}
        }
        Ok(Effect::None)
    }

    /// Processes a whole line.
    ///
    /// # Errors
    /// [`Unmatched`].
    pub fn line(&mut self, line: &Line) -> Result<(), Unmatched> {
        (0..line.items.len()).try_for_each(|index| self.item(line, index).map(|_| ()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(lines: &[&[Item]]) -> Result<usize, Unmatched> {
        let mut tracker = Tracker::default();
        for items in lines {
            tracker.line(&Line { items: items.to_vec(), offset: 0 })?;
        }
        Ok(tracker.depth())
    }

    #[test]
    fn blocks_and_short_forms() {
        let condition = || Item::If("P1=1".into());
        let stop = || Item::Stop;
        assert_eq!(check(&[&[condition()], &[stop()], &[Item::Else], &[Item::EndIf]]), Ok(0));
        assert_eq!(check(&[&[condition(), stop()], &[Item::Else, stop()]]), Ok(0));
        assert_eq!(check(&[&[condition()], &[condition(), stop()], &[Item::EndIf]]), Ok(0));
        assert_eq!(check(&[&[condition()], &[Item::While("P1<2".into())], &[Item::EndWhile]]), Ok(1));
        assert_eq!(check(&[&[condition()], &[Item::Else, stop()]]), Ok(0));
        for wrong in [Item::EndIf, Item::Else, Item::EndWhile] {
            assert_eq!(check(&[&[wrong]]), Err(Unmatched));
        }
        assert_eq!(check(&[&[Item::While("P1<2".into())], &[Item::EndIf]]), Err(Unmatched));
        assert_eq!(check(&[&[condition(), stop()], &[stop()], &[Item::Else]]), Err(Unmatched));
    }
}
