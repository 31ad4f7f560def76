#!/usr/bin/env bash
# scripts/docs.sh [OUT]   the site: the documents, the references that are generated from the programs and the Python package, the
#                         notebooks with what they draw, and a model that moves on the front page. OUT (default build/site) can be
#                         served from anywhere. Warnings are errors: a link that leads nowhere, a page that is in no menu, a
#                         document that does not parse, a notebook that fails.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
. scripts/setup.sh
require cargo cc venv
out=${1:-build/site}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

[ -n "${SOFTTWIN_BUILT:-}" ] || scripts/page.sh # the front page needs the code for browsers
[ -n "${SOFTTWIN_BUILT:-}" ] || cargo build --locked --quiet --package softtwin --package python
program=${CARGO_TARGET_DIR:-target}/debug/softtwin

mkdir -p "$work/pages/reference" "$work/extra"
cp --parents -t "$work/pages" README.md OPERATIONS.md ARCHITECTURE.md CONTRIBUTING.md CHANGELOG.md SECURITY.md benchmarks/*.{md,png,toml} benchmarks/prepare.py
cp -r docs "$work/pages/docs"
cp --parents -t "$work/pages" examples/gallery/README.md examples/gallery/*/{README.md,picture.*}
"$program" export models/pneunet/pneunet.twin --out "$work/extra/finger.html"

# Every command with its help, in the order in which the tool lists them.
{
    printf '# Commands\n\nEach says with `--help` what it does; this page is made of that.\n'
    "$program" --help | while IFS= read -r line; do
        if [[ $line =~ ^([A-Z][a-z\ ]+):$ ]]; then printf '\n## %s\n' "${BASH_REMATCH[1]}"; fi
        [[ $line =~ ^\ \ ([a-z]+)\ \ + ]] || continue
        name=${BASH_REMATCH[1]}
        [ "$name" != help ] || continue
        printf '\n### %s\n\n```text\n' "$name"
        COLUMNS=90 "$program" "$name" --help
        printf '```\n'
    done
} >"$work/pages/reference/commands.md"
# Files that people write, with every key, its unit and its meaning.
{
    printf '# Files\n\nEvery key with its unit and meaning. Commands name a key that they do not know, with the nearest one.\n'
    for file in config/scenes/finger.toml config/twin.toml config/train.toml config/gateway.toml models/pneunet/actuator.toml; do
        printf '\n## %s\n\n```toml\n' "$file"
        cat "$file"
        printf '```\n'
    done
} >"$work/pages/reference/files.md"

[ ! scripts/docs.sh -nt build/docs-venv/installed ] || rm -f build/docs-venv/installed # its list of packages may have changed
if [ ! -f build/docs-venv/installed ]; then
    python3 -m venv build/docs-venv
    build/docs-venv/bin/pip install --quiet --disable-pip-version-check --no-compile 'sphinx<9' 'myst-parser<6' 'sphinx-autoapi<4' furo \
        nbclient nbformat ipykernel numpy matplotlib
    touch build/docs-venv/installed
fi

# Notebooks are committed without results; here they run.
mkdir "$work/pages/notebooks"
native_module
for notebook in clients/python/examples/*.ipynb; do
    PYTHONPATH=$PWD/clients/python/src SOFTTWIN_MODEL=$PWD/models/pneunet/pneunet.twin SOFTTWIN_DATA=$PWD/benchmarks/data \
        PYDEVD_DISABLE_FILE_VALIDATION=1 \
        build/docs-venv/bin/python docs/site/notebook.py "$notebook" "$work/pages/notebooks/$(basename "$notebook" .ipynb).md"
done

export SOFTTWIN_SITE_EXTRA=$work/extra SOFTTWIN_PACKAGE=$PWD/clients/python/src/softtwin
rm -rf "$out"
build/docs-venv/bin/sphinx-build -W --keep-going -q -b html -d "$work/doctrees" -c docs/site "$work/pages" "$out"
# The site begins with the front page.
printf '<!doctype html><meta http-equiv="refresh" content="0; url=docs/index.html"><a href="docs/index.html">softtwin</a>\n' >"$out/index.html"
echo "$out/index.html"
