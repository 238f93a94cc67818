//! The place that an M-variable points to, in any spelling of its definition (Software Reference p. 253).

use super::{Space, number};

/// The bits of a word of PMAC.
const WORD_BITS: u32 = 24;
/// The arguments of a thumbwheel multiplexer: its address, offset and size.
const THUMBWHEEL_ARGUMENTS: usize = 3;

/// The definition of an M-variable.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MDefinition {
    /// `*`: nowhere; the variable itself holds its value.
    Nowhere,
    /// Bits of an X or Y word: `X:$C003,8,16,S`, `Y:$FFC2,0`, `X:$C001,24`.
    Field {
        /// The half.
        space: Space,
        /// Its address.
        address: u32,
        /// The lowest bit.
        offset: u32,
        /// How many bits.
        width: u32,
        /// How to read the bits; `U` if the definition says nothing.
        format: char,
    },
    /// A whole register: `D:$28`, `L:$1000`, `F:$D210`, `DP:$D200`.
    Register {
        /// The space, which says how to read it.
        space: Space,
        /// Its address.
        address: u32,
    },
    /// Inputs behind the thumbwheel multiplexer: `TWD:4,0.8,U`.
    Thumbwheel {
        /// `B`, `D`, `R` or `S`.
        kind: char,
        /// The numbers after the colon.
        arguments: [Option<f64>; THUMBWHEEL_ARGUMENTS],
        /// How to read the bits; `U` if the definition says nothing.
        format: char,
    },
}

impl MDefinition {
    /// The definition that `text` spells; `None` for anything else.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let plain: String = text.chars().filter(|c| *c != ' ').map(|c| c.to_ascii_uppercase()).collect();
        if plain == "*" {
            return Some(Self::Nowhere);
        }
        let end = plain.find(|c: char| !c.is_ascii_alphabetic())?;
        let (name, rest) = plain.split_at(end);
        let mut arguments = rest.strip_prefix(':').unwrap_or(rest).split(',');
        if let Some(kind) = name.strip_prefix("TW") {
            return thumbwheel(kind, arguments);
        }
        let space = Space::ALL.into_iter().find(|space| space.name() == name)?;
        let address = number::parse(arguments.next()?).ok()?;
        if !matches!(space, Space::X | Space::Y) {
            return arguments.next().is_none().then_some(Self::Register { space, address });
        }
        let mut bits = || arguments.next().map_or(Some(None), |text| number::parse(text).ok().map(Some));
        let (offset, width) = match bits()?.unwrap_or(0) {
            WORD_BITS => (0, WORD_BITS),
            offset => (offset, bits()?.unwrap_or(1)),
        };
        let format = format(arguments.next())?;
        arguments.next().is_none().then_some(Self::Field { space, address, offset, width, format })
    }
}

/// The letter after a field that says how to read it.
fn format(text: Option<&str>) -> Option<char> {
    match text {
        None => Some('U'),
        Some(text @ ("U" | "S" | "D" | "C")) => text.chars().next(),
        Some(_) => None,
    }
}

fn thumbwheel<'t>(kind: &str, texts: impl Iterator<Item = &'t str>) -> Option<MDefinition> {
    let kind = kind.chars().next().filter(|letter| kind.len() == 1 && "BDRS".contains(*letter))?;
    let mut texts = texts.peekable();
    let mut arguments = [None; THUMBWHEEL_ARGUMENTS];
    for argument in &mut arguments {
        *argument = texts
            .next_if(|text| text.starts_with(|c: char| c.is_ascii_digit()))
            .map(str::parse)
            .transpose()
            .ok()?;
    }
    let format = format(texts.next())?;
    (arguments[0].is_some() && texts.next().is_none()).then_some(MDefinition::Thumbwheel {
        kind,
        arguments,
        format,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_spelling_of_a_definition_is_that_definition() {
        for (typed, listed) in [
            ("X:$000000,0,24,U", "X:$0,24"),
            ("Y:$078402,8,1", "Y:$78402,8"),
            ("D:$000088", "D:$88"),
            ("y $ffc2", "Y:$FFC2,0,1,U"),
            ("X:$C001,24,S", "x:$c001,0,24,s"),
            ("Y:49152,0,4,D", "Y:$C000,0,4,D"),
            ("DP:$060080", "DP:$60080"),
            ("X$0806,24", "X:$806,24"),
            ("TWD:4,0.80,U", "TWD:4,0.8"),
            ("*", " * "),
        ] {
            let definition = MDefinition::parse(typed);
            assert!(definition.is_some(), "{typed}");
            assert_eq!(definition, MDefinition::parse(listed), "{typed}");
        }
    }

    #[test]
    fn other_definitions_are_others_and_what_is_none_is_told() {
        for (one, other) in [
            ("X:$C003,8,16,S", "X:$C003,8,16"),
            ("X:$C003,8", "Y:$C003,8"),
            ("X:$C003,0,16", "X:$C003,24"),
            ("D:$88", "L:$88"),
            ("TWS:1", "TWB:1"),
        ] {
            assert_ne!(MDefinition::parse(one), MDefinition::parse(other), "{one}");
        }
        for text in [
            "",
            "X",
            "X:",
            "Z:$88",
            "X:$C003,8,16,S,1",
            "L:$88,1",
            "X:$C003,8,Q",
            "TW:1",
            "TWX:1",
            "TWS:",
            "**",
        ] {
            assert_eq!(MDefinition::parse(text), None, "{text}");
        }
    }
}
