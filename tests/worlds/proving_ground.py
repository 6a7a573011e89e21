"""Writes scenarios whose recorded drive excites a vehicle: swerves, pedal steps, slow and fast stretches on an empty road.

The drives are those that `own_world.py` plans (urban, handling, highway). A car that follows them (`--policy log-replay`)
shows what it is made of, which gentle town drives do not.

    python tests/worlds/proving_ground.py --out DIR --seed 1 --count 6
"""

import argparse
import json
import pathlib

import numpy as np

import own_world

VEHICLE = {"length_m": 5.176, "width_m": 2.297, "height_m": 1.777, "wheel_base_m": 3.089, "rear_axle_to_centre_m": 1.461,
           "max_steering_rad": 0.6, "max_steering_rate_radps": 0.8, "max_acceleration_mps2": 4.0, "max_deceleration_mps2": 8.0,
           "mass_kg": 2000.0}
CAMERA = {"name": "front", "width_px": 160, "height_px": 96, "fx_px": 114.2518, "fy_px": 114.2518, "cx_px": 80.0, "cy_px": 48.0,
          "k1": 0.0, "k2": 0.0, "x_in_rig_m": 1.5, "y_in_rig_m": 0.0, "z_in_rig_m": 1.6, "yaw_left_rad": 0.0,
          "pitch_down_rad": 0.05, "roll_rad": 0.0}
KINDS = ["handling", "urban", "highway"]


def drive(r, kind, secs):
    """Returns time, pose, speed, yaw rate and acceleration of the rear axle at 10 Hz."""
    dt = own_world.DT
    want_v, want_ay, pedal = own_world.draw_plan(r, kind)
    want_v, want_ay, pedal = (a[int(2.0 / dt):] for a in (want_v, want_ay, pedal))
    v, yaw, x, y, accel, turn = float(want_v[0]), r.uniform(-np.pi, np.pi), 0.0, 0.0, 0.0, 0.0
    rows = []
    steps = round(0.1 / dt)
    for k in range(round(secs / dt) + 1):
        if k % steps == 0:
            rows.append((x, y, yaw, v, turn, accel))
        wish = np.clip(0.9 * (want_v[k] - v) + pedal[k], -2.7, 2.2)
        accel += (wish - accel) * dt / 0.15
        v = max(v + accel * dt, 0.0)
        turn = want_ay[k] / max(v, 3.0)
        yaw += turn * dt
        x, y = x + v * np.cos(yaw) * dt, y + v * np.sin(yaw) * dt
    return np.array(rows)


def ribbon(points, offset):
    """Returns a line beside another, to the left where positive."""
    along = np.gradient(points, axis=0)
    normal = np.column_stack([-along[:, 1], along[:, 0]]) / np.maximum(np.hypot(*along.T), 1e-9)[:, None]
    return points + offset * normal


def scenario(name, rows, kind, seed):
    points, yaw = rows[:, :2], rows[:, 2]
    ends = [np.array([np.cos(a), np.sin(a)]) for a in (yaw[0], yaw[-1])]
    far = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))]) // 3.0
    kept = points[np.concatenate([[True], np.diff(far) > 0])]
    before = points[0] - np.outer(np.arange(40, 0, -5.0), ends[0])
    after = points[-1] + np.outer(np.arange(5.0, 250.0, 5.0), ends[1])
    line = np.vstack([before, kept, after])
    left, right = ribbon(line, 5.0), ribbon(line, -5.0)
    text = lambda a: np.round(a, 3).tolist()
    outline = text(np.vstack([left, right[::-1]]))
    wrapped = (yaw + np.pi) % (2 * np.pi) - np.pi
    column = lambda values, places: np.round(values, places).tolist()
    still = [0.0] * len(rows)
    return {
        "format": "dreamstream-scenario", "version": 1, "name": name, "family": "",
        "origin": {"source": f"proving ground, {kind}, seed {seed}", "licence": "Apache-2.0", "attribution": "The DreamStream authors"},
        "prompt": "front camera view of an empty proving ground", "frame": "x-east y-north z-up", "dt_secs": 0.1,
        "vehicle": VEHICLE, "cameras": [CAMERA],
        "ego_log": {"x_m": column(points[:, 0], 3), "y_m": column(points[:, 1], 3), "heading_rad": column(wrapped, 5),
                    "forward_mps": column(rows[:, 3], 5), "left_mps": still, "yaw_rate_radps": column(rows[:, 4], 5),
                    "forward_mps2": column(rows[:, 5], 5), "left_mps2": column(rows[:, 3] * rows[:, 4], 5),
                    "steering_rad": still, "steering_rate_radps": still},
        "route_m": text(line), "tracks": [],
        "map": {"lanes": [{"name": "main", "kind": "road", "speed_limit_mps": 40.0, "successors": [], "predecessors": [],
                           "left": None, "right": None, "centre_line_m": text(line), "polygon_m": outline}],
                "junctions_m": [], "drivable_m": [outline], "road_edges_m": [text(left), text(right)],
                "lane_lines": [{"kind": "dashed", "colour": "white", "points_m": text(ribbon(line, side))} for side in (-2.0, 2.0)],
                "crosswalks_m": [], "stop_lines": [], "traffic_lights": []},
    }


def write(out, seed, count, secs):
    """Writes scenarios, the kinds of drive in turn; returns their paths."""
    out.mkdir(parents=True, exist_ok=True)
    paths = []
    for number in range(count):
        kind = KINDS[number % len(KINDS)]
        name = f"{kind}-{seed}-{number}"
        rows = drive(np.random.default_rng([seed, number]), kind, secs)
        paths.append(out / f"{name}.scenario.json")
        paths[-1].write_text(json.dumps(scenario(name, rows, kind, seed)))
    return paths


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=6)
    parser.add_argument("--secs", type=float, default=25.0)
    given = parser.parse_args()
    write(given.out, given.seed, given.count, given.secs)


if __name__ == "__main__":
    main()
