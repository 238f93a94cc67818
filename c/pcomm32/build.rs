//! The name in the library itself; and a program may unload the library while a thread of a stream or a callback runs.

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rustc-cdylib-link-arg=-Wl,-soname,libPComm32W.so,-z,nodelete");
}
