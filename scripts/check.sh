#!/usr/bin/env bash
# Checks that scripts/test.sh does not have: the programs as others use them, and what takes hours.
#   scripts/check.sh view                        `softtwin view` in headless Chromium (CHROMIUM names another program)
#   scripts/check.sh view --screenshots DIR      instead: pictures in five sizes, light and dark, in every mode [--only MODE]
#   scripts/check.sh view --film FILE.webp       instead: the README's moving picture, docs/images/view.webp
#   scripts/check.sh view --rate                 instead: frames per second that the browser draws
#   scripts/check.sh actuators                   three new actuators, each from `softtwin new` to a running twin; a mesh of a CAD file
#   scripts/check.sh exports                     every export read by meshio and numpy and compared with `softtwin predict`
#   scripts/check.sh calculix [--finer-mm 3 1.5] a finger solved by `softtwin simulate` and by CalculiX
#   scripts/check.sh batch                       config/batch: a small list of cases as a SLURM array and by Snakemake on two cores
#   scripts/check.sh benchmark                   two tasks of `benchmarks`: softtwin beside a polynomial, without all peers
#   scripts/check.sh clients [pytest arguments]  the Python client against running twins
#   scripts/check.sh documents [PAGE...]         the shell blocks of the documents run; those that do not are listed with the reason
#   scripts/check.sh documents long [PAGE...]    the pages with blocks that take minutes, with these blocks
#   scripts/check.sh gallery                     examples/gallery: every command runs, and the pictures show what they showed
#   scripts/check.sh c                           C and C++ clients: installed, found by pkg-config, compiled, run with a twin
#   scripts/check.sh install [--profile NAME]    Debian package and Python wheel: built, installed into empty folders, used from there;
#                                                the Python source distribution compiles
#   scripts/check.sh dependencies                licences, sources and second versions of packages of others, by cargo-deny (deny.toml)
#   scripts/check.sh prepare                     the Python packages of actuators, exports, batch, clients, documents, gallery and gateway
#   scripts/check.sh gateway [test arguments]    the network gateway: tests, a Zenoh client against a running twin
#   scripts/check.sh ros2-peer                   the gateway's topics and services by hiroz, an independent implementation of ROS 2
#   scripts/check.sh aarch64 [test arguments]    the NEON kernel under emulation
#   scripts/check.sh hours [WHAT...]             some hours on two cores, logs in build/verify; default: ros2-peer, calculix and these:
#       soak        one hour at 1 kHz with disturbances: no loss, no wrong value, no growth
#       cycles      10,000 restarts, reloads and rotations, 100,000 readers: no growth
#       sealed      40 new states, solved and compared with predictions and half-widths
#       inputs      100,000 damaged command lines and files, a million damaged inputs of the parsers
#       kills       every program killed at every system call of its start and end
#       peers       the same task by other libraries, from PyPI
#       hard-cases  cases with a known solution
#       packages    `install` with a release build, and the gateway's package
# Python packages come from PyPI into build/ the first time; ros2-peer has its own crates, in target/ros2-peer.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
target=${CARGO_TARGET_DIR:-target}

. scripts/setup.sh
require cargo cc

# Skipped if SOFTTWIN_BUILT is set, as .ci/run does.
# shellcheck disable=SC2046 # `network` prints no word or two
build() { [ -n "${SOFTTWIN_BUILT:-}" ] || cargo build --locked --quiet --workspace $(network) --bins --lib; }

# python NAME PACKAGE...: sets `python` to an interpreter with these packages, in build/NAME-venv.
python() {
    local venv=build/$1-venv
    require venv
    if [ ! -f "$venv/installed" ]; then
        python3 -m venv "$venv"
        "$venv/bin/pip" install --quiet --disable-pip-version-check --no-compile "${@:2}"
        touch "$venv/installed"
    fi
    python=$venv/bin/python
}

readers_python() {
    python=python3
    if ! python3 -c 'import meshio, numpy, h5py' 2>/dev/null; then python readers 'meshio==5.3.5' 'numpy<3' h5py; fi
}

clients_python() {
    [ ! clients/python/pyproject.toml -nt build/clients-venv/installed ] || rm -f build/clients-venv/installed
    python clients numpy pandas polars pytest matplotlib mypy xarray pyvista fmpy 'pymoca<0.13' jsonschema basyx-python-sdk \
        mcap mcap-protobuf-support 'foxglove-sdk<0.31' rerun-sdk gymnasium nbclient nbformat ipykernel \
        'meshio==5.3.5' h5py lxml mapdl-archive jax onnx onnxruntime 'gmsh==4.15.2' 'scikit-learn<2'
}

benchmark_python() { python benchmark 'numpy<3' 'scipy<2' 'scikit-learn<2' matplotlib; }

batch_python() { python batch 'snakemake<10'; }

gmsh_python() { python gmsh "gmsh==4.15.2" numpy; }

gallery_python() { python gallery 'gmsh==4.15.2' numpy matplotlib; }

documents_python() {
    python documents 'numpy<3' 'scipy<2' 'scikit-learn<2' matplotlib 'fmpy<0.4' 'iceoryx2==0.10.0' 'gmsh==4.15.2' 'eclipse-zenoh==1.10.2'
}

gateway_python() { python gateway "eclipse-zenoh==1.10.2" numpy pytest rosbags; }

prepare() {
    readers_python
    batch_python
    clients_python
    gateway_python
    gmsh_python
    documents_python
    gallery_python
    benchmark_python
}

view() {
    require python3 chromium
    python=python3
    case " $* " in *" --film "*) python pictures 'pillow<13' ;; esac
    build
    exec "$python" scripts/checks/view.py --programs "$target/debug" "$@"
}

actuators() {
    build
    # shellcheck disable=SC2046
    cargo test --locked --workspace $(network) --test own_actuator -- "$@"
    gmsh_python # the mesh of a CAD file, with the real package
    # shellcheck disable=SC2046
    SOFTTWIN_GMSH_PYTHON=$PWD/$python cargo test --locked --workspace $(network) -p softtwin --test all -- step::
}

exports() {
    build
    readers_python
    exec "$python" scripts/checks/exports.py --programs "$target/debug"
}

calculix() {
    require ccx
    build
    python calculix 'meshio==5.3.5' 'numpy<3' scipy
    exec "$python" scripts/checks/calculix.py --programs "$target/debug" "$@"
}

# The same list both ways: the same bytes, and the last run solves nothing.
batch() {
    batch_python
    build
    local work count=2 snakemake file
    snakemake=$(realpath "$(dirname "$python")")/snakemake
    work=$(mktemp -d)
    # shellcheck disable=SC2064
    trap "rm -rf '$work'" EXIT
    PATH=$(realpath "$target")/debug:$PATH
    local slurm=$PWD/config/batch/slurm.sh snakefile=$PWD/config/batch/Snakefile
    cd "$work"
    softtwin new finger --chambers 1 --length-mm 24 >/dev/null
    softtwin mesh --actuator finger/actuator.toml --size-mm 9 >/dev/null
    softtwin sample --kind sequence --n 4 --regime free --pressure 0.01 0.03 --out cases.csv >/dev/null
    local run=("$slurm" finger/actuator.toml cases.csv slurm --sensitivities --json)
    for ((task = 0; task < count; task++)); do
        SLURM_ARRAY_TASK_ID=$task SLURM_ARRAY_TASK_COUNT=$count "${run[@]}" >/dev/null
    done
    "${run[@]}" >slurm.json
    grep -q '"reused":4' slurm.json || { echo "check.sh: expected 4 reused states, found $(<slurm.json)" >&2; exit 1; }
    "$snakemake" --quiet all --snakefile "$snakefile" --cores 2 \
        --config actuator=finger/actuator.toml cases=cases.csv out=snake parts=$count options=--sensitivities
    for file in slurm/*.*; do cmp "$file" "snake/${file#slurm/}"; done
    echo "check.sh: a list solved as a SLURM array and by Snakemake gave the same database"
}

benchmark() {
    benchmark_python
    build
    SOFTTWIN_BIN=$(realpath "$target")/debug "$python" benchmarks/run.py --models softtwin polynomial \
        --tasks "fingertip, air" "bending block" --json |
        "$python" -c 'import json, sys
rms = {(r["task"], r["model"]): r["rms_percent"] for r in json.load(sys.stdin)}
for task in {task for task, _ in rms}:
    own, peer = rms[task, "softtwin"], rms[task, "polynomial"]
    print(f"{task}: softtwin {own:.2f} %, polynomial {peer:.2f} %")
    assert own <= peer, "expected softtwin to be no worse than a polynomial"'
}

clients() {
    clients_python
    build
    export PYTHONPATH=$PWD/clients/python/src
    native_module
    "$python" -m mypy --cache-dir build/mypy --ignore-missing-imports --no-error-summary clients/python/src/softtwin
    exec "$python" -m pytest -q clients/python/tests "$@"
}

# Pages of the gallery are left to `gallery`, which compares their pictures too.
documents() {
    require strace
    local long=
    if [ "${1:-}" = long ]; then long=--long && shift; fi
    export SOFTTWIN_NETWORK=1 PYTHONPATH=$PWD/clients/python/src
    documents_python
    build
    native_module
    [ $# -gt 0 ] || set -- ./*.md docs/*.md docs/clients/*.md examples/gallery/README.md benchmarks/README.md models/shapes/*/README.md
    PATH=$(realpath "$target")/debug:$(realpath "$(dirname "$python")"):$PATH exec scripts/checks/blocks.py ${long:+"$long"} "$@"
}

gallery() {
    gallery_python
    build
    python3 scripts/checks/gallery.py --prove examples/gallery/*/picture.svg
    PATH=$(realpath "$(dirname "$python")"):$PATH exec scripts/gallery.sh --check --programs "$target/debug"
}

# started LOG COMMAND...: starts a command in the background and waits until it is ready.
started() {
    local log=$1 pid
    : >"$log"
    "${@:2}" 2>"$log" &
    pid=$!
    until grep -q ready: "$log"; do
        kill -0 "$pid" 2>/dev/null || { echo "check.sh: ${*:2} did not start:" >&2; cat "$log" >&2; exit 1; }
        sleep 0.1
    done
}

c() {
    require c++ pkg-config cmake
    local work program flags
    work=$(mktemp -d)
    # shellcheck disable=SC2064
    trap "kill \$(jobs -p) 2>/dev/null || true; wait; rm -rf '$work'" EXIT
    scripts/package.sh c "$work/prefix" --profile dev
    export PKG_CONFIG_PATH=$work/prefix/lib/pkgconfig LD_LIBRARY_PATH=$work/prefix/lib
    read -ra flags < <(pkg-config --cflags --libs softtwin)
    cc -std=c11 -Wall -Werror clients/c/examples/twin.c "${flags[@]}" -lm -o "$work/twin_c"
    # C++ by CMake, as a separate project.
    cmake -S clients/c/examples -B "$work/cmake" -DCMAKE_PREFIX_PATH="$work/prefix" >/dev/null
    cmake --build "$work/cmake" >/dev/null
    cp "$work/cmake/twin_cpp" "$work/"
    readelf -d "$work/prefix/lib/libsofttwin.so" | grep -q 'SONAME.*libsofttwin.so.0' ||
        { echo "check.sh: expected the SONAME libsofttwin.so.0 in libsofttwin.so" >&2; exit 1; }
    ! readelf -S "$work/prefix/lib/libsofttwin.so" | grep -q '\.symtab' ||
        { echo "check.sh: libsofttwin.so is not stripped" >&2; exit 1; }
    export SOFTTWIN_DOMAIN=cinstall$$ SOFTTWIN_ROOT=$work/iox
    started "$work/twin.log" "$target/debug/softtwind" twin --scene config/scenes/finger.toml
    started "$work/bridge.log" "$target/debug/softtwind" bridge --scene config/scenes/finger.toml --loop
    for program in twin_c twin_cpp; do
        "$work/$program" finger | tee "$work/$program.out"
        grep -q '^field' "$work/$program.out" || { echo "check.sh: $program printed no field" >&2; exit 1; }
    done
    echo "check.sh: the C and C++ clients were installed, found by pkg-config and CMake, compiled and run"
}

install_check() {
    require dpkg-deb systemd-analyze systemd-sysusers venv git
    exec scripts/checks/install.sh "$@"
}

# Advisories come from a repository of their own: `cargo deny check advisories`, where that can be reached.
dependencies() {
    local deny=build/cargo-deny/bin/cargo-deny
    [ -x "$deny" ] || cargo install --locked --quiet --debug --no-default-features --root build/cargo-deny cargo-deny@0.20.2
    "$deny" check --hide-inclusion-graph licenses sources bans
}

gateway() {
    require openssl
    gateway_python
    export SOFTTWIN_NETWORK=1
    build
    if [ -n "${SOFTTWIN_BUILT:-}" ]; then # scripts/test.sh has run its tests
        exec "$python" -m pytest -q crates/gateway/tests
    fi
    cargo test --locked --workspace --features gateway/network --test processes -- "$@"
    "$python" -m pytest -q crates/gateway/tests
}

# Two twins, one of them with readings from the peer; `softtwin echo` and `get` provide the reference values for the peer. The
# gateway is in turn a client of a router with the settings of ROS, a second router, and a peer.
ros2_peer() {
    require python3
    export SOFTTWIN_NETWORK=1
    local work ports way called say=$target/debug/softtwin peer=$target/ros2-peer/debug/ros2-peer
    local scene=scripts/checks/ros2_peer/scene.toml
    work=$(mktemp -d)
    # shellcheck disable=SC2064
    trap "kill \$(jobs -p) 2>/dev/null || true; wait; rm -rf '$work'" EXIT
    build
    CARGO_TARGET_DIR=$target/ros2-peer cargo build --locked --quiet --manifest-path scripts/checks/ros2_peer/Cargo.toml
    export SOFTTWIN_DOMAIN=ros2peer$$ SOFTTWIN_ROOT=$work/iox
    started "$work/twin.log" "$target/debug/softtwind" twin --scene "$scene"
    started "$work/bridge.log" "$target/debug/softtwind" bridge --scene "$scene" --loop
    "$say" echo softtwin/finger/state --json >"$work/states.jsonl" &
    "$say" echo softtwin/finger/field/surface --json >"$work/fields.jsonl" &
    "$say" get 'softtwin/finger/whatif?pressure_mpa=0.05;gap_mm=30' --json >"$work/whatif.json"
    read -ra ports < <(python3 -c 'import socket
held = [socket.socket() for _ in range(2)]
for one in held: one.bind(("127.0.0.1", 0))
print(*(one.getsockname()[1] for one in held))')
    local router=tcp/127.0.0.1:${ports[0]} gateway=tcp/127.0.0.1:${ports[1]}
    started "$work/router.log" "$peer" router "$router"
    for way in client router peer; do
        echo "check.sh: the gateway's mode is $way"
        called=$router
        case $way in
            client) echo "connect = [\"$router\"]" ;;
            router) printf '%s\n' "connect = [\"$router\"]" "listen = [\"$gateway\"]" ;;
            peer) echo "listen = [\"$gateway\"]" && called=$gateway ;;
        esac >"$work/gateway.toml"
        cat >>"$work/gateway.toml" <<END
mode = "$way"
readings_from_network = ["fed"]
[ros2]
domain_id = 7
node = "twins"
models = ["$PWD/models/pneunet/pneunet.twin"]
END
        started "$work/gateway.log" "$target/debug/softtwin-gateway" --config "$work/gateway.toml"
        echo $! >"$work/gateway.pid"
        "$peer" "$called" "$work"
    done
}

# With an aarch64 target of the installed toolchain that target is used; without one (no rustup server in reach) Debian's own
# compiler and its arm64 standard library are unpacked into build/aarch64.
aarch64() {
    local triple=aarch64-unknown-linux-gnu root=$PWD/build/aarch64 version runtime llvm package
    require aarch64-linux-gnu-gcc qemu-aarch64-static
    if ! [ -d "$(rustc --print sysroot)/lib/rustlib/$triple/lib" ]; then
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
    exec cargo test --locked --target "$triple" --target-dir target/aarch64 -p rom --lib --test all -- kernel "$@"
}

# hours_of WHAT: one of the long checks.
hours_of() {
    local studies=$target/release/softtwin-studies
    case "$1" in
        soak) "$studies" soak --seconds 3600 --report "$out/soak.json" ;;
        cycles) "$studies" cycles >"$out/cycles.json" ;;
        sealed) "$studies" sweep --fresh 40 --below-mpa 0.005 --database "$target/sweep" ;;
        inputs)
            SOFTTWIN_INPUTS=1000000 cargo test --locked --workspace --test inputs &&
                SOFTTWIN_HOSTILE=100000 cargo test --locked --workspace --test system -- hostile::
            ;;
        kills) SOFTTWIN_KILLS=all SOFTTWIN_KILLED_READERS=1500 cargo test --locked --workspace --test system -- kills:: ;;
        peers | hard-cases) "$studies" "$1" ;;
        packages) scripts/check.sh install --profile release && scripts/package.sh deb "$out" --gateway ;;
        ros2-peer | calculix) scripts/check.sh "$1" ;;
        *) echo "check.sh: hours: no check $1" >&2 && return 2 ;;
    esac
}

hours() {
    local out=build/verify failed=() what begin result
    [ $# -gt 0 ] || set -- soak cycles sealed inputs kills peers ros2-peer calculix hard-cases packages
    mkdir -p "$out"
    cargo build --locked --release -p softtwin -p softtwind -p studies --bins
    for what in "$@"; do
        begin=$SECONDS result=passed
        hours_of "$what" >"$out/$what.log" 2>&1 || { result="FAILED, see $out/$what.log"; failed+=("$what"); }
        printf '%-10s %6d s  %s\n' "$what" $((SECONDS - begin)) "$result"
    done
    [ ${#failed[@]} -eq 0 ]
}

case ${1:-} in
    view | actuators | exports | calculix | batch | benchmark | clients | documents | gallery | c | dependencies | prepare | gateway | aarch64 | hours) "$@" ;;
    install) install_check "${@:2}" ;;
    ros2-peer) ros2_peer ;;
    -h | --help) sed -n '2,32s/^# \{0,1\}//p' "$0" ;;
    *) sed -n '2,32s/^# \{0,1\}//p' "$0" >&2; exit 2 ;;
esac
