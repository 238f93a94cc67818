//! One round of the loop after each wake: the loop takes the servo data alone, or does the work that is due, for 50 us.

use std::time::Duration;

use super::{BOARD_CHECK_NS, BoardLoop, HEARTBEAT_NS};
use crate::daemon::bus::board::BoardBus;
use crate::daemon::bus::board_function::Polled;
use crate::daemon::bus::function_table::Work;
use crate::daemon::bus::guard_time::Turn;
use crate::daemon::bus::readable::Readable;
use crate::daemon::shared::info::WatchedThread;
use crate::function::line_port::PortError;
use crate::protocol::Function;
use crate::segment::State;

/// A round goes on for this time while work is due. An interrupt that comes meanwhile waits for the rest of the round;
/// a command waits only for the piece under way.
const ROUND_NS: u64 = 50_000;
/// Most pieces of work in a round; needed where time stands still.
const PIECES_A_ROUND: usize = 32;
/// The heartbeat may come this much late, with the servo data, or this much early, with other work.
const HEARTBEAT_SPARE_NS: u64 = 5_000_000;

/// When work other than the servo data is due, as the last whole round found.
#[derive(Clone, Copy)]
pub(super) struct Ahead {
    pub due_ns: u64,
    /// That work can wait until then.
    pub latest_ns: u64,
}

impl Ahead {
    /// Work may be due now.
    pub const NOW: Self = Self { due_ns: 0, latest_ns: 0 };
}

impl BoardLoop {
    pub(super) fn running(&mut self, readable: &Readable) {
        let now = self.clock.ns();
        if *readable == Readable::default() && self.is_servo_alone(now) {
            self.servo_alone(now);
        } else {
            if std::mem::take(&mut self.is_unseen) {
                self.see_servo();
            }
            self.whole_round(readable, now);
            (self.ahead, self.told) = (self.look_ahead(), self.functions.servo_told());
        }
    }

    /// Whether the loop has to look after the servo data only.
    fn is_servo_alone(&self, now: u64) -> bool {
        now < self.ahead.due_ns
            && self.functions.servo.is_live()
            && !self.is_paused(now)
            && !self.only_watches()
            // Where the servo is always near, a whole round counts how often a command has stood back.
            && !self.connections.intake.has_waiting()
            && self.reporter.is_told()
            && !self.presence.is_reset_known
    }

    /// Takes the servo data only. On a machine that has slept, the rest of a round costs more than the servo data.
    fn servo_alone(&mut self, now: u64) {
        if now < self.functions.servo_due_ns() {
            return;
        }
        // No other work has waited for the servo data.
        self.guard.others_had_turn();
        let polled = self.poll_only(Function::Servo);
        let is_data = polled.as_ref().is_ok_and(|polled| *polled == Polled::default());
        self.is_unseen = is_data && self.functions.servo_told() == self.told;
        if self.is_unseen {
            return;
        }
        // The poll found more than data.
        self.ahead = Ahead::NOW;
        let result = polled.and_then(|polled| self.react(Function::Servo, polled));
        self.note_failure(result);
    }

    fn whole_round(&mut self, readable: &Readable, now: u64) {
        if !self.is_paused(now) {
            self.attend(readable, now);
            self.connections.pulse.count_round(WatchedThread::Bus);
            let result = self.due_work(now);
            self.note_failure(result);
        }
        // Beat at once when the board comes to life, so that waiting clients need not wait 50 ms.
        let beats = now + HEARTBEAT_SPARE_NS >= self.heartbeat_due_ns;
        if beats || self.shows_life() && self.reporter.status.state != State::Live {
            self.heartbeat_due_ns = now + HEARTBEAT_NS;
            self.beat(now);
            self.reporter.tend_log();
        }
        if now >= self.check_due_ns {
            self.check_due_ns = now + BOARD_CHECK_NS;
            let result = self.check_board();
            self.note_failure(result);
        }
        self.tell_clients(beats, self.clock.at(now));
    }

    /// Does the work that is due from `now` on, piece by piece, for a round's time. An empty wait between two pieces
    /// would cost more than most pieces.
    fn due_work(&mut self, now: u64) -> Result<(), PortError> {
        let mut at = now;
        for _ in 0..PIECES_A_ROUND {
            if !self.one_piece(at)? {
                break;
            }
            at = self.clock.ns();
            if at >= now + ROUND_NS || self.is_paused(at) || self.connections.intake.has_waiting() {
                break;
            }
        }
        Ok(())
    }

    /// Does the most urgent piece of work that is due `now`: the servo data, else the work that has waited longest.
    /// Returns whether any was due.
    fn one_piece(&mut self, now: u64) -> Result<bool, PortError> {
        let work = self.next_work().filter(|(due_ns, _)| *due_ns <= now);
        let servo_due = now >= self.functions.servo_due_ns();
        let near = self.is_servo_near(now);
        let intake = &self.connections.intake;
        match (self.guard.turn(servo_due, near, work.is_some(), || intake.has_waiting()), work) {
            (Turn::Servo, _) => self.poll_function(Function::Servo)?,
            (Turn::Others, Some((_, work))) => {
                if work == Work::Function(Function::Ascii) && self.presence.is_out_of_reach {
                    // The loop begins nothing in words that it still has to put in order.
                    self.check_page()?;
                }
                let (accesses, began_ns) = (self.bus.accesses(), self.clock.ns());
                match work {
                    Work::Function(function) => self.poll_function(function)?,
                    Work::UserWords => {
                        let (functions, mut context) = self.functions_in_context();
                        functions.read_user_words(&mut context)?;
                    }
                }
                let took = Duration::from_nanos(self.clock.ns().saturating_sub(began_ns));
                self.guard.took(self.bus.accesses() - accesses, took);
            }
            (Turn::Others | Turn::Nobody, _) => return Ok(false),
        }
        Ok(true)
    }

    fn poll_function(&mut self, function: Function) -> Result<(), PortError> {
        let polled = self.poll_only(function)?;
        self.react(function, polled)
    }

    fn poll_only(&mut self, function: Function) -> Result<Polled, PortError> {
        let accesses = self.bus.accesses();
        let (functions, mut context) = self.functions_in_context();
        let polled = functions.poll(function, &mut context)?;
        if let Some(counter) = functions.counter::<BoardBus>(function) {
            self.connections.publisher.counters().add(counter, self.bus.accesses() - accesses);
        }
        Ok(polled)
    }

    /// The first due work that can wait for the servo, and when it is due.
    fn next_work(&self) -> Option<(u64, Work)> {
        self.functions.next::<BoardBus>(self.only_watches())
    }

    /// When that work or the heartbeat is due, and how long both can wait.
    fn look_ahead(&self) -> Ahead {
        let [due_ns, latest_ns] = self.functions.times::<BoardBus>(self.only_watches());
        Ahead {
            due_ns: due_ns.min(self.heartbeat_due_ns),
            latest_ns: latest_ns.min(self.heartbeat_due_ns + HEARTBEAT_SPARE_NS),
        }
    }

    /// Sets the servo period and the time of an access: a test with its own clock cannot measure them.
    #[cfg(test)]
    pub(crate) fn learn(&mut self, servo_period_ns: u64, access_ns: u64) {
        self.functions.servo.configure(crate::map::Motors::first(8), Some(servo_period_ns), Some(1));
        (0..100).for_each(|_| self.guard.took(100, Duration::from_nanos(100 * access_ns)));
    }
}
