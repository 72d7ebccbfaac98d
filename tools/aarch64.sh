#!/usr/bin/env bash
# Runs the aarch64 wheel in a whole aarch64 Python under qemu: streams of simulated beats decode to the
# bits of this machine. `make aarch64`, on Debian; not part of the tests.
#
# Everything is unpacked into build/aarch64: nothing foreign is installed, but qemu-user-static.
set -euo pipefail
cd "$(dirname "$0")/.."
here=$PWD/build/aarch64
python=.venv/bin/python

command -v qemu-aarch64-static >/dev/null || apt-get install -qq -y qemu-user-static

if [ ! -x "$here/root/usr/bin/python3.11" ]; then
    mkdir -p "$here"/{state/lists/partial,cache/archives/partial,root}
    touch "$here/state/status"
    foreign=(-qq -o APT::Architecture=arm64 -o APT::Architectures::=arm64 -o Dir::State="$here/state"
        -o Dir::State::status="$here/state/status" -o Dir::Cache="$here/cache" -o Debug::NoLocking=1)
    apt-get "${foreign[@]}" update
    apt-get "${foreign[@]}" install -y --download-only --no-install-recommends python3.11 libgcc-s1 libstdc++6
    for package in "$here"/cache/archives/*.deb; do dpkg-deb -x "$package" "$here/root"; done
fi

if [ ! -d "$here/site/scipy" ]; then
    $python -m pip install --quiet --disable-pip-version-check --target "$here/site" -c constraints.txt \
        --python-version 3.11 --implementation cp --abi cp311 --only-binary=:all: \
        --platform manylinux_2_28_aarch64 --platform manylinux_2_17_aarch64 --platform manylinux2014_aarch64 \
        numpy scipy
fi

MODALMOTION_TARGET=linux-aarch64 .venv/wheels/bin/python -m hatchling build -t wheel -d "$here/wheel"
rm -rf "$here"/site/modalmotion*
$python -m zipfile -e "$here"/wheel/*aarch64.whl "$here/site"

$python tools/decoded_bits.py encode "$here/streams" | tee "$here/native.txt"
qemu-aarch64-static -L "$here/root" -E PYTHONPATH="$here/site" -E OPENBLAS_NUM_THREADS=1 \
    "$here/root/usr/bin/python3.11" tools/decoded_bits.py decode "$here/streams" | tee "$here/aarch64.txt"
# All but the first line, which names the machine.
cmp <(tail -n +2 "$here/native.txt") <(tail -n +2 "$here/aarch64.txt")
echo "The same bits."
