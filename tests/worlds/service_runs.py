"""Plays sealed runs whose effect comes from a Python process in a stage's place on the bus, and scores the diagnosis.

For each run: a service is drawn and a stage of this folder takes its place (own dynamics, own camera, late bridge), with one
withheld effect or none. From the vehicle logs alone `gap diagnose --quick`, `gap apply`; then the scenarios that were kept
from the fit are driven again in the nominal and in the corrected simulator. Answers are opened last.

    python tests/worlds/service_runs.py --binary target/debug/dreamstream --out DIR --seed 1 --effects 20 --none 10
    python tests/worlds/service_runs.py --out DIR --score
"""

import argparse
import json
import math
import os
import pathlib
import shutil
import subprocess
import sys
import time

import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]
STAGES = {"sim": "world_stage.py", "video": "frame_stage.py", "policy": "delay_stage.py"}
# Of twenty effects so many in each service.
SHARES = ["sim"] * 12 + ["video"] * 5 + ["policy"] * 3
PAIRED, HELD = ["cut-in"], ["free-curve", "unprotected-left"]
FLAGS = ["--policy", "log-replay", "--observation", "layout", "--vehicle-log", "--no-pictures", "--duration", "0"]


def plan(seed, effects, none):
    """Returns the runs in random order: (number, kind, service, seed)."""
    r = np.random.default_rng(seed)
    runs = []
    for kind, count in (("single", effects), ("none", none)):
        services = (list(r.permutation(SHARES)) * (count // len(SHARES) + 1))[:count]
        runs += [(kind, str(service), int(r.integers(1, 2**31))) for service in services]
    return [(number, *runs[k]) for number, k in enumerate(r.permutation(len(runs)))]


def call(binary, *arguments, log):
    with open(log, "a") as said:
        said.write("\n$ " + " ".join(map(str, arguments)) + "\n")
        said.flush()
        return subprocess.run([str(binary), *map(str, arguments)], cwd=ROOT, stdin=subprocess.DEVNULL, stdout=said, stderr=said).returncode


def scenario(name):
    return ROOT / f"scenarios/base/{name}.scenario.json"


def part(real, names, out):
    """Makes a folder of some drives of a folder of vehicle logs."""
    out.mkdir(parents=True, exist_ok=True)
    meta = json.loads((real / "meta.json").read_text())
    meta["drives"] = [drive for drive in meta["drives"] if (drive["file"].removesuffix(".mcap") in names)]
    for drive in meta["drives"]:
        shutil.copy(real / drive["file"], out / drive["file"])
    (out / "meta.json").write_text(json.dumps(meta))


def drive(given, number, kind, service, seed):
    """Drives one sealed run, and the nominal simulator on the shipped scenarios."""
    folder = given.out / f"run_{number:02d}"
    if (folder / "driven").exists():
        return
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    log = folder / "log.txt"
    ground = folder / "ground"
    subprocess.run([sys.executable, HERE / "proving_ground.py", "--out", ground, "--seed", str(seed), "--count", str(given.drives), "--secs", str(given.secs)], check=True)
    stage = f"{service}={sys.executable} {HERE / STAGES[service]} --seed {seed} --kind {kind} --answer {folder / 'answer.json'}"
    tests = [scenario(name) for name in PAIRED + HELD]
    failed = call(given.binary, "run", ground, *tests, *FLAGS, "--stage", stage, "--out", folder / "world", log=log)
    if failed:
        raise SystemExit(f"{folder}: the run failed, see {log}")
    call(given.binary, "run", *tests, *FLAGS, "--out", folder / "nominal", log=log)
    for run in ("world", "nominal"):
        shutil.rmtree(folder / run / "recordings", ignore_errors=True)
    (folder / "driven").touch()


def unseen_frames(binary, folder):
    """Measures a diagnosis of the camera on the frames of the scenarios that it never saw."""
    said, log, apart = folder / "gap/fit-frames/diagnosis.json", folder / "log.txt", folder / "gap-held"
    if said.exists():
        call(binary, "gap", "diagnose", folder / "held", "--nominal", folder / "nominal", "--quick", "--no-pages", "-o", apart, log=log)
        call(binary, "gap", "evaluate", said, apart / "cases/held-frames", "-o", folder / "unseen-frames.json", log=log)


def close(given, number):
    """Diagnoses a sealed run from its vehicle logs alone, corrects the simulator, and drives what the fit never saw."""
    folder = given.out / f"run_{number:02d}"
    if (folder / "done").exists():
        return
    log, began = folder / "log.txt", time.time()
    real = folder / "world/real"
    drives = [drive["file"].removesuffix(".mcap") for drive in json.loads((real / "meta.json").read_text())["drives"]]
    part(real, [name for name in drives if name not in HELD], folder / "fit")
    part(real, HELD, folder / "held")
    call(given.binary, "gap", "diagnose", folder / "fit", "--nominal", folder / "nominal", "--quick", "--no-pages", "-o", folder / "gap", log=log)
    found = sorted((folder / "gap").glob("*/diagnosis.json"))
    call(given.binary, "gap", "apply", *found, "-o", folder / "corrected.toml", log=log)
    call(given.binary, "gap", "evaluate", folder / "gap/fit/diagnosis.json", folder / "held", "-o", folder / "unseen.json", log=log)
    unseen_frames(given.binary, folder)
    call(given.binary, "run", *[scenario(name) for name in HELD], *FLAGS, "--config", folder / "corrected.toml", "--out", folder / "corrected", log=log)
    (folder / "done").write_text(f"{time.time() - began:.0f} s\n")


# --- scoring -----------------------------------------------------------------------------------------------------------


def wilson(hits, of, z=1.645):
    """Returns the 90 % interval of a share."""
    if of == 0:
        return 0.0, 1.0
    p, n = hits / of, of
    middle, half = p + z * z / (2 * n), z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return (middle - half) / (1 + z * z / n), (middle + half) / (1 + z * z / n)


def share(hits, of):
    low, high = wilson(hits, of)
    return f"{hits} of {of} = {hits / max(of, 1):.2f} [{low:.2f}, {high:.2f}]"


def read(path):
    return json.loads(path.read_text()) if path.exists() else None


def positions(path):
    """Returns stamps and positions of a vehicle log."""
    from mcap.reader import make_reader

    with open(path, "rb") as file:
        rows = [json.loads(message.data) for _, channel, message in make_reader(file).iter_messages(topics=["vehicle"])]
    return np.array([(row["t"], row["x"], row["y"]) for row in rows])


def deviation(folder, run):
    """Returns the mean over held-out drives of the rms distance to the real drive, m."""
    gaps = []
    for name in HELD:
        a, b = (positions(folder / which / f"real/{name}.mcap") for which in ("world", run))
        n = min(len(a), len(b))
        gaps.append(float(np.sqrt(((a[:n, 1:] - b[:n, 1:]) ** 2).sum(axis=1).mean())))
    return float(np.mean(gaps))


def driving_scores(folder, run):
    episodes = json.loads((folder / run / "results.json").read_text())["episodes"]
    return {e["scenario"]: e["driving_score"] for e in episodes if e["scenario"] in HELD}


def judge(folder):
    """Compares what was said of a run with its answer."""
    answer = read(folder / "answer.json")
    car, frames = read(folder / "gap/fit/diagnosis.json"), read(folder / "gap/fit-frames/diagnosis.json")
    said = []
    for diagnosis, service in ((car, "sim"), (frames, "video")):
        if diagnosis and diagnosis["verdict"] != "none":
            said += [(name, "policy" if name == "obs_latency" else service) for name in diagnosis["chosen"]]
            if diagnosis["verdict"] == "unknown":
                said.append(("unknown", service))
    truth = {effect["id"]: effect["value"] for effect in answer["effects"]}
    row = {"run": folder.name, "service": answer["service"], "truth": truth, "said": [name for name, _ in said],
           "accused": sorted({service for _, service in said}), "verdicts": [d["verdict"] for d in (car, frames) if d]}
    row["right_service"] = row["accused"] == ([answer["service"]] if truth else [])
    row["strict"] = set(row["said"]) == set(truth)
    source = frames if answer["service"] == "video" and frames else car
    first = source["effects"][0] if source and source["effects"] else None
    row["first"] = first["id"] if first else ""
    row["estimate"] = first["value"] if first else math.nan
    if answer["service"] == "video" and frames:
        held = [s for s in read(folder / "unseen-frames.json") or [] if s["metric"] == "image_rmse"]
        row["predicted"], row["realised"] = frames.get("predicted_share"), held[0].get("share_explained") if held else None
    elif answer["service"] == "sim" and row["said"]:
        unseen = [s for s in read(folder / "unseen.json") or [] if s["metric"] == "position_2s"]
        row["predicted"], row["realised"] = car.get("predicted_share"), unseen[0].get("share_explained") if unseen else None
    mended = "corrected" if (folder / "corrected/results.json").exists() else "nominal"
    row["deviation"] = [deviation(folder, run) for run in ("nominal", mended)]
    world, nominal, corrected = (driving_scores(folder, run) for run in ("world", "nominal", mended))
    off = lambda other: float(np.mean([abs(100 * (other[n] or 0) - 100 * (world[n] or 0)) for n in HELD if n in world and n in other]))
    row["score"] = [off(nominal), off(corrected)]
    return row


def score(out):
    rows = [judge(folder) for folder in sorted(out.glob("run_*")) if (folder / "done").exists()]
    with_effect, without = [r for r in rows if r["truth"]], [r for r in rows if not r["truth"]]
    print("| run | service: withheld | said | right service | strict | share of position predicted, realised | held out: off the real route, m | driving score off by, points |")
    print("|---|---|---|---|---|---|---|---|")
    for r in rows:
        told = ", ".join(f"{k} {v:.3g}" for k, v in r["truth"].items()) or "none"
        shares = f"{r['predicted']:.2f}, {r['realised']:.2f}" if None not in (r.get("predicted"), r.get("realised")) else ""
        said = ", ".join(r["said"]) or f"none (first {r['first']})"
        print(f"| {r['run'][4:]} | {r['service'] or ''}: {told} | {said} | {'yes' if r['right_service'] else 'no'} | {'yes' if r['strict'] else 'no'} | {shares} "
              f"| {r['deviation'][0]:.3f} → {r['deviation'][1]:.3f} | {r['score'][0]:.2f} → {r['score'][1]:.2f} |")
    gaps = sorted(abs(r["predicted"] - r["realised"]) for r in with_effect if None not in (r.get("predicted"), r.get("realised")))
    print(f"\nright service {share(sum(r['right_service'] for r in with_effect), len(with_effect))}")
    print(f"strict effect {share(sum(r['strict'] for r in with_effect), len(with_effect))}")
    print(f"first suspect is the withheld one {share(sum(r['first'] in r['truth'] for r in with_effect), len(with_effect))}")
    print(f"false alarms without effect {share(sum(bool(r['said']) for r in without), len(without))}")
    print(f"median |predicted - realised share| {np.median(gaps) if gaps else math.nan:.3f} over {len(gaps)} runs")
    for name, key in (("route", "deviation"), ("driving score", "score")):
        before, after = (float(np.mean([r[key][i] for r in with_effect])) if with_effect else math.nan for i in (0, 1))
        print(f"{name}: off by {before:.3f} in the nominal, {after:.3f} in the corrected simulator")
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--binary", type=pathlib.Path, default=ROOT / "target/debug/dreamstream")
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--effects", type=int, default=20)
    parser.add_argument("--none", type=int, default=10)
    parser.add_argument("--drives", type=int, default=4, help="drives on the proving ground a run")
    parser.add_argument("--secs", type=float, default=30.0, help="length of each")
    parser.add_argument("--only", type=int, action="append", help="only the runs of these numbers")
    parser.add_argument("--drive", action="store_true", help="drive only; another call diagnoses")
    parser.add_argument("--score", action="store_true", help="score what is there instead of driving")
    given = parser.parse_args()
    given.out = given.out.resolve()
    if given.score:
        score(given.out)
        return
    os.environ.setdefault("PYTHONWARNINGS", "ignore")
    for number, kind, service, seed in plan(given.seed, given.effects, given.none):
        if given.only is None or number in given.only:
            drive(given, number, kind, service, seed)
            if not given.drive:
                close(given, number)
    score(given.out)


if __name__ == "__main__":
    main()
