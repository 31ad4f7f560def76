#!/usr/bin/env bash
# All tests: units, properties, golden files, multi-process stories. Needs Rust, a C compiler and strace.
#   scripts/test.sh              everything
#   scripts/test.sh NAME         only the tests whose name contains NAME
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# Multi-process tests start the two programs, so these are built first.
cargo build --locked --workspace --bins
exec cargo test --locked --workspace --no-fail-fast -- "$@"
