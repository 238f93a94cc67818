//! One client's requests and their answers.

use std::net::IpAddr;
use std::time::Duration;

use log::info;
use pmac_dpram::format::Visible;
use pmac_dpram::language::password::without_password;
use pmac_dpram::map::Family;
use pmac_dpram::protocol::control;

use crate::addressed::{Addressed, Doubt};
use crate::board::{self, Board, Failure, Place};
use crate::journal::MOTION;
use crate::packet::{Packet, Request};
use crate::reply::{Handshake, Pending};
use crate::texts::Texts;
use crate::window::Reply;

/// The byte that confirms a request.
pub(crate) const DONE: u8 = b'@';
/// The refusal for a client that may only read.
pub(crate) const READ_ONLY: &str = "this gateway only reads (--read-only)";
/// The log's word for a refusal.
pub(crate) const REFUSAL: &str = "refused";
/// After this silence a client makes room for another: `SILENT`, or `SILENT_MOVER` if the client has moved something,
/// which may still move.
const SILENT: Duration = Duration::from_secs(60);
const SILENT_MOVER: Duration = Duration::from_secs(3600);

/// The rules for every client.
#[derive(Debug, Clone)]
pub struct Rules {
    /// The board's daemon.
    pub place: Place,
    /// Only questions go to the board.
    pub read_only: bool,
    /// A jog without an end goes on when its client is gone.
    pub keep_jogs: bool,
    /// The gateway's own answer to `VERSION`; `None`: the board's.
    pub version: Option<String>,
    /// The texts that the board's programs send.
    pub texts: Texts,
}

/// The answer to a client, or why his connection ends instead.
pub type Answer = Result<Vec<u8>, String>;

/// The state of a client's port, without unfetched replies.
#[derive(Debug, Clone, Copy, Default)]
pub struct Port {
    pub(crate) handshake: Handshake,
    /// The motor and the coordinate system that the client addressed last.
    pub(crate) addressed: Addressed,
    /// Another closed the client's program buffer, or `pmacd` closed it for the client's silence. Until the client
    /// sends a CLOSE or an OPEN, his lines may be meant for that buffer.
    pub(crate) has_lost_buffer: bool,
}

/// One client.
pub struct Session {
    peer: String,
    /// Whether the client is gone, as far as the gateway sees without reading his data.
    is_gone: Box<dyn Fn() -> bool + Send>,
    /// The address at which the client reached this program.
    own_address: Option<IpAddr>,
    pub(crate) rules: Rules,
    pub(crate) board: Board,
    pub(crate) port: Port,
    pub(crate) pending: Pending,
    /// The gateway may have forgotten what this client addressed: his lines must name the motor or system, until a line
    /// has.
    pub(crate) says_whom: bool,
    /// After a refused line, which of its addresses a line that moves or stops something must name again.
    pub(crate) doubt: Doubt,
    has_moved: bool,
    /// The number of the next program text for this client.
    next_text: u64,
    write_error: [u8; 4],
}

impl Session {
    /// The client at `peer`, not connected yet.
    #[must_use]
    pub fn new(peer: String, rules: Rules) -> Self {
        let board = Board::new(rules.place.clone(), rules.keep_jogs);
        let next_text = rules.texts.end();
        Self {
            peer,
            is_gone: Box::new(|| false),
            own_address: None,
            rules,
            board,
            port: Port::default(),
            pending: Pending::default(),
            says_whom: false,
            doubt: Doubt::default(),
            has_moved: false,
            next_text,
            write_error: [0; 4],
        }
    }

    /// The same client; `is_gone` tells whether the client is gone.
    #[must_use]
    pub fn watching(self, is_gone: impl Fn() -> bool + Send + 'static) -> Self {
        Self { is_gone: Box::new(is_gone), ..self }
    }

    /// The same client, who reached this program at `own_address`.
    #[must_use]
    pub fn reached_at(self, own_address: Option<IpAddr>) -> Self {
        Self { own_address, ..self }
    }

    /// Ends a request of a client that is gone while motors jog for him: a request may have hundreds of lines.
    ///
    /// # Errors
    /// [`Failure::Gone`]: the client's jogs end with his connection.
    pub(crate) fn look_after_jogs(&self) -> Result<(), Failure> {
        if self.board.has_jogs() && (self.is_gone)() {
            return Err(Failure::Gone("he is gone, and a motor jogged for him".to_owned()));
        }
        Ok(())
    }

    /// The client at `peer`, with the remembered `port` if he was here before. A forgotten client does not learn that
    /// he was forgotten.
    #[must_use]
    pub fn again(peer: String, rules: Rules, port: Option<Port>) -> Self {
        Self { port: port.unwrap_or_default(), says_whom: true, ..Self::new(peer, rules) }
    }

    /// The state to remember for the client's return.
    #[must_use]
    pub fn into_port(self) -> Port {
        Port { has_lost_buffer: self.port.has_lost_buffer || self.board.is_in_buffer(), ..self.port }
    }

    /// After this silence the client makes room for another client; `None`: never while the client has a program buffer
    /// open.
    #[must_use]
    pub fn gives_way(&self) -> Option<Duration> {
        let silent = if self.has_moved { SILENT_MOVER } else { SILENT };
        (!self.board.is_in_buffer()).then_some(silent)
    }

    /// The time until the next [`Self::renew`]; `None`: never.
    #[must_use]
    pub fn renews_in(&self) -> Option<Duration> {
        self.board.renews_in()
    }

    /// Tells `pmacd` that the client is alive.
    pub fn renew(&mut self) {
        if let Err(Failure::Refused { why: Some(why), .. }) = self.board.renew() {
            self.port.has_lost_buffer = true;
            self.tell("lost", &why);
        }
    }

    /// Answers `packet`.
    pub fn answer(&mut self, packet: &Packet) -> Answer {
        let Packet { request, upload, value, .. } = *packet;
        let was_in_buffer = self.board.is_in_buffer();
        let answer = match request {
            Request::SendLine => self.text(&packet.data).map(|()| vec![DONE]),
            Request::GetResponse => {
                self.flush();
                self.text(&packet.data).map(|()| self.pending.take())
            }
            Request::GetBuffer => {
                self.look_for_text();
                Ok(self.pending.take())
            }
            Request::GetLine => {
                self.look_for_text();
                Ok(self.pending.take_line())
            }
            Request::ReadReady => {
                self.look_for_text();
                Ok(vec![u8::from(!self.pending.is_empty()), 0])
            }
            // ^X would end any client's running line on the board. Here each client has a port of his own.
            Request::Flush => {
                self.flush();
                Ok(vec![DONE])
            }
            Request::ControlResponse => self.control_response(value),
            Request::SendControl => self.control_response(value).map(|_| vec![DONE]),
            Request::WriteBuffer => self.write_buffer(&packet.data),
            Request::WriteError => Ok(self.write_error.to_vec()),
            Request::GetMem | Request::SetMem | Request::SetBit | Request::SetBits => self.memory(packet),
            Request::IpAddress if upload => self.ip_address(),
            Request::Port | Request::FirmwareDownload | Request::IpAddress => {
                Err(Failure::Gone(format!("{request:?} is always refused")))
            }
        };
        match answer {
            // The answers to other requests have no room for an error: the client would take the error for data.
            Err(Failure::Refused { code, lines, why, .. })
                if matches!(request, Request::GetResponse | Request::ControlResponse) =>
            {
                self.refused(code, &lines, why.as_deref());
                Ok(self.pending.take())
            }
            answer => answer.map_err(|failure| {
                self.port.has_lost_buffer |= was_in_buffer;
                failure.into()
            }),
        }
    }

    /// Carries out a line of the client's window; `None` where the board need not answer it.
    ///
    /// # Errors
    /// Why the client's connection ends.
    pub(crate) fn line_of_window(&mut self, text: &[u8]) -> Result<Option<Reply>, String> {
        let was_in_buffer = self.board.is_in_buffer();
        // Keeps the unfetched replies of other lines apart.
        let others = std::mem::take(&mut self.pending);
        let mut parts = text.trim_ascii_end().split(|byte| matches!(byte, b'\r' | b'\n'));
        let done = parts.try_for_each(|part| self.one_text(part));
        let mut lines = std::mem::replace(&mut self.pending, others).into_lines();
        match done {
            Ok(()) => Ok(Some(Reply { lines, error: None })),
            Err(Failure::Refused { code, lines: more, why, .. }) => {
                if let Some(why) = why {
                    self.tell(REFUSAL, &why);
                }
                lines.extend(more.into_iter().map(String::into_bytes));
                Ok(Some(Reply { lines, error: Some(code) }))
            }
            Err(Failure::Unanswered(why)) => {
                self.tell("no answer", &why);
                Ok(None)
            }
            Err(Failure::Gone(why)) => {
                self.port.has_lost_buffer |= was_in_buffer;
                Err(why)
            }
        }
    }

    /// The address at which the client reached this program.
    fn ip_address(&self) -> Result<Vec<u8>, Failure> {
        match self.own_address.map(|address| address.to_canonical()) {
            Some(IpAddr::V4(address)) => Ok(address.octets().to_vec()),
            other => Err(Failure::Gone(format!("his way here has no address of four bytes ({other:?})"))),
        }
    }

    /// The same client with a connection to `pmacd` of its own, for requests that do not wait for the running line.
    pub(crate) fn beside(&self) -> Self {
        let beside = Self::new(self.peer.clone(), self.rules.clone());
        Self { port: self.port, says_whom: self.says_whom, ..beside }
    }

    /// Takes over what the client did `beside`: its replies follow his own.
    pub(crate) fn joins(&mut self, beside: &mut Self) {
        self.has_moved |= beside.has_moved;
        self.pending.append(std::mem::take(&mut beside.pending));
    }

    /// The board's family.
    pub(crate) fn family(&mut self) -> Result<&'static Family, Failure> {
        self.board.family()
    }

    /// Drops the unfetched replies and program texts.
    pub(crate) fn flush(&mut self) {
        self.pending.clear();
        self.next_text = self.rules.texts.end();
    }

    /// If no reply waits, puts one program text there. Only one at a time, so the unfetched bytes stay bounded.
    fn look_for_text(&mut self) {
        if !self.pending.is_empty() {
            return;
        }
        let Some((number, text)) = self.rules.texts.next(self.next_text) else { return };
        let lost = number - self.next_text;
        if lost > 0 {
            self.tell(
                "lost",
                &format!("{lost} texts of the board's programs, which he did not fetch in time"),
            );
        }
        self.next_text = number.saturating_add(1);
        self.pending.text(text, self.port.handshake);
    }

    /// Adds a refusal to the client's replies.
    pub(crate) fn refused(&mut self, code: u16, lines: &[String], why: Option<&str>) {
        self.pending.lines(lines, self.port.handshake);
        self.pending.error(code, self.port.handshake);
        if let Some(why) = why {
            self.tell(REFUSAL, why);
        }
    }

    /// Logs an event (`refused` or another word) and its reason.
    pub(crate) fn tell(&self, what: &str, why: &str) {
        info!("{}: {what}: {}", self.peer, Visible(why));
    }

    /// Logs a line that moves or stops something, unless nothing was sent.
    pub(crate) fn log_motion<T>(&mut self, line: &str, sent: &Result<T, Failure>) {
        if !matches!(sent, Err(Failure::Refused { is_sent: false, .. })) {
            self.has_moved = true;
            info!(target: MOTION, "{}: {}", self.peer, Visible(without_password(line)));
        }
    }

    /// Sends a control character and returns its reply, which is empty for most of them.
    pub(crate) fn control(&mut self, character: u8) -> Result<Vec<String>, Failure> {
        if character == control::CANCEL {
            self.flush();
            return Ok(Vec::new());
        }
        // These open and close the buffers for every client's lines.
        if matches!(character, control::OPEN_ROTARY | control::CLOSE_ROTARY) {
            let why = "a buffer is a client's own only if he opens it by a line, as OPEN ROT, and closes it by CLOSE";
            return Err(Failure::unsent(board::NOT_NOW, why));
        }
        let moves = !control::only_reports(character);
        if moves && self.rules.read_only {
            return Err(Failure::unsent(board::NO_RIGHT, READ_ONLY));
        }
        let sent = self.board.control(character);
        if moves {
            self.log_motion(&control::name(character), &sent);
        }
        sent
    }

    fn control_response(&mut self, value: u16) -> Result<Vec<u8>, Failure> {
        self.flush();
        let character = u8::try_from(value).ok().filter(|character| (1..=31).contains(character));
        let character = character
            .ok_or_else(|| Failure::unsent(board::ILLEGAL, "no control character has this number"))?;
        let lines = self.control(character)?;
        // "The resulting response data is not terminated."
        self.pending.lines(&lines, self.port.handshake);
        Ok(self.pending.take())
    }

    /// Sends lines until the board refuses a line. Answers four bytes: the line's number, low byte first; the error;
    /// $80 for an error.
    fn write_buffer(&mut self, data: &[u8]) -> Result<Vec<u8>, Failure> {
        const LONGEST: usize = 1024;
        const ERROR: u8 = 0x80;
        self.write_error = [0; 4];
        if data.len() > LONGEST {
            let [low, _] = board::NO_ROOM.to_le_bytes();
            self.write_error = [0, 0, low, ERROR];
            return Ok(self.write_error.to_vec());
        }
        let lines = data.split(|byte| *byte == 0).enumerate().filter(|(_, line)| !line.is_empty());
        for (index, line) in lines {
            let mut parts = line.split(|byte| matches!(byte, b'\r' | b'\n'));
            let code = match parts.try_for_each(|part| self.one_text(part)) {
                Ok(()) => continue,
                Err(Failure::Refused { code, why, .. }) => {
                    if let Some(why) = why {
                        self.tell(REFUSAL, &why);
                    }
                    code
                }
                Err(gone) => return Err(gone),
            };
            let [low, high] = u16::try_from(index + 1).unwrap_or(u16::MAX).to_le_bytes();
            self.write_error = [low, high, u8::try_from(code).unwrap_or(u8::MAX), ERROR];
            break;
        }
        // The client does not ask for the replies of these lines.
        self.pending.clear();
        Ok(self.write_error.to_vec())
    }
}
