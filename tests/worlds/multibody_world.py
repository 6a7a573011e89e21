"""A reference world by other authors: CommonRoad's multi-body cars, as labelled cases of the practice schema.

The vehicle is the 29-state model of the PyPI package `commonroad-vehicle-models` (Althoff and Würsching, TU München: sprung
and unsprung masses, roll, pitch, compliant suspension, four spinning wheels, Magic Formula with combined slip) with its
parameters of a Ford Escort, a BMW 320i and a VW Vanagon, compiled as it stands by numba. Added here are what it does
not have (servo, dead times, air and rolling resistance, slopes, sensors) and the effects; followers, strengths of the
effects and plans are those of the other two worlds. The nominal single track is what its user would have: weighed mass,
measured axles, yaw inertia, and stiffnesses from steady turns.

    pip install commonroad-vehicle-models numba
    python tests/worlds/multibody_world.py --out DIR --seed 1 --singles 88 --none 40 --pairs 20 --unknown 40
"""

import argparse
import json
import math
import pathlib
from collections import namedtuple
from types import SimpleNamespace

import numba
import numpy as np
import vehiclemodels.utils.tire_model as tyre
import vehiclemodels.utils.vehicle_dynamics_ks_cog as kinematic
import vehiclemodels.vehicle_dynamics_mb as multibody
from vehiclemodels.init_mb import init_mb
from vehiclemodels.vehicle_parameters import setup_vehicle_parameters

import own_world
from labelled_case import Unfit, draw_car, draw_ids, make_case, write_log
from metadrive_actuators import DT, Actuators, clip
from metadrive_world import AIR, G, KINDS, LEAD_IN, UNKNOWN, draw_plan, read_sensors

# The wheels' spin is stiff at walking pace: fourth order needs a millisecond.
FINE = 20
# Tyres with the plysteer and conicity of the single tyre that was measured, all pulling one way.
AS_DELIVERED = False
# Without counterpart in this model, whose four tyres are one and act at once.
EFFECTS = {k: v for k, v in own_world.EFFECTS.items() if k not in ("front_grip", "rear_grip", "tyre_relaxation", "kinematic_only")}

for module in (tyre, kinematic, multibody):
    for name, thing in list(vars(module).items()):
        if callable(thing) and getattr(thing, "__module__", "").startswith("vehiclemodels") and name not in ("vehicle_dynamics_mb", "vehicle_dynamics_ks_cog"):
            setattr(module, name, numba.njit(thing))
multibody.vehicle_dynamics_ks_cog = numba.njit(kinematic.vehicle_dynamics_ks_cog)
dynamics = numba.njit(multibody.vehicle_dynamics_mb)


@numba.njit
def slopes(x, push, p, down, across, along, beside, turning):
    """Their right-hand side, with gravity along and across the road (m/s2) and forces on the body (N, N m) beside it."""
    f = np.array(dynamics(x, (0.0, push), p))
    f[3] += down + along / p.m
    f[5] += turning / p.I_z
    for lateral in (10, 15, 20):
        f[lateral] += across
    f[10] += beside / p.m_s
    return f


@numba.njit
def advance(x, wheel, push, p, down, across, along, beside, turning):
    """Moves on by DT; `wheel` and `push` run from their first to their second value. Returns the mean felt acceleration."""
    h, felt = DT / FINE, np.zeros(2)
    for k in range(FINE):
        share = (k + 0.5) / FINE
        x[2] = wheel[0] + share * (wheel[1] - wheel[0])
        u = push[0] + share * (push[1] - push[0])
        k1 = slopes(x.copy(), u, p, down, across, along, beside, turning)
        k2 = slopes(x + 0.5 * h * k1, u, p, down, across, along, beside, turning)
        k3 = slopes(x + 0.5 * h * k2, u, p, down, across, along, beside, turning)
        k4 = slopes(x + h * k3, u, p, down, across, along, beside, turning)
        f = (k1 + 2 * k2 + 2 * k3 + k4) / 6
        felt[0] += (f[3] - x[5] * x[10] - down) / FINE
        felt[1] += (f[10] + x[5] * x[3] - across) / FINE
        x += h * f
    return felt


def frozen(given, name="Parameters"):
    """Their parameters as nested named tuples, which compiled code can read."""
    fields = {k: frozen(v, k) if hasattr(v, "__dict__") else float(v) for k, v in vars(given).items() if v is not None and k != "trailer"}
    return namedtuple(name, fields)(**fields)


def scaled(build, mass=1.0, inertia=1.0, grip=1.0, shift=0.0):
    """Their parameters of a drawn car with another mass (kg, added to the body), yaw inertia, friction and centre of gravity."""
    p = setup_vehicle_parameters(vehicle_id=build["car"])
    p.tire, p.longitudinal = SimpleNamespace(**vars(p.tire)), SimpleNamespace(**vars(p.longitudinal))
    # left and right tyres are mirror images, so that what pulls a single tyre aside cancels; theirs all pull one way
    if not AS_DELIVERED:
        p.tire.p_hy1 = p.tire.p_vy1 = p.tire.r_hy1 = p.tire.r_vy1 = p.tire.r_by3 = p.tire.r_hx1 = 0.0
    p.longitudinal.v_switch = p.longitudinal.v_max  # no engine of theirs: power is limited by an effect alone
    heavier = build["heavier"]
    for key in ("m", "m_s", "m_uf", "m_ur", "I_Phi_s", "I_y_s", "I_z", "I_uf", "I_ur", "K_sf", "K_sr", "K_sdf", "K_sdr", "K_tsf", "K_tsr", "K_zt", "K_ras", "K_rad"):
        setattr(p, key, getattr(p, key) * heavier)
    p.K_lt /= heavier
    for key in ("K_sf", "K_sr", "K_sdf", "K_sdr"):
        setattr(p, key, getattr(p, key) * build["spring"])
    p.a, p.b = p.a * build["front"] + shift, p.b * build["rear"] - shift
    p.h_s *= build["height"]
    p.I_z *= build["turn"] * inertia * (1 + 0.5 * (mass - 1))
    p.m_s, p.m = p.m_s + (mass - 1) * p.m, p.m * mass
    p.tire.p_ky1 *= build["stiff"]
    p.tire.p_dy1, p.tire.p_dx1 = p.tire.p_dy1 * build["grip"] * grip, p.tire.p_dx1 * build["grip"] * grip
    return p


class Spun(Unfit):
    """The car slid at more than a third of its speed, or turned over."""


def steady_turn(p, v0):
    """A turn of 2 m/s2 held for ten seconds: relative understeer, rear slip, side acceleration, roll angle, unrest."""
    base, fixed = p.a + p.b, frozen(p)
    x, steer, seen = np.array(init_mb([0, 0, 0, v0, 0, 0, 0], p), dtype=float), base * 2.0 / v0**2, []
    for k in range(500):
        wheel = steer * min(1.0, k / 100)
        advance(x, (wheel, wheel), (1.5 * (v0 - x[3]),) * 2, fixed, 0.0, 0.0, 0.0, 0.0, 0.0)
        if k > 400:
            seen.append([x[3], x[10], x[5], x[6]])
    v, vy, r, roll = np.mean(seen, axis=0)
    return steer * v / (r * base) - 1, -(vy - p.b * r) / v, v * r, roll, np.std([row[2] for row in seen])


def identify(p):
    """Axle stiffnesses as a user would find them (rear from the slip at 15 m/s, front from understeer over three speeds), and
    the body's roll per side acceleration, rad/(m/s2)."""
    turns = {v: steady_turn(p, v) for v in (10.0, 15.0, 25.0)}
    if any(turn[4] > 1e-3 or turn[2] < 0.5 for turn in turns.values()):
        return None
    base, mass = p.a + p.b, p.m
    growth = sum(turn[0] * v * v for v, turn in turns.items()) / sum(v**4 for v in turns)
    _, slip, ay, roll, _ = turns[15.0]
    rear = mass * ay * p.a / base / max(slip, 5e-4)
    front = p.b / max(growth * base**2 / mass + p.a / rear, 1e-7)
    return front, rear, roll / ay


def draw_vehicle(r):
    """Draws a car around one of theirs, what its user knows of it, and the mismatch that every vehicle has."""
    n, found = r.normal, None
    while found is None:
        build = {"car": int(r.integers(1, 4)), "heavier": r.uniform(0.9, 1.6), "front": r.uniform(0.93, 1.07), "rear": r.uniform(0.93, 1.07),
                 "height": r.uniform(0.85, 1.1), "turn": r.uniform(0.9, 1.1), "spring": r.uniform(0.9, 1.4), "stiff": r.uniform(0.6, 1.0), "grip": r.uniform(0.9, 1.05)}
        p = scaled(build)
        found = identify(p)
    front, rear = (float(c) * (1 + n(0, 0.02)) for c in found[:2])
    omega, damping = 2 * np.pi * n(4.0, 0.25), r.uniform(0.75, 0.9)
    nominal = {
        "model": "linear_single_track", "mass": round(p.m), "yaw_inertia": round(p.I_z), "lf": round(p.a, 3), "lr": round(p.b, 3), "wheelbase": round(p.a + p.b, 3),
        "cornering_stiffness_front": round(front, -2), "cornering_stiffness_rear": round(rear, -2),
        "steer_lag": round(2 * damping / omega, 3), "accel_lag": round(r.uniform(0.08, 0.16), 3), "rolling_decel": round(r.uniform(0.09, 0.14), 3),
        "drag_decel_per_v2": round(0.5 * AIR * r.uniform(0.55, 1.0) / p.m, 6), "friction": round(p.tire.p_dy1, 2),
        "idm": {"headway": round(r.uniform(1.2, 1.6), 2), "min_gap": 2.5, "max_accel": 1.5, "comfort_decel": 2.0, "exponent": 4, "vehicle_length": 4.6},
    }
    real = {
        "build": build, "mass": 1 + n(0, 0.012), "inertia": 1 + n(0, 0.03), "grip": 1 + n(0, 0.03), "roll_per_ay": abs(found[2]),
        "roll": nominal["rolling_decel"] * (1 + n(0, 0.05)), "drag": nominal["drag_decel_per_v2"] * p.m * (1 + n(0, 0.05)),
        "steer_gain": 1 + n(0, 0.004), "steer_zero": n(0, 0.0006), "steer_dead": r.uniform(0.004, 0.02), "accel_dead": r.uniform(0.004, 0.02),
        "omega": omega, "damping": damping, "accel_lag": nominal["accel_lag"] * (1 + n(0, 0.05)),
        "pose_age": r.uniform(0.002, 0.014), "imu_age": r.uniform(0.002, 0.014), "wheel_age": r.uniform(0.002, 0.014), "encoder_age": r.uniform(0.002, 0.014),
        "gyro_zero": n(0, 0.0006), "ax_zero": n(0, 0.02), "ay_zero": n(0, 0.02), "wheel": 1 + n(0, 0.0012), "crown": n(0, 0.0017), "roll_gain": n(0.035, 0.006),
        "wind": n(0, 0.5, 2), "hill": r.uniform(0.0005, 0.0012), "hill_phase": r.uniform(0, 6.28), "imu_noise": r.uniform(0.07, 0.12),
        "follow": {"headway": 1 + n(0, 0.015), "v0": 1 + n(0, 0.01), "accel": 1 + n(0, 0.02), "gap": n(0, 0.04), "lag": r.uniform(0.1, 0.16), "delay": 0.0},
    }
    return nominal, real


def drive(r, case, kind):
    """Drives one plan; returns truth and commands at 50 Hz from LEAD_IN before time zero."""
    real, nominal, on = case["real"], case["nominal"], lambda key, neutral: case["values"].get(key, neutral)
    p = scaled(real["build"], real["mass"] + on("payload", 0.0), real["inertia"] * on("yaw_inertia", 1.0), real["grip"] * on("mu", 1.0), on("cg_shift", 0.0))
    fixed = frozen(p)
    # the drive is calibrated: asked acceleration is that of the nominal mass with its wheels
    push = nominal["mass"] / p.m * (1 + 4 * p.I_y_w / p.R_w**2 / nominal["mass"])
    want_v, want_ay = draw_plan(r, kind, case["amplitude"])
    x = np.array(init_mb([0, 0, 0, want_v[0], r.uniform(-np.pi, np.pi), 0, 0], p), dtype=float)
    base = nominal["wheelbase"]
    us = nominal["mass"] * (nominal["lr"] / nominal["cornering_stiffness_front"] - nominal["lf"] / nominal["cornering_stiffness_rear"]) / base
    chain, log, heading, felt = Actuators(case, want_v[0]), {}, x[4], np.zeros(2)
    drag, roll = real["drag"] + 0.5 * AIR * on("drag_add", 0.0), real["roll"] + G * on("roll_add", 0.0)
    wind = real["wind"] + np.array([on("wind_steady", 0.0), 0.0])
    bursts, pushes, slosh, slosh_rate = r.uniform(2, 33, 5), r.choice([-1, 1], 5), 0.0, 0.0
    wheel = force = 0.0
    held, slot = (0.0, 0.0), -1
    for k in range(want_v.size - 1):
        secs, v = k * DT - LEAD_IN, max(x[3], 3.0)
        want_r = want_ay[k] / v
        heading = x[4] + clip(heading + DT * want_r - x[4], 0.3)
        steer = want_r / v * (base + us * v * v) + (0.1 * (want_r - x[5]) + 0.25 * clip(heading - x[4], 0.2)) * 8.0 / v
        accel = 0.9 * (want_v[k] - x[3]) + nominal["rolling_decel"] + nominal["drag_decel_per_v2"] * v * v
        now = int(math.floor(k * DT * on("cmd_hold_rate", 1e9)))
        asked = clip(float(steer), 0.5), max(min(float(accel), 2.2), -2.7)
        if now > slot:
            slot, held = now, asked
        last, (wheel, force) = (wheel, force), chain.step(*held, max(x[3], 0.0), felt[1], secs)
        c, s = math.cos(x[4]), math.sin(x[4])
        slope = on("grade", 0.0) + real["hill"] * math.sin(0.02 * (x[0] + x[1]) + real["hill_phase"])
        down, across = -G * math.sin(slope), -G * math.sin(real["crown"] + on("bank", 0.0))
        moving = np.array([x[3] * c - x[10] * s, x[3] * s + x[10] * c]) - wind
        along, beside = moving[0] * c + moving[1] * s, -moving[0] * s + moving[1] * c
        speed = math.hypot(along, beside)
        gust = p.m * on("gust_bursts", 0.0) * sum(a * math.exp(-(((secs - b) / 0.5) ** 2)) for a, b in zip(pushes, bursts))
        slosh_rate += DT * ((2 * np.pi * 0.6) ** 2 * (felt[1] - slosh) - 0.8 * slosh_rate)
        slosh += DT * slosh_rate
        f_along = -drag * along * speed - p.m * roll
        f_side = -2.5 * drag * beside * speed + gust + p.m * on("load_slosh", 0.0) * (slosh - felt[1])
        entries = {"x": x[0], "y": x[1], "yaw": x[4], "v": x[3], "r": x[5], "servo": chain.servo, "cmd_steer": asked[0], "cmd_accel": asked[1],
                   "wheel": p.R_w * float(np.mean(x[23:27])), "lean": abs(x[6]) * np.sign(x[5])}
        for key, value in entries.items():
            log.setdefault(key, []).append(value)
        if not abs(x[10]) < 0.3 * x[3] or not abs(x[6]) < 0.5 or x[3] < 1.0:
            raise Spun
        felt = advance(x, (last[0], wheel), (last[1] * push, force * push), fixed, down, across, f_along, f_side, 0.3 * gust)
        log.setdefault("ax", []).append(felt[0])
        log.setdefault("ay", []).append(felt[1])
    log = {key: np.array(value) for key, value in log.items()}
    # accelerometers are levelled but for a share of the body's own roll, so that a car has the usual gain in curves
    left_over = (real["roll_gain"] + on("suspension_roll", 0.0)) / (G * real["roll_per_ay"])
    log["ay"] = log["ay"] + left_over * G * np.sin(log.pop("lean"))
    return log


def draw_case(r, given, kind, number, index):
    nominal, real, day = draw_car(r, given.seed, number, given.fleet, draw_vehicle)
    ids = draw_ids(r, kind, index, EFFECTS, UNKNOWN)
    values = {i: float(own_world.draw_value(r, i)) if i in EFFECTS else float(r.uniform(*UNKNOWN[i])) for i in ids}
    told = lambda i: values[i] * nominal["mass"] if i == "payload" else values[i]
    kinds = [str(k) for k in r.permutation(list(KINDS))] + [str(r.choice(list(KINDS)))]
    missing = [str(r.choice(["steer_meas", "v_wheel", "ay", "ax"]))] if r.random() < 0.15 else []
    missing = [m for m in missing if not any(i in own_world.NEEDS.get(m, []) for i in ids)]
    label = {"kind": kind, "drive_kinds": kinds, "channels_missing": missing,
             "effects": [{"id": i, "value": told(i), "unit": EFFECTS.get(i, ("",))[0], "group": EFFECTS.get(i, ("", "out_of_library"))[1], **own_world.place(i)} for i in ids]}
    return {"name": f"case_{number:03d}", "nominal": nominal, "real": real, "values": values, "kinds": kinds, "missing": missing, "label": label, "day": day, "amplitude": given.amplitude}


def write_case(r, case, folder):
    folder.mkdir(parents=True, exist_ok=True)
    drives = []
    for d, kind in enumerate(case["kinds"]):
        log = drive(r, case, kind)
        t, rows = read_sensors(r, case, log)
        write_log(folder / f"drive_{d}.csv", t, rows, case["missing"])
        fast = log["v"][round(LEAD_IN / DT)::2]
        far = np.cumsum(np.concatenate([[0], 0.5 * (fast[1:] + fast[:-1]) * 2 * DT]))
        desired = round(float(fast.max() * r.uniform(0.98, 1.12)), 2)
        (folder / f"agents_{d}.csv").write_text(own_world.follow(r, case, far, fast, desired))
        drives.append({"file": f"drive_{d}.csv", "agents": f"agents_{d}.csv", "agents_desired_speed": desired})
    meta = {"case": case["name"], "vehicle": "multibody", **case["day"], "rate_hz": 20, "agent_rate_hz": 10, "drives": drives, "channels_missing": case["missing"],
            "nominal": case["nominal"], "suggested_split": {"fit": [0, 1, 2], "held_out": [3]}}
    (folder / "meta.json").write_text(json.dumps(meta, indent=1))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--seed", type=int, default=1)
    for kind, count in (("singles", len(EFFECTS)), ("none", 16), ("pairs", 10), ("unknown", 8)):
        parser.add_argument(f"--{kind}", type=int, default=count)
    parser.add_argument("--fleet", type=int, default=0, help="so many vehicles, each of which drives every so manieth case on a day of its own (0: one for each case)")
    parser.add_argument("--as-delivered", action="store_true", help="leave the side terms of the tyres in")
    parser.add_argument("--twins", action="store_true", help="drive each case with effects a second time without them, into `without`: the truth about cells")
    parser.add_argument("--amplitude", type=float, default=1.0, help="side acceleration and swing of the speed times so much, the same seed's vehicles and effects")
    given = parser.parse_args()
    global AS_DELIVERED
    AS_DELIVERED, labels = given.as_delivered, {}
    counts = {"single": given.singles, "none": given.none, "double": given.pairs, "out_of_library": given.unknown}
    for number, (kind, index) in enumerate([(kind, k) for kind, count in counts.items() for k in range(count)]):
        case = make_case(given.seed, number, given.out, lambda r: draw_case(r, given, kind, number, index), write_case, given.twins)
        labels[case["name"]] = case["label"]
    (given.out / "labels.json").write_text(json.dumps(labels, indent=1))


if __name__ == "__main__":
    main()
