//! A VME card behind the kernel module `pmac_vme`: a UIO device for each of the card's interrupt vectors. The device of
//! v+1 also has the card's DPRAM (map 0) and mailboxes (map 1).

use crate::device::board::byte_spec::ByteSpec;
use crate::device::board::spec::{BoardSpec, Place, WindowSpec};
use crate::device::interrupt::InterruptSource;
use crate::device::system::System;
use crate::device::uio::UioInfo;
use crate::map::mailbox;

/// The map of the mailboxes.
const MAILBOX_MAP: u32 = 1;

/// The parts of a VME card besides its DPRAM.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VmeCard {
    /// The registers of the mailboxes.
    pub registers: ByteSpec,
    /// The interrupt of vector v-1: the card has taken a group.
    pub taken: InterruptSource,
    /// The interrupt of vector v: the mailboxes hold a group of a reply.
    pub reply: InterruptSource,
    /// Bits A19-A14 of the DPRAM's VME address.
    pub page: u8,
}

impl VmeCard {
    /// The card of a `vme:` board; `None` without `pmac_vme`.
    ///
    /// # Errors
    /// What the card lacks: without its page register it would show another part of its DPRAM after a reset.
    pub fn of(system: &System, board: &BoardSpec) -> Result<Option<Self>, String> {
        let BoardSpec::Window(WindowSpec { place: Place::Vme(node), .. }) = board else { return Ok(None) };
        let Some(info) = UioInfo::at(system, node).filter(UioInfo::is_vme_card) else { return Ok(None) };
        let lacks = |what: &str| {
            format!(
                "{} is {}, which has no {what}: card N is vme:/dev/pmac-vmeN; dmesg tells if pmac_vme failed",
                info.node(),
                info.name
            )
        };
        let all = UioInfo::all(system);
        let of_vector = |vector: &str| {
            let name = format!("{}-{vector}", info.name);
            let found = all.iter().find(|other| other.name == name);
            found.map(|other| InterruptSource::Uio(other.node().into())).ok_or_else(|| lacks(&name))
        };
        // pmac_vme gives VME addresses, not the processor's.
        let dpram = info.maps.iter().find(|map| map.number == 0).ok_or_else(|| lacks("memory"))?;
        Ok(Some(Self {
            registers: ByteSpec::in_map(info.node().into(), MAILBOX_MAP),
            taken: of_vector("taken")?,
            reply: of_vector("reply")?,
            page: mailbox::page_of(dpram.address.wrapping_add(dpram.offset) as u32),
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::testing::FakeSystem;

    fn card(fake: &FakeSystem, board: &str) -> Result<Option<VmeCard>, String> {
        VmeCard::of(&fake.system, &board.parse().unwrap())
    }

    #[test]
    fn a_card_has_the_vectors_of_its_number_and_the_page_of_its_address() {
        let fake = FakeSystem::new();
        for (number, name) in ["pmac-vme0-taken", "pmac-vme0-reply", "pmac-vme0"].into_iter().enumerate() {
            fake.uio(number as u32, name, 0x70_0000, 0x8000, 0x4000, 0x8000);
            fake.uio(number as u32 + 3, &name.replace('0', "1"), 0x76_0000, 0x1_0000, 0xC000, 0x1_0000);
        }
        fake.link("dev/pmac-vme1", "uio5");
        for (board, page, taken) in
            [("vme:/dev/uio2", 1, "uio:/dev/uio0"), ("vme:/dev/pmac-vme1", 0x1B, "uio:/dev/uio3")]
        {
            let card = card(&fake, board).unwrap().unwrap();
            assert_eq!((card.page, card.taken.to_string()), (page, taken.to_owned()), "{board}");
            let number = taken.replace("uio3", "uio5").replace("uio0", "uio2");
            assert_eq!(card.registers.to_string(), format!("{number},map=1"), "{board}");
        }
        assert_eq!(card(&fake, "vme:/dev/uio2").unwrap().unwrap().reply.to_string(), "uio:/dev/uio1");
        assert_eq!(card(&fake, "uio:/dev/uio2"), Ok(None), "a UIO board is what its specification says");
        std::fs::remove_dir_all(fake.path("sys/class/uio/uio1")).unwrap();
        let error = card(&fake, "vme:/dev/uio2").unwrap_err();
        assert!(error.starts_with("/dev/uio2 is pmac-vme0, which has no pmac-vme0-reply"), "{error}");
        let error = card(&fake, "vme:/dev/uio0").unwrap_err();
        assert!(error.contains("is pmac-vme0-taken") && error.contains("vme:/dev/pmac-vmeN"), "{error}");
    }

    #[test]
    fn a_window_of_vme_user_is_no_card() {
        let fake = FakeSystem::new();
        fake.memory("dev/bus/vme/m0", 0x1_0000);
        assert_eq!(card(&fake, "vme:/dev/bus/vme/m0"), Ok(None));
    }
}
