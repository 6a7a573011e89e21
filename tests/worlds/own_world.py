"""An independent reference world for the gap diagnosis: writes labelled cases in the practice schema from a seed.

Shares no code with the crates: two-track vehicle, Magic Formula tyres with load sensitivity and friction ellipse,
second-order servo, Heun integration at 4 ms, terrain undulation, own car following, own noise (levels of the practice
README). Needs numpy only. Drives run side by side as lanes of arrays. Not drawn: `obs_latency`, which no log of this
schema can show.

    python tests/worlds/own_world.py --out DIR --seed 1 --singles 240 --none 120 --pairs 60 --unknown 60
"""

import argparse
import copy
import json
import pathlib

import numpy as np

from labelled_case import draw_car

DT = 0.004
SECONDS = 36.5
DRIVES = 5
TOGETHER = 48
G = 9.81
AIR = 1.2

# id: (unit, group, weakest, strongest, shape): magnitudes are drawn evenly in the logarithm from weak to strong; a
# `plus` is added, `either` is added with either sign, `less` divides by 1 + magnitude, `scale` multiplies or divides, a
# `limit` is the magnitude itself, `on` is a switch.
EFFECTS = {
    "steer_delay": ("s", "steer_timing", 0.045, 0.25, "plus"),
    "steer_lag": ("s", "steer_timing", 0.06, 0.35, "plus"),
    "steer_rate": ("rad/s", "steer_timing", 0.06, 0.25, "limit"),
    "steer_backlash": ("rad", "steer_play", 0.004, 0.025, "plus"),
    "steer_offset": ("rad", "steer_zero", 0.004, 0.018, "either"),
    "steer_gain": ("x", "lateral_gain", 0.04, 0.2, "scale"),
    "steer_saturation": ("rad", "steer_range", 0.05, 0.12, "limit"),
    "accel_delay": ("s", "drive_timing", 0.06, 0.4, "plus"),
    "accel_lag": ("s", "drive_timing", 0.08, 0.6, "plus"),
    "accel_jerk_limit": ("m/s^3", "drive_timing", 0.7, 3.0, "limit"),
    "brake_gain": ("x", "brake", 0.08, 0.7, "less"),
    "brake_fade": ("1/MJ", "brake", 0.1, 0.3, "plus"),
    "drive_gain": ("x", "drive", 0.08, 0.5, "less"),
    "power_limit": ("W/kg", "drive", 8.0, 20.0, "limit"),
    "deadzone_accel": ("m/s^2", "drive", 0.08, 0.4, "plus"),
    "cmd_hold_rate": ("Hz", "command_rate", 4.0, 9.0, "limit"),
    "payload": ("kg", "mass", 0.08, 0.38, "plus"),
    "front_grip": ("x", "lateral_gain", 0.15, 0.5, "less"),
    "rear_grip": ("x", "lateral_gain", 0.12, 0.35, "less"),
    "mu": ("x", "friction", 0.3, 0.5, "limit"),
    "yaw_inertia": ("x", "turning", 0.2, 0.48, "scale"),
    "tyre_relaxation": ("m", "turning", 0.4, 1.0, "plus"),
    "cg_shift": ("m", "lateral_gain", 0.06, 0.25, "either"),
    "drag_add": ("m^2 (CdA)", "resistance", 0.35, 2.8, "plus"),
    "roll_add": ("1", "resistance", 0.005, 0.02, "plus"),
    "kinematic_only": ("1", "lateral_gain", 1.0, 1.0, "on"),
    "grade": ("rad", "slope", 0.008, 0.06, "either"),
    "bank": ("rad", "slope", 0.012, 0.07, "either"),
    "wind_steady": ("m/s", "wind", 3.0, 12.0, "either"),
    "suspension_roll": ("1", "accelerometer", 0.06, 0.11, "plus"),
    "gyro_bias": ("rad/s", "gyro", 0.004, 0.028, "either"),
    "gyro_scale": ("1", "gyro", 0.02, 0.1, "either"),
    "ax_bias": ("m/s^2", "accelerometer", 0.12, 0.4, "either"),
    "ay_bias": ("m/s^2", "accelerometer", 0.12, 0.4, "either"),
    "imu_misalignment": ("rad", "accelerometer", 0.025, 0.1, "either"),
    "wheel_scale": ("x", "wheel_odometry", 0.008, 0.08, "scale"),
    "lever_arm": ("m", "pose_point", 0.3, 2.8, "either"),
    "pose_latency": ("s", "pose_timing", 0.04, 0.3, "plus"),
    "imu_latency": ("s", "imu_timing", 0.04, 0.25, "plus"),
    "clock_drift": ("s/s", "pose_timing", 0.0015, 0.01, "plus"),
    "timestamp_jitter": ("s", "jitter", 0.006, 0.03, "plus"),
    "dropped_frames": ("1", "drops", 0.05, 0.35, "plus"),
    "tr_delay": ("s", "traffic_timing", 0.2, 1.0, "plus"),
    "tr_headway": ("x", "traffic_spacing", 0.12, 0.7, "scale"),
    "tr_v0": ("x", "traffic_speed", 0.08, 0.45, "less"),
    "tr_accel": ("x", "traffic_dynamics", 0.25, 0.9, "less"),
    "tr_brake": ("x", "traffic_dynamics", 0.35, 0.9, "less"),
    "tr_min_gap": ("m", "traffic_spacing", 0.6, 3.5, "plus"),
}

# the ten commonest, for curves of detection against size, and the number of sizes
COMMON = ["steer_delay", "steer_offset", "steer_gain", "brake_gain", "drive_gain", "front_grip", "drag_add", "pose_latency", "wheel_scale", "tr_headway"]
CURVE_STEPS = 8

# outside the library: weakest and strongest
UNKNOWN = {
    "steer_stiction": (0.008, 0.015), "gust_bursts": (1.2, 2.2), "brake_pulsation": (0.3, 0.5), "position_jumps": (0.4, 1.0),
    "gyro_wander": (0.012, 0.03), "assist_by_speed": (0.12, 0.25), "one_sided_lag": (0.3, 0.6), "pull_under_power": (0.004, 0.01),
    "rough_patches": (0.5, 1.0), "surging": (0.4, 0.8),
}
# the point of the loop at which each acts, here and in the worlds by other authors
ACTS_AT = {
    "steer_stiction": "steering", "assist_by_speed": "steering", "pull_under_power": "steering", "steer_compliance": "steering",
    "brake_pulsation": "drive", "one_sided_lag": "drive", "rough_patches": "drive", "surging": "drive", "drive_cuts": "drive",
    "gust_bursts": "lateral", "load_slosh": "lateral", "gyro_wander": "sensor.yaw_rate", "position_jumps": "sensor.x",
}


def place(i, acts_at=ACTS_AT):
    """Tells where an effect outside the library acts, for labels."""
    return {"insertion": acts_at[i]} if i in acts_at else {}

# effects that may begin in the middle of a drive
SUDDEN = [
    "steer_delay", "steer_lag", "steer_offset", "steer_gain", "accel_delay", "accel_lag", "brake_gain", "drive_gain", "deadzone_accel", "drag_add",
    "roll_add", "grade", "bank", "wind_steady", "gyro_bias", "gyro_scale", "ax_bias", "ay_bias", "wheel_scale", "pose_latency", "imu_latency", "lever_arm",
]

# effects that a missing channel would hide
NEEDS = {"v_wheel": ["wheel_scale"], "ax": ["ax_bias", "imu_misalignment"], "ay": ["ay_bias", "suspension_roll", "imu_misalignment", "bank"]}


def side(r):
    return 1.0 if r.random() < 0.5 else -1.0


def draw_value(r, effect, share=None):
    """Draws the value of an effect from weak to strong, as the label gives it; `share` fixes how strong, 0 being a
    quarter of the weakest drawn otherwise."""
    _, _, weak, strong, shape = EFFECTS[effect]
    low, high = np.log(weak), np.log(strong)
    if share is not None:
        low = high = np.log(weak / 4) + share * (high - np.log(weak / 4))
    size = float(np.exp(r.uniform(low, high)))
    if shape in ("plus", "limit", "on"):
        return size
    if shape == "either":
        return side(r) * size
    return 1 / (1 + size) if shape == "less" or r.random() < 0.5 else 1 + size


def draw_vehicle(r):
    """Draws a nominal vehicle and the mismatch of the real one."""
    mass, base = np.exp(r.uniform(np.log(950), np.log(3200))), r.uniform(2.4, 3.6)
    lf = base * r.uniform(0.43, 0.53)
    lr = base - lf
    front = mass * G * lr / base * r.uniform(10.0, 13.0)
    rear = front * lf / lr * r.uniform(1.06, 1.22)
    omega, damping = 2 * np.pi * r.normal(4.0, 0.3), r.uniform(0.7, 0.95)
    nominal = {
        "model": "linear_single_track", "mass": round(mass, 0), "yaw_inertia": round(mass * lf * lr * r.uniform(0.9, 1.12), 0),
        "lf": round(lf, 3), "lr": round(lr, 3), "wheelbase": round(base, 3),
        "cornering_stiffness_front": round(front, -2), "cornering_stiffness_rear": round(rear, -2),
        "steer_lag": round(2 * damping / omega, 3), "accel_lag": round(r.uniform(0.07, 0.2), 3),
        "rolling_decel": round(r.uniform(0.09, 0.14), 3),
        "drag_decel_per_v2": round(0.5 * AIR * r.uniform(0.5, 1.1) * (mass / 1500) ** 0.4 / mass, 6), "friction": 1.0,
        "idm": {"headway": round(r.uniform(1.2, 1.6), 2), "min_gap": 2.5, "max_accel": 1.5, "comfort_decel": 2.0,
                "exponent": 4, "vehicle_length": 4.6},
    }
    n = r.normal
    real = {
        "mass": mass * (1 + n(0, 0.012)), "inertia": nominal["yaw_inertia"] * (1 + n(0, 0.03)), "lf": lf, "lr": lr,
        "cf": front * (1 + n(0, 0.02)), "cr": rear * (1 + n(0, 0.02)), "mu": 1.0 + n(0, 0.03),
        "roll": nominal["rolling_decel"] * (1 + n(0, 0.05)), "drag": nominal["drag_decel_per_v2"] * mass * (1 + n(0, 0.05)),
        "steer_gain": 1 + n(0, 0.004), "steer_zero": n(0, 0.0006), "steer_dead": r.uniform(0.004, 0.02),
        "accel_dead": r.uniform(0.004, 0.02), "omega": omega, "damping": damping, "accel_lag": nominal["accel_lag"] * (1 + n(0, 0.05)),
        "pose_age": r.uniform(0.002, 0.014), "imu_age": r.uniform(0.002, 0.014), "wheel_age": r.uniform(0.002, 0.014),
        "encoder_age": r.uniform(0.002, 0.014), "gyro_zero": n(0, 0.0006), "ax_zero": n(0, 0.02), "ay_zero": n(0, 0.02),
        "wheel": 1 + n(0, 0.0012), "crown": n(0, 0.0017), "wind_x": n(0, 0.5), "wind_y": n(0, 0.5),
        "relax": r.uniform(0.2, 0.3), "roll_gain": n(0.035, 0.006), "height": r.uniform(0.4, 0.52), "slip": r.uniform(18, 26),
        "hill": r.uniform(0.0005, 0.0012), "hill_phase": r.uniform(0, 6.28), "imu_noise": r.uniform(0.07, 0.12), "noise": float(np.exp(n(0, 0.12))),
        "follow": {"headway": 1 + n(0, 0.015), "v0": 1 + n(0, 0.01), "accel": 1 + n(0, 0.02), "gap": n(0, 0.04),
                   "lag": r.uniform(0.1, 0.16), "delay": 0.0},
    }
    return nominal, real


# mean speed, its swing, lateral acceleration
KINDS = {"urban": (8.5, 3.0, 2.3), "highway": (24.0, 4.0, 1.7), "handling": (13.5, 3.0, 3.0)}


def draw_plan(r, kind, amplitude=1.0):
    """Draws target speed, target lateral acceleration and pedal steps over time: slow waves, swerves and steps."""
    centre, swing, lateral = KINDS[kind] * np.array([1.0, amplitude, amplitude])
    t = np.arange(0, SECONDS + DT, DT)
    wave = lambda lo, hi: np.sin(2 * np.pi * t / r.uniform(lo, hi) + r.uniform(0, 6.28))
    speed = centre * r.uniform(0.9, 1.1) + swing * (0.7 * wave(9, 16) + 0.5 * wave(5, 8))
    fast = (3.0, 6.0) if kind == "handling" else (5.0, 12.0)
    ay = lateral * (0.6 * wave(*fast) + 0.45 * wave(8, 18) * (wave(13, 30) > -0.3))
    if kind == "handling":
        start = r.uniform(6, 20)
        step = (t > start) & (t < start + 8)
        ay = np.where(step, lateral * 0.8 * np.tanh(1.5 * np.sin(2 * np.pi * (t - start) / r.uniform(2.2, 3.6))), ay)
    window = np.hanning(int(r.uniform(0.1, 0.7) / DT))  # hands need a moment
    ay = np.convolve(np.pad(ay, window.size, mode="edge"), window / window.sum(), mode="same")[window.size:-window.size]
    pedal = np.zeros(t.size)
    for start in r.uniform(2, 33, 5):
        pedal[(t > start) & (t < start + r.uniform(0.8, 2.0))] = amplitude * side(r) * r.choice([0.6, 1.0])
    return np.maximum(speed, 3.5), np.clip(ay, -3.8 * amplitude, 3.8 * amplitude), pedal


def magic(slip, load, stiffness, mu):
    """Side force of one wheel: Magic Formula with C = 1.35, given slope at zero."""
    peak = mu * load
    return peak * np.sin(1.35 * np.arctan(stiffness * slip / (1.35 * np.maximum(peak, 1.0))))


def begin(onset, drive):
    """When an effect begins in a drive: at its onset, in the drives after it from the start, in those before it never."""
    if drive == onset["drive"]:
        return onset["secs"]
    return -1.0 if drive > onset["drive"] else np.inf


class Lanes:
    """All drives of some cases, integrated side by side."""

    def __init__(self, cases):
        self.cases = cases
        self.n = len(cases) * DRIVES
        spread = lambda key, source="real": np.repeat([c[source][key] for c in cases], DRIVES)
        self.real = {k: spread(k) for k in cases[0]["real"] if k != "follow"}
        self.nominal = {k: spread(k, "nominal") for k, v in cases[0]["nominal"].items() if isinstance(v, float)}
        self.e = {k: np.repeat([c["values"].get(k, np.nan) for c in cases], DRIVES) for k in list(EFFECTS) + list(UNKNOWN)}
        starts = [c["onset"] or {"drive": 0, "secs": -1.0} for c in cases]
        self.begins = np.array([begin(s, drive) for s in starts for drive in range(DRIVES)])
        self.now = 0.0
        plans = [draw_plan(c["rng"], kind, c["amplitude"]) for c in cases for kind in c["kinds"]]
        self.want_v, self.want_ay, self.pedal = (np.array([p[i] for p in plans]) for i in range(3))

    def on(self, key, neutral):
        """Value of an effect per lane, neutral where it is absent and until it begins."""
        return np.where(np.isnan(self.e[key]) | (self.now < self.begins), neutral, self.e[key])

    def resistance(self):
        """Rolling resistance and drag as they are now."""
        return self.real["roll"] + G * self.on("roll_add", 0.0), self.real["drag"] + 0.5 * AIR * self.on("drag_add", 0.0)

    def dead(self):
        """Dead times of steering and pedals as they are now, in steps."""
        steer, accel = self.real["steer_dead"] + self.on("steer_delay", 0.0), self.real["accel_dead"] + self.on("accel_delay", 0.0)
        return np.round(steer / DT).astype(int), np.round(accel / DT).astype(int)

    def run(self):
        real, n = self.real, self.n
        steps = self.want_v.shape[1] - 1
        mass = real["mass"] + self.on("payload", 0.0) * self.nominal["mass"]
        inertia = real["inertia"] * (1 + 0.5 * self.on("payload", 0.0))
        rigid = 1 + 19 * self.on("kinematic_only", 0.0)
        cf, cr = real["cf"] * self.on("front_grip", 1.0) * rigid, real["cr"] * self.on("rear_grip", 1.0) * rigid
        mu = real["mu"] * self.on("mu", 1.0) * rigid
        inertia = inertia * self.on("yaw_inertia", 1.0)
        real["lf"] = real["lf"] + self.on("cg_shift", 0.0)
        real["lr"] = real["lr"] - self.on("cg_shift", 0.0)
        real["relax"] = real["relax"] + self.on("tyre_relaxation", 0.0)
        roll, drag = self.resistance()
        base = real["lf"] + real["lr"]
        dead_s, dead_a = self.dead()
        state = {k: np.zeros(n) for k in ("x", "y", "yaw", "vy", "r", "servo", "rate", "servo2", "play", "acc", "af", "ar", "stick", "heat")}
        state["v"] = self.want_v[:, 0].copy()
        cmd_s, cmd_a = np.zeros((n, steps)), np.zeros((n, steps))
        raw_s, raw_a = np.zeros((n, steps)), np.zeros((n, steps))
        log = {k: np.zeros((n, steps)) for k in ("x", "y", "yaw", "v", "r", "ax", "ay", "servo", "wheel")}
        hold = self.on("cmd_hold_rate", 1e9)
        lanes = np.arange(n)
        heading = np.zeros(n)
        gust = self.gusts(steps)
        for k in range(steps):
            self.now = k * DT
            if np.any(np.abs(self.begins - self.now) < DT):
                (roll, drag), (dead_s, dead_a) = self.resistance(), self.dead()
            if k % 5 == 0:  # the controller runs at 50 Hz
                v = np.maximum(state["v"], 3.0)
                want_r = self.want_ay[:, k] / v
                heading = heading + 0.02 * want_r
                heading = state["yaw"] + np.clip(heading - state["yaw"], -0.3, 0.3)
                us = self.nominal["mass"] * (self.nominal["lr"] / self.nominal["cornering_stiffness_front"] - self.nominal["lf"] / self.nominal["cornering_stiffness_rear"]) / base
                steer = want_r / v * (base + us * v * v) + (0.1 * (want_r - state["r"]) + 0.25 * np.clip(heading - state["yaw"], -0.2, 0.2)) * 8.0 / v
                accel = 0.9 * (self.want_v[:, k] - state["v"]) + self.nominal["rolling_decel"] + self.nominal["drag_decel_per_v2"] * v * v + self.pedal[:, k]
                now_s, now_a = np.clip(steer, -0.5, 0.5), np.clip(accel, -2.7, 2.2)
            raw_s[:, k], raw_a[:, k] = now_s, now_a
            fresh = np.floor(k * DT * hold) > np.floor((k - 1) * DT * hold)
            last = max(k - 1, 0)
            cmd_s[:, k] = np.where(fresh | (k == 0), now_s, cmd_s[:, last])
            cmd_a[:, k] = np.where(fresh | (k == 0), now_a, cmd_a[:, last])
            self.actuate(state, cmd_s[lanes, np.maximum(k - dead_s, 0)], cmd_a[lanes, np.maximum(k - dead_a, 0)], k)
            out = self.heun(state, (mass, inertia, cf, cr, mu, roll, drag, base), gust[:, k])
            for key in ("x", "y", "yaw", "v", "r", "servo"):
                log[key][:, k] = state[key]
            log["ax"][:, k], log["ay"][:, k] = out
            log["wheel"][:, k] = state["v"] * (1 + out[0] / G / real["slip"] * 1.1)
        return log, raw_s, raw_a

    def gusts(self, steps):
        gust = np.zeros((self.n, steps))
        t = np.arange(steps) * DT
        for lane in np.flatnonzero(~np.isnan(self.e["gust_bursts"])):
            r = self.cases[lane // DRIVES]["rng"]
            for start in r.uniform(2, 33, 5):
                gust[lane] += self.e["gust_bursts"][lane] * side(r) * np.exp(-(((t - start) / 0.5) ** 2))
        return gust

    def actuate(self, s, steer, accel, k):
        real = self.real
        lag = self.on("steer_lag", 0.0)
        s["servo2"] += np.where(lag > 0, (steer - s["servo2"]) * (1 - np.exp(-DT / np.maximum(lag, 1e-3))), steer - s["servo2"])
        target = s["servo2"]
        stick = self.on("steer_stiction", 0.0)
        s["stick"] = np.where(np.abs(target - s["stick"]) > stick, target, s["stick"])
        target = np.where(stick > 0, s["stick"], target)
        s["rate"] += DT * (real["omega"] ** 2 * (target - s["servo"]) - 2 * real["damping"] * real["omega"] * s["rate"])
        limit = self.on("steer_rate", 1e9)
        s["rate"] = np.clip(s["rate"], -limit, limit)
        end = self.on("steer_saturation", 1e9)
        s["servo"] = np.clip(s["servo"] + DT * s["rate"], -end, end)
        half = 0.5 * self.on("steer_backlash", 0.0)
        s["play"] = np.clip(s["play"], s["servo"] - half, s["servo"] + half)
        assist = self.on("assist_by_speed", 0.0) * np.sin(s["v"] * 1.1)
        pull = self.on("pull_under_power", 0.0) * np.maximum(s["acc"] - 0.5, 0.0)
        s["wheel"] = s["play"] * real["steer_gain"] * self.on("steer_gain", 1.0) * (1 + assist) + real["steer_zero"] + self.on("steer_offset", 0.0) + pull
        width = self.on("deadzone_accel", 0.0)
        accel = np.sign(accel) * np.maximum(np.abs(accel) - width, 0.0)
        lag = real["accel_lag"] + self.on("accel_lag", 0.0)
        lag = np.where(accel > s["acc"], lag + self.on("one_sided_lag", 0.0), lag)
        change = (accel - s["acc"]) * (1 - np.exp(-DT / lag))
        jerk = self.on("accel_jerk_limit", 1e9) * DT
        s["acc"] = s["acc"] + np.clip(change, -jerk, jerk)
        pulse = 1 + self.on("brake_pulsation", 0.0) * np.sin(2 * np.pi * 1.3 * k * DT)
        fade = np.maximum(1 - self.on("brake_fade", 0.0) * s["heat"], 0.1)
        s["heat"] += np.maximum(-accel, 0.0) * self.nominal["mass"] * s["v"] * DT * 1e-6
        surge = self.on("surging", 0.0) * np.sin(2 * np.pi * 0.45 * k * DT)
        pull_on = np.minimum(s["acc"], self.on("power_limit", 1e9) / np.maximum(s["v"], 1.0)) * self.on("drive_gain", 1.0)
        s["push"] = np.where(s["acc"] > 0, pull_on, s["acc"] * self.on("brake_gain", 1.0) * fade * pulse) + surge

    def heun(self, s, p, gust):
        keys = ("x", "y", "yaw", "v", "vy", "r", "af", "ar")
        d1, _ = self.slopes(s, p, gust)
        half = dict(s)
        for key in keys:
            half[key] = s[key] + DT * d1[key]
        d2, out = self.slopes(half, p, gust)
        for key in keys:
            s[key] = s[key] + 0.5 * DT * (d1[key] + d2[key])
        s["v"] = np.maximum(s["v"], 0.5)
        return out

    def slopes(self, s, p, gust):
        mass, inertia, cf, cr, mu, roll, drag, base = p
        real = self.real
        lf, lr, h, track = real["lf"], real["lr"], real["height"], 1.55
        v, sin, cos = s["v"], np.sin(s["yaw"]), np.cos(s["yaw"])
        wx, wy = real["wind_x"] + self.on("wind_steady", 0.0), real["wind_y"]
        along, across = v - (cos * wx + sin * wy), -sin * wx + cos * wy
        air = np.hypot(along, across)
        force = self.nominal["mass"] * s["push"]
        ax0, ay0 = force / mass, v * s["r"]
        shift, tilt = mass * ax0 * h / base, mass * ay0 * h / track
        front, rear = mass * G * lr / base - shift, mass * G * lf / base + shift
        fy = [np.zeros(self.n), np.zeros(self.n)]
        for axle, (load, c, slip, part) in enumerate(((front, cf, s["af"], 0.56), (rear, cr, s["ar"], 0.44))):
            still = mass * G * (lr if axle == 0 else lf) / base
            share = np.where(force > 0, 1.0 if axle == 0 else 0.0, 0.62 if axle == 0 else 0.38)
            for wheel in (-1, 1):
                fz = np.maximum(0.5 * load + wheel * part * tilt, 50.0)
                used = np.clip(np.abs(force * share * 0.5) / (mu * fz), 0, 0.95)
                stiff = 0.5 * c * (fz / (0.5 * still)) ** 0.8
                fy[axle] = fy[axle] + magic(slip, fz, stiff, mu) * np.sqrt(1 - used**2)
        steer = s["wheel"]
        side_air = 2.5 * drag * across * air + mass * gust
        patch = self.on("rough_patches", 0.0) * (np.sin(2 * np.pi * (s["x"] + 0.6 * s["y"]) / 90.0) > 0.6)
        ax = (force - np.sin(steer) * fy[0] - drag * along * air) / mass - roll - patch
        ay = (np.cos(steer) * fy[0] + fy[1] + side_air) / mass
        slope = self.on("grade", 0.0) + real["hill"] * np.sin(0.02 * (s["x"] + s["y"]) + real["hill_phase"])
        bank = real["crown"] + self.on("bank", 0.0)
        d = {
            "x": v * cos - s["vy"] * sin, "y": v * sin + s["vy"] * cos, "yaw": s["r"],
            "v": ax + s["vy"] * s["r"] - G * np.sin(slope), "vy": ay - v * s["r"] - G * np.sin(bank),
            "r": (lf * np.cos(steer) * fy[0] - lr * fy[1] + 0.3 * mass * gust) / inertia,
        }
        speed = np.maximum(v, 1.0)
        d["af"] = speed / real["relax"] * (steer - np.arctan2(s["vy"] + lf * s["r"], speed) - s["af"])
        d["ar"] = speed / real["relax"] * (-np.arctan2(s["vy"] - lr * s["r"], speed) - s["ar"])
        return d, (ax, ay)


def read_sensors(rng, lanes, log, lane, rate_hz=20):
    """Samples one lane's truth with ages, jitter, noise and sensor effects."""
    real = {k: v[lane] for k, v in lanes.real.items()}
    t = 0.5 + 1 / rate_hz * np.arange(35 * rate_hz)
    late = np.isfinite(lanes.begins[lane]) and lanes.begins[lane] > 0
    value = lambda key, neutral: np.where(t < lanes.begins[lane], neutral, lanes.e[key][lane]) if late else lanes.e[key][lane]
    on = lambda key, neutral: neutral if np.isnan(lanes.e[key][lane]) or lanes.begins[lane] == np.inf else value(key, neutral)
    grid = np.arange(log["x"].shape[1]) * DT
    jitter = rng.normal(0, np.hypot(0.001, on("timestamp_jitter", 0.0)), t.size)
    at = lambda key, age: np.interp(t + jitter - age, grid, log[key][lane])
    age = real["pose_age"] + on("pose_latency", 0.0) + on("clock_drift", 0.0) * (t - t[0])
    imu = real["imu_age"] + on("imu_latency", 0.0)
    yaw, arm = at("yaw", age), on("lever_arm", 0.0)
    wander = np.cumsum(rng.normal(0, 1, (2, t.size)), axis=1)
    wander = 0.03 * (wander - wander.mean(axis=1, keepdims=True)) / np.maximum(wander.std(axis=1, keepdims=True), 1e-9)
    jump = np.zeros((2, t.size))
    if not np.isnan(lanes.e["position_jumps"][lane]):
        for start in rng.uniform(3, 33, 6):
            inside = (t > start) & (t < start + rng.uniform(0.6, 1.5))
            jump[:, inside] += on("position_jumps", 0.0) * rng.normal(0, 1, (2, 1))
    drift = on("gyro_wander", 0.0) * np.sin(2 * np.pi * t / 6.0)
    ax, ay = at("ax", imu), at("ay", imu) * (1 + real["roll_gain"] + on("suspension_roll", 0.0))
    turn = on("imu_misalignment", 0.0)
    n = lambda sd: rng.normal(0, sd * real["noise"], t.size)
    rows = {
        "x": at("x", age) + arm * np.cos(yaw) + wander[0] + jump[0] + n(0.012),
        "y": at("y", age) + arm * np.sin(yaw) + wander[1] + jump[1] + n(0.012),
        "yaw": yaw + n(0.0018), "v": at("v", age) + n(0.025),
        "yaw_rate": at("r", imu) * (1 + on("gyro_scale", 0.0)) + on("gyro_bias", 0.0) + real["gyro_zero"] + drift + n(0.0028),
        "ax": ax * np.cos(turn) + ay * np.sin(turn) + on("ax_bias", 0.0) + real["ax_zero"] + n(real["imu_noise"]),
        "ay": ay * np.cos(turn) - ax * np.sin(turn) + on("ay_bias", 0.0) + real["ay_zero"] + n(real["imu_noise"]),
        "steer_meas": np.round((at("servo", real["encoder_age"]) + n(0.0006)) / 0.0005) * 0.0005,
        "v_wheel": at("wheel", real["wheel_age"]) * real["wheel"] * on("wheel_scale", 1.0) + n(0.03),
    }
    for k in np.flatnonzero(rng.random(t.size) < on("dropped_frames", 0.0)):
        if k > 0:
            for key in ("x", "y", "yaw", "v", "yaw_rate", "ax", "ay"):
                rows[key][k] = rows[key][k - 1]
    return t, rows


def follow(rng, case, lead_x, lead_v, desired):
    """Two followers at 25 Hz: own code of the intelligent driver model with lag, delay and acceleration noise."""
    idm, real, on = case["nominal"]["idm"], case["real"]["follow"], lambda k, d: case["values"].get(k, d)
    step, rows = 0.04, []
    head = idm["headway"] * real["headway"] * on("tr_headway", 1.0)
    v0 = desired * real["v0"] * on("tr_v0", 1.0)
    amax = idm["max_accel"] * real["accel"] * on("tr_accel", 1.0)
    gap0 = idm["min_gap"] + real["gap"] + on("tr_min_gap", 0.0)
    back = int(round((real["delay"] + on("tr_delay", 0.0)) / step))
    for number in (1, 2):
        v, a = min(lead_v[0], 0.97 * v0), 0.0
        gap = (gap0 + head * v) / np.sqrt(max(1 - (v / v0) ** 4, 0.08))
        vs, gaps = [v], [gap]
        shake = 0.0
        for k in range(len(lead_v) - 1):
            j = max(k - back, 0)
            wish_gap = gap0 + max(0.0, vs[j] * head + vs[j] * (vs[j] - lead_v[j]) / (2 * np.sqrt(amax * idm["comfort_decel"] * on("tr_brake", 1.0))))
            wish = max(amax * (1 - (vs[j] / v0) ** idm["exponent"] - (wish_gap / max(gaps[j], 0.5)) ** 2), -8.0)
            a += (wish - a) * (1 - np.exp(-step / real["lag"]))
            shake += -shake * step / 0.5 + 0.06 * np.sqrt(2 * step / 0.5) * rng.normal()
            nv = max(vs[-1] + step * (a + shake), 0.0)
            gaps.append(gaps[-1] + step * 0.5 * (lead_v[k] + lead_v[k + 1] - vs[-1] - nv))
            vs.append(nv)
        vs, gaps = np.array(vs), np.array(gaps)
        t = np.arange(0.5, 35.5, 0.1)
        grid = np.arange(len(vs)) * step
        pick = lambda s: np.interp(t, grid, s)
        noisy = np.column_stack([pick(vs) + rng.normal(0, 0.08, t.size), pick(gaps) + rng.normal(0, 0.08, t.size), pick(lead_v) + rng.normal(0, 0.08, t.size)])
        place = pick(lead_x - gaps)
        rows += [f"{t[k]:.1f},{number},{place[k]:.2f},0.00,0.000,{noisy[k, 0]:.2f},{noisy[k, 1]:.2f},{noisy[k, 2]:.2f}" for k in range(t.size)]
        lead_v, lead_x = vs, lead_x - gaps
    return "t,id,x,y,yaw,v,gap,v_lead\n" + "\n".join(rows) + "\n"


def draw_case(r, given, kind, number, index):
    """Draws one case: vehicle, effects, kinds of drive, missing channel, label."""
    nominal, real, day = draw_car(r, given.seed, number, given.fleet, draw_vehicle)
    names = list(EFFECTS)
    if kind == "single":
        ids = [names[index % len(names)]]
    elif kind == "curve":
        ids = [COMMON[index % len(COMMON)]]
    elif kind == "onset":
        ids = [SUDDEN[index % len(SUDDEN)]]
    elif kind == "double":
        first = names[(7 * index + int(r.integers(7))) % len(names)]
        others = [n for n in names if EFFECTS[n][1] != EFFECTS[first][1]]
        ids = [first, others[r.integers(len(others))]]
    elif kind == "out_of_library":
        ids = [list(UNKNOWN)[index % len(UNKNOWN)]]
    else:
        ids = []
    share = (index // len(COMMON)) / (CURVE_STEPS - 1) if kind == "curve" else None
    onset = {"drive": int(r.integers(3)), "secs": float(r.uniform(8, 28))} if kind == "onset" else None
    kind = "single" if kind in ("curve", "onset") else kind
    values = {i: draw_value(r, i, share) if i in EFFECTS else float(r.uniform(*UNKNOWN[i])) for i in ids}
    told = lambda i: values[i] * nominal["mass"] if i == "payload" else values[i]
    group = lambda i: EFFECTS[i][1] if i in EFFECTS else "out_of_library"
    kinds = list(r.permutation(["urban", "highway", "handling"])) + list(r.choice(["urban", "highway", "handling"], DRIVES - 3))
    missing = [str(r.choice(["steer_meas", "v_wheel", "ay", "ax"]))] if r.random() < 0.15 else []
    if any(i in NEEDS.get(m, []) for m in missing for i in ids):
        missing = []
    values = {**dict(given.trait), **values}
    label = {"kind": kind, "effects": [{"id": i, "value": told(i), "unit": EFFECTS.get(i, ("",))[0], "group": group(i), **place(i)} for i in ids],
             "drive_kinds": [str(k) for k in kinds], "channels_missing": missing}
    if onset:
        label["onset"] = onset
    return {"name": f"case_{number:03d}", "nominal": nominal, "real": real, "values": values, "kinds": [str(k) for k in kinds], "missing": missing, "label": label, "day": day, "onset": onset, "rate": given.rate, "amplitude": given.amplitude, "rng": r}


def write_drive(folder, lanes, run, case, lane, number):
    """Writes one drive of a case, ego and followers; returns its entry in the description."""
    log, cmd_s, cmd_a = run
    r = case["rng"]
    t, rows = read_sensors(r, lanes, log, lane, case["rate"])
    index = np.round(t / DT).astype(int)
    columns = [("t", t, 3), ("cmd_steer", cmd_s[lane][index], 5), ("cmd_accel", cmd_a[lane][index], 3)]
    columns += [(k, rows[k], p) for k, p in (("x", 3), ("y", 3), ("yaw", 4), ("v", 3), ("yaw_rate", 4), ("ax", 2), ("ay", 2), ("steer_meas", 4), ("v_wheel", 3))]
    cells = [[f"{v:.{p}f}" if k not in case["missing"] else "" for v in col] for k, col, p in columns]
    text = ",".join(k for k, _, _ in columns) + "\n" + "\n".join(",".join(row) for row in zip(*cells)) + "\n"
    (folder / f"drive_{number}.csv").write_text(text)
    fast = log["v"][lane][::10]
    far = np.cumsum(np.concatenate([[0], 0.5 * (fast[1:] + fast[:-1]) * 10 * DT]))
    desired = round(float(fast.max() * r.uniform(0.98, 1.12)), 2)
    (folder / f"agents_{number}.csv").write_text(follow(r, case, far, fast, desired))
    return {"file": f"drive_{number}.csv", "agents": f"agents_{number}.csv", "agents_desired_speed": desired}


def write_case(out, lanes, run, case, first):
    """Writes a case of four drives, and under `unseen` a fifth one that no diagnosis is given."""
    folder, apart = out / case["name"], out / "unseen" / case["name"]
    for place, numbers in ((folder, range(4)), (apart, range(4, DRIVES))):
        place.mkdir(parents=True, exist_ok=True)
        drives = [write_drive(place, lanes, run, case, first + k, k) for k in numbers]
        meta = {"case": case["name"], "vehicle": "drawn", **case["day"], "rate_hz": case["rate"], "agent_rate_hz": 10, "drives": drives,
                "channels_missing": case["missing"], "nominal": case["nominal"]}
        if place == folder:
            meta["suggested_split"] = {"fit": [0, 1, 2], "held_out": [3]}
        (place / "meta.json").write_text(json.dumps(meta, indent=1))


def write_cases(out, cases):
    """Drives cases side by side and writes them."""
    if cases:
        lanes = Lanes(cases)
        run = lanes.run()
        for c, case in enumerate(cases):
            write_case(out, lanes, run, case, c * DRIVES)


def without(case):
    """The twin of a case: the same vehicle, plans and noise in a world without its effects. What no library contains is there
    with size zero, because drawing it takes numbers from the generator."""
    values = {i: 0.0 for i in case["values"] if i in UNKNOWN}
    return {**case, "values": values, "onset": None, "rng": copy.deepcopy(case["rng"])}


def spreads():
    """Standard deviation of every drawn mismatch relative to the nominal, over two thousand vehicles."""
    r = np.random.default_rng(0)
    pairs = [draw_vehicle(r) for _ in range(2000)]
    of = lambda f: float(np.std([f(n, v) for n, v in pairs]))
    return {
        "mass": of(lambda n, v: v["mass"] / n["mass"]), "yaw_inertia": of(lambda n, v: v["inertia"] / n["yaw_inertia"]),
        "front_stiffness": of(lambda n, v: v["cf"] / n["cornering_stiffness_front"]), "friction": of(lambda n, v: v["mu"]),
        "rolling": of(lambda n, v: v["roll"] / n["rolling_decel"]), "steer_gain": of(lambda n, v: v["steer_gain"]),
        "steer_zero": of(lambda n, v: v["steer_zero"]), "steer_dead": of(lambda n, v: v["steer_dead"]),
        "pose_age": of(lambda n, v: v["pose_age"]), "gyro_zero": of(lambda n, v: v["gyro_zero"]), "ax_zero": of(lambda n, v: v["ax_zero"]),
        "wheel": of(lambda n, v: v["wheel"]), "crown": of(lambda n, v: v["crown"]), "wind": of(lambda n, v: v["wind_x"]),
        "headway": of(lambda n, v: v["follow"]["headway"]), "follower_speed": of(lambda n, v: v["follow"]["v0"]),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=pathlib.Path)
    parser.add_argument("--spreads", action="store_true", help="print the spread of the drawn mismatches and stop")
    parser.add_argument("--seed", type=int, default=1)
    for kind, count in (("singles", 48), ("none", 12), ("pairs", 6), ("unknown", 10)):
        parser.add_argument(f"--{kind}", type=int, default=count)
    parser.add_argument("--curve", type=int, default=0, help="instead: so many draws of each of the common effects at each of their sizes")
    parser.add_argument("--onset", type=int, default=0, help="instead: so many cases with one effect that begins within a drive and stays")
    parser.add_argument("--fleet", type=int, default=0, help="so many vehicles, each of which drives every so manieth case on a day of its own (0: one for each case)")
    trait = lambda text: (text.split("=")[0], float(text.split("=")[1]))
    parser.add_argument("--trait", type=trait, default=[], nargs="*", metavar="ID=VALUE", help="what every car has, healthy or not, such as steer_backlash=0.02")
    parser.add_argument("--rate", type=int, default=20, help="rows a second of the vehicle's logs")
    parser.add_argument("--twins", action="store_true", help="drive each case with effects a second time without them, into `without`: the truth about cells")
    parser.add_argument("--amplitude", type=float, default=1.0, help="side acceleration, pedals and swing of the speed times so much, the same seed's vehicles and effects")
    given = parser.parse_args()
    if given.spreads or given.out is None:
        print(json.dumps(spreads()))
        return
    wanted = [("single", k) for k in range(given.singles)] + [("none", k) for k in range(given.none)]
    wanted += [("double", k) for k in range(given.pairs)] + [("out_of_library", k) for k in range(given.unknown)]
    if given.curve:
        wanted = [("curve", k) for k in range(len(COMMON) * CURVE_STEPS)] * given.curve
    if given.onset:
        wanted = [("onset", k) for k in range(given.onset)]
    labels = {}
    for start in range(0, len(wanted), TOGETHER):
        part = list(enumerate(wanted))[start:start + TOGETHER]
        cases = [draw_case(np.random.default_rng([given.seed, number]), given, kind, number, index) for number, (kind, index) in part]
        twins = [without(case) for case in cases if given.twins and case["values"]]
        for out, driven in ((given.out, cases), (given.out / "without", twins)):
            write_cases(out, driven)
        labels.update({case["name"]: case["label"] for case in cases})
    (given.out / "labels.json").write_text(json.dumps(labels, indent=1))


if __name__ == "__main__":
    main()
