//! Reads files of binary rotary commands, as `pmacctl rotary encode` writes them.

use serde_json::Value;

use crate::format::file_text;

/// The pairs of words in a file: JSON (objects with `word1` and `word2`, pairs, or plain strings in an array), or hex
/// words separated by blanks, commas or lines, with comments as in a program.
///
/// # Errors
/// The first element that is not a word, and its position.
pub fn words(bytes: &[u8]) -> Result<Vec<(u32, u32)>, String> {
    let text = file_text::read(bytes).map_err(|reason| reason.to_string())?;
    if text.trim_start().starts_with('[') {
        let values: Vec<Value> = serde_json::from_str(&text).map_err(|error| error.to_string())?;
        let mut words = Vec::new();
        for (value, at) in values.iter().zip(1..) {
            let parts = match value {
                Value::Object(object) => vec![object.get("word1"), object.get("word2")],
                Value::Array(pair) => pair.iter().map(Some).collect(),
                word => vec![Some(word)],
            };
            for part in parts {
                let word = part.and_then(Value::as_str);
                words.push(word.ok_or_else(|| format!("element {at}: no word1 and word2 of hex digits"))?);
            }
        }
        return pairs(words.into_iter());
    }
    let code = text.lines().map(|line| {
        let end = line.find(';').into_iter().chain(line.find("//")).min().unwrap_or(line.len());
        &line[..end]
    });
    pairs(code.flat_map(|line| line.split([' ', '\t', ','])).filter(|word| !word.is_empty()))
}

/// Words of up to six hex digits, with or without `$` or `0x`, two by two.
pub fn pairs<'a>(words: impl Iterator<Item = &'a str>) -> Result<Vec<(u32, u32)>, String> {
    let word = |(text, at): (&str, usize)| {
        let digits = ["$", "0x", "0X"].iter().find_map(|mark| text.strip_prefix(mark)).unwrap_or(text);
        let plain = !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_hexdigit());
        let value = u32::from_str_radix(digits, 16).ok().filter(|&value| plain && value <= 0xFF_FFFF);
        value.ok_or_else(|| format!("word {at}: {text:?} is not a word of six hex digits"))
    };
    let words = words.zip(1..).map(word).collect::<Result<Vec<u32>, String>>()?;
    let (pairs, rest) = words.as_chunks::<2>();
    match rest {
        [] => Ok(pairs.iter().map(|&[word1, word2]| (word1, word2)).collect()),
        _ => Err(format!("{} words: a command is two words", words.len())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_read_in_each_form() {
        let expected = vec![(0x000E23, 0x500000), (0x000661, 0x980000)];
        for text in [
            "000E23 500000  ; 1:1 X10\n000661 980000 // Y-3.25\n",
            "$e23,0x500000\r\n661\t$980000",
            r#"["000E23","500000","000661","980000"]"#,
            r#" [["000E23","500000"],["000661","980000"]]"#,
            r#"[{"line":1,"word1":"000E23","word2":"500000"},{"word1":"000661","word2":"980000"}]"#,
        ] {
            assert_eq!(words(text.as_bytes()), Ok(expected.clone()), "{text}");
        }
        assert_eq!(words(b""), Ok(vec![]));
        assert_eq!(words(b"[]"), Ok(vec![]));
    }

    #[test]
    fn what_is_no_word_is_said() {
        for (text, expected) in [
            ("000E23", "1 words: a command is two words"),
            ("000E23 X10", "word 2: \"X10\""),
            ("1000000 0", "word 1: \"1000000\""),
            ("+12 0", "word 1: \"+12\""),
            ("$ 0", "word 1: \"$\""),
            (r#"[{"word1":"000E23"}]"#, "element 1"),
            (r#"[1, 2]"#, "element 1"),
            ("[", "EOF"),
        ] {
            let error = words(text.as_bytes()).unwrap_err();
            assert!(error.starts_with(expected), "{text}: {error}");
        }
        assert!(words(b"\xFF\xFE\xFF").is_err());
    }
}
