//! How long the bus thread waits for what, in one place, so that the order of these times can be seen and checked.
//!
//! A time of the board's own handshake stands with its function (`crate::function`); a time of the loop's rounds, in nanoseconds,
//! with the loop.

use std::time::Duration;

// Questions of the daemon about the board.
/// How long the board may take for a question about its identity.
pub const IDENTITY_ANSWER: Duration = Duration::from_millis(500);
/// The most time for such a question that a board gets that was late.
pub const IDENTITY_ANSWER_AT_MOST: Duration = Duration::from_secs(2);
/// How long to wait before the daemon asks a silent board again.
pub const IDENTITY_AGAIN: Duration = Duration::from_secs(10);
/// How often to ask for I-variables that another host may have changed.
pub const IDENTITY_RECHECK: Duration = Duration::from_secs(30);
/// How long to wait after a line that may have changed something: more may follow.
pub const IDENTITY_AFTER_LINE: Duration = Duration::from_millis(200);
/// How long lines that go on changing something can put these questions off.
pub const IDENTITY_PUT_OFF_AT_MOST: Duration = Duration::from_secs(2);
/// How long the board may take for a question for definitions of M-variables.
pub const DEFINITIONS_ANSWER: Duration = Duration::from_secs(5);
/// How long to wait before the daemon repeats a question that the board has not answered, or otherwise.
pub const DEFINITIONS_AGAIN: Duration = Duration::from_secs(1);
/// The same of a board that does not tell.
pub const DEFINITIONS_AGAIN_AT_LAST: Duration = Duration::from_secs(30);
/// How long to wait after a line that defines an M-variable: more may follow.
pub const DEFINITIONS_AFTER_LINE: Duration = Duration::from_secs(1);
/// After so long without an answer the board counts as one that does not tell.
pub const DEFINITIONS_NOT_TOLD: Duration = Duration::from_secs(10);
/// How long lines that always wait can put these questions off.
pub const DEFINITIONS_PUT_OFF_AT_MOST: Duration = Duration::from_secs(2);
/// How long the reply to a question of the daemon's may take; a slow board is asked for fewer lines.
pub const OWN_QUESTION: Duration = Duration::from_millis(400);

// Command lines.
/// How often to poll right after something happened, while the board owes an answer.
pub const LINES_POLL_SOON: Duration = Duration::from_micros(100);
/// How often to poll later, while the board still owes an answer.
pub const LINES_POLL_LATER: Duration = Duration::from_millis(1);
/// How long the daemon polls often after the last thing that happened.
pub const LINES_POLLED_OFTEN: Duration = Duration::from_millis(20);
/// How often to poll for unsolicited texts when nothing is owed and no interrupt announces them.
pub const LINES_POLL_IDLE: Duration = Duration::from_millis(20);
/// How often to poll for unsolicited texts when an interrupt announces them, which may be lost.
pub const LINES_POLL_IDLE_WITH_INTERRUPT: Duration = Duration::from_secs(1);
/// How long the board may take from one line to the next of the reply to a question of the daemon's.
pub const OWN_LINE: Duration = Duration::from_millis(500);
/// How long the board may take for all lines of such a reply.
pub const OWN_REPLY: Duration = Duration::from_secs(5);
/// How long the board may take to say whether a program buffer is open.
pub const BUFFER_ANSWER: Duration = Duration::from_secs(1);
/// How soon the daemon asks that again for a question of its own, when a buffer was open or the board did not answer.
pub const BUFFER_AGAIN: Duration = Duration::from_secs(1);
/// How long the board may take for the line that settles whose a reply is, and then for each response.
pub const CHECK_ANSWER: Duration = Duration::from_secs(1);
/// How soon that line goes again to a board that did not answer it.
pub const CHECK_AGAIN: Duration = Duration::from_secs(1);
/// How long the board may take for the `^F` that asks whether it takes control characters. It takes them within milliseconds.
pub const CHARACTER_TAKEN: Duration = Duration::from_millis(300);
/// How soon `^F` goes again when the board did not take it.
pub const CHARACTER_AGAIN: Duration = Duration::from_secs(5);
/// How often the DPRAM's page is written while the board does not answer.
pub const PAGE_AGAIN: Duration = Duration::from_secs(1);
/// A line that takes so long is one that others are told they wait for.
pub const LINE_IS_SLOW: Duration = Duration::from_millis(50);
/// The board has this of the wait to answer in, if the whole wait is four times as long.
pub const LEFT_TO_ANSWER: Duration = Duration::from_millis(500);

// Ports and interrupts.
/// How long a command may stay unread in the DPRAM before the board is asked. It takes commands within milliseconds.
pub const LINE_STUCK: Duration = Duration::from_millis(100);
/// How often the board is asked for I58 again.
pub const PORT_ASKED_AGAIN: Duration = Duration::from_secs(2);
/// How soon the board is asked after a line that may have changed the answer.
pub const PORT_ASKED_SOON: Duration = Duration::from_millis(200);
/// How long the board may take to answer the question for I58 through the mailboxes.
pub const PORT_ANSWER: Duration = Duration::from_millis(500);
/// How long after a response the host port's interrupt may still come. Then it was lost on its way to the host, and has to be
/// acknowledged all the same.
pub const RESPONSE_ANNOUNCED: Duration = Duration::from_millis(50);
/// How often a lost connection is tried again.
pub const INTERRUPT_RECONNECT: Duration = Duration::from_millis(500);
/// An interrupt and its response are no further apart.
pub const INTERRUPT_APART: Duration = Duration::from_millis(100);

// The loop and its other work.
/// Time limit at the start for the board to make the DPRAM visible.
pub const FIRST_REACH: Duration = Duration::from_millis(200);
/// Time limit at the end for the board to stop held jogs.
pub const LAST_STOP: Duration = Duration::from_millis(500);
/// Within which time changes are counted that may be logged.
pub const LOG_QUOTA: Duration = Duration::from_secs(60);
/// How often to ask whether the board has taken a request.
pub const PANEL_POLL: Duration = Duration::from_millis(1);
/// How often to poll whether PMAC is done.
pub const WRITE_POLL: Duration = Duration::from_millis(1);
/// How often to look for room in a full buffer: two reads. More often than a servo cycle, after which even a board that
/// takes all there is at once has not taken what came since the last one.
pub const ROTARY_POLL: Duration = Duration::from_micros(250);

const fn is_less(one: Duration, other: Duration) -> bool {
    one.as_nanos() < other.as_nanos()
}

// The order that the rules of the bus thread rely on.
const _: () = {
    assert!(is_less(LINES_POLL_SOON, LINES_POLL_LATER) && is_less(LINES_POLL_LATER, LINES_POLL_IDLE));
    assert!(is_less(LINES_POLL_IDLE, LINES_POLL_IDLE_WITH_INTERRUPT));
    assert!(is_less(OWN_LINE, OWN_REPLY));
    // A question is cut so that its whole reply comes in time; a board that was late gets more time.
    assert!(is_less(OWN_QUESTION, IDENTITY_ANSWER) && is_less(IDENTITY_ANSWER, IDENTITY_ANSWER_AT_MOST));
    assert!(is_less(IDENTITY_AFTER_LINE, IDENTITY_PUT_OFF_AT_MOST));
    assert!(is_less(IDENTITY_ANSWER_AT_MOST, IDENTITY_AGAIN) && is_less(IDENTITY_AGAIN, IDENTITY_RECHECK));
    assert!(is_less(DEFINITIONS_AFTER_LINE, DEFINITIONS_PUT_OFF_AT_MOST));
    // The board is asked more than once before it counts as one that does not tell.
    assert!(is_less(DEFINITIONS_ANSWER, DEFINITIONS_NOT_TOLD));
    assert!(is_less(DEFINITIONS_NOT_TOLD, DEFINITIONS_AGAIN_AT_LAST));
    assert!(is_less(CHARACTER_TAKEN, CHARACTER_AGAIN));
    // The board has answered the question for I58, or its time is over, before it is asked again.
    assert!(is_less(LINE_STUCK, PORT_ASKED_SOON) && is_less(PORT_ANSWER, PORT_ASKED_AGAIN));
    assert!(is_less(RESPONSE_ANNOUNCED, INTERRUPT_APART) && is_less(INTERRUPT_APART, INTERRUPT_RECONNECT));
};
