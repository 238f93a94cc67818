//! One client, with the line of his that is at work: a board acknowledges a line at once, and hears its control characters meanwhile.

use std::thread::{self, JoinHandle};
use std::time::Duration;

use pmac_dpram::protocol::control;

use crate::memory::written;
use crate::packet::{Packet, REPLY_MAX, Request};
use crate::session::{Answer, DONE, Port, Session};
use crate::window::{Reply, Window};

/// What a line's thread needs.
const STACK: usize = 256 * 1024;
/// How often a line at work is looked after.
const LOOK: Duration = Duration::from_millis(200);

/// What becomes of a line: what the client finds in his window, or why his connection ends.
type Done = Result<Option<Reply>, String>;

/// One client.
pub struct Client {
    /// `None` while a line is at work, which has it then.
    session: Option<Session>,
    work: Option<Work>,
    /// From his first request for memory on.
    window: Option<Window>,
}

/// Whether `packet` is a control character, alone, which goes to the board at once: all but ^X, which does not go there.
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

/// A line at work.
struct Work {
    /// `None` once its end is known.
    thread: Option<JoinHandle<(Session, Done)>>,
    /// Carries out what does not wait for the line, over a connection of its own.
    beside: Session,
    /// The line came by the window.
    is_windows: bool,
    /// The client does not want its reply any more.
    is_dropped: bool,
}

impl Work {
    /// Waits for the end of the line.
    fn end(&mut self) -> Result<(Session, Done), String> {
        let ended = self.thread.take().and_then(|thread| thread.join().ok());
        ended.ok_or_else(|| "the thread of his line has failed".to_owned())
    }
}

impl Drop for Work {
    /// A client has his place until his line has ended: so there are never more lines at work than places.
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

    /// What `packet` is answered.
    ///
    /// # Errors
    /// Why his connection ends.
    pub fn answer(&mut self, packet: &Packet) -> Answer {
        let followed = self.follow(false);
        match (followed, packet.request) {
            (Ok(()), _) => self.carry_out(packet),
            // A stop goes to the board, though the connection ends for the line before it.
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
                // What sends a line leaves what there is to be fetched.
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

    /// What carries out a request that does not wait for a line.
    fn current(&mut self) -> Result<&mut Session, String> {
        let beside = self.work.as_mut().map(|work| &mut work.beside);
        beside.or(self.session.as_mut()).ok_or_else(|| "his line has ended without its reply".to_owned())
    }

    /// Has `line` carried out, behind the one that is at work.
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

    /// Takes the reply of a line that has ended; of one at work, too, if this `waits` for it.
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

    /// His window.
    fn window(&mut self) -> Result<&mut Window, String> {
        let window = match self.window.take() {
            Some(window) => window,
            None => Window::new(&self.current()?.family()?.ascii),
        };
        Ok(self.window.insert(window))
    }

    /// What the board does with what the client has written into his window.
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

    /// Bytes of the DPRAM, those of the window from there.
    fn read(&mut self, packet: &Packet) -> Answer {
        let (first, count) = (u32::from(packet.value), u32::from(packet.length));
        if !(1..=REPLY_MAX).contains(&usize::from(packet.length)) {
            return self.current()?.answer(packet);
        }
        self.look()?;
        let window = self.window()?;
        // Only when he looks: some clear the word of a response after each look, whether it was there or not.
        window.put();
        let own: Vec<Option<u8>> =
            (first..first + count).map(|offset| window.byte(offset).map(|byte| *byte)).collect();
        let mut bytes = Vec::with_capacity(own.len());
        // None of it is the window's, or what stands before it, itself, and what stands behind it.
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

    /// Writes bytes of the DPRAM; those of the window go there.
    fn write(&mut self, packet: &Packet) -> Answer {
        if !self.put(packet)? {
            return self.current()?.answer(packet);
        }
        self.look()?;
        Ok(vec![DONE])
    }

    /// Writes bytes of the window, if `packet` has only such.
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

    /// Whether a line is at work.
    #[must_use]
    pub const fn is_at_work(&self) -> bool {
        self.work.is_some()
    }

    /// How soon [`Self::renew`] is to be called; never if `None`.
    #[must_use]
    pub fn renews_in(&self) -> Option<Duration> {
        self.session.as_ref().map_or(Some(LOOK), Session::renews_in)
    }

    /// Says that the client is still there.
    ///
    /// # Errors
    /// Why his connection ends.
    pub fn renew(&mut self) -> Result<(), String> {
        self.follow(false)?;
        if let Some(session) = &mut self.session {
            session.renew();
        }
        if self.window.is_some() { self.look() } else { Ok(()) }
    }

    /// After how long a silence he makes room for another client: never while a line is at work.
    #[must_use]
    pub fn gives_way(&self) -> Option<Duration> {
        self.session.as_ref().and_then(Session::gives_way)
    }

    /// What is to be remembered of him.
    #[must_use]
    pub fn into_port(mut self) -> Port {
        drop(self.follow(true));
        self.session.map_or_else(Port::default, Session::into_port)
    }
}
