#!/usr/bin/env bash
# Installs the C and C++ client: libsofttwin (shared, stripped, and static), softtwin.h, softtwin_layout.h, softtwin.hpp, and
# what pkg-config (softtwin) and CMake (find_package(softtwin)) need to find them.
#   scripts/install_c.sh PREFIX [--profile dev|light|release]        default: release
#   PKG_CONFIG_PATH=PREFIX/lib/pkgconfig pkg-config --cflags --libs softtwin
#   cmake -DCMAKE_PREFIX_PATH=PREFIX ...
# DESTDIR, when it is set, is written in front of PREFIX and into no file, as packages need it.
set -euo pipefail
prefix=${1:?install_c.sh needs a folder: scripts/install_c.sh PREFIX}
profile=release
if [ "${2:-}" = --profile ]; then profile=${3:?--profile needs a name}; fi
mkdir -p "${DESTDIR:-}$prefix"
[ -n "${DESTDIR:-}" ] || prefix=$(cd "$prefix" && pwd)
root=${DESTDIR:-}$prefix
[[ $root = /* ]] || root=$PWD/$root
cd "$(dirname "${BASH_SOURCE[0]}")/.."
packages=(-p capi)
# Beside other builds with softtwind, whose features it then shares: nothing is compiled twice.
if [ "$profile" = dev ] || [ -n "${DESTDIR:-}" ]; then packages+=(-p softtwind); fi
cargo build --locked --quiet --profile "$profile" "${packages[@]}"
folder=${CARGO_TARGET_DIR:-target}/$([ "$profile" = dev ] && echo debug || echo "$profile")
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -1)
mkdir -p "$root/lib/pkgconfig" "$root/lib/cmake/softtwin" "$root/include"
strip --strip-unneeded -o "$root/lib/libsofttwin.so.0" "$folder/libcapi.so"
ln -sf libsofttwin.so.0 "$root/lib/libsofttwin.so"
strip --strip-debug -o "$root/lib/libsofttwin.a" "$folder/libcapi.a"
cp crates/capi/include/softtwin{,_layout}.h crates/capi/include/softtwin.hpp "$root/include/"
sed "s|@PREFIX@|$prefix|; s|@VERSION@|$version|" clients/c/softtwin.pc.in > "$root/lib/pkgconfig/softtwin.pc"
for file in softtwin-config softtwin-config-version; do
    sed "s|@VERSION@|$version|" "clients/c/cmake/$file.cmake.in" > "$root/lib/cmake/softtwin/$file.cmake"
done
echo "installed libsofttwin $version to $root"
