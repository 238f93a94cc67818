//! How long the bus thread waits for each event, in one place, so that the order of these times can be seen and
//! checked.
//!
//! A time of the board's own handshake stands with its function (`crate::function`); a time of the loop's rounds, in
//! nanoseconds, with the loop.

use std::time::Duration;

// The daemon's questions about the board.
/// How long the board may take for a question about its identity.
pub const IDENTITY_ANSWER: Duration = Duration::from_millis(500);
/// The most time for such a question, for a board that was late.
pub const IDENTITY_ANSWER_AT_MOST: Duration = Duration::from_secs(2);
/// How long to wait before the daemon asks a silent board again.
pub const IDENTITY_AGAIN: Duration = Duration::from_secs(10);
/// How often the daemon asks for I-variables that another host may have changed.
pub const IDENTITY_RECHECK: Duration = Duration::from_secs(30);
/// How long the daemon waits after a line that may have changed an I-variable: more lines may follow.
pub const IDENTITY_AFTER_LINE: Duration = Duration::from_millis(200);
/// How long lines that go on changing I-variables can put these questions off.
pub const IDENTITY_PUT_OFF_AT_MOST: Duration = Duration::from_secs(2);
/// How long the board may take for a question for definitions of M-variables.
pub const DEFINITIONS_ANSWER: Duration = Duration::from_secs(5);
/// How long the daemon waits before it repeats a question that the board has not answered, or has answered wrongly.
pub const DEFINITIONS_AGAIN: Duration = Duration::from_secs(1);
/// The same pause, for a board that does not tell its definitions.
pub const DEFINITIONS_AGAIN_AT_LAST: Duration = Duration::from_secs(30);
/// How long the daemon waits after a line that defines an M-variable: more lines may follow.
pub const DEFINITIONS_AFTER_LINE: Duration = Duration::from_secs(1);
/// After this time without an answer the daemon takes the board for one that does not tell its definitions.
pub const DEFINITIONS_NOT_TOLD: Duration = Duration::from_secs(10);
/// How long a queue that is never empty can put these questions off.
pub const DEFINITIONS_PUT_OFF_AT_MOST: Duration = Duration::from_secs(2);
/// How long the reply to the daemon's own question may take; the daemon asks a slow board for fewer lines.
pub const OWN_QUESTION: Duration = Duration::from_millis(400);

// Command lines.
/// How often the daemon polls right after an event, while the board owes an answer.
pub const LINES_POLL_SOON: Duration = Duration::from_micros(100);
/// How often the daemon polls later, while the board still owes an answer.
pub const LINES_POLL_LATER: Duration = Duration::from_millis(1);
/// How long after the last event the daemon polls often.
pub const LINES_POLLED_OFTEN: Duration = Duration::from_millis(20);
/// How often the daemon polls for unsolicited texts while the board owes no answer and no interrupt announces texts.
pub const LINES_POLL_IDLE: Duration = Duration::from_millis(20);
/// How often the daemon polls for unsolicited texts if an interrupt announces them, which may be lost.
pub const LINES_POLL_IDLE_WITH_INTERRUPT: Duration = Duration::from_secs(1);
/// How long the board may take from one line to the next, in the reply to the daemon's own question.
pub const OWN_LINE: Duration = Duration::from_millis(500);
/// How long the board may take for all lines of such a reply.
pub const OWN_REPLY: Duration = Duration::from_secs(5);
/// How long the board may take to say whether a program buffer is open.
pub const BUFFER_ANSWER: Duration = Duration::from_secs(1);
/// How soon the daemon asks again for a question of its own, if a buffer was open or the board did not answer.
pub const BUFFER_AGAIN: Duration = Duration::from_secs(1);
/// How long the board may take for the probe, the line that settles whose a reply is, and then for each response.
pub const CHECK_ANSWER: Duration = Duration::from_secs(1);
/// How soon the daemon sends the probe again to a board that did not answer it.
pub const CHECK_AGAIN: Duration = Duration::from_secs(1);
/// How long the board may take for the `^F` that asks whether it takes control characters. A board takes them within
/// milliseconds.
pub const CHARACTER_TAKEN: Duration = Duration::from_millis(300);
/// How soon the daemon sends `^F` again if the board did not take it.
pub const CHARACTER_AGAIN: Duration = Duration::from_secs(5);
/// How often the daemon writes the DPRAM's page while the board does not answer.
pub const PAGE_AGAIN: Duration = Duration::from_secs(1);
/// When a line is slow: from then on the daemon tells other clients that they wait for this line.
pub const LINE_IS_SLOW: Duration = Duration::from_millis(50);
/// The part of a wait that the daemon keeps for the board's answer, if the whole wait is at least four times as long.
pub const LEFT_TO_ANSWER: Duration = Duration::from_millis(500);

// Ports and interrupts.
/// How long a command may stay unread in the DPRAM before the daemon asks the board. A board takes commands within
/// milliseconds.
pub const LINE_STUCK: Duration = Duration::from_millis(100);
/// How often the daemon asks the board for I58 again.
pub const PORT_ASKED_AGAIN: Duration = Duration::from_secs(2);
/// How soon the daemon asks after a line that may have changed the answer.
pub const PORT_ASKED_SOON: Duration = Duration::from_millis(200);
/// How long the board may take to answer the question for I58 through the mailboxes.
pub const PORT_ANSWER: Duration = Duration::from_millis(500);
/// How long after a response the host port's interrupt may still come. Then the interrupt was lost on its way to the
/// host, and the daemon has to acknowledge it all the same.
pub const RESPONSE_ANNOUNCED: Duration = Duration::from_millis(50);
/// How often the daemon tries to restore a lost connection.
pub const INTERRUPT_RECONNECT: Duration = Duration::from_millis(500);
/// The longest time between an interrupt and its response.
pub const INTERRUPT_APART: Duration = Duration::from_millis(100);

// The loop and its other work.
/// Time limit at the start for the board to make the DPRAM visible.
pub const FIRST_REACH: Duration = Duration::from_millis(200);
/// Time limit at the end for the board to stop held jogs.
pub const LAST_STOP: Duration = Duration::from_millis(500);
/// The time within which the daemon counts the changes for the log.
pub const LOG_QUOTA: Duration = Duration::from_secs(60);
/// How often the daemon polls whether the board has taken a request.
pub const PANEL_POLL: Duration = Duration::from_millis(1);
/// How often the daemon polls whether PMAC is done.
pub const WRITE_POLL: Duration = Duration::from_millis(1);
/// How often the daemon looks for room in a full buffer, with two reads. The pause is shorter than a servo cycle: after
/// a cycle, even a board that takes all lines at once has not taken the lines that came since the last one.
pub const ROTARY_POLL: Duration = Duration::from_micros(250);

const fn is_less(one: Duration, other: Duration) -> bool {
    one.as_nanos() < other.as_nanos()
}

// The order that the rules of the bus thread rely on.
const _: () = {
    assert!(is_less(LINES_POLL_SOON, LINES_POLL_LATER) && is_less(LINES_POLL_LATER, LINES_POLL_IDLE));
    assert!(is_less(LINES_POLL_IDLE, LINES_POLL_IDLE_WITH_INTERRUPT));
    assert!(is_less(OWN_LINE, OWN_REPLY));
    // The daemon cuts a question so that its whole reply comes in time; a board that was late gets more time.
    assert!(is_less(OWN_QUESTION, IDENTITY_ANSWER) && is_less(IDENTITY_ANSWER, IDENTITY_ANSWER_AT_MOST));
    assert!(is_less(IDENTITY_AFTER_LINE, IDENTITY_PUT_OFF_AT_MOST));
    assert!(is_less(IDENTITY_ANSWER_AT_MOST, IDENTITY_AGAIN) && is_less(IDENTITY_AGAIN, IDENTITY_RECHECK));
    assert!(is_less(DEFINITIONS_AFTER_LINE, DEFINITIONS_PUT_OFF_AT_MOST));
    // The daemon asks the board more than once before it takes the board for one that does not tell its definitions.
    assert!(is_less(DEFINITIONS_ANSWER, DEFINITIONS_NOT_TOLD));
    assert!(is_less(DEFINITIONS_NOT_TOLD, DEFINITIONS_AGAIN_AT_LAST));
    assert!(is_less(CHARACTER_TAKEN, CHARACTER_AGAIN));
    // The board has answered the question for I58, or the question's time is over, before the daemon asks again.
    assert!(is_less(LINE_STUCK, PORT_ASKED_SOON) && is_less(PORT_ANSWER, PORT_ASKED_AGAIN));
    assert!(is_less(RESPONSE_ANNOUNCED, INTERRUPT_APART) && is_less(INTERRUPT_APART, INTERRUPT_RECONNECT));
};
