//! The settings of a board that no manual decides. The daemon checks them at the start, and again once it knows the
//! firmware.

use super::span::Refusal;
use crate::map::{BadFirmware, BufferLayout, Family, Firmware};
use crate::protocol::settings::{BoardSettings, VariableMode};

/// The settings, checked for a family.
#[derive(Debug, Clone)]
pub struct CheckedSettings {
    settings: BoardSettings,
    family: &'static Family,
    layout: BufferLayout,
}

impl CheckedSettings {
    /// Checks `settings` for a board of `family`. The daemon knows the firmware here only if the configuration gives
    /// it.
    ///
    /// # Errors
    /// Names the setting, its value and the allowed values, or the buffers that overlap.
    pub fn decide(
        settings: BoardSettings,
        family: &'static Family,
        firmware: Option<&str>,
    ) -> Result<Self, Refusal> {
        let settings = BoardSettings { plan: settings.plan.of(family), ..settings };
        let firmware = firmware
            .map(str::parse)
            .transpose()
            .map_err(|error: BadFirmware| Refusal::of("firmware", error))?;
        settings
            .rotary
            .check()
            .map_err(|error| Refusal::of(format!("rotary.{}", error.name), format!("[rotary] {error}")))?;
        let layout = layout(&settings, family, firmware).map_err(|error| Refusal::of("plan", error))?;
        Ok(Self { settings, family, layout })
    }

    /// The settings as written, with defaults, the family's among them.
    #[must_use]
    pub const fn settings(&self) -> &BoardSettings {
        &self.settings
    }

    /// The board's family.
    #[must_use]
    pub const fn family(&self) -> &'static Family {
        self.family
    }

    /// The layout of the buffers before the daemon knows the board's firmware.
    #[must_use]
    pub const fn layout(&self) -> BufferLayout {
        self.layout
    }

    /// The layout of the buffers for the board's `firmware`. An invalid version changes nothing.
    ///
    /// # Errors
    /// Names the buffers that overlap because this firmware moves the gather buffer.
    pub fn layout_for(&self, firmware: Option<&str>) -> Result<BufferLayout, String> {
        match firmware.and_then(|text| text.parse().ok()) {
            None => Ok(self.layout),
            known => layout(&self.settings, self.family, known),
        }
    }

    /// The settings for background variables.
    #[must_use]
    pub fn variable_mode(&self) -> VariableMode {
        self.settings.variables.mode
    }
}

fn layout(
    settings: &BoardSettings,
    family: &'static Family,
    firmware: Option<Firmware>,
) -> Result<BufferLayout, String> {
    BufferLayout::new(&settings.layout(family, firmware), &settings.plan)
        .map_err(|error| format!("[plan] {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::{HostOffset, PMAC};

    fn decided(settings: BoardSettings) -> Result<CheckedSettings, String> {
        CheckedSettings::decide(settings, &PMAC, None).map_err(|refusal| refusal.text)
    }

    #[test]
    fn the_gather_buffer_is_kept_where_the_firmware_has_it() {
        let checked = decided(BoardSettings::default()).unwrap();
        let start = |layout: BufferLayout| layout.gather().start;
        assert_eq!(start(checked.layout()), HostOffset::new(0x0800));
        assert_eq!(start(checked.layout_for(Some("1.16D")).unwrap()), HostOffset::new(0x0900));
        for other in [Some("1.13"), Some("hello"), None] {
            assert_eq!(start(checked.layout_for(other).unwrap()), HostOffset::new(0x0800), "{other:?}");
        }
    }

    #[test]
    fn what_cannot_be_is_said_by_name() {
        let mut settings = BoardSettings::default();
        settings.rotary.exponent_bias = 64;
        assert_eq!(decided(settings).unwrap_err(), "[rotary] exponent_bias = 64: 0 to 63");
        let mut settings = BoardSettings::default();
        settings.plan.variable_write_start = 0xD300;
        let error = decided(settings).unwrap_err();
        assert!(error.starts_with("[plan] ") && error.contains("variable_write"), "{error}");
        // Room up to the tables as printed, and 64 longs too much where the firmware has moved the buffer.
        let mut settings = BoardSettings::default();
        settings.plan.gather_longs = 0x820;
        let checked = decided(settings).unwrap();
        assert!(checked.layout_for(Some("1.16D")).unwrap_err().contains("overlap"));
    }
}
