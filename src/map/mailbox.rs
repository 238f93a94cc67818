//! The VME mailbox circuit: byte registers at odd addresses from the board's mailbox base on (User Manual pp. 263-267).
//!
//! Offsets are bytes from that base, not from the DPRAM's.

/// Bytes of the VME bus that the circuit takes.
pub const LENGTH: usize = 0x200;
/// How many mailboxes there are, numbered from 0.
pub const MAILBOXES: usize = 16;
/// The page register: bits 5-0 are A19-A14 of the DPRAM's address, to be written after every reset.
pub const PAGE: usize = 0x121;

/// The register of mailbox `number`, 0 to 15.
#[must_use]
pub const fn register(number: usize) -> usize {
    2 * number + 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mailboxes_have_the_addresses_of_the_manuals_example() {
        let base = 0x7F_A000;
        let addresses = [0, 1, 2, 3, 4, 14, 15].map(|number| base + register(number));
        assert_eq!(addresses, [0x7F_A001, 0x7F_A003, 0x7F_A005, 0x7F_A007, 0x7F_A009, 0x7F_A01D, 0x7F_A01F]);
        assert_eq!(register(MAILBOXES - 1), 0x1F);
    }
}
