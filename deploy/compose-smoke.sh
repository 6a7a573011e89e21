#!/usr/bin/env bash
# Brings the fleet up with docker-compose, drives one scenario through it with two video workers, then eight, kills one of both
# while they work, and takes everything down. Fails if a drive does not complete, a guest without token gets in, `top` and the
# metrics do not see the kill within 5 s, or the killed worker held no drive.
#
#   deploy/compose-smoke.sh            images are built as in docker-compose.yml (a registry is needed for the bases)
#   OFFLINE=1 deploy/compose-smoke.sh  the base is made by debootstrap under the same tag, and the binary is built here
set -euo pipefail
cd "$(dirname "$0")/.."
work=$(mktemp -d)
trap 'docker-compose logs --no-color --tail 40 >"$work.log" 2>&1 || true; docker-compose down -v --remove-orphans >/dev/null 2>&1 || true; rm -rf "$work"' EXIT

if [ "${OFFLINE:-0}" = 1 ]; then
    command -v debootstrap >/dev/null || { echo "OFFLINE needs debootstrap" >&2; exit 1; }
    if ! docker image inspect debian:bookworm-slim >/dev/null 2>&1; then
        debootstrap --variant=minbase bookworm "$work/root" ${DEBIAN_MIRROR:+"$DEBIAN_MIRROR"} >/dev/null
        rm -rf "$work/root/var/cache/apt" "$work/root/var/lib/apt/lists" "$work/root/usr/share/doc" "$work/root/usr/share/man"
        tar -C "$work/root" -c . | docker import - debian:bookworm-slim >/dev/null
    fi
    cargo build --locked -p dreamstream
    mkdir -p "$work/builder/out"
    strip -o "$work/builder/out/dreamstream" "${CARGO_TARGET_DIR:-target}/debug/dreamstream"
    printf 'FROM debian:bookworm-slim\nCOPY out /out\n' >"$work/builder/Dockerfile"
    docker build -q -t dreamstream-builder "$work/builder" >/dev/null
    export BUILDER=dreamstream-builder
fi
dreamstream() { cargo run -q --locked -- "$@"; }

docker-compose build -q
docker-compose up -d --scale vdm-worker=2
orchestrator=$(docker-compose ps -q orchestrator)
mkdir "$work/certs"
docker cp "$orchestrator:/certs/ca.pem" "$work/certs/ca.pem"
docker cp "$orchestrator:/certs/token" "$work/certs/token"
fleet=(--orchestrator https://127.0.0.1:4710 --ca "$work/certs/ca.pem" --token "$work/certs/token")

if dreamstream health --orchestrator https://127.0.0.1:4710 --ca "$work/certs/ca.pem" 2>/dev/null; then
    echo "the orchestrator let somebody in without a token" >&2
    exit 1
fi
dreamstream submit scenarios/base/free-curve.scenario.json --duration 3 --out "$work/first" "${fleet[@]}"
grep -q '"insecure": false' "$work/first/results.json"

dreamstream submit scenarios/base --duration 8 --out "$work/second" "${fleet[@]}" &
drive=$!
address=$(docker inspect -f '{{range .NetworkSettings.Networks}}{{.IPAddress}}{{end}}' "$orchestrator")
scrape() { curl -sS --cacert "$work/certs/ca.pem" --resolve "orchestrator:9464:$address" "$@" https://orchestrator:9464/metrics; }
told() { scrape -H "authorization: Bearer $(cat "$work/certs/token")" | grep -q "^dreamstream_$1\$"; }
working() { told 'instances{role="video",state="works"} 2'; }
in_metrics() { told 'instances{role="video",state="lost its line"} 1'; }
taken_over() { told 'lost_leases_total{role="video",cause="died"} [1-9][0-9]*'; }
in_top() { dreamstream top --once --json "${fleet[@]}" | grep -q '"lost its line"'; }
within_5s() { until "$1"; do ((SECONDS < killed + 5)) || { echo "$1: the kill was not seen within 5 s" >&2; exit 1; }; done; }
scrape | grep -q 'a token is asked for' || { echo "the metrics were told to somebody without a token" >&2; exit 1; }

began=$SECONDS
until working; do ((SECONDS < began + 60)) || { echo "two video workers were never at work at once" >&2; exit 1; }; done
docker kill "$(docker-compose ps -q vdm-worker | head -n 1)" >/dev/null
killed=$SECONDS
within_5s in_metrics
within_5s in_top
wait "$drive"
taken_over || { echo "the killed worker held no drive" >&2; exit 1; }

docker-compose ps
docker images --format '{{.Repository}} {{.Size}}' | grep '^dreamstream/'
echo "compose smoke passed"
