//! Asks a board for its family through a port outside its DPRAM: the VME mailboxes, which lie at the same place in
//! every family (PMAC User Manual p. 263-267, Turbo User Manual p. 397).

use std::time::{Duration, Instant};

use log::info;

use super::config::family::Recognised;
use super::config::ports::{MailboxConfig, MailboxUse};
use super::exit::Failure;
use crate::daemon::bus::ports::mailbox::MailboxDriver;
use crate::device::{ByteBusError, Inherited, System};
use crate::function::line_port::AsciiEvent;
use crate::map::Family;

/// The question that every family answers.
const QUESTION: &str = "TYPE";
/// The character that a board may send before each line (Turbo's I63).
const STX: char = '\u{2}';
/// How long the board may take to answer, with all that the port lets pass before. A board without power answers
/// nothing.
const PATIENCE: Duration = Duration::from_secs(2);

/// The family that the board names through its mailboxes; `None` if the board names none within [`PATIENCE`], or if the
/// configuration allows no line that way. `wait` waits some milliseconds and returns the time.
///
/// # Errors
/// The daemon cannot open or reach the mailboxes.
pub fn by_mailbox(
    config: &MailboxConfig,
    inherited: &Inherited,
    wait: impl FnMut() -> Instant,
) -> Result<Recognised, Failure> {
    if config.when == MailboxUse::Never {
        return Ok(None);
    }
    let driver = MailboxDriver::open(config.clone(), QUESTION.len(), &System::here(), inherited);
    let mut driver = driver.map_err(|error| Failure::board(error.as_ref()))?;
    let answer = ask(&mut driver, wait).map_err(|error| Failure::board(&error))?;
    let family = answer.as_deref().and_then(Family::of_type);
    if let (Some(answer), Some(_)) = (answer, family) {
        info!("through the mailboxes the board answers {QUESTION} with \"{answer}\"");
    }
    Ok(family)
}

/// The first line of the board's answer.
fn ask(
    driver: &mut MailboxDriver,
    mut wait: impl FnMut() -> Instant,
) -> Result<Option<String>, ByteBusError> {
    let begin = wait();
    driver.start(begin)?;
    let mut asked = false;
    let mut answer = None;
    let mut now = begin;
    while now < begin + PATIENCE {
        driver.tend(now);
        driver.take_interrupts(now);
        while let Some(event) = driver.port.poll(&mut driver.registers, now)? {
            match event {
                AsciiEvent::Line(text) if asked => {
                    let line = String::from_utf8_lossy(text.as_bytes());
                    answer.get_or_insert_with(|| line.trim_start_matches(STX).to_owned());
                }
                AsciiEvent::Done(_) if asked => return Ok(answer),
                _ => {}
            }
        }
        if !asked && driver.is_connected() {
            asked = driver.port.begin(&mut driver.registers, QUESTION.as_bytes())?;
        }
        now = wait();
    }
    Ok(answer)
}
