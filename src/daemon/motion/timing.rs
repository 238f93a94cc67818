//! Limits in time of motion and its stops.

use std::time::Duration;

/// How long the reports must show a motor standing until its jog is over: a motor that turns round stands for a moment.
pub const JOG_STANDS: Duration = Duration::from_millis(100);

/// How long the panel may take for a stop.
pub const PANEL_STOP_TAKES: Duration = Duration::from_millis(100);
/// How long the board may take to tell the address before a stop by command line. After the daemon gives up a question,
/// the port stays held for longer than a slow board takes to answer.
pub const STOP_QUESTION_TAKES: Duration = Duration::from_millis(400);
/// How long the board may take for the line that stops, and for ^A.
pub const STOP_LINE_TAKES: Duration = Duration::from_secs(1);
/// How long the holder's own stop may take, by panel, command line and ^A. The holder waits meanwhile, and renews
/// nothing.
pub const HOLDERS_STOP_TAKES: Duration = Duration::from_secs(3);
/// How long the daemon waits to request a stop again that it has not seen the board take.
pub const STOP_AGAIN: Duration = Duration::from_secs(1);

/// How long the reports must show a motor standing until its stop is done. A report may date from just before the motor
/// began to move.
pub const STOP_SEEN: Duration = Duration::from_millis(50);
/// How long motors may go on after a stop where the daemon sends no ^A: shorter than a client waits before it warns its
/// user.
pub const STOP_GIVEN_UP: Duration = Duration::from_millis(800);
/// How long the daemon watches motors that no message sent can stop: they may stand by themselves.
pub const STOP_HOPELESS: Duration = Duration::from_millis(100);

const _: () = {
    let by_every_way =
        PANEL_STOP_TAKES.as_millis() + STOP_QUESTION_TAKES.as_millis() + 2 * STOP_LINE_TAKES.as_millis();
    assert!(by_every_way < HOLDERS_STOP_TAKES.as_millis(), "the holder's stop goes every way");
    assert!(STOP_SEEN.as_millis() < STOP_HOPELESS.as_millis(), "a motor that stands is seen to stand");
    assert!(STOP_HOPELESS.as_millis() < STOP_GIVEN_UP.as_millis(), "hope takes longer");
    assert!(STOP_GIVEN_UP.as_millis() < STOP_AGAIN.as_millis(), "a stop ends before it is requested again");
};
