//! Every manual page, by the name of its file.

use clap::{Command, CommandFactory};

use super::command::{commands, describe};
use super::roff::Page;
use super::sections::complete;

/// The part of pmacd.toml(5) that is written by hand, up to the lists of names.
const CONFIGURATION: &str = include_str!("../../systemd/man/pmacd.toml.5");

/// The page of the program that is no part of this package.
const GATEWAY: &str = include_str!("../../systemd/man/pmac-gateway.8");
const WEB: &str = include_str!("../../systemd/man/pmac-web.8");

/// The programs.
pub fn programs() -> [Command; 3] {
    let pmacd = pmac_dpram::daemon::options::Options::command();
    let pmac_sim = pmac_dpram::sim::process::options::Options::command();
    [pmacd, pmac_sim, pmac_dpram::cli::command()]
}

/// The pages: one of each program, of each command of pmacctl, of the configuration, and of the gateway.
pub fn pages() -> Vec<(String, String)> {
    let mut pages = Vec::new();
    for mut program in programs() {
        program.build();
        let section = if program.get_name() == "pmacd" { "8" } else { "1" };
        pages.push(page(&program, section));
        pages.extend(commands(&program).map(|command| page(command, section)));
    }
    let mut configuration = Page::from(CONFIGURATION);
    complete(&mut configuration, "pmacd.toml");
    pages.push(("pmacd.toml.5".to_owned(), configuration.finish()));
    pages.push(("pmac-gateway.8".to_owned(), GATEWAY.to_owned()));
    pages.push(("pmac-web.8".to_owned(), WEB.to_owned()));
    pages
}

fn page(command: &Command, section: &str) -> (String, String) {
    let name = command.get_display_name().unwrap_or_else(|| command.get_name());
    let manual = if section == "8" { "System administration" } else { "PMAC boards" };
    let mut page = Page::new(name, section, manual);
    describe(&mut page, command);
    complete(&mut page, name);
    (format!("{name}.{section}"), page.finish())
}
