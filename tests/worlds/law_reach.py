"""How far laws that `gap discover` found carry on drives kept from the fit and on harder ones, beside what others learn.

    python tests/worlds/own_world.py --out WORLD --seed 1 ... ; python tests/worlds/own_world.py --out HARDER --seed 1 --amplitude 1.5 ...
    python tests/worlds/baseline_rates.py WORLD --logs 3 --out FOUND --discover
    python tests/worlds/law_reach.py FOUND/logs-3 WORLD HARDER [--peers sparse network] [--program target/debug/dreamstream]

Shares are of the gap of the law's own metric (displacement after 2 s or the sensor's channel) between the fitted ordinary
mismatch and the law; no law is a share of zero. Peers learn all of the gap from the first three drives of a case
(learned_residual.py), so beside them stands the share from the nominal car on, of the displacement after 2 s, for cases whose
effect is no sensor's. Several programs at once share the work by case.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

from baseline_rates import wilson

POSITION = "position_2s"
HERE = pathlib.Path(__file__).parent


def evaluated(given, diagnosis, case, *more):
    """The metrics of `gap evaluate` by name, empty where it refuses."""
    ran = subprocess.run([given.program, "gap", "evaluate", diagnosis, case, *more], capture_output=True, text=True)
    if ran.returncode:
        print(f"{case}: {ran.stderr.strip().splitlines()[-1] if ran.stderr.strip() else ran.returncode}", file=sys.stderr)
        return {}
    return {shrink["metric"]: shrink for shrink in json.loads(ran.stdout)}


def closed(after, of):
    """The share of the nominal car's gap that is closed, in the metric of one shrink; at least −1."""
    gap = of["before"] - of["floor"]
    return max(1 - (after - of["floor"]) / gap, -1.0) if gap > 0 else None


def judge(given, name, harder_alike):
    """Shares of one case: the law's on the kept drive and on harder ones, then each peer's and the whole model's, by world."""
    file = given.found / name / "diagnosis.json"
    diagnosis = json.loads(file.read_text())
    found = diagnosis.get("discovery") or {}
    metric = (found.get("share_explained") or {}).get("metric", POSITION) if "law" in found else None
    told = {"law": {}, "whole": {}}
    for world, case in (("kept", given.world / name), ("harder", given.harder / name)):
        if world == "harder" and not harder_alike:
            continue
        ours = evaluated(given, file, case, "--drives", "3")
        share = ours.get(metric, {}).get("share_explained") or 0.0
        told["law"][world] = max(share, -1.0) if metric else 0.0
        nominal = ours.get(POSITION)
        if not nominal or not given.peers or given.labels[name]["effects"][0]["insertion"].startswith("sensor"):
            continue
        told["whole"][world] = closed(nominal["after"], nominal)
        plain = given.found / name / "nominal.json"
        plain.write_text(json.dumps({**diagnosis, "verdict": "none", "chosen": [], "corrected_model": {"effects": [], "nuisance": {}}}))
        for peer in given.peers:
            command = f"{sys.executable} {HERE / 'learned_residual.py'} {{case}} --fit {given.world / name} --kind {peer}"
            theirs = evaluated(given, plain, case, "--drives", "3", "--simulator", command).get(POSITION)
            told.setdefault(peer, {})[world] = closed(theirs["before"], nominal) if theirs else -1.0
    return told


def median(values):
    return sorted(values)[len(values) // 2] if values else float("nan")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for what in ("found", "world", "harder"):
        parser.add_argument(what, type=pathlib.Path)
    parser.add_argument("--peers", nargs="*", default=[], choices=["sparse", "network", "none"])
    parser.add_argument("--program", default="target/debug/dreamstream")
    given = parser.parse_args()
    given.labels = json.loads((given.found / "labels.json").read_text())
    strange = [n for n, label in given.labels.items() if label["kind"] == "out_of_library" and (given.found / n / "diagnosis.json").exists()]
    car = lambda world, n: json.loads((world / n / "meta.json").read_text())["nominal"]
    alike = {n: (given.harder / n).exists() and car(given.world, n) == car(given.harder, n) for n in strange}
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        told = dict(zip(strange, pool.map(lambda n: judge(given, n, alike[n]), strange)))
    lost = [n for n in strange if not alike[n]]
    print(f"{given.world.name}: {len(strange)} cases outside the library" + (f", {len(lost)} without harder drives of the same vehicle: {lost}" if lost else ""))
    for world, bar in (("kept", 0.5), ("harder", 0.3)):
        of = [t["law"][world] for t in told.values() if world in t["law"]]
        print(f"  law, {world} drives: share {bar} or more {wilson(sum(s >= bar for s in of), len(of))}, median {median(of):.2f}")
    for who in ("whole", *given.peers):
        for world in ("kept", "harder"):
            of = [t[who][world] for t in told.values() if t.get(who, {}).get(world) is not None]
            whole = [t["whole"][world] for t in told.values() if t.get(who, {}).get(world) is not None]
            better = sum(mine < theirs for theirs, mine in zip(of, whole))
            beside = "" if who == "whole" else f", nearer than law and fitted mismatch in {better} of {len(of)}"
            print(f"  {who}, {world} drives: gap of the nominal car closed, median {median(of):.2f}{beside}")
    (given.found / "reach.json").write_text(json.dumps(told, indent=1))


if __name__ == "__main__":
    main()
