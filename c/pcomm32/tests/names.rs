//! The names of the library, their table in `functions.tsv`, and the page that shows it.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// How many names the vendor's loader resolves: it gives up if one is missing.
const IN_LOADER: usize = 246;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// A row of the table.
struct Function {
    is_in_loader: bool,
    works: bool,
    note: String,
}

fn table() -> BTreeMap<String, Function> {
    let text = fs::read_to_string(root().join("functions.tsv")).unwrap();
    let rows = text.lines().skip(1).map(|line| {
        let [name, in_loader, state, note] = line.split('\t').collect::<Vec<_>>()[..] else {
            panic!("{line}")
        };
        assert!(["y", "n"].contains(&in_loader) && ["works", "error"].contains(&state), "{line}");
        let row = Function { is_in_loader: in_loader == "y", works: state == "works", note: note.to_owned() };
        (name.to_owned(), row)
    });
    rows.collect()
}

/// The library. No Rust program can link it, so cargo does not build it for a test.
fn library() -> PathBuf {
    let build = ["build", "--locked", "--quiet", "-p", "pmac-dpram-pcomm32"];
    assert!(Command::new(env!("CARGO")).args(build).current_dir(root()).status().unwrap().success());
    std::env::current_exe().unwrap().ancestors().nth(2).unwrap().join("libPComm32W.so")
}

#[test]
fn the_library_exports_the_names_of_the_table_and_no_others() {
    let listed = Command::new("nm").args(["-D", "--defined-only"]).arg(library()).output().unwrap();
    assert!(listed.status.success(), "{}", String::from_utf8_lossy(&listed.stderr));
    let listed = String::from_utf8(listed.stdout).unwrap();
    let exported: BTreeSet<&str> = listed.lines().filter_map(|line| line.split_whitespace().nth(2)).collect();
    let table = table();
    let named: BTreeSet<&str> = table.keys().map(String::as_str).collect();
    assert_eq!(exported, named);
    assert_eq!(table.values().filter(|function| function.is_in_loader).count(), IN_LOADER);
}

#[test]
fn the_table_calls_an_error_what_is_one() {
    let stubs = fs::read_to_string(root().join("src/exports/stubs.rs")).unwrap();
    let rows = stubs.lines().filter_map(|line| line.strip_prefix("        "));
    let mut stubs: BTreeSet<&str> = rows.filter_map(|line| Some(line.split_once('(')?.0)).collect();
    // This function says so by itself.
    stubs.insert("PmacConfigure");
    for (name, function) in table() {
        assert_eq!(function.works, !stubs.contains(name.as_str()), "{name}");
        assert!(function.works || !function.note.is_empty(), "{name}: why?");
    }
}

#[test]
fn the_page_has_the_table() {
    let page = fs::read_to_string(root().join("../../docs/pcomm32.md")).unwrap();
    let is_row = |line: &&str| line.starts_with("| `") && line.matches('|').count() == 4;
    let shown: Vec<&str> = page.lines().filter(is_row).collect();
    let mut rows: Vec<String> = Vec::new();
    for (name, Function { is_in_loader, works, note }) in table() {
        let mark = if is_in_loader { "" } else { "*" };
        let state = if works { "works" } else { "error" };
        rows.push(format!("| `{name}`{mark} | {state} | {note} |"));
    }
    rows.sort_by_key(|row| row.to_lowercase());
    let all = rows.join("\n");
    assert!(shown == rows, "docs/pcomm32.md wants these rows:\n{all}");
}
