//! Completions for a shell: besides options, the boards that have a daemon, and the registers that go by name.

use clap::Command;
use clap::builder::PossibleValuesParser;
use clap_complete::{Shell, generate};
use pmac_dpram::gather::Source;
use pmac_dpram::map::{Layout, PMAC};

/// The shells.
pub const SHELLS: [Shell; 3] = [Shell::Bash, Shell::Zsh, Shell::Fish];

/// Stands for the boards in what is generated.
const BOARDS: &str = "BOARDS";
/// What lists them: the sockets of their daemons. In it no quote ends that of a shell.
const LIST_BOARDS: &str = "ls /run/pmacd $XDG_RUNTIME_DIR/pmacd 2>/dev/null | sed -n s/.sock//p";

/// The completions of `program` for `shell`.
pub fn completions(shell: Shell, program: Command) -> String {
    let name = program.get_name().to_owned();
    let mut program = if name == "pmacctl" { with_values(shown(&program)) } else { program };
    let mut text = Vec::new();
    generate(shell, &mut program, name, &mut text);
    let text = String::from_utf8_lossy(&text).into_owned();
    match shell {
        Shell::Bash => text.replace(BOARDS, &format!("$({LIST_BOARDS})")),
        Shell::Zsh => text.replace(&format!("({BOARDS})"), &format!("{{compadd -- $({LIST_BOARDS})}}")),
        _ => text.replace(&format!("{BOARDS}\\t''"), &format!("({LIST_BOARDS})")),
    }
}

/// Without old spellings, which the shells would offer, too.
fn shown(command: &Command) -> Command {
    let shown = command.get_subcommands().filter(|sub| !sub.is_hide_set()).map(self::shown);
    let mut without =
        Command::new(command.get_name().to_owned()).args(command.get_arguments()).subcommands(shown);
    if let Some(about) = command.get_about() {
        without = without.about(about.clone());
    }
    match command.get_version() {
        Some(version) => without.version(version.to_owned()),
        None => without,
    }
}

fn with_values(program: Command) -> Command {
    let names = Source::names(&Layout::new(&PMAC, None));
    let names: Vec<String> = names.split(", ").map(str::to_owned).collect();
    let registers = PossibleValuesParser::new(names);
    let (watched, shown) = (registers.clone(), registers.clone());
    program
        .mut_arg("name", |name| name.value_parser([BOARDS]))
        .mut_subcommand("gather", |gather| gather.mut_arg("source", |source| source.value_parser(registers)))
        .mut_subcommand("top", |top| top.mut_arg("watches", |watch| watch.value_parser(shown)))
        .mut_subcommand("variable", |variable| {
            variable.mut_subcommand("watch", |watch| {
                watch.mut_arg("registers", |register| register.value_parser(watched))
            })
        })
}
