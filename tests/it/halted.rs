//! The caller ends a whole gather or a whole stream, and the daemon does not carry out the end.

use std::time::Duration;

use pmac_dpram::client::{Board, ClientError, CommandError, StreamOptions, gather_all, stream_all};
use pmac_dpram::protocol::CallError;

use crate::support::{PATIENCE, Site, wait_until};

fn running() -> Site {
    let site = Site::running(&[], &[]);
    site.wait_for_live_servo();
    wait_until("the board's scales", || site.has_scales());
    site
}

#[test]
fn a_stream_whose_program_may_run_on_is_not_told_as_ended() {
    let mut site = running();
    let connections = (site.connection(), site.connection());
    let text = "X1\n".repeat(5000);
    let options = StreamOptions {
        coordinate_system: 1,
        define_longs: Some(100),
        run: false,
        left: None,
        timeout: PATIENCE,
    };
    // No stop is sent before the daemon is gone.
    let goes_on = || {
        site.kill_daemon();
        false
    };
    let error = stream_all(connections, ("text", text.as_bytes()), &options, goes_on).unwrap_err();
    assert!(error.began && error.said.contains("the program may run on"), "{error}");
    assert!(matches!(error.cause, CommandError::Refused(CallError::StopFailed { .. })), "{error:?}");
}

#[test]
fn a_gather_that_the_board_may_continue_is_not_told_as_ended() {
    let mut site = running();
    let (mut board, connection) = (Board::attach(&site.name).unwrap(), site.connection());
    let sources = ["servo_timer".to_owned()];
    let goes_on = || {
        site.kill_daemon();
        false
    };
    let error = gather_all(&mut board, connection, &sources, (1, Duration::from_secs(600)), goes_on);
    match error.unwrap_err() {
        ClientError::Socket(error) => assert!(error.is_uncertain(), "{error}"),
        ClientError::Gather(text) => assert!(text.contains("may go on gathering"), "{text}"),
        error => panic!("{error}"),
    }
}
