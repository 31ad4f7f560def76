#!/usr/bin/env bash
# Installs the C and C++ client: libsofttwin (shared and static), softtwin.h, softtwin_layout.h, softtwin.hpp,
# softtwin.pc.
#   scripts/install_c.sh PREFIX [--profile dev|release]        default: release
#   PKG_CONFIG_PATH=PREFIX/lib/pkgconfig pkg-config --cflags --libs softtwin
set -euo pipefail
prefix=${1:?install_c.sh needs a folder: scripts/install_c.sh PREFIX}
profile=release
if [ "${2:-}" = --profile ]; then profile=${3:?--profile needs a name}; fi
mkdir -p "$prefix"
prefix=$(cd "$prefix" && pwd)
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# The everyday build takes the whole workspace, so that nothing is compiled twice.
if [ "$profile" = dev ]; then cargo build --locked --quiet --workspace; else cargo build --locked --quiet --profile "$profile" -p capi; fi
folder=${CARGO_TARGET_DIR:-target}/$([ "$profile" = dev ] && echo debug || echo "$profile")
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -1)
mkdir -p "$prefix/lib/pkgconfig" "$prefix/include"
cp "$folder/libcapi.so" "$prefix/lib/libsofttwin.so.0"
ln -sf libsofttwin.so.0 "$prefix/lib/libsofttwin.so"
cp "$folder/libcapi.a" "$prefix/lib/libsofttwin.a"
cp crates/capi/include/softtwin{,_layout}.h crates/capi/include/softtwin.hpp "$prefix/include/"
sed "s|@PREFIX@|$prefix|; s|@VERSION@|$version|" clients/c/softtwin.pc.in > "$prefix/lib/pkgconfig/softtwin.pc"
echo "installed libsofttwin $version to $prefix"
