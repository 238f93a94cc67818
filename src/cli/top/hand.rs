//! The thread that holds a jog for `top`.
//!
//! The hand renews the lease only until the moment that the last key press set. So the motor also stops when the screen
//! hangs (a terminal that is gone or takes no more output), not only when the process ends: then the daemon stops the
//! motor.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::cli::act::hold::may_be_moving;
use crate::client::hold::jogs_by_panel;
use crate::client::{CommandError, Connection, HeldJog};
use crate::function::panel::PanelAction;
use crate::protocol::CallError;
use crate::segment::SegmentName;

/// The longest sleep during a jog.
const ORDERS_WITHIN: Duration = Duration::from_millis(20);
/// How long the end of the program waits for the stop of a jog.
const STOP_WITHIN: Duration = Duration::from_secs(8);

/// An order to the hand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// Ask whether this user may jog.
    Arm(u8),
    /// Jog until this time.
    Jog {
        motor: u8,
        action: PanelAction,
        until: Instant,
    },
    /// Go on jogging until this time.
    Keep(Instant),
    Stop,
}

/// The outcome of an order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Told {
    Armed(u8),
    /// No motor moves; the screen must disarm the keys.
    Refused(String),
    Jogs(u8),
    Stopping(u8),
    Stopped(u8),
    /// The jog is over, with this message.
    Fault(String),
    /// The board's answer to a control character.
    Character(u8, Result<(), String>),
}

/// The daemon's address.
#[derive(Debug, Clone)]
struct Daemon {
    socket: PathBuf,
    name: SegmentName,
}

impl Daemon {
    fn connect(&self) -> Result<Connection, CommandError> {
        Connection::open(&self.socket)?.of_board(&self.name)
    }
}

pub struct Hand {
    daemon: Daemon,
    orders: Option<Sender<Order>>,
    tell: Sender<Told>,
    told: Receiver<Told>,
    thread: Option<JoinHandle<()>>,
}

impl Hand {
    /// For the board called `name`, whose daemon listens at `socket`.
    pub fn new(socket: PathBuf, name: SegmentName) -> Self {
        let ((orders, taken), (tell, told)) = (channel(), channel());
        let daemon = Daemon { socket, name };
        let holder = Holder { daemon: daemon.clone(), orders: taken, tell: tell.clone() };
        let thread = std::thread::spawn(move || holder.run());
        Self { daemon, orders: Some(orders), tell, told, thread: Some(thread) }
    }

    pub fn order(&self, order: Order) {
        if let Some(orders) = &self.orders {
            // The thread is gone only after a panic, which has stopped the jog.
            let _ = orders.send(order);
        }
    }

    /// Sends a control character ahead of everything, whatever the hand does meanwhile.
    pub fn send_character(&self, character: u8) {
        let (daemon, tell) = (self.daemon.clone(), self.tell.clone());
        std::thread::spawn(move || {
            let sent = daemon.connect().and_then(|mut connection| connection.control(character));
            let sent = sent.map(drop).map_err(|error| error.to_string());
            let _ = tell.send(Told::Character(character, sent));
        });
    }

    /// The events since the last call.
    pub fn told(&self) -> impl Iterator<Item = Told> + '_ {
        self.told.try_iter()
    }

    /// Stops every jog, and names the motors that may not have stopped.
    pub fn end(mut self) -> Vec<String> {
        drop(self.orders.take());
        let deadline = Instant::now() + STOP_WITHIN;
        while self.thread.as_ref().is_some_and(|thread| !thread.is_finished()) && Instant::now() < deadline {
            std::thread::sleep(ORDERS_WITHIN);
        }
        let (mut stopping, mut faults) = (None, Vec::new());
        for told in self.told.try_iter() {
            match told {
                Told::Jogs(motor) | Told::Stopping(motor) => stopping = Some(motor),
                Told::Stopped(_) => stopping = None,
                Told::Fault(text) => {
                    stopping = None;
                    faults.push(text);
                }
                Told::Armed(_) | Told::Refused(_) | Told::Character(..) => {}
            }
        }
        faults.extend(stopping.map(|motor| may_be_moving(&[motor])));
        faults
    }
}

/// The thread's side of the hand.
struct Holder {
    daemon: Daemon,
    orders: Receiver<Order>,
    tell: Sender<Told>,
}

impl Holder {
    /// Follows the orders until no more can come.
    fn run(&self) {
        let mut next = self.orders.recv().ok();
        while let Some(order) = next.take() {
            match order {
                Order::Arm(motor) => {
                    self.tell(may_jog(&self.daemon).map_or_else(Told::Refused, |()| Told::Armed(motor)));
                }
                Order::Jog { motor, action, until } => next = self.jog(motor, action, until),
                // The jog is over already.
                Order::Keep(_) | Order::Stop => {}
            }
            next = next.or_else(|| self.orders.recv().ok());
        }
    }

    fn tell(&self, told: Told) {
        // The screen is gone only at the program's end.
        let _ = self.tell.send(told);
    }

    /// Jogs until the keys have been silent for too long. Returns the order that ended the jog, if that order asks for
    /// more.
    fn jog(&self, motor: u8, action: PanelAction, mut until: Instant) -> Option<Order> {
        let begun = self.daemon.connect();
        let held = match begun.and_then(|connection| HeldJog::begin(connection, action.name(), &[motor])) {
            Ok(held) => held,
            Err(error @ (CommandError::Broken { .. } | CommandError::NoAnswer { .. })) => {
                self.tell(Told::Fault(format!("{error}; {}", may_be_moving(&[motor]))));
                return None;
            }
            Err(error) => {
                self.tell(Told::Refused(error.to_string()));
                return None;
            }
        };
        self.tell(Told::Jogs(motor));
        let mut next = None;
        while held.is_held() && Instant::now() < until {
            match self.orders.recv_timeout(ORDERS_WITHIN) {
                Ok(Order::Keep(further)) => until = until.max(further),
                Ok(Order::Stop) | Err(RecvTimeoutError::Disconnected) => break,
                Ok(other) => {
                    next = Some(other);
                    break;
                }
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
        self.tell(Told::Stopping(motor));
        self.tell(match held.stop() {
            Ok(_) => Told::Stopped(motor),
            Err(error @ CommandError::Refused(_)) => Told::Fault(error.to_string()),
            Err(error) => Told::Fault(format!("{error}; {}", may_be_moving(&[motor]))),
        });
        next
    }
}

/// Why this user may not jog. The daemon decides, so the hand asks before the user presses a key.
fn may_jog(daemon: &Daemon) -> Result<(), String> {
    let asked =
        daemon.connect().and_then(|mut connection| Ok((connection.info()?, jogs_by_panel(&mut connection)?)));
    // Without the panel a jog is a command line.
    let (info, by_panel) = asked.map_err(|error| error.to_string())?;
    let (needed, less): (_, &[&str]) = if by_panel {
        ("operate", &["observe", "stop"])
    } else {
        ("engineer", &["observe", "stop", "operate"])
    };
    match info.role.as_deref() {
        Some(role) if less.contains(&role) => {
            Err(CallError::NotPermitted { role_needed: needed.to_owned() }.to_string())
        }
        _ => Ok(()),
    }
}
