"""Real logs with an effect put in by hand, where the truth is known: what a baseline of other stretches finds of it.

Takes cases written by `gap import`, cuts their drives into stretches, deals these in turn to small cases, and writes beside
each case copies into which one effect was put, by arithmetic on the recorded columns alone: no simulator has a part in it.
Every fold of the cases is diagnosed against a baseline of the untouched cases of the other folds.

    dreamstream gap import configs/gap/iac-av21-racecar.toml DATA/iac-av21-racecar -o CASES/av21
    python tests/worlds/real_injection.py CASES/av21 CASES/dart --out WORLD --seed 1
    python tests/worlds/real_injection.py --rates WORLD --out DIR [--program target/debug/dreamstream] [--full] [--wrong]
"""

import argparse
import csv
import json
import pathlib
import subprocess

import numpy as np

from baseline_rates import rates, wilson

STEP = 0.05
LEAST_DRIVES = 2


def later(columns, steps):
    """Measurements that arrive `steps` samples after they were taken."""

    def change(table):
        for c in set(columns) & set(table):
            table[c] = np.concatenate([np.full(steps, np.nan), table[c][:-steps]])

    return change


def sooner(column, steps):
    """A command that acts `steps` samples after it was given."""
    return lambda table: table.update({column: np.concatenate([table[column][steps:], np.full(steps, np.nan)])})


def put(r, kind):
    """Draws one effect: parameters of its label and the arithmetic that puts it into a table, with the channels it needs."""
    steps = int(r.integers(1, 5)) if kind.endswith("latency") else int(r.integers(2, 7))
    sign = r.choice([-1, 1])
    if kind == "imu_latency":
        return steps * STEP, later(["yaw_rate", "ax", "ay"], steps), {"yaw_rate"}
    if kind == "pose_latency":
        return steps * STEP, later(["x", "y", "yaw"], steps), {"x"}
    if kind == "steer_delay":
        return steps * STEP, sooner("cmd_steer", steps), {"cmd_steer"}
    if kind == "accel_delay":
        return steps * STEP, sooner("cmd_accel", steps), {"v_wheel"}
    if kind == "wheel_scale":
        scale = 1 + sign * r.uniform(0.03, 0.06)
        return scale, lambda table: table.update(v_wheel=table["v_wheel"] * scale), {"v_wheel"}
    bias = sign * r.uniform(0.005, 0.02)
    return bias, lambda table: table.update(yaw_rate=table["yaw_rate"] + bias), {"yaw_rate"}


KINDS = ["imu_latency", "pose_latency", "steer_delay", "accel_delay", "wheel_scale", "gyro_bias"]


def read(path):
    with open(path, newline="") as file:
        rows = list(csv.reader(file))
    return {name: np.array([float(row[i]) if row[i] else np.nan for row in rows[1:]]) for i, name in enumerate(rows[0])}


def write(path, table):
    """Writes the rows in which both commands stand."""
    whole = np.isfinite(table["cmd_steer"]) & np.isfinite(table["cmd_accel"])
    names = list(table)
    lines = [",".join("" if np.isnan(table[n][i]) else f"{table[n][i]:.9g}" for n in names) for i in np.flatnonzero(whole)]
    path.write_text(",".join(names) + "\n" + "\n".join(lines) + "\n")


def stretches(case, meta, secs):
    """The drives of a case in pieces of so many seconds, ends left over dropped."""
    rows = round(secs / STEP)
    for drive in meta["drives"]:
        table = read(case / drive["file"])
        for start in range(0, len(table["t"]) - rows + 1, rows):
            yield {name: column[start : start + rows] for name, column in table.items()}


def deal(case, out, secs, drives, r):
    """Writes the untouched and the touched cases of one imported log; returns their labels."""
    meta = json.loads((case / "meta.json").read_text())
    pieces = list(stretches(case, meta, secs))
    count = len(pieces) // drives
    missing = set(meta.get("channels_missing", []))
    labels = {}
    for number in range(count):
        mine = [pieces[number + k * count] for k in range(drives)]
        for kind in ["none", *KINDS]:
            value, change, needed = (None, lambda table: None, set()) if kind == "none" else put(r, kind)
            if needed & missing or (kind == "accel_delay" and "cmd_accel" in meta.get("channels_derived", [])):
                continue
            name = f"{case.name}-{number:02d}-{kind}"
            folder = out / name
            folder.mkdir(parents=True)
            for k, piece in enumerate(mine):
                table = dict(piece)
                change(table)
                write(folder / f"drive_{k}.csv", table)
            described = {**meta, "case": name, "vehicle": case.name, "day": f"{number:02d}", "drives": [{"file": f"drive_{k}.csv"} for k in range(drives)]}
            (folder / "meta.json").write_text(json.dumps(described, indent=1))
            effects = [] if kind == "none" else [{"id": kind, "value": round(float(value), 4)}]
            labels[name] = {"kind": "none" if kind == "none" else "single", "effects": effects, "log": case.name, "number": number}
    return labels


def judge(world, labels, log, given):
    """Diagnoses every fold of a log against the untouched cases of the others."""
    mine = {n: label for n, label in labels.items() if label["log"] == log}
    numbers = sorted({label["number"] for label in mine.values()})
    found = {}
    for fold in range(given.folds):
        tested = [n for n, label in mine.items() if label["number"] % given.folds == fold]
        healthy = [world / n for n, label in mine.items() if label["kind"] == "none" and label["number"] % given.folds != fold][: given.logs]
        if not tested or not healthy:
            continue
        out = given.out / log / f"fold-{fold}"
        out.mkdir(parents=True, exist_ok=True)
        subprocess.run([given.program, "gap", "baseline", *healthy, "-o", out / "baseline.json"], check=True, capture_output=True)
        command = [given.program, "gap", "diagnose", *(world / n for n in tested), "--no-pages", "--out", out, "--baseline", out / "baseline.json"]
        subprocess.run(command + ([] if given.full else ["--quick"]), capture_output=True)
        found.update({n: json.loads((out / n / "diagnosis.json").read_text()) for n in tested if (out / n / "diagnosis.json").exists()})
    print(f"{log}: {len(numbers)} cases of stretches, {given.folds} folds, baselines of at most {given.logs} cases")
    return mine, found


def report(labels, found, wrong):
    for what, hits, of in rates(labels, found):
        if of:
            print(f"  {what:34} {wilson(hits, of)}")
    by_kind = {}
    for n, label in labels.items():
        if label["effects"]:
            kind = label["effects"][0]["id"]
            effects = (found.get(n) or {}).get("effects")
            hit, of = by_kind.get(kind, (0, 0))
            by_kind[kind] = (hit + bool(effects and effects[0]["id"] == kind), of + 1)
    print("  first right by kind: " + ", ".join(f"{kind} {hit}/{of}" for kind, (hit, of) in by_kind.items()))
    for n, label in labels.items() if wrong else []:
        d, ids = found.get(n), [e["id"] for e in label["effects"]]
        if not (d and d["chosen"] == ids and d["verdict"] != "unknown"):
            print("   ", n, label["effects"], "→", d and (d["verdict"], d["chosen"], [f"{e['id']} {e['evidence_gain']:.1f}" for e in d["effects"][:3]], round(d["p_unknown"], 2)))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=pathlib.Path, nargs="*")
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--secs", type=float, default=15.0, help="length of a stretch")
    parser.add_argument("--drives", type=int, default=3, help="stretches of a case")
    parser.add_argument("--rates", type=pathlib.Path, help="a world written before: diagnose it and print rates by log")
    parser.add_argument("--folds", type=int, default=2)
    parser.add_argument("--logs", type=int, default=10, help="at most so many healthy cases in a baseline")
    parser.add_argument("--program", default="target/debug/dreamstream")
    parser.add_argument("--full", action="store_true", help="default effort instead of --quick")
    parser.add_argument("--wrong", action="store_true", help="list what is wrong")
    given = parser.parse_args()
    if given.rates is None:
        labels = {}
        for index, case in enumerate(given.cases):
            labels.update(deal(case, given.out, given.secs, max(given.drives, LEAST_DRIVES), np.random.default_rng([given.seed, index])))
        (given.out / "labels.json").write_text(json.dumps(labels, indent=1))
        return
    labels = json.loads((given.rates / "labels.json").read_text())
    all_labels, all_found = {}, {}
    for log in sorted({label["log"] for label in labels.values()}):
        mine, found = judge(given.rates, labels, log, given)
        report(mine, found, given.wrong)
        all_labels.update(mine)
        all_found.update(found)
    print("all logs")
    report(all_labels, all_found, False)


if __name__ == "__main__":
    main()
