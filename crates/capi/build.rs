//! Gives the shared library the name that programs look for; `scripts/package.sh c` installs it under that name.

fn main() {
    if std::env::var("CARGO_CFG_TARGET_OS").as_deref() == Ok("linux") {
        println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,libsofttwin.so.0");
    }
    println!("cargo::rerun-if-changed=build.rs");
}
