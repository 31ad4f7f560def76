# What the measuring and testing scripts share; sourced from the repository's root.
# shellcheck shell=bash

me=$(basename "$0" .sh)

# options NAME... -- ARGUMENTS: sets the variables of these names from `--NAME VALUE`; anything else ends with 2.
options() {
    local known=" " name
    while [ "$1" != -- ]; do known+="$1 "; shift; done
    shift
    while [ $# -gt 0 ]; do
        name=${1#--}
        if [[ $1 != --* || $known != *" $name "* ]]; then echo "$me: unknown option $1" >&2; exit 2; fi
        [ $# -ge 2 ] || { echo "$me: $1 needs a value" >&2; exit 2; }
        printf -v "$name" %s "$2"
        shift 2
    done
}

# Folder of the programs of a profile (dev or release).
programs() { echo "${CARGO_TARGET_DIR:-target}/${1/#dev/debug}"; }

# ready LOG COMMAND...: starts it in the background and waits until it says that it is ready. Its number is in `started`.
ready() {
    local log=$1
    shift
    "$@" 2>"$log" &
    started=$!
    until grep -q ready: "$log"; do
        kill -0 "$started" 2>/dev/null || { echo "$me: $* did not start:" >&2; cat "$log" >&2; exit 1; }
        sleep 0.1
    done
}

# Python with a plain Zenoh client, in build/gateway-venv; its path is in `python`. PyPI is asked the first time.
zenoh_python() {
    local venv=build/gateway-venv
    if [ ! -f "$venv/installed" ]; then
        python3 -m venv "$venv"
        "$venv/bin/pip" install --quiet --disable-pip-version-check "eclipse-zenoh==1.10.2" numpy pytest
        touch "$venv/installed"
    fi
    python=$venv/bin/python
}
