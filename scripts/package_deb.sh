#!/usr/bin/env bash
# Builds the Debian package: softtwin, softtwind, softtwin-demo, services, udev rule, man pages, shell completions, models under
# /usr/share/softtwin, configuration under /etc/softtwin that an upgrade keeps, the C library with its headers, that of FMUs.
#   scripts/package_deb.sh OUT [--profile dev|light|release] [--gateway]       default: release
# --gateway builds a second package, softtwin-gateway. Needs Rust, a C compiler, dpkg-deb.
set -euo pipefail
out=${1:?package_deb.sh needs a folder: scripts/package_deb.sh OUT}
shift
profile=release gateway=
while [ $# -gt 0 ]; do
    case "$1" in
        --profile) profile=${2:?--profile needs a name}; shift 2 ;;
        --gateway) gateway=yes; shift ;;
        *) echo "package_deb.sh: expected --profile or --gateway, found $1" >&2; exit 2 ;;
    esac
done
mkdir -p "$out"
out=$(cd "$out" && pwd)
cd "$(dirname "${BASH_SOURCE[0]}")/.."
folder=${CARGO_TARGET_DIR:-target}/$([ "$profile" = dev ] && echo debug || echo "$profile")
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -1)
architecture=$(dpkg --print-architecture)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# units ROOT UNIT... : services with the folders of a package.
units() {
    local unit
    mkdir -p "$1/usr/lib/systemd/system"
    for unit in "${@:2}"; do
        sed 's|/usr/local/bin/|/usr/bin/|; /^# Install (once/,/^#   systemctl enable/d; /^# Installation:/d' "config/systemd/$unit" \
            > "$1/usr/lib/systemd/system/$unit"
    done
}

# control ROOT NAME DEPENDS DESCRIPTION : what dpkg wants to know, with every file of /etc as a configuration file.
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

# package ROOT NAME
package() {
    chmod -R go-w,a+rX "$1"
    # A package that is only tried is not worth a minute of compressing it.
    local quick=()
    [ "$profile" = release ] || quick=(-Zgzip -z1)
    dpkg-deb --root-owner-group "${quick[@]}" --build "$1" "$out/$2_${version}_$architecture.deb" >/dev/null
    echo "$out/$2_${version}_$architecture.deb"
}

root=$work/softtwin
cargo build --locked --quiet --profile "$profile" -p softtwind -p softtwin --bins
mkdir -p "$root/usr/bin"
for program in softtwin softtwind softtwin-demo; do strip -o "$root/usr/bin/$program" "$folder/$program"; done
install -d "$root/usr/lib/softtwin"
strip --strip-unneeded -o "$root/usr/lib/softtwin/libfmu.so" "$folder/deps/libfmu.so"
DESTDIR=$root scripts/install_c.sh /usr --profile "$profile" >/dev/null
scripts/share.sh "$root/usr/share/softtwin"
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
# The scenes again, to be changed: their models and traces stay below /usr/share.
install -D -m 644 -t "$root/etc/softtwin" config/twin.toml
for scene in config/scenes/*.toml; do
    sed 's|"\.\./\.\./models/|"/usr/share/softtwin/models/|; s|"\.\./traces/|"/usr/share/softtwin/config/traces/|; s|config/scenes/|/etc/softtwin/|' \
        "$scene" > "$root/etc/softtwin/$(basename "$scene")"
done
control "$root" softtwin "libc6, libgcc-s1, procps, systemd" "digital twin runtime of soft pneumatic actuators
 From pressure and gap to the whole deformed, stressed body in shared memory, as a real-time service."
install -m 755 packaging/postinst "$root/DEBIAN/postinst"
package "$root" softtwin
[ -n "$gateway" ] || exit 0

root=$work/gateway
cargo build --locked --quiet --profile "$profile" -p gateway --features network
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
