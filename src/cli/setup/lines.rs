//! `pmacctl setup`: computes and explains the lines that set up a board. `setup/send.rs` sends them.

use std::fmt::Write;
use std::path::PathBuf;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Subcommand};

use crate::cli::args::values::family;
use crate::cli::setup::answer::Explanation;
use crate::map::number::parse;
use crate::map::{Family, Function, Generation, PMAC, PmacRegister};
use crate::setup::SetupPlan;
use crate::setup::enable::{self, EnablePlan, Options};
use crate::setup::isa::{self, IsaAddressing, TurboWindow};
use crate::setup::vme::{AddressBits, VmeSetup};

/// The part to set up.
#[derive(Debug, Clone, Subcommand)]
pub enum SetupCommand {
    /// Place the DPRAM in the memory of an ISA (PC bus) host
    Isa(Isa),
    /// Place the mailboxes and the DPRAM on the VME bus, and choose the interrupt
    Vme(Vme),
    /// Switch on automatic functions: the variables and commands that each needs, and why
    Enable(Enable),
}

/// `setup isa`.
#[derive(Debug, Clone, Args)]
pub struct Isa {
    /// Where the DPRAM starts, a multiple of 0x4000, for example 0xD4000
    #[arg(long, value_name = "ADDRESS", value_parser = parse)]
    pub address: u32,
    /// How many address lines to decode; addresses above the first megabyte need 24
    #[arg(long, value_name = "BITS", default_value = "24", value_parser = addressing())]
    pub addressing: IsaAddressing,
    /// Switch the DPRAM off
    #[arg(long)]
    pub disable: bool,
    #[command(flatten)]
    pub board: OfBoard,
    /// Turbo boards: how many KiB the window shows at a time
    #[arg(long, value_name = "KIB", default_value = "16", value_parser = window())]
    pub window: TurboWindow,
}

fn addressing() -> impl TypedValueParser<Value = IsaAddressing> {
    PossibleValuesParser::new(["20", "24"])
        .map(|bits| if bits == "20" { IsaAddressing::Bits20 } else { IsaAddressing::Bits24 })
}

fn window() -> impl TypedValueParser<Value = TurboWindow> {
    PossibleValuesParser::new(["16", "64"])
        .map(|kib| if kib == "16" { TurboWindow::Kib16 } else { TurboWindow::Kib64 })
}

fn address_bits() -> impl TypedValueParser<Value = AddressBits> {
    PossibleValuesParser::new(["16", "24", "32"]).map(|bits| match bits.as_str() {
        "16" => AddressBits::A16,
        "24" => AddressBits::A24,
        _ => AddressBits::A32,
    })
}

/// `setup vme`.
#[derive(Debug, Clone, Args)]
pub struct Vme {
    /// The mailboxes' base, a multiple of 0x200, for example 0x7FA000
    #[arg(long, value_name = "ADDRESS", value_parser = parse)]
    pub mailbox: u32,
    /// Where the DPRAM starts, a multiple of 0x4000. Without this the lines switch the DPRAM off
    #[arg(long, value_name = "ADDRESS", value_parser = parse)]
    pub dpram: Option<u32>,
    /// How many address bits the board decodes
    #[arg(long, value_name = "BITS", default_value = "24", value_parser = address_bits())]
    pub address_bits: AddressBits,
    /// The interrupt level, 1 to 7
    #[arg(long, value_name = "LEVEL", default_value = "2", value_parser = parse)]
    pub irq_level: u32,
    /// The middle one of the three interrupt vectors, odd
    #[arg(long, value_name = "VECTOR", default_value = "0xA1", value_parser = parse)]
    pub vector: u32,
    /// Instead of printing lines: have this host's bridge show mailboxes and DPRAM at this node of vme_user, as
    /// /dev/bus/vme/m0, and print pmacd's configuration
    #[arg(long, value_name = "NODE")]
    pub window: Option<PathBuf>,
    #[command(flatten)]
    pub board: OfBoard,
}

/// `setup enable`.
#[derive(Debug, Clone, Args)]
pub struct Enable {
    /// ascii, panel, servo, background, variables, rotary, gather
    #[arg(required = true, value_name = "FUNCTION")]
    pub functions: Vec<Function>,
    /// servo, background: the highest reported motor and coordinate system (PMAC, PMAC2)
    #[arg(long, value_name = "N", default_value_t = Options::default().motors)]
    pub motors: u32,
    /// servo, gather: servo cycles between reports or samples
    #[arg(long, value_name = "CYCLES", default_value_t = Options::default().period)]
    pub period: u32,
    /// ascii: interrupt the host when a response is ready
    #[arg(long)]
    pub interrupt: bool,
    /// rotary: the coordinate system that executes the program
    #[arg(long, value_name = "N", default_value_t = Options::default().coordinate_system)]
    pub coordinate_system: u32,
    /// rotary: the size of the buffer in PMAC's own memory, in 48-bit words
    #[arg(long, value_name = "WORDS", default_value_t = Options::default().rotary_words)]
    pub rotary_size: u32,
    /// gather: the size of the buffer, in 32-bit words
    #[arg(long, value_name = "LONGS", default_value_t = Options::default().gather_longs)]
    pub gather_size: u32,
    /// gather: stop when the buffer is full, instead of wrapping round
    #[arg(long)]
    pub stop_when_full: bool,
    /// gather: a register to gather, Y:$C000, X:$C001, D:$002B or L:$1005; up to 24 of them, 48 on Turbo boards
    #[arg(long = "source", value_name = "REGISTER")]
    pub sources: Vec<PmacRegister>,
    /// Add SAVE, so that the variables survive a reset
    #[arg(long)]
    pub save: bool,
    #[command(flatten)]
    pub board: OfBoard,
}

/// Which board the lines are for.
#[derive(Debug, Clone, Args)]
pub struct OfBoard {
    /// The board's family: pmac, pmac2, turbo or turbo2 [default: that of the board that pmacd or --port reaches, else pmac]
    #[arg(long, value_parser = family, value_name = "FAMILY")]
    pub family: Option<&'static Family>,
}

impl OfBoard {
    /// The family, or PMAC while the family is unknown.
    pub fn known(&self) -> &'static Family {
        self.family.unwrap_or(&PMAC)
    }
}

impl SetupCommand {
    /// The board for which the lines are.
    pub fn board(&mut self) -> &mut OfBoard {
        let (Self::Isa(Isa { board, .. })
        | Self::Vme(Vme { board, .. })
        | Self::Enable(Enable { board, .. })) = self;
        board
    }
}

/// The lines that `setup …` would send, as JSON and as text. They depend on whether the servo report runs already.
///
/// # Errors
/// Why this set-up is impossible; exit status 2.
pub fn answer(command: &SetupCommand, servo_runs: bool) -> Result<Explanation, String> {
    let plan = match command {
        SetupCommand::Isa(options) => options.plan()?,
        SetupCommand::Vme(options) => options.setup().plan().map_err(|error| error.to_string())?,
        SetupCommand::Enable(options) => {
            let plan = options.plan(servo_runs)?;
            return Ok(Explanation::of(&plan, enable_text(&plan))?.with(plan.commands));
        }
    };
    Ok(Explanation::of(&plan, plan_text(&plan))?.with(plan.commands))
}

impl Isa {
    fn plan(&self) -> Result<SetupPlan, String> {
        let generation = self.board.known().generation;
        if (self.window, generation) == (TurboWindow::Kib64, Generation::Pmac) {
            return Err("only Turbo boards have a window of 64 KiB; give --family turbo".to_owned());
        }
        isa::plan(generation, self.address, self.addressing, !self.disable, self.window)
            .map_err(|error| error.to_string())
    }
}

impl Vme {
    /// The wanted settings.
    pub fn setup(&self) -> VmeSetup {
        let Self { mailbox, dpram, address_bits, irq_level, vector, .. } = *self;
        let generation = self.board.known().generation;
        VmeSetup { mailbox, dpram, address_bits, irq_level, vector, generation }
    }
}

impl Enable {
    fn plan(&self, servo_runs: bool) -> Result<EnablePlan, String> {
        let options = Options {
            motors: self.motors,
            period: self.period,
            interrupt: self.interrupt,
            coordinate_system: self.coordinate_system,
            rotary_words: self.rotary_size,
            gather_longs: self.gather_size,
            gather_wrap: !self.stop_when_full,
            gather_sources: self.sources.clone(),
            save: self.save,
            servo_runs,
        };
        enable::plan(&self.functions, &options, self.board.known()).map_err(|error| error.to_string())
    }
}

// Writing to a String cannot fail.

fn plan_text(plan: &SetupPlan) -> String {
    let mut text = String::new();
    for value in &plan.values {
        let _ = writeln!(text, "{:<8} {}", value.register, value.value);
        for field in &value.fields {
            let _ = writeln!(text, "    {:<4} {:<8}  {}", field.bits, field.value, field.meaning);
        }
    }
    for warning in &plan.warnings {
        let _ = writeln!(text, "\nwarning: {warning}");
    }
    let _ = writeln!(text, "\nSend, in this order (PMAC uses the values from the next reset on):");
    list(&mut text, &plan.commands);
    for write in plan.after_reset.iter().flatten() {
        let _ = writeln!(
            text,
            "\nAfter every reset, before the DPRAM is used, the host writes the byte 0x{:02X} (A19-A14 of the DPRAM) \
             to 0x{:X}.",
            write.value, write.address
        );
    }
    text
}

fn enable_text(plan: &EnablePlan) -> String {
    let mut text = String::new();
    for function in &plan.plans {
        let _ = writeln!(text, "{}", function.function);
        for line in &function.lines {
            let _ = writeln!(text, "  {:<18}  {}", line.line, line.why);
        }
        for note in &function.notes {
            let _ = writeln!(text, "  - {note}");
        }
        text.push('\n');
    }
    let _ = writeln!(text, "Send, in this order:");
    list(&mut text, &plan.commands);
    text
}

fn list(text: &mut String, commands: &[String]) {
    for command in commands {
        let _ = writeln!(text, "  {command}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::{CommandFactory, Parser};
    use serde_json::json;

    #[derive(Debug, Parser)]
    struct Line {
        #[command(subcommand)]
        command: SetupCommand,
    }

    fn answered(line: &str) -> Explanation {
        answer(&command(line), false).unwrap_or_else(|reason| panic!("{line}: {reason}"))
    }

    fn command(line: &str) -> SetupCommand {
        Line::try_parse_from(line.split(' ')).unwrap_or_else(|error| panic!("{error}")).command
    }

    #[test]
    fn the_tree_is_sound() {
        Line::command().debug_assert();
    }

    #[test]
    fn the_manuals_examples_from_the_command_line() {
        let answer = answered("setup isa --address 0xEC000 --addressing 24");
        assert_eq!(answer.document["commands"], json!(["WX:$786,$0000E,$000C5", "SAVE", "$$$"]));
        assert_eq!(answer.document.get("after_reset"), None);
        let answer = answered("setup isa --address $EC000 --addressing 24 --disable");
        assert_eq!(answer.document["commands"][0], "WX:$786,$0000E,$000C4");

        let vme =
            "setup vme --mailbox 0x7FA000 --dpram 0x1FC000 --address-bits 24 --irq-level 2 --vector 0xA1";
        let answer = answered(vme);
        assert_eq!(
            answer.document["commands"],
            json!(["WX$0783,$39,$4,$0,$7F,$A0,$02,$A1,$10,$E0,$90", "SAVE", "$$$"])
        );
        assert_eq!(answer.document["after_reset"], json!([{ "address": "0x7FA121", "value": "0x3F" }]));
        assert_eq!(answer.document["values"][9]["register"], "X:$078C");
        assert_eq!(answer.commands.len(), 3);
    }

    #[test]
    fn the_text_explains_every_bit() {
        let text = answered("setup isa --address 0xEC000").text;
        assert_eq!(
            text,
            "X:$0786  $0E\n    \
             7-0  00001110  A23-A16 of the DPRAM's start\n\
             X:$0787  $C5\n    \
             7-6  11        A15-A14 of the DPRAM's start\n    \
             5-3  000       reserved\n    \
             2    1         24-bit addressing\n    \
             1    0         8K x 16 bit DPRAM\n    \
             0    1         DPRAM enabled\n\n\
             Send, in this order (PMAC uses the values from the next reset on):\n  \
             WX:$786,$0000E,$000C5\n  SAVE\n  $$$\n"
        );
        let text = answered("setup vme --mailbox 0x7FA000 --dpram 0x1FC000").text;
        assert!(text.contains("the byte 0x3F (A19-A14 of the DPRAM) to 0x7FA121"), "{text}");
    }

    #[test]
    fn functions_are_planned() {
        let answer = answered("setup enable servo gather --source D:$002B --source D:$0028 --motors 2");
        assert_eq!(
            answer.document["commands"],
            json!([
                "I19=1",
                "I59=2",
                "I48=1",
                "I45=3",
                "I20=$000003",
                "I21=$80002B",
                "I22=$800028",
                "DEFINE GATHER 1024",
                "GATHER",
                "GATHER"
            ])
        );
        assert_eq!(answer.document["plans"][0]["function"], "servo");
        assert_eq!(answer.document["plans"][0]["lines"][2]["line"], "I48=1");
        assert!(answer.document["plans"][0]["lines"][2]["why"].is_string());
        assert!(answer.document["plans"][1]["notes"].is_array());
        assert!(answer.text.starts_with("servo\n  I19=1  "));
        assert!(answer.text.ends_with("  GATHER\n  GATHER\n"));
        let both = command("setup enable servo gather");
        let starts = |servo_runs| {
            let lines = super::answer(&both, servo_runs).unwrap().commands;
            lines.iter().filter(|line| *line == "GATHER").count()
        };
        assert_eq!((starts(false), starts(true)), (2, 1));
    }

    #[test]
    fn what_cannot_be_is_refused_with_the_reason() {
        let refused = |line: &str| answer(&command(line), false).unwrap_err();
        assert!(refused("setup isa --address 0xEC100").contains("not a multiple of 16 KiB"));
        assert!(refused("setup isa --address 0xC0000 --window 64").contains("--family turbo"));
        assert!(refused("setup vme --mailbox 0x7FA000 --irq-level 8").contains("levels 1 to 7"));
        assert!(refused("setup enable servo --motors 9").contains("1 to 8"));
        for line in [
            "setup isa --address EC000",
            "setup isa --address 0xEC000 --addressing 32",
            "setup isa",
            "setup vme --mailbox 0x7FA000 --address-bits 20",
            "setup vme --mailbox 0x7FA000 --family umac",
            "setup enable",
            "setup enable everything",
            "setup enable gather --source DP:$D200",
        ] {
            assert!(Line::try_parse_from(line.split(' ')).is_err(), "{line}");
        }
    }
}
