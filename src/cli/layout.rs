//! The board's map and scales, for register names and units.

use std::time::{Duration, Instant};

use crate::cli::context::Failure;
use crate::client::{Board, identity};
use crate::decode::Scales;
use crate::map::{Firmware, Layout};
use crate::segment::Identity;

/// How long to wait for the board's identity. Without command lines it never arrives.
const IDENTIFIED: Duration = Duration::from_secs(2);

/// The known parts of the board's map and scales.
pub fn board_layout(board: &mut Board) -> Result<(Layout, Scales, Option<Firmware>), Failure> {
    // The daemon may still be identifying a board after a start or a reset.
    let deadline = Instant::now() + IDENTIFIED;
    let mut identity = board.identity()?;
    while !is_identified(&identity) && Instant::now() < deadline {
        std::thread::sleep(Duration::from_millis(20));
        board.refresh()?;
        identity = board.identity()?;
    }
    let family = identity::family(&identity)
        .ok_or_else(|| Failure::Request("the board's family is not known to this program".to_owned()))?;
    let firmware = identity.firmware.as_deref().and_then(|text| text.parse().ok());
    Ok((Layout::new(family, firmware), identity::scales(&identity), firmware))
}

/// Whether the board has told its firmware and, later, its servo period.
fn is_identified(identity: &Identity) -> bool {
    identity.firmware.is_some() && identity.servo_period_ps.is_some()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::Text;

    #[test]
    fn a_board_is_identified_once_it_has_told_its_servo_period_too() {
        let mut identity = Identity { firmware: Some(Text::from_bytes(b"1.947")), ..Identity::default() };
        assert!(!is_identified(&identity));
        identity.servo_period_ps = Some(442_740_000);
        assert!(is_identified(&identity));
        identity.firmware = None;
        assert!(!is_identified(&identity));
    }
}
