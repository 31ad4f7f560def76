#!/usr/bin/env bash
# Builds what is installed elsewhere. --profile dev|light|release, default: release.
#   scripts/package.sh deb OUT [--gateway]       Debian package: softtwin, softtwind, softtwin-demo, services, udev rule, man pages, shell
#                                                completions, models, configuration under /etc/softtwin that an upgrade keeps, C library with
#                                                headers, library of FMUs; --gateway: a second package, softtwin-gateway
#   scripts/package.sh wheel OUT [--target x86_64-unknown-linux-gnu|aarch64-unknown-linux-gnu]
#                                                Python wheel: the package with its native module, the programs, one model. A release, or what
#                                                --target names, runs on every Linux with glibc 2.17 or newer; other profiles are for this machine
#   scripts/package.sh sdist OUT                 Python source distribution: what the same wheel is compiled from, elsewhere
#   scripts/package.sh c PREFIX                  C and C++ client: libsofttwin (shared, static), headers, pkg-config and CMake files:
#                                                PKG_CONFIG_PATH=PREFIX/lib/pkgconfig pkg-config --cflags --libs softtwin
#                                                cmake -DCMAKE_PREFIX_PATH=PREFIX ...
#   scripts/package.sh share FOLDER [MODEL...]   content of share/softtwin: scenes, traces, settings, models (default: every model)
# Needs Rust and a C compiler; deb: dpkg-deb; wheel and sdist: Python 3.10 or newer with pip.
set -euo pipefail
usage() { sed -n '2,14s/^# \{0,1\}//p' "$0" >&2; exit 2; }
[ $# -ge 2 ] || usage
what=$1
mkdir -p "$2"
out=$(cd "$2" && pwd)
shift 2
cd "$(dirname "${BASH_SOURCE[0]}")/.."
profile=release gateway= target= models=()
while [ $# -gt 0 ]; do
    case "$1" in
        --profile) profile=${2:?--profile needs a name}; shift 2 ;;
        --gateway) gateway=yes; shift ;;
        --target) target=${2:?--target needs a name}; shift 2 ;;
        -*) usage ;;
        *) models+=("$1"); shift ;;
    esac
done
folder=${CARGO_TARGET_DIR:-target}/$([ "$profile" = dev ] && echo debug || echo "$profile")
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -1)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
. scripts/setup.sh
require cargo cc

# compile ARGUMENT...: skipped if SOFTTWIN_BUILT says that the profile dev is built.
compile() {
    [ "$profile ${SOFTTWIN_BUILT:-}" = "dev 1" ] || cargo build --locked --quiet --profile "$profile" "$@"
}

# share FOLDER MODEL...
share() {
    local model scene complete
    install -D -m 644 -t "$1/config" config/*.toml
    install -D -m 644 -t "$1/config/traces" config/traces/*.csv
    mkdir -p "$1/config/scenes"
    for model in "${@:2}"; do
        install -D -m 644 -t "$1/models/$model" "models/$model"/{"$model.twin","$model.json","$model.card.json",actuator.toml}
    done
    for scene in config/scenes/*.toml; do
        # Only scenes whose models are there.
        complete=yes
        for model in $(sed -n 's|^model = "../../models/\([^/]*\)/.*|\1|p' "$scene"); do
            [ -f "$1/models/$model/$model.twin" ] || complete=
        done
        [ -z "$complete" ] || install -m 644 -t "$1/config/scenes" "$scene"
    done
}

# c_client ROOT PREFIX: installs to ROOT/PREFIX; ROOT is written into no file.
c_client() {
    local root=$1$2 prefix=$2 file
    # With softtwind, whose features it then shares: nothing is compiled twice.
    compile -p capi -p softtwind
    mkdir -p "$root/lib/pkgconfig" "$root/lib/cmake/softtwin" "$root/include"
    strip --strip-unneeded -o "$root/lib/libsofttwin.so.0" "$folder/libcapi.so"
    ln -sf libsofttwin.so.0 "$root/lib/libsofttwin.so"
    strip --strip-debug -o "$root/lib/libsofttwin.a" "$folder/libcapi.a"
    cp crates/capi/include/softtwin{,_layout}.h crates/capi/include/softtwin.hpp "$root/include/"
    sed "s|@PREFIX@|$prefix|; s|@VERSION@|$version|" clients/c/softtwin.pc.in >"$root/lib/pkgconfig/softtwin.pc"
    for file in softtwin-config softtwin-config-version; do
        sed "s|@VERSION@|$version|" "clients/c/cmake/$file.cmake.in" >"$root/lib/cmake/softtwin/$file.cmake"
    done
    echo "installed libsofttwin $version to $root"
}

# Code for browsers, where the compiler has the library for it; without it `softtwin export` makes no pages.
page() { scripts/page.sh >&2 || echo "package.sh: exported pages are left out of this package" >&2; }

wheel() {
    local arguments="--profile $profile"
    page
    # The compiler of this machine links against this machine's glibc; zig links against an old one, for either processor.
    if [ "$profile" = release ] || [ -n "$target" ]; then
        target=${target:-$(rustc -vV | sed -n 's/^host: //p')}
        [ -d "$(rustc --print target-libdir --target "$target")" ] ||
            { echo "package.sh: rustc has no libraries for this processor; \`rustup target add $target\`" >&2; exit 1; }
        arguments+=" --target $target --compatibility manylinux_2_17"
    fi
    MATURIN_PEP517_ARGS=$arguments "${PYTHON:-python3}" -m pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir "$out" clients/python
    ls "$out"/softtwin-*.whl
}

sdist() {
    page
    "${PYTHON:-python3}" -m pip install --quiet --disable-pip-version-check --target "$work/build" build
    PYTHONPATH=$work/build "${PYTHON:-python3}" -m build --sdist --outdir "$out" clients/python >"$work/sdist.log" 2>&1 ||
        { cat "$work/sdist.log" >&2; exit 1; }
    ls "$out"/softtwin-*.tar.gz
}

# units ROOT UNIT...: services with the folders of a package.
units() {
    local unit
    mkdir -p "$1/usr/lib/systemd/system"
    for unit in "${@:2}"; do
        sed 's|/usr/local/bin/|/usr/bin/|; /^# Install (once/,/^#   systemctl enable/d; /^# Installation:/d' "config/systemd/$unit" \
            > "$1/usr/lib/systemd/system/$unit"
    done
}

# control ROOT NAME DEPENDS DESCRIPTION: metadata of a package; every file of /etc is a configuration file.
control() {
    mkdir -p "$1/DEBIAN"
    (cd "$1" && find etc -type f -printf '/%p\n' 2>/dev/null | sort) > "$1/DEBIAN/conffiles"
    cat > "$1/DEBIAN/control" <<END
Package: $2
Version: $version
Architecture: $architecture
Maintainer: softtwin maintainers <softtwin@localhost>
Installed-Size: $(du -sk "$1" | cut -f1)
Depends: $3
Section: science
Priority: optional
Description: $4
END
}

# package ROOT NAME: builds the .deb.
package() {
    chmod -R go-w,a+rX "$1"
    # Compressing well takes a minute.
    local quick=()
    [ "$profile" = release ] || quick=(-Zgzip -z1)
    dpkg-deb --root-owner-group "${quick[@]}" --build "$1" "$out/$2_${version}_$architecture.deb" >/dev/null
    echo "$out/$2_${version}_$architecture.deb"
}

deb() {
    local root=$work/softtwin program scene
    page
    compile -p softtwind -p softtwin --bins
    mkdir -p "$root/usr/bin"
    for program in softtwin softtwind softtwin-demo; do strip -o "$root/usr/bin/$program" "$folder/$program"; done
    install -d "$root/usr/lib/softtwin"
    strip --strip-unneeded -o "$root/usr/lib/softtwin/libfmu.so" "$folder/deps/libfmu.so"
    c_client "$root" /usr >/dev/null
    share "$root/usr/share/softtwin" "${models[@]}"
    units "$root" softtwin-{twin,bridge,record}@.service
    install -D -m 644 packaging/softtwin.sysusers "$root/usr/lib/sysusers.d/softtwin.conf"
    install -D -m 644 packaging/softtwin.tmpfiles "$root/usr/lib/tmpfiles.d/softtwin.conf"
    install -D -m 644 packaging/softtwin.rules "$root/usr/lib/udev/rules.d/61-softtwin.rules"
    "$folder/softtwin" manual --out "$work/manual"
    mkdir -p "$root/usr/share/man"
    cp -r "$work/manual/man1" "$root/usr/share/man/"
    gzip -9n "$root"/usr/share/man/man1/*
    for program in softtwin softtwind softtwin-demo; do
        install -D -m 644 "$work/manual/completions/$program.bash" "$root/usr/share/bash-completion/completions/$program"
        install -D -m 644 "$work/manual/completions/_$program" "$root/usr/share/zsh/vendor-completions/_$program"
        install -D -m 644 "$work/manual/completions/$program.fish" "$root/usr/share/fish/vendor_completions.d/$program.fish"
    done
    install -D -m 644 LICENSE-MIT "$root/usr/share/doc/softtwin/copyright"
    install -D -m 644 -t "$root/usr/share/doc/softtwin" README.md OPERATIONS.md CHANGELOG.md LICENSE-APACHE
    # Scenes to be changed; their models and traces are below /usr/share.
    install -D -m 644 -t "$root/etc/softtwin" config/twin.toml
    for scene in config/scenes/*.toml; do
        sed 's|"\.\./\.\./models/|"/usr/share/softtwin/models/|; s|"\.\./traces/|"/usr/share/softtwin/config/traces/|; s|config/scenes/|/etc/softtwin/|' \
            "$scene" > "$root/etc/softtwin/$(basename "$scene")"
    done
    control "$root" softtwin "libc6, libgcc-s1, procps, systemd" "digital twin runtime of soft pneumatic actuators
 From pressure and gap to the whole deformed, stressed body in shared memory, as a real-time service."
    install -m 755 packaging/postinst "$root/DEBIAN/postinst"
    package "$root" softtwin
    [ -n "$gateway" ] || return 0

    root=$work/gateway
    compile -p gateway --features network
    mkdir -p "$root/usr/bin"
    strip -o "$root/usr/bin/softtwin-gateway" "$folder/softtwin-gateway"
    units "$root" softtwin-gateway.service
    install -D -m 644 -t "$root/etc/softtwin" config/gateway.toml
    mkdir -p "$root/usr/share/man/man1"
    "$folder/softtwin-gateway" --manual "$root/usr/share/man/man1"
    gzip -9n "$root"/usr/share/man/man1/*
    control "$root" softtwin-gateway "libc6, libgcc-s1, softtwin (= $version)" "network gateway of softtwin
 The shared-memory topics of this machine's twins on a Zenoh network."
    package "$root" softtwin-gateway
}

all_models() { for file in models/*/*.twin; do basename "$(dirname "$file")"; done; }
[ ${#models[@]} -gt 0 ] || mapfile -t models < <(all_models)
case "$what" in
    deb)
        architecture=$(dpkg --print-architecture)
        deb
        ;;
    wheel) wheel ;;
    sdist) sdist ;;
    c) c_client "" "$out" ;;
    share) share "$out" "${models[@]}" ;;
    *) usage ;;
esac
