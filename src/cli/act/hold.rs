//! `pmacctl jog MOTOR + --hold`: a jog that lasts while its command runs and the data show the motors.

use std::io::{self, Read};
use std::os::fd::AsFd;
use std::sync::mpsc::channel;
use std::time::{Duration, Instant};

use clap::Args;
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};

use crate::cli::args::values::seconds;
use crate::cli::console::{Interrupt, note};
use crate::cli::context::{Context, Failure, Verdict, check_numbers};
use crate::client::{Board, CommandError, HeldJog};
use crate::function::panel::PanelAction;

/// Period of the checks during a held jog, in milliseconds.
const INPUT_WITHIN_MS: u16 = 20;
/// How long the answer to a stop, or the data, may be missing before the user is warned.
pub const UNSURE_AFTER: Duration = Duration::from_millis(600);

/// `--hold` and `--seconds`.
#[derive(Debug, Clone, Copy, Args)]
pub struct Hold {
    /// Jog only while this command runs: until ^C, the end of its input or --seconds, and while the data are live. After a
    /// kill of the command the motors jog for 200 ms at most
    #[arg(long)]
    pub hold: bool,
    /// End the held jog after this time, in seconds
    #[arg(long, value_name = "S", requires = "hold", value_parser = seconds, allow_negative_numbers = true)]
    pub seconds: Option<Duration>,
}

/// Jogs the motors `numbers`, for `seconds` at most.
pub fn hold(
    context: &Context,
    action: PanelAction,
    numbers: &[u8],
    seconds: Option<Duration>,
) -> Result<Verdict, Failure> {
    let mut connection = context.connection()?;
    check_numbers(Context::family(None, &mut connection)?, true, numbers)?;
    let interrupt = Interrupt::listen()?;
    // An input that ended before the jog cannot hold it: only the time ends the jog then.
    let holds = !input_ended();
    if !holds && seconds.is_none() {
        let reason =
            "--hold needs an open input, or --seconds: else nothing would hold the jog; nothing was sent";
        return Err(Failure::Request(reason.to_owned()));
    }
    let end = seconds.and_then(|seconds| Instant::now().checked_add(seconds));
    let mut sight = Sight::begin(context);
    let held = HeldJog::begin(connection, action.name(), numbers)?;
    let over = || interrupt.came() || end.is_some_and(|end| Instant::now() >= end) || !held.is_held();
    let mut lost = None;
    while lost.is_none() && !over() {
        if !holds {
            std::thread::sleep(Duration::from_millis(INPUT_WITHIN_MS.into()));
        } else if input_ended() {
            break;
        }
        lost = sight.lost();
    }
    let Some(why) = lost else { return stop(held, numbers) };
    let motors = listed(numbers);
    note(format_args!(
        "pmacctl: the data are not live ({why}), so nobody can see what motor {motors} does: it MAY BE MOVING; the hold \
         ends with a stop"
    ));
    stop(held, numbers)?;
    Err(Failure::Refused(format!(
        "the hold of motor {motors} was ended: the data were not live; the stop was taken"
    )))
}

/// The data that show the motors during the jog.
struct Sight {
    /// The segment; `None` where it was not readable at the start.
    board: Option<Board>,
    /// Whether the servo data were live at the start: a jog can also be held without live data.
    has_servo: bool,
    /// The time since when no data are live.
    blind_since: Option<Instant>,
}

impl Sight {
    fn begin(context: &Context) -> Self {
        let mut board = context.board().ok();
        let servo = board.as_mut().and_then(|board| board.snapshot().ok()?.servo);
        Self { board, has_servo: servo.is_some_and(|servo| servo.is_fresh()), blind_since: None }
    }

    /// Why the data have not shown the motors for [`UNSURE_AFTER`]; `None` if they have.
    fn lost(&mut self) -> Option<String> {
        let board = self.board.as_mut()?;
        let snapshot = board.snapshot().ok()?;
        let servo = snapshot.servo.filter(|_| self.has_servo).and_then(|servo| servo.stale);
        let Some(why) = snapshot.stale.or(servo) else {
            self.blind_since = None;
            return None;
        };
        let since = *self.blind_since.get_or_insert_with(Instant::now);
        (since.elapsed() >= UNSURE_AFTER).then(|| why.to_string())
    }
}

/// Stops the held jog. Says soon, not only in the end, that the motors may be moving.
fn stop(held: HeldJog, numbers: &[u8]) -> Result<Verdict, Failure> {
    let warning = may_be_moving(numbers);
    let (tell, told) = channel();
    std::thread::spawn(move || tell.send(held.stop()));
    let stopped = told.recv_timeout(UNSURE_AFTER).or_else(|_| {
        note(format_args!("pmacctl: {warning}"));
        told.recv()
    });
    match stopped {
        Ok(Ok(_)) => Ok(Verdict::Yes),
        Ok(Err(error @ CommandError::Refused(_))) => Err(error.into()),
        Ok(Err(error)) => Err(Failure::Request(format!("{error}; {warning}"))),
        Err(_) => Err(Failure::Request(warning)),
    }
}

/// The warning while pmacd has not confirmed the stop of a held jog.
pub fn may_be_moving(numbers: &[u8]) -> String {
    format!(
        "motor {} MAY BE MOVING: pmacd did not confirm the stop. A paused pmacd stops it when it goes on, a new one does \
         not: use the emergency stop, pmacctl jog {} stop, pmacctl abort, or ^A over the serial port",
        listed(numbers),
        listed(numbers).replace(' ', "")
    )
}

/// The numbers as a sentence has them: `1, 2`.
fn listed(numbers: &[u8]) -> String {
    let numbers: Vec<String> = numbers.iter().map(ToString::to_string).collect();
    numbers.join(", ")
}

/// Waits a moment for input and discards it. Returns whether the input has ended.
fn input_ended() -> bool {
    let stdin = io::stdin();
    match poll(&mut [PollFd::new(stdin.as_fd(), PollFlags::POLLIN)], PollTimeout::from(INPUT_WITHIN_MS)) {
        Ok(0) | Err(Errno::EINTR) => false,
        Ok(_) => match stdin.lock().read(&mut [0; 256]) {
            Ok(count) => count == 0,
            Err(error) => error.kind() != io::ErrorKind::Interrupted,
        },
        // The input cannot be read: treat it as ended.
        Err(_) => true,
    }
}
