//! The thread that asks the daemon for data that the segment does not have, so that a silent daemon does not stop the
//! screen.

use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::watches::{Watched, Watches};
use crate::cli::context::Context;
use crate::cli::show::coordinates::Overrides;
use crate::cli::show::status;

/// The thread asks this often.
const ASK_EVERY: Duration = Duration::from_secs(1);

/// The daemon's last answer.
pub struct DaemonAnswer {
    pub at: Instant,
    /// The document of `status --json`.
    pub status: Value,
    pub overrides: Overrides,
    pub watched: Watched,
}

/// Its drop ends the thread as soon as the daemon has answered.
pub struct Asker {
    names: Sender<Vec<String>>,
    answers: Receiver<DaemonAnswer>,
    last: Option<DaemonAnswer>,
}

impl Asker {
    /// Asks for the values of `watches`, too.
    pub fn new(context: Context, watches: Vec<String>) -> Self {
        let ((names, wanted), (tell, answers)) = (channel(), channel());
        let asker = Self { names, answers, last: None };
        asker.watch(watches);
        std::thread::spawn(move || run(&context, &wanted, &tell));
        asker
    }

    /// Asks for the values of these names from now on.
    pub fn watch(&self, names: Vec<String>) {
        // The thread ends only with the screen.
        let _ = self.names.send(names);
    }

    /// The last answer, if there is one.
    pub fn last(&mut self) -> Option<&DaemonAnswer> {
        if let Some(answer) = self.answers.try_iter().last() {
            self.last = Some(answer);
        }
        self.last.as_ref()
    }
}

fn run(context: &Context, names: &Receiver<Vec<String>>, tell: &Sender<DaemonAnswer>) {
    let mut watches = Watches::default();
    loop {
        match names.recv_timeout(ASK_EVERY) {
            Ok(names) => watches.set(names),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
        let status = status::look(context);
        let status = status.unwrap_or_else(
            |failure| json!({ "name": null, "condition": "unreachable", "reason": failure.to_string() }),
        );
        let i10 = context.board().and_then(|mut board| Ok(board.identity()?.i10)).ok().flatten();
        let overrides = Overrides::ask(context, i10);
        let watched = watches.look(context);
        if tell.send(DaemonAnswer { at: Instant::now(), status, overrides, watched }).is_err() {
            return;
        }
    }
}
