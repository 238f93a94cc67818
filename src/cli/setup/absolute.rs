//! `pmacctl board absolute`: explains what PMAC reads with an absolute-position setting, and decodes given words.

use std::fmt::Write;

use clap::Args;
use serde::Serialize;

use crate::cli::setup::answer::Explanation;
use crate::map::Generation;
use crate::map::number::parse;
use crate::setup::absolute::AbsoluteFormat;
use crate::setup::position::Word;

/// `absolute`.
#[derive(Debug, Clone, Args)]
pub struct Absolute {
    /// The board's family: pmac, pmac2, turbo or turbo2 [default: by the given variables]
    #[arg(long, value_name = "FAMILY")]
    pub family: Option<Generation>,
    /// PMAC and PMAC2: the value of Ix10
    #[arg(long, value_name = "VALUE", value_parser = parse, conflicts_with_all = ["ixx10", "ixx95"],
          required_unless_present = "ixx10")]
    pub ix10: Option<u32>,
    /// Turbo: the value of Ixx10, an address
    #[arg(long, value_name = "VALUE", value_parser = parse, requires = "ixx95")]
    pub ixx10: Option<u32>,
    /// Turbo: the value of Ixx95, a format
    #[arg(long, value_name = "VALUE", value_parser = parse, requires = "ixx10")]
    pub ixx95: Option<u32>,
    /// The content of a register, such as Y:$078D00=$123456; prints the position in the registers. Without it, those of the board
    /// that a daemon has, if it is of that family
    #[arg(long = "word", value_name = "ADDRESS=VALUE", num_args = 1..)]
    pub words: Vec<Word>,
}

/// A format, and the position if words were given.
#[derive(Serialize)]
struct Document<'a> {
    #[serde(flatten)]
    format: &'a AbsoluteFormat,
    #[serde(skip_serializing_if = "Option::is_none")]
    position: Option<i64>,
}

/// Answers `absolute …`, with the known content of the registers.
///
/// # Errors
/// The reason that the words are invalid; exit status 2.
pub fn answer(options: &Absolute, format: &AbsoluteFormat, words: &[Word]) -> Result<Explanation, String> {
    let position = match words {
        [] => None,
        words => Some(format.position(words).map_err(|error| error.to_string())?),
    };
    // The variable with the home position, in the spelling of the family's manual.
    let offset = if options.ix10.is_some() { "Ix26" } else { "Ixx26" };
    Explanation::of(&Document { format, position }, text(format, position, offset))
}

/// The format that the options name.
///
/// # Errors
/// Why the options name none; exit status 2.
pub fn format(options: &Absolute) -> Result<AbsoluteFormat, String> {
    let format = match (options.ix10, options.ixx10.zip(options.ixx95), options.family) {
        (Some(_), _, Some(Generation::Turbo)) => {
            return Err("a Turbo board has Ixx10 and Ixx95; give --ixx10 and --ixx95".to_owned());
        }
        (_, Some(_), Some(Generation::Pmac)) => {
            return Err(
                "a PMAC or PMAC2 has Ix10 alone, with the format in its bits 16-23; give --ix10".to_owned()
            );
        }
        (Some(ix10), _, _) => AbsoluteFormat::pmac(ix10),
        (None, Some((ixx10, ixx95)), _) => AbsoluteFormat::turbo(ixx10, ixx95),
        (None, None, _) => return Err("give --ix10, or --ixx10 and --ixx95".to_owned()),
    };
    format.map_err(|error| error.to_string())
}

// Writing to a String cannot fail.
fn text(format: &AbsoluteFormat, position: Option<i64>, offset: &str) -> String {
    let mut text = format.kind.title().to_owned();
    if let Some(bits) = format.bits {
        let _ = write!(text, ", {bits} bits");
    }
    text.push_str(if format.signed { ", signed\n" } else { ", unsigned\n" });
    let mut lowest = 0;
    for part in &format.registers {
        let bits = |from: u32| match part.bits {
            1 => format!("bit {from}"),
            _ => format!("bits {}-{from}", from + part.bits - 1),
        };
        let _ = writeln!(text, "  {}  {}  are position {}", part.address, bits(part.from_bit), bits(lowest));
        lowest += part.bits;
    }
    if let Some(address) = format.address {
        let _ = writeln!(text, "  from {address} on");
    }
    if let Some(address) = format.multiplexer_address {
        let _ = writeln!(text, "  multiplexer address {address}");
    }
    if let (Some(converter), Some(open)) = (format.converter, format.switch_open) {
        let switch = if open { "open" } else { "closed" };
        let _ = writeln!(text, "  converter {converter} of the board with switch SW1-1 {switch}");
    }
    if let Some(node) = format.node {
        let _ = writeln!(text, "  MACRO node {node}");
    }
    for note in &format.notes {
        let _ = writeln!(text, "  - {note}");
    }
    if let Some(position) = position {
        let _ = writeln!(text, "position {position} (the motor's position is this minus {offset})");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::{CommandFactory, Parser};
    use serde_json::{Value, json};

    #[derive(Debug, Parser)]
    struct Line {
        #[command(flatten)]
        absolute: Absolute,
    }

    fn parsed(line: &str) -> Absolute {
        Line::try_parse_from(line.split(' ')).unwrap_or_else(|error| panic!("{error}")).absolute
    }

    fn told(line: &str) -> Result<Explanation, String> {
        let options = parsed(line);
        answer(&options, &format(&options)?, &options.words)
    }

    fn answered(line: &str) -> Explanation {
        told(line).unwrap_or_else(|reason| panic!("{line}: {reason}"))
    }

    #[test]
    fn the_tree_is_sound() {
        Line::command().debug_assert();
    }

    #[test]
    fn the_reference_pages_first_example() {
        let answer = answered("absolute --family turbo --ixx10 0x078D00 --ixx95 0x200000");
        assert_eq!(
            answer.document,
            json!({
                "kind": "parallel", "space": "Y", "signed": false, "bits": 32, "notes": [],
                "registers": [
                    { "address": "Y:$078D00", "from_bit": 0, "bits": 24 },
                    { "address": "Y:$078D01", "from_bit": 0, "bits": 8 },
                ],
            })
        );
        assert_eq!(
            answer.text,
            "parallel data, 32 bits, unsigned\n  \
             Y:$078D00  bits 23-0  are position bits 23-0\n  \
             Y:$078D01  bits 7-0  are position bits 31-24\n"
        );
    }

    #[test]
    fn words_give_the_position() {
        let format = "absolute --family turbo --ixx10 $078D00 --ixx95 $A00000";
        for words in ["--word Y:$078D00=$FFFFFE --word Y:$078D01=$FF", "--word Y:$078D00=-2 Y:$078D01=255"] {
            let answer = answered(&format!("{format} {words}"));
            assert_eq!(answer.document["position"], json!(-2));
            assert!(answer.text.ends_with("position -2 (the motor's position is this minus Ixx26)\n"));
        }
        let pmac = answered("absolute --ix10 0xB1C006 --word Y:$C006=$100");
        assert!(
            pmac.text.ends_with("position 1 (the motor's position is this minus Ix26)\n"),
            "{}",
            pmac.text
        );
        let reason = told(&format!("{format} --word Y:$078D00=0")).unwrap_err();
        assert!(reason.contains("Y:$078D01 is missing"), "{reason}");
    }

    #[test]
    fn other_kinds() {
        let resolver = answered("absolute --family pmac --ix10 0x000100");
        assert_eq!(
            (&resolver.document["kind"], &resolver.document["space"]),
            (&json!("resolver"), &Value::Null)
        );
        assert_eq!(resolver.document["multiplexer_address"], 0);
        assert!(resolver.text.contains("converter 1 of the board with switch SW1-1 closed"));
        let acc28 = answered("absolute --ix10 0xB1C006");
        assert_eq!(
            acc28.document["registers"][0],
            json!({ "address": "Y:$C006", "from_bit": 8, "bits": 16 })
        );
        let node = answered("absolute --ixx10 0x4 --ixx95 0x740000");
        assert_eq!((&node.document["kind"], &node.document["node"]), (&json!("macro_parallel"), &json!(4)));
    }

    #[test]
    fn what_means_nothing_is_refused_with_the_reason() {
        let refused = |line: &str| told(line).unwrap_err();
        assert!(refused("absolute --ixx10 0x78D00 --ixx95 0x330000").contains("format code $33"));
        assert!(refused("absolute --family turbo --ix10 0x16FFD1").contains("--ixx95"));
        assert!(refused("absolute --family pmac2 --ixx10 1 --ixx95 1").contains("--ix10"));
        for line in [
            "absolute",
            "absolute --family turbo",
            "absolute --ixx10 1",
            "absolute --ixx95 1",
            "absolute --ix10 1 --ixx10 1 --ixx95 1",
            "absolute --ix10 x",
            "absolute --ix10 0x16FFD1 --word Y:$FFD1",
        ] {
            assert!(Line::try_parse_from(line.split(' ')).is_err(), "{line}");
        }
    }
}
