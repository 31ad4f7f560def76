#!/bin/sh
# Builds an actuator's mesh: scripts/mesh.sh models/pneunet/actuator.toml [--out FILE] [--finer TIMES] [--search SECONDS]
# gmsh comes from PyPI into target/mesh-venv. On a bare Debian or Ubuntu it needs these libraries:
#   apt-get install python3-venv libglu1-mesa libxrender1 libxcursor1 libxft2 libxinerama1
# Nobody needs this to use the committed mesh.
set -eu
here=$(cd "$(dirname "$0")/.." && pwd)
venv="$here/target/mesh-venv"
if [ ! -x "$venv/bin/python" ] || ! "$venv/bin/python" -c 'import gmsh, numpy' 2>/dev/null; then
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet gmsh==4.15.2 numpy
fi
exec "$venv/bin/python" "$here/scripts/mesh.py" "$@"
