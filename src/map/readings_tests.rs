//! The list of readings, and what messages call them.

use super::*;

#[test]
fn the_list_has_every_name_and_value_there_is() {
    let defaults = serde_json::to_value(Readings::default()).unwrap();
    assert_eq!(defaults.as_object().unwrap().len(), READINGS.len());
    for reading in READINGS {
        assert_eq!(Readings::default().value(reading.name).as_deref(), Some(reading.values[0]));
        for value in reading.values {
            let readings = Readings::default().with(&format!("{}={value}", reading.name)).unwrap();
            assert_eq!(readings.value(reading.name).as_deref(), Some(*value));
        }
        // The error of a value that is none lists those there are.
        let error = Readings::default().with(&format!("{}=x", reading.name)).unwrap_err().to_string();
        assert_eq!(error.matches('`').count(), 2 * (1 + reading.values.len()), "{error}");
    }
}

#[test]
fn readings_that_messages_name_are_named_as_they_are_written() {
    for word in [GatherSizeWord::WithIndex, GatherSizeWord::AsPrinted, GatherSizeWord::NotWritten] {
        let readings = Readings::default().with(&format!("gather_size_word={word}")).unwrap();
        assert_eq!(readings.gather_size_word, word);
    }
}

#[test]
fn b3_where_nobody_knows_which_word_is_which_what_both_would_say_is_known() {
    let is_open = |copies| GlobalWords::told(None, copies, |[_, second]| second & 1 << 19 != 0);
    assert_eq!(is_open([0x01_0000, 1]), Some(false));
    assert_eq!(is_open([0x09_0000, 1]), None);
    assert_eq!(is_open([0x01_0000, 0x08_0001]), None);
    assert_eq!(is_open([0x09_0000, 0x08_0001]), Some(true));
}
