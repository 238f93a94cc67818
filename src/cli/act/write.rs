//! `pmacctl write`: writes words of the DPRAM that no automatic function uses, or with `--engineer` any word.

use clap::Args;
use serde::Serialize;

use crate::cli::context::{Context, Failure, Verdict};
use crate::format::{float32, split32};
use crate::map::{BitField, Family, Field, HostOffset, Space};
use crate::protocol::READ_MAX;

/// The most words in one write.
const WORDS_MAX: usize = READ_MAX;

/// `write`.
#[derive(Debug, Args)]
pub struct Write {
    /// Y:$D800, X:$D800, DP:$D801, F:$D802, bits as Y:$D800,8,4 (lowest bit, width), or a host offset 0x2000
    #[arg(value_name = "ADDR")]
    pub address: String,
    /// The value, decimal or $hexadecimal; further values go to the following addresses of the same kind
    #[arg(value_name = "VALUE", required = true, allow_negative_numbers = true)]
    pub values: Vec<String>,
    /// Also write words that an automatic function owns. You answer for the result
    #[arg(long)]
    pub engineer: bool,
    /// The board's family [default: as the daemon reports]
    #[arg(long, value_name = "FAMILY", value_parser = Family::by_name)]
    pub family: Option<&'static Family>,
}

/// One written value.
#[derive(Debug, Serialize)]
struct Written {
    pmac_address: String,
    host_offset: u32,
    words: Vec<u16>,
    mask: Vec<u16>,
}

pub fn run(context: &mut Context, options: &Write) -> Result<Verdict, Failure> {
    // Check the request before asking the daemon, if the family is known.
    if let Some(family) = options.family {
        places(options, family)?;
    }
    let mut connection = context.connection()?;
    let family = Context::family(options.family, &mut connection)?;
    let places = places(options, family)?;
    let Some(first) = places.first().map(|place| place.offset) else { return Ok(Verdict::Yes) };
    connection.write(first, &span(first, &places), options.engineer)?;
    if context.output.is_json() {
        let written: Vec<Written> = places
            .iter()
            .map(|place| Written {
                pmac_address: place.address.clone(),
                host_offset: place.offset.bytes(),
                words: place.words.iter().map(|(value, _)| *value).collect(),
                mask: place.words.iter().map(|(_, mask)| *mask).collect(),
            })
            .collect();
        context.output.json(&written)?;
    }
    Ok(Verdict::Yes)
}

/// One value at its address: its words, and the bits of each to change.
struct Place {
    address: String,
    offset: HostOffset,
    words: Vec<(u16, u16)>,
}

fn places(options: &Write, family: &Family) -> Result<Vec<Place>, Failure> {
    let Field { location, bits } = Field::parse(&options.address, family).map_err(Failure::request)?;
    let space = location.space;
    if matches!(space, Space::D | Space::L) {
        return Err(Failure::Request(format!(
            "{}: registers of 48 bits are not written here; write the two DP: locations, or the register itself by \
             pmacctl send",
            options.address
        )));
    }
    if bits.is_some() && options.values.len() > 1 {
        return Err(Failure::Request("a bit field takes one value".into()));
    }
    // Addresses of one kind are one location (two words) apart.
    let places: Result<Vec<Place>, Failure> = options
        .values
        .iter()
        .enumerate()
        .map(|(index, text)| {
            let offset = location.offset.plus_words(2 * index);
            let words =
                encode(space, bits, text).map_err(|what| Failure::Request(format!("{text:?}: {what}")))?;
            if offset.plus_words(words.len()).bytes() > family.length {
                return Err(Failure::Request(format!("{text:?} would go past the end of the DPRAM")));
            }
            let number = family.pmac_number(offset);
            let field = bits.map_or_else(String::new, |bits| format!(",{},{}", bits.offset, bits.width));
            let address = format!("{space}:{}{field}", family.print_number(number));
            Ok(Place { address, offset, words })
        })
        .collect();
    let places = places?;
    let words = 2 * (options.values.len() - 1) + space.words();
    if words > WORDS_MAX {
        return Err(Failure::Request(format!(
            "{} values are too many; one write takes at most {WORDS_MAX} words",
            options.values.len()
        )));
    }
    Ok(places)
}

/// All words from the first address to the last. Words between the values stay unchanged.
fn span(first: HostOffset, places: &[Place]) -> Vec<(u16, u16)> {
    let mut words = Vec::new();
    for place in places {
        words.resize(place.offset.words_since(first), (0, 0));
        words.extend(&place.words);
    }
    words
}

fn encode(space: Space, bits: Option<BitField>, text: &str) -> Result<Vec<(u16, u16)>, String> {
    if space == Space::F {
        let value: f32 = text.parse().map_err(|_| "not a number".to_owned())?;
        if value.is_infinite() && !text.to_ascii_lowercase().contains("inf") {
            return Err("too large for 32 bits of floating point".to_owned());
        }
        return Ok(float32::encode(value).map(|word| (word, u16::MAX)).to_vec());
    }
    let whole = if space == Space::Dp { 32 } else { 16 };
    let bits = bits.unwrap_or(BitField { offset: 0, width: whole });
    let value = integer(text, bits.width)? << bits.offset & bits.mask();
    let words = split32(value).into_iter().zip(split32(bits.mask()));
    Ok(words.take(space.words()).collect())
}

/// A value of `width` bits, signed or not.
fn integer(text: &str, width: u32) -> Result<u32, String> {
    let (sign, digits) = text.strip_prefix('-').map_or((1, text), |digits| (-1, digits));
    let (digits, radix) = match digits.strip_prefix('$').or_else(|| digits.strip_prefix("0x")) {
        Some(digits) => (digits, 16),
        None => (digits, 10),
    };
    let plain = !digits.is_empty() && digits.chars().all(|digit| digit.is_digit(radix));
    let value = i64::from_str_radix(digits, radix).ok().filter(|_| plain).map(|value| sign * value);
    let value = value.ok_or("not a whole number; write 5, -5, $1F or 0x1F")?;
    let (least, most) = (-(1_i64 << (width - 1)), (1_i64 << width) - 1);
    if (least..=most).contains(&value) {
        Ok(value as u32)
    } else {
        Err(format!("does not fit {width} bits, which hold {least} to {most}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::PMAC;

    fn written(address: &str, values: &[&str]) -> Result<Vec<(u16, u16)>, String> {
        let options = Write {
            address: address.to_owned(),
            values: values.iter().map(|value| (*value).to_owned()).collect(),
            engineer: false,
            family: None,
        };
        let places = places(&options, &PMAC).map_err(|failure| failure.to_string())?;
        Ok(span(places[0].offset, &places))
    }

    #[test]
    fn values_become_words_and_masks() {
        let all = u16::MAX;
        assert_eq!(
            written("Y:$D800", &["-1", "$1F", "65535"]),
            Ok(vec![(all, all), (0, 0), (0x1F, all), (0, 0), (all, all)])
        );
        assert_eq!(
            written("DP:$D800", &["-2", "$80000000"]),
            Ok(vec![(0xFFFE, all), (all, all), (0, all), (0x8000, all)])
        );
        assert_eq!(written("F:$D800", &["-3.140625"]), Ok(vec![(0, all), (0xC049, all)]));
        assert_eq!(written("Y:$D800,8,4", &["5"]), Ok(vec![(0x0500, 0x0F00)]));
        assert_eq!(written("Y:$D800,8,4", &["-8"]), Ok(vec![(0x0800, 0x0F00)]));
        assert_eq!(written("DP:$D800,12,8", &["$FF"]), Ok(vec![(0xF000, 0xF000), (0x000F, 0x000F)]));
        assert_eq!(written("0x2002", &["7"]), Ok(vec![(7, all)]));
    }

    #[test]
    fn what_is_wrong_is_said() {
        for (address, values, expected) in [
            ("Y:$D800", &["65536"] as &[&str], "-32768 to 65535"),
            ("Y:$D800", &["-32769"], "does not fit 16 bits"),
            ("Y:$D800,8,4", &["16"], "does not fit 4 bits"),
            ("Y:$D800,8,4", &["1", "2"], "takes one value"),
            ("DP:$D800", &["4294967296"], "does not fit 32 bits"),
            ("Y:$D800", &["1.5"], "not a whole number"),
            ("Y:$D800", &["--1"], "not a whole number"),
            ("Y:$D800", &["$"], "not a whole number"),
            ("F:$D800", &["x"], "not a number"),
            ("F:$D800", &["1e99"], "too large"),
            ("L:$D800", &["1"], "48 bits"),
            ("Y:$DFFF", &["1", "2"], "past the end of the DPRAM"),
            ("Y:$D800", &["1"; 33], "too many"),
            ("Q:$D800", &["1"], "not an address"),
        ] {
            let error = written(address, values).unwrap_err();
            assert!(error.contains(expected), "{address} {values:?}: {error}");
        }
        assert!(written("Y:$D800", &["1"; 32]).is_ok());
    }
}
