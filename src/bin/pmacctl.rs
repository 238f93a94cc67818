//! The command line.

fn main() -> std::process::ExitCode {
    pmac_dpram::cli::run(std::env::args_os())
}
