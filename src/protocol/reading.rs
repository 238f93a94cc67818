//! What the daemon reads of a board at all: the functions it uses, and of the servo and background reports the motors and
//! fields.
//!
//! Bus accesses are the cost on real hardware, so what nobody needs can be switched off or left out in the configuration.
//! The same tables stand in the reply of `GetSettings`.

use serde::{Deserialize, Serialize};

use crate::map::{PMAC, Selection, block_fields};

/// An automatic function of the DPRAM, as the daemon uses it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Function {
    /// Servo fixed data into the segment.
    Servo,
    /// Background fixed data into the segment.
    Background,
    /// Command lines, control characters, and texts that programs send.
    Ascii,
    /// Background variables, read and written.
    Variables,
    /// Gathered samples into the segment.
    Gather,
    /// Control panel requests and feed rate overrides.
    Panel,
    /// Binary rotary buffers.
    Rotary,
}

impl Function {
    /// Every one.
    pub const ALL: [Self; 7] = [
        Self::Servo,
        Self::Background,
        Self::Ascii,
        Self::Variables,
        Self::Gather,
        Self::Panel,
        Self::Rotary,
    ];

    /// Its name in the configuration.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Servo => "servo",
            Self::Background => "background",
            Self::Ascii => "ascii",
            Self::Variables => "variables",
            Self::Gather => "gather",
            Self::Panel => "panel",
            Self::Rotary => "rotary",
        }
    }
}

/// The functions that are used, every one unless told otherwise. One that is not makes no bus access at all.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Functions(Vec<Function>);

impl Default for Functions {
    fn default() -> Self {
        Self(Function::ALL.to_vec())
    }
}

impl Functions {
    /// Whether `function` is used.
    #[must_use]
    pub fn has(&self, function: Function) -> bool {
        self.0.contains(&function)
    }
}

/// A motor, or coordinate system, by its number: 1 to 8.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "i64", into = "i64")]
pub struct Number(u8);

impl From<Number> for i64 {
    fn from(number: Number) -> Self {
        number.0.into()
    }
}

impl TryFrom<i64> for Number {
    type Error = String;

    fn try_from(number: i64) -> Result<Self, String> {
        let small = u8::try_from(number).ok().filter(|number| (1..=PMAC.motors as u8).contains(number));
        small.map(Self).ok_or_else(|| format!("there is no motor {number}; write 1 to {}", PMAC.motors))
    }
}

/// All of them.
fn every_number() -> Vec<Number> {
    (1..=PMAC.motors as u8).map(Number).collect()
}

/// A name out of the register table. (Spelt out below, it would pass for a text borrowed from the message.)
type Name = &'static str;

/// Makes the names of one report's fields.
macro_rules! field_names {
    ($(#[$about:meta])* $name:ident, $function:literal) => {
        $(#[$about])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
        #[serde(try_from = "String", into = "String")]
        pub struct $name(Name);

        impl $name {
            /// Every one, in the order of the register table.
            #[must_use]
            pub fn all() -> Vec<Self> {
                block_fields(&PMAC, $function).map(|field| Self(field.name)).collect()
            }

            /// Its name.
            #[must_use]
            pub const fn name(self) -> &'static str {
                self.0
            }
        }

        impl From<$name> for String {
            fn from(field: $name) -> Self {
                field.0.to_owned()
            }
        }

        impl TryFrom<String> for $name {
            type Error = String;

            fn try_from(text: String) -> Result<Self, String> {
                let found = block_fields(&PMAC, $function).find(|field| field.is_called(&text));
                found.map(|field| Self(field.name)).ok_or_else(|| {
                    let names: Vec<_> = Self::all().into_iter().map(Self::name).collect();
                    format!("there is no {} field `{text}`; there are {}", $function, names.join(", "))
                })
            }
        }
    };
}

field_names!(
    /// A field of the servo report, as `pmacctl map` and gather name it: `actual_position`, or `motor_actual_position`.
    ServoField,
    "servo"
);
field_names!(
    /// A field of the background report: `program_status`, or `cs_program_status`.
    BackgroundField,
    "background"
);

/// The spare words of a motor's servo block.
const SPARE: &str = "spare";

/// What is read of the servo report. The two global status words are always read: they tell whether a command line would
/// be taken as a program line.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ServoSettings {
    /// The motors, as far as the board reports them.
    pub motors: Vec<Number>,
    /// Of every motor these fields.
    pub fields: Vec<ServoField>,
    /// Whether the four spare words of a motor are read where `fields` has them.
    pub spare_words: bool,
}

impl Default for ServoSettings {
    fn default() -> Self {
        Self { motors: every_number(), fields: ServoField::all(), spare_words: true }
    }
}

impl ServoSettings {
    /// What is read.
    #[must_use]
    pub fn selection(&self) -> Selection {
        let fields = self.fields.iter().map(|field| field.0);
        selection("servo", fields.filter(|name| self.spare_words || *name != SPARE), &self.motors)
    }
}

/// What is read of the background report. The board's three ports are always read.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BackgroundSettings {
    /// The motors and the coordinate systems of the same numbers, as far as the board reports them.
    pub motors: Vec<Number>,
    /// Of every motor and coordinate system these fields.
    pub fields: Vec<BackgroundField>,
}

impl Default for BackgroundSettings {
    fn default() -> Self {
        Self { motors: every_number(), fields: BackgroundField::all() }
    }
}

impl BackgroundSettings {
    /// What is read.
    #[must_use]
    pub fn selection(&self) -> Selection {
        selection("background", self.fields.iter().map(|field| field.0), &self.motors)
    }
}

fn selection(function: &str, names: impl Iterator<Item = &'static str>, numbers: &[Number]) -> Selection {
    let words = names
        .filter_map(|name| block_fields(&PMAC, function).find(|field| field.name == name))
        .map(|field| field.words);
    Selection::new(words, numbers.iter().map(|number| number.0.into()))
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_function_has_one_name_in_configuration_and_set_up() {
        let mut configured = super::Function::ALL.map(super::Function::name);
        let mut set_up = crate::setup::enable::Function::ALL.map(crate::setup::enable::Function::name);
        configured.sort_unstable();
        set_up.sort_unstable();
        assert_eq!(configured, set_up);
    }

    use super::*;
    use crate::map::classic::{BACKGROUND_BLOCK_WORDS, SERVO_MOTOR_WORDS};

    fn words(selection: Selection, block: usize) -> usize {
        let mut runs = Vec::new();
        selection.runs(block, 8, &mut runs);
        runs.iter().map(ExactSizeIterator::len).sum()
    }

    #[test]
    fn all_is_read_unless_something_is_left_out() {
        let servo =
            |text: &str| words(toml::from_str::<ServoSettings>(text).unwrap().selection(), SERVO_MOTOR_WORDS);
        assert_eq!(servo(""), 240);
        assert_eq!(servo("spare_words = false"), 8 * 26);
        assert_eq!(servo("motors = [3, 1]"), 60);
        assert_eq!(servo("motors = [1, 1]\nfields = ['actual_position', 'motor_servo_status']"), 6);
        assert_eq!(servo("fields = ['spare']\nspare_words = false"), 0);
        let background = |text: &str| {
            words(toml::from_str::<BackgroundSettings>(text).unwrap().selection(), BACKGROUND_BLOCK_WORDS)
        };
        assert_eq!(background(""), 8 * 62);
        assert_eq!(background("motors = [2]\nfields = ['cs_program_status', 'x_target_position']"), 6);
    }

    #[test]
    fn what_there_is_not_is_refused_by_name() {
        for (text, reason) in [
            ("motors = [9]", "there is no motor 9; write 1 to 8"),
            ("motors = [0]", "there is no motor 0"),
            ("motors = [-1]", "there is no motor -1"),
            (
                "fields = ['following_error']",
                "there is no servo field `following_error`; there are commanded_position, ",
            ),
            ("spares = false", "unknown field `spares`"),
        ] {
            let error = toml::from_str::<ServoSettings>(text).unwrap_err().to_string();
            assert!(error.contains(reason), "{text}: {error}");
        }
        assert!(toml::from_str::<BackgroundSettings>("fields = ['spare']").is_err());
    }

    #[test]
    fn functions_go_by_their_names() {
        #[derive(Deserialize)]
        struct File {
            #[serde(default)]
            functions: Functions,
        }
        let parse = |text: &str| toml::from_str::<File>(text).map(|file| file.functions);
        assert!(Function::ALL.into_iter().all(|function| parse("").unwrap().has(function)));
        let two = parse("functions = ['servo', 'gather']").unwrap();
        assert!(two.has(Function::Gather) && !two.has(Function::Ascii));
        assert!(
            parse("functions = ['mailbox']").unwrap_err().to_string().contains("unknown variant `mailbox`")
        );
        for function in Function::ALL {
            assert_eq!(serde_json::to_value(function).unwrap(), function.name());
        }
    }
}
