#!/bin/sh
# Writes requirements.lock (what runs) and requirements-dev.lock (what checks and draws) with the newest
# versions that pyproject.toml allows, resolved in a fresh environment.
set -eu
cd "$(dirname "$0")/.."

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python=${PYTHON:-.venv/bin/python}

# PyTorch's pin has a lock of its own, for it comes from an index of its own. setuptools is a package
# that PyTorch needs, but pip's list leaves it out of some Pythons' environments unless asked for all.
freeze() {
    "$work/venv/bin/pip" freeze --all --exclude coadapt-edge --exclude pip --exclude wheel \
        --exclude torch | grep -v '^-e' | LC_ALL=C sort
}

"$python" -m venv "$work/venv"
pip() { "$work/venv/bin/pip" --quiet --disable-pip-version-check "$@"; }
# There already, it keeps the resolver from the build for graphics cards and the packages that need.
pip install --no-deps --no-index --requirement requirements-torch.lock 2>/dev/null \
    || pip install --no-deps --requirement requirements-torch.lock
pip install .
freeze >"$work/run"
pip install '.[dev,figures,llm-server,recordings]'
freeze >"$work/all"
cp "$work/run" requirements.lock
LC_ALL=C comm -13 "$work/run" "$work/all" >requirements-dev.lock
