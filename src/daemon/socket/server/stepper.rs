//! The command server driven step by step, with the clock of its caller: for fuzzing and for tests.
//!
//! The same server as [`super`] runs in a thread. A test can so try races in every order, and repeat each order.

use std::io;
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use nix::sys::eventfd::{EfdFlags, EventFd};

use super::{Backend, Service};
use crate::daemon::socket::connection::Client;
use crate::daemon::socket::listener::Listener;
use crate::daemon::socket::options::{ServeError, ServeOptions};
use crate::daemon::socket::policy::{Peer, Role};
use crate::map::Motors;

/// The server.
pub struct ServerStepper {
    service: Service,
    never: EventFd,
}

/// Counts of the server's state.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ServerStats {
    /// Connections.
    pub clients: usize,
    /// Calls that wait for the board.
    pub calls: usize,
    /// Tickets that belong to a connection, or to a sequence.
    pub tickets: usize,
    /// Sequences that run.
    pub sequences: usize,
    /// Stops under way.
    pub stops: usize,
    /// Jogs that a connection holds.
    pub holds: usize,
    /// Commands that wait for their turn or are with the bus thread.
    pub turns: usize,
    /// Registers that clients watch.
    pub watched: usize,
    /// The longest output that waits for a client to fetch it, in bytes.
    pub longest_output: usize,
}

impl ServerStepper {
    /// As [`super::serve`], but without a thread.
    ///
    /// # Errors
    /// [`ServeError`] when a group is unknown or the system gives no descriptor.
    pub fn new(options: &ServeOptions, listener: Listener, backend: Backend) -> Result<Self, ServeError> {
        let never = EventFd::from_value_and_flags(0, EfdFlags::EFD_CLOEXEC).map_err(io::Error::from)?;
        Ok(Self { service: Service::new(options, listener, backend)?, never })
    }

    /// Takes in a connection of `peer`, as if the listener had accepted it.
    ///
    /// # Errors
    /// When the stream cannot be made non-blocking.
    pub fn enter(&mut self, stream: UnixStream, peer: Peer, role: Role, now: Instant) -> io::Result<()> {
        stream.set_nonblocking(true)?;
        let (admission, clients, holds, audit) = self.service.entrance();
        admission.admit(Client::new(stream, peer, role, now), clients, holds, audit, now);
        Ok(())
    }

    /// Does all work that is due at `now`, which must not lie before the last round's `now`. Does not wait.
    ///
    /// # Errors
    /// The error of `poll`.
    pub fn round(&mut self, now: Instant) -> nix::Result<()> {
        let ready = self.service.wait(&self.never, Duration::ZERO)?;
        self.service.round(ready, now);
        Ok(())
    }

    /// Whether a call waits for the board.
    #[must_use]
    pub fn waits_for_board(&self) -> bool {
        self.service.clients.iter().any(|(_, client)| client.waits_for_board())
    }

    /// When the server stops the first held jog, or ends the first sequence, unless its client renews it.
    #[must_use]
    pub fn first_hold_end(&self) -> Option<Instant> {
        let Service { ledger, sequences, clients, .. } = &self.service;
        let held = ledger.first_end(|client| clients.get(client).is_some());
        held.into_iter().chain(sequences.first_lapse()).min()
    }

    /// The counts of the server's state now.
    #[must_use]
    pub fn kept(&self) -> ServerStats {
        let Service { clients, calls, ledger, sequences, stops, watches, .. } = &self.service;
        ServerStats {
            clients: clients.count(),
            calls: clients.iter().filter(|(_, client)| client.waits_for_board()).count(),
            tickets: calls.count(),
            sequences: sequences.count(),
            stops: stops.count(),
            holds: ledger.holds(),
            turns: calls.commands(),
            watched: watches.watched(),
            longest_output: clients.iter().map(|(_, client)| client.unsent()).max().unwrap_or(0),
        }
    }

    /// Begins to stop: stops held jogs, and ends every sequence. [`Self::end`] may follow once [`Self::is_ending`]
    /// tells that none is left.
    pub fn begin_end(&mut self, now: Instant) {
        self.service.begin_end(now);
    }

    /// Whether the end that was `begun` goes on.
    #[must_use]
    pub fn is_ending(&mut self, begun: Instant, now: Instant) -> bool {
        self.service.time_left(begun, now).is_some()
    }

    /// Stops: answers every client that waits. Returns the motors of held jogs that may still move.
    pub fn end(mut self, now: Instant) -> Motors {
        self.service.end(now)
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};
    use std::time::Duration;

    use nix::unistd::{Gid, Uid};

    use super::*;
    use crate::daemon::shared::info::Info;
    use crate::daemon::shared::job::Job;
    use crate::daemon::shared::queue::{Command, Event, Outcome, Text, Ticket, at_once, queue};
    use crate::daemon::shared::status::{BoardStatus, MotorsStatus};
    use crate::device::Trace;
    use crate::function::line_port::ResponseText;
    use crate::map::Motors;
    use crate::map::{PMAC, TURBO2};
    use crate::protocol::function::Functions;
    use crate::protocol::{BoardInfo, BoardSettings, Enabled};

    /// More rounds than any user's share of processor time makes of one flood: the share is measured in real time, so
    /// that a busy machine serves fewer clients a round.
    const ROUNDS: usize = 200;

    /// Does rounds at one moment until the server has served every client.
    fn settle(server: &mut ServerStepper, now: Instant) {
        for _ in 0..ROUNDS {
            server.round(now).unwrap();
        }
    }

    /// A client that has made one call.
    fn client(server: &mut ServerStepper, call: &str, now: Instant) -> UnixStream {
        let (ours, theirs) = UnixStream::pair().unwrap();
        let peer = Peer { uid: Uid::from_raw(1), gid: Gid::from_raw(1), pid: 1 };
        server.enter(theirs, peer, Role::Engineer, now).unwrap();
        (&ours).write_all(call.as_bytes()).and_then(|()| (&ours).write_all(&[0])).unwrap();
        ours
    }

    #[test]
    fn a_jog_that_waits_is_not_sent_when_its_hold_is_over() {
        let directory = tempfile::tempdir().unwrap();
        let options = ServeOptions::new(directory.path().join("socket"));
        let (commands, taken) = queue(at_once::ALL).unwrap();
        let (answers, events) = queue(at_once::ALL).unwrap();
        let info = Info::new(&PMAC, BoardInfo::default(), BoardSettings::default());
        let backend = Backend { commands, events, info, trace: Trace::new(0) };
        let mut server = ServerStepper::new(&options, options.listen().unwrap(), backend).unwrap();
        let now = Instant::now();
        let jog = |method: &str, motor: u8, oneway: bool| {
            format!(
                r#"{{"method":"io.github.pmac-dpram.Board.{method}","parameters":{{"action":"jog+","numbers":[{motor}]}},"oneway":{oneway}}}"#
            )
        };
        let mut others = Vec::new();
        for _ in 0..at_once::PANEL {
            others.push(client(&mut server, &jog("Panel", 2, false), now));
        }
        settle(&mut server, now);
        let mut tickets = Vec::new();
        while let Some(Command::Job { ticket, .. }) = taken.try_receive() {
            tickets.push(ticket);
        }
        assert_eq!(tickets.len(), at_once::PANEL, "there is room for no other");
        let mut holder = client(&mut server, &jog("PanelHold", 1, false), now);
        // A hold that no client would have to renew.
        others.push(client(&mut server, &jog("PanelHold", 1, true), now));
        settle(&mut server, now);
        assert_eq!(server.kept().holds, 1);
        let open = BoardStatus {
            motors: MotorsStatus { open_loops: Motors::of(1), ..MotorsStatus::default() },
            ..BoardStatus::default()
        };
        assert!(answers.try_send(Event::Info(open)).is_ok());
        settle(&mut server, now);
        let mut reply = [0; 512];
        let length = holder.read(&mut reply).unwrap();
        let reply = String::from_utf8_lossy(&reply[..length]);
        assert!(reply.contains("motor 1 is open") && reply.contains("the jog was not sent"), "{reply}");
        for ticket in tickets {
            assert!(answers.try_send(Event::Done(ticket, Outcome::Done)).is_ok());
        }
        settle(&mut server, now);
        let Some(Command::Job { job, .. }) = taken.try_receive() else { panic!("there is no stop") };
        assert_eq!(*job, Job::EndHold(Motors::of(1)));
        assert!(taken.try_receive().is_none(), "no jog follows its stop");
    }

    #[test]
    fn a_motor_that_somebody_begins_to_hold_meanwhile_is_not_jogged() {
        let directory = tempfile::tempdir().unwrap();
        let options = ServeOptions::new(directory.path().join("socket"));
        let (commands, taken) = queue(at_once::ALL).unwrap();
        let (answers, events) = queue(at_once::ALL).unwrap();
        let info = Info::new(&PMAC, BoardInfo::default(), BoardSettings::default());
        let backend = Backend { commands, events, info, trace: Trace::new(0) };
        let mut server = ServerStepper::new(&options, options.listen().unwrap(), backend).unwrap();
        let now = Instant::now();
        let call = |method: &str, parameters: &str| {
            format!(r#"{{"method":"io.github.pmac-dpram.Board.{method}","parameters":{parameters}}}"#)
        };
        let jog = |motor| call("JogTo", &format!(r#"{{"motor":{motor},"position":500}}"#));
        // Each jog has asked the board which motor is addressed. Another client holds the first jog's motor before the
        // answer comes.
        let mut first = client(&mut server, &jog(1), now);
        let _second = client(&mut server, &jog(2), now);
        settle(&mut server, now);
        let _holder = client(&mut server, &call("PanelHold", r#"{"action":"jog+","numbers":[1]}"#), now);
        settle(&mut server, now);
        let mut sent = Vec::new();
        while let Some(command) = taken.try_receive() {
            if let Command::Send { ticket, line, .. } = command {
                sent.push(line.to_string());
                assert!(answers.try_send(Event::Line(ticket, ResponseText::cut(b"3"))).is_ok());
                assert!(answers.try_send(Event::Done(ticket, Outcome::Done)).is_ok());
                settle(&mut server, now);
            }
        }
        assert_eq!(sent, ["#", "#", "#2J=500#3"]);
        let mut reply = [0; 512];
        let length = first.read(&mut reply).unwrap();
        let reply = String::from_utf8_lossy(&reply[..length]);
        assert!(reply.contains("holds a jog of motor 1; nothing was sent"), "{reply}");
    }

    #[test]
    fn what_is_done_is_told_as_done_when_the_question_about_it_has_no_answer() {
        let directory = tempfile::tempdir().unwrap();
        let options = ServeOptions::new(directory.path().join("socket"));
        let (commands, taken) = queue(at_once::ALL).unwrap();
        let (answers, events) = queue(at_once::ALL).unwrap();
        let info = Info::new(&PMAC, BoardInfo::default(), BoardSettings::default());
        let backend = Backend { commands, events, info, trace: Trace::new(0) };
        let mut server = ServerStepper::new(&options, options.listen().unwrap(), backend).unwrap();
        let mut now = Instant::now();
        let answering = BoardStatus { enabled: Enabled::ASCII, ..BoardStatus::default() };
        assert!(answers.try_send(Event::Info(answering)).is_ok());
        let call = r#"{"method":"io.github.pmac-dpram.Board.FeedOverride","parameters":{"coordinate_system":1,"raw":0}}"#;
        for outcome in [Some(Outcome::Dropped(Text::of(&"^A"))), Some(Outcome::Busy), None] {
            let mut client = client(&mut server, call, now);
            settle(&mut server, now);
            let Some(Command::Job { ticket, .. }) = taken.try_receive() else { panic!("no override") };
            assert!(answers.try_send(Event::Done(ticket, Outcome::Done)).is_ok());
            settle(&mut server, now);
            let Some(Command::Send { ticket, .. }) = taken.try_receive() else { panic!("no question") };
            match outcome {
                Some(outcome) => assert!(answers.try_send(Event::Done(ticket, outcome)).is_ok()),
                None => now += Duration::from_secs(10),
            }
            settle(&mut server, now);
            let mut reply = [0; 1024];
            let length = client.read(&mut reply).unwrap();
            let reply = String::from_utf8_lossy(&reply[..length]);
            assert!(reply.contains("could not be asked") && !reply.contains("error"), "{reply}");
        }
    }

    #[test]
    fn an_abort_does_not_wait_for_a_flood_of_observers() {
        let directory = tempfile::tempdir().unwrap();
        let options = ServeOptions::new(directory.path().join("socket"));
        let (commands, taken) = queue(at_once::ALL).unwrap();
        let (_answers, events) = queue(at_once::ALL).unwrap();
        let info = Info::new(&PMAC, BoardInfo::default(), BoardSettings::default());
        let backend = Backend { commands, events, info, trace: Trace::new(0) };
        let mut server = ServerStepper::new(&options, options.listen().unwrap(), backend).unwrap();
        let now = Instant::now();
        let enter = |server: &mut ServerStepper, user, role, calls: &[&str]| {
            let (ours, theirs) = UnixStream::pair().unwrap();
            let peer = Peer { uid: Uid::from_raw(user), gid: Gid::from_raw(1), pid: 1 };
            server.enter(theirs, peer, role, now).unwrap();
            for call in calls {
                (&ours).write_all(call.as_bytes()).and_then(|()| (&ours).write_all(&[0])).unwrap();
            }
            ours
        };
        let costly = r#"{"method":"org.varlink.service.GetInterfaceDescription","parameters":{"interface":"io.github.pmac-dpram.Board"}}"#;
        let mut clients = Vec::new();
        for user in 1..=60 {
            clients.push(enter(&mut server, user, Role::Observe, &[costly; 16]));
        }
        let abort = r#"{"method":"io.github.pmac-dpram.Board.SendControl","parameters":{"character":"^A"}}"#;
        clients.push(enter(&mut server, 99, Role::Stop, &[abort]));
        server.round(now).unwrap();
        let first = taken.try_receive();
        assert!(
            matches!(first, Some(Command::Control { character: 1, .. })),
            "in the first round: {first:?}"
        );
        // The others have their turn all the same.
        let mut answered = 0;
        for _ in 0..20 * ROUNDS {
            server.round(now).unwrap();
            for client in &clients[..60] {
                client.set_nonblocking(true).unwrap();
                let mut chunk = [0; 65536];
                while let Ok(count @ 1..) = (&*client).read(&mut chunk) {
                    answered += chunk[..count].iter().filter(|byte| **byte == 0).count();
                }
            }
            if answered == 60 * 16 {
                return;
            }
        }
        panic!("only {answered} calls were answered");
    }

    #[test]
    fn who_may_stop_may_stop_one_motor_where_there_is_no_panel() {
        let directory = tempfile::tempdir().unwrap();
        let options = ServeOptions::new(directory.path().join("socket"));
        let (commands, taken) = queue(at_once::ALL).unwrap();
        let (answers, events) = queue(at_once::ALL).unwrap();
        let functions = Functions::all(&TURBO2);
        let settings = BoardSettings { functions, ..BoardSettings::default() };
        let backend = Backend {
            commands,
            events,
            info: Info::new(&TURBO2, BoardInfo::default(), settings),
            trace: Trace::new(0),
        };
        let mut server = ServerStepper::new(&options, options.listen().unwrap(), backend).unwrap();
        let now = Instant::now();
        for (action, numbers, sent, replied) in [
            ("jog-stop", "[2,32]", &["#?#2?#32?", "#2J/#32J/#5"][..], "\"parameters\":{}"),
            ("stop", "[16]", &["&", "&16A&5"], "\"parameters\":{}"),
            ("hold", "[1]", &["&", "&1H&5"], "\"parameters\":{}"),
            ("jog-stop", "[33]", &[], "1 to 32, not 33"),
            ("jog+", "[1]", &[], "does not use the function `panel`"),
        ] {
            let (ours, theirs) = UnixStream::pair().unwrap();
            let peer = Peer { uid: Uid::from_raw(7), gid: Gid::from_raw(1), pid: 1 };
            server.enter(theirs, peer, Role::Stop, now).unwrap();
            let call = format!(
                r#"{{"method":"io.github.pmac-dpram.Board.Panel","parameters":{{"action":"{action}","numbers":{numbers}}}}}"#
            );
            (&ours).write_all(call.as_bytes()).and_then(|()| (&ours).write_all(&[0])).unwrap();
            settle(&mut server, now);
            let mut lines = Vec::new();
            while let Some(command) = taken.try_receive() {
                let Command::First { ticket, line, .. } = command else { panic!("{command:?}") };
                lines.push(line.to_string());
                assert!(answers.try_send(Event::Line(ticket, ResponseText::cut(b"5"))).is_ok());
                assert!(answers.try_send(Event::Done(ticket, Outcome::Done)).is_ok());
                settle(&mut server, now);
            }
            assert_eq!(lines, sent, "{action}");
            let mut reply = [0; 1024];
            let length = (&ours).read(&mut reply).unwrap();
            let reply = String::from_utf8_lossy(&reply[..length]);
            assert!(reply.contains(replied), "{action}: {reply}");
        }
    }

    #[test]
    fn the_bus_thread_never_has_more_than_it_has_room_for() {
        let directory = tempfile::tempdir().unwrap();
        let options = ServeOptions::new(directory.path().join("socket"));
        let (commands, taken) = queue(at_once::ALL).unwrap();
        let (answers, events) = queue(8).unwrap();
        let info = Info::new(&PMAC, BoardInfo::default(), BoardSettings::default());
        let backend = Backend { commands, events, info, trace: Trace::new(0) };
        let mut server = ServerStepper::new(&options, options.listen().unwrap(), backend).unwrap();
        let mut now = Instant::now();
        let mut clients = Vec::new();
        let mut held = Vec::new();
        // Twice a flood of lines, and a bus thread that answers none of the first in time.
        for _ in 0..2 {
            for _ in 0..2 * at_once::LINES {
                let call = r#"{"method":"io.github.pmac-dpram.Board.Send","parameters":{"line":"P1","timeout_ms":1}}"#;
                clients.push(client(&mut server, call, now));
            }
            settle(&mut server, now);
            while let Some(command) = taken.try_receive() {
                let Command::Send { ticket, .. } = command else { panic!("{command:?}") };
                held.push(ticket);
            }
            assert_eq!(held.len(), at_once::LINES);
            now += Duration::from_secs(10);
            settle(&mut server, now);
            assert_eq!(
                server.kept().calls,
                0,
                "all have been told that it is late, or that their turn did not come"
            );
        }
        let first: Ticket = held[0];
        assert_eq!(answers.try_send(Event::Done(first, Outcome::TimedOut)).ok(), Some(()));
        server.round(now).unwrap();
        assert_eq!(server.kept().turns, at_once::LINES - 1);
    }
}
