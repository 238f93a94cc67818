//! The committed header is the one that the functions of `src/border` make.

use std::fs;
use std::path::{Path, PathBuf};

/// Set: write the header, and compare nothing.
const WRITE: &str = "PMAC_WRITE_HEADER";
/// The source with what C sees, in the header's order.
const SOURCES: [&str; 12] = [
    "failure",
    "types",
    "board",
    "snapshot",
    "updates",
    "streams",
    "replies",
    "sequences",
    "border/board",
    "border/updates",
    "border/commands",
    "border/values",
];

fn source(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("src/{name}.rs"))
}

/// The header as cbindgen makes it, in C of 1989: no comma at an enum's end, no comment by slashes. A comment of one line
/// takes one.
fn made() -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut config = cbindgen::Config::from_file(root.join("cbindgen.toml")).unwrap();
    config.header = Some(include_str!("header.txt").trim_end().to_owned());
    let builder = cbindgen::Builder::new().with_config(config);
    let builder = SOURCES.iter().fold(builder, |builder, name| builder.with_src(source(name)));
    let mut made = Vec::new();
    builder.generate().unwrap().write(&mut made);
    let mut text = String::from_utf8(made).unwrap();
    for (from, to) in [
        (",\n} ", "\n} "),
        ("PMAC_STATUS_", "PMAC_"),
        ("#endif  // __cplusplus", "#endif"),
        ("#endif // __cplusplus", "#endif"),
        ("}  // extern \"C\"", "}"),
    ] {
        text = text.replace(from, to);
    }
    let mut lines: Vec<String> = Vec::new();
    for line in text.trim_start().lines() {
        if let [.., opening, comment] = lines.as_slice()
            && line.trim() == "*/"
            && opening.trim() == "/*"
        {
            let short = format!("{} {} */", opening, comment.trim());
            lines.truncate(lines.len() - 2);
            lines.push(short);
        } else {
            lines.push(line.to_owned());
        }
    }
    lines.join("\n") + "\n"
}

#[test]
fn the_header_is_made_of_the_functions() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("include/pmac_dpram.h");
    let made = made();
    if std::env::var_os(WRITE).is_some() {
        fs::write(&path, &made).unwrap();
    }
    let there = fs::read_to_string(&path).unwrap();
    assert_eq!(there, made, "write the header anew: {WRITE}=1 cargo test -p pmac-dpram-c");
}

#[test]
fn every_exported_function_is_in_the_header_and_in_the_manual_page() {
    let header = made();
    let page = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("man/pmac_dpram.3")).unwrap();
    let mut count = 0;
    for name in SOURCES {
        let text = fs::read_to_string(source(name)).unwrap();
        for rest in text.split("extern \"C\" fn ").skip(1).filter(|rest| rest.starts_with("pmac_")) {
            let function = rest.split('(').next().unwrap();
            assert!(header.contains(&format!("{function}(")), "{function} is not in the header");
            assert!(page.contains(function), "{function} is not in the manual page");
            count += 1;
        }
    }
    assert!(count > 40, "{count}");
}
