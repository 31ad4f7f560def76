#!/usr/bin/env bash
# The code of exported pages (`softtwin export MODEL --out PAGE.html`), compiled for browsers; the next build of softtwin takes it in.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
target=wasm32-unknown-unknown
[ -d "$(rustc --print target-libdir --target $target)" ] ||
    { echo "page.sh: rustc has no libraries for browsers; \`rustup target add $target\`" >&2; exit 1; }
RUSTFLAGS='-C target-feature=+simd128' cargo rustc --locked --release --package page --target $target --crate-type cdylib
cp "${CARGO_TARGET_DIR:-target}/$target/release/page.wasm" crates/viewer/page.wasm
