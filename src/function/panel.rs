//! The control panel: jog, home, run, stop and feed rate override without a command line (DPRAM manual p. 12-13).
//!
//! | word | host | PMAC |
//! |---|---|---|
//! | 0x0004, 0x0008, ... | writes what motor or coordinate system 1, 2, ... shall do | reads |
//! | 0x0000 bits 7-0 | sets, last, for whom the requests are | clears the whole word when it acts |
//! | 0x0006, 0x000A, ... | writes the override of coordinate system 1, 2, ... | reads |
//! | 0x0002 bits 7-0 | sets, last, and clears whose override is taken from here | reads, never clears |
//!
//! PMAC looks only while I2 is 3; no word tells whether it does, so a request that is never taken is all that shows.
//! Because PMAC clears all of 0x0000, the next request waits until it is 0: a bit set in between would be lost.
//!
//! Motor n and coordinate system n share a request word. The manual says what two jog bits together mean (stop), and
//! about no other pair of requests to the same motor or the same coordinate system; such pairs are refused here.

use std::str::FromStr;

use crate::device::{Bus, BusError};
use crate::map::HostOffset;
use crate::map::classic::{
    self, MOTORS, PANEL_FEED_HOLD, PANEL_HOME, PANEL_JOG_MINUS, PANEL_JOG_PLUS, PANEL_OVERRIDE,
    PANEL_OVERRIDE_ENABLE, PANEL_PRE_JOG, PANEL_REQUEST, PANEL_REQUEST_ENABLE, PANEL_START, PANEL_STEP,
    PANEL_STOP, PANEL_STRIDE,
};

/// The bits a motor acts on.
const MOTOR_BITS: u16 = PANEL_JOG_MINUS | PANEL_JOG_PLUS | PANEL_PRE_JOG | PANEL_HOME;
/// Words of the panel, 0x0000-0x0023.
pub const PANEL_WORDS: usize = classic::PANEL.words();
/// The enable bits there are, one a number.
const NUMBERS: u16 = 0x00FF;

/// Something a panel can ask for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PanelAction {
    /// Motor: jog in negative direction until stopped.
    JogMinus,
    /// Motor: jog in positive direction until stopped.
    JogPlus,
    /// Motor: stop jogging; jog minus and jog plus together.
    JogStop,
    /// Motor: return to the position before the last jog.
    PreJog,
    /// Motor: home search.
    Home,
    /// Coordinate system: run.
    Start,
    /// Coordinate system: one step; while it runs, quit.
    Step,
    /// Coordinate system: abort.
    Stop,
    /// Coordinate system: feed hold.
    Hold,
}

impl PanelAction {
    /// Every action.
    pub const ALL: [Self; 9] = [
        Self::JogMinus,
        Self::JogPlus,
        Self::JogStop,
        Self::PreJog,
        Self::Home,
        Self::Start,
        Self::Step,
        Self::Stop,
        Self::Hold,
    ];

    /// Its bits in a request word.
    #[must_use]
    pub const fn bits(self) -> u16 {
        match self {
            Self::JogMinus => PANEL_JOG_MINUS,
            Self::JogPlus => PANEL_JOG_PLUS,
            Self::JogStop => PANEL_JOG_MINUS | PANEL_JOG_PLUS,
            Self::PreJog => PANEL_PRE_JOG,
            Self::Home => PANEL_HOME,
            Self::Start => PANEL_START,
            Self::Step => PANEL_STEP,
            Self::Stop => PANEL_STOP,
            Self::Hold => PANEL_FEED_HOLD,
        }
    }

    /// Whether it is for motors; the others are for coordinate systems.
    #[must_use]
    pub const fn is_for_motors(self) -> bool {
        self.bits() & MOTOR_BITS != 0
    }

    /// Its name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::JogMinus => "jog-",
            Self::JogPlus => "jog+",
            Self::JogStop => "jog-stop",
            Self::PreJog => "pre-jog",
            Self::Home => "home",
            Self::Start => "start",
            Self::Step => "step",
            Self::Stop => "stop",
            Self::Hold => "hold",
        }
    }
}

impl std::fmt::Display for PanelAction {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for PanelAction {
    type Err = PanelError;

    fn from_str(text: &str) -> Result<Self, PanelError> {
        Self::ALL
            .into_iter()
            .find(|action| action.name().eq_ignore_ascii_case(text))
            .ok_or_else(|| PanelError::Action(text.to_owned()))
    }
}

/// Why a panel request or an override was refused. Nothing has been written then.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PanelError {
    /// No such action.
    #[error(
        "the panel has no action {0:?}; it has jog-, jog+, jog-stop, pre-jog and home for motors, \
         start, step, stop and hold for coordinate systems"
    )]
    Action(String),
    /// No such motor or coordinate system.
    #[error("the panel has numbers 1 to 8, not {0}")]
    Number(usize),
    /// Two actions that exclude each other.
    #[error("{action} for number {number} contradicts what was asked of it before in the same request")]
    Contradiction {
        /// The motor or coordinate system.
        number: usize,
        /// The action that came second.
        action: PanelAction,
    },
    /// A percentage that is none.
    #[error("{0} % is not a feed rate override; write 0 or more")]
    Percent(f64),
    /// A raw override the word has no room for.
    #[error("a feed rate override is 0 to 32767 (in 1/32768 ms), not {0}")]
    Raw(u32),
    /// A servo period of nothing.
    #[error("with I10 = 0 a percentage means nothing; give the override as a raw value or say what I10 is")]
    NoServoPeriod,
}

/// What is asked of which motors and coordinate systems, all at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PanelRequest {
    /// Whose words count: bit 0 is number 1.
    pub mask: u8,
    /// The request words of numbers 1 to 8.
    pub words: [u16; MOTORS],
}

impl PanelRequest {
    /// Asks `action` of each of `numbers` (1-8).
    ///
    /// # Errors
    /// A number there is not.
    pub fn of(action: PanelAction, numbers: &[usize]) -> Result<Self, PanelError> {
        numbers.iter().try_fold(Self::default(), |request, &number| request.and(action, number))
    }

    /// Also asks `action` of `number` (1-8). Jog minus and jog plus add up to stop.
    ///
    /// # Errors
    /// A number there is not; two actions for one motor, or for one coordinate system, that exclude each other.
    pub fn and(mut self, action: PanelAction, number: usize) -> Result<Self, PanelError> {
        check_number(number)?;
        let jogs = PANEL_JOG_MINUS | PANEL_JOG_PLUS;
        let same_kind = if action.is_for_motors() { MOTOR_BITS } else { !MOTOR_BITS };
        let word = &mut self.words[number - 1];
        let others = *word & same_kind & !action.bits();
        let both_jog = action.bits() & !jogs == 0 && others & !jogs == 0;
        if others != 0 && !both_jog {
            return Err(PanelError::Contradiction { number, action });
        }
        *word |= action.bits();
        self.mask |= 1 << (number - 1);
        Ok(self)
    }
}

impl PanelRequest {
    /// Two requests as one. Nothing is checked: meant for stops, of which two do not exclude each other.
    #[must_use]
    pub fn together_with(mut self, other: &Self) -> Self {
        self.mask |= other.mask;
        for (word, added) in self.words.iter_mut().zip(other.words) {
            *word |= added;
        }
        self
    }

    /// The motors it stops jogging, and of which it wants nothing else: bit 0 is number 1.
    #[must_use]
    pub fn stops(&self) -> u8 {
        let is_stop = |index: &usize| self.words[*index] == PanelAction::JogStop.bits();
        (0..MOTORS).filter(is_stop).fold(0, |mask, index| mask | 1 << index) & self.mask
    }
}

fn check_number(number: usize) -> Result<(), PanelError> {
    if (1..=MOTORS).contains(&number) { Ok(()) } else { Err(PanelError::Number(number)) }
}

/// A feed rate override as the DPRAM holds it: the time, in 1/32768 ms, that a servo cycle counts for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct FeedOverride(u16);

impl FeedOverride {
    /// The largest value: 225.87 % at the default I10.
    pub const MAXIMUM: Self = Self(0x7FFF);

    /// The override whose word is `raw`.
    ///
    /// # Errors
    /// More than 32767.
    pub fn from_raw(raw: u32) -> Result<Self, PanelError> {
        match u16::try_from(raw) {
            Ok(word) if word <= Self::MAXIMUM.0 => Ok(Self(word)),
            _ => Err(PanelError::Raw(raw)),
        }
    }

    /// `percent` of real time with the servo period `i10` (I10, in 1/8388608 ms). More than the word has room for
    /// becomes [`FeedOverride::MAXIMUM`]; what was meant and what was made of it differ then, which
    /// [`FeedOverride::percent`] tells.
    ///
    /// # Errors
    /// A negative percentage, or one that is no number; I10 = 0.
    pub fn from_percent(percent: f64, i10: u32) -> Result<Self, PanelError> {
        if !percent.is_finite() || percent < 0.0 {
            return Err(PanelError::Percent(percent));
        }
        if i10 == 0 {
            return Err(PanelError::NoServoPeriod);
        }
        let raw = (percent / 100.0 * f64::from(i10) / UNITS_OF_I10).round();
        Ok(if raw < f64::from(Self::MAXIMUM.0) { Self(raw as u16) } else { Self::MAXIMUM })
    }

    /// The word.
    #[must_use]
    pub const fn raw(self) -> u16 {
        self.0
    }

    /// In percent of real time with the servo period `i10`; `None` when that is 0.
    #[must_use]
    pub fn percent(self, i10: u32) -> Option<f64> {
        (i10 != 0).then(|| f64::from(self.0) * UNITS_OF_I10 * 100.0 / f64::from(i10))
    }
}

/// One unit of the override word in units of I10: 1/32768 ms over 1/8388608 ms.
const UNITS_OF_I10: f64 = 256.0;

/// The panel as it lies in the DPRAM.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PanelWords {
    /// 0x0000: whose request PMAC has not taken yet.
    pub request_enable: u16,
    /// 0x0002: whose override comes from here.
    pub override_enable: u16,
    /// The request words of numbers 1 to 8, as last written.
    pub requests: [u16; MOTORS],
    /// The overrides of coordinate systems 1 to 8, valid or not.
    pub overrides: [u16; MOTORS],
}

impl PanelWords {
    /// The panel in its words, the first being the one at 0x0000.
    #[must_use]
    pub fn of(words: &[u16; PANEL_WORDS]) -> Self {
        let word = |first: HostOffset, index| words[at(first, index).word() - PANEL_REQUEST_ENABLE.word()];
        Self {
            request_enable: word(PANEL_REQUEST_ENABLE, 0),
            override_enable: word(PANEL_OVERRIDE_ENABLE, 0),
            requests: std::array::from_fn(|index| word(PANEL_REQUEST, index)),
            overrides: std::array::from_fn(|index| word(PANEL_OVERRIDE, index)),
        }
    }
}

/// The host's half of the panel.
#[derive(Debug, Default)]
pub struct Panel {
    /// The host's enable bits in 0x0002, once they were read.
    override_enable: Option<u16>,
}

impl Panel {
    /// A panel that has not looked at the board yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes over from whatever host was there before: a request PMAC has not taken is withdrawn, since nobody waits
    /// for it any more; the overrides in force are adopted as they are, since to end one changes the speed of a
    /// machine that runs. Returns the mask of the withdrawn request. 2 reads, 1 write. Also to be called after a
    /// reset of the board.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn take_over(&mut self, bus: &mut impl Bus) -> Result<u8, BusError> {
        let left = bus.read16(PANEL_REQUEST_ENABLE)?;
        Self::withdraw(bus)?;
        self.override_enable = None;
        self.enabled_overrides(bus)?;
        Ok((left & NUMBERS) as u8)
    }

    /// Puts `request` to PMAC. `Ok(false)`: PMAC has not taken the last one, or there is no board; try later.
    /// 1 read, and 1 write more than numbers are concerned.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn begin(bus: &mut impl Bus, request: &PanelRequest) -> Result<bool, BusError> {
        if !Self::taken(bus)? {
            return Ok(false);
        }
        for (index, word) in request.words.iter().enumerate() {
            if request.mask & 1 << index != 0 {
                bus.write16(at(PANEL_REQUEST, index), *word)?;
            }
        }
        bus.order_writes();
        bus.write16(PANEL_REQUEST_ENABLE, u16::from(request.mask))?;
        bus.order_writes();
        Ok(true)
    }

    /// Whether PMAC has taken the last request. 1 read. An absent board, which reads as all ones, has not.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn taken(bus: &mut impl Bus) -> Result<bool, BusError> {
        Ok(Self::mask(bus)? == 0)
    }

    /// For whom the request in the panel is, bit 0 being number 1: 0 when PMAC has taken the last one, all ones where there is
    /// no board. 1 read.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn mask(bus: &mut impl Bus) -> Result<u16, BusError> {
        bus.read16(PANEL_REQUEST_ENABLE)
    }

    /// Takes back a request PMAC has not taken. PMAC may take it in this very moment; whether it did cannot be known.
    /// 1 write.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn withdraw(bus: &mut impl Bus) -> Result<(), BusError> {
        bus.write16(PANEL_REQUEST_ENABLE, 0)?;
        bus.order_writes();
        Ok(())
    }

    /// Sets the override of coordinate system `number` and has PMAC take it from here until it is released, across
    /// restarts of the host too. It acts only while the coordinate system's Ix93 points to the register PMAC copies
    /// it to ($0806 + $C0*(n-1)). `Ok(false)`: there is no board. 2 writes; 1 read the first time.
    ///
    /// # Errors
    /// A number there is not, or the bus cannot be reached.
    pub fn set_override(
        &mut self,
        bus: &mut impl Bus,
        number: usize,
        value: FeedOverride,
    ) -> Result<bool, PanelBusError> {
        check_number(number)?;
        let Some(enabled) = self.enabled_overrides(bus)? else { return Ok(false) };
        bus.write16(at(PANEL_OVERRIDE, number - 1), value.raw())?;
        bus.order_writes();
        self.enable_overrides(bus, enabled | 1 << (number - 1))?;
        Ok(true)
    }

    /// Has PMAC take the override of coordinate system `number` from here no longer. `Ok(false)`: there is no board.
    /// PMAC keeps the last value in its own register. 1 write; 1 read the first time.
    ///
    /// # Errors
    /// A number there is not, or the bus cannot be reached.
    pub fn release_override(&mut self, bus: &mut impl Bus, number: usize) -> Result<bool, PanelBusError> {
        check_number(number)?;
        let Some(enabled) = self.enabled_overrides(bus)? else { return Ok(false) };
        self.enable_overrides(bus, enabled & !(1 << (number - 1)))?;
        Ok(true)
    }

    /// The whole panel as it lies there. 18 reads.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn show(bus: &mut impl Bus) -> Result<PanelWords, BusError> {
        let mut words = [0; PANEL_WORDS];
        bus.read_block(PANEL_REQUEST_ENABLE, &mut words)?;
        Ok(PanelWords::of(&words))
    }

    fn enabled_overrides(&mut self, bus: &mut impl Bus) -> Result<Option<u16>, BusError> {
        if self.override_enable.is_none() {
            let word = bus.read16(PANEL_OVERRIDE_ENABLE)?;
            // Bits 15-8 are not used; all of them set is an absent board.
            self.override_enable = (word != u16::MAX).then_some(word & NUMBERS);
        }
        Ok(self.override_enable)
    }

    fn enable_overrides(&mut self, bus: &mut impl Bus, enabled: u16) -> Result<(), BusError> {
        bus.write16(PANEL_OVERRIDE_ENABLE, enabled)?;
        bus.order_writes();
        self.override_enable = Some(enabled);
        Ok(())
    }
}

/// A refused override, or a bus out of reach.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PanelBusError {
    /// Refused; nothing has been written.
    #[error(transparent)]
    Refused(#[from] PanelError),
    /// The bus.
    #[error(transparent)]
    Bus(#[from] BusError),
}

const fn at(first: HostOffset, index: usize) -> HostOffset {
    first.plus_words(index * (PANEL_STRIDE as usize / 2))
}

#[cfg(test)]
#[path = "panel_tests.rs"]
mod tests;
