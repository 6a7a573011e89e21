#!/usr/bin/env bash
# Brings the fleet up with docker-compose, drives one scenario through it with two video workers, kills one of them,
# drives again, and takes everything down. Fails if a drive does not complete.
#
#   deploy/compose-smoke.sh            images are built as in docker-compose.yml (a registry is needed for the bases)
#   OFFLINE=1 deploy/compose-smoke.sh  the base is made by debootstrap under the same tag, and the binary is built here
set -euo pipefail
cd "$(dirname "$0")/.."
work=$(mktemp -d)
trap 'docker-compose down -v --remove-orphans >/dev/null 2>&1 || true; rm -rf "$work"' EXIT

if [ "${OFFLINE:-0}" = 1 ]; then
    command -v debootstrap >/dev/null || { echo "OFFLINE needs debootstrap" >&2; exit 1; }
    if ! docker image inspect debian:bookworm-slim >/dev/null 2>&1; then
        debootstrap --variant=minbase bookworm "$work/root" >/dev/null
        rm -rf "$work/root/var/cache/apt" "$work/root/var/lib/apt/lists" "$work/root/usr/share/doc" "$work/root/usr/share/man"
        tar -C "$work/root" -c . | docker import - debian:bookworm-slim >/dev/null
    fi
    cargo build --locked -p dreamstream
    mkdir -p "$work/builder/out"
    strip -o "$work/builder/out/dreamstream" target/debug/dreamstream
    printf 'FROM debian:bookworm-slim\nCOPY out /out\n' >"$work/builder/Dockerfile"
    docker build -q -t dreamstream-builder "$work/builder" >/dev/null
    export BUILDER=dreamstream-builder
fi

docker-compose build -q
docker-compose up -d --scale vdm-worker=2
run() { # drives a scenario on the fleet and fails if it does not complete
    cargo run -q --locked -- submit "$1" --observation "$2" --duration 3 --out "$work/$3"
}
run scenarios/base/free-curve.scenario.json dreamstream first
docker kill "$(docker-compose ps -q vdm-worker | head -n 1)" >/dev/null
run scenarios/base/cut-in.scenario.json dreamstream second
docker-compose ps
docker images --format '{{.Repository}} {{.Size}}' | grep '^dreamstream/'
echo "compose smoke passed"
