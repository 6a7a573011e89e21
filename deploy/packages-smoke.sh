#!/usr/bin/env bash
# Tries the wheel and the tarball of target/packages (deploy/packages.sh) in a fresh Debian container that has Python and no
# Rust toolchain: a first drive of each, and a drive by a policy in Python. Fails if one does not complete, or takes a minute.
#
#   deploy/packages-smoke.sh           the base image is debian:bookworm-slim, made by debootstrap where it cannot be pulled
#
# What pip installs beside the wheel (numpy, eclipse-zenoh, protobuf) is downloaded beforehand and is not counted.
set -euo pipefail
cd "$(dirname "$0")/../target/packages"
wheel=$(ls dreamstream-*.whl)
tarball=$(ls dreamstream-*.tar.gz)
work=$(mktemp -d)
image=dreamstream-packages-smoke
trap 'rm -rf "$work"; docker image rm -f $image >/dev/null 2>&1 || true' EXIT

if ! docker image inspect dreamstream-bare-python >/dev/null 2>&1; then
    command -v debootstrap >/dev/null || { echo "needs debootstrap" >&2; exit 1; }
    debootstrap --variant=minbase --include=python3,python3-venv,python3-pip bookworm "$work/root" ${DEBIAN_MIRROR:+"$DEBIAN_MIRROR"} >/dev/null
    rm -rf "$work/root/var/cache/apt" "$work/root/var/lib/apt/lists"
    tar -C "$work/root" -c . | docker import - dreamstream-bare-python >/dev/null
fi
mkdir "$work/image"
cp "$wheel" "$tarball" "$work/image"
python3 -m pip download -q --disable-pip-version-check --python-version 3.11 --implementation cp --only-binary :all: \
    --platform "$(echo "$tarball" | grep -o 'manylinux_2_[0-9]*_[a-z0-9_]*')" \
    --platform manylinux_2_28_x86_64 --platform manylinux2014_x86_64 --platform manylinux_2_17_x86_64 -d "$work/image/wheels" "./$wheel"
rm -f "$work"/image/wheels/dreamstream-*
cat >"$work/image/mine.py" <<'PYTHON'
import numpy as np
from dreamstream import Policy


class Mine(Policy):
    def plan(self, observation):
        times_s = 0.5 * np.arange(1, 17)
        return np.stack([observation.ego.speed_mps * times_s, 0 * times_s, 0 * times_s], axis=1)
PYTHON
cat >"$work/image/Dockerfile" <<'DOCKER'
FROM dreamstream-bare-python
COPY . /packages
RUN useradd --create-home newcomer
USER newcomer
WORKDIR /home/newcomer
DOCKER
docker build -q -t $image "$work/image" >/dev/null

# In an empty folder, without network; `! command -v` says that there is no toolchain.
docker run --rm --network none -e WHEEL="$wheel" -e TARBALL="$tarball" $image bash -euc '
    for tool in cargo rustc cc gcc; do ! command -v $tool; done
    completed() { python3 -c "import json, sys; episodes = json.load(open(sys.argv[1]))[\"episodes\"]; print(sys.argv[1], [(e[\"scenario\"], e[\"status\"]) for e in episodes]); sys.exit(any(e[\"status\"] != \"completed\" for e in episodes) or not episodes)" $1; }
    began=$SECONDS
    python3 -m venv venv
    venv/bin/pip install -q --disable-pip-version-check --no-index --find-links /packages/wheels /packages/$WHEEL
    venv/bin/dreamstream run scenarios/base/free-curve.scenario.json --out wheel
    completed wheel/results.json
    echo "pip install and first drive: $((SECONDS - began)) s"; [ $((SECONDS - began)) -lt 60 ]

    began=$SECONDS
    venv/bin/python -m dreamstream run /packages/mine.py:Mine --name mine --connect tcp/127.0.0.1:7448 --sessions 1 --quiet &
    policy=$!
    venv/bin/dreamstream run scenarios/base/cut-in.scenario.json --policy mine --policy-listen tcp/127.0.0.1:7448 --out mine
    wait $policy
    completed mine/results.json
    echo "drive by a policy in Python: $((SECONDS - began)) s"; [ $((SECONDS - began)) -lt 60 ]

    if [ -e venv/bin/viewer ]; then
        venv/bin/dreamstream view wheel/recordings/*.mcap --save drive.rrd
        ls -s drive.rrd
    fi

    began=$SECONDS
    tar -xzf /packages/$TARBALL
    ln -s "$PWD/${TARBALL%.tar.gz}/bin/dreamstream" here
    ./here run scenarios/base/free-curve.scenario.json --out tarball
    completed tarball/results.json
    echo "unpack and first drive: $((SECONDS - began)) s"; [ $((SECONDS - began)) -lt 60 ]
    ./here run scenarios/base/free-curve.scenario.json --processes --observation layout --duration 2 --out processes
    completed processes/results.json

    cp "${TARBALL%.tar.gz}/bin/dreamstream" alone
    if said=$(./alone run scenarios/base 2>&1); then echo "a binary without its files ran" >&2; exit 1; fi
    echo "without its files: $said"; echo "$said" | grep -q share/dreamstream
'
echo "packages smoke passed"
