#!/bin/sh
# Writes requirements.lock (what runs) and requirements-dev.lock (what checks and draws): the newest
# versions that pyproject.toml allows for every Python that it allows, with the hashes of their files.
# UPGRADE= keeps the versions that are pinned already, where pyproject.toml still allows them.
set -eu
cd "$(dirname "$0")/.."

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"${PYTHON:-.venv/bin/python}" -m venv "$work/venv"
"$work/venv/bin/python" -m pip install --quiet --disable-pip-version-check uv==0.13.9

# PyTorch's pin has a lock of its own, without a hash: its index and a folder of wheels have different files.
compile() {
    output=$1
    shift
    "$work/venv/bin/uv" pip compile --quiet --universal --python-version 3.11 --fork-strategy fewest \
        --generate-hashes --only-binary :all: --no-emit-package torch --custom-compile-command 'make lock' \
        ${UPGRADE---upgrade} --output-file "$output" "$@" pyproject.toml
    # What pyproject.toml's [tool.uv] says of all lines.
    sed -i "s/ ; python_full_version < '3.14' and platform_python_implementation == 'CPython' and sys_platform == 'linux'//" "$output"
}

compile requirements.lock --extra swarm
# shellcheck disable=SC2046
compile requirements-dev.lock --constraint requirements.lock --extra swarm --extra dev --extra figures \
    --extra llm-server --extra recordings $(sed -n 's/^\([a-z0-9-]*\)==.*/--no-emit-package \1/p' requirements.lock)
