"""Rates of a diagnosis against baselines of a few healthy logs, on a world drawn with `--fleet`.

For every vehicle of the fleet its first healthy cases make the baseline, its other cases are diagnosed with it: how often
a healthy one is called anything, a library effect unknown, the first effect right, the choice right, both of a pair found.
Labels of the cases that were diagnosed lie beside the diagnoses, for `gap score DIR/logs-N --others OTHER/logs-N/labels.json`.

    python tests/worlds/own_world.py --out WORLD --seed SEED --fleet 3 --none 45 --singles 48 --pairs 12 --unknown 10
    python tests/worlds/baseline_rates.py WORLD --logs 3 5 10 --out DIR [--program target/debug/dreamstream] [--full | --discover]

`--pool 3` keeps three healthy cases of a vehicle for its baselines instead of ten: the others are tested. Processor seconds
a case are those of the diagnoses alone.
"""

import argparse
import json
import math
import pathlib
import resource
import subprocess

POOL = 10


def wilson(hits, count, z=1.645):
    if count == 0:
        return "no case"
    p, n = hits / count, count
    middle, half = (p + z * z / 2 / n) / (1 + z * z / n), z * math.sqrt(p * (1 - p) / n + z * z / 4 / n / n) / (1 + z * z / n)
    return f"{hits} of {count} = {p:.2f} [{middle - half:.2f}, {middle + half:.2f}]"


def rates(labels, found):
    """Counts over the labelled cases; a case without a diagnosis counts as wrong."""
    none = [found.get(name) for name, label in labels.items() if label["kind"] == "none"]
    library = {name: label for name, label in labels.items() if label["kind"] in ("single", "double")}
    singles = {name: {e["id"] for e in label["effects"]} for name, label in library.items() if label["kind"] == "single"}
    pairs = {name: {e["id"] for e in label["effects"]} for name, label in library.items() if label["kind"] == "double"}
    strange = [found.get(name) for name, label in labels.items() if label["kind"] == "out_of_library"]
    verdict = lambda d: d and d["verdict"]
    first = lambda name: found.get(name) and found[name]["effects"] and found[name]["effects"][0]["id"]
    chosen = lambda name: set(found[name]["chosen"]) if found.get(name) else None
    right = [name for name, ids in singles.items() if chosen(name) is not None and ids <= chosen(name)]
    lines = [
        ("false alarms", sum(verdict(d) != "none" for d in none), len(none)),
        ("  of these unknown", sum(verdict(d) == "unknown" for d in none), len(none)),
        ("library called unknown", sum(verdict(found.get(n)) == "unknown" for n in library), len(library)),
        ("first effect right", sum(first(n) in ids for n, ids in singles.items()), len(singles)),
        ("strict", sum(chosen(n) == ids and verdict(found[n]) == "single" for n, ids in singles.items()), len(singles)),
        ("companions beside a right single", sum(len(chosen(n)) > 1 for n in right), len(right)),
        ("pairs both", sum(chosen(n) is not None and ids <= chosen(n) for n, ids in pairs.items()), len(pairs)),
        ("out of library called unknown", sum(verdict(d) == "unknown" for d in strange), len(strange)),
    ]
    return lines


def law_rates(labels, found):
    """Counts of `gap discover`: insertion, law and what it explains of each effect outside the library; laws of healthy cases."""
    strange = {n: label["effects"][0]["insertion"] for n, label in labels.items() if label["kind"] == "out_of_library"}
    none = [found.get(n) for n, label in labels.items() if label["kind"] == "none"]
    told = {n: (found.get(n) or {}).get("discovery") or {} for n in strange}
    first = lambda n: told[n]["insertion"][0]["id"] if told[n].get("insertion") else ""
    share = lambda n: (told[n].get("share_explained") or {}).get("value", 0.0)
    alike = lambda n, place: first(n).startswith(place) or (place == "sensor.x" and first(n) == "sensor.y")
    sensor = lambda place: place.startswith("sensor")
    # what calibration leaves of the car's metrics, in floor units
    left = lambda n: max([s.get("nuisance", s["before"]) / s["floor"] for s in (found.get(n) or {}).get("how_far", []) if "agent" not in s["metric"]] or [0.0])
    wide = [n for n in strange if left(n) >= 2.0]
    # a channel of the car that lies beyond its floor and a tenth of it beyond where calibration left it
    worse = lambda s: s["metric"].startswith("channel:") and s["after"] > max(s.get("nuisance", s["before"]), s["floor"]) + 0.1 * s["floor"]
    lawful = [n for n in strange if "law" in told[n]]
    return [
        ("insertion first", sum(alike(n, place) for n, place in strange.items()), len(strange)),
        ("sensor or physics right", sum(sensor(first(n)) == sensor(place) for n, place in strange.items()), len(strange)),
        ("a law is offered", sum("law" in told[n] for n in strange), len(strange)),
        ("law explains half of kept drives", sum(share(n) >= 0.5 for n in strange), len(strange)),
        ("of two floor units or more", sum(share(n) >= 0.5 for n in wide), len(wide)),
        ("no channel worse by a law", sum(not any(map(worse, found[n]["how_far"])) for n in lawful), len(lawful)),
        ("law on a healthy case", sum("law" in ((d or {}).get("discovery") or {}) for d in none), len(none)),
    ]


def spent():
    """Processor seconds of all programs that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("world", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--logs", type=int, nargs="*", default=[3, 5, 10])
    parser.add_argument("--pool", type=int, default=POOL, help="so many healthy cases of a vehicle are kept for baselines and not tested")
    parser.add_argument("--program", default="target/debug/dreamstream")
    parser.add_argument("--full", action="store_true", help="default effort instead of --quick")
    parser.add_argument("--discover", action="store_true", help="look for laws, at default effort")
    parser.add_argument("--wrong", action="store_true", help="list what is wrong")
    given = parser.parse_args()
    labels = json.loads((given.world / "labels.json").read_text())
    fleets = {}
    for name in sorted(labels):
        fleets.setdefault(json.loads((given.world / name / "meta.json").read_text())["vehicle"], []).append(name)
    pool = {vehicle: [n for n in names if labels[n]["kind"] == "none"][: given.pool] for vehicle, names in fleets.items()}
    targets = {v: [n for n in names if n not in pool[v]] for v, names in fleets.items()}
    tested = {n: labels[n] for names in targets.values() for n in names}
    for count in given.logs:
        out, found, secs = given.out / f"logs-{count}", {}, 0.0
        for vehicle, names in targets.items():
            baseline = []
            if count:
                file = out / f"{vehicle}.json"
                healthy = [given.world / n for n in pool[vehicle][:count]]
                subprocess.run([given.program, "gap", "baseline", *healthy, "-o", file], check=True, capture_output=True)
                baseline = ["--baseline", file]
            command = [given.program, "gap", "discover" if given.discover else "diagnose", *(given.world / n for n in names), "--no-pages", "--out", out, *baseline]
            before = spent()
            subprocess.run(command + ([] if given.full or given.discover else ["--quick"]), capture_output=True)
            secs += spent() - before
            for n in names:
                path = out / n / "diagnosis.json"
                if path.exists():
                    found[n] = json.loads(path.read_text())
        (out / "labels.json").write_text(json.dumps(tested, indent=1))
        print(f"{given.world.name}: baseline of {count} healthy logs" if count else f"{given.world.name}: no baseline")
        for what, hits, of in rates(tested, found) + (law_rates(tested, found) if given.discover else []):
            print(f"  {what:34} {wilson(hits, of)}")
        print(f"  {'processor seconds a case':34} {secs / max(len(tested), 1):.1f}", flush=True)
        if given.wrong:
            for n, label in tested.items():
                d, ids = found.get(n), [e["id"] for e in label["effects"]]
                good = d and (d["verdict"] == "unknown" if label["kind"] == "out_of_library" else sorted(d["chosen"]) == sorted(ids) and d["verdict"] != "unknown")
                if not good:
                    print("   ", n, ids, "→", d and (d["verdict"], d["chosen"], [f"{e['id']} {e['evidence_gain']:.1f}" for e in d["effects"][:3]], round(d["p_unknown"], 2)))


if __name__ == "__main__":
    main()
