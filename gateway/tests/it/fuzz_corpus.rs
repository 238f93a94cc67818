//! What the fuzzer found worth keeping, once more: every input of `fuzz/corpus/gateway` and `fuzz/regressions/gateway`. The long runs
//! are `fuzz/run`'s.

use std::path::Path;

#[path = "../../../fuzz/src/gateway.rs"]
mod gateway;

#[test]
fn what_clients_send_is_answered_or_ends_them() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz");
    let below = |kind: &str| std::fs::read_dir(root.join(kind).join("gateway")).into_iter().flatten();
    let mut count = 0;
    for entry in below("corpus").chain(below("regressions")) {
        gateway::body(&std::fs::read(entry.unwrap().path()).unwrap());
        count += 1;
    }
    assert!(count >= 10, "only {count} inputs were kept");
}
