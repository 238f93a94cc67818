//! The VME mailbox circuit: 16 byte registers for commands and replies, and the DPRAM's page (User Manual p. 260-267).

/// The circuit's bytes on the VME bus, from its base.
pub const LENGTH: usize = 0x200;
/// Mailboxes; mailbox k is the byte at base + 2 k + 1.
pub const MAILBOXES: usize = 16;
/// The page register: bits A19-A14 of the DPRAM's VME address. The host writes it after every reset.
pub const PAGE_SELECT: usize = 0x121;

/// The page of a DPRAM at this VME address.
#[must_use]
pub const fn page_of(dpram: u32) -> u8 {
    (dpram >> 14 & 0x3F) as u8
}
