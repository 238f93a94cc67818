//! One client and his running line. A board acknowledges a line at once, and takes control characters while the line
//! runs; so does the gateway.

use std::thread::{self, JoinHandle};
use std::time::Duration;

use pmac_dpram::protocol::control;

use crate::memory::written;
use crate::packet::{Packet, REPLY_MAX, Request};
use crate::session::{Answer, DONE, Port, Session};
use crate::window::{Reply, Window};

/// Stack of a line's thread, in bytes.
const STACK: usize = 256 * 1024;
/// How often the gateway looks whether a running line has ended.
const LOOK: Duration = Duration::from_millis(200);

/// The end of a line: the reply for the client's window, or why his connection ends.
type Done = Result<Option<Reply>, String>;

/// One client.
pub struct Client {
    /// `None` while a line runs: the line's thread has the session then.
    session: Option<Session>,
    work: Option<Work>,
    /// From the client's first memory request on.
    window: Option<Window>,
}

/// Whether `packet` is nothing but control characters for the board, sent at once. ^X does not go to the board.
fn is_control(packet: &Packet) -> bool {
    let goes =
        |byte: &u8| (1..32).contains(byte) && !matches!(*byte, b'\t' | b'\r' | b'\n' | control::CANCEL);
    match packet.request {
        Request::ControlResponse | Request::SendControl => packet.value != u16::from(control::CANCEL),
        Request::SendLine | Request::GetResponse => {
            let text = packet.data.split(|byte| *byte == 0).next().unwrap_or_default().trim_ascii_end();
            !text.is_empty() && text.iter().all(goes)
        }
        _ => false,
    }
}

/// A running line.
struct Work {
    /// `None` once the line has ended.
    thread: Option<JoinHandle<(Session, Done)>>,
    /// Carries out requests that do not wait for the line, over a connection of its own.
    beside: Session,
    /// The line came by the window.
    is_windows: bool,
    /// The client has dropped the line's reply.
    is_dropped: bool,
}

impl Work {
    /// Waits until the line has ended.
    fn end(&mut self) -> Result<(Session, Done), String> {
        let ended = self.thread.take().and_then(|thread| thread.join().ok());
        ended.ok_or_else(|| "the thread of his line has failed".to_owned())
    }
}

impl Drop for Work {
    /// A client keeps his place until his line has ended: so never more lines run than there are places.
    fn drop(&mut self) {
        if self.thread.is_some() {
            drop(self.end());
        }
    }
}

impl Client {
    /// The client of `session`.
    #[must_use]
    pub const fn new(session: Session) -> Self {
        Self { session: Some(session), work: None, window: None }
    }

    /// Answers `packet`.
    ///
    /// # Errors
    /// Why his connection ends.
    pub fn answer(&mut self, packet: &Packet) -> Answer {
        let followed = self.follow(false);
        match (followed, packet.request) {
            (Ok(()), _) => self.carry_out(packet),
            // A stop still goes to the board, although the connection ends for the line before it.
            (Err(why), _) if is_control(packet) => {
                self.current()?.answer(packet)?;
                Err(why)
            }
            (Err(why), Request::SetMem) => {
                self.put(packet)?;
                self.look_for_control()?;
                Err(why)
            }
            (Err(why), _) => Err(why),
        }
    }

    fn carry_out(&mut self, packet: &Packet) -> Answer {
        match (packet.request, &mut self.work) {
            (request, Some(work)) if is_control(packet) => {
                // `SendLine` leaves unfetched replies in place.
                work.is_dropped |= !work.is_windows && request != Request::SendLine;
                work.beside.answer(packet)
            }
            (Request::SendLine, _) => {
                let packet = packet.clone();
                self.begin(false, move |session| session.answer(&packet).map(|_| None))?;
                Ok(vec![DONE])
            }
            (Request::GetMem, _) => self.read(packet),
            (Request::SetMem | Request::SetBit | Request::SetBits, _) => self.write(packet),
            (Request::ReadReady, Some(_)) => Ok(vec![0, 0]),
            _ => {
                self.follow(true)?;
                self.current()?.answer(packet)
            }
        }
    }

    /// The session for requests that do not wait for the running line.
    fn current(&mut self) -> Result<&mut Session, String> {
        let beside = self.work.as_mut().map(|work| &mut work.beside);
        beside.or(self.session.as_mut()).ok_or_else(|| "his line has ended without its reply".to_owned())
    }

    /// Starts `line` after the running line has ended.
    fn begin(
        &mut self,
        is_windows: bool,
        line: impl FnOnce(&mut Session) -> Done + Send + 'static,
    ) -> Result<(), String> {
        self.follow(true)?;
        let beside = self.current()?.beside();
        let Some(mut session) = self.session.take() else { return Ok(()) };
        let run = move || {
            let done = line(&mut session);
            (session, done)
        };
        let thread = thread::Builder::new().name("line".to_owned()).stack_size(STACK).spawn(run);
        let thread = Some(thread.map_err(|error| format!("a thread for his line: {error}"))?);
        self.work = Some(Work { thread, beside, is_windows, is_dropped: false });
        Ok(())
    }

    /// Takes the reply of an ended line. If this `waits`, waits for a running line first.
    fn follow(&mut self, waits: bool) -> Result<(), String> {
        let has_ended = |work: &mut Work| waits || work.thread.as_ref().is_none_or(JoinHandle::is_finished);
        let Some(mut work) = self.work.take_if(has_ended) else { return Ok(()) };
        let (mut session, done) = work.end()?;
        if work.is_dropped && !work.is_windows {
            session.flush();
        }
        session.joins(&mut work.beside);
        self.session = Some(session);
        if let (Some(reply), Some(window), false) = (done?, &mut self.window, work.is_dropped) {
            window.respond(reply);
        }
        Ok(())
    }

    /// The client's window.
    fn window(&mut self) -> Result<&mut Window, String> {
        let window = match self.window.take() {
            Some(window) => window,
            None => Window::new(&self.current()?.family()?.ascii),
        };
        Ok(self.window.insert(window))
    }

    /// Does what the board does with the client's writes into the window.
    fn look(&mut self) -> Result<(), String> {
        self.look_for_control()?;
        if self.work.is_none()
            && let Some(line) = self.window()?.take_line()
        {
            self.begin(true, move |session| session.line_of_window(&line))?;
        }
        Ok(())
    }

    fn look_for_control(&mut self) -> Result<(), String> {
        let window = self.window()?;
        match window.take_control() {
            Some(control::CANCEL) => {
                window.cancel();
                if let Some(work) = self.work.as_mut().filter(|work| work.is_windows) {
                    work.is_dropped = true;
                }
            }
            Some(character) => {
                let lines = self.current()?.control(character)?;
                self.window()?.report(lines);
            }
            None => {}
        }
        Ok(())
    }

    /// Reads bytes of the DPRAM; the window's bytes come from the window.
    fn read(&mut self, packet: &Packet) -> Answer {
        let (first, count) = (u32::from(packet.value), u32::from(packet.length));
        if !(1..=REPLY_MAX).contains(&usize::from(packet.length)) {
            return self.current()?.answer(packet);
        }
        self.look()?;
        let window = self.window()?;
        // Only at a read: some clients clear the word of a response after each read, whether or not the response was
        // there.
        window.put();
        let own: Vec<Option<u8>> =
            (first..first + count).map(|offset| window.byte(offset).map(|byte| *byte)).collect();
        let mut bytes = Vec::with_capacity(own.len());
        // At most three parts: before the window, the window, behind the window.
        for part in own.chunk_by(|one, next| one.is_some() == next.is_some()) {
            match part.iter().copied().collect::<Option<Vec<u8>>>() {
                Some(own) => bytes.extend(own),
                None => {
                    let length = u16::try_from(part.len()).unwrap_or(u16::MAX);
                    let value = u16::try_from(first as usize + bytes.len()).unwrap_or(u16::MAX);
                    bytes.extend(self.current()?.answer(&Packet { value, length, ..packet.clone() })?);
                }
            }
        }
        Ok(bytes)
    }

    /// Writes bytes of the DPRAM; the window's bytes go into the window.
    fn write(&mut self, packet: &Packet) -> Answer {
        if !self.put(packet)? {
            return self.current()?.answer(packet);
        }
        self.look()?;
        Ok(vec![DONE])
    }

    /// Writes `packet` into the window, if all its bytes are the window's.
    fn put(&mut self, packet: &Packet) -> Result<bool, String> {
        let first = u32::from(packet.value);
        let bytes = written(packet).unwrap_or_default();
        let last = first + u32::try_from(bytes.len()).unwrap_or(u32::MAX);
        let window = self.window()?;
        if bytes.is_empty() || (first..last).any(|offset| window.byte(offset).is_none()) {
            return Ok(false);
        }
        for (offset, (value, mask)) in (first..).zip(bytes) {
            if let Some(byte) = window.byte(offset) {
                *byte = *byte & !mask | value & mask;
            }
        }
        Ok(true)
    }

    /// Whether a line runs.
    #[must_use]
    pub const fn is_at_work(&self) -> bool {
        self.work.is_some()
    }

    /// The time until the next [`Self::renew`]; `None`: never.
    #[must_use]
    pub fn renews_in(&self) -> Option<Duration> {
        self.session.as_ref().map_or(Some(LOOK), Session::renews_in)
    }

    /// Tells `pmacd` that the client is alive, and takes an ended line's reply.
    ///
    /// # Errors
    /// Why the client's connection ends.
    pub fn renew(&mut self) -> Result<(), String> {
        self.follow(false)?;
        if let Some(session) = &mut self.session {
            session.renew();
        }
        if self.window.is_some() { self.look() } else { Ok(()) }
    }

    /// After this silence the client makes room for another client; `None`: never while a line runs.
    #[must_use]
    pub fn gives_way(&self) -> Option<Duration> {
        self.session.as_ref().and_then(Session::gives_way)
    }

    /// The state to remember for the client's return.
    #[must_use]
    pub fn into_port(mut self) -> Port {
        drop(self.follow(true));
        self.session.map_or_else(Port::default, Session::into_port)
    }
}
