# shellcheck shell=bash
# Sourced by the other scripts. `require NAME...` checks that programs exist before anything is built: cargo, rust-tools, cc, c++, venv,
# or a program's name. As root on Debian or Ubuntu it installs those that are missing; otherwise it names the command in one line
# and exits with 1.

# present NAME: true if the program exists.
present() {
    case "$1" in
        rust-tools) cargo fmt --version && cargo clippy --version ;;
        venv) python3 -c 'import venv, ensurepip' ;;
        chromium) command -v "${CHROMIUM:-chromium}" ;;
        *) command -v "$1" ;;
    esac >/dev/null 2>&1
}

# package_of NAME: its packages in Debian and Ubuntu.
package_of() {
    case "$1" in
        cc) echo gcc libc6-dev ;;
        c++) echo g++ ;;
        venv) echo python3-venv ;;
        kill) echo procps ;;
        ccx) echo calculix-ccx ;;
        systemd-analyze | systemd-sysusers) echo systemd ;;
        dpkg-deb) echo dpkg ;;
        aarch64-linux-gnu-gcc) echo gcc-aarch64-linux-gnu ;;
        qemu-aarch64-static) echo qemu-user-static ;;
        *) echo "$1" ;;
    esac
}

require() {
    local name missing=() packages=() command= found=()
    for name in "$@"; do
        present "$name" && continue
        case "$name" in
            cargo) command="curl --proto '=https' --tlsv1.2 -sSf https://sh.rustup.rs | sh" ;;
            rust-tools)
                command="rustup component add rustfmt clippy"
                $command >&2 && continue
                ;;
            *)
                missing+=("$name")
                read -ra found <<<"$(package_of "$name")"
                packages+=("${found[@]}")
                continue
                ;;
        esac
        echo "$(basename "$0"): $name is not installed: $command" >&2
        exit 1
    done
    [ ${#missing[@]} -gt 0 ] || return 0
    command="apt-get install -y ${packages[*]}"
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
        echo "$(basename "$0"): $command" >&2
        if { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq "${packages[@]}"; } >&2; then
            for name in "${missing[@]}"; do
                present "$name" || { echo "$(basename "$0"): $name is not found after: $command" >&2; exit 1; }
            done
            return 0
        fi
    fi
    echo "$(basename "$0"): not installed: ${missing[*]}; on Debian or Ubuntu: sudo $command" >&2
    exit 1
}

# The option of cargo that builds the network gateway too, if SOFTTWIN_NETWORK is set.
network() { [ -z "${SOFTTWIN_NETWORK:-}" ] || echo --features gateway/network; }

# native_module: the built module where Python finds it beside the package's sources. Several checks do this at the same time: a module
# that is there stays, and another one takes its place in one step.
native_module() {
    local built=${CARGO_TARGET_DIR:-target}/debug/lib_native.so place=clients/python/src/softtwin/_native.abi3.so
    cmp -s "$built" "$place" || { cp -f "$built" "$place.$$" && mv -f "$place.$$" "$place"; }
}
