//! The ledger of motion: which client has set which motors in motion, and until when.
//!
//! A row is a command, with the motors that still obey it. A hold of several motors is one row: its client renews all
//! of them at once, and the daemon stops all of them once one of them stands.
//!
//! | the command | others may command its motors | it ends |
//! |---|---|---|
//! | a held jog, by the panel | no | when its client fails to renew it in time, or is gone |
//! | a jog without an end, by command line | yes: the last client to command a motor owns it | with its client; also with its silence, if the call says so |
//! | a panel request that no client holds | yes | when a client stops its motors |
//!
//! A motor that moved and then stood, as the reports show, obeys no row any more. An abort or a kill of all motors ends
//! every hold without a stop: the motors stand, and a stop would close a killed motor's loop again.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use log::{info, warn};

use super::hold_end::HoldEnd;
use super::timing::{HOLDERS_STOP_TAKES, JOG_STANDS};
use crate::daemon::shared::caller::Caller;
use crate::daemon::shared::leases::HOLD_LEASE;
use crate::daemon::shared::open_buffer::Account;
use crate::function::servo::Motion;
use crate::map::Motors;

/// How a client has set motors in motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Way {
    /// By the panel, as long as this client holds the motors.
    Held(Account),
    /// By a command line, as long as its client is connected.
    Line,
    /// By the panel; no client holds the motors.
    #[default]
    Panel,
}

/// A command, and the motors that still obey it.
#[derive(Debug, Default)]
struct Row {
    motors: Motors,
    client: u64,
    way: Way,
    /// When the row ends, unless its client speaks before.
    until: Option<Instant>,
    /// For a jog by line: how long its client may be silent, if silence ends the jog.
    silence: Option<Duration>,
    /// The motors that the reports have shown moving since the command.
    moved: Motors,
    /// The moved motors that stand now, and since when.
    stands: BTreeMap<usize, Instant>,
    /// Why the row ends; the daemon may not have requested the stop yet.
    over: Option<HoldEnd>,
    /// The daemon has requested the stop, or the row needs none. The row stays until its holder has heard why.
    has_ended: bool,
    /// For a panel request: the motors whose lost panel the log has already told.
    told: Motors,
}

impl Row {
    const fn is_hold(&self) -> bool {
        matches!(self.way, Way::Held(_))
    }

    /// Whether this is a hold whose stop the daemon has not requested.
    const fn is_live(&self) -> bool {
        self.is_hold() && !self.has_ended
    }

    fn see(&mut self, motion: Motion, now: Instant) {
        self.moved.add(self.motors.among(motion.moving));
        let standing = self.motors.among(self.moved).among(motion.standing);
        self.stands.retain(|motor, _| standing.contains(*motor));
        for motor in standing.numbers() {
            self.stands.entry(motor).or_insert(now);
        }
    }

    /// The motors that have stood for long enough by `now`.
    fn stood(&self, now: Instant) -> Motors {
        let stood = self.stands.iter().filter(|(_, since)| now >= **since + JOG_STANDS);
        stood.map(|(motor, _)| *motor).collect()
    }

    /// The motors that may still move at `now`.
    fn going(&self, now: Instant) -> Motors {
        self.motors.without(self.stood(now))
    }

    /// The row ends at `until`, unless its motors stop before.
    fn end(&mut self, why: HoldEnd, until: Instant) {
        (self.over, self.until) = (Some(why), Some(until));
    }

    /// When the row needs attention next, if nothing happens before.
    fn next_moment(&self) -> Option<Instant> {
        let stands = self.stands.values().min().map(|since| *since + JOG_STANDS);
        stands.filter(|_| self.is_live() && self.over.is_none()).into_iter().chain(self.until).min()
    }
}

/// Every command that motors obey, and the ended holds whose clients have not heard of the end.
#[derive(Debug, Default)]
pub struct Ledger(Vec<Row>);

impl Ledger {
    /// The holds that are not over.
    fn held(&mut self) -> impl Iterator<Item = &mut Row> {
        self.0.iter_mut().filter(|row| row.is_hold() && row.over.is_none())
    }

    fn place_of_hold(&self, client: u64) -> Option<usize> {
        self.0.iter().position(|row| row.is_hold() && row.client == client)
    }

    /// `client` holds a jog of `motors`; the ledger adds the jog to an earlier hold of that client. The hold first runs
    /// until `begun`, when the board must have taken the jog, and then from renewal to renewal.
    pub fn hold(&mut self, client: u64, holder: Account, motors: Motors, begun: Instant) {
        let before = self.place_of_hold(client).map(|at| self.0.swap_remove(at));
        let mut row = Row { motors, client, way: Way::Held(holder), until: Some(begun), ..Row::default() };
        if let Some(before) = before.filter(Row::is_live) {
            row.motors.add(before.motors);
            row.until = row.until.max(before.until);
        }
        self.0.push(row);
    }

    /// `motors` may jog for `client`, which may be silent for `silence`. Other clients' jogs stay in the ledger until
    /// the daemon knows that the board has carried out the line ([`Self::commanded`]).
    pub fn jog_by_line(&mut self, client: u64, motors: Motors, silence: Option<Duration>, now: Instant) {
        self.remove(motors, |row| row.way == Way::Line && row.client == client);
        let until = silence.map(|silence| now + silence);
        self.add(Row { motors, client, way: Way::Line, until, silence, ..Row::default() });
    }

    /// The board has taken, or may have taken, a panel request that sets `motors` in motion. No client holds them.
    pub fn jog_by_panel(&mut self, motors: Motors) {
        self.remove(motors, |row| row.way == Way::Panel);
        self.add(Row { motors, client: Caller::NOBODY, ..Row::default() });
    }

    fn add(&mut self, row: Row) {
        self.0.extend((!row.motors.is_empty()).then_some(row));
    }

    /// Takes `motors` out of the rows that `are` selects.
    fn remove(&mut self, motors: Motors, are: impl Fn(&Row) -> bool) {
        self.0.retain_mut(|row| {
            if !are(row) {
                return true;
            }
            row.motors.remove(motors);
            !row.motors.is_empty()
        });
    }

    /// The board has carried out another command to `motors`. Holds go on: no other client may command their motors.
    pub fn commanded(&mut self, motors: Motors) {
        self.remove(motors, |row| !row.is_hold());
    }

    /// The account `by` has stopped `motors`, over the connection `client`. Jogs of these motors that other clients
    /// hold are over. The daemon stops each such jog on its own: the jog may have begun after the stop.
    pub fn stopped(&mut self, client: u64, by: Account, motors: Motors, now: Instant) {
        self.commanded(motors);
        self.remove(motors, |row| row.is_live() && row.client == client);
        for row in self.held().filter(|row| row.client != client && row.motors.meets(motors)) {
            row.end(HoldEnd::Stopped(by, row.motors.among(motors)), now);
        }
    }

    /// `character`, which stops every motor, is on its way to the board. From now on no client can renew a hold. The
    /// daemon requests stops only if the board has not taken the character within the time of a lease.
    pub fn stop_all_begins(&mut self, character: u8, now: Instant) {
        self.held().for_each(|row| row.end(HoldEnd::Control(character), now + HOLD_LEASE));
    }

    /// The board has taken a character that stops every motor: the holds that [`Self::stop_all_begins`] marked have
    /// ended, with every other row ([`Self::commanded`]). Returns the clients that had a hold.
    pub fn all_stopped(&mut self) -> Vec<u64> {
        let mut holders = Vec::new();
        for row in self.0.iter_mut().filter(|row| row.is_live()) {
            if let Some(end @ HoldEnd::Control(_)) = row.over {
                info!(target: "audit", "{end} (mask {:#04x}); it gets no stop", row.motors.bits());
                row.has_ended = true;
                holders.push(row.client);
            }
        }
        holders
    }

    /// The board has stopped reading the control panel, which renews and stops every hold.
    pub fn panel_ended(&mut self, by: Option<Account>, now: Instant) {
        self.held().for_each(|row| row.end(HoldEnd::PanelEnded(by), now));
    }

    /// The daemon ends, and with it every jog that ends with its client.
    pub fn daemon_ends(&mut self, now: Instant) {
        let ends = self.0.iter_mut().filter(|row| row.way != Way::Panel && row.over.is_none());
        ends.for_each(|row| row.end(HoldEnd::DaemonEnds, now));
    }

    /// Takes in a report: `motion` says which motors move and stand, `opened` whose loops have opened.
    pub fn see(&mut self, motion: Motion, opened: Motors, now: Instant) {
        for row in self.held().filter(|row| row.motors.meets(opened)) {
            row.end(HoldEnd::OpenLoop(row.motors.among(opened)), now);
        }
        self.0.retain_mut(|row| {
            if !row.is_hold() {
                row.motors = row.going(now);
            }
            row.see(motion, now);
            row.is_hold() || !row.motors.is_empty()
        });
    }

    /// The first other account that holds any of `motors`, and which of them it holds.
    pub fn held_by_another(&self, client: u64, motors: Motors) -> Option<(Account, Motors)> {
        self.0.iter().filter(|row| row.client != client && row.over.is_none()).find_map(|row| match row.way {
            Way::Held(holder) => {
                Some((holder, row.motors.among(motors))).filter(|(_, held)| !held.is_empty())
            }
            Way::Line | Way::Panel => None,
        })
    }

    /// `client` renews its hold.
    ///
    /// # Errors
    /// Why its hold is over; `None` when it had none.
    pub fn renew(&mut self, client: u64, now: Instant) -> Result<(), Option<HoldEnd>> {
        let at = self.place_of_hold(client).ok_or(None)?;
        let row = &mut self.0[at];
        row.over.map_or(Ok(()), |end| Err(Some(end)))?;
        row.until = Some(now + HOLD_LEASE);
        Ok(())
    }

    /// The clients that `is_heard` selects have spoken: their jogs by line run on.
    pub fn hear(&mut self, is_heard: impl Fn(u64) -> bool, now: Instant) {
        for row in self.0.iter_mut().filter(|row| row.over.is_none() && is_heard(row.client)) {
            row.until = row.silence.map_or(row.until, |silence| Some(now + silence));
        }
    }

    /// `client` asks for the stop of `motors`. Returns whether the stop ends a jog that the client holds, or held.
    ///
    /// # Errors
    /// Why the motors stand already. The daemon sends no stop then, which could close a killed motor's loop. Told once.
    pub fn stop_for(&mut self, client: u64, motors: Motors, now: Instant) -> Result<bool, HoldEnd> {
        let Some(at) = self.place_of_hold(client) else { return Ok(false) };
        let row = &mut self.0[at];
        let (is_its_own, over, has_ended) = (row.motors.has_all(motors), row.over, row.has_ended);
        let stands = over.filter(|end| matches!(end, HoldEnd::Control(_) | HoldEnd::OpenLoop(_)));
        if has_ended {
            self.0.swap_remove(at);
        } else if is_its_own && stands.is_none() {
            row.until = row.until.max(Some(now + HOLDERS_STOP_TAKES));
        }
        stands.filter(|_| is_its_own).map_or(Ok(is_its_own), Err)
    }

    /// Ends every row whose client is silent or gone (not `is_there`), and the holds with a motor that has stood for
    /// long enough. Returns the motors to stop, and the clients that held some of them.
    pub fn lapse(&mut self, is_there: impl Fn(u64) -> bool, now: Instant) -> (Motors, Vec<u64>) {
        for row in self.held() {
            let stood = row.stood(now);
            if !stood.is_empty() {
                row.end(HoldEnd::Stands(stood), now);
            }
        }
        let (mut stopped, mut holders) = (Motors::NONE, Vec::new());
        self.0.retain_mut(|row| {
            let is_late = row.until.is_some_and(|until| until <= now);
            // A control character gets its time to stop the motors, even if their holder is gone.
            let may_be_gone = row.way != Way::Panel && !matches!(row.over, Some(HoldEnd::Control(_)));
            let is_gone = may_be_gone && !is_there(row.client);
            if row.has_ended || !(is_late || is_gone) {
                return true;
            }
            let motors = if row.is_hold() { row.motors } else { row.going(now) };
            if !motors.is_empty() {
                tell_lapse(row, motors);
            }
            stopped.add(motors);
            (row.has_ended, row.until) = (true, None);
            if row.is_hold() {
                row.over.get_or_insert(HoldEnd::Silent);
                holders.push(row.client);
            }
            row.is_hold()
        });
        (stopped, holders)
    }

    /// Drops the ended holds of `client`, which will not ask why they ended.
    pub fn forget(&mut self, client: u64) {
        self.0.retain(|row| !(row.has_ended && row.client == client));
    }

    /// Whether a holder has not yet heard that its jog ended with the daemon.
    pub fn has_untold(&self) -> bool {
        self.0.iter().any(|row| row.has_ended && row.over == Some(HoldEnd::DaemonEnds))
    }

    /// The motors of holds whose stop the daemon has not requested.
    pub fn held_motors(&self) -> Motors {
        self.0.iter().filter(|row| row.is_live()).fold(Motors::NONE, |all, row| all.and(row.motors))
    }

    /// The motors that a panel request has set in motion and that no report shows standing.
    pub fn going_by_panel(&self, motion: Motion) -> Motors {
        let rows = self.0.iter().filter(|row| row.way == Way::Panel);
        rows.fold(Motors::NONE, |all, row| all.and(row.motors)).without(motion.standing)
    }

    /// The motors of [`Self::going_by_panel`] that the log has not named yet, now that the panel is gone.
    pub fn newly_alone(&mut self, motion: Motion) -> Motors {
        let mut alone = Motors::NONE;
        for row in self.0.iter_mut().filter(|row| row.way == Way::Panel) {
            let going = row.motors.without(motion.standing).without(row.told);
            row.told.add(going);
            alone.add(going);
        }
        alone
    }

    /// The motors that may still jog by line for `client`.
    pub fn jogs_by_line(&self, client: u64, now: Instant) -> Motors {
        let rows = self.0.iter().filter(|row| row.way == Way::Line && row.client == client);
        rows.fold(Motors::NONE, |all, row| all.and(row.going(now)))
    }

    /// Whether `client` has a row: a command that ends with the client, or a hold whose end the client has not heard.
    pub fn is_of(&self, client: u64) -> bool {
        self.0.iter().any(|row| row.client == client)
    }

    /// How many holds the daemon has yet to stop.
    pub fn holds(&self) -> usize {
        self.0.iter().filter(|row| row.is_live()).count()
    }

    /// When the ledger needs attention next, if nothing happens before.
    pub fn next_moment(&self) -> Option<Instant> {
        self.0.iter().filter_map(Row::next_moment).min()
    }

    /// When the first row of a client that `is_there` runs out unless the client renews it.
    pub fn first_end(&self, is_there: impl Fn(u64) -> bool) -> Option<Instant> {
        let rows = self.0.iter().filter(|row| row.over.is_none() && is_there(row.client));
        rows.filter_map(|row| row.until).min()
    }
}

/// Logs why the daemon stops the `motors` of `row`.
fn tell_lapse(row: &Row, motors: Motors) {
    let mask = motors.bits();
    match (row.way, row.over) {
        (Way::Held(_), None) => {
            warn!(target: "audit", "a held jog is stopped (mask {mask:#04x}): its holder is gone or silent");
        }
        (Way::Held(_), Some(end)) => {
            warn!(target: "audit", "{end}; its motors (mask {mask:#04x}) are stopped")
        }
        (_, over) => {
            let why = if over.is_some() { "pmacd ends" } else { "who had asked for it is gone or silent" };
            warn!(target: "audit", "motor {motors} jogged by command line: {why}; pmacd stops it");
        }
    }
}

#[cfg(test)]
#[path = "ledger_tests.rs"]
mod tests;
