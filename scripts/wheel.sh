#!/usr/bin/env bash
# Makes the wheel skillbench-fieldbus of a program `bench`. Usage: wheel.sh PROGRAM DIR PYTHON
#
# PYTHON has pip and setuptools. The wheel is for the processor of this machine, or for that of SKILLBENCH_WHEEL_MACHINE.
set -euo pipefail
program=$1 out=$2 python=$3
cd "$(dirname "$0")/.."
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml)
source=$(mktemp -d)
trap 'rm -rf "$source"' EXIT
cp -r python/pyproject.toml python/setup.py python/README.md python/skillbench_fieldbus LICENSE-MIT LICENSE-APACHE "$source"
rm -rf "$source"/skillbench_fieldbus/__pycache__
mkdir "$source/skillbench_fieldbus/bin"
strip --strip-debug -o "$source/skillbench_fieldbus/bin/bench" "$program"
cp node/schemas/control.schema.json "$source/skillbench_fieldbus"
mkdir -p "$out"
SKILLBENCH_VERSION=$version "$python" -m pip wheel --quiet --no-deps --no-build-isolation --wheel-dir "$out" "$source"
