//! The command line.

fn main() -> std::process::ExitCode {
    pmac_dpram::process::abort_on_panic();
    pmac_dpram::cli::run(std::env::args_os())
}
