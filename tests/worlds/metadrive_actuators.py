"""Servo and drive between command and wheel of `metadrive_world.py`, which MetaDrive does not have, with every effect on the way."""

import math

DT, CONTROL = 0.02, 5
FINE = DT / CONTROL


def clip(value, limit):
    return max(min(value, limit), -limit)


class Actuators:
    """Servo of second order, lagging drive force, and every effect on the way from command to wheel; 4 ms steps."""

    def __init__(self, case, v):
        self.real, self.on = case["real"], lambda key, neutral: case["values"].get(key, neutral)
        self.mass, self.v = case["nominal"]["mass"], v
        self.servo = self.rate = self.slow = self.stick = self.play = self.accel = self.work = 0.0
        self.steers, self.accels = [], []

    def step(self, steer, accel, v, ay, secs):
        real, on, back = self.real, self.on, len(self.steers)
        self.steers += [steer] * CONTROL
        self.accels += [accel] * CONTROL
        dead_s, dead_a = (int(round(dead / FINE)) for dead in (real["steer_dead"] + on("steer_delay", 0.0), real["accel_dead"] + on("accel_delay", 0.0)))
        share = 1 - math.exp(-FINE / on("steer_lag", 1e-9))
        lag = 1 - math.exp(-FINE / (real["accel_lag"] + on("accel_lag", 0.0)))
        stiction, rate, limit, half = on("steer_stiction", 0.0), on("steer_rate", 1e9), on("steer_saturation", 9.0), 0.5 * on("steer_backlash", 0.0)
        pull, brake = real["omega"] ** 2, 2 * real["damping"] * real["omega"]
        dead_zone, jerk = on("deadzone_accel", 0.0), on("accel_jerk_limit", 1e9) * FINE
        for k in range(back, back + CONTROL):
            self.slow += (self.steers[max(k - dead_s, 0)] - self.slow) * share
            self.stick = self.slow if abs(self.slow - self.stick) > stiction else self.stick
            self.rate = clip(self.rate + FINE * (pull * (self.stick - self.servo) - brake * self.rate), rate)
            self.servo = clip(self.servo + FINE * self.rate, limit)
            self.play = max(min(self.play, self.servo + half), self.servo - half)
            ask = self.accels[max(k - dead_a, 0)]
            ask = math.copysign(max(abs(ask) - dead_zone, 0.0), ask)
            self.accel += clip((ask - self.accel) * lag, jerk)
        out = self.accel
        if out > 0:
            out = min(out * on("drive_gain", 1.0), on("power_limit", 1e9) / max(v, 1.0))
            if on("drive_cuts", 0.0) > 0 and secs % 4.3 < on("drive_cuts", 0.0):
                out = 0.0
        else:
            out *= on("brake_gain", 1.0) * max(1 - on("brake_fade", 0.0) * self.work, 0.0)
            self.work += self.mass * abs(out) * v * DT * 1e-6
        pull = on("pull_under_power", 0.0) * max(self.accel - 0.5, 0.0)
        give = 1 - on("steer_compliance", 0.0) * abs(ay)
        wheel = self.play * real["steer_gain"] * on("steer_gain", 1.0) * give + real["steer_zero"] + on("steer_offset", 0.0) + pull
        return wheel, out
