#!/usr/bin/env bash
# Installs the Debian package in an empty root and the wheel in an empty environment, uses both outside the sources, and compiles the source
# distribution. Started by scripts/check.sh install.
#   --profile dev|light|release      default: dev
set -euo pipefail
profile=dev
if [ "${1:-}" = --profile ]; then profile=${2:?--profile needs a name}; fi
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
. scripts/setup.sh
fail() { echo "check.sh: $*" >&2; exit 1; }
work=$(mktemp -d)
trap 'kill $(jobs -p) 2>/dev/null || true; wait; rm -rf "$work"' EXIT
root=$work/root
before=$(git status --porcelain --ignored 2>/dev/null | grep -v '__pycache__\|\.pytest_cache\|_native' || true)

# demonstration PROGRAM...: runs it for three seconds in the root folder and checks that fields arrive.
demonstration() {
    local said
    said=$(cd / && "$@" --seconds 3 --json)
    python3 - "$said" <<'END' || fail "$1: the demonstration said $said"
import json, sys
said = json.loads(sys.argv[1])
assert said["entries"] == 125110 and said["fields_received"] > 100, said
END
    echo "check.sh: $1: $said"
}

scripts/package.sh deb "$work" --profile "$profile"
mkdir -p "$root/var/lib/dpkg"
touch "$root/var/lib/dpkg/status"
# The root has no other package; the package's script runs outside, with DPKG_ROOT.
dpkg() { command dpkg --root="$root" --log=/dev/null --force-depends --force-script-chrootless "$@" >"$work/dpkg.log" 2>&1 || { cat "$work/dpkg.log"; fail "dpkg $*"; }; }
dpkg --install "$work"/softtwin_*.deb
grep -q '^softtwin:' "$root/etc/passwd" || fail "the package made no user softtwin"
demonstration "$root/usr/bin/softtwin" demo
"$root/usr/bin/softtwin" export models/pneunet/pneunet.twin --out "$work/finger.fmu" || fail "the package exports no FMU"
# The services are checked with the units of this machine's systemd.
cp -rn /usr/lib/systemd/system/. "$root/usr/lib/systemd/system/"
install -D -t "$root/bin" /bin/sh /bin/kill
systemd-analyze --root="$root" --man=no verify softtwin-{twin,bridge,record}@finger.service 2>"$work/verify.log" || { cat "$work/verify.log"; fail "systemd-analyze verify"; }
! grep -i softtwin "$work/verify.log" || fail "systemd-analyze verify had something to say"
for path in $(grep -ho '"/usr/share/softtwin/[^"]*"' "$root"/etc/softtwin/*.toml | tr -d '"'); do
    [ -f "$root$path" ] || fail "a scene in /etc/softtwin names $path, which the package does not have"
done
for file in usr/share/man/man1/softtwin{,-train,d-twin}.1.gz usr/share/bash-completion/completions/softtwin \
    usr/lib/udev/rules.d/61-softtwin.rules usr/lib/cmake/softtwin/softtwin-config.cmake; do
    [ -f "$root/$file" ] || fail "the package has no /$file"
done
bash -n "$root/usr/share/bash-completion/completions/softtwin"
# An upgrade keeps changed configuration files.
echo '# mine' >> "$root/etc/softtwin/finger.toml"
dpkg --install "$work"/softtwin_*.deb
grep -q '^# mine$' "$root/etc/softtwin/finger.toml" || fail "installing again replaced a changed /etc/softtwin/finger.toml"

python3 -m venv "$work/venv"
client() { git status --porcelain --ignored clients/python | grep -v '__pycache__\|\.pytest_cache\|_native' || true; }
client_before=$(client)
PYTHON=$work/venv/bin/python scripts/package.sh wheel "$work" --profile "$profile"
[ "$client_before" = "$(client)" ] || fail "building the wheel left files in clients/python"
# A release is for other machines: an old glibc, and small enough to send. Other profiles are for this machine.
wheel=$(echo "$work"/softtwin-*.whl) tag=cp310-abi3-linux_
if [ "$profile" = release ]; then
    tag=cp310-abi3-*manylinux_2_17_
    [ "$(stat -c %s "$wheel")" -le 30000000 ] || fail "expected a wheel of at most 30 MB, found $(stat -c %s "$wheel") bytes: $wheel"
fi
[[ $wheel == *-$tag* ]] || fail "expected a wheel whose tag is $tag, found $wheel"
python3 -m venv "$work/clean"
"$work/clean/bin/pip" install --quiet --disable-pip-version-check "$work"/softtwin-*.whl
demonstration "$work/clean/bin/softtwin" demo
# The source distribution has every file that the compiler and the wheel's data need. What others wrote is compiled already.
PYTHON=$work/venv/bin/python scripts/package.sh sdist "$work"
mkdir "$work/source"
tar -xzf "$work"/softtwin-*.tar.gz -C "$work/source" --strip-components 1
target=$(realpath "${CARGO_TARGET_DIR:-target}")
# shellcheck disable=SC2046 # `network` prints no word or two
(cd "$work/source" && cargo check --locked --quiet --target-dir "$target" --workspace $(network) --bins --lib)
(cd "$work/source" && scripts/package.sh share "$work/share" pneunet)
diff -r "$work/share" "$work/clean/share/softtwin" || fail "the source distribution has other files than the wheel in share/softtwin"
export SOFTTWIN_DOMAIN=install$$ SOFTTWIN_ROOT=$work/iox
cd /
scene=$("$work/clean/bin/python" -c 'import softtwin; print(softtwin.shared_file("config/scenes/finger.toml"))')
"$work/clean/bin/softtwind" twin --scene "$scene" 2>"$work/twin.log" &
twin=$!
until grep -q ready: "$work/twin.log"; do
    kill -0 "$twin" 2>/dev/null || { cat "$work/twin.log"; fail "the wheel's twin did not start"; }
    sleep 0.1
done
"$work/clean/bin/softtwind" bridge --scene "$scene" --loop 2>"$work/bridge.log" &
"$work/clean/bin/python" - <<'END' || fail "the Python subscription"
import softtwin

for field in softtwin.subscribe("softtwin/finger/field", timeout_s=20.0):
    assert len(field.von_mises) == 25022, len(field.von_mises)
    print(f"check.sh: Python received field {field.header.seq}, largest stress {field.von_mises.max():.3f} MPa")
    break
model = softtwin.Model(softtwin.shared_file("models/pneunet/pneunet.twin"))
print(f"check.sh: Python predicts {model.predict(0.05, 30.0).contact_force_n:.4f} N without a daemon")
END
cd - >/dev/null
[ "$before" = "$(git status --porcelain --ignored 2>/dev/null | grep -v '__pycache__\|\.pytest_cache\|_native' || true)" ] || fail "the packages left files in the checkout: $(git status --porcelain --ignored)"
echo "check.sh: the Debian package and the wheel were built, installed and used, and the source distribution compiles"
