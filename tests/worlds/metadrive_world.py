"""A reference world by other authors: MetaDrive's vehicles (Bullet raycast vehicle) and its traffic policy, as labelled cases.

Vehicle classes, chassis, suspension, wheels, and contact are those of the PyPI package
`metadrive-simulator`; the followers are its IDM policy driving its vehicles. Added here are what it does not have (servo,
dead times, air and rolling resistance, slopes as tilted gravity, sensors) and the effects. The nominal single track of a
vehicle is what its user would have: weighed mass, measured axles, box inertia, and stiffnesses from steady turns.

    pip install metadrive-simulator
    python tests/worlds/metadrive_world.py --out DIR --seed 1 --singles 42 --none 16 --pairs 10 --unknown 8
"""

import argparse
import json
import math
import pathlib
from types import SimpleNamespace

import numpy as np

import own_world
from labelled_case import Unfit, draw_car, draw_ids, make_case, write_log
from metadrive_actuators import DT, Actuators, clip

SECONDS, LEAD_IN, G, AIR = 36.5, 3.0, 9.81, 1.2
# Bullet's wheel takes out a share of its side slip per physics step, so that its cornering stiffness is proportional to
# speed over step. At MetaDrive's usual 20 ms no linear tyre fits two speeds; at 5 ms slip is nearly nil at any speed.
PHYSICS = 0.005
LATE = 1.5 * PHYSICS

# id: (unit, group, draw of a value)
EFFECTS = {
    "steer_delay": ("s", "steer_timing", lambda r: r.uniform(0.06, 0.2)),
    "steer_lag": ("s", "steer_timing", lambda r: r.uniform(0.08, 0.3)),
    "steer_rate": ("rad/s", "steer_timing", lambda r: r.uniform(0.05, 0.12)),
    "steer_backlash": ("rad", "steer_play", lambda r: r.uniform(0.006, 0.02)),
    "steer_offset": ("rad", "steer_zero", lambda r: side(r) * r.uniform(0.005, 0.015)),
    "steer_gain": ("x", "lateral_gain", lambda r: 1 + side(r) * r.uniform(0.05, 0.14)),
    "steer_saturation": ("rad", "steer_limit", lambda r: r.uniform(0.02, 0.04)),
    "accel_delay": ("s", "drive_timing", lambda r: r.uniform(0.1, 0.35)),
    "accel_lag": ("s", "drive_timing", lambda r: r.uniform(0.12, 0.5)),
    "accel_jerk_limit": ("m/s^3", "drive_timing", lambda r: r.uniform(0.8, 2.0)),
    "brake_gain": ("x", "brake", lambda r: r.uniform(0.65, 0.88)),
    "brake_fade": ("1/MJ", "brake", lambda r: r.uniform(0.15, 0.3)),
    "drive_gain": ("x", "drive", lambda r: r.uniform(0.68, 0.88)),
    "power_limit": ("W/kg", "drive", lambda r: r.uniform(11.0, 17.0)),
    "deadzone_accel": ("m/s^2", "drive", lambda r: r.uniform(0.1, 0.35)),
    "cmd_hold_rate": ("Hz", "command_rate", lambda r: r.uniform(4.0, 8.0)),
    "payload": ("kg", "mass", lambda r: r.uniform(0.12, 0.35)),
    "mu": ("x", "friction", lambda r: r.uniform(0.3, 0.42)),
    "drag_add": ("m^2 (CdA)", "resistance", lambda r: r.uniform(0.6, 2.2)),
    "roll_add": ("1", "resistance", lambda r: r.uniform(0.008, 0.018)),
    "grade": ("rad", "slope", lambda r: side(r) * r.uniform(0.012, 0.05)),
    "bank": ("rad", "slope", lambda r: side(r) * r.uniform(0.015, 0.06)),
    "wind_steady": ("m/s", "wind", lambda r: side(r) * r.uniform(5.0, 11.0)),
    "gyro_bias": ("rad/s", "gyro", lambda r: side(r) * r.uniform(0.008, 0.025)),
    "gyro_scale": ("1", "gyro", lambda r: side(r) * r.uniform(0.03, 0.09)),
    "ax_bias": ("m/s^2", "accelerometer", lambda r: side(r) * r.uniform(0.15, 0.35)),
    "ay_bias": ("m/s^2", "accelerometer", lambda r: side(r) * r.uniform(0.15, 0.35)),
    "imu_misalignment": ("rad", "accelerometer", lambda r: side(r) * r.uniform(0.04, 0.1)),
    "wheel_scale": ("x", "wheel_odometry", lambda r: 1 + side(r) * r.uniform(0.012, 0.05)),
    "lever_arm": ("m", "pose_point", lambda r: side(r) * r.uniform(0.6, 2.5)),
    "pose_latency": ("s", "pose_timing", lambda r: r.uniform(0.06, 0.25)),
    "imu_latency": ("s", "imu_timing", lambda r: r.uniform(0.06, 0.2)),
    "clock_drift": ("s/s", "pose_timing", lambda r: r.uniform(0.002, 0.008)),
    "timestamp_jitter": ("s", "jitter", lambda r: r.uniform(0.006, 0.02)),
    "dropped_frames": ("1", "drops", lambda r: r.uniform(0.08, 0.3)),
    "tr_delay": ("s", "traffic_timing", lambda r: r.uniform(0.3, 0.9)),
    "tr_headway": ("x", "traffic_spacing", lambda r: r.choice([r.uniform(0.6, 0.8), r.uniform(1.25, 1.7)])),
    "tr_v0": ("x", "traffic_speed", lambda r: r.uniform(0.7, 0.88)),
    "tr_accel": ("x", "traffic_dynamics", lambda r: r.uniform(0.5, 0.7)),
    "tr_brake": ("x", "traffic_dynamics", lambda r: r.uniform(0.5, 0.65)),
    "tr_min_gap": ("m", "traffic_spacing", lambda r: r.uniform(1.5, 3.5)),
}
# what no library contains, with its range; gusts and load act along the vehicle, because wheels that do not slip take
# whatever pushes sideways, so that nothing moves
UNKNOWN = {
    "steer_stiction": (0.008, 0.015), "gust_bursts": (1.2, 2.2), "drive_cuts": (0.5, 0.8), "position_jumps": (0.4, 1.0),
    "gyro_wander": (0.012, 0.03), "steer_compliance": (0.03, 0.06), "load_slosh": (0.5, 0.9), "pull_under_power": (0.004, 0.01),
}
ACTS_AT = {**own_world.ACTS_AT, "gust_bursts": "drive", "load_slosh": "drive"}
KINDS = {"urban": (9.0, 3.0, 2.2), "highway": (24.0, 4.0, 1.6), "handling": (15.0, 3.0, 3.0)}


def side(r):
    return 1.0 if r.random() < 0.5 else -1.0


class Dragging(Unfit):
    """The chassis touched the ground in a drive."""


class World:
    """MetaDrive's engine without its map: a plane on which its vehicles are driven wheel by wheel."""

    def __init__(self):
        from metadrive.engine import base_engine
        base_engine.BaseEngine.try_pull_asset = lambda self: None  # nothing is drawn, so no picture files are needed
        from metadrive.component.vehicle import vehicle_type as types
        from metadrive.envs.metadrive_env import MetaDriveEnv
        from metadrive.policy.idm_policy import IDMPolicy
        self.env = MetaDriveEnv({"use_render": False, "show_terrain": False, "traffic_density": 0.0, "num_scenarios": 1, "log_level": 50})
        self.env.reset(seed=0)
        self.engine, self.policy = self.env.engine, IDMPolicy
        self.classes = [types.DefaultVehicle, types.SVehicle, types.MVehicle, types.LVehicle, types.XLVehicle]
        self.engine.clear_objects(list(self.engine.get_objects()))
        self.env.current_map.detach_from_world()
        self.physics = self.engine.physics_world.dynamic_world
        self.physics.clearContactAddedCallback()  # nothing to crash into

    def spawn(self, build, y=0.0):
        """Puts one vehicle on the plane with the mass, inertia, springs, axles and grip of a build."""
        from panda3d.core import Vec3
        kind = self.classes[build["type"]]
        vehicle = self.engine.spawn_object(kind, vehicle_config=dict(navigation_module=None, spawn_position_heading=((0.0, y), 0.0)), random_seed=0)
        vehicle.body.setMass(build["mass"])
        inertia = vehicle.body.getInertia()
        vehicle.body.setInertia(Vec3(inertia.x, inertia.y, build["inertia"]))
        for number, wheel in enumerate(vehicle.system.getWheels()):
            wheel.setSuspensionStiffness(build["spring"])
            wheel.setMaxSuspensionForce(2.0 * build["mass"] * G)  # as delivered 6 kN, on which heavy ones sit on the ground
            wheel.setFrictionSlip(build["friction"])
            at = wheel.getChassisConnectionPointCs()
            wheel.setChassisConnectionPointCs(Vec3(at.x, build["lf"] if number < 2 else -build["lr"], at.z))
        vehicle.set_position((0.0, y), height=kind.TIRE_RADIUS + 0.1)
        return vehicle

    def drags(self, vehicle):
        """Tells whether the chassis touches the ground, which no drag of the nominal vehicle accounts for."""
        return self.physics.contactTest(vehicle.body).getNumContacts() > 0

    def step(self, vehicle=None, force=None, physics=PHYSICS):
        for _ in range(round(DT / physics)):
            if force is not None:
                vehicle.body.applyCentralForce(force)
            self.physics.doPhysics(physics, 1, physics)

    def gravity(self, x=0.0, y=0.0):
        from panda3d.core import Vec3
        self.physics.setGravity(Vec3(x, y, -G))

    def clear(self, *vehicles):
        self.gravity()
        self.engine.clear_objects([v.name for v in vehicles], force_destroy=True)


def push(vehicle, force, steer_rad=None, physics=PHYSICS):
    """Spreads a force over the four wheels as MetaDrive does: engine when positive, brake when negative."""
    for wheel in range(4):
        vehicle.system.applyEngineForce(max(force, 0.0) / 4, wheel)
        vehicle.system.setBrake(max(-force, 0.0) / 4 * physics, wheel)
        if steer_rad is not None and wheel < 2:
            vehicle.system.setSteeringValue(math.degrees(steer_rad), wheel)


def state_of(vehicle):
    """Position, heading, body velocity, yaw rate and the chassis axes at the instant of the velocities.

    The transform that Bullet hands out is behind its velocities by LATE (two steps, half of one gained back because a
    physics step moves with its final velocity); it is carried forward by that time.
    """
    from panda3d.core import Vec3
    quat, velocity, r = vehicle.origin.getQuat(), vehicle.body.getLinearVelocity(), vehicle.body.getAngularVelocity().z
    turn = Vec3(math.cos(LATE * r), math.sin(LATE * r), 0)
    onward = lambda a: Vec3(a.x * turn.x - a.y * turn.y, a.x * turn.y + a.y * turn.x, a.z)
    ahead, left = onward(quat.xform(Vec3(0, 1, 0))), onward(quat.xform(Vec3(-1, 0, 0)))
    yaw, at = math.atan2(ahead.y, ahead.x), vehicle.origin.getPos() + velocity * LATE
    c, s = math.cos(yaw), math.sin(yaw)
    return SimpleNamespace(x=at.x, y=at.y, yaw=yaw, v=velocity.x * c + velocity.y * s, vy=-velocity.x * s + velocity.y * c,
                           r=r, velocity=velocity, ahead=ahead, left=left)


def start(vehicle, v):
    from panda3d.core import Vec3
    ahead = vehicle.origin.getQuat().xform(Vec3(0, 1, 0))
    vehicle.body.setLinearVelocity(ahead * float(v))


def draw_build(r, world):
    """Draws a vehicle around one of MetaDrive's classes."""
    number = int(r.integers(len(world.classes)))
    kind = world.classes[number]
    mass = kind.MASS * r.uniform(0.8, 1.6)
    length = kind.DEFAULT_LENGTH * r.uniform(0.9, 1.1)
    return {"type": number, "mass": mass, "lf": kind.FRONT_WHEELBASE * r.uniform(0.92, 1.08), "lr": kind.REAR_WHEELBASE * r.uniform(0.92, 1.08),
            "inertia": mass / 12 * (length**2 + kind.DEFAULT_WIDTH**2), "spring": r.uniform(35.0, 60.0), "friction": r.uniform(0.85, 1.0)}


def steady_turn(world, build, v0):
    """Drives a steady turn of 2 m/s2; returns relative understeer, rear slip angle, side acceleration, unrest and own drag."""
    vehicle, dragged = world.spawn(build), False
    base, seen = build["lf"] + build["lr"], []
    steer = base * 2.0 / v0**2
    start(vehicle, v0)
    for k in range(500):
        s = state_of(vehicle)
        push(vehicle, build["mass"] * 1.5 * (v0 - s.v), steer * min(1.0, k / 100))
        world.step()
        if k > 350:
            seen.append([s.v, s.vy, s.r])
            dragged = dragged or world.drags(vehicle)
    world.clear(vehicle)
    if dragged:
        return None
    v, vy, r = np.mean(seen, axis=0)
    return steer * v / (r * base) - 1, -(vy - build["lr"] * r) / v, v * r, np.std([row[2] for row in seen]), 1.5 * (v0 - v)


def identify(world, build):
    """Axle stiffnesses as a user would find them: rear from the slip at 15 m/s, front from understeer over three speeds."""
    turns = {v: steady_turn(world, build, v) for v in (10.0, 15.0, 25.0)}
    if any(turn is None or turn[3] > 2e-4 or turn[4] > 0.04 for turn in turns.values()):
        return None
    base, mass = build["lf"] + build["lr"], build["mass"]
    growth = sum(turn[0] * v * v for v, turn in turns.items()) / sum(v**4 for v in turns)
    _, slip, ay, _, _ = turns[15.0]
    rear = mass * ay * build["lf"] / base / max(slip, 5e-4)
    front = build["lr"] / max(growth * base**2 / mass + build["lf"] / rear, 1e-7)
    return front, rear


def draw_vehicle(r, world):
    """Draws a vehicle, what its user knows of it, and the mismatch that every vehicle has."""
    n, found = r.normal, None
    while found is None:  # a chassis that never settles, or drags on the ground, is no vehicle
        build = draw_build(r, world)
        found = identify(world, build)
    front, rear = (float(c) * (1 + n(0, 0.02)) for c in found)
    omega, damping = 2 * np.pi * n(4.0, 0.25), r.uniform(0.75, 0.9)
    nominal = {
        "model": "linear_single_track", "mass": round(build["mass"]), "yaw_inertia": round(build["inertia"]),
        "lf": round(build["lf"], 3), "lr": round(build["lr"], 3), "wheelbase": round(build["lf"] + build["lr"], 3),
        "cornering_stiffness_front": round(front, -2), "cornering_stiffness_rear": round(rear, -2),
        "steer_lag": round(2 * damping / omega, 3), "accel_lag": round(r.uniform(0.08, 0.16), 3), "rolling_decel": round(r.uniform(0.09, 0.14), 3),
        "drag_decel_per_v2": round(0.5 * AIR * r.uniform(0.55, 1.0) / build["mass"], 6), "friction": round(build["friction"], 2),
        "idm": {"headway": round(r.uniform(1.2, 1.6), 2), "min_gap": 2.5, "max_accel": 1.5, "comfort_decel": 2.0, "exponent": 4, "vehicle_length": 4.6},
    }
    real = {
        "build": {**build, "mass": build["mass"] * (1 + n(0, 0.012)), "inertia": build["inertia"] * (1 + n(0, 0.03)), "friction": build["friction"] * (1 + n(0, 0.03))},
        "roll": nominal["rolling_decel"] * (1 + n(0, 0.05)), "drag": nominal["drag_decel_per_v2"] * build["mass"] * (1 + n(0, 0.05)),
        "steer_gain": 1 + n(0, 0.004), "steer_zero": n(0, 0.0006), "steer_dead": r.uniform(0.004, 0.02), "accel_dead": r.uniform(0.004, 0.02),
        "omega": omega, "damping": damping, "accel_lag": nominal["accel_lag"] * (1 + n(0, 0.05)),
        "pose_age": r.uniform(0.002, 0.014), "imu_age": r.uniform(0.002, 0.014), "wheel_age": r.uniform(0.002, 0.014), "encoder_age": r.uniform(0.002, 0.014),
        "gyro_zero": n(0, 0.0006), "ax_zero": n(0, 0.02), "ay_zero": n(0, 0.02), "wheel": 1 + n(0, 0.0012), "crown": n(0, 0.0017),
        "wind": n(0, 0.5, 2), "hill": r.uniform(0.0005, 0.0012), "hill_phase": r.uniform(0, 6.28), "imu_noise": r.uniform(0.07, 0.12),
        "follow": {"headway": 1 + n(0, 0.015), "v0": 1 + n(0, 0.01), "accel": 1 + n(0, 0.02), "gap": n(0, 0.04), "lag": r.uniform(0.07, 0.12)},
    }
    return nominal, real


def draw_plan(r, kind, amplitude):
    """Draws target speed and lateral acceleration over time: slow waves, and a stretch of steps when handling."""
    centre, swing, lateral = KINDS[kind] * np.array([1.0, amplitude, amplitude])
    t = np.arange(-LEAD_IN, SECONDS + DT, DT)
    wave = lambda low, high: np.sin(2 * np.pi * t / r.uniform(low, high) + r.uniform(0, 6.28))
    speed = centre * r.uniform(0.88, 1.12) + swing * (0.7 * wave(9, 16) + 0.5 * wave(5, 8))
    fast = (3.0, 6.0) if kind == "handling" else (5.0, 12.0)
    ay = lateral * (0.6 * wave(*fast) + 0.45 * wave(8, 18) * (wave(13, 30) > -0.3))
    if kind == "handling":
        begin, period = r.uniform(6, 20), r.uniform(2.2, 3.6)
        ay = np.where((t > begin) & (t < begin + 8), lateral * 0.8 * np.tanh(1.5 * np.sin(2 * np.pi * (t - begin) / period)), ay)
    return np.maximum(speed, 3.0), np.clip(ay * np.clip((t + LEAD_IN) / LEAD_IN, 0, 1), -3.8 * amplitude, 3.8 * amplitude)


def drive(r, world, case, kind):
    """Drives one plan; returns truth and commands at 50 Hz from time zero."""
    real, nominal, on = case["real"], case["nominal"], lambda key, neutral: case["values"].get(key, neutral)
    build = dict(real["build"])
    build["mass"] += on("payload", 0.0) * nominal["mass"]
    build["friction"] *= on("mu", 1.0)
    vehicle = world.spawn(build)
    vehicle.set_heading_theta(r.uniform(-np.pi, np.pi))
    from panda3d.core import Vec3
    want_v, want_ay = draw_plan(r, kind, case["amplitude"])
    steps = want_v.size - 1
    start(vehicle, want_v[0])
    base = nominal["wheelbase"]
    us = nominal["mass"] * (nominal["lr"] / nominal["cornering_stiffness_front"] - nominal["lf"] / nominal["cornering_stiffness_rear"]) / base
    chain, log, heading, ay = Actuators(case, want_v[0]), {}, state_of(vehicle).yaw, 0.0
    ax, touched = 0.0, False
    drag, roll = real["drag"] + 0.5 * AIR * on("drag_add", 0.0), real["roll"] + G * on("roll_add", 0.0)
    wind = Vec3(real["wind"][0] + on("wind_steady", 0.0), real["wind"][1], 0)
    bursts, slosh, slosh_rate = r.uniform(2, 33, 5), 0.0, 0.0
    pushes, held, slot = r.choice([-1, 1], 5), (0.0, 0.0), -1
    before = state_of(vehicle)
    for k in range(steps):
        s, secs = state_of(vehicle), k * DT - LEAD_IN
        v = max(s.v, 3.0)
        want_r = want_ay[k] / v
        off = math.atan2(math.sin(heading + DT * want_r - s.yaw), math.cos(heading + DT * want_r - s.yaw))
        heading = s.yaw + clip(off, 0.3)
        steer = want_r / v * (base + us * v * v) + (0.1 * (want_r - s.r) + 0.25 * clip(off, 0.2)) * 8.0 / v
        accel = 0.9 * (want_v[k] - s.v) + nominal["rolling_decel"] + nominal["drag_decel_per_v2"] * v * v
        now = int(math.floor(k * DT * on("cmd_hold_rate", 1e9)))
        asked = clip(float(steer), 0.5), max(min(float(accel), 2.2), -2.7)
        if now > slot:
            slot, held = now, asked
        wheel, force = chain.step(*held, max(s.v, 0.0), ay, secs)
        c, sn = math.cos(s.yaw), math.sin(s.yaw)
        slope = on("grade", 0.0) + real["hill"] * math.sin(0.02 * (s.x + s.y) + real["hill_phase"])
        bank = real["crown"] + on("bank", 0.0)
        down, across = -G * math.sin(slope), -G * math.sin(bank)
        tilt = Vec3(down * c - across * sn, down * sn + across * c, 0)
        world.gravity(tilt.x, tilt.y)
        air = s.velocity - wind
        along, beside = air.x * c + air.y * sn, -air.x * sn + air.y * c
        speed = math.hypot(along, beside)
        gust = on("gust_bursts", 0.0) * sum(p * math.exp(-(((secs - b) / 0.5) ** 2)) for p, b in zip(pushes, bursts))
        slosh_rate += DT * ((2 * np.pi * 0.6) ** 2 * (ax - slosh) - 0.8 * slosh_rate)
        slosh += DT * slosh_rate
        f_along = -drag * along * speed - build["mass"] * roll * math.copysign(1.0, s.v)
        f_along += build["mass"] * (gust + on("load_slosh", 0.0) * (slosh - ax))
        f_side = -2.5 * drag * beside * speed
        push(vehicle, nominal["mass"] * force, wheel)
        for key, value in (("x", s.x), ("y", s.y), ("yaw", s.yaw), ("v", s.v), ("r", s.r), ("servo", chain.servo), ("cmd_steer", asked[0]), ("cmd_accel", asked[1])):
            log.setdefault(key, []).append(value)
        world.step(vehicle, Vec3(f_along * c - f_side * sn, f_along * sn + f_side * c, 0))
        after = state_of(vehicle)
        felt = (after.velocity - before.velocity) / DT - Vec3(tilt.x, tilt.y, -G)
        before = after
        ax, ay = felt.dot(after.ahead), felt.dot(after.left)
        touched = touched or (k % 5 == 0 and world.drags(vehicle))
        log.setdefault("ax", []).append(ax)
        log.setdefault("ay", []).append(ay)
        log.setdefault("tilt", []).append((after.ahead.z, after.left.z))
    world.clear(vehicle)
    if touched:
        raise Dragging
    log = {key: np.array(value) for key, value in log.items()}
    # accelerometers are mounted level: the chassis's own stance on its springs is no zero of theirs
    stance = G * log.pop("tilt").mean(axis=0)
    log["ax"], log["ay"] = log["ax"] - stance[0], log["ay"] - stance[1]
    log["yaw"] = np.unwrap(log["yaw"])
    return log


def read_sensors(r, case, log):
    """Samples the truth at 20 Hz with ages, jitter, noise and sensor effects."""
    real, on = case["real"], lambda key, neutral: case["values"].get(key, neutral)
    t = 0.5 + 0.05 * np.arange(700)
    grid = np.arange(log["x"].size) * DT - LEAD_IN
    taken = t + r.normal(0, np.hypot(0.001, on("timestamp_jitter", 0.0)), t.size)
    at = lambda key, age, shift=0.0: np.interp(taken - age, grid + shift, log[key])
    age = real["pose_age"] + on("pose_latency", 0.0) + on("clock_drift", 0.0) * (t - t[0])
    imu = real["imu_age"] + on("imu_latency", 0.0)
    n = lambda sd: r.normal(0, sd, t.size)
    yaw, arm = at("yaw", age), on("lever_arm", 0.0)
    wander = np.cumsum(r.normal(0, 1, (2, t.size)), axis=1)
    wander = 0.03 * (wander - wander.mean(axis=1, keepdims=True)) / wander.std(axis=1, keepdims=True)
    for begin in r.uniform(3, 33, 6):
        inside = (t > begin) & (t < begin + r.uniform(0.6, 1.5))
        wander[:, inside] += on("position_jumps", 0.0) * r.normal(0, 1, (2, 1))
    # a force felt over a step belongs to its middle
    ax, ay, turn = at("ax", imu, DT / 2), at("ay", imu, DT / 2), on("imu_misalignment", 0.0)
    rows = {
        "x": at("x", age) + arm * np.cos(yaw) + wander[0] + n(0.012), "y": at("y", age) + arm * np.sin(yaw) + wander[1] + n(0.012),
        "yaw": yaw + n(0.0018), "v": at("v", age) + n(0.025),
        "yaw_rate": at("r", imu) * (1 + on("gyro_scale", 0.0)) + on("gyro_bias", 0.0) + real["gyro_zero"]
        + on("gyro_wander", 0.0) * np.sin(2 * np.pi * t / 6.0) + n(0.0028),
        "ax": ax * np.cos(turn) + ay * np.sin(turn) + on("ax_bias", 0.0) + real["ax_zero"] + n(real["imu_noise"]),
        "ay": ay * np.cos(turn) - ax * np.sin(turn) + on("ay_bias", 0.0) + real["ay_zero"] + n(real["imu_noise"]),
        "steer_meas": np.round((at("servo", real["encoder_age"]) + n(0.0006)) / 0.0005) * 0.0005,
        "v_wheel": at("wheel" if "wheel" in log else "v", real["wheel_age"]) * real["wheel"] * on("wheel_scale", 1.0) + n(0.03),
    }
    for k in np.flatnonzero(r.random(t.size) < on("dropped_frames", 0.0)):
        for key in ("x", "y", "yaw", "v", "yaw_rate", "ax", "ay") if k else ():
            rows[key][k] = rows[key][k - 1]
    # the value in force when the sample is taken
    now = np.floor((t - grid[0]) / DT + 1e-6).astype(int)
    return t, {"cmd_steer": log["cmd_steer"][now], "cmd_accel": log["cmd_accel"][now], **rows}


def follow(r, world, case, lead_x, lead_v, desired):
    """Two MetaDrive vehicles behind the ego under MetaDrive's IDM policy at 10 Hz, its parameters in SI for a usual driver."""
    idm, real, on = case["nominal"]["idm"], case["real"]["follow"], lambda key, neutral: case["values"].get(key, neutral)
    accel, brake = idm["max_accel"] * real["accel"] * on("tr_accel", 1.0), idm["comfort_decel"] * on("tr_brake", 1.0)
    head, gap0 = idm["headway"] * real["headway"] * on("tr_headway", 1.0), idm["min_gap"] + real["gap"] + on("tr_min_gap", 0.0)
    v0, delay = desired * real["v0"] * on("tr_v0", 1.0), int(round(on("tr_delay", 0.0) / DT))
    build = {**case["real"]["build"], "friction": 1.0}
    cars, policies, past, seen = [], [], [[], []], [[], []]
    for k in range(2):
        car = world.spawn(build, 12.0 * (k + 1))
        car.set_heading_theta(0.0)
        v = min(lead_v[0], 0.97 * v0)
        start(car, v)
        policy = world.policy(car, 0)
        # the policy reckons in km/h: its time and its braking term take the factor 3.6 per speed
        policy.ACC_FACTOR, policy.DEACC_FACTOR, policy.DELTA = accel, -brake * 3.6**4, idm["exponent"]
        policy.DISTANCE_WANTED, policy.TIME_WANTED, policy.target_speed = gap0, head / 3.6, v0 * 3.6
        gap = (gap0 + head * v) / np.sqrt(max(1 - (v / v0) ** 4, 0.08))
        cars.append(SimpleNamespace(body=car, gap=gap, real=0.0, shake=0.0, wish=0.0))
        policies.append(policy)
    moving = lambda v: SimpleNamespace(speed_km_h=3.6 * v, velocity_km_h=np.array([3.6 * v, 0.0]), heading=np.array([1.0, 0.0]))
    leads = [lead_v, None]
    for k in range(lead_v.size):
        speeds = [lead_v[k]] + [state_of(c.body).v for c in cars]
        for i, car in enumerate(cars):
            past[i].append((speeds[i + 1], car.gap, speeds[i]))
            seen[i].append((speeds[i + 1], car.gap, speeds[i]))
            if k % 5 == 0:
                v, gap, ahead = past[i][max(k - delay, 0)]
                policies[i].control_object = moving(max(v, 0.0))
                car.wish = max(policies[i].acceleration(moving(ahead), max(gap, 0.5)), -8.0)
            car.real += (car.wish - car.real) * (1 - math.exp(-DT / real["lag"]))
            car.shake += -car.shake * DT / 0.5 + 0.06 * math.sqrt(2 * DT / 0.5) * r.normal()
            push(car.body, build["mass"] * (car.real + car.shake), physics=DT)
        world.step(physics=DT)  # no steering, so MetaDrive's usual step will do
        for i, car in enumerate(cars):
            following = lead_v[min(k + 1, lead_v.size - 1)] if i == 0 else state_of(cars[0].body).v
            car.gap += 0.5 * DT * (speeds[i] + following - speeds[i + 1] - state_of(car.body).v)
    world.clear(*(c.body for c in cars))
    t, rows = np.arange(0.5, 35.5, 0.1), []
    grid, place = np.arange(lead_v.size) * DT - LEAD_IN, lead_x
    for i in range(2):
        truth = np.array(seen[i])
        place = place - truth[:, 1] - idm["vehicle_length"]
        pick = lambda column: np.interp(t, grid, column)
        v, gap, ahead = (pick(truth[:, c]) + r.normal(0, 0.08, t.size) for c in range(3))
        rows += [f"{t[k]:.1f},{i + 1},{x:.2f},0.00,0.000,{v[k]:.2f},{gap[k]:.2f},{ahead[k]:.2f}" for k, x in enumerate(pick(place))]
    return "t,id,x,y,yaw,v,gap,v_lead\n" + "\n".join(rows) + "\n"


def draw_case(r, world, given, kind, number, index):
    nominal, real, day = draw_car(r, given.seed, number, given.fleet, lambda r: draw_vehicle(r, world))
    ids = draw_ids(r, kind, index, EFFECTS, UNKNOWN)
    values = {i: float(EFFECTS[i][2](r)) if i in EFFECTS else float(r.uniform(*UNKNOWN[i])) for i in ids}
    told = lambda i: values[i] * nominal["mass"] if i == "payload" else values[i]
    kinds = [str(k) for k in r.permutation(list(KINDS))] + [str(r.choice(list(KINDS)))]
    missing = [str(r.choice(["steer_meas", "v_wheel", "ay", "ax"]))] if r.random() < 0.15 else []
    missing = [m for m in missing if not (m == "v_wheel" and "wheel_scale" in ids) and f"{m}_bias" not in ids]
    label = {"kind": kind, "drive_kinds": kinds, "channels_missing": missing,
             "effects": [{"id": i, "value": told(i), "unit": EFFECTS.get(i, ("",))[0], "group": EFFECTS.get(i, ("", "out_of_library"))[1], **own_world.place(i, ACTS_AT)} for i in ids]}
    return {"name": f"case_{number:03d}", "nominal": nominal, "real": real, "values": values, "kinds": kinds, "missing": missing, "label": label, "day": day, "amplitude": given.amplitude}


def write_case(r, world, case, folder):
    drives = []
    for d, kind in enumerate(case["kinds"]):
        log = drive(r, world, case, kind)
        folder.mkdir(parents=True, exist_ok=True)
        t, rows = read_sensors(r, case, log)
        write_log(folder / f"drive_{d}.csv", t, rows, case["missing"])
        far = np.cumsum(log["v"]) * DT
        desired = round(float(log["v"].max() * r.uniform(0.98, 1.12)), 2)
        (folder / f"agents_{d}.csv").write_text(follow(r, world, case, far, log["v"], desired))
        drives.append({"file": f"drive_{d}.csv", "agents": f"agents_{d}.csv", "agents_desired_speed": desired})
    meta = {"case": case["name"], "vehicle": "metadrive", **case["day"], "rate_hz": 20, "agent_rate_hz": 10, "drives": drives, "channels_missing": case["missing"],
            "nominal": case["nominal"], "suggested_split": {"fit": [0, 1, 2], "held_out": [3]}}
    (folder / "meta.json").write_text(json.dumps(meta, indent=1))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--seed", type=int, default=1)
    for kind, count in (("singles", len(EFFECTS)), ("none", 16), ("pairs", 10), ("unknown", 8)):
        parser.add_argument(f"--{kind}", type=int, default=count)
    parser.add_argument("--part", default="1/1", help="of several processes that share a draw, which: 2/3 makes every third case from the second on")
    parser.add_argument("--fleet", type=int, default=0, help="so many vehicles, each of which drives every so manieth case on a day of its own (0: one for each case)")
    parser.add_argument("--twins", action="store_true", help="drive each case with effects a second time without them, into `without`: the truth about cells")
    parser.add_argument("--amplitude", type=float, default=1.0, help="side acceleration and swing of the speed times so much, the same seed's vehicles and effects")
    given = parser.parse_args()
    part, parts = map(int, given.part.split("/"))
    world, labels = World(), {}
    counts = {"single": given.singles, "none": given.none, "double": given.pairs, "out_of_library": given.unknown}
    wanted = [(kind, k) for kind, count in counts.items() for k in range(count)]
    for number, (kind, index) in list(enumerate(wanted))[part - 1::parts]:
        case = make_case(given.seed, number, given.out, lambda r: draw_case(r, world, given, kind, number, index), lambda r, *case: write_case(r, world, *case), given.twins)
        labels[case["name"]] = case["label"]
    # Parts add to what the others wrote.
    path = given.out / "labels.json"
    told = json.loads(path.read_text()) if path.exists() and parts > 1 else {}
    path.write_text(json.dumps({**told, **labels}, indent=1))


if __name__ == "__main__":
    main()
