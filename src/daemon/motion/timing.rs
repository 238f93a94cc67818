//! How long motion and its stops may take.

use std::time::Duration;

/// How long a motor must be seen to stand until its jog is over: a motor that turns round stands for a moment.
pub const JOG_STANDS: Duration = Duration::from_millis(100);

/// How long the panel has for a stop.
pub const PANEL_STOP_TAKES: Duration = Duration::from_millis(100);
/// How long the board has to say what is addressed before a stop by command line. A question that is given up holds the port for
/// longer than a slow board takes.
pub const STOP_QUESTION_TAKES: Duration = Duration::from_millis(400);
/// How long the board has for the line that stops, and for ^A.
pub const STOP_LINE_TAKES: Duration = Duration::from_secs(1);
/// How long the holder's own stop may take, by panel, command line and ^A. Its holder waits, and renews nothing.
pub const HOLDERS_STOP_TAKES: Duration = Duration::from_secs(3);
/// How long until a stop that nobody has seen to be taken is requested again.
pub const STOP_AGAIN: Duration = Duration::from_secs(1);

/// How long a motor must be seen to stand until its stop is done. A report may be from just before the motor began to move.
pub const STOP_SEEN: Duration = Duration::from_millis(50);
/// How long motors that were stopped may go on where the daemon sends no ^A: less than what a client waits before it warns its user.
pub const STOP_GIVEN_UP: Duration = Duration::from_millis(800);
/// How long motors are looked at where nothing that was sent can stop them: they may stand by themselves.
pub const STOP_HOPELESS: Duration = Duration::from_millis(100);

const _: () = {
    let by_every_way =
        PANEL_STOP_TAKES.as_millis() + STOP_QUESTION_TAKES.as_millis() + 2 * STOP_LINE_TAKES.as_millis();
    assert!(by_every_way < HOLDERS_STOP_TAKES.as_millis(), "the holder's stop goes every way");
    assert!(STOP_SEEN.as_millis() < STOP_HOPELESS.as_millis(), "a motor that stands is seen to stand");
    assert!(STOP_HOPELESS.as_millis() < STOP_GIVEN_UP.as_millis(), "hope takes longer");
    assert!(STOP_GIVEN_UP.as_millis() < STOP_AGAIN.as_millis(), "a stop ends before it is requested again");
};
