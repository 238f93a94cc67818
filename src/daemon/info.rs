//! What `GetInfo` answers: written as the daemon learns it, read by the socket's thread.
//!
//! The bus thread only stores atomics or tries the lock, so no reader ever holds it up.

use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use super::ascii_desk::PortState;
use super::host_link::HostPortCounts;
use super::response_port::Way;
use crate::protocol::{BoardInfo, BoardSettings, CommandPort, CommandState, Enabled, State};

/// The daemon's present knowledge of its board.
#[derive(Debug, Default)]
pub struct SharedInfo {
    info: Mutex<BoardInfo>,
    settings: BoardSettings,
    state: AtomicU32,
    enabled: AtomicU32,
    rounds: AtomicU64,
    command_port: AtomicU32,
    command_state: AtomicU32,
    served: AtomicU32,
    old: AtomicU32,
    unannounced: AtomicU32,
}

impl SharedInfo {
    /// Starts with `info`; its `state` and `enabled` are ignored, they have setters of their own. The `settings` stay.
    #[must_use]
    pub fn new(info: BoardInfo, settings: BoardSettings) -> Self {
        Self { info: Mutex::new(info), settings, ..Self::default() }
    }

    /// What `GetSettings` answers.
    #[must_use]
    pub fn settings(&self) -> &BoardSettings {
        &self.settings
    }

    /// Says whether the segment's data can be trusted. Never waits.
    pub fn set_state(&self, state: State) {
        self.state.store(state as u32, Ordering::Relaxed);
    }

    /// Says which automatic functions are at work. Never waits.
    pub fn set_enabled(&self, enabled: Enabled) {
        self.enabled.store(enabled.bits(), Ordering::Relaxed);
    }

    /// Says which port command lines go through. Never waits.
    pub fn set_command_port(&self, way: Way) {
        let port = match way {
            Way::Dpram => CommandPort::Dpram,
            Way::Mailbox => CommandPort::Mailbox,
        };
        self.command_port.store(port as u32, Ordering::Relaxed);
    }

    /// Says what became of the last command line. Never waits.
    pub fn set_command_state(&self, state: PortState) {
        let state = match state {
            PortState::Unknown => CommandState::Unknown,
            PortState::Answers => CommandState::Answers,
            PortState::Silent => CommandState::Silent,
        };
        self.command_state.store(state as u32, Ordering::Relaxed);
    }

    /// Says what the host port's interrupts have come to. Never waits.
    pub fn set_host_port(&self, counts: HostPortCounts) {
        self.served.store(counts.served, Ordering::Relaxed);
        self.old.store(counts.old, Ordering::Relaxed);
        self.unannounced.store(counts.unannounced, Ordering::Relaxed);
    }

    /// Changes the identity. May wait for a reader: not for the bus thread.
    pub fn update(&self, change: impl FnOnce(&mut BoardInfo)) {
        change(&mut self.info.lock().unwrap_or_else(PoisonError::into_inner));
    }

    /// Changes the identity unless a reader is at it just now; false asks for another try later. Never waits.
    pub fn try_update(&self, change: impl FnOnce(&mut BoardInfo)) -> bool {
        let held = self.info.try_lock();
        held.map(|mut info| change(&mut info)).is_ok()
    }

    /// Whether an automatic function is at work. Never waits.
    #[must_use]
    pub fn is_enabled(&self, function: Enabled) -> bool {
        Enabled::from_bits_truncate(self.enabled.load(Ordering::Relaxed)).contains(function)
    }

    /// The bus thread has made another round. Never waits.
    pub fn count_round(&self) {
        self.rounds.fetch_add(1, Ordering::Relaxed);
    }

    /// Rounds of the bus thread so far: while it lives, at least ten a second.
    #[must_use]
    pub fn rounds(&self) -> u64 {
        self.rounds.load(Ordering::Relaxed)
    }

    /// All of it.
    #[must_use]
    pub fn read(&self) -> BoardInfo {
        let mut info = self.info.lock().unwrap_or_else(PoisonError::into_inner).clone();
        info.state = match self.state.load(Ordering::Relaxed) {
            0 => State::Init,
            1 => State::Live,
            2 => State::Stale,
            _ => State::Dead,
        };
        info.command_port = match self.command_port.load(Ordering::Relaxed) {
            0 => CommandPort::Dpram,
            _ => CommandPort::Mailbox,
        };
        info.command_state = match self.command_state.load(Ordering::Relaxed) {
            0 => CommandState::Unknown,
            1 => CommandState::Answers,
            _ => CommandState::Silent,
        };
        if let Some(host_port) = &mut info.host_port {
            host_port.served = self.served.load(Ordering::Relaxed);
            host_port.old = self.old.load(Ordering::Relaxed);
            host_port.unannounced = self.unannounced.load(Ordering::Relaxed);
        }
        info.enabled = Enabled::from_bits_truncate(self.enabled.load(Ordering::Relaxed)).names();
        info
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_set_is_read() {
        let shared = SharedInfo::new(
            BoardInfo { name: "pmac0".to_owned(), ..BoardInfo::default() },
            BoardSettings::default(),
        );
        for state in [State::Init, State::Live, State::Stale, State::Dead] {
            shared.set_state(state);
            assert_eq!(shared.read().state, state);
        }
        shared.set_enabled(Enabled::SERVO | Enabled::INTERRUPT);
        assert_eq!(shared.read().command_state, CommandState::Unknown);
        for (state, told) in
            [(PortState::Answers, CommandState::Answers), (PortState::Silent, CommandState::Silent)]
        {
            shared.set_command_state(state);
            assert_eq!(shared.read().command_state, told);
        }
        shared.update(|info| info.motors = 8);
        assert!(shared.try_update(|info| info.pid = 7));
        let info = shared.read();
        assert_eq!((info.name.as_str(), info.motors, info.pid), ("pmac0", 8, 7));
        assert_eq!(info.enabled, ["servo", "interrupt"]);
        let reading = shared.info.lock().unwrap();
        assert!(!shared.try_update(|info| info.pid = 8));
        drop(reading);
    }
}
