//! What a program has to build that wants only a part of this package.

use std::collections::BTreeSet;
use std::process::Command;

/// The most crates that a program with the client library alone builds, this package included, build-time macros not.
const CLIENT_CRATES: usize = 15;

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
fn the_daemon_brings_nothing_for_terminals() {
    let daemon = crates("daemon");
    for of_pmacctl in ["jiff", "ratatui", "rustix", "rustyline", "tar"] {
        assert!(!daemon.contains(of_pmacctl), "{of_pmacctl} is in {daemon:?}");
    }
    assert!(daemon.contains("caps"), "{daemon:?}");
}
