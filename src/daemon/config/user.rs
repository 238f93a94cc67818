//! `[[user]]`: words of the DPRAM that the site's own programs write.

use serde::Deserialize;

use super::span::Refusal;
use crate::format::Text;
use crate::format::visible::is_hidden;
use crate::map::user_word::{USER_DATA_WORDS, USER_NAME_BYTES, USER_UNIT_BYTES, USER_WORDS, UserWord};
use crate::map::{BitField, Family, Field, Space, TypedAddress};
use crate::mirror::UserRate;

/// The rate if the configuration gives none, in hertz.
const USUAL_HZ: f64 = 10.0;

/// One `[[user]]` as written.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UserTable {
    name: String,
    /// As "$DA10".
    address: String,
    /// As "DP", "F", "L", "Y:8,4", "X:0,16,S".
    format: String,
    count: Option<i64>,
    unit: Option<String>,
    /// As "Y:$DA0F".
    guard: Option<String>,
    /// Samples a second, or "servo".
    rate_hz: Option<toml::Value>,
}

/// The words, and when the daemon reads them: at the highest of their rates.
#[derive(Debug, Clone, PartialEq)]
pub struct UserArea {
    /// The words.
    pub words: Vec<UserWord>,
    /// The rate.
    pub rate: UserRate,
}

/// The user words that the tables name, for a board of `family`.
///
/// # Errors
/// Names the wrong key: its table, and the value to write.
pub(super) fn decide(tables: &[UserTable], family: &Family) -> Result<UserArea, Refusal> {
    let mut words: Vec<UserWord> = Vec::new();
    let mut rates = Vec::new();
    for (index, table) in tables.iter().enumerate() {
        let refuse = |key: &str, text: String| Refusal::of(format!("user.{index}.{key}"), text);
        let word = word(table, family).map_err(|(key, text)| refuse(key, text))?;
        if words.iter().any(|other| other.name == word.name) {
            return Err(refuse("name", format!("another [[user]] is called {:?} already", table.name)));
        }
        words.push(word);
        if words.len() > USER_WORDS {
            return Err(refuse("name", format!("there are more than {USER_WORDS} [[user]] tables")));
        }
        let taken: usize = words.iter().map(UserWord::words).sum();
        if taken > USER_DATA_WORDS {
            let text = format!(
                "with this one all [[user]] tables take {taken} words of 16 bits, and may take {USER_DATA_WORDS}: write a smaller count"
            );
            return Err(refuse("count", text));
        }
        rates.extend(table.rate_hz.as_ref().map(rate).transpose().map_err(|text| refuse("rate_hz", text))?);
    }
    let usual = UserRate::EveryNs((1e9 / USUAL_HZ) as u64);
    let fastest = rates.into_iter().min_by_key(|rate| match rate {
        UserRate::Servo => 0,
        UserRate::EveryNs(period) => *period,
    });
    Ok(UserArea { words, rate: fastest.unwrap_or(usual) })
}

fn word(table: &UserTable, family: &Family) -> Result<UserWord, (&'static str, String)> {
    let (location, bits, signed) = place(table, family)?;
    let count = table.count.unwrap_or(1);
    let count = usize::try_from(count).ok().filter(|count| (1..=USER_DATA_WORDS).contains(count));
    let count = count.ok_or_else(|| {
        ("count", format!("count = {}: write 1 to {USER_DATA_WORDS}", table.count.unwrap_or(1)))
    })?;
    let guard = table.guard.as_deref().map(|text| guard(text, family)).transpose();
    let word = UserWord {
        name: name(&table.name).map_err(|text| ("name", text))?,
        unit: unit(table.unit.as_deref().unwrap_or_default()).map_err(|text| ("unit", text))?,
        location,
        bits,
        signed,
        count,
        guard: guard.map_err(|text| ("guard", text))?,
    };
    let end = word.place(count - 1).plus_words(location.space.words());
    if end.bytes() > family.length {
        return Err(("count", format!("{count} values from {} on leave the DPRAM", table.address)));
    }
    if word.guard.is_some_and(|guard| (location.offset..end).contains(&guard)) {
        return Err((
            "guard",
            "the guard lies in the value's own words: give it a word of its own".to_owned(),
        ));
    }
    Ok(word)
}

/// The place of the first value, and its bits.
fn place(
    table: &UserTable,
    family: &Family,
) -> Result<(TypedAddress, Option<BitField>, bool), (&'static str, String)> {
    let format = table.format.trim();
    let (space, bits) = format.split_once(':').map_or((format, None), |(space, bits)| (space, Some(bits)));
    let shape = || {
        let text = format!(
            "format = {format:?}: write DP, F, D, L, X or Y, or bits of X, Y or DP by the lowest one and their number, as Y:8,4; \
             with ,S behind they are signed"
        );
        ("format", text)
    };
    if !Space::ALL.into_iter().any(|one| one.name() == space) {
        return Err(shape());
    }
    if table.address.trim().is_empty() {
        let text = "no address stands here: write one, as $DA10. A shell takes $DA10 for a variable, unless its text is quoted, \
                    as behind <<'EOF'";
        return Err(("address", text.to_owned()));
    }
    let address = format!("{space}:{}", table.address.trim());
    let location = TypedAddress::parse(&address, family).map_err(|error| ("address", error.to_string()))?;
    let Some(bits) = bits else { return Ok((location, None, false)) };
    let (field, signed) = match bits.strip_suffix(",S") {
        Some(field) => (field, true),
        None => (bits.strip_suffix(",U").unwrap_or(bits), false),
    };
    if !field.contains(',') {
        return Err(shape());
    }
    let field = Field::parse(&format!("{address},{field}"), family);
    let field = field.map_err(|error| ("format", format!("format = {format:?}: {error}")))?;
    Ok((location, field.bits, signed))
}

fn guard(text: &str, family: &Family) -> Result<crate::map::HostOffset, String> {
    let guard = TypedAddress::parse(text, family).map_err(|error| error.to_string())?;
    if !matches!(guard.space, Space::X | Space::Y) {
        return Err(format!(
            "guard = {text:?}: a guard is one word of 16 bits: write Y: or X: and its address"
        ));
    }
    Ok(guard.offset)
}

/// A name can be typed, and is no number.
fn name(text: &str) -> Result<Text<USER_NAME_BYTES>, String> {
    let begins = text.starts_with(|first: char| first.is_ascii_alphabetic());
    let typed = text.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"._-".contains(&byte));
    Text::new(text.as_bytes()).filter(|_| begins && typed).ok_or_else(|| {
        format!(
            "name = {text:?}: write 1 to {USER_NAME_BYTES} letters, digits, `.`, `_` and `-`, a letter first"
        )
    })
}

fn unit(text: &str) -> Result<Text<USER_UNIT_BYTES>, String> {
    let printed = !text.contains(|c: char| is_hidden(c) || c.is_whitespace());
    Text::new(text.as_bytes()).filter(|_| printed).ok_or_else(|| {
        format!("unit = {text:?}: write up to {USER_UNIT_BYTES} bytes without blanks, as deg or mm")
    })
}

fn rate(value: &toml::Value) -> Result<UserRate, String> {
    let hz = match value {
        toml::Value::String(text) if text == "servo" => return Ok(UserRate::Servo),
        toml::Value::Integer(hz) => *hz as f64,
        toml::Value::Float(hz) => *hz,
        _ => f64::NAN,
    };
    if (0.1..=1000.0).contains(&hz) {
        return Ok(UserRate::EveryNs((1e9 / hz) as u64));
    }
    Err("rate_hz is out of range: write 0.1 to 1000, or \"servo\" for each servo update".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::{HostOffset, PMAC, TURBO2};

    #[derive(Deserialize)]
    struct File {
        user: Vec<UserTable>,
    }

    fn decided(text: &str) -> Result<UserArea, (String, String)> {
        let File { user } = toml::from_str(text).unwrap();
        decide(&user, &PMAC).map_err(|refusal| (refusal.key.unwrap_or_default(), refusal.text))
    }

    #[test]
    fn tables_name_words_of_every_format() {
        let text = "[[user]]\nname = 'count'\naddress = '$DA10'\nformat = 'DP'\nrate_hz = 50\n\
                    [[user]]\nname = 'mode'\naddress = '$DA11'\nformat = 'Y:8,4,S'\nguard = 'Y:$DA0F'\n\
                    [[user]]\nname = 'table'\naddress = '$DA20'\nformat = 'L'\ncount = 3\nunit = 'mm'\n";
        let UserArea { words, rate } = decided(text).unwrap();
        assert_eq!(rate, UserRate::EveryNs(20_000_000), "the highest that is written");
        let [count, mode, table] = &words[..] else { panic!("{words:?}") };
        assert_eq!((count.location.offset, count.words()), (HostOffset::new(0x2840), 2));
        assert_eq!((mode.bits, mode.signed), (Some(BitField { offset: 8, width: 4 }), true));
        assert_eq!(mode.guard, Some(HostOffset::new(0x283C)));
        assert_eq!((&table.unit[..], table.words(), table.place(2)), ("mm", 12, HostOffset::new(0x2890)));
        let servo = format!("{text}rate_hz = 'servo'\n");
        assert_eq!(decided(&servo).unwrap().rate, UserRate::Servo);
        let File { user } = toml::from_str(&text.replace("$DA", "$0602")).unwrap();
        assert_eq!(decide(&user, &TURBO2).unwrap().words[2].location.offset, HostOffset::new(0x0880));
    }

    #[test]
    fn what_cannot_be_is_refused_key_by_key() {
        let first = "[[user]]\nname = 'x'\naddress = '$DA00'\nformat = 'DP'\n";
        let table = |name: &str, address: &str, format: &str, more: &str| {
            format!("[[user]]\nname = '{name}'\naddress = '{address}'\nformat = '{format}'\n{more}\n")
        };
        for (text, key, why) in [
            (table("x", "$DA10", "DP", ""), "name", "another [[user]] is called \"x\""),
            (table("2", "$DA10", "DP", ""), "name", "a letter first"),
            (
                table("y", "$C000", "DP", ""),
                "address",
                "lies outside the DPRAM of a PMAC, which has DP:$D000",
            ),
            (table("y", "", "DP", ""), "address", "unless its text is quoted"),
            (table("y", "$DFFF", "L", ""), "address", "lies outside the DPRAM"),
            (table("y", "$DA10", "Q", ""), "format", "write DP, F, D, L, X or Y"),
            (table("y", "$DA10", "Y:8", ""), "format", "as Y:8,4"),
            (table("y", "$DA10", "Y:8,9", ""), "format", "the field does not lie in the 16 bits of Y:"),
            (table("y", "$DA10", "F:0,4", ""), "format", "only Y:, X: and DP: have bit fields"),
            (table("y", "$DA10", "DP", "count = 0"), "count", "write 1 to 256"),
            (
                table("y", "$DA10", "DP", "count = 200"),
                "count",
                "take 402 words of 16 bits, and may take 256",
            ),
            (table("y", "$DFFF", "DP", "count = 2"), "count", "leave the DPRAM"),
            (table("y", "$DA10", "DP", "unit = 'a b'"), "unit", "without blanks"),
            (table("y", "$DA10", "DP", "unit = \"m\\u202Em\""), "unit", "without blanks"),
            (table("y", "$DA10", "DP", "guard = 'DP:$DA0F'"), "guard", "one word of 16 bits"),
            (table("y", "$DA10", "DP", "guard = 'Y:$C000'"), "guard", "lies outside"),
            (table("y", "$DA10", "DP", "guard = 'X:$DA10'"), "guard", "a word of its own"),
            (table("y", "$DA10", "DP", "rate_hz = 0"), "rate_hz", "write 0.1 to 1000, or \"servo\""),
            (table("y", "$DA10", "DP", "rate_hz = 'fast'"), "rate_hz", "or \"servo\""),
        ] {
            let (found, said) = decided(&format!("{first}{text}")).unwrap_err();
            assert_eq!(found, format!("user.1.{key}"), "{text}: {said}");
            assert!(said.contains(why), "{text}: {said}");
        }
    }
}
