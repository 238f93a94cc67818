//! The daemon that owns the board. See [`pmac_dpram::daemon`].

fn main() -> std::process::ExitCode {
    pmac_dpram::process::abort_on_panic();
    pmac_dpram::daemon::main()
}
