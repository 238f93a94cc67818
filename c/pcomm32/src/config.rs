//! Which board each device number means, and the readings that no public source decides.

use std::path::PathBuf;
use std::{env, fs, io};

use serde::Deserialize;
use std::collections::BTreeMap;

/// Device numbers are 0 to 7.
pub(crate) const DEVICES: usize = 8;
const FILE: &str = "/etc/pmacd/pcomm32.toml";
/// The board of device 0 without a configuration.
const FIRST: &str = "pmac0";

/// The meaning of the functions of positions and velocities.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Units {
    /// `units` multiplies counts, and counts a servo cycle.
    #[default]
    Counts,
    /// `units` multiplies the register: 1/(Ix08*32) count, and 1/(Ix09*32) count a servo cycle.
    Raw,
}

/// Where a device's daemon is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Daemon {
    /// The name of its board.
    Name(String),
    /// Its socket.
    Socket(PathBuf),
}

/// The configuration.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct Config {
    pub(crate) devices: [Option<Daemon>; DEVICES],
    /// The device that `PmacSelect` gives.
    pub(crate) select: u32,
    /// The number of motor 1 and of coordinate system 1 in calls.
    pub(crate) first_motor: u32,
    pub(crate) units: Units,
}

/// The file. Environment variables of the keys' names stand above it: `PMAC_DEVICES`, `PMAC_SELECT`, …
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    #[serde(default)]
    devices: BTreeMap<String, String>,
    select: Option<u32>,
    first_motor: Option<u32>,
    units: Option<Units>,
}

impl Config {
    /// The configuration of this process.
    pub(crate) fn read() -> Result<Self, String> {
        let text = match fs::read_to_string(FILE) {
            Ok(text) => text,
            Err(error) if error.kind() == io::ErrorKind::NotFound => String::new(),
            Err(error) => return Err(format!("{FILE}: {error}")),
        };
        Self::of(&text, |name| env::var(name).ok())
    }

    fn of(text: &str, variable: impl Fn(&str) -> Option<String>) -> Result<Self, String> {
        let mut written: Written = toml::from_str(text).map_err(|error| format!("{FILE}: {error}"))?;
        if let Some(list) = variable("PMAC_DEVICES") {
            let pairs = list.split(',').map(str::trim).filter(|pair| !pair.is_empty());
            let read = |pair: &str| {
                let (number, place) = pair.split_once('=').ok_or_else(|| bad("PMAC_DEVICES", pair))?;
                Ok::<_, String>((number.trim().to_owned(), place.trim().to_owned()))
            };
            written.devices = pairs.map(read).collect::<Result<_, _>>()?;
        }
        let number = |name: &str, written: Option<u32>, default: u32, most: u32| {
            let value = match variable(name) {
                Some(text) => text.trim().parse().map_err(|_| bad(name, &text))?,
                None => written.unwrap_or(default),
            };
            if value <= most { Ok(value) } else { Err(bad(name, &value.to_string())) }
        };
        let mut config = Self {
            devices: Default::default(),
            select: number("PMAC_SELECT", written.select, 0, DEVICES as u32 - 1)?,
            first_motor: number("PMAC_FIRST_MOTOR", written.first_motor, 0, 1)?,
            units: match variable("PMAC_UNITS").as_deref() {
                Some("counts") => Units::Counts,
                Some("raw") => Units::Raw,
                Some(text) => return Err(bad("PMAC_UNITS", text)),
                None => written.units.unwrap_or_default(),
            },
        };
        if written.devices.is_empty() {
            written.devices.insert("0".to_owned(), FIRST.to_owned());
        }
        for (number, place) in written.devices {
            let slot = number.parse().ok().and_then(|number: usize| config.devices.get_mut(number));
            let slot = slot.ok_or_else(|| format!("device {number:?}: there are 0 to {}", DEVICES - 1))?;
            *slot = Some(match place.contains('/') {
                true => Daemon::Socket(place.into()),
                false => Daemon::Name(place),
            });
        }
        Ok(config)
    }
}

fn bad(name: &str, text: &str) -> String {
    format!("{name}: {text:?} is not possible; docs/pcomm32.md has the values")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, variables: &[(&str, &str)]) -> Result<Config, String> {
        let of =
            |name: &str| variables.iter().find(|(key, _)| *key == name).map(|(_, text)| (*text).to_owned());
        Config::of(text, of)
    }

    #[test]
    fn the_example_is_the_default() {
        assert_eq!(read(include_str!("../pcomm32.toml.example"), &[]), read("", &[]));
    }

    #[test]
    fn without_a_configuration_device_0_is_pmac0() {
        let config = read("", &[]).unwrap();
        assert_eq!(config.devices[0], Some(Daemon::Name("pmac0".to_owned())));
        assert_eq!(config.devices.iter().flatten().count(), 1);
        assert_eq!((config.select, config.first_motor, config.units), (0, 0, Units::Counts));
    }

    #[test]
    fn the_environment_stands_above_the_file() {
        let file = "select = 2\nfirst_motor = 1\nunits = \"raw\"\n[devices]\n2 = \"dome\"\n";
        let config = read(file, &[]).unwrap();
        assert_eq!(config.devices[2], Some(Daemon::Name("dome".to_owned())));
        assert_eq!((config.select, config.first_motor, config.units), (2, 1, Units::Raw));
        let variables = [("PMAC_DEVICES", " 0=pmac0, 1=/run/pmacd/dome.sock ,"), ("PMAC_FIRST_MOTOR", "0")];
        let config = read(file, &variables).unwrap();
        assert_eq!(config.devices[1], Some(Daemon::Socket("/run/pmacd/dome.sock".into())));
        assert_eq!((config.devices[2].clone(), config.first_motor), (None, 0));
    }

    #[test]
    fn a_wrong_value_is_named() {
        for (variables, name) in [
            ([("PMAC_DEVICES", "8=pmac0")], "\"8\""),
            ([("PMAC_DEVICES", "pmac0")], "PMAC_DEVICES"),
            ([("PMAC_SELECT", "8")], "PMAC_SELECT"),
            ([("PMAC_FIRST_MOTOR", "2")], "PMAC_FIRST_MOTOR"),
            ([("PMAC_UNITS", "mm")], "PMAC_UNITS"),
        ] {
            assert!(read("", &variables).unwrap_err().contains(name), "{name}");
        }
        assert!(read("device = 1", &[]).unwrap_err().contains(FILE));
    }
}
