"""Writes real logs that are not one CSV each (JSON messages, NumPy arrays, split tables) as plain CSV, one row per sample.

Values are copied, angles and axes untouched but for what a CSV cannot hold: quaternions become a heading, geocentric
positions a local east-north plane. Streams of other rates are joined as the latest value at or before the row's stamp,
with the stamp of their own sample beside it. What the columns mean is for the mapping files in `configs/gap/`.

    python tests/worlds/real_logs.py DATA_DIR --out DIR
"""

import argparse
import json
import pathlib

import numpy as np


def write(path, columns):
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = zip(*(np.asarray(column) for column in columns.values()))
    path.write_text(",".join(columns) + "\n" + "\n".join(",".join(f"{v:.9g}" if abs(v) < 1e9 else f"{v:.0f}" for v in row) for row in rows) + "\n")


def latest(t, stamps):
    return np.clip(np.searchsorted(stamps, t, side="right") - 1, 0, len(stamps) - 1)


def heading(w, x, y, z):
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def nuscenes(folder, out):
    read = lambda name: json.loads((folder / f"scene-0103_{name}.json").read_text())
    pose, steer, imu, zoe = read("pose"), read("steeranglefeedback"), read("ms_imu"), read("zoe_veh_info")
    stamps = lambda rows: np.array([row["utime"] for row in rows])
    t, pick = stamps(imu), lambda rows, key: np.array([row[key] for row in rows])
    at = {name: latest(t, stamps(rows)) for name, rows in (("pose", pose), ("steer", steer), ("zoe", zoe))}
    pos, turn, rate, accel = pick(pose, "pos"), pick(pose, "orientation"), pick(imu, "rotation_rate"), pick(imu, "linear_accel")
    first = t[0]
    columns = {
        "utime": t - first, "pose_utime": stamps(pose)[at["pose"]] - first, "x": pos[at["pose"], 0], "y": pos[at["pose"], 1],
        "yaw": heading(*turn.T)[at["pose"]], "vel": pick(pose, "vel")[at["pose"], 0], "rate_z": rate[:, 2], "accel_x": accel[:, 0], "accel_y": accel[:, 1],
        "steer_utime": stamps(steer)[at["steer"]] - first, "steer": pick(steer, "value")[at["steer"]], "zoe_utime": stamps(zoe)[at["zoe"]] - first,
    }
    for wheel in ("FL", "FR", "RL", "RR"):
        columns[f"wheel_{wheel}_rpm"] = pick(zoe, f"{wheel}_wheel_speed")[at["zoe"]]
    keep = t >= max(stamps(pose)[0], stamps(steer)[0], stamps(zoe)[0])
    write(out, {key: value[keep] for key, value in columns.items()})


def comma(folder, out):
    read = lambda name: np.load(folder / f"{name}.npy")
    t, gps = read("IMU_gyro_t"), read("global_pose_frame_times")
    position, q = read("global_pose_frame_positions"), read("global_pose_frame_orientations")
    up = position[0] / np.linalg.norm(position[0])
    east = np.cross([0, 0, 1], up)
    east /= np.linalg.norm(east)
    north = np.cross(up, east)
    local = position - position[0]
    w, x, y, z = q.T
    forward = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], axis=1)
    steer_t, speed_t, wheel_t, acc_t = (read(f"{n}_t") for n in ("CAN_steering_angle", "CAN_speed", "CAN_wheel_speed", "IMU_accelerometer"))
    at = {"gps": latest(t, gps), "steer": latest(t, steer_t), "speed": latest(t, speed_t), "wheel": latest(t, wheel_t), "acc": latest(t, acc_t)}
    gyro, acc = read("IMU_gyro_value"), read("IMU_accelerometer_value")
    columns = {
        "t": t - t[0], "gps_t": gps[at["gps"]] - t[0], "east": (local @ east)[at["gps"]], "north": (local @ north)[at["gps"]],
        "yaw": np.arctan2(forward @ north, forward @ east)[at["gps"]], "steer_t": steer_t[at["steer"]] - t[0], "steer_deg": read("CAN_steering_angle_value").ravel()[at["steer"]],
        "speed_t": speed_t[at["speed"]] - t[0], "speed": read("CAN_speed_value").ravel()[at["speed"]], "gyro_down": gyro[:, 2],
        "acc_forward": acc[at["acc"], 0], "acc_right": acc[at["acc"], 1], "wheel_t": wheel_t[at["wheel"]] - t[0],
    }
    for number, wheel in enumerate(("FL", "FR", "RL", "RR")):
        columns[f"wheel_{wheel}"] = read("CAN_wheel_speed_value")[at["wheel"], number]
    keep = (t >= max(gps[0], steer_t[0], speed_t[0], wheel_t[0])) & (t <= min(gps[-1], steer_t[-1], speed_t[-1]))
    write(out, {key: value[keep] for key, value in columns.items()})


def bayesrace(folder, out):
    read = lambda name: np.loadtxt(folder / f"DYN-PP-ETHZ.{name}.csv", delimiter=",")
    t, states, inputs = read("time"), read("states"), read("inputs")
    count = min(len(states), len(inputs))
    names = ("x", "y", "phi", "vx", "vy", "omega")
    write(out, {"t": t[:count], **{n: states[:count, k] for k, n in enumerate(names)}, "throttle": inputs[:count, 0], "steering": inputs[:count, 1]})


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    given = parser.parse_args()
    for folder, make in (("nuscenes-can-bus-scene-0103", nuscenes), ("comma2k19-example", comma), ("bayesrace-sim", bayesrace)):
        if (given.data / folder).is_dir():
            make(given.data / folder, given.out / f"{folder}.csv")


if __name__ == "__main__":
    main()
