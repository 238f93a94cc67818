//! The board's map and scales, for register names and units.

use std::time::{Duration, Instant};

use crate::cli::context::Failure;
use crate::client::{Board, identity};
use crate::decode::Scales;
use crate::map::{Firmware, Layout};

/// How long to wait for the board's identity. Without command lines it never arrives.
const IDENTIFIED: Duration = Duration::from_secs(2);

/// The board's map and scales, as far as they are known.
pub fn board_layout(board: &mut Board) -> Result<(Layout, Scales, Option<Firmware>), Failure> {
    // The daemon may still be identifying a board after a start or a reset.
    let deadline = Instant::now() + IDENTIFIED;
    let mut identity = board.identity()?;
    while identity.firmware.is_none() && Instant::now() < deadline {
        std::thread::sleep(Duration::from_millis(20));
        board.refresh()?;
        identity = board.identity()?;
    }
    let family = identity::family(&identity)
        .ok_or_else(|| Failure::Request("the board's family is not known to this program".to_owned()))?;
    let firmware = identity.firmware.as_deref().and_then(|text| text.parse().ok());
    Ok((Layout::new(family, firmware), identity::scales(&identity), firmware))
}
