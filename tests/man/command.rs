//! A program's manual page, made from the definition of its command line: synopsis with values, options, commands.

use clap::{Arg, ArgAction, Command};

use super::roff::{Page, bold, escaped, italic};

/// What stands before the options of a program's every command, which the program's own page has.
const GLOBAL: &str = "Options of every command";

/// The sections NAME to COMMANDS.
pub fn describe(page: &mut Page, command: &Command) {
    let name = command.get_display_name().unwrap_or_else(|| command.get_name());
    let about = command.get_about().map(ToString::to_string).unwrap_or_default();
    page.section("NAME");
    page.markup(&format!("{} \\- {}", escaped(name), escaped(&about)));
    page.section("SYNOPSIS");
    let forms: Vec<String> = if command.has_subcommands() && name.contains('-') {
        commands(command).map(synopsis).collect()
    } else {
        vec![synopsis(command)]
    };
    for (index, form) in forms.iter().enumerate() {
        if index > 0 {
            page.line_break();
        }
        page.markup(form);
    }
    page.section("DESCRIPTION");
    page.text(&format!("{about}."));
    let long = command.get_long_about().map(ToString::to_string).unwrap_or_default();
    for paragraph in long.split("\n\n").filter(|paragraph| !about.starts_with(*paragraph)) {
        page.paragraph();
        page.text(paragraph);
    }
    if command.has_subcommands() {
        page.section("COMMANDS");
        // A program's commands have pages of their own; a command's are explained here.
        let in_full = name.contains('-');
        for sub in commands(command) {
            let about = sub.get_about().map(ToString::to_string).unwrap_or_default();
            if in_full {
                page.part(sub.get_name());
                page.text(&format!("{about}."));
                for arg in own(sub) {
                    entry(page, arg);
                }
            } else {
                page.entry(
                    &format!("{}(1)", bold(&format!("{name}-{}", sub.get_name()))),
                    &format!("{about}."),
                );
            }
        }
    }
    options(page, command);
}

/// The commands that are shown.
pub fn commands(command: &Command) -> impl Iterator<Item = &Command> {
    command.get_subcommands().filter(|sub| !sub.is_hide_set())
}

fn options(page: &mut Page, command: &Command) {
    let (global, own): (Vec<_>, Vec<_>) = shown(command).partition(|arg| is_global(arg));
    if !own.is_empty() {
        page.section("OPTIONS");
        for arg in own {
            entry(page, arg);
        }
    }
    if !global.is_empty() {
        page.section(&GLOBAL.to_uppercase());
        for arg in global {
            entry(page, arg);
        }
    }
}

/// The arguments that are only this command's.
fn own(command: &Command) -> impl Iterator<Item = &Arg> {
    shown(command).filter(|arg| !is_global(arg) && arg.get_id() != "help")
}

fn shown(command: &Command) -> impl Iterator<Item = &Arg> {
    command.get_arguments().filter(|arg| !arg.is_hide_set())
}

fn is_global(arg: &Arg) -> bool {
    arg.get_help_heading() == Some(GLOBAL)
}

/// The command's words, then each of its arguments with the values it takes.
fn synopsis(command: &Command) -> String {
    let mut line = bold(command.get_bin_name().unwrap_or_else(|| command.get_name()));
    let arguments: Vec<&Arg> = own(command).filter(|arg| arg.get_id() != "version").collect();
    let (positional, options): (Vec<&Arg>, Vec<&Arg>) =
        arguments.into_iter().partition(|arg| arg.is_positional());
    for arg in options.into_iter().chain(positional) {
        let text = signature(arg, "|");
        line += &if arg.is_required_set() { format!(" {text}") } else { format!(" [{text}]") };
    }
    if shown(command).any(is_global) {
        line += &format!(" [{}]", italic("OPTION"));
        line += "...";
    }
    if command.has_subcommands() {
        line += &format!(" {} ...", italic("COMMAND"));
    }
    line
}

/// How an argument is written.
fn signature(arg: &Arg, between: &str) -> String {
    let short = arg.get_short().map(|short| bold(&format!("-{short}")));
    let long = arg.get_long().map(|long| bold(&format!("--{long}")));
    let mut text = short.into_iter().chain(long).collect::<Vec<_>>().join(between);
    if takes_value(arg) {
        let names = arg.get_value_names().map(|names| names.join(" "));
        let value = italic(&names.unwrap_or_else(|| arg.get_id().as_str().to_uppercase()));
        text += &if text.is_empty() { value } else { format!(" {value}") };
    }
    if may_repeat(arg) { text + "..." } else { text }
}

fn takes_value(arg: &Arg) -> bool {
    matches!(arg.get_action(), ArgAction::Set | ArgAction::Append)
}

fn may_repeat(arg: &Arg) -> bool {
    matches!(arg.get_action(), ArgAction::Append)
}

fn entry(page: &mut Page, arg: &Arg) {
    let help = arg.get_long_help().or_else(|| arg.get_help()).map(ToString::to_string).unwrap_or_default();
    let mut text = format!("{help}.");
    let values: Vec<String> = if takes_value(arg) {
        let values = arg.get_possible_values();
        values.iter().filter(|value| !value.is_hide_set()).map(possible).collect()
    } else {
        Vec::new()
    };
    if !values.is_empty() {
        text += &format!(" One of: {}.", values.join(", "));
    }
    let defaults: Vec<_> = arg.get_default_values().iter().map(|value| value.to_string_lossy()).collect();
    if takes_value(arg) && !defaults.is_empty() {
        text += &format!(" Default: {}.", defaults.join(","));
    }
    page.entry(&signature(arg, ", "), &text);
}

fn possible(value: &clap::builder::PossibleValue) -> String {
    match value.get_help() {
        Some(help) => format!("{} ({help})", value.get_name()),
        None => value.get_name().to_owned(),
    }
}
