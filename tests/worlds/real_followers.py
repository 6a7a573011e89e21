"""Real leader-follower pairs (CommonRoad NGSIM, nuScenes scenarios) as a case for the gap diagnosis, and the check on other vehicles.

A pair is a vehicle whose nearest vehicle ahead in its own lane stays the same for at least 6.6 s (one window of 5 s and its history). Every pair is one drive: the
leader stands in as ego vehicle (its commands are computed from its own motion, so that nothing is learned from it), the
follower is agent 1. Odd pairs are held out. `--judge` simulates the held-out followers 5 s behind their recorded leaders,
with the nominal driver and with the diagnosed one, and prints displacement at 1, 3, 5 s and the distance between the gap
distributions (Wasserstein, m), with 90 % bootstrap intervals over pairs.

    python tests/worlds/real_followers.py DATA_DIR --out CASE_DIR [--source ngsim|nuscenes] [--judge diagnosis.json]
"""

import argparse
import json
import pathlib
import xml.etree.ElementTree as xml

import numpy as np

IDM = {"headway": 1.4, "min_gap": 2.5, "max_accel": 1.5, "comfort_decel": 2.0, "exponent": 4}
DESIRED = {"ngsim": 29.0, "nuscenes": 14.0}  # speed limits: US 101, town roads
STEP, SHORTEST = 0.1, 66


def ngsim(data):
    """Tracks {id: (length, {step: (x, y, yaw, v)})} of the motorway scenario."""
    root = xml.parse(next((data / "commonroad-ngsim").glob("USA_US101*.xml"))).getroot()
    number = lambda node, path: float(node.find(f"{path}/exact").text)
    for obstacle in root.iter("dynamicObstacle"):
        states = [obstacle.find("initialState")] + obstacle.findall("trajectory/state")
        rows = {int(number(s, "time")): (float(s.find("position/point/x").text), float(s.find("position/point/y").text),
                                         number(s, "orientation"), number(s, "velocity")) for s in states}
        yield obstacle.get("id"), float(obstacle.find("shape/rectangle/length").text), rows


def nuscenes(data):
    for path in sorted((data / "nuscenes-mini-scenarios").glob("scene-*.json")):
        for track in json.loads(path.read_text())["tracks"]:
            if track["type"] == "VEHICLE":
                values = zip(track["x"], track["y"], track["heading"], np.hypot(track["vx"], track["vy"]))
                yield f"{path.stem}:{track['id']}", track["length"], dict(zip(track["steps"], values))


def pairs(tracks):
    scenes = {}
    for track in tracks:
        scenes.setdefault(track[0].split(":")[0] if ":" in track[0] else "", []).append(track)
    for scene in scenes.values():
        yield from pairs_of(scene)


def pairs_of(tracks):
    for name, length, rows in tracks:
        run, leader = [], None
        for step in sorted(rows) + [10**9]:
            best = None
            if step in rows:
                x, y, yaw, _ = rows[step]
                for other, other_length, other_rows in tracks:
                    if other == name or step not in other_rows:
                        continue
                    dx, dy = other_rows[step][0] - x, other_rows[step][1] - y
                    along, across = dx * np.cos(yaw) + dy * np.sin(yaw), dy * np.cos(yaw) - dx * np.sin(yaw)
                    turned = abs(np.angle(np.exp(1j * (other_rows[step][2] - yaw))))
                    if 0 < along < 70 and abs(across) < 1.6 and turned < 0.3 and (best is None or along < best[1]):
                        best = (other, along, along - 0.5 * (length + other_length), other_rows[step], rows[step], step)
            if best and leader == best[0] and (not run or step == run[-1][5] + 1):
                run.append(best)
                continue
            moving = [np.mean([r[k][3] for r in run]) > 2.0 and np.ptp([r[k][2] for r in run]) > 1e-4 for k in (3, 4)] if run else []
            if len(run) >= SHORTEST and all(moving):
                yield run
            run, leader = ([best], best[0]) if best else ([], None)


def write(folder, found, desired):
    folder.mkdir(parents=True, exist_ok=True)
    drives = []
    for k, run in enumerate(found):
        t = STEP * np.arange(len(run))
        lead, own, gap = np.array([r[3] for r in run]), np.array([r[4] for r in run]), np.array([r[2] for r in run])
        yaw = np.unwrap(lead[:, 2])
        v = np.maximum(lead[:, 3], 0.5)
        accel = np.clip(np.gradient(lead[:, 3], STEP), -9, 9)  # annotated boxes jump
        columns = (t, np.clip(np.arctan(2.7 * np.gradient(yaw, STEP) / v), -0.6, 0.6), accel, lead[:, 0], lead[:, 1], yaw)
        rows = "\n".join(",".join(f"{c:.5f}" for c in row) for row in zip(*columns))
        (folder / f"drive_{k}.csv").write_text("t,cmd_steer,cmd_accel,x,y,yaw\n" + rows + "\n")
        rows = "\n".join(f"{t[j]:.1f},1,{own[j, 0]:.3f},{own[j, 1]:.3f},{own[j, 2]:.4f},{own[j, 3]:.3f},{gap[j]:.3f},{lead[j, 3]:.3f}" for j in range(len(run)))
        (folder / f"agents_{k}.csv").write_text("t,id,x,y,yaw,v,gap,v_lead\n" + rows + "\n")
        drives.append({"file": f"drive_{k}.csv", "agents": f"agents_{k}.csv", "agents_desired_speed": desired})
    nominal = {"model": "linear_single_track", "mass": 1500.0, "yaw_inertia": 2700.0, "lf": 1.3, "lr": 1.4, "cornering_stiffness_front": 4e6,
               "cornering_stiffness_rear": 4e6, "steer_lag": 0.0, "accel_lag": 0.0, "rolling_decel": 0.0, "drag_decel_per_v2": 0.0, "friction": 4.0, "idm": IDM}
    split = {"fit": list(range(0, len(found), 2)), "held_out": list(range(1, len(found), 2))}
    (folder / "meta.json").write_text(json.dumps({"case": folder.name, "drives": drives, "nominal": nominal, "suggested_split": split}, indent=1))


def simulate(run, start, driver, desired):
    """Gap and speed of a follower over 5 s from its measured state behind its recorded leader."""
    own, lead = np.array([r[4][3] for r in run]), np.array([r[3][3] for r in run])
    gap = np.array([r[2] for r in run])
    speeds, gaps, accel = list(own[: start + 1]), list(gap[: start + 1]), (own[start] - own[start - 1]) / STEP
    back = int(round(driver["delay"] / STEP))
    for j in range(start, start + 50):
        v, s, ahead = speeds[max(j - back, 0)], max(gaps[max(j - back, 0)], 0.5), lead[max(j - back, 0)]
        wanted = driver["min_gap"] + max(0.0, v * driver["headway"] + v * (v - ahead) / (2 * np.sqrt(driver["max_accel"] * driver["comfort_decel"])))
        wish = max(driver["max_accel"] * (1 - (v / (desired * driver["v0"])) ** IDM["exponent"] - (wanted / s) ** 2), -8.0)
        accel += (wish - accel) * (1 - np.exp(-STEP / driver["lag"]) if driver["lag"] > 0.01 else 1.0)
        after = max(speeds[-1] + STEP * accel, 0.0)
        gaps.append(gaps[-1] + STEP * 0.5 * (lead[j] + lead[j + 1] - speeds[-1] - after))
        speeds.append(after)
    return np.array(gaps[start:])


def judge(found, desired, diagnosis):
    model = json.loads(diagnosis.read_text())["corrected_model"]
    values = {**model["nuisance"], **{e["id"]: e["value"] for e in model["effects"]}}
    nominal = {**IDM, "delay": 0.0, "v0": 1.0, "lag": 0.0}
    of = lambda name, neutral: values.get(name, neutral)
    corrected = {"headway": IDM["headway"] * of("tr_headway", 1), "min_gap": IDM["min_gap"] + of("tr_min_gap", 0), "max_accel": IDM["max_accel"] * of("tr_accel", 1),
                 "comfort_decel": IDM["comfort_decel"] * of("tr_brake", 1), "delay": of("tr_delay", 0), "v0": of("tr_v0", 1), "lag": of("tr_lag", 0)}
    held, errors = found[1::2], []
    for run in held:
        gap = np.array([r[2] for r in run])
        starts = range(14, len(run) - 51, 10)
        errors.append([[simulate(run, s, driver, desired) - gap[s : s + 51] for s in starts] + [gap[s : s + 51] for s in starts] for driver in (nominal, corrected)])
    rng = np.random.default_rng(0)

    def figures(chosen):
        out = []
        for kind in (0, 1):
            miss = np.concatenate([errors[k][kind][: len(errors[k][kind]) // 2] for k in chosen])
            real = np.concatenate([errors[k][kind][len(errors[k][kind]) // 2 :] for k in chosen])
            out.append([np.sqrt(np.mean(miss[:, at] ** 2)) for at in (10, 30, 50)] + [np.mean(np.abs(np.sort((real + miss)[:, 50]) - np.sort(real[:, 50])))])
        return np.array(out)

    everything = figures(range(len(held)))
    draws = np.array([figures(rng.integers(len(held), size=len(held))) for _ in range(300)])
    low, high = np.quantile(draws, 0.05, axis=0), np.quantile(draws, 0.95, axis=0)
    for kind, label in enumerate(("nominal", "corrected")):
        parts = [f"{name} {everything[kind, c]:.2f} [{low[kind, c]:.2f}, {high[kind, c]:.2f}]" for c, name in enumerate(("1 s", "3 s", "5 s", "gap distribution"))]
        print(f"{label}: " + ", ".join(parts) + f" m over {len(held)} held-out pairs")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--source", choices=("ngsim", "nuscenes"), default="ngsim")
    parser.add_argument("--judge", type=pathlib.Path)
    given = parser.parse_args()
    found = list(pairs((ngsim if given.source == "ngsim" else nuscenes)(given.data)))
    print(f"{len(found)} pairs")
    if given.judge:
        judge(found, DESIRED[given.source], given.judge)
    else:
        write(given.out, found, DESIRED[given.source])


if __name__ == "__main__":
    main()
