//! The DPRAM by bytes, under the daemon's rules: a client cannot write a function's words.

use crate::board::{self, Failure};
use crate::packet::{Packet, REPLY_MAX, Request};
use crate::session::{DONE, READ_ONLY, Session};

/// A long word of the DPRAM.
const LONG: usize = 4;

/// The bytes that `packet` writes, each with its value and the bits to change; `None` for data of another form.
pub(crate) fn written(packet: &Packet) -> Option<Vec<(u8, u8)>> {
    let data = packet.data.as_slice();
    match packet.request {
        Request::SetMem if (1..=REPLY_MAX).contains(&data.len()) => {
            Some(data.iter().map(|byte| (*byte, 0xFF)).collect())
        }
        // An OR with the mask sets bits, an AND with it clears the others.
        Request::SetBit if data.len() == LONG => match packet.index {
            1 => Some(data.iter().map(|mask| (0xFF, *mask)).collect()),
            0 => Some(data.iter().map(|mask| (0, !*mask)).collect()),
            _ => None,
        },
        Request::SetBits if data.len() == 2 * LONG => {
            let (set, clear) = data.split_at(LONG);
            let bits = set.iter().zip(clear);
            Some(bits.map(|(set, clear)| (*set, set | clear)).collect())
        }
        _ => None,
    }
}

impl Session {
    /// Carries out a memory request.
    pub(crate) fn memory(&mut self, packet: &Packet) -> Result<Vec<u8>, Failure> {
        if packet.request == Request::GetMem {
            return self.read(packet);
        }
        match written(packet) {
            _ if self.rules.read_only => Err(Failure::unsent(board::NO_RIGHT, READ_ONLY)),
            Some(bytes) => self.board.write(packet.value, &bytes).map(|()| vec![DONE]),
            None => Err(Failure::unsent(board::UNKNOWN, format!("{:?} has other data", packet.request))),
        }
    }

    fn read(&mut self, packet: &Packet) -> Result<Vec<u8>, Failure> {
        let count = usize::from(packet.length);
        if !(1..=REPLY_MAX).contains(&count) {
            return Err(Failure::Gone(format!("GetMem reads 1 to {REPLY_MAX} bytes, not {count}")));
        }
        self.board.read(packet.value, count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn packet(request: Request, index: u16, data: &[u8]) -> Packet {
        Packet { upload: true, request, value: 0, index, length: 4, data: data.to_vec() }
    }

    #[test]
    fn bits_are_set_and_cleared_as_the_masks_say() {
        let set = written(&packet(Request::SetBit, 1, &[1, 0, 0, 0x80])).unwrap();
        assert_eq!(set, [(0xFF, 1), (0xFF, 0), (0xFF, 0), (0xFF, 0x80)]);
        let clear = written(&packet(Request::SetBit, 0, &[0xFE, 0xFF, 0xFF, 0x7F])).unwrap();
        assert_eq!(clear, [(0, 1), (0, 0), (0, 0), (0, 0x80)]);
        let both = written(&packet(Request::SetBits, 0, &[1, 0, 0, 0, 2, 0, 0, 4])).unwrap();
        assert_eq!(both, [(1, 3), (0, 0), (0, 0), (0, 4)]);
        for (request, index, data) in [
            (Request::SetBit, 2, &[0; 4][..]),
            (Request::SetBit, 1, &[0; 3]),
            (Request::SetBits, 0, &[0; 4]),
            (Request::SetMem, 0, &[]),
            (Request::SetMem, 0, &[0; 1401]),
        ] {
            assert_eq!(written(&packet(request, index, data)), None, "{request:?}");
        }
    }
}
