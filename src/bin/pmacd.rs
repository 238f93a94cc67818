//! The daemon that owns the board. See [`pmac_dpram::daemon`].

fn main() -> std::process::ExitCode {
    pmac_dpram::daemon::main()
}
