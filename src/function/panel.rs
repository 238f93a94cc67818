//! The control panel: jog, home, run, stop and feed rate override without a command line (DPRAM manual p. 12-13). A
//! [`PanelBlock`] says where the panel's words lie, and for how many numbers.
//!
//! | word | host | PMAC |
//! |---|---|---|
//! | `request` | writes what motor or coordinate system 1, 2, ... shall do | reads |
//! | `request_enable` | sets, last, for whom the requests are | clears the whole word when it acts |
//! | `feed_override` | writes the override of coordinate system 1, 2, ... | reads |
//! | `override_enable` | sets, last, and clears whose override is taken from here | reads, never clears |
//!
//! PMAC looks only while the panel is enabled (I2=3). No word tells whether it is enabled: the host only sees that
//! PMAC never takes a request. PMAC clears all of `request_enable`, so the next request waits until that word is 0: a
//! bit set in between would be lost. PMAC clears the word "on taking action" (p. 13). If the host takes a request back
//! while PMAC acts on it, PMAC still clears the word, and wipes out a request that the host has put there meanwhile.
//! After taking a request back the host therefore waits for [`PANEL_REST`], or asks twice.
//!
//! Motor n and coordinate system n share a request word. The manual says that two jog bits together mean stop. It is
//! silent on every other pair of requests to the same motor or coordinate system, so the driver refuses those pairs.

use std::str::FromStr;
use std::time::Duration;

use crate::device::{Bus, BusError};
use crate::map::functions::panel_request as bit;
use crate::map::{HostOffset, PanelBlock};

/// How long after it took a request back the host writes only stops to the panel: PMAC may be acting on that request.
pub const PANEL_REST: Duration = Duration::from_millis(50);
/// The bits that a motor acts on.
const MOTOR_BITS: u16 = bit::JOG_MINUS | bit::JOG_PLUS | bit::PRE_JOG | bit::HOME;
/// The most numbers a panel can have: an enable word has a bit for each.
const MOST_NUMBERS: usize = 16;

/// An action that a panel can ask for.
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
            Self::JogMinus => bit::JOG_MINUS,
            Self::JogPlus => bit::JOG_PLUS,
            Self::JogStop => bit::JOG_MINUS | bit::JOG_PLUS,
            Self::PreJog => bit::PRE_JOG,
            Self::Home => bit::HOME,
            Self::Start => bit::START,
            Self::Step => bit::STEP,
            Self::Stop => bit::STOP,
            Self::Hold => bit::FEED_HOLD,
        }
    }

    /// Whether the action is for motors; the other actions are for coordinate systems.
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

/// Why the driver refused a panel request or an override. It has written nothing then.
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
    #[error("the panel has numbers 1 to {numbers}, not {number}")]
    Number {
        /// The requested number.
        number: usize,
        /// How many the panel has.
        numbers: usize,
    },
    /// Two actions that exclude each other.
    #[error("{action} for number {number} contradicts what was asked of it before in the same request")]
    Contradiction {
        /// The motor or coordinate system.
        number: usize,
        /// The action that came second.
        action: PanelAction,
    },
    /// Not a percentage.
    #[error("{0} % is not a feed rate override; write 0 or more")]
    Percent(f64),
    /// A raw override that the word has no room for.
    #[error("a feed rate override is 0 to 32767 (in 1/32768 ms), not {0}")]
    Raw(u32),
    /// A servo period of 0.
    #[error("with I10 = 0 a percentage means nothing; give the override as a raw value or say what I10 is")]
    NoServoPeriod,
}

/// A request to several motors and coordinate systems at once.
#[derive(Clone, Copy, PartialEq, Eq, Default)]
pub struct PanelRequest {
    /// Whose words count: bit 0 is number 1.
    mask: u32,
    /// The request words, number 1 first.
    words: [u16; MOST_NUMBERS],
}

impl PanelRequest {
    /// Asks `action` of each of `numbers`, counted from 1.
    ///
    /// # Errors
    /// A number that `panel` has not.
    pub fn of(panel: &PanelBlock, action: PanelAction, numbers: &[usize]) -> Result<Self, PanelError> {
        numbers.iter().try_fold(Self::default(), |request, &number| request.and(panel, action, number))
    }

    /// Also asks `action` of `number`. Jog minus and jog plus add up to stop.
    ///
    /// # Errors
    /// A number that `panel` does not have; two actions for one motor, or for one coordinate system, that exclude each
    /// other.
    pub fn and(mut self, panel: &PanelBlock, action: PanelAction, number: usize) -> Result<Self, PanelError> {
        check_number(panel, number)?;
        let jogs = bit::JOG_MINUS | bit::JOG_PLUS;
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

    /// Stops the motors in `mask` that jog; bit 0 is motor 1.
    #[must_use]
    pub fn jog_stop(mask: u32) -> Self {
        let word = |index| if mask >> index & 1 == 0 { 0 } else { PanelAction::JogStop.bits() };
        Self { mask, words: std::array::from_fn(word) }
    }

    /// Two requests as one. Does not check for conflicts: use it only for stops, which never conflict.
    #[must_use]
    pub fn together_with(mut self, other: &Self) -> Self {
        self.mask |= other.mask;
        for (number, word) in other.asked() {
            self.words[number - 1] |= word;
        }
        self
    }

    /// Whose words count: bit 0 is number 1.
    #[must_use]
    pub const fn mask(&self) -> u32 {
        self.mask
    }

    /// The action, if the request asks the same of all its numbers.
    #[must_use]
    pub fn action(&self) -> Option<PanelAction> {
        let (_, first) = self.asked().next()?;
        let action = PanelAction::ALL.into_iter().find(|action| action.bits() == first)?;
        self.asked().all(|(_, word)| word == first).then_some(action)
    }

    /// The numbers that the request is for, and the request word of each.
    fn asked(&self) -> impl Iterator<Item = (usize, u16)> {
        (1..).zip(self.words).filter(|(number, _)| self.mask >> (number - 1) & 1 != 0)
    }

    /// The motors whose jog the request stops and of which it asks no other action: bit 0 is number 1.
    #[must_use]
    pub fn stops(&self) -> u32 {
        let stops = self.asked().filter(|(_, word)| *word == PanelAction::JogStop.bits());
        stops.fold(0, |mask, (number, _)| mask | 1 << (number - 1))
    }

    /// Whether the request only stops motors that jog.
    #[must_use]
    pub fn is_stop(&self) -> bool {
        self.stops() == self.mask
    }

    /// Whether the request only stops, aborts and holds, so that the host may ask PMAC twice.
    #[must_use]
    pub fn ends_motion(&self) -> bool {
        let jogs = PanelAction::JogStop.bits();
        let ending = jogs | PanelAction::Stop.bits() | PanelAction::Hold.bits();
        let stops = |word: u16| word & jogs == 0 || word & jogs == jogs;
        self.asked().all(|(_, word)| word != 0 && word & !ending == 0 && stops(word))
    }
}

impl std::fmt::Debug for PanelRequest {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_map().entries(self.asked().map(|(number, word)| (number, format!("{word:#06x}")))).finish()
    }
}

fn check_number(panel: &PanelBlock, number: usize) -> Result<(), PanelError> {
    let numbers = panel.numbers;
    if (1..=numbers).contains(&number) { Ok(()) } else { Err(PanelError::Number { number, numbers }) }
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

    /// `percent` of real time with the servo period `i10` (I10, in 1/8388608 ms). A value that the word has no room
    /// for becomes [`FeedOverride::MAXIMUM`]; [`FeedOverride::percent`] tells the percentage that applies then.
    ///
    /// # Errors
    /// A negative percentage, or not a number; I10 = 0.
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

    /// The override in percent of real time with the servo period `i10`; `None` if `i10` is 0.
    #[must_use]
    pub fn percent(self, i10: u32) -> Option<f64> {
        (i10 != 0).then(|| f64::from(self.0) * UNITS_OF_I10 * 100.0 / f64::from(i10))
    }
}

/// One unit of the override word in units of I10: 1/32768 ms over 1/8388608 ms.
const UNITS_OF_I10: f64 = 256.0;

/// The panel as it lies in the DPRAM.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PanelWords {
    /// The numbers whose request PMAC has not taken yet.
    pub request_enable: u16,
    /// The coordinate systems whose override PMAC takes from the panel.
    pub override_enable: u16,
    /// The request words, number 1 first, as last written.
    pub requests: Vec<u16>,
    /// The overrides, coordinate system 1 first, valid or not.
    pub overrides: Vec<u16>,
}

impl PanelWords {
    /// The panel in `words`, which begin at the region's start. Missing words count as 0.
    #[must_use]
    pub fn of(panel: &PanelBlock, words: &[u16]) -> Self {
        let word =
            |at: HostOffset| words.get(at.words_since(panel.region.start)).copied().unwrap_or_default();
        let all = |first| (0..panel.numbers).map(|index| word(place(panel, first, index))).collect();
        Self {
            request_enable: word(panel.request_enable),
            override_enable: word(panel.override_enable),
            requests: all(panel.request),
            overrides: all(panel.feed_override),
        }
    }
}

/// Where the word of number `index + 1` lies, if the word of number 1 is at `first`.
const fn place(panel: &PanelBlock, first: HostOffset, index: usize) -> HostOffset {
    first.plus_words(index * panel.stride)
}

/// The host's half of the panel.
#[derive(Debug)]
pub struct Panel {
    words: &'static PanelBlock,
    /// The host's enable bits of the overrides, once the host has read them.
    override_enable: Option<u16>,
}

impl Panel {
    /// A panel in `words` that has not looked at the board yet.
    #[must_use]
    pub const fn new(words: &'static PanelBlock) -> Self {
        Self { words, override_enable: None }
    }

    /// Takes over from an earlier host. Withdraws a request that PMAC has not taken, since no client waits for it any
    /// more. Keeps the overrides in force, since ending one changes the speed of a running machine. 1 read, 1 write.
    /// The caller also calls this after a reset of the board.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn acquire(&mut self, bus: &mut impl Bus) -> Result<(), BusError> {
        self.withdraw(bus)?;
        self.override_enable = None;
        self.enabled_overrides(bus)?;
        Ok(())
    }

    /// Hands `request` to PMAC. `Ok(false)`: PMAC has not taken the last request, or the board is absent; try later. 1
    /// read, 1 write, and 1 write a number.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn begin(&self, bus: &mut impl Bus, request: &PanelRequest) -> Result<bool, BusError> {
        if !self.taken(bus)? {
            return Ok(false);
        }
        for (number, word) in request.asked() {
            bus.write16(place(self.words, self.words.request, number - 1), word)?;
        }
        bus.order_writes();
        bus.write16(self.words.request_enable, request.mask as u16)?;
        bus.order_writes();
        Ok(true)
    }

    /// Whether PMAC has taken the last request. 1 read. An absent board reads as all ones and has not taken it.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn taken(&self, bus: &mut impl Bus) -> Result<bool, BusError> {
        Ok(bus.read16(self.words.request_enable)? == 0)
    }

    /// Takes back a request that PMAC has not taken. PMAC may take the request at this very moment; the host cannot
    /// know whether it did. 1 write.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn withdraw(&self, bus: &mut impl Bus) -> Result<(), BusError> {
        bus.write16(self.words.request_enable, 0)?;
        bus.order_writes();
        Ok(())
    }

    /// Sets the override of coordinate system `number`. PMAC takes the override from the panel until the host releases
    /// it, also across restarts of the host. The override acts only while the coordinate system's Ix93 points to the
    /// register that PMAC copies the override to ([`crate::map::Family::override_register`]). `Ok(false)`: the board
    /// is absent. 2 writes; 1 read the first time.
    ///
    /// # Errors
    /// A number that the panel does not have, or a bus out of reach.
    pub fn set_override(
        &mut self,
        bus: &mut impl Bus,
        number: usize,
        value: FeedOverride,
    ) -> Result<bool, PanelBusError> {
        check_number(self.words, number)?;
        let Some(enabled) = self.enabled_overrides(bus)? else { return Ok(false) };
        bus.write16(place(self.words, self.words.feed_override, number - 1), value.raw())?;
        bus.order_writes();
        self.enable_overrides(bus, enabled | 1 << (number - 1))?;
        Ok(true)
    }

    /// Makes PMAC stop taking the override of coordinate system `number` from the panel. `Ok(false)`: the board is
    /// absent. PMAC keeps the last value in its own register. 1 write; 1 read the first time.
    ///
    /// # Errors
    /// A number that the panel does not have, or a bus out of reach.
    pub fn release_override(&mut self, bus: &mut impl Bus, number: usize) -> Result<bool, PanelBusError> {
        check_number(self.words, number)?;
        let Some(enabled) = self.enabled_overrides(bus)? else { return Ok(false) };
        self.enable_overrides(bus, enabled & !(1 << (number - 1)))?;
        Ok(true)
    }

    /// The bits of an enable word that stand for a number.
    const fn used_bits(&self) -> u16 {
        ((1_u32 << self.words.numbers) - 1) as u16
    }

    fn enabled_overrides(&mut self, bus: &mut impl Bus) -> Result<Option<u16>, BusError> {
        if self.override_enable.is_none() {
            let word = bus.read16(self.words.override_enable)?;
            // An enable word of all ones means an absent board.
            self.override_enable = (word != u16::MAX).then_some(word & self.used_bits());
        }
        Ok(self.override_enable)
    }

    fn enable_overrides(&mut self, bus: &mut impl Bus, enabled: u16) -> Result<(), BusError> {
        bus.write16(self.words.override_enable, enabled)?;
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

#[cfg(test)]
#[path = "panel_tests.rs"]
mod tests;
