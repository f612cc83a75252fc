#!/bin/sh
# Makes a base image without a registry: Debian's own bootstrap, imported into Docker.
# Usage: base.sh IMAGE_NAME. Needs root, debootstrap and a running Docker engine.
set -eu

image=${1:?usage: base.sh IMAGE_NAME}
packages=python3,python3-venv,python3-pip,ca-certificates,iproute2,libegl1,libgl1,libgomp1,libusb-1.0-0,libx11-6,prometheus

[ "$(id -u)" = 0 ] || { echo "base.sh: debootstrap needs root" >&2; exit 1; }
command -v debootstrap >/dev/null || { echo "base.sh: install debootstrap first" >&2; exit 1; }

root=$(mktemp -d)
trap 'rm -rf "$root"' EXIT
debootstrap --variant=minbase --include="$packages" bookworm "$root" >&2
rm -rf "$root"/var/cache/apt/archives/*.deb "$root"/var/lib/apt/lists/* "$root"/usr/share/doc/*
tar -C "$root" -c . | docker import - "$image" >&2
echo "$image"
