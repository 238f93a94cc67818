//! Tells the log, the segment and the clients the changes of the board.

use std::fmt::Arguments;
use std::time::Instant;

use log::{Level, error, info, log, warn};

use crate::clock::Clock;
use crate::daemon::bus::memory_scan::{Outcome, Unclear};
use crate::daemon::bus::timing::LOG_QUOTA;
use crate::daemon::shared::function_use::FunctionUse;
use crate::daemon::shared::log_quota::LogQuota;
use crate::daemon::shared::queue::{Event, Sender};
use crate::daemon::shared::status::{BoardStatus, KnownIdentity};
use crate::map::{Family, LACKS_DPRAM, Motors, ReportStart, lacks_dpram};
use crate::mirror::Transition;
use crate::protocol::{CommandPort, CommandState, Function};
use crate::segment::{Identity, State};

/// The most changes that the log gets within a time. The data of a board that comes and goes would fill the log.
const TOLD: u32 = 20;

/// Logs changes, up to a quota.
struct ChangeLog {
    quota: Option<LogQuota>,
    clock: Clock,
}

impl ChangeLog {
    /// Logs a change, or counts it.
    fn tell(&mut self, level: Level, change: Arguments<'_>) {
        let now = self.clock.now();
        self.sum_up(now);
        if self.quota.get_or_insert(LogQuota::until(now + LOG_QUOTA)).may_tell(TOLD) {
            log!(level, "{change}");
        }
    }

    /// Ends the quota whose time is over, and logs how many changes it held back.
    fn sum_up(&mut self, now: Instant) {
        if let Some(quota) = self.quota.take_if(|quota| quota.end() <= now)
            && quota.untold() > 0
        {
            info!(
                "{} more such changes within {LOG_QUOTA:?}: the board, or what it reports, comes and goes",
                quota.untold()
            );
        }
    }
}

/// Keeps the last report, so that it tells only changes.
pub struct Reporter {
    /// The board's family, as the daemon takes it.
    family: &'static Family,
    /// The hints for the user if servo data are stale, if background data are stale, and if the board answers no
    /// command line.
    hints: [String; 3],
    /// The status for the clients; [`Self::send`] sends it.
    pub status: BoardStatus,
    sent: BoardStatus,
    /// The queue had no room for the last change.
    is_untold: bool,
    /// The port and state in the log: a port that was in doubt and answers as before has not changed.
    port_logged: Option<(CommandPort, CommandState)>,
    identity: Option<Identity>,
    /// The functions in use, as the log has them.
    uses: FunctionUse,
    bus_error: bool,
    log: ChangeLog,
}

impl Reporter {
    /// A reporter that has told nothing yet of a board of `family`.
    #[must_use]
    pub fn new(family: &'static Family, clock: Clock) -> Self {
        let i = &family.i;
        let reported = i.reported.map_or_else(String::new, |number| format!(", I{number}>0"));
        let (enable, period, background) = (i.servo_enable, i.servo_period, i.background_enable);
        Self {
            family,
            hints: [
                match (family.servo.start, i.servo_in_background) {
                    (ReportStart::Gather, _) => {
                        format!("is I{enable}=1, I{period}>0{reported}, and GATHER given?")
                    }
                    // Turbo User Manual p. 403: with a period of 0 the board makes a report whenever the host has taken
                    // the last one.
                    (ReportStart::Enable, None) => format!("is I{enable}=1?"),
                    (ReportStart::Enable, Some(other)) => {
                        format!("is I{enable}=1, or I{other}=1 and I{background}=1?")
                    }
                },
                format!("is I{background}=1{reported}?"),
                format!("is I{}=1?", i.ascii_enable),
            ],
            status: BoardStatus::default(),
            sent: BoardStatus::default(),
            is_untold: false,
            port_logged: None,
            identity: None,
            uses: FunctionUse::default(),
            bus_error: false,
            log: ChangeLog { quota: None, clock },
        }
    }

    /// The reporter of a replay: no host can change the settings of its board.
    pub fn of_replay(mut self) -> Self {
        self.hints = ["servo data", "background data", "answers"]
            .map(|what| format!("this is a replay: the recording has no {what} of this time"));
        self
    }

    /// Tells the clients the changes since the last call, in one event. If the queue is full, the next call tries
    /// again.
    pub fn send(&mut self, events: &Sender<Event>) {
        // Compares in place: most calls find no change, and a copy costs more than the comparison.
        let is_new = self.status != self.sent;
        self.is_untold = is_new && events.try_send(Event::Info(self.status)).is_err();
        if is_new && !self.is_untold {
            self.sent = self.status;
        }
    }

    /// Whether the clients have got every change; if not, the queue was full.
    #[must_use]
    pub const fn is_told(&self) -> bool {
        !self.is_untold
    }

    /// Ends the log's quota, if its time is over. The loop calls this now and then.
    pub fn tend_log(&mut self) {
        self.log.sum_up(self.log.clock.now());
    }

    /// Takes in whether the board shows life. `may_begin`: the board has had no time yet to show any. Returns the state
    /// after a change.
    pub fn board(&mut self, shows_life: bool, may_begin: bool) -> Option<State> {
        let state = match (shows_life, self.status.state) {
            (true, _) => State::Live,
            (false, State::Init) if may_begin => return None,
            (false, _) => State::Stale,
        };
        if std::mem::replace(&mut self.status.state, state) == state {
            return None;
        }
        if shows_life {
            self.log.tell(Level::Info, format_args!("board: live"));
        } else {
            let text = format_args!("board: stale, no servo data, no background data and no ASCII reply");
            self.log.tell(Level::Warn, text);
        }
        Some(state)
    }

    /// The loop ends, and with it the clients' view of the board.
    pub fn end(&mut self, events: &Sender<Event>) {
        self.status.state = State::Dead;
        self.send(events);
    }

    /// Another host or a reset has taken `motors` out of the servo report's mask; none: all are in the mask again.
    pub fn taken_out(&mut self, motors: Motors) {
        let (level, text) = match motors.len() {
            0 => (Level::Info, "servo data: every motor is reported again".to_owned()),
            count => (
                Level::Warn,
                format!(
                    "servo data: {count} of the motors are not reported any more: another host, or a reset, has changed the mask"
                ),
            ),
        };
        self.log.tell(level, format_args!("{text}"));
    }

    /// The data of a report have become live, or stale after so many nanoseconds.
    pub fn data(&mut self, report: Function, transition: Transition, stale_after_ns: u64) {
        let (data, what, hint) = match report {
            Function::Servo => ("servo data", "update", 0),
            _ => ("background data", "report", 1),
        };
        match transition {
            Transition::Live => self.log.tell(Level::Info, format_args!("{data}: live")),
            Transition::Stale => {
                let (ms, hint) = (stale_after_ns / 1_000_000, &self.hints[hint]);
                self.log.tell(Level::Warn, format_args!("{data}: stale, no {what} for {ms} ms ({hint})"));
            }
        }
    }

    /// The daemon has found the board reset.
    pub fn reset(&mut self) {
        self.log.tell(Level::Info, format_args!("the board was reset, or its memory cleared"));
    }

    /// The port that carries command lines, and its state.
    pub fn port(&mut self, port: CommandPort, state: CommandState) {
        if state == CommandState::Unknown || self.port_logged.replace((port, state)) == Some((port, state)) {
            return;
        }
        let (name, hint) = match port {
            CommandPort::Dpram => ("DPRAM ASCII", self.hints[2].as_str()),
            CommandPort::Mailbox => ("VME mailboxes", "is I3=2? are both interrupts there?"),
        };
        if state == CommandState::Answers {
            self.log.tell(Level::Info, format_args!("{name}: live"));
        } else {
            self.log.tell(Level::Warn, format_args!("{name}: no answer ({hint})"));
        }
    }

    /// Whether the board's identity differs from the last.
    #[must_use]
    pub fn is_new(&self, identity: &Identity) -> bool {
        self.identity.as_ref() != Some(identity)
    }

    /// The board's identity, and how many motors the daemon reads from it.
    pub fn identity(&mut self, identity: Identity, motors: usize) {
        let known = KnownIdentity {
            firmware: identity.firmware,
            board_type: identity.board_type,
            motors: u32::try_from(motors).unwrap_or(u32::MAX),
            servo_period_ns: identity.servo_period_ps.map(|ps| ps / 1000),
        };
        self.identity = Some(identity);
        if self.status.identity.replace(known) == Some(known) {
            // The change is no news for the log, such as a scale.
            return;
        }
        if let (Some(board_type), Some(firmware)) = (&known.board_type, &known.firmware) {
            info!("the board is {board_type}, firmware {firmware}, reports {motors} motors");
        }
        let board_type = known.board_type.as_deref();
        if let Some(other) = board_type.and_then(|answer| self.family.contradicted_by_type(answer)) {
            let level = if other.is_laid_out_otherwise() { Level::Error } else { Level::Info };
            log!(level, "{other}");
        }
        if board_type.is_some_and(lacks_dpram) {
            warn!("{LACKS_DPRAM}");
        }
    }

    /// Whether the board has told that it makes the servo report and the background report.
    #[must_use]
    pub fn reports(&self) -> [bool; 2] {
        let is_on = |told: fn(&Identity) -> Option<u32>| self.identity.as_ref().and_then(told) == Some(1);
        [is_on(|identity| identity.servo_report), is_on(|identity| identity.background_report)]
    }

    /// The targets of the board's M-variables, and the resulting use of the functions.
    pub fn pointers(&mut self, outcome: Outcome, uses: &FunctionUse) {
        let follows = "pmacd uses the functions of its configuration into whose words none is known to point, though programs \
                       may keep data there";
        match outcome {
            // The end of the questions tells them together.
            Outcome::More => return,
            Outcome::Known => {}
            Outcome::Unknown => {
                let text = "the board does not tell where its M-variables point";
                self.log.tell(Level::Warn, format_args!("{text}; {follows}"));
            }
            Outcome::Unclear(Unclear { variable, text }) => {
                let text = format_args!(
                    "the board answers M{variable}-> with \"{text}\", which is no definition of it; {follows}"
                );
                self.log.tell(Level::Warn, text);
            }
        }
        if uses.program_words(self.family).ne(self.uses.program_words(self.family)) {
            for words in uses.program_words(self.family) {
                self.log.tell(Level::Warn, format_args!("{words}"));
            }
        }
        self.uses = *uses;
    }

    /// The bus was out of reach.
    pub fn bus_error(&mut self, error: &dyn std::fmt::Display) {
        if !std::mem::replace(&mut self.bus_error, true) {
            error!("bus: {error}; further bus errors are only counted");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::ManualTime;
    use crate::daemon::shared::info::Info;
    use crate::daemon::shared::queue::queue;
    use crate::map::{PMAC, TURBO2};
    use crate::protocol::{BoardInfo, BoardSettings, Enabled};

    #[test]
    fn what_to_look_at_goes_by_the_family() {
        let [servo, background, ascii] = Reporter::new(&PMAC, Clock::real()).hints;
        assert_eq!(servo, "is I48=1, I19>0, I59>0, and GATHER given?");
        assert_eq!((background.as_str(), ascii.as_str()), ("is I49=1, I59>0?", "is I58=1?"));
        let [servo, background, _] = Reporter::new(&TURBO2, Clock::real()).hints;
        assert_eq!(servo, "is I48=1, or I57=1 and I49=1?");
        assert_eq!(background, "is I49=1?");
    }

    #[test]
    fn changes_that_come_again_and_again_are_counted() {
        let time = ManualTime::at(1);
        let mut log = ChangeLog { quota: None, clock: time.clock() };
        let mut told = 0;
        for _ in 0..1000 {
            log.tell(Level::Info, format_args!("servo data: live"));
            told = log.quota.map_or(0, |quota| quota.told());
        }
        assert_eq!((told, log.quota.map(|quota| quota.untold())), (TOLD, Some(1000 - u64::from(TOLD))));
        time.advance(LOG_QUOTA);
        log.sum_up(log.clock.now());
        assert!(log.quota.is_none(), "it begins again");
    }

    #[test]
    fn a_state_is_told_when_it_changes() {
        let mut reporter = Reporter::new(&PMAC, Clock::real());
        assert_eq!(reporter.board(false, true), None, "it has had no time yet");
        assert_eq!(reporter.board(false, false), Some(State::Stale));
        assert_eq!(reporter.board(false, true), None, "that is known");
        assert_eq!(reporter.board(true, false), Some(State::Live));
        assert_eq!(reporter.status.state, State::Live);
    }

    #[test]
    fn what_changes_is_reported_once_and_read() {
        let (events, told) = queue(1).unwrap();
        let mut reporter = Reporter::new(&PMAC, Clock::real());
        let board = BoardInfo {
            name: "pmac0".to_owned(),
            firmware: Some("1.16D".to_owned()),
            ..BoardInfo::default()
        };
        let mut info = Info::new(&PMAC, board, BoardSettings::default());
        let mut take = |reporter: &mut Reporter| {
            reporter.send(&events);
            let event = told.try_receive();
            if let Some(Event::Info(status)) = event {
                info.take(status);
            }
            (event.is_some(), info.board().clone(), info.pulse().board())
        };
        assert!(!take(&mut reporter).0, "nothing has changed");
        reporter.status.state = State::Live;
        reporter.status.enabled = Enabled::SERVO | Enabled::INTERRUPT;
        reporter.status.lines.info.command_state = CommandState::Silent;
        let (reported, board, seen) = take(&mut reporter);
        assert!(reported && board == seen);
        assert_eq!((board.state, board.lines.command_state), (State::Live, CommandState::Silent));
        assert_eq!(
            (board.enabled, board.firmware.as_deref()),
            (vec!["servo".to_owned(), "interrupt".to_owned()], Some("1.16D"))
        );
        assert!(!take(&mut reporter).0, "it was told");
        reporter.status.identity =
            Some(KnownIdentity { firmware: None, board_type: None, motors: 4, servo_period_ns: Some(5) });
        assert!(events.try_send(Event::Info(BoardStatus::default())).is_ok());
        reporter.send(&events);
        assert!(!reporter.is_told());
        told.try_receive();
        let (reported, board, _) = take(&mut reporter);
        assert!(reported && reporter.is_told(), "a full queue is tried again");
        assert_eq!((board.motors, board.servo_period_ns, board.firmware), (4, Some(5), None));
    }
}
