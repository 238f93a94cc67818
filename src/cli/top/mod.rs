//! `pmacctl top`: motors, coordinate systems, health and watches on one screen, and jog keys.
//!
//! | file | content |
//! |---|---|
//! | `keys` | the effect of each key |
//! | `state` | the selection, the armed motor and the typed text; keys in, orders out |
//! | `arming`, `hand` | when a jog key may move a motor; the thread that holds the jog |
//! | `source`, `trace` | the data of each picture; the following errors of the last seconds |
//! | `asker`, `watches` | the thread that asks the daemon; registers and variables |
//! | `draw` | the picture |
//! | `tty` | the terminal |

mod arming;
mod asker;
mod draw;
mod hand;
mod keys;
mod source;
mod state;
mod trace;
mod tty;
mod watches;

use std::io::{self, IsTerminal};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Args;
use signal_hook::consts::{SIGCONT, SIGTSTP};

use crate::cli::args::values::rate;
use crate::cli::console::{Interrupt, Output, note};
use crate::cli::context::{Context, Failure, Verdict};
use crate::cli::show::motors;
use crate::client::Snapshot;
use asker::Asker;
use draw::{Look, Picture};
use hand::Hand;
use source::Source;
use state::{Effect, ScreenState};
use trace::Traces;
use tty::{Input, Tty};

#[derive(Debug, Args)]
pub struct Top {
    /// Registers, as for variable watch, and I-, M-, P- and Q-variables, which top asks by command line (M: role engineer)
    #[arg(value_name = "NAME")]
    pub watches: Vec<String>,
    /// The most pictures a second; 2.5 at least
    #[arg(long, value_name = "HZ", default_value = "10", value_parser = top_rate, allow_negative_numbers = true)]
    pub rate: Duration,
}

/// The longest time between two pictures, whatever `--rate` says: within it the reader never misses updates in the
/// daemon's ring, and the screen reports an unconfirmed stop in time.
const SLOWEST: Duration = Duration::from_millis(400);
/// The shortest time between two pictures while the user presses keys.
const KEYS: Duration = Duration::from_millis(30);

fn top_rate(text: &str) -> Result<Duration, String> {
    let period = rate(text)?;
    if period <= SLOWEST { Ok(period) } else { Err("must be at least 2.5 a second".to_owned()) }
}

pub fn run(context: &mut Context, options: &Top) -> Result<Verdict, Failure> {
    if context.output.is_json() || !context.output.is_terminal() || !io::stdin().is_terminal() {
        let why = "top needs a terminal; in a pipe, pmacctl watch prints lines, and motors --json a document";
        return Err(Failure::Request(why.to_owned()));
    }
    let board = context.board()?;
    let (name, socket) = (board.name().clone(), board.socket().to_owned());
    let signals = Signals::listen()?;
    let theirs = Context::new(
        context.told_name().map(|name| name.as_str()),
        context.told_socket().map(Into::into),
        Output::new(false, true),
    )?;
    let mut screen = Screen {
        name: name.to_string(),
        source: Source::new(board),
        asker: Asker::new(theirs, options.watches.clone()),
        hand: Hand::new(socket, name),
        state: ScreenState::new(options.watches.clone()),
        traces: Traces::default(),
        found: Err("nothing has been read yet".to_owned()),
        look: Look::of_environment(),
        tty: Tty::open().map_err(|error| Failure::Request(format!("the terminal: {error}")))?,
    };
    let ended = screen.show(options.rate, &signals);
    let Screen { hand, tty, .. } = screen;
    // Release the motor first, then the terminal.
    let faults = hand.end();
    drop(tty);
    for fault in faults {
        note(format_args!("pmacctl: {fault}"));
    }
    ended.map(|()| Verdict::Yes)
}

/// The signals that have come.
struct Signals {
    end: Interrupt,
    suspend: Arc<AtomicBool>,
    resumed: Arc<AtomicBool>,
}

impl Signals {
    fn listen() -> Result<Self, Failure> {
        let flag = |signal| {
            let flag = Arc::new(AtomicBool::new(false));
            signal_hook::flag::register(signal, Arc::clone(&flag)).map_err(Failure::request).map(|_| flag)
        };
        Ok(Self { end: Interrupt::listen()?, suspend: flag(SIGTSTP)?, resumed: flag(SIGCONT)? })
    }
}

struct Screen {
    name: String,
    source: Source,
    asker: Asker,
    hand: Hand,
    state: ScreenState,
    traces: Traces,
    /// The segment's data at the last picture, or the reason for their absence.
    found: Result<Snapshot, String>,
    look: Look,
    tty: Tty,
}

impl Screen {
    /// Shows pictures until a key or a signal ends it, or the terminal is gone.
    fn show(&mut self, every: Duration, signals: &Signals) -> Result<(), Failure> {
        loop {
            let began = Instant::now();
            self.read();
            self.draw()?;
            let mut pressed = false;
            loop {
                let wait = if pressed { KEYS.min(every) } else { every };
                let left = wait.saturating_sub(began.elapsed());
                let input = self.tty.key_within(left);
                if signals.end.came() || input == Input::End {
                    return Ok(());
                }
                self.follow_signals(signals)?;
                if let Input::Key(key) = input {
                    pressed = true;
                    let effects = self.state.key(key, self.is_live(), Instant::now());
                    if self.carry_out(effects)? {
                        return Ok(());
                    }
                } else if wait <= began.elapsed() {
                    break;
                }
            }
        }
    }

    fn is_live(&self) -> bool {
        let servo = self.found.as_ref().ok().and_then(|snapshot| snapshot.servo.as_ref());
        servo.is_some_and(|servo| servo.is_fresh())
    }

    /// Reads the segment, and the hand's reports.
    fn read(&mut self) {
        self.found = self.source.look(&mut self.traces).map_err(|error| error.to_string());
        let now = Instant::now();
        let told: Vec<_> = self.hand.told().collect();
        let mut effects = Vec::new();
        for told in told {
            effects.extend(self.state.told(told, now));
        }
        let snapshot = self.found.as_ref().ok();
        let motors = snapshot.map(motors::shown);
        let motors = motors.map(|motors| motors.iter().map(|motor| motor.servo.motor).collect());
        let background = snapshot.and_then(|snapshot| snapshot.background.as_ref());
        let systems = background.map_or(0, |background| background.data.coordinate_systems.len());
        effects.extend(self.state.saw(motors.unwrap_or_default(), systems, self.is_live()));
        self.state.tick(now);
        self.carry_out_orders(effects);
    }

    /// Carries out the state's effects that concern the hand.
    fn carry_out_orders(&self, effects: Vec<Effect>) {
        for effect in effects {
            if let Effect::Hand(order) = effect {
                self.hand.order(order);
            }
        }
    }

    fn draw(&mut self) -> io::Result<()> {
        let Self { name, asker, state, traces, found, look, tty, .. } = self;
        let picture = Picture {
            name,
            snapshot: found.as_ref().map_err(String::as_str),
            answer: asker.last(),
            traces,
            state,
            look: *look,
            now: Instant::now(),
        };
        tty.draw(|frame| picture.draw(frame))
    }

    fn follow_signals(&mut self, signals: &Signals) -> Result<(), Failure> {
        if signals.suspend.swap(false, Ordering::Relaxed) {
            self.suspend()?;
            signals.resumed.store(false, Ordering::Relaxed);
        } else if signals.resumed.swap(false, Ordering::Relaxed) {
            self.tty.resume()?;
        }
        Ok(())
    }

    fn suspend(&mut self) -> io::Result<()> {
        let effects = self.state.disarm();
        self.carry_out_orders(effects);
        self.tty.suspend()
    }

    /// Carries out the state's effects. True when the screen must end.
    fn carry_out(&mut self, effects: Vec<Effect>) -> Result<bool, Failure> {
        for effect in effects {
            match effect {
                Effect::Hand(order) => self.hand.order(order),
                Effect::Character(character) => self.hand.send_character(character),
                Effect::Watch(names) => self.asker.watch(names),
                Effect::Suspend => self.suspend()?,
                Effect::Quit => return Ok(true),
            }
        }
        Ok(false)
    }
}
