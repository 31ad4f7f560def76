#!/usr/bin/env bash
# Compiles the ROM crate for aarch64 and runs its tests under emulation: the NEON kernel against the plain reference.
#   scripts/test_aarch64.sh [test arguments]
# With an aarch64 target of the installed toolchain that target is used; without one (no rustup server in reach) Debian's own
# compiler and its arm64 standard library are unpacked into build/aarch64. Needs root for the cross linker the first time.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
target=aarch64-unknown-linux-gnu
need=()
command -v aarch64-linux-gnu-gcc >/dev/null || need+=(gcc-aarch64-linux-gnu)
command -v qemu-aarch64-static >/dev/null || need+=(qemu-user-static)
((${#need[@]} == 0)) || { apt-get update -qq && apt-get install -y -qq "${need[@]}"; }
if ! [ -d "$(rustc --print sysroot)/lib/rustlib/$target/lib" ]; then
    root=$PWD/build/aarch64
    if [ ! -x "$root/usr/bin/rustc" ]; then
        dpkg --print-foreign-architectures | grep -qx arm64 || dpkg --add-architecture arm64
        apt-get update -qq
        version=$(apt-cache show rustc-web | sed -n 's/^Version: //p' | sort -V | tail -1)
        runtime=libstd-rust-web-$(cut -d. -f1,2 <<<"$version")
        llvm=$(apt-cache depends "$runtime" | sed -n 's/.*Depends: \(libllvm[0-9]*\)$/\1/p')
        mkdir -p "$root/packages"
        (cd "$root/packages" && apt-get download -qq "rustc-web=$version" "$runtime=$version" "$llvm" \
            "libstd-rust-web-dev:amd64=$version" "libstd-rust-web-dev:arm64=$version")
        for package in "$root"/packages/*.deb; do dpkg -x "$package" "$root"; done
    fi
    export RUSTC=$root/usr/bin/rustc LD_LIBRARY_PATH=$root/usr/lib/x86_64-linux-gnu
fi
export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=aarch64-linux-gnu-gcc
export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER="qemu-aarch64-static -L /usr/aarch64-linux-gnu"
exec cargo test --locked --target "$target" --target-dir target/aarch64 -p rom --lib -- kernel "$@"
