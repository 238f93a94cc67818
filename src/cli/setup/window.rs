//! `pmacctl setup vme --window`: sets the window of this host's VME bridge, and prints what pmacd's configuration then has.

use std::path::Path;

use serde_json::json;

use super::answer::Explanation;
use super::lines::Vme;
use crate::cli::context::Failure;
use crate::device::System;
use crate::device::board::vme::set_window;
use crate::setup::vme::{BridgeWindow, VmeSetup};

/// Has the bridge show the mailboxes and the DPRAM of `options` at `node`.
pub fn set(options: &Vme, node: &Path) -> Result<Explanation, Failure> {
    let setup = options.setup();
    let window = setup.window().map_err(Failure::request)?;
    set_window(&System::here(), node, window).map_err(Failure::request)?;
    answer(&setup, window, node).map_err(Failure::Request)
}

fn answer(setup: &VmeSetup, window: BridgeWindow, node: &Path) -> Result<Explanation, String> {
    let (BridgeWindow { address, size, address_bits }, node) = (window, node.display());
    let place = |at: u32| match at - address {
        0 => format!("vme:{node}"),
        offset => format!("vme:{node},offset={offset:#x}"),
    };
    let (registers, board) = (place(setup.mailbox), setup.dpram.map(place));
    let page = setup.page().map(|write| write.value);
    let document = json!({
        "node": node.to_string(), "address": format!("{address:#x}"), "size": format!("{size:#x}"),
        "address_bits": address_bits.count(), "board": board, "registers": registers, "page": page,
    });
    let board = board.map(|board| format!("board = \"{board}\"\n\n")).unwrap_or_default();
    let page = page.map(|page| format!("page = {page:#04x}\n")).unwrap_or_default();
    // vme_user passes no interrupt on, and command lines through the mailboxes need two.
    let text = format!(
        "# {node}: {address:#x} to {:#x} of the VME bus, A{}, D16, until the bridge's driver is unloaded\n\
         {board}[mailbox]\nregisters = \"{registers}\"\nuse = \"never\"\n{page}",
        address + (size - 1),
        address_bits.count(),
    );
    Explanation::of(&document, text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::{BoardSpec, ByteSpec};
    use crate::map::Generation;
    use crate::setup::vme::AddressBits;

    #[test]
    fn the_configuration_names_both_parts_in_the_window() {
        let setup = VmeSetup {
            mailbox: 0x7F_A000,
            dpram: Some(0x1F_C000),
            address_bits: AddressBits::A24,
            irq_level: 2,
            vector: 0xA1,
            generation: Generation::Pmac,
        };
        let shown =
            |setup: VmeSetup| answer(&setup, setup.window().unwrap(), Path::new("/dev/bus/vme/m0")).unwrap();
        let Explanation { document, text, .. } = shown(setup);
        assert_eq!(
            text,
            "# /dev/bus/vme/m0: 0x1f0000 to 0x7fffff of the VME bus, A24, D16, until the bridge's driver is unloaded\n\
             board = \"vme:/dev/bus/vme/m0,offset=0xc000\"\n\n\
             [mailbox]\nregisters = \"vme:/dev/bus/vme/m0,offset=0x60a000\"\nuse = \"never\"\npage = 0x3f\n"
        );
        let spec = |key: &str| document[key].as_str().unwrap().to_owned();
        spec("board").parse::<BoardSpec>().unwrap();
        spec("registers").parse::<ByteSpec>().unwrap();
        assert_eq!((document["size"].as_str(), document["page"].as_u64()), (Some("0x610000"), Some(0x3F)));

        let Explanation { document, text, .. } = shown(VmeSetup { mailbox: 0x7F_0000, dpram: None, ..setup });
        assert!(
            text.ends_with("[mailbox]\nregisters = \"vme:/dev/bus/vme/m0\"\nuse = \"never\"\n"),
            "{text}"
        );
        assert_eq!((&document["board"], &document["page"]), (&json!(null), &json!(null)));
    }
}
