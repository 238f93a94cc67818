//! The list of readings, and what messages call them.

use super::*;

#[test]
fn the_list_has_every_name_and_value_there_is() {
    let defaults = serde_json::to_value(Readings::default()).unwrap();
    assert_eq!(defaults.as_object().unwrap().len(), READINGS.len());
    for reading in READINGS {
        // A wrong guess would move the machine elsewhere.
        let default = if reading.name == "rotary_code2" { None } else { Some(reading.values[0]) };
        assert_eq!(Readings::default().value(reading.name).as_deref(), default);
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
}
