//! What a program has to build that wants only a part of this package.

use std::collections::BTreeSet;
use std::process::Command;

/// The most crates that a program with the client library alone builds, this package included, build-time macros not.
const CLIENT_CRATES: usize = 15;

/// What pmacd links, this package included, build-time macros not. It owns a machine: each crate more is a decision.
const DAEMON_CRATES: [&str; 32] = [
    "anstyle",
    "bitflags",
    "caps",
    "cfg-if",
    "clap",
    "clap_builder",
    "clap_lex",
    "env_filter",
    "env_logger",
    "errno",
    "itoa",
    "libc",
    "linux-raw-sys",
    "log",
    "memchr",
    "memmap2",
    "memoffset",
    "nix",
    "pmac-dpram",
    "rustix",
    "serde",
    "serde_core",
    "serde_json",
    "serde_spanned",
    "signal-hook",
    "signal-hook-registry",
    "thiserror",
    "toml",
    "toml_datetime",
    "toml_parser",
    "winnow",
    "zmij",
];

/// The crates that a build with `features` alone links.
fn crates(features: &str) -> BTreeSet<String> {
    let output = Command::new(env!("CARGO"))
        .args(["tree", "--offline", "--locked", "--edges", "normal,no-proc-macro", "--prefix", "none"])
        .args(["--no-default-features", "--features", features])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    let name = |line: &str| line.split(' ').next().unwrap().to_owned();
    text.lines().filter(|line| !line.is_empty()).map(name).collect()
}

#[test]
fn a_client_builds_few_crates() {
    let client = crates("client");
    assert!(client.len() <= CLIENT_CRATES, "{} crates: {client:?}", client.len());
    assert!(client.contains("serde_json"), "{client:?}");
}

#[test]
fn the_daemon_links_these_crates_and_no_other() {
    let (daemon, known) = (crates("daemon"), BTreeSet::from(DAEMON_CRATES.map(str::to_owned)));
    let more: Vec<_> = daemon.difference(&known).collect();
    assert!(more.is_empty(), "pmacd links {more:?}, too: do without, or add it to DAEMON_CRATES and say why");
    let gone: Vec<_> = known.difference(&daemon).collect();
    assert!(gone.is_empty(), "pmacd no longer links {gone:?}: take it out of DAEMON_CRATES");
}

#[test]
fn every_package_and_the_readme_name_the_same_oldest_rust() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let read = |path: &str| std::fs::read_to_string(root.join(path)).unwrap();
    let oldest = env!("CARGO_PKG_RUST_VERSION");
    for package in ["", "c/", "c/pcomm32/", "gateway/", "web/", "benches/", "fuzz/", "python/"] {
        let manifest = read(&format!("{package}Cargo.toml"));
        assert!(manifest.contains(&format!("\nrust-version = \"{oldest}\"\n")), "{package}: {oldest}");
    }
    assert!(read("README.md").contains(&format!("Rust {oldest} or newer")), "{oldest}");
}
