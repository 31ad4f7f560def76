#!/usr/bin/env bash
# Installs the C and C++ client into a fresh folder, builds the examples as docs/clients/c.md says, and runs both beside a twin.
#   scripts/test_c_install.sh        needs cc, c++ and pkg-config
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. scripts/lib.sh
work=$(mktemp -d)
trap 'kill $(jobs -p) 2>/dev/null || true; wait; rm -rf "$work"' EXIT
scripts/install_c.sh "$work/prefix" --profile dev
export PKG_CONFIG_PATH=$work/prefix/lib/pkgconfig LD_LIBRARY_PATH=$work/prefix/lib
read -ra flags < <(pkg-config --cflags --libs softtwin)
cc -std=c11 -Wall -Werror clients/c/examples/twin.c "${flags[@]}" -lm -o "$work/twin_c"
c++ -std=c++17 -Wall -Werror clients/c/examples/twin.cpp "${flags[@]}" -o "$work/twin_cpp"
folder=$(programs dev)
export SOFTTWIN_DOMAIN=cinstall$$ SOFTTWIN_ROOT=$work/iox
sed "s#\.\./\.\./models#$PWD/models#; s#\.\./traces#$PWD/config/traces#; s#^loop = false#loop = true#" config/scenes/finger.toml >"$work/scene.toml"
ready "$work/twin.log" "$folder/softtwind" twin --scene "$work/scene.toml"
ready "$work/bridge.log" "$folder/softtwind" bridge --scene "$work/scene.toml"
for program in twin_c twin_cpp; do
    "$work/$program" finger | tee "$work/$program.out"
    grep -q '^field' "$work/$program.out" || { echo "test_c_install: $program printed no field" >&2; exit 1; }
done
echo "test_c_install: installed, found by pkg-config, compiled and run"
