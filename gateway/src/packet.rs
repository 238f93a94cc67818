//! Requests from the network: a header of 8 bytes with big-endian numbers, and data behind some of them.

/// Bytes of a header.
pub const HEADER: usize = 8;
/// Most bytes of data in a request.
pub const DATA_MAX: usize = 1492;
/// Most bytes of data in a reply.
pub const REPLY_MAX: usize = 1400;

const DOWNLOAD: u8 = 0x40;
const UPLOAD: u8 = 0xC0;

/// The kinds of request, with their numbers on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Request {
    /// Sends a line; the reply is one byte. The client fetches the line's reply by [`Self::GetBuffer`].
    SendLine = 0xB0,
    /// Fetches the next line of the waiting replies.
    GetLine = 0xB1,
    /// Drops the waiting replies.
    Flush = 0xB3,
    /// Reads bytes of the DPRAM.
    GetMem = 0xB4,
    /// Writes bytes of the DPRAM.
    SetMem = 0xB5,
    /// Sends a control character; the reply is one byte.
    SendControl = 0xB6,
    /// Sets or clears bits of a long word.
    SetBit = 0xBA,
    /// Sets and clears bits of a long word.
    SetBits = 0xBB,
    /// Reads or writes a byte of the host port.
    Port = 0xBE,
    /// Sends a line, and fetches its reply.
    GetResponse = 0xBF,
    /// Asks whether replies wait.
    ReadReady = 0xC2,
    /// Sends a control character, and fetches its reply.
    ControlResponse = 0xC4,
    /// Fetches the next waiting reply, or a part of it.
    GetBuffer = 0xC5,
    /// Sends several lines.
    WriteBuffer = 0xC6,
    /// Tells how the last [`Self::WriteBuffer`] ended.
    WriteError = 0xC7,
    /// Loads other firmware.
    FirmwareDownload = 0xCB,
    /// Reads or sets the port's address.
    IpAddress = 0xE0,
}

impl Request {
    const ALL: [Self; 17] = [
        Self::SendLine,
        Self::GetLine,
        Self::Flush,
        Self::GetMem,
        Self::SetMem,
        Self::SendControl,
        Self::SetBit,
        Self::SetBits,
        Self::Port,
        Self::GetResponse,
        Self::ReadReady,
        Self::ControlResponse,
        Self::GetBuffer,
        Self::WriteBuffer,
        Self::WriteError,
        Self::FirmwareDownload,
        Self::IpAddress,
    ];

    fn of(number: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|request| *request as u8 == number)
    }

    /// Whether data follow the header. In other requests the length is the number of bytes to read, or means nothing.
    fn has_data(self, upload: bool) -> bool {
        match self {
            Self::SendLine
            | Self::SetMem
            | Self::SetBit
            | Self::SetBits
            | Self::GetResponse
            | Self::WriteBuffer
            | Self::FirmwareDownload => true,
            Self::IpAddress => !upload,
            _ => false,
        }
    }
}

/// A whole request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Packet {
    /// The client wants data. Some clients set it in requests that write.
    pub upload: bool,
    /// The kind of request.
    pub request: Request,
    /// wValue.
    pub value: u16,
    /// wIndex.
    pub index: u16,
    /// wLength.
    pub length: u16,
    /// The bytes behind the header.
    pub data: Vec<u8>,
}

/// Bytes that are no request. The gateway cannot read on behind them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Malformed {
    /// The first byte names no direction.
    Direction(u8),
    /// The second byte names no known request.
    Request(u8),
    /// More data than a request can have.
    Length(u16),
}

impl std::fmt::Display for Malformed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Direction(byte) => write!(f, "a request begins with $40 or $C0, not with ${byte:02X}"),
            Self::Request(byte) => write!(f, "the request ${byte:02X} is not known"),
            Self::Length(length) => write!(f, "a request has at most {DATA_MAX} bytes of data, not {length}"),
        }
    }
}

impl Packet {
    /// The request at the start of `bytes`, and its number of bytes; `None` while its end is missing.
    ///
    /// # Errors
    /// [`Malformed`].
    pub fn take(bytes: &[u8]) -> Result<Option<(Self, usize)>, Malformed> {
        match bytes {
            [first, ..] if *first != DOWNLOAD && *first != UPLOAD => {
                return Err(Malformed::Direction(*first));
            }
            [_, second, ..] if Request::of(*second).is_none() => return Err(Malformed::Request(*second)),
            _ => {}
        }
        let Some((header, behind)) = bytes.split_first_chunk::<HEADER>() else { return Ok(None) };
        let [first, second, value_high, value_low, index_high, index_low, length_high, length_low] = *header;
        let Some(request) = Request::of(second) else { return Err(Malformed::Request(second)) };
        let upload = first == UPLOAD;
        let length = u16::from_be_bytes([length_high, length_low]);
        let count = if request.has_data(upload) { usize::from(length) } else { 0 };
        if count > DATA_MAX {
            return Err(Malformed::Length(length));
        }
        let Some(data) = behind.get(..count) else { return Ok(None) };
        let packet = Self {
            upload,
            request,
            value: u16::from_be_bytes([value_high, value_low]),
            index: u16::from_be_bytes([index_high, index_low]),
            length,
            data: data.to_vec(),
        };
        Ok(Some((packet, HEADER + count)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_request_is_read_whole_or_not_at_all() {
        let mut bytes = vec![0x40, 0xBF, 0, 1, 0, 2, 0, 4];
        bytes.extend_from_slice(b"#1J+more");
        for end in 0..12 {
            assert_eq!(Packet::take(&bytes[..end]), Ok(None), "{end}");
        }
        let (packet, taken) = Packet::take(&bytes).unwrap().unwrap();
        assert_eq!(taken, 12);
        assert_eq!((packet.request, packet.value, packet.index), (Request::GetResponse, 1, 2));
        assert_eq!((packet.upload, packet.data.as_slice()), (false, &b"#1J+"[..]));
    }

    #[test]
    fn the_length_of_a_reading_request_announces_no_data() {
        for (request, upload) in [(0xB4, UPLOAD), (0xC2, UPLOAD), (0xC5, UPLOAD), (0xE0, UPLOAD)] {
            let bytes = [upload, request, 0, 0, 0, 0, 0xFF, 0xFF];
            let (packet, taken) = Packet::take(&bytes).unwrap().unwrap();
            assert_eq!((taken, packet.data.len(), packet.length), (8, 0, 0xFFFF), "{request:02X}");
        }
    }

    #[test]
    fn what_is_no_request_is_refused_at_its_first_wrong_byte() {
        assert_eq!(Packet::take(b"G"), Err(Malformed::Direction(b'G')));
        assert_eq!(Packet::take(&[0x40, 0x00]), Err(Malformed::Request(0)));
        assert_eq!(Packet::take(&[0x40, 0xB5, 0, 0, 0, 0, 5, 0xD5]), Err(Malformed::Length(1493)));
        assert_eq!(Packet::take(&[0x40, 0xB5, 0, 0, 0, 0, 5, 0xD4]), Ok(None));
    }

    proptest! {
        #[test]
        fn nothing_takes_more_than_is_there(bytes in proptest::collection::vec(any::<u8>(), 0..1600)) {
            if let Ok(Some((packet, taken))) = Packet::take(&bytes) {
                prop_assert!(taken <= bytes.len() && packet.data.len() + HEADER == taken);
            }
        }
    }
}
