#!/usr/bin/env bash
# scripts/gallery.sh [--check] [--programs DIR] [NAME...]   runs the commands of examples/gallery/NAME/README.md (of all of them) from the
#     repository's root and puts the pictures they make in place. With --check it compares them with those in place and writes nothing there.
# Needs Python with numpy, matplotlib and gmsh; what the commands write stays in build/gallery.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. scripts/setup.sh
programs=${CARGO_TARGET_DIR:-target}/debug check=
while [ $# -gt 0 ]; do
    case $1 in
        --check) check=1 ;;
        --programs) programs=$2 && shift ;;
        -*) sed -n '2,4s/^# \{0,1\}//p' "$0" >&2 && exit 2 ;;
        *) break ;;
    esac
    shift
done
[ $# -gt 0 ] || set -- $(basename -a examples/gallery/*/)
PATH=$(realpath "$programs"):$PATH
export PATH PYTHONPATH=$PWD/clients/python/src
native_module
# Bounded: a picture wall that loads slowly is none.
most_bytes=60000

# run NAME: its commands, in a domain of their own. What they start ends with them.
run() {
    local folder=build/gallery/$1 began=$SECONDS
    rm -rf "$folder" && mkdir -p "$folder"
    sed -n '/^```sh$/,/^```$/{/^```/!p}' "examples/gallery/$1/README.md" >"$folder/commands"
    [ -s "$folder/commands" ] || { echo "gallery.sh: examples/gallery/$1/README.md: expected a block of commands, found none" >&2; return 1; }
    {
        printf 'set -euo pipefail\nset -m\ntrap '\''jobs -p | xargs -r kill 2>/dev/null || true'\'' EXIT\n'
        cat "$folder/commands"
    } >"$folder/script"
    SOFTTWIN_DOMAIN=gallery$$ SOFTTWIN_ROOT=$PWD/build/gallery/iox bash "$folder/script" >"$folder/log" 2>&1 </dev/null ||
        { echo "gallery.sh: $1 failed:" >&2; cat "$folder/log" >&2; return 1; }
    printf '%-20s %3d s\n' "$1" $((SECONDS - began))
}

for name in "$@"; do
    run "$name"
    made=$(ls build/gallery/"$name"/picture.*)
    size=$(stat -c %s "$made")
    [ "$size" -le "$most_bytes" ] || { echo "gallery.sh: $made: expected at most $most_bytes bytes, found $size" >&2; exit 1; }
    kept=examples/gallery/$name/${made##*/}
    if [ -n "$check" ]; then
        python3 scripts/checks/gallery.py "$kept" "$made"
    else
        cp "$made" "$kept"
    fi
done
