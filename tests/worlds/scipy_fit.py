"""The obvious alternative to the gap diagnosis: every effect fitted to the whole log by a general optimiser.

A linear single track in numpy (all windows side by side) is fitted by `scipy.optimize.least_squares` (soft L1), once per
effect, each with six usual nuisances free; the effects are ranked by the loss left. Prints the ranking and the processor
time beside that of `dynamics-practice --quick` and of the full diagnosis on the same case, in one run, each on one core.

    python tests/worlds/scipy_fit.py CASE --practice target/release/examples/dynamics-practice

Needs numpy and scipy. Leaves out what no smooth residual shows (play, drop-outs, jitter), followers, intervals, pairs,
`unknown` and everything else that the diagnosis answers: it is the cheapest thing of its kind.
"""

import argparse
import json
import os
import pathlib
import resource
import subprocess
import tempfile
import time

import numpy as np
from scipy.optimize import least_squares

STEP, FINE, STRIDE, WARM, SCORED, BLOCK = 0.05, 0.01, 25, 10, 40, 5
G, AIR = 9.81, 1.2
FLOORS = {"dx": 0.03, "dy": 0.03, "dyaw": 0.002, "v": 0.025, "yaw_rate": 0.0025, "ax": 0.06, "ay": 0.07, "steer_meas": 0.0005, "v_wheel": 0.03}
# effect: (neutral, lower, upper)
EFFECTS = {
    "steer_delay": (0, 0, 0.4), "steer_lag": (0, 0, 0.6), "steer_rate": (2, 0.05, 2), "steer_gain": (1, 0.8, 1.2), "steer_offset": (0, -0.02, 0.02),
    "accel_delay": (0, 0, 0.5), "accel_lag": (0, 0, 0.8), "accel_jerk_limit": (30, 0.5, 30), "brake_gain": (1, 0.5, 1.1), "drive_gain": (1, 0.6, 1.1),
    "deadzone_accel": (0, 0, 0.4), "payload": (0, 0, 0.4), "front_grip": (1, 0.6, 1.6), "rear_grip": (1, 0.6, 1.6), "mu": (1, 0.2, 1),
    "yaw_inertia": (1, 0.67, 1.5), "tyre_relaxation": (0.25, 0, 1.2), "cg_shift": (0, -0.3, 0.3), "drag_add": (0, -0.2, 3), "roll_add": (0, 0, 0.02),
    "grade": (0, -0.08, 0.08), "bank": (0, -0.08, 0.08), "suspension_roll": (0, 0, 0.15), "gyro_bias": (0, -0.03, 0.03), "gyro_scale": (0, -0.1, 0.1),
    "ax_bias": (0, -0.4, 0.4), "ay_bias": (0, -0.4, 0.4), "wheel_scale": (1, 0.9, 1.1), "lever_arm": (0, -3, 3), "pose_latency": (0, 0, 0.4),
    "imu_latency": (0, 0, 0.3), "imu_misalignment": (0, -0.1, 0.1),
}
# what every vehicle has a little of, and how much of it a fit may use
NUISANCES = {"steer_delay": (0, 0.03), "accel_delay": (0, 0.03), "steer_gain": (0.985, 1.015), "payload": (0, 0.04), "pose_latency": (0, 0.03), "imu_latency": (0, 0.03)}


def read(folder):
    """Returns the description and the fit drives as columns resampled to 20 Hz."""
    meta = json.loads((folder / "meta.json").read_text())
    fit = meta.get("suggested_split", {}).get("fit", range(len(meta["drives"])))
    drives = []
    for k in fit:
        raw = np.genfromtxt(folder / meta["drives"][k]["file"], delimiter=",", names=True)
        t = np.arange(raw["t"][0], raw["t"][-1], STEP)
        drives.append({c: np.interp(t, raw["t"], raw[c]) for c in raw.dtype.names if c != "t" and not np.isnan(raw[c]).any()})
    return meta["nominal"], drives


def actuated(drive, nominal, p):
    """Returns road-wheel angle and acceleration on the fine grid: delay, limits, first-order lag."""
    count = len(drive["cmd_steer"])
    fine = np.arange(0, (count - 1) * STEP, FINE)
    coarse = np.arange(count) * STEP
    steer = np.interp(fine - p["steer_delay"], coarse, drive["cmd_steer"]) * p["steer_gain"] + p["steer_offset"]
    accel = np.interp(fine - p["accel_delay"], coarse, drive["cmd_accel"])
    dead = p["deadzone_accel"]
    accel = np.sign(accel) * np.maximum(np.abs(accel) - dead, 0)
    accel = np.where(accel > 0, accel * p["drive_gain"], accel * p["brake_gain"])
    return lagged(steer, nominal["steer_lag"] + p["steer_lag"], p["steer_rate"]), lagged(accel, nominal["accel_lag"] + p["accel_lag"], p["accel_jerk_limit"])


def lagged(signal, lag, limit):
    out = np.empty_like(signal)
    now = signal[0]
    share = 1 - np.exp(-FINE / max(lag, 1e-3))
    for k, wanted in enumerate(signal):
        now += np.clip(share * (wanted - now), -limit * FINE, limit * FINE)
        out[k] = now
    return out


def residuals(vector, names, nominal, drives, prepared):
    """Returns measured minus simulated block means of all windows in floor units."""
    p = {k: v[0] for k, v in EFFECTS.items()}
    p.update(zip(names, vector))
    found = []
    for drive, starts in zip(drives, prepared):
        steer, accel = actuated(drive, nominal, p)
        found.append(windows(drive, starts, steer, accel, nominal, p))
    return np.concatenate(found)


def windows(drive, starts, steer, accel, nominal, p):
    per, count = round(STEP / FINE), WARM + SCORED
    mass = nominal["mass"] * (1 + p["payload"])
    lf, lr = nominal["lf"] + p["cg_shift"], nominal["lr"] - p["cg_shift"]
    cf, cr = nominal["cornering_stiffness_front"] * p["front_grip"], nominal["cornering_stiffness_rear"] * p["rear_grip"]
    inertia = nominal["yaw_inertia"] * p["yaw_inertia"]
    base = nominal["lf"] + nominal["lr"]
    load_f, load_r = mass * G * lr / base * p["mu"], mass * G * lf / base * p["mu"]
    v, r = drive["v"][starts].copy(), drive["yaw_rate"][starts].copy()
    slip = np.zeros_like(v)
    yaw, x, y = np.zeros_like(v), np.zeros_like(v), np.zeros_like(v)
    force_f, force_r = np.zeros_like(v), np.zeros_like(v)
    track = {k: [] for k in ("x", "y", "yaw", "v", "r", "ax", "ay", "steer")}
    for k in range((count + 2) * per):
        index = np.minimum(starts * per + k, len(steer) - 1)
        if k == WARM * per:
            v, x, y, yaw = drive["v"][starts + WARM].copy(), x * 0, y * 0, yaw * 0
        fast = np.maximum(v, 1.0)
        want_f, want_r = cf * (steer[index] - (slip + lf * r) / fast), -cr * (slip - lr * r) / fast
        want_f, want_r = load_f * np.tanh(want_f / load_f), load_r * np.tanh(want_r / load_r)
        share = 1 - np.exp(-FINE * fast / max(p["tyre_relaxation"], 1e-3))
        force_f, force_r = force_f + share * (want_f - force_f), force_r + share * (want_r - force_r)
        resist = nominal["rolling_decel"] + p["roll_add"] * G + (nominal["drag_decel_per_v2"] + 0.5 * AIR * p["drag_add"] / nominal["mass"]) * v * v
        along = accel[index] * nominal["mass"] / mass - resist - force_f * np.sin(steer[index]) / mass
        side = (force_f + force_r) / mass
        dv = along - G * p["grade"] + r * slip
        slip = slip + FINE * (side - G * p["bank"] - r * v)
        r = r + FINE * (lf * force_f - lr * force_r) / inertia
        v = np.maximum(v + FINE * dv, 0)
        x, y, yaw = x + FINE * (v * np.cos(yaw) - slip * np.sin(yaw)), y + FINE * (v * np.sin(yaw) + slip * np.cos(yaw)), yaw + FINE * r
        if k >= WARM * per - per:
            for name, value in (("x", x), ("y", y), ("yaw", yaw), ("v", v), ("r", r), ("ax", along), ("ay", side * (1 + p["suspension_roll"])), ("steer", steer[index])):
                track[name].append(value)
    track = {k: np.array(v) for k, v in track.items()}
    return compare(drive, starts, track, p)


def at(track, late):
    """Returns a track at the samples of the scored part, `late` seconds before their stamps."""
    per = round(STEP / FINE)
    place = np.clip((np.arange(1, SCORED + 1) + 1) * per - late / FINE - 1, 0, len(track) - 2)
    low = place.astype(int)
    share = (place - low)[:, None]
    return track[low] * (1 - share) + track[low + 1] * share


def compare(drive, starts, track, p):
    pose, imu = (lambda k: at(track[k], p["pose_latency"])), (lambda k: at(track[k], p["imu_latency"]))
    yaw, lever = pose("yaw"), p["lever_arm"]
    ax, ay = imu("ax"), imu("ay")
    said = {
        "dx": pose("x") + lever * (np.cos(yaw) - 1), "dy": pose("y") + lever * np.sin(yaw), "dyaw": yaw, "v": pose("v"),
        "yaw_rate": imu("r") * (1 + p["gyro_scale"]) + p["gyro_bias"], "ax": ax + p["imu_misalignment"] * ay + p["ax_bias"],
        "ay": ay - p["imu_misalignment"] * ax + p["ay_bias"], "steer_meas": at(track["steer"], 0.0), "v_wheel": at(track["v"], 0.0) * p["wheel_scale"],
    }
    first = starts + WARM
    index = first[None, :] + np.arange(1, SCORED + 1)[:, None]
    index = np.minimum(index, len(drive["cmd_steer"]) - 1)
    out = []
    if "x" in drive:
        heading = drive["yaw"][first]
        dx, dy = drive["x"][index] - drive["x"][first], drive["y"][index] - drive["y"][first]
        measured = {"dx": dx * np.cos(heading) + dy * np.sin(heading), "dy": dy * np.cos(heading) - dx * np.sin(heading), "dyaw": drive["yaw"][index] - heading}
    else:
        measured = {}
    for name, floor in FLOORS.items():
        values = measured.get(name, drive[name][index] if name in drive else None)
        if values is not None:
            z = (values - said[name]).reshape(SCORED // BLOCK, BLOCK, -1).mean(axis=1) / floor
            out.append(z.ravel())
    return np.nan_to_num(np.concatenate(out))


def general(folder):
    """Fits every effect; returns (effect, cost, value) by cost, and the processor seconds."""
    nominal, drives = read(folder)
    prepared = [np.arange(0, len(d["cmd_steer"]) - WARM - SCORED - 2, STRIDE) for d in drives]
    begin = time.process_time()
    rows = []
    for effect, (neutral, low, high) in EFFECTS.items():
        names = [effect] + [n for n in NUISANCES if n != effect]
        bounds = np.array([(low, high)] + [NUISANCES[n] for n in names[1:]], float).T
        start = np.clip([0.5 * neutral + 0.25 * (low + high)] + [EFFECTS[n][0] for n in names[1:]], bounds[0] + 1e-6, bounds[1] - 1e-6)
        found = least_squares(residuals, start, bounds=bounds, loss="soft_l1", x_scale=(bounds[1] - bounds[0]), diff_step=1e-3, max_nfev=15, args=(names, nominal, drives, prepared))
        rows.append((effect, float(found.cost), float(found.x[0])))
    return sorted(rows, key=lambda r: r[1]), time.process_time() - begin


def ours(program, folder, quick):
    """Returns the answer of the diagnosis and its processor seconds on one core."""
    with tempfile.TemporaryDirectory() as out:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        flags = ["--only", folder.name, "--out", out] + (["--quick"] if quick else [])
        subprocess.run([program, str(folder.parent), *flags], check=True, capture_output=True, env={**os.environ, "RAYON_NUM_THREADS": "1"})
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        answer = json.loads((pathlib.Path(out) / folder.name / "diagnosis.json").read_text())
    return answer, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("case", type=pathlib.Path)
    parser.add_argument("--practice", required=True)
    given = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    rows, secs = general(given.case)
    print(f"scipy, {len(EFFECTS)} effects: {secs:.1f} s; best: " + ", ".join(f"{e} {v:.4g} (loss {c:.0f})" for e, c, v in rows[:3]))
    for quick in (True, False):
        answer, mine = ours(given.practice, given.case, quick)
        name = "quick" if quick else "full"
        print(f"diagnosis, {name}: {mine:.1f} s; {answer['verdict']} {', '.join(answer['chosen'])}; scipy takes {secs / mine:.1f} times as long")


if __name__ == "__main__":
    main()
