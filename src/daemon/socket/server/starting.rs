//! Checks lines and starts before the daemon sends them, and keeps their effects: a start runs no lines that no client
//! expects.

use std::time::Instant;

use super::Service;
use crate::daemon::motion::effect::{LineEffect, Starts};
use crate::daemon::shared::caller::Caller;
use crate::daemon::shared::open_buffer::Account;
use crate::daemon::shared::queue::Outcome;
use crate::daemon::socket::heard::Heard;
use crate::language::settings::CutsOff;
use crate::language::{Line, WhileOpen, is_rotary};
use crate::protocol::board::SendReply;
use crate::protocol::cut_off;
use crate::protocol::{CallError, OpenBufferInfo, Reply, control};

impl Service {
    /// Checks that `client` may send `line`, alone or in a sequence, and returns the line's effect. `confirmed`: the
    /// lines left in rotary buffers shall run.
    ///
    /// # Errors
    /// Why not; the daemon has sent nothing.
    pub(super) fn may_send(
        &mut self,
        client: u64,
        line: &Line,
        confirmed: bool,
    ) -> Result<LineEffect, CallError> {
        let meaning = &line.meaning;
        self.may_start(Starts { systems: meaning.starts, confirmed })?;
        let open = self.info.board().open_buffer.as_ref().and_then(|open| open.name.as_deref());
        let effect = LineEffect::of(meaning, open.is_some_and(is_rotary), self.info.family().i.panel);
        self.spares_holds(client, meaning.moves)?;
        Ok(effect)
    }

    /// The board has carried out a line of `by` with this `effect`.
    pub(super) fn line_done(&mut self, effect: LineEffect, by: Account, now: Instant) {
        self.leftovers.forget(effect.forgets);
        self.leftovers.aborted(effect.aborts);
        if effect.ends_panel {
            self.panel_ended(Some(by), now);
        }
    }

    /// The reply to the caller whose line, with this `effect`, has ended.
    pub(super) fn reply_to_line(
        &mut self,
        effect: LineEffect,
        heard: Heard,
        now: Instant,
    ) -> Result<Reply, CallError> {
        let by = heard.caller.peer.account();
        if heard.outcome == Outcome::Done {
            self.line_done(effect, by, now);
        }
        let lines = heard.lines(now)?;
        // The buffer open at this moment: the bus thread reports open buffers and the board's answers in their order.
        let open = self.info.board().open_buffer.as_ref();
        let WhileOpen { enters, changes, may_act, .. } = effect.while_open;
        let is_told = |open: &&OpenBufferInfo| may_act || enters && open.takes_lines_of(by.uid);
        let entered = open.filter(is_told).filter(|_| lines.is_empty() && !changes).cloned();
        Reply::with(&SendReply { lines, entered })
    }

    /// Checks that `caller` may send `line` alone although the line affects every user. While a program is open the
    /// board carries out nothing at once, and `$$$` and `SAVE` are no statements.
    ///
    /// # Errors
    /// Tells the line's effect, and on whom; the daemon has sent nothing.
    pub(super) fn is_meant(&self, caller: Caller, line: &Line) -> Result<(), CallError> {
        let cuts_off = line.meaning.settings.cuts_off;
        if self.info.board().open_buffer.is_none() && cuts_off != CutsOff::No {
            return Err(cut_off::refusal(line, cuts_off));
        }
        self.spares_others(caller, line)
    }

    /// Checks that `line` leaves alone the buffers that other users have open, and the sequences that they run.
    ///
    /// # Errors
    /// Names the work that the line would end; the daemon has sent nothing.
    pub(super) fn spares_others(&self, caller: Caller, line: &Line) -> Result<(), CallError> {
        let Some(command) = cut_off::ends_work(&line.meaning) else { return Ok(()) };
        let uid = caller.peer.uid;
        let is_others = |open: &&OpenBufferInfo| !open.sequence && open.uid != Some(uid.as_raw());
        let buffer = self.info.board().open_buffer.as_ref().filter(is_others).map(ToString::to_string);
        let work: Vec<String> = self.sequences.of_others(uid).chain(buffer).collect();
        if work.is_empty() { Ok(()) } else { Err(cut_off::ends_work_refusal(command, &work.join(", and "))) }
    }

    /// The line that the daemon sends in the place of `character`. ^U and ^L act as `OPEN ROT` and `CLOSE` (Software
    /// Reference p. 273), so the same rules hold, and the daemon knows the buffers' owner. ^L closes rotary buffers. If
    /// a board closed any buffer by ^L, it would end another client's download, so other buffers need `CLOSE`.
    ///
    /// # Errors
    /// A buffer other than the rotary buffers is open; the daemon has sent nothing.
    pub(super) fn line_for(&self, character: u8) -> Result<Option<&'static str>, CallError> {
        let is_other = |open: &&OpenBufferInfo| open.name.as_deref().is_none_or(|name| !is_rotary(name));
        match (character, self.info.board().open_buffer.as_ref().filter(is_other)) {
            (control::OPEN_ROTARY, _) => Ok(Some("OPEN ROT")),
            (control::CLOSE_ROTARY, None) => Ok(Some("CLOSE")),
            (control::CLOSE_ROTARY, Some(open)) => Err(CallError::refused(format_args!(
                "^L closes the rotary buffers, and what is open is {open}; nothing was sent; CLOSE by an engineer closes it"
            ))),
            _ => Ok(None),
        }
    }

    /// Checks that programs may start: the daemon is not ending a stream that feeds them, and no lines are left there.
    ///
    /// # Errors
    /// Why not; the daemon has sent nothing.
    pub(super) fn may_start(&mut self, starts: Starts) -> Result<(), CallError> {
        if self.sequences.is_ending_feed(starts.systems) {
            return Err(CallError::refused(
                "not started: pmacd is ending a rotary stream into this coordinate system; try again",
            ));
        }
        self.leftovers.check(starts)
    }
}
