//! What the fuzzer found worth keeping, once more: every input of `fuzz/corpus` and `fuzz/regressions` through the function
//! it was found with. The long runs are `fuzz/run`'s.

use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

#[path = "../../fuzz/src/lib.rs"]
mod targets;

/// The inputs of a target, by name.
fn inputs(target: &str) -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz");
    let below = |kind: &str| fs::read_dir(root.join(kind).join(target)).into_iter().flatten();
    let entries = below("corpus").chain(below("regressions"));
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    paths
}

fn replay(target: &str, body: fn(&[u8])) {
    let paths = inputs(target);
    assert!(paths.len() >= 10, "{target}: only {} inputs were kept", paths.len());
    let mut failed = Vec::new();
    for path in paths {
        let input = fs::read(&path).unwrap();
        if catch_unwind(AssertUnwindSafe(|| body(&input))).is_err() {
            failed.push(path);
        }
    }
    assert!(failed.is_empty(), "{target}: {failed:#?}");
}

macro_rules! targets {
    ($($target:ident)*) => {$(
        #[test]
        fn $target() {
            replay(stringify!($target), targets::$target::body);
        }
    )*

    #[test]
    fn every_target_is_replayed_and_built() {
        let manifest = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/Cargo.toml")).unwrap();
        let built = manifest.lines().filter_map(|line| line.strip_prefix("path = \"targets/")?.strip_suffix(".rs\""));
        // The gateway is a package of its own, and so are its tests.
        let here = built.filter(|target| *target != "gateway");
        assert_eq!(here.collect::<Vec<_>>(), [$(stringify!($target)),*]);
    }
    };
}

targets! { board client config daemon files replies rotary segment service sim socket sysfs }
