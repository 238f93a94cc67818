//! One client: what he is answered to each request.

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

/// One byte that says: done.
pub(crate) const DONE: u8 = b'@';
/// What a client is told who may only look.
pub(crate) const READ_ONLY: &str = "this gateway only reads (--read-only)";
/// How the log calls what was not done.
pub(crate) const REFUSAL: &str = "refused";
/// After how long a silence a client makes room for another; and one who has moved something, which may still move.
const SILENT: Duration = Duration::from_secs(60);
const SILENT_MOVER: Duration = Duration::from_secs(3600);

/// What holds for every client.
#[derive(Debug, Clone)]
pub struct Rules {
    /// The board's daemon.
    pub place: Place,
    /// Nothing is sent but questions.
    pub read_only: bool,
    /// A jog without an end goes on when its client is gone.
    pub keep_jogs: bool,
    /// What `VERSION` is answered, if not by the board.
    pub version: Option<String>,
    /// What the board's programs send by themselves.
    pub texts: Texts,
}

/// What a client is answered, or why his connection ends instead.
pub type Answer = Result<Vec<u8>, String>;

/// What a client is on his port, besides what he has not fetched.
#[derive(Debug, Clone, Copy, Default)]
pub struct Port {
    pub(crate) handshake: Handshake,
    /// The motor and the coordinate system that he addressed last.
    pub(crate) addressed: Addressed,
    /// The program buffer that he had open was closed by another, or for his silence. What he sends may be meant for it until he
    /// closes it, or opens one.
    pub(crate) has_lost_buffer: bool,
}

/// One client.
pub struct Session {
    peer: String,
    /// Whether he is gone, as far as that can be seen without reading what he has sent.
    is_gone: Box<dyn Fn() -> bool + Send>,
    /// The address that he has for this program.
    own_address: Option<IpAddr>,
    pub(crate) rules: Rules,
    pub(crate) board: Board,
    pub(crate) port: Port,
    pub(crate) pending: Pending,
    /// What this client addressed before may have been forgotten: a line has to say whom it addresses, until one has.
    pub(crate) says_whom: bool,
    /// The same of what moves or stops something, behind a line that the board has refused, of what that line has addressed.
    pub(crate) doubt: Doubt,
    has_moved: bool,
    /// The number of the next text of the board's programs that he gets.
    next_text: u64,
    write_error: [u8; 4],
}

impl Session {
    /// The client at `peer`. Nothing is connected yet.
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

    /// Of the same client `is_gone` says whether he is.
    #[must_use]
    pub fn watching(self, is_gone: impl Fn() -> bool + Send + 'static) -> Self {
        Self { is_gone: Box::new(is_gone), ..self }
    }

    /// The same client, who has reached this program at `own_address`.
    #[must_use]
    pub fn reached_at(self, own_address: Option<IpAddr>) -> Self {
        Self { own_address, ..self }
    }

    /// Looks whether somebody is there, while motors jog for him: a request may have hundreds of lines.
    ///
    /// # Errors
    /// [`Failure::Gone`]: with the client's connection his jogs end.
    pub(crate) fn look_after_jogs(&self) -> Result<(), Failure> {
        if self.board.has_jogs() && (self.is_gone)() {
            return Err(Failure::Gone("he is gone, and a motor jogged for him".to_owned()));
        }
        Ok(())
    }

    /// The client at `peer`, of whom `port` was remembered, if he was here before. He does not hear it when he is forgotten.
    #[must_use]
    pub fn again(peer: String, rules: Rules, port: Option<Port>) -> Self {
        Self { port: port.unwrap_or_default(), says_whom: true, ..Self::new(peer, rules) }
    }

    /// What is to be remembered of him.
    #[must_use]
    pub fn into_port(self) -> Port {
        Port { has_lost_buffer: self.port.has_lost_buffer || self.board.is_in_buffer(), ..self.port }
    }

    /// After how long a silence he makes room for another client: never while he has a program buffer open.
    #[must_use]
    pub fn gives_way(&self) -> Option<Duration> {
        let silent = if self.has_moved { SILENT_MOVER } else { SILENT };
        (!self.board.is_in_buffer()).then_some(silent)
    }

    /// How soon [`Self::renew`] is to be called; never if `None`.
    #[must_use]
    pub fn renews_in(&self) -> Option<Duration> {
        self.board.renews_in()
    }

    /// Says that the client is still there.
    pub fn renew(&mut self) {
        if let Err(Failure::Refused { why: Some(why), .. }) = self.board.renew() {
            self.port.has_lost_buffer = true;
            self.tell("lost", &why);
        }
    }

    /// What `packet` is answered.
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
            // ^X would end the line that the board is at, whosever it is. Here each client has a port of his own.
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
            // The answers to other requests have no room for an error: the client would take it for what he has asked for.
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
    /// Why his connection ends.
    pub(crate) fn line_of_window(&mut self, text: &[u8]) -> Result<Option<Reply>, String> {
        let was_in_buffer = self.board.is_in_buffer();
        // What is to be fetched of other lines stays apart.
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

    /// The address at which the client has reached this program.
    fn ip_address(&self) -> Result<Vec<u8>, Failure> {
        match self.own_address.map(|address| address.to_canonical()) {
            Some(IpAddr::V4(address)) => Ok(address.octets().to_vec()),
            other => Err(Failure::Gone(format!("his way here has no address of four bytes ({other:?})"))),
        }
    }

    /// The same client with a connection to `pmacd` of its own, for what does not wait for the line that this one is at.
    pub(crate) fn beside(&self) -> Self {
        let beside = Self::new(self.peer.clone(), self.rules.clone());
        Self { port: self.port, says_whom: self.says_whom, ..beside }
    }

    /// What was done `beside` counts for this client, and its replies stand behind his.
    pub(crate) fn joins(&mut self, beside: &mut Self) {
        self.has_moved |= beside.has_moved;
        self.pending.append(std::mem::take(&mut beside.pending));
    }

    /// The board's family.
    pub(crate) fn family(&mut self) -> Result<&'static Family, Failure> {
        self.board.family()
    }

    /// Empties what there is to be fetched, texts of the board's programs, too.
    pub(crate) fn flush(&mut self) {
        self.pending.clear();
        self.next_text = self.rules.texts.end();
    }

    /// Where nothing else is there to be fetched, a text of the board's programs is. One at a time: what is not fetched stays bounded.
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

    /// Puts a refusal where the client fetches it.
    pub(crate) fn refused(&mut self, code: u16, lines: &[String], why: Option<&str>) {
        self.pending.lines(lines, self.port.handshake);
        self.pending.error(code, self.port.handshake);
        if let Some(why) = why {
            self.tell(REFUSAL, why);
        }
    }

    /// Logs that something was `refused`, or what else became of it, and why.
    pub(crate) fn tell(&self, what: &str, why: &str) {
        info!("{}: {what}: {}", self.peer, Visible(why));
    }

    /// Logs what moves or stops something, unless nothing of it was sent.
    pub(crate) fn log_motion<T>(&mut self, line: &str, sent: &Result<T, Failure>) {
        if !matches!(sent, Err(Failure::Refused { is_sent: false, .. })) {
            self.has_moved = true;
            info!(target: MOTION, "{}: {}", self.peer, Visible(without_password(line)));
        }
    }

    /// Sends a control character, and returns its reply; nothing for most of them.
    pub(crate) fn control(&mut self, character: u8) -> Result<Vec<String>, Failure> {
        if character == control::CANCEL {
            self.flush();
            return Ok(Vec::new());
        }
        // They open and close the buffers for whoever sends lines.
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

    /// Sends lines until one is refused. Four bytes: the number of the line, low byte first; the error; $80 if there is one.
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
        // What the lines have answered is not asked for.
        self.pending.clear();
        Ok(self.write_error.to_vec())
    }
}
