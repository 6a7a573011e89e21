"""Checks `gap attribute` on worlds with two effects in different services, drawn from a seed.

The truth is what each effect costs alone, measured on other scenarios than the attribution sees: with two components and
the same drives, the larger Shapley share is the larger single loss by definition, which would show nothing. A world has a
truth where, over those other scenarios, one effect costs at least two points, and as much more than the other with a 90 %
interval above zero; a world that falls short of it on the first twelve of them is not looked at further. Worlds are drawn
until so many have a truth, and what the rest are is printed too. The figure over all worlds with a truth is the one to
judge; beside it stands that of the worlds in which the command itself says which share is largest.

    python tests/worlds/attribution_worlds.py --binary target/debug/dreamstream --out DIR --seed 1 --worlds 20
"""

import argparse
import json
import pathlib
import subprocess

import numpy as np

from service_runs import ROOT, share

# component: effects with the range of their one value, strong enough that a drive's score can notice
SERVICES = {
    "dynamics": {"steer_delay": (0.25, 0.5), "steer_lag": (0.3, 0.7), "steer_gain": (0.75, 0.87), "steer_offset": (0.01, 0.025),
                 "front_grip": (0.5, 0.7), "brake_gain": (0.4, 0.65), "accel_delay": (0.4, 0.7), "steer_rate": (0.04, 0.1)},
    "frames": {"mount_yaw": (1.5, 3.0), "mount_pitch": (1.5, 3.0), "mount_roll": (1.5, 3.0), "focal_error": (0.05, 0.1),
               "gamma": (0.6, 0.75), "defocus": (2.0, 4.0), "sensor_noise": (15.0, 40.0), "night_illumination": (0.1, 0.4)},
    "agents": {"tr_headway": (0.5, 0.6), "tr_delay": (0.6, 1.2), "tr_brake": (0.5, 0.7), "tr_accel": (1.4, 1.6)},
    "latency and sensors": {"obs_latency": (0.3, 0.6), "gyro_bias": (0.02, 0.05), "wheel_scale": (0.88, 0.94), "pose_latency": (0.2, 0.4)},
}
# The scenarios that truth is measured on: their folder, first seed and number.
PARTS = {"screen": (500, 12), "second": (520, 36)}
# Effects of two parameters: what the second one is.
SECOND = {"sensor_noise": 0.0, "night_illumination": 0.3}


def draw(r):
    """Returns two effects (component, id, values) of different components."""
    names = r.choice(list(SERVICES), 2, replace=False, p=[0.35, 0.35, 0.1, 0.2])
    made = []
    for component in map(str, names):
        effect = str(r.choice(list(SERVICES[component])))
        values = [float(r.uniform(*SERVICES[component][effect]))]
        made.append((component, effect, values + ([SECOND[effect]] if effect in SECOND else [])))
    return made


def write(path, effects):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(f'[[effects]]\nid = "{name}"\nvalues = {values}\n' for _, name, values in effects))
    return path


def call(given, *arguments):
    with open(given.out / "log.txt", "a") as said:
        said.write("\n$ " + " ".join(map(str, arguments)) + "\n")
        said.flush()
        subprocess.run([str(given.binary), *map(str, arguments)], cwd=ROOT, stdin=subprocess.DEVNULL, stdout=said, stderr=said, check=True)


def score(given, part, config, out):
    """Returns the driving score of each scenario of a part of the second set."""
    out = out / part
    if not (out / "results.json").exists():
        call(given, "run", given.out / part, "--policy", given.policy, "--observation", given.observation, "--duration", given.duration,
             "--no-pictures", "--config", config, "--out", out)
    episodes = json.loads((out / "results.json").read_text())["episodes"]
    return {e["scenario"]: 100 * (e["driving_score"] or 0.0) for e in episodes}


def alone(given, folder, effects, nominal):
    """Returns what each effect costs by itself, and whether one of them clearly costs more: the truth of a world."""
    losses = {component: np.zeros(0) for component, _, _ in effects}
    for part in PARTS:
        for component, name, values in effects:
            scores = score(given, part, write(folder / f"{name}.toml", [(component, name, values)]), folder / name)
            losses[component] = np.append(losses[component], [nominal[key] - scores[key] for key in sorted(scores)])
        one, other = losses.values()
        apart = (one - other) * np.sign(np.sum(one - other) or 1.0)
        if apart.mean() < 2.0 or max(one.mean(), other.mean()) < 2.0:
            break
    drawn = np.random.default_rng(0).integers(0, len(apart), (2000, len(apart)))
    clear = min(apart.mean(), max(one.mean(), other.mean())) >= 2.0 and np.quantile(apart[drawn].mean(axis=1), 0.05) > 0
    return {component: float(loss.mean()) for component, loss in losses.items()}, bool(clear)


def attribute(given, folder, effects):
    """Returns the points that `gap attribute` gives to each component, and whether it calls the largest apart."""
    config = write(folder / "real.toml", effects)
    if not (folder / "attribution/attribution.json").exists():
        call(given, "gap", "attribute", given.out / "first", "--config", config, "--policy", given.policy, "--real-frames", given.observation,
             "--nominal-frames", given.observation, "--duration", given.duration, "--out", folder / "attribution")
    report = json.loads((folder / "attribution/attribution.json").read_text())[0]
    split = next(metric for metric in report["metrics"] if metric["metric"] == "driving_score")
    return {part["component"]: (-100 * part["value"]) for part in split["shares"]}, split["lead"]["apart"]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--binary", type=pathlib.Path, default=ROOT / "target/debug/dreamstream")
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--worlds", type=int, default=20)
    parser.add_argument("--start", type=int, default=0, help="number of the first world: goes on with a draw that was stopped, the worlds are the same")
    parser.add_argument("--scenarios", type=int, default=48)
    parser.add_argument("--duration", type=float, default=10.0)
    parser.add_argument("--policy", default="camera")
    parser.add_argument("--observation", default="reference")
    given = parser.parse_args()
    given.out = given.out.resolve()
    given.out.mkdir(parents=True, exist_ok=True)
    for name, (first, count) in {"first": (0, given.scenarios), **PARTS}.items():
        if not (given.out / name).exists():
            call(given, "scenario", "generate", "--seed", 1000 * given.seed + first, "--count", count, "--out", given.out / name)
    idle = write(given.out / "nominal.toml", [])
    nominal = {key: value for part in PARTS for key, value in score(given, part, idle, given.out / "nominal").items()}
    print("| world | component: effect | alone on other scenarios, points | Shapley share, points | apart | right |\n|---|---|---|---|---|---|")
    line = lambda d: ", ".join(f"{k} {v:.1f}" for k, v in d.items())
    rights, sure, number = [], [], given.start
    while len(rights) < given.worlds and number < given.start + 10 * given.worlds:
        folder, effects = given.out / f"world_{number:02d}", draw(np.random.default_rng([given.seed, number]))
        truth, clear = alone(given, folder, effects, nominal)
        told = ", ".join(f"{c}: {n} {v[0]:.3g}" for c, n, v in effects)
        said, apart, verdict = "", "", "no truth"
        if clear:
            shares, told_apart = attribute(given, folder, effects)
            rights.append(max(shares, key=shares.get) == max(truth, key=truth.get))
            sure += [rights[-1]] if told_apart else []
            said, apart, verdict = line(shares), "yes" if told_apart else "", "yes" if rights[-1] else "no"
        print(f"| {number} | {told} | {line(truth)} | {said} | {apart} | {verdict} |", flush=True)
        number += 1
    print(f"\nthe largest share names the service that costs most: {share(sum(rights), len(rights))}; {number - given.start - len(rights)} worlds drawn beside them have no truth")
    print(f"where the command calls it apart from the next: {share(sum(sure), len(sure))}")


if __name__ == "__main__":
    main()
