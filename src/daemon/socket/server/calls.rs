//! The part of the server that begins calls, and goes on with them when the board has answered.

use std::time::{Duration, Instant};

use super::Service;
use super::replies::{Answered, hold_over, is_stopping};
use crate::daemon::motion::effect::LineEffect;
use crate::daemon::motion::hold_end::HoldEnd;
use crate::daemon::motion::leftovers::Leftovers;
use crate::daemon::motion::resets;
use crate::daemon::scripts::{Found, Resource};
use crate::daemon::shared::job::Job;
use crate::daemon::shared::open_buffer::Writer;
use crate::daemon::shared::queue::{Command, Line, Origin, Outcome, Text, Ticket};
use crate::daemon::socket::audit;
use crate::daemon::socket::call_step::{CallStep, CommandPart};
use crate::daemon::socket::call_table::{Caller, Ended, Then};
use crate::daemon::socket::connection::{Client, Waiting};
use crate::daemon::socket::heard::{Heard, reply_lines};
use crate::daemon::socket::jobs;
use crate::daemon::socket::methods::{Action, Ask, parse_call};
use crate::daemon::socket::policy::{Peer, Role};
use crate::daemon::socket::replay;
use crate::function::variable_read::VariableEntry;
use crate::language::password::without_password;
use crate::protocol::board::{JogRenewReply, ResetsReply, WatchReply};
use crate::protocol::{BoardInfo, Call, CallError, Enabled, Reply, answer, control};

/// How long a question to the board for a watch or a reset check may wait.
const WATCH_TIMEOUT: Duration = Duration::from_secs(1);
/// How long the board may take to take a table of registers.
const OWN_JOB_TIMEOUT: Duration = Duration::from_secs(5);

impl Service {
    /// Begins a call: answers the call at once, or hands a command to the bus thread.
    pub(super) fn begin(&mut self, id: u64, call: &Call, now: Instant) {
        self.sequences.renew(id, now);
        self.ledger.hear(|client| client == id, now);
        let Some(client) = self.clients.get(id) else { return };
        let caller = Caller { client: id, peer: client.peer(), oneway: call.oneway == Some(true) };
        let is_unheard = !caller.oneway && !client.hears();
        let outdated = client.call_outdated();
        let action = parse_call(call, client.role(), self.characters, &self.info);
        // The caller has gone without waiting for the answer: the server begins only stops for that caller.
        if is_unheard && !action.as_ref().is_ok_and(Action::stops) {
            return;
        }
        let action = action.and_then(|action| {
            self.info.replies().map_or(Ok(()), |replies| replay::check(&action, replies))?;
            match outdated {
                _ if self.stopping.is_some() && action.begins() => Err(is_stopping()),
                Some(reason) if action.may_move() => Err(CallError::refused(reason)),
                _ => Ok(action),
            }
        });
        if action.as_ref().is_ok_and(Action::ends_motion) {
            self.calls.drop_starts(Text::of(&format_args!(
                "not sent: uid {} has stopped a motion meanwhile; give the command again",
                caller.peer.uid
            )));
        }
        let reply = match action.and_then(|action| self.act(caller, action, now)) {
            Ok(None) => return,
            Ok(Some(reply)) => self.clients.served(id, reply),
            Err(error) => {
                if self.clients.get_mut(id).is_some_and(|client| client.is_worth_telling(&error)) {
                    let Peer { uid, pid, .. } = caller.peer;
                    let what = format_args!("refused {:?} of uid {uid} pid {pid}: {error}", call.method);
                    self.audit.tell(uid, what, now);
                }
                Reply::of_error(&error)
            }
        };
        if !caller.oneway {
            self.clients.reply(id, &reply, now);
        }
    }

    /// Carries out a call; returns the reply if the reply is known at once.
    fn act(&mut self, caller: Caller, action: Action, now: Instant) -> Answered {
        match action {
            Action::Reply(reply) => return Ok(Some(reply)),
            Action::Info => {
                let role = self.clients.get(caller.client).map(|client| client.role().to_string());
                let unfinished =
                    self.sequences.unfinished().into_iter().chain(self.jogs_without_panel()).collect();
                let elsewhere = self.info.elsewhere(self.sequences.on(Resource::Gather).is_some(), now);
                let stops = self.sent_stops.of_others(caller.client, self.info.family());
                let reset_ago_ms = self.resets.ago(now).and_then(|ago| u64::try_from(ago.as_millis()).ok());
                let board = BoardInfo {
                    role,
                    unfinished,
                    notes: self.notes.told(now),
                    elsewhere,
                    stops,
                    reset_ago_ms,
                    ..self.info.board().clone()
                };
                return Reply::with(&board).map(Some);
            }
            Action::Ask(ask) => return self.ask(caller, ask, now),
            Action::StopByLine(target, audit) => {
                let Some(client) = self.clients.get_mut(caller.client) else { return Ok(None) };
                client.wait_for(Waiting::Board);
                self.audit.tell_done(caller.peer, Some(client.role()), &audit, now);
                self.stop_by_line(target, Some(caller), false, now);
            }
            Action::Watch(entries) => {
                let guard = jobs::variables_enabled(self.info.family());
                if !self.answers() || guard.is_known(self.info.enabling(), now) {
                    return self.watch(caller.client, entries, now);
                }
                let deadline = now + WATCH_TIMEOUT;
                self.question(caller, &guard.question(), CallStep::Watch(entries), deadline);
            }
            Action::Stream => {
                if let Some(client) = self.clients.get_mut(caller.client) {
                    client.wait_for(Waiting::Messages(0));
                }
            }
            Action::Trace(end) => {
                if !end && self.tracing.is_free() {
                    let role = self.clients.get(caller.client).map(Client::role);
                    self.audit.tell_done(caller.peer, role, "traces the bus accesses", now);
                }
                return Reply::with(&self.tracing.take(caller, end, now)?).map(Some);
            }
            Action::Sequence(call) => return self.sequence_call(caller, call, now),
            Action::RenewJogs => {
                let going = self.ledger.jogs_by_line(caller.client, now);
                let motors = going.numbers().filter_map(|motor| u8::try_from(motor).ok()).collect();
                return Reply::with(&JogRenewReply { going: !going.is_empty(), motors }).map(Some);
            }
            Action::Note(text) => {
                if !self.notes.add(caller.peer, text, now) {
                    let reason = "a user leaves one note a second".to_owned();
                    return Err(CallError::Refused { reason });
                }
                return Ok(Some(Reply::done()));
            }
            Action::CheckReset => {
                self.question(caller, resets::QUESTION, CallStep::Resets(now), now + WATCH_TIMEOUT);
            }
            Action::Renew => {
                if let Some(renewed) = self.renewed_at_the_end(now) {
                    return renewed.map(|()| Some(Reply::done()));
                }
                let renewed = self.ledger.renew(caller.client, now);
                if renewed == Err(Some(HoldEnd::DaemonEnds)) {
                    self.ledger.forget(caller.client);
                }
                return renewed.map(|()| Some(Reply::done())).map_err(hold_over);
            }
        }
        Ok(None)
    }

    /// Whether the board answers command lines now.
    pub(super) fn answers(&self) -> bool {
        self.info.is_enabled(Enabled::ASCII)
    }

    pub(super) fn ask(&mut self, caller: Caller, ask: Ask, now: Instant) -> Answered {
        if let Ask::Control { character, .. } = ask
            && let Some(line) = self.line_for(character)?
        {
            return self.ask(caller, Ask::line(Line::of(line)), now);
        }
        let Some(ask) = self.knows_what_is_left(caller, ask, now) else { return Ok(None) };
        let deadline = now + ask.timeout();
        match ask {
            Ask::Send { line, question, into_buffer, while_connected, silence, confirmed, .. } => {
                if !confirmed {
                    self.is_meant(caller, &line)?;
                }
                let mut effect = self.may_send(caller.client, &line, confirmed)?;
                if while_connected {
                    effect.ends_jogs(&line.meaning, silence);
                }
                // In an open buffer the line may be a part of a program.
                let is_closed = self.info.board().open_buffer.is_none();
                // A client below the role of engineer enters nothing into a program buffer.
                let role = self.clients.get(caller.client).map(Client::role);
                let question = question || role.is_some_and(|role| role < Role::Engineer);
                let is_question = (is_closed || question) && line.meaning.only_asks_for_variables;
                let sends = format!("sends {:?}", without_password(&line));
                let audit = audit::entry(caller.peer, sends, is_question);
                let origin = Origin::of(caller.peer.uid.as_raw(), &line, false);
                let account = caller.peer.account();
                let writer = match (question, into_buffer) {
                    (true, _) => Writer::Question,
                    (false, Some(true)) => Writer::IntoBuffer(account),
                    (false, Some(false)) => Writer::Beside,
                    (false, None) => Writer::Hand(account),
                };
                let then = Then::Call(CallStep::Reply(effect));
                self.wait_for_board(caller, deadline, then, audit, |ticket| Command::Send {
                    ticket,
                    line,
                    origin,
                    deadline,
                    writer,
                });
            }
            Ask::Control { character, keeps_lines, starts } => {
                self.may_start(starts)?;
                let stops_all = matches!(character, control::ABORT | control::KILL);
                let uid = caller.peer.uid.as_raw();
                let drops_lines = stops_all && !keeps_lines;
                if stops_all {
                    self.stop_all_begins(caller, character, drops_lines, now);
                }
                let sends = format!("sends {}", control::name(character));
                let audit = audit::entry(caller.peer, sends, control::only_reports(character));
                let then = Then::Call(CallStep::Reply(LineEffect::default()));
                self.wait_for_board(caller, deadline, then, audit, |ticket| Command::Control {
                    ticket,
                    uid,
                    drops_lines,
                    character,
                    deadline,
                });
            }
            Ask::Read { first, count } => {
                let then = Then::Call(CallStep::Reply(LineEffect::default()));
                self.wait_for_board(caller, deadline, then, None, |ticket| Command::ReadWords {
                    ticket,
                    first,
                    count,
                });
            }
            Ask::Job(call) => return self.ask_job(caller, Box::new(call), now),
            Ask::Order(order) => return self.order(caller, order, now),
        }
        Ok(None)
    }

    /// Asks the board `question`; the call goes on with `step` afterwards.
    pub(super) fn question(&mut self, caller: Caller, question: &str, step: CallStep, deadline: Instant) {
        self.send_beside(caller, Line::of(question), None, step, deadline);
    }

    /// Sends a line of the daemon's own for `caller`, which enters no program buffer; the call goes on with `step`
    /// afterwards.
    pub(super) fn send_beside(
        &mut self,
        caller: Caller,
        line: Line,
        audit: Option<String>,
        step: CallStep,
        deadline: Instant,
    ) {
        let origin = Origin::of(caller.peer.uid.as_raw(), &line, false);
        self.wait_for_board(caller, deadline, Then::Call(step), audit, |ticket| Command::Send {
            ticket,
            line,
            origin,
            deadline,
            writer: Writer::Question,
        });
    }

    pub(super) fn wait_for_board(
        &mut self,
        caller: Caller,
        deadline: Instant,
        then: Then,
        audit: Option<String>,
        command: impl FnOnce(Ticket) -> Command,
    ) {
        if let Some(client) = self.clients.get_mut(caller.client) {
            client.wait_for(Waiting::Board);
            self.calls.ask(caller, deadline, then, audit, command);
        }
    }

    /// Hands the bus thread as many commands as it has room for.
    pub(super) fn hand_out(&mut self, now: Instant) {
        let Self { calls, clients, audit, info, .. } = self;
        let log = |caller: Caller, what: &str| {
            let role = clients.get(caller.client).map(Client::role);
            audit.tell_done(caller.peer, role, what, now);
        };
        for ended in calls.hand_out(info.holds_port(), now, |client| clients.hears(client), log) {
            self.on_end(ended, now);
        }
    }

    /// The bus thread has finished a command, or has failed to.
    pub(super) fn on_end(&mut self, Ended { then, effect, heard }: Ended, now: Instant) {
        self.note_effect(effect, &then, &heard, now);
        let Heard { caller, outcome, .. } = heard;
        let step = match then {
            Then::Sequence(number, effect) => {
                return self.step_done((number, effect), heard, Found::default(), now);
            }
            Then::Stop(number) => return self.stop_step(number, &heard.lines, outcome, now),
            Then::Call(step) => step,
        };
        // The log has the request, so the log also tells that the request was not carried out.
        if heard.is_logged
            && !heard.is_given_up
            && outcome.is_unsent()
            && let Err(why) = reply_lines(outcome, Vec::new(), false, now)
        {
            let Peer { uid, pid, .. } = caller.peer;
            self.audit.tell(uid, format_args!("refused that of uid {uid} pid {pid}: {why}"), now);
        }
        // A client has stopped all motion since the daemon asked this question: nothing begins behind it.
        if step.part() == CommandPart::Before
            && let Outcome::Dropped(reason) = outcome
        {
            return self.answer(caller, Err(CallError::refused(reason)), now);
        }
        let reply = match step {
            CallStep::Reply(effect) => self.reply_to_line(effect, heard, now).map(Some),
            CallStep::Job(call) => self.job_step(call, heard, now),
            CallStep::Order { order, is_old } => self.order_step(order, is_old, heard, now),
            CallStep::Ordered { effect, back } => self.ordered(effect, &back, heard, now),
            CallStep::PutBack(error) => Err(*error),
            CallStep::Start(start) => self.start_step(start, heard, now),
            CallStep::Watch(entries) => self.watch_step(entries, heard, now),
            CallStep::Resets(asked) => heard.lines(now).and_then(|lines| {
                self.see_counter(&lines, asked, now);
                Reply::with(&ResetsReply { resets: self.resets.count() }).map(Some)
            }),
        };
        if let Some(reply) = reply.transpose() {
            self.answer(caller, reply, now);
        }
    }

    /// The board has answered `lines` to the question for its servo counter, `asked` then.
    pub(super) fn see_counter(&mut self, lines: &[String], asked: Instant, now: Instant) {
        let counter = lines.first().and_then(|line| answer::integer(line));
        let was_reset = counter
            .and_then(|counter| u64::try_from(counter).ok())
            .is_some_and(|counter| self.resets.counter_is(counter, asked, now));
        if was_reset {
            self.leftovers = Leftovers::after_reset();
        }
    }

    /// Answers a call that waited, and begins the caller's next calls.
    pub(super) fn answer(&mut self, caller: Caller, reply: Result<Reply, CallError>, now: Instant) {
        self.ledger.hear(|client| client == caller.client, now);
        let Some(client) = self.clients.get_mut(caller.client) else { return };
        client.wait_for(Waiting::Nothing);
        if !caller.oneway {
            client.reply(&reply.unwrap_or_else(|error| Reply::of_error(&error)), now);
        }
        self.advance(caller.client, now);
    }

    /// Begins a watch after the board has told whether it copies registers, or has not answered.
    fn watch_step(&mut self, entries: Vec<VariableEntry>, heard: Heard, now: Instant) -> Answered {
        let client = heard.caller.client;
        let answers = heard.answers(now)?;
        jobs::variables_enabled(self.info.family()).check(answers.as_deref())?;
        if answers.is_some() {
            // Many watches that begin at once need only one question.
            self.info.confirm_variables(now);
        }
        self.watch(client, entries, now)
    }

    /// Begins a watch. The bus thread hears of it only if the table changes. The reply comes once the board has the
    /// table.
    fn watch(&mut self, id: u64, entries: Vec<VariableEntry>, now: Instant) -> Answered {
        let Some(client) = self.clients.get_mut(id) else { return Ok(None) };
        let observer = (client.role() == Role::Observe).then_some(client.peer().uid);
        let table = self.watches.watch(id, entries, observer).map_err(CallError::refused)?;
        client.wait_for(Waiting::Watch);
        if let Some(table) = table {
            self.tell_watched(&[id], table, now);
        }
        Ok(None)
    }

    /// Tells clients that the board's table number `table` has the registers that they watch.
    pub(super) fn tell_watched(&mut self, clients: &[u64], table: u32, now: Instant) {
        for id in clients {
            let reply = Reply::with(&WatchReply { watched: self.watches.count_of(*id), table });
            if let Ok(reply) = reply {
                self.clients.reply(*id, &Reply { continues: Some(true), ..reply }, now);
            }
        }
    }

    /// Tells clients that the board did not take the table with their registers. They watch nothing.
    pub(super) fn refuse_watches(&mut self, clients: &[u64], outcome: Outcome, now: Instant) {
        for id in clients {
            let Some(client) = self.clients.get_mut(*id) else { continue };
            client.wait_for(Waiting::Nothing);
            let error = reply_lines(outcome, Vec::new(), false, now).err().unwrap_or(CallError::Busy);
            client.reply(&Reply::of_error(&error), now);
            self.advance(*id, now);
        }
    }

    /// Sends the bus thread the table of watched registers after a change. If the queue is full, the server tries
    /// again.
    pub(super) fn send_watch_table(&mut self, now: Instant) {
        let Some(table) = self.watches.update(now) else { return };
        if let Some(ticket) = self.calls.send_now(Job::WatchVariables(table), now + OWN_JOB_TIMEOUT) {
            self.watches.sent(ticket);
        }
    }
}
