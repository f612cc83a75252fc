#!/bin/sh
# Writes requirements.lock (what runs) and requirements-dev.lock (what checks it) with the newest
# versions that pyproject.toml allows, resolved in a fresh environment.
set -eu
cd "$(dirname "$0")/.."

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python=${PYTHON:-.venv/bin/python}

freeze() { "$work/venv/bin/pip" freeze --exclude coadapt-edge --exclude pip | grep -v '^-e' | LC_ALL=C sort; }

"$python" -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check .
freeze >"$work/run"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check '.[dev,llm-server]' 'setuptools>=68'
freeze >"$work/all"
cp "$work/run" requirements.lock
LC_ALL=C comm -13 "$work/run" "$work/all" >requirements-dev.lock
# pip freeze leaves it out; newer Pythons' environments come without it.
"$work/venv/bin/pip" freeze --all | grep '^setuptools==' >>requirements-dev.lock
