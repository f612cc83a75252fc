#!/bin/sh
# Makes .venv with the pinned packages, and installs the Debian packages that the swarm needs.
# Safe to run again: does nothing when nothing changed. SKIP_SYSTEM=1 leaves the system alone;
# EXTRA=llm also installs the embedded language model (deploy/llm.sh).
set -eu
cd "$(dirname "$0")/.."

venv=.venv
stamp=$venv/.setup-done
inputs="requirements.lock requirements-dev.lock requirements-torch.lock pyproject.toml setup.py deploy/setup.sh deploy/locked.sh \
    perception/kernels/coding.c perception/kernels/network.c perception/kernels/places.c perception/kernels/team.h \
    worlds/factory/rays.c"

say() { echo "setup: $*" >&2; }
. deploy/apt.sh
. deploy/locked.sh

missing_packages() {
    command -v ip >/dev/null 2>&1 || echo iproute2
    # `make data` brings recorded scans with it.
    command -v git >/dev/null 2>&1 || echo git
    command -v prometheus >/dev/null 2>&1 || echo prometheus
    # For the loops in C (setup.py); without a compiler all works, slower.
    command -v cc >/dev/null 2>&1 || echo gcc libc6-dev
    for pair in libEGL.so.1=libegl1 libGL.so.1=libgl1 libgomp.so.1=libgomp1 libusb-1.0.so.0=libusb-1.0-0 \
        libX11.so.6=libx11-6; do
        ldconfig -p 2>/dev/null | grep -q "${pair%%=*}" || echo "${pair#*=}"
    done
    python3 -c 'import ensurepip, venv' 2>/dev/null || echo python3-venv
}

install_system() {
    packages=$(PATH=$PATH:/usr/sbin:/sbin missing_packages | tr '\n' ' ')
    [ -n "$packages" ] || return 0
    # shellcheck disable=SC2086
    apt_install $packages || { [ $? = 3 ] && return 0; return 1; }
    # Only the program is wanted, not Debian's own Prometheus service on port 9090.
    if [ -d /run/systemd/system ] && echo "$packages" | grep -q prometheus; then
        $as_root systemctl disable --quiet --now prometheus || true
    fi
}

find_python() {
    for candidate in ${PYTHON:-} python3.11 python3 python3.12 python3.13; do
        if "$candidate" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' \
            2>/dev/null; then
            echo "$candidate"
            return 0
        fi
    done
    say "no Python 3.11 to 3.13 found; set PYTHON to one"
    return 1
}

# First, so that no later line of a lock can bring another build. A wheel that lies where pip looks
# for files (PIP_FIND_LINKS) is taken without asking an index, and one that is installed stays.
install_torch() {
    torch="--quiet --disable-pip-version-check --no-deps --requirement requirements-torch.lock"
    # shellcheck disable=SC2086
    $venv/bin/python -m pip install --no-index $torch 2>/dev/null && return 0
    say "downloading PyTorch's build for the processor (about 200 MB)"
    # shellcheck disable=SC2086
    $venv/bin/python -m pip install $torch && return 0
    say "PyTorch could not be installed: $(grep '^torch==' requirements-torch.lock), the build for the processor,"
    say "lies in no folder of PIP_FIND_LINKS ('${PIP_FIND_LINKS:-}'), and the index in requirements-torch.lock gave none;"
    say "put a wheel for this Python into a folder, and run: PIP_FIND_LINKS=folder make setup"
    return 1
}

install_python() {
    [ "${SKIP_SYSTEM:-0}" = 1 ] || install_system
    python=$(find_python)
    [ -x $venv/bin/python ] || "$python" -m venv $venv
    say "installing the pinned Python packages into $venv"
    install_torch
    locked_pip install --no-deps --requirement requirements.lock --requirement requirements-dev.lock
    $venv/bin/python -m pip install --quiet --disable-pip-version-check --no-deps \
        --no-build-isolation --editable .
    # A checkout has what an installation lacks: research and tests.
    pwd >"$($venv/bin/python -c 'import site; print(site.getsitepackages()[0])')/coadapt-checkout.pth"
    touch "$stamp"
    say "done: $venv/bin/coadapt"
}

case ${EXTRA:-} in
    "" | llm) ;;
    *) say "EXTRA=$EXTRA is unknown; allowed: llm"; exit 2 ;;
esac
if [ ! -e "$stamp" ] || [ -n "$(find $inputs -newer "$stamp")" ]; then
    install_python
fi
if [ "${EXTRA:-}" = llm ]; then
    sh deploy/llm.sh
fi
