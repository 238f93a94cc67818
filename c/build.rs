//! Gives the shared library its SONAME, and every symbol that name as its version. The library stays in memory: a program
//! may unload it while a thread of the library renews a jog.

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    if std::env::var("CARGO_CFG_TARGET_ENV").as_deref() != Ok("gnu") {
        return;
    }
    // rustc's own version script is anonymous, and no linker takes a second script with names. GNU ld makes the versions
    // without a script.
    for argument in ["-Wl,-soname,libpmac_dpram.so.1,-z,nodelete", "-fuse-ld=bfd", "-Wl,--default-symver"] {
        println!("cargo:rustc-cdylib-link-arg={argument}");
    }
}
