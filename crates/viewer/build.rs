//! Takes the module of exported pages into the program where `scripts/page.sh` has made it; everything else builds without.

use std::path::Path;
use std::{env, fs, io};

fn main() -> io::Result<()> {
    const MODULE: &str = "page.wasm";
    println!("cargo::rerun-if-changed={MODULE}");
    let out = env::var_os("OUT_DIR").ok_or_else(|| io::Error::other("cargo gives a build script OUT_DIR"))?;
    let module = if Path::new(MODULE).exists() { fs::read(MODULE)? } else { Vec::new() };
    fs::write(Path::new(&out).join(MODULE), module)
}
