"""How often `gap watch` alarms over healthy driving, and how soon after an effect began, on worlds drawn with `--fleet`.

For every vehicle its last healthy cases make the baseline; its other healthy cases are watched one after another. With
`--steps`, effects are watched by the same baselines: cases of the same seed in which one begins within a drive
(`own_world.py --onset`), or the world's own single effects, which begin with their log. Sizes are floor units as the
example `effect-sizes` of ds-dynamics prints them.

    python tests/worlds/own_world.py --out WORLD --seed SEED --fleet 3 --none 800 --singles 48 --pairs 0 --unknown 0
    cargo run -p ds-dynamics --example effect-sizes -- STEPS > SIZES
    python tests/worlds/watch_rates.py WORLD --out DIR --logs 3 10 --rates 1 10 [--steps STEPS --sizes SIZES]
"""

import argparse
import json
import math
import pathlib
import subprocess

BANDS = [(0, 2), (2, 4), (4, 8), (8, 1000)]
DRIVE_SECS = 35.0


def poisson(count):
    """The 90 % interval of the mean of a count, by bisection of its tails."""
    below = lambda mean, most: sum(math.exp(-mean + k * math.log(mean) - math.lgamma(k + 1)) for k in range(most + 1))

    def solve(wanted, most):
        low, high = 1e-9, 10.0 * (count + 5)
        for _ in range(80):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if below(middle, most) > wanted else (low, middle)
        return low
    return 0.0 if count == 0 else solve(0.95, count - 1), solve(0.05, count)


def watched(given, cases, baseline, rate, file):
    """Watches cases one after another; returns the report, or nothing where the watch refused."""
    command = [given.program, "gap", "watch", *cases, "--baseline", baseline, "--alarms-per-hour", str(rate), "--alarms-only", "-o", file]
    file.unlink(missing_ok=True)
    said = subprocess.run(command, capture_output=True, text=True)
    if said.returncode:
        print("   refused:", said.stderr.strip().splitlines()[-1])
    return json.loads(file.read_text()) if file.exists() else None


def delay(report, onset):
    """Seconds from the onset to the first alarm after it; without a limit where there is none."""
    since = lambda alarm: (alarm["drive"] - onset["drive"]) * DRIVE_SECS + alarm["secs"] - onset["secs"]
    return min((since(a) for a in (report or {"alarms": []})["alarms"] if since(a) > 0), default=math.inf)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("world", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--logs", type=int, nargs="*", default=[3, 10])
    parser.add_argument("--rates", type=float, nargs="*", default=[1.0, 10.0])
    parser.add_argument("--steps", type=pathlib.Path, help="cases with effects of the same vehicles; the world itself for its singles")
    parser.add_argument("--sizes", type=pathlib.Path)
    parser.add_argument("--only-steps", action="store_true")
    parser.add_argument("--program", default="target/debug/dreamstream")
    given = parser.parse_args()
    labels = json.loads((given.world / "labels.json").read_text())
    vehicle = lambda folder: json.loads((folder / "meta.json").read_text())["vehicle"]
    fleets = {}
    for name in sorted(labels):
        if labels[name]["kind"] == "none":
            fleets.setdefault(vehicle(given.world / name), []).append(given.world / name)
    steps, sizes = {}, {}
    if given.steps:
        sizes = json.loads(given.sizes.read_text())
        labelled = json.loads((given.steps / "labels.json").read_text())
        steps = {given.steps / n: label for n, label in labelled.items() if label["kind"] == "single" and sizes.get(n) is not None}
    given.out.mkdir(parents=True, exist_ok=True)
    for count in given.logs:
        baselines = {}
        for v, cases in fleets.items():
            baselines[v] = given.out / f"{v}-{count}.json"
            subprocess.run([given.program, "gap", "baseline", *cases[-count:], "-o", baselines[v]], check=True, capture_output=True)
        for rate in given.rates:
            print(f"{given.world.name}: baselines of {count} healthy logs, {rate:g} alarms an hour set", flush=True)
            if not given.only_steps:
                told = [watched(given, cases[:-count], baselines[v], rate, given.out / f"{v}-{count}-{rate:g}.json") for v, cases in fleets.items()]
                alarms, hours = sum(len(r["alarms"]) for r in told), sum(r["hours"] for r in told)
                low, high = (n / hours / rate for n in poisson(alarms))
                each = ", ".join(f"{len(r['alarms'])} in {r['hours']:.2f} h" for r in told)
                print(f"   {alarms} alarms in {hours:.2f} h = {alarms / hours / rate:.2f} times the set rate [{low:.2f}, {high:.2f}] ({each})", flush=True)
            found = []
            for case, label in steps.items():
                report = watched(given, [case], baselines[vehicle(case)], rate, given.out / "step.json")
                onset = label.get("onset") or {"drive": 0, "secs": 0.5}
                found.append((sizes[case.name], delay(report, onset), label["effects"][0]["id"]))
            for low, high in BANDS if found else []:
                band = sorted(d for size, d, _ in found if low <= size < high)
                if band:
                    middle = band[len(band) // 2] if len(band) % 2 else 0.5 * (band[len(band) // 2 - 1] + band[len(band) // 2])
                    late = sorted(e for size, d, e in found if low <= size < high and d > 30)
                    print(f"   {low} to {high} floor units, {len(band)} steps: median delay {middle:.1f} s, {sum(d <= 30 for d in band)} within 30 s; later or never: {', '.join(late)}", flush=True)


if __name__ == "__main__":
    main()
