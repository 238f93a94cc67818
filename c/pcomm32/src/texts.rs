//! Texts that the board's programs send: fetched by the program, or told to its callback from a thread of this library.

use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

use pmac_dpram::client::Messages;
use pmac_dpram::map::Controller;
use pmac_dpram::protocol::Message;

use crate::ascii::text;
use crate::device::{Device, lock, this_thread};
use crate::fault::Fault;
use crate::process::{spawn, with};
use crate::variables::family;

/// How often the thread looks whether the program wants no more texts.
const LOOK: Duration = Duration::from_millis(200);
/// How long the end waits for a callback that runs.
const CALLBACK: Duration = Duration::from_secs(1);

/// The texts that the program fetches.
pub(crate) struct Texts {
    stream: Messages,
    next: Option<Message>,
}

impl Texts {
    /// Looks for the next text, without waiting.
    fn look(&mut self) -> Result<Option<&Message>, Fault> {
        if self.next.is_none() {
            self.next = self.stream.next_within(Duration::ZERO)?;
        }
        Ok(self.next.as_ref())
    }
}

fn with_texts<T>(number: u32, work: impl FnOnce(&mut Texts) -> Result<T, Fault>) -> Result<T, Fault> {
    with(number, |device| {
        let mut texts = lock(&device.texts);
        // The texts before the first look are lost.
        let open = match texts.take() {
            Some(open) if !open.stream.ended() => open,
            _ => Texts { stream: device.connect()?.messages()?, next: None },
        };
        work(texts.insert(open))
    })
}

/// Whether a text waits.
pub(crate) fn is_ready(number: u32) -> Result<bool, Fault> {
    with_texts(number, |texts| Ok(texts.look()?.is_some()))
}

/// The next text, if one waits.
pub(crate) fn next(number: u32) -> Result<Vec<u8>, Fault> {
    with_texts(number, |texts| {
        texts.look()?;
        let message = texts.next.take().ok_or_else(|| Fault::refused("no text waits"))?;
        Ok(text(&[message.text]))
    })
}

/// A thread that calls the program back.
pub(crate) struct Interrupt {
    state: Arc<(Mutex<State>, Condvar)>,
}

#[derive(Default)]
struct State {
    is_over: bool,
    /// The thread, while the program's callback runs.
    calls: Option<usize>,
}

impl Interrupt {
    /// Ends the callbacks: waits until none runs, but not for itself or for a callback that hangs.
    fn end(&self) {
        let (state, changed) = &*self.state;
        let deadline = Instant::now() + CALLBACK;
        let mut state = lock(state);
        state.is_over = true;
        while state.calls.is_some_and(|caller| caller != this_thread()) {
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return;
            }
            state = changed.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

impl Drop for Interrupt {
    fn drop(&mut self) {
        self.end();
    }
}

/// Calls `told` from a thread with each text, if `mask` has the interrupt of the DPRAM's replies: a bit of 0 switches an
/// interrupt on.
pub(crate) fn call_back(number: u32, mask: u32, told: impl Fn(&[u8]) + Send + 'static) -> Result<(), Fault> {
    with(number, |device| {
        let line = ascii_line(family(device)?.host_port);
        if mask >> line & 1 != 0 {
            let why =
                format!("mask {mask:#X}: on Linux only the interrupt of texts (IR{line}) reaches a program");
            return Err(Fault::argument(why));
        }
        let mut stream = device.connect()?.messages()?;
        let state = Arc::<(Mutex<State>, Condvar)>::default();
        let interrupt = Interrupt { state: Arc::clone(&state) };
        let run = move || {
            while !lock(&state.0).is_over && !stream.ended() {
                // The stream has ended after an error.
                let Ok(Some(message)) = stream.next_within(LOOK) else { continue };
                if let Some(_calling) = Calling::begin(&state) {
                    told(&text(&[message.text]));
                }
            }
        };
        spawn("pcomm32-texts", run).map_err(|error| Fault::refused(error.to_string()))?;
        let before = lock(&device.interrupt).replace(interrupt);
        drop(before);
        Ok(())
    })
}

/// A callback that runs.
struct Calling<'a>(&'a (Mutex<State>, Condvar));

impl<'a> Calling<'a> {
    /// `None` when the program wants no more texts.
    fn begin(shared: &'a (Mutex<State>, Condvar)) -> Option<Self> {
        let mut state = lock(&shared.0);
        state.calls = (!state.is_over).then(this_thread);
        state.calls.map(|_| Self(shared))
    }
}

impl Drop for Calling<'_> {
    fn drop(&mut self) {
        lock(&self.0.0).calls = None;
        self.0.1.notify_all();
    }
}

/// Ends the callbacks.
pub(crate) fn no_call_back(number: u32) -> Result<(), Fault> {
    with(number, |device| {
        let interrupt = lock(&device.interrupt).take();
        interrupt.map(drop).ok_or_else(|| Fault::argument("no callback is set"))
    })
}

/// The interrupt that announces the DPRAM's replies: jumper E55 of a PMAC, a fixed one of a PMAC2.
const fn ascii_line(controller: Controller) -> u32 {
    match controller {
        Controller::Pic8259 => 7,
        Controller::Pmac2 => 5,
    }
}

/// Ends all that a device has with texts.
pub(crate) fn close(device: &Device) {
    let interrupt = lock(&device.interrupt).take();
    drop(interrupt);
    *lock(&device.texts) = None;
}
