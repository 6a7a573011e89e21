#!/usr/bin/env bash
# Lays out the built programs with the files that they ship with, and makes of them one wheel (command line and Python client)
# and one tarball (command line), in target/packages. Nothing is published.
#
#   deploy/packages.sh [FOLDER]        the folder of dreamstream and, where they are built, viewer and trainer; target/debug without
#
# Needs git, binutils and python3 with venv and pip.
set -euo pipefail
cd "$(dirname "$0")/.."
built=${1:-${CARGO_TARGET_DIR:-target}/debug}
programs=("$built/dreamstream")
for beside in viewer trainer; do [ ! -x "$built/$beside" ] || programs+=("$built/$beside"); done
out=target/packages
version=$(sed -n 's/^version = "\(.*\)"$/\1/p' Cargo.toml | head -n 1)

# The C libraries that every Linux of the platform tag has (PEP 600); the tag names the newest glibc symbol that is asked for.
strange=$(objdump -p "${programs[@]}" | awk '$1 == "NEEDED" { print $2 }' | grep -vE '^(libc|libm|libgcc_s|libdl|libpthread|librt|ld-linux[-a-z0-9_]*)\.so' || true)
[ -z "$strange" ] || { echo "${programs[*]} need libraries that not every system has: $strange" >&2; exit 1; }
glibc=$(objdump -T "${programs[@]}" | grep -o 'GLIBC_2\.[0-9]*' | sort -uV | tail -n 1)
platform="manylinux_2_${glibc#GLIBC_2.}_$(uname -m)"

name="dreamstream-$version-$platform"
rm -rf "$out"
mkdir -p "$out/$name/bin" "$out/$name/share/dreamstream"
for program in "${programs[@]}"; do strip -o "$out/$name/bin/$(basename "$program")" "$program"; done
git ls-files -z configs scenarios/README.md scenarios/base LICENSE NOTICE | tar --null -T - -c | tar -x -C "$out/$name/share/dreamstream"
tar -C "$out" --sort=name --owner=0 --group=0 -czf "$out/$name.tar.gz" "$name"

python3 -m venv "$out/venv"
DREAMSTREAM_PREFIX="$PWD/$out/$name" DREAMSTREAM_PLATFORM="$platform" \
    "$out/venv/bin/pip" wheel -q --disable-pip-version-check --no-deps -w "$out" ./clients/python
rm -rf "$out/venv"
ls -sh --block-size=M "$out/$name/bin"/* "$out"/*.tar.gz "$out"/*.whl
