//! Measures the driver beside its peers. Absolute times depend on the machine and on what else runs there; ratios of interleaved rounds
//! of one run are what is told.

mod allocation;
mod bare;
mod bare_board;
mod clock;
mod commands;
mod daemon;
mod errors;
mod growth;
mod machine;
mod poll;
mod process;
mod rig;
mod segment;
mod table;
mod turbo;

const USAGE: &str =
    "usage: pmac-dpram-bench segment [ROUNDS [CHECKED-COPIES [PAGES]]]   (h hot, f fresh, w wake, l loss)
       pmac-dpram-bench daemon [ROUNDS [SECONDS]]
       pmac-dpram-bench bare [ROUNDS [SECONDS]]
       pmac-dpram-bench commands [ROUNDS]
       pmac-dpram-bench errors [ROUNDS]
       pmac-dpram-bench poll [ROUNDS]
       pmac-dpram-bench turbo [SECONDS]
       pmac-dpram-bench allocation [SECONDS]
       pmac-dpram-bench growth [SECONDS-PER-LINE]";

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |index: usize, otherwise: u64| {
        arguments.get(index).map_or(otherwise, |text| text.parse().unwrap_or(otherwise))
    };
    match arguments.first().map(String::as_str) {
        Some("segment") => {
            let only = arguments.get(3).map_or("hfwl", String::as_str);
            segment::run(number(1, 9) as usize, number(2, 100_000_000), only);
        }
        Some("daemon") => daemon::run(number(1, 3) as usize, number(2, 5)),
        Some("growth") => growth::run(number(1, 4)),
        Some("commands") => commands::run(number(1, 5) as usize),
        Some("errors") => errors::run(number(1, 3) as usize),
        Some("bare") => exit(bare::run(number(1, 5) as usize, number(2, 5))),
        Some("poll") => exit(poll::run(number(1, 5) as usize)),
        Some("turbo") => exit(turbo::run(number(1, 60))),
        Some("allocation") => exit(allocation::run(number(1, 10))),
        _ => {
            eprintln!("{USAGE}");
            std::process::exit(2);
        }
    }
}

/// Ends the program with status 1 unless all is `well`.
fn exit(well: bool) {
    if !well {
        std::process::exit(1);
    }
}
