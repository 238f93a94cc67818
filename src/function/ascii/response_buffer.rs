//! The response buffer: its text is read, split into lines, and handed back.
//!
//! A text lies there until PMAC writes another one. An `<ACK>` may come over it "to mark the end of transmission" (DPRAM manual
//! p. 28, step 6), or with the last line of a reply: the control word is a "termination character" (p. 29). So the host
//! puts a NUL where the text begins before it hands the buffer back: a text that lies under the next control word is new.
//!
//! A text is one line. Some board may put several into the buffer, with `<CR>` between: that "response strings in DPRAM do not
//! end with a carriage-return" (p. 28) says nothing of what is inside.

use super::{AsciiEvent, DpramPort, ResponseText};
use crate::device::{Access, Bus, BusError};
use crate::map::functions::{RESPONSE_BYTES, response};

/// `<ACK>`, which the control word tells; some board may put it into the text, too.
const ACK: u8 = 0x06;

const fn is_between_lines(byte: u8) -> bool {
    matches!(byte, b'\r' | b'\n')
}

/// What was read of the reply under way and is not told yet.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Untold {
    /// Its lines.
    text: Option<ResponseText>,
    /// The reply ends behind them.
    end_follows: bool,
}

impl Untold {
    pub(super) const fn new(text: ResponseText, end_follows: bool) -> Self {
        Self { text: Some(text), end_follows }
    }

    /// Whether all is told.
    pub(super) const fn is_empty(&self) -> bool {
        self.text.is_none() && !self.end_follows
    }

    /// The next line, or the end of the reply.
    pub(super) fn next(&mut self) -> Option<AsciiEvent> {
        let Some(text) = self.text.take() else {
            return std::mem::take(&mut self.end_follows).then_some(AsciiEvent::Done(Ok(())));
        };
        let mut lines = text.as_bytes().splitn(2, |byte| is_between_lines(*byte));
        let first = lines.next().map_or(text, ResponseText::cut);
        self.text = lines.next().map(|rest| {
            let blank = rest.iter().take_while(|byte| is_between_lines(**byte)).count();
            ResponseText::cut(&rest[blank..])
        });
        Some(AsciiEvent::Line(first))
    }
}

impl DpramPort {
    /// Reads the text that goes with `control`; an error has none.
    pub(super) fn read_response(
        &mut self,
        bus: &mut impl Bus,
        control: u16,
    ) -> Result<ResponseText, BusError> {
        if control & response::ERROR != 0 {
            return Ok(ResponseText::default());
        }
        // The manual counts the characters once with their NUL and once without it (p. 28 and 29), so the count is not
        // believed: the text is read up to its NUL, which both pages have, and never beyond the buffer.
        let step = bus.access().words();
        let mut bytes = [0; RESPONSE_BYTES];
        for (index, place) in bytes.chunks_mut(2 * step).enumerate() {
            let mut words = [0; Access::MOST_WORDS];
            let words = &mut words[..step];
            bus.read_data(self.words.response.plus_words(index * step), words)?;
            for (pair, word) in place.chunks_exact_mut(2).zip(words.iter()) {
                pair.copy_from_slice(&self.order.unpack(*word));
            }
            if place.contains(&0) {
                break;
            }
        }
        let length = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
        let is_mark = |byte: &u8| is_between_lines(*byte) || *byte == ACK;
        let end = bytes[..length].iter().rposition(|byte| !is_mark(byte)).map_or(0, |last| last + 1);
        Ok(ResponseText::cut(&bytes[..end]))
    }

    /// Hands the buffer back to the board. An `<ACK>` alone has found the NUL of the text before.
    pub(super) fn take_response(
        &mut self,
        bus: &mut impl Bus,
        control: u16,
        text: &ResponseText,
    ) -> Result<(), BusError> {
        if control != response::ACKNOWLEDGE || !text.as_bytes().is_empty() {
            bus.write16(self.words.response, 0)?;
            bus.order_writes();
        }
        bus.write16(self.words.response_control, 0)?;
        bus.order_writes();
        Ok(())
    }
}
