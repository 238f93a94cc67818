//! What a client sends to the gateway: bytes that come in any pieces, from a client who may do everything or only read, while
//! nobody is at the daemon's socket.

use pmac_gateway::board::Place;
use pmac_gateway::client::Client;
use pmac_gateway::packet::{DATA_MAX, HEADER, Packet, REPLY_MAX};
use pmac_gateway::session::{Rules, Session};
use pmac_gateway::texts::Texts;

/// Nobody listens there.
const NOWHERE: &str = "/nonexistent/pmac0.sock";

/// First byte: who the client is; second: how many bytes come at a time.
pub fn body(data: &[u8]) {
    let [who, piece, rest @ ..] = data else { return };
    let rules = Rules {
        place: Place::new(NOWHERE.into(), None),
        read_only: who & 1 != 0,
        keep_jogs: who & 8 != 0,
        version: (who & 2 != 0).then(|| "1.94".to_owned()),
        texts: Texts::default(),
    };
    let session = match who & 4 {
        0 => Session::new("fuzzer".to_owned(), rules),
        _ => Session::again("fuzzer".to_owned(), rules, None),
    };
    let mut client = Client::new(session);
    let mut bytes = Vec::new();
    for piece in rest.chunks(usize::from(*piece).max(1)) {
        bytes.extend_from_slice(piece);
        loop {
            match Packet::take(&bytes) {
                Err(malformed) => {
                    assert!(!malformed.to_string().is_empty());
                    return;
                }
                Ok(None) => break,
                Ok(Some((packet, taken))) => {
                    assert!((HEADER..=HEADER + DATA_MAX).contains(&taken) && taken <= bytes.len());
                    bytes.drain(..taken);
                    match client.answer(&packet) {
                        Ok(reply) => assert!((1..=REPLY_MAX).contains(&reply.len()), "{packet:?}"),
                        Err(why) => {
                            assert!(!why.is_empty());
                            return;
                        }
                    }
                    if client.renew().is_err() {
                        return;
                    }
                }
            }
        }
        // What is no whole request yet is bounded.
        assert!(bytes.len() < HEADER + DATA_MAX);
    }
}
