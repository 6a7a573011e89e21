"""How well `gap fleet` tells affected vehicles from the others, on fleets dealt from a world drawn with `--fleet`.

Every fleet has one case of each vehicle: of some vehicles, drawn, a case with an effect, of the others a healthy one.

    python tests/worlds/own_world.py --out WORLD --seed SEED --fleet 12 --none 48 --singles 48 --pairs 0 --unknown 0
    python tests/worlds/fleet_rates.py WORLD --out DIR [--fleets 8] [--affected 3] [--program target/debug/dreamstream]
"""

import argparse
import json
import pathlib
import subprocess

import numpy as np

from baseline_rates import wilson


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("world", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--fleets", type=int, default=8)
    parser.add_argument("--affected", type=int, default=3)
    parser.add_argument("--program", default="target/debug/dreamstream")
    given = parser.parse_args()
    labels = json.loads((given.world / "labels.json").read_text())
    of = {name: json.loads((given.world / name / "meta.json").read_text())["vehicle"] for name in labels}
    vehicles = sorted(set(of.values()))
    kind = lambda vehicle, wanted: [n for n in sorted(labels) if of[n] == vehicle and labels[n]["kind"] == wanted]
    found, truly, right, called, wrong = 0, 0, 0, 0, []
    for fleet in range(given.fleets):
        r = np.random.default_rng([given.seed, fleet])
        ill = set(r.choice(vehicles, given.affected, replace=False))
        cases = {v: str(r.choice(kind(v, "single" if v in ill else "none"))) for v in vehicles}
        out = given.out / f"fleet-{fleet}"
        command = [given.program, "gap", "fleet", *(given.world / c for c in cases.values()), "--quick", "--out", out]
        subprocess.run(command, check=True, capture_output=True)
        told = {m["name"]: m for m in json.loads((out / "fleet.json").read_text())["members"]}
        for v, case in cases.items():
            ids = [e["id"] for e in labels[case]["effects"]]
            first = told[v]["effects"][0]["id"] if told[v]["effects"] else None
            found += told[v]["affected"] and v in ill
            right += told[v]["affected"] and v in ill and first in ids
            called += told[v]["affected"]
            truly += v in ill
            if told[v]["affected"] != (v in ill):
                wrong.append(f"fleet {fleet} {case} {ids}: log e {told[v]['log_e']:.1f}, {first}")
    print(f"{given.world.name}: {given.fleets} fleets of {len(vehicles)} vehicles, {given.affected} affected in each")
    print(f"  affected vehicles called so        {wilson(found, truly)}")
    print(f"  of these with the right effect     {wilson(right, found)}")
    print(f"  of those called so, falsely        {wilson(called - found, called)}")
    print("\n".join(f"    {line}" for line in wrong))


if __name__ == "__main__":
    main()
