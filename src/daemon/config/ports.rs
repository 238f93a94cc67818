//! The tables `[mailbox]` and `[host_port]` of the configuration: byte registers beside the DPRAM.

use serde::Deserialize;

use super::span::Refusal;
use crate::device::{BoardSpec, ByteSpec, InterruptSource, System, VmeCard};
use crate::function::host_port::{HostPort, Initialisation};
use crate::function::mailbox::{EnableReplies, ErrorReport, MailboxSettings};
use crate::map::{Controller, Family};

/// The number of pages (six bits).
const PAGES: u8 = 0x40;

/// When command lines go through the VME mailboxes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MailboxUse {
    /// Always. The DPRAM's ASCII buffers stay unused.
    Always,
    /// While the DPRAM's port is off (I58=0) or out of reach.
    #[default]
    Fallback,
    /// Never. The registers only set the page.
    Never,
}

/// The byte of a word that holds a register.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Lane {
    /// The odd byte, as in the manual: mailbox n at base + 2n + 1.
    #[default]
    Odd,
    /// The even byte: the bridge swaps the bytes of a word.
    Even,
}

/// The refusal of a key, with the key in front.
fn of(key: &str, error: impl std::fmt::Display) -> Refusal {
    Refusal::of(key, format!("{key}: {error}"))
}

/// `[mailbox]` as written.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MailboxTable {
    registers: String,
    #[serde(default, rename = "use")]
    when: MailboxUse,
    #[serde(default)]
    lane: Lane,
    taken: Option<String>,
    reply: Option<String>,
    dpram: Option<String>,
    page: Option<u8>,
    #[serde(default)]
    error_report: ErrorReport,
    #[serde(default)]
    enable_replies: EnableReplies,
}

/// The sources of the interrupts with vectors v-1 and v.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Vectors {
    /// v-1: PMAC has taken a group.
    pub taken: InterruptSource,
    /// v: the mailboxes hold a group of a reply.
    pub reply: InterruptSource,
}

/// The mailbox circuit of a VME board.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MailboxConfig {
    /// The place of its 0x200 bytes.
    pub registers: ByteSpec,
    /// When command lines go through the mailboxes.
    pub when: MailboxUse,
    /// The byte of a word that holds a register.
    pub lane: Lane,
    /// The interrupt sources. `None` if command lines never go through the mailboxes.
    pub vectors: Option<Vectors>,
    /// The source of vector v+1 (a response in the DPRAM), if it differs from the board specification's.
    pub dpram: Option<InterruptSource>,
    /// The page that makes the DPRAM visible: bits A19-A14 of its address, written after every reset.
    pub page: Option<u8>,
    /// The board's protocol settings.
    pub talk: MailboxSettings,
}

impl MailboxConfig {
    /// The circuit of `board`: as the table says, or as the kernel describes a VME card. Lines may go through the
    /// mailboxes if the daemon serves command lines at all (`lines`).
    ///
    /// # Errors
    /// The key that is wrong, and how to write it.
    pub fn decide(
        table: Option<MailboxTable>,
        board: &BoardSpec,
        lines: bool,
    ) -> Result<Option<Self>, Refusal> {
        let Some(table) = table else {
            let card = VmeCard::of(&System::here(), board).map_err(Refusal::anywhere)?;
            return Ok(card.map(|card| Self::of_card(card, lines)));
        };
        let config = table.decide()?;
        if config.when != MailboxUse::Never && !lines {
            let text = "functions leaves \"ascii\" out, so the mailboxes can only set the page: write use = \"never\" in [mailbox]";
            return Err(Refusal::of("mailbox.use", text));
        }
        Ok(Some(config))
    }

    /// The circuit of a card.
    fn of_card(card: VmeCard, lines: bool) -> Self {
        Self {
            registers: card.registers,
            when: if lines { MailboxUse::Fallback } else { MailboxUse::Never },
            lane: Lane::default(),
            vectors: lines.then_some(Vectors { taken: card.taken, reply: card.reply }),
            dpram: None,
            page: Some(card.page),
            talk: MailboxSettings::default(),
        }
    }
}

impl MailboxTable {
    /// The settings of the table.
    ///
    /// # Errors
    /// The key that is wrong, and how to write it.
    fn decide(self) -> Result<MailboxConfig, Refusal> {
        let source = |key: &str, text: Option<String>| {
            let parse = |text: String| text.parse().map_err(|error| of(&format!("mailbox.{key}"), error));
            text.map(parse).transpose()
        };
        let vectors = match (source("taken", self.taken)?, source("reply", self.reply)?) {
            (Some(taken), Some(reply)) => Some(Vectors { taken, reply }),
            (None, None) if self.when == MailboxUse::Never => None,
            _ => {
                return Err(Refusal::of(
                    "mailbox",
                    "mailbox: taken and reply must both be given: name the sources of the interrupts v-1 and v, \
                     or write use = \"never\"",
                ));
            }
        };
        if let Some(page) = self.page.filter(|page| *page >= PAGES) {
            let text = format!("mailbox.page = {page} is out of range: write 0 to 0x3F, bits A19-A14");
            return Err(Refusal::of("mailbox.page", text));
        }
        Ok(MailboxConfig {
            registers: self.registers.parse().map_err(|error| of("mailbox.registers", error))?,
            when: self.when,
            lane: self.lane,
            vectors,
            dpram: source("dpram", self.dpram)?,
            page: self.page,
            talk: MailboxSettings { error_report: self.error_report, enable_replies: self.enable_replies },
        })
    }
}

/// `[host_port]` as written.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HostPortTable {
    registers: String,
    controller: Option<Controller>,
    line: Option<u8>,
    initialisation: Option<Initialisation>,
}

/// The interrupt controller behind the board's host port.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HostPortConfig {
    /// The place of its 16 registers.
    pub registers: ByteSpec,
    /// The controller, and our line on it.
    pub port: HostPort,
    /// The I-variable that enables an interrupt for each response in the DPRAM.
    pub interrupt: u16,
}

impl HostPortTable {
    /// The settings of the table, for a board of `family`.
    ///
    /// # Errors
    /// The key that is wrong, and how to write it.
    pub fn decide(self, family: &Family) -> Result<HostPortConfig, Refusal> {
        let default = HostPort::usual(self.controller.unwrap_or(family.host_port));
        let line = self.line.unwrap_or(default.line);
        if line > 7 {
            let text = format!("host_port.line = {line} is out of range: write 0 to 7");
            return Err(Refusal::of("host_port.line", text));
        }
        if self.initialisation.is_some() && default.controller == Controller::Pmac2 {
            let text = "host_port.initialisation is for the 8259 of a PMAC(1); leave it out";
            return Err(Refusal::of("host_port.initialisation", text));
        }
        Ok(HostPortConfig {
            registers: self.registers.parse().map_err(|error| of("host_port.registers", error))?,
            port: HostPort { line, initialisation: self.initialisation, ..default },
            interrupt: family.i.interrupt,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_card_needs_no_table() {
        let card = VmeCard {
            registers: "uio:/dev/uio2,map=1".parse().unwrap(),
            taken: "uio:/dev/uio0".parse().unwrap(),
            reply: "uio:/dev/uio1".parse().unwrap(),
            page: 0x1B,
        };
        let config = MailboxConfig::of_card(card.clone(), true);
        assert_eq!((config.when, config.lane, config.page), (MailboxUse::Fallback, Lane::Odd, Some(0x1B)));
        assert_eq!(config.dpram, None, "v+1 is the interrupt of the board's own device");
        let vectors = config.vectors.unwrap();
        assert_eq!((vectors.taken, vectors.reply), (card.taken.clone(), card.reply.clone()));
        let page_alone = MailboxConfig::of_card(card, false);
        assert_eq!((page_alone.when, page_alone.vectors), (MailboxUse::Never, None));
    }
    use crate::map::{FAMILIES, PMAC, PMAC2};

    fn mailbox(text: &str) -> Result<MailboxConfig, String> {
        toml::from_str::<MailboxTable>(text)
            .map_err(|error| error.message().to_owned())?
            .decide()
            .map_err(|refusal| refusal.text)
    }

    fn host_port(text: &str, family: &Family) -> Result<HostPortConfig, String> {
        toml::from_str::<HostPortTable>(text)
            .map_err(|error| error.message().to_owned())?
            .decide(family)
            .map_err(|refusal| refusal.text)
    }

    #[test]
    fn what_is_left_out_has_its_default() {
        let config = mailbox("registers = \"file:m\"\ntaken = \"unix:t\"\nreply = \"unix:r\"\n").unwrap();
        assert_eq!((config.when, config.lane, config.page), (MailboxUse::Fallback, Lane::Odd, None));
        assert!(config.vectors.is_some() && config.dpram.is_none());
        assert_eq!(config.talk, MailboxSettings::default());
        let config = mailbox("registers = \"file:m\"\nuse = \"never\"\npage = 0x3F\n").unwrap();
        assert_eq!((config.vectors, config.page), (None, Some(0x3F)));
        let config = host_port("registers = \"port:0x210\"\n", &PMAC).unwrap();
        assert_eq!((config.port, config.registers), (HostPort::PMAC, "port:0x210".parse().unwrap()));
        for family in FAMILIES {
            let config = host_port("registers = \"file:h\"\n", family).unwrap();
            let usual = HostPort::usual(family.host_port);
            assert_eq!((config.port, config.interrupt), (usual, family.i.interrupt), "{}", family.name);
        }
        assert_eq!((PMAC.host_port, PMAC2.host_port), (Controller::Pic8259, Controller::Pmac2));
    }

    #[test]
    fn what_is_wrong_is_said_with_its_key() {
        let both = "registers = \"file:m\"\ntaken = \"unix:t\"\nreply = \"unix:r\"\n";
        for (text, reason) in [
            ("registers = \"file:m\"\n".to_owned(), "taken and reply must both be given"),
            ("registers = \"m\"\nuse = \"never\"\n".to_owned(), "mailbox.registers"),
            (format!("{both}page = 64\n"), "mailbox.page = 64"),
            (both.replace("unix:t", "t"), "mailbox.taken"),
            (format!("{both}use = \"often\"\n"), "often"),
            (format!("{both}speed = 1\n"), "speed"),
        ] {
            let error = mailbox(&text).unwrap_err();
            assert!(error.contains(reason), "{text}: {error}");
        }
        for (text, reason) in [
            ("registers = \"port:0x210\"\nline = 8\n", "host_port.line = 8"),
            (
                "registers = \"port:0x210\"\ncontroller = \"pmac2\"\ninitialisation = [1, 2, 3]\n",
                "leave it out",
            ),
            ("registers = \"port:x\"\n", "host_port.registers"),
            ("controller = \"apic\"\nregisters = \"port:1\"\n", "apic"),
        ] {
            let error = host_port(text, &PMAC).unwrap_err();
            assert!(error.contains(reason), "{text}: {error}");
        }
    }
}
