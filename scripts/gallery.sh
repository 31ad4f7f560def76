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

for name in "$@"; do
    rm -rf "build/gallery/$name" && mkdir -p "build/gallery/$name"
    python3 scripts/checks/blocks.py --in-place "build/gallery/$name" "examples/gallery/$name/README.md"
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
