//! The function that uses a word of the DPRAM, and the place that an M-variable points to.

use super::functions::rotary_header;
use super::{AddressError, BufferLayout, Family, Function, Generation, HostOffset, Owner, TypedAddress};

/// 16-bit words of a rotary header.
const ROTARY_HEADER_WORDS: usize = rotary_header::START + 1;

/// The function that uses the word at `offset`: the words with a fixed place, the headers of the buffers, and the
/// buffers. `None`: no function, or outside the DPRAM.
#[must_use]
pub fn function_of(layout: &BufferLayout, offset: HostOffset) -> Option<Function> {
    match layout.classify(offset)? {
        Owner::Fixed(region) => Function::ALL
            .into_iter()
            .find(|function| region.name.starts_with(function.name()))
            .or_else(|| function_of_header(layout.family(), offset)),
        Owner::Buffer(region) => match region.name {
            "gather" => Some(Function::Gather),
            name if name.starts_with("rotary") => Some(Function::Rotary),
            _ => Some(Function::Variables),
        },
        Owner::Firmware(_) => Some(Function::Gather),
        Owner::User => None,
    }
}

fn function_of_header(family: &Family, offset: HostOffset) -> Option<Function> {
    let (read, write) = (&family.variable_read, &family.variable_write);
    let read = [read.ready.word, read.multi_user.word, read.timer, read.count, read.start];
    let is_in = |header: &HostOffset| (*header..header.plus_words(ROTARY_HEADER_WORDS)).contains(&offset);
    if read.contains(&offset) || [write.count, write.start].contains(&offset) {
        Some(Function::Variables)
    } else if [family.gather.size, family.gather.index].contains(&offset) {
        Some(Function::Gather)
    } else {
        family.rotary.headers.iter().any(is_in).then_some(Function::Rotary)
    }
}

/// How many M-variables a board of `family` has, from M0 on (User Manual p. 148; Turbo User Manual p. 243).
#[must_use]
pub const fn m_variables(family: &Family) -> u16 {
    match family.generation {
        Generation::Pmac => 1024,
        Generation::Turbo => 8192,
    }
}

/// The place that an M-variable points to, by the board's answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Definition {
    /// To this place in the DPRAM.
    Dpram(TypedAddress),
    /// Elsewhere, or nowhere (`*`).
    Elsewhere,
}

/// The place of M-variable `number` of a board of `family` by `text`, the board's line about it: `X:$060100,0,16,S`,
/// `DP:$060080`, `*`, or, while I9 is odd, `M11->Y:$FFC2,0` (Software Reference p. 253). `None` for another variable's
/// line, or a text without a definition.
#[must_use]
pub fn definition(text: &str, number: u16, family: &Family) -> Option<Definition> {
    let text = match text.split_once("->") {
        None => text.trim(),
        Some((name, text)) => {
            let told = name.trim().strip_prefix(['M', 'm'])?.parse();
            (told == Ok(number)).then_some(text.trim())?
        }
    };
    // `TWD:4,0.8,U`: inputs behind a multiplexer.
    let is_thumbwheel = text.get(..2).is_some_and(|kind| kind.eq_ignore_ascii_case("TW"));
    if text == "*" || is_thumbwheel {
        return Some(Definition::Elsewhere);
    }
    match TypedAddress::parse(text.split(',').next()?, family) {
        Ok(place) => Some(Definition::Dpram(place)),
        Err(AddressError::Outside { .. }) => Some(Definition::Elsewhere),
        Err(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::{BufferSettings, Layout, PMAC, TURBO2};

    fn user_of(family: &'static Family, place: &str) -> Option<Function> {
        let settings = BufferSettings::default().of(family);
        let layout = BufferLayout::new(&Layout::new(family, None), &settings).unwrap();
        match definition(place, 7, family)? {
            Definition::Dpram(place) => function_of(&layout, place.offset),
            Definition::Elsewhere => None,
        }
    }

    #[test]
    fn each_word_has_the_function_that_uses_it() {
        use Function::{Ascii, Background, Gather, Panel, Rotary, Servo, Variables};
        for (place, function) in [
            ("Y:$D000,8,1", Panel),
            ("DP:$D012", Servo),
            ("Y:$D08A", Background),
            ("Y:$D18B", Ascii),
            ("X:$D1B4", Ascii),
            ("Y:$D1FB,0,16", Variables),
            ("Y:$D1F7", Rotary),
            ("Y:$D1FF,0,8", Gather),
            ("DP:$D200", Gather),
            ("F:$DFF0", Rotary),
        ] {
            assert_eq!(user_of(&PMAC, place), Some(function), "{place}");
        }
        for place in ["DP:$D800", "*", "X:$C000,0", "Y:$CFFF"] {
            assert_eq!(user_of(&PMAC, place), None, "{place}");
        }
        // Words of a site in the motor report (`M211` of ls-cat-org/pgpmac), and a site's buffer of 500 floating-point values.
        assert_eq!(user_of(&TURBO2, "DP:$060080"), Some(Servo));
        assert_eq!(user_of(&TURBO2, "Y:$060450"), Some(Gather));
    }

    #[test]
    fn a_definition_is_read_in_both_forms_and_what_is_none_does_not_tell() {
        let place = |text| match definition(text, 11, &TURBO2) {
            Some(Definition::Dpram(at)) => Some(TURBO2.print_half(at.offset)),
            Some(Definition::Elsewhere) => Some("elsewhere".to_owned()),
            None => None,
        };
        for text in ["DP:$60080", "M11->DP:$60080", " m11 -> dp:$060080 ", "Y:$60080,0,16,S"] {
            assert_eq!(place(text).as_deref(), Some("Y:$060080"), "{text}");
        }
        for text in ["*", "M11->*", "X:$78000,24", "X:$FFFF8C,0,16", "TWD:4,0.8,U", "M11->L:$10F0"] {
            assert_eq!(place(text).as_deref(), Some("elsewhere"), "{text}");
        }
        for text in ["M12->DP:$60080", "M12->*", "", "->*", "7", "I10=5", "DP:", "DP:$6008G", "ERR003"] {
            assert_eq!(place(text), None, "{text}");
        }
    }
}
