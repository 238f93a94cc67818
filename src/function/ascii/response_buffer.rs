//! The response buffer: the port reads the text and hands the buffer back to the board.

use super::DpramPort;
use crate::device::{Access, Bus, BusError};
use crate::function::line_port::ResponseText;
use crate::map::functions::{RESPONSE_BYTES, response};

impl DpramPort {
    /// Reads the text that belongs to `control`; an error and an `<ACK>` have no text.
    pub(super) fn read_response(
        &mut self,
        bus: &mut dyn Bus,
        control: u16,
    ) -> Result<ResponseText, BusError> {
        if control & response::ERROR != 0 || control == response::ACKNOWLEDGE {
            return Ok(ResponseText::default());
        }
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
        Ok(ResponseText::cut(&bytes[..length]))
    }

    /// Hands the buffer back to the board.
    pub(super) fn take_response(&self, bus: &mut dyn Bus) -> Result<(), BusError> {
        bus.write16(self.words.response_control, 0)?;
        bus.order_writes();
        Ok(())
    }
}
