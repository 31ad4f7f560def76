#!/usr/bin/env bash
# `softtwin view` in a real browser: headless Chromium against a live twin, and what people may do wrong with the page.
#   scripts/test_view.sh                       all checks
#   scripts/test_view.sh --picture FILE.png    also keeps the screenshot (docs/images/view.png is made by this)
# Needs Rust, a C compiler, Python 3 and Chromium (Debian: apt-get install chromium). CHROMIUM names another program.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
command -v python3 >/dev/null || { echo "test_view: python3 is not here" >&2; exit 1; }
cargo build --locked --quiet --workspace --bins
exec python3 scripts/test_view.py --programs "${CARGO_TARGET_DIR:-target}/debug" "$@"
