"""A sim-server in Python: the vehicle, actuators, sensors and drivers of `own_world.py` in the simulator's place.

Follows the policy's plans with the nominal tracking law (`nominal_tracker.py`), so that commands are those that the nominal
car would hear; everything behind the commands is this world's own: two-track car, Magic Formula tyres, second-order servo,
Heun steps of 4 ms, ages and noise of sensors. One effect, none or two are drawn from a seed and written to a file apart.

    dreamstream run SCENARIOS --policy log-replay --observation layout --vehicle-log --out RUN \\
        --stage "sim=python tests/worlds/world_stage.py --seed 5 --answer ANSWER.json"
"""

import argparse
import json
import pathlib
import zlib

import numpy as np

import own_world
from dreamstream import stage
from nominal_tracker import Tracker, route_command, wheel_base_that_turns, wrap
from own_traffic import Traffic, contacts

DT, G = own_world.DT, own_world.G
HISTORY = 500
LOGGED = ("x", "y", "yaw", "v", "r", "servo", "ax", "ay", "wheel")
# Followers are another field; a switch has no size; the others need more than a short drive in still air.
LEFT_OUT = {"kinematic_only", "brake_fade", "wind_steady"}
DRAWN = [name for name in own_world.EFFECTS if name not in LEFT_OUT and not name.startswith("tr_")]
SENSED = {"gyro_bias", "gyro_scale", "ax_bias", "ay_bias", "imu_misalignment", "wheel_scale", "lever_arm", "pose_latency",
          "imu_latency", "clock_drift", "suspension_roll"}
NOISE = (0.012, 0.012, 0.0018, 0.025, 0.0028, 0.0, 0.0, 0.0006, 0.03)


def draw_effects(r, count):
    """Draws effects of different groups, from weak to strong as `own_world` does."""
    values = {}
    while len(values) < count:
        name = str(r.choice(DRAWN))
        if all(own_world.EFFECTS[name][1] != own_world.EFFECTS[other][1] for other in values):
            values[name] = own_world.draw_value(r, name)
    return values


def mismatch(r, vehicle):
    """Draws what a vehicle differs in from the nominal car of a scenario, as much as the vehicles of `own_world` do."""
    like, real = own_world.draw_vehicle(r)
    mass, base = vehicle.mass_kg, vehicle.wheel_base_m
    front, rear = 14.0 * 0.5 * mass * G, 20.0 * 0.5 * mass * G
    inertia = mass * (vehicle.size.length_m**2 + vehicle.size.width_m**2) / 12.0
    real.update(
        mass=mass * real["mass"] / like["mass"], inertia=inertia * real["inertia"] / like["yaw_inertia"],
        lf=0.5 * base, lr=0.5 * base, cf=front * real["cf"] / like["cornering_stiffness_front"],
        cr=rear * real["cr"] / like["cornering_stiffness_rear"], omega=2 * real["damping"] / 0.05,
        accel_lag=0.2 * real["accel_lag"] / like["accel_lag"], roll=abs(real["roll"] - like["rolling_decel"]),
        drag=abs(real["drag"] - like["drag_decel_per_v2"] * like["mass"]))
    return real, {"mass": mass}


class Car(own_world.Lanes):
    """One car of `own_world`, stepped instead of driven by that world's own driver; may stand."""

    def __init__(self, real, nominal, values):
        self.n = 1
        self.values = values
        self.real = {key: np.array([value]) for key, value in real.items() if key != "follow"}
        self.nominal = {key: np.array([value]) for key, value in nominal.items()}
        self.real["lf"] = self.real["lf"] + values.get("cg_shift", 0.0)
        self.real["lr"] = self.real["lr"] - values.get("cg_shift", 0.0)
        self.real["relax"] = self.real["relax"] + values.get("tyre_relaxation", 0.0)
        on = values.get
        self.constants = (
            self.real["mass"] + on("payload", 0.0) * self.nominal["mass"],
            self.real["inertia"] * (1 + 0.5 * on("payload", 0.0)) * on("yaw_inertia", 1.0),
            self.real["cf"] * on("front_grip", 1.0), self.real["cr"] * on("rear_grip", 1.0), self.real["mu"] * on("mu", 1.0),
            self.real["roll"] + G * on("roll_add", 0.0), self.real["drag"] + 0.5 * own_world.AIR * on("drag_add", 0.0),
            self.real["lf"] + self.real["lr"])

    def on(self, key, neutral):
        return self.values.get(key, neutral)

    def heun(self, s, p, gust):
        keys = ("x", "y", "yaw", "v", "vy", "r", "af", "ar")
        first, _ = self.slopes(s, p, gust)
        half = {**s, **{key: s[key] + DT * first[key] for key in keys}}
        second, out = self.slopes(half, p, gust)
        for key in keys:
            s[key] = s[key] + 0.5 * DT * (first[key] + second[key])
        if s["v"][0] < 0.3:  # brakes hold; what creeps does not slip
            s["v"] = np.maximum(s["v"], 0.0)
            s["r"] = s["v"] * np.tan(s["wheel"]) / p[-1]
            s["vy"] = s["r"] * self.real["lr"]
            s["af"], s["ar"] = np.zeros(1), np.zeros(1)
            if s["v"][0] == 0.0:
                out = (np.zeros(1), np.zeros(1))
        return out


class World:
    """Maker of `world` and `ego`."""

    def __init__(self, scene, seed, values):
        self.scene, self.spec, self.scenario = scene, scene.spec, scene.scenario
        self.values = values
        self.dt = self.scenario.dt_ns * 1e-9
        self.substeps = round(self.dt / DT)
        real, nominal = mismatch(np.random.default_rng([seed, 1]), self.scenario.vehicle)
        self.noise_scale, self.imu_noise = real["noise"], real["imu_noise"]
        self.car = Car(real, nominal, values)
        self.route = np.column_stack([self.scenario.route.x_m, self.scenario.route.y_m])
        self.traffic = Traffic(self.scenario, self.spec.agents)
        r = np.random.default_rng([seed, zlib.crc32(self.spec.scenario.encode()), self.spec.seed])
        samples = 2 * (self.spec.last_tick + 2)
        self.white = r.normal(0, 1, (samples, 9))
        self.late = r.normal(0, np.hypot(0.001, values.get("timestamp_jitter", 0.0)), samples)
        self.lost = r.random(samples) < values.get("dropped_frames", 0.0)
        wander = np.cumsum(r.normal(0, 1, (2, samples)), axis=1)
        wander -= wander.mean(axis=1, keepdims=True)
        self.wander = 0.03 * wander / np.maximum(wander.std(axis=1, keepdims=True), 1e-9)

    # --- state ---------------------------------------------------------------------------------------------------------

    def start(self):
        self.tick, self.step, self.tracker = 0, 0, None
        self.state = self.logged(0)
        self.sent = [(float(self.state["servo"][0]), float(self.state["acc"][0]))] * HISTORY
        self.hold = self.sent[-1]
        self.past = [self.moment((np.array([self.state["acc"][0]]), self.state["v"] * self.state["r"]))] * HISTORY
        self.velocity, self.acceleration = self.rig_velocity(), (float(self.state["acc"][0]), float(self.state["v"][0] * self.state["r"][0]))
        self.traffic.start()

    def logged(self, tick):
        """Takes the recorded drive over as a state of this car."""
        ego = self.scenario.ego_log[min(tick, len(self.scenario.ego_log) - 1)]
        lr, lf = self.car.real["lr"][0], self.car.real["lf"][0]
        x, y, heading = ego.pose.x_m, ego.pose.y_m, ego.pose.heading_rad
        v, r = max(ego.velocity_mps.x, 0.0), ego.yaw_rate_radps
        vy = ego.velocity_mps.y + lr * r
        steer = ego.steering_rad
        if steer == 0.0 and v > 1.0:
            steer = float(np.arctan(r * wheel_base_that_turns(self.scenario.vehicle.wheel_base_m, v) / v))
        speed = max(v, 1.0)
        fields = {"x": x + lr * np.cos(heading), "y": y + lr * np.sin(heading), "yaw": heading, "v": v, "vy": vy, "r": r,
                  "servo": steer, "rate": 0.0, "servo2": steer, "play": steer, "wheel": steer, "stick": steer,
                  "acc": ego.acceleration_mps2.x, "push": ego.acceleration_mps2.x, "heat": 0.0,
                  "af": steer - np.arctan2(vy + lf * r, speed), "ar": -np.arctan2(vy - lr * r, speed)}
        return {key: np.array([float(value)]) for key, value in fields.items()}

    def moment(self, felt):
        s = self.state
        wheel = s["v"] * (1 + felt[0] / G / self.car.real["slip"] * 1.1)
        return tuple(float(a[0]) for a in (s["x"], s["y"], s["yaw"], s["v"], s["r"], s["servo"], felt[0], felt[1], wheel))

    def rig(self):
        """Returns the rear axle's pose."""
        s, lr = self.state, self.car.real["lr"][0]
        yaw = float(s["yaw"][0])
        return float(s["x"][0]) - lr * np.cos(yaw), float(s["y"][0]) - lr * np.sin(yaw), float(wrap(yaw))

    def rig_velocity(self):
        s = self.state
        return float(s["v"][0]), float(s["vy"][0] - s["r"][0] * self.car.real["lr"][0])

    # --- motion --------------------------------------------------------------------------------------------------------

    def advance(self):
        """Moves the world one tick on."""
        before = self.rig_velocity()
        speed = float(self.state["v"][0])
        self.traffic.advance(self.tick, self.rig(), before[0], self.scenario.vehicle, self.dt)
        if self.tracker is None:
            self.follow_log()
        else:
            vehicle = self.scenario.vehicle
            x, y, heading = self.rig()
            base = wheel_base_that_turns(vehicle.wheel_base_m, speed)
            command = self.tracker.command(self.tick - self.planned_at, (x, y, heading, speed, self.sent[-1][0]), base)
            accel = float(np.clip(command[0], -vehicle.max_deceleration_mps2, vehicle.max_acceleration_mps2))
            rate = float(np.clip(command[1], -vehicle.max_steering_rate_radps, vehicle.max_steering_rate_radps))
            for _ in range(self.substeps):
                limit = vehicle.max_steering_rad
                self.sent.append((float(np.clip(self.sent[-1][0] + rate * DT, -limit, limit)), accel))
                self.substep()
        self.tick += 1
        after = self.rig_velocity()
        r = float(self.state["r"][0])
        self.velocity = after
        self.acceleration = ((after[0] - before[0]) / self.dt - r * after[1], (after[1] - before[1]) / self.dt + r * after[0])
        self.sent, self.past = self.sent[-HISTORY:], self.past[-HISTORY:]

    def substep(self):
        self.step += 1
        rate = self.values.get("cmd_hold_rate")
        fresh = rate is None or np.floor(self.step * DT * rate) > np.floor((self.step - 1) * DT * rate)
        if rate is not None:
            self.hold = self.sent[-1] if fresh else self.hold
            self.held = (getattr(self, "held", []) + [self.hold])[-HISTORY:]
        heard = self.sent if rate is None else self.held
        late = lambda own, effect: min(round((self.car.real[own][0] + self.values.get(effect, 0.0)) / DT), len(heard) - 1)
        steer, accel = heard[-1 - late("steer_dead", "steer_delay")][0], heard[-1 - late("accel_dead", "accel_delay")][1]
        self.car.actuate(self.state, np.array([steer]), np.array([accel]), self.step)
        felt = self.car.heun(self.state, self.car.constants, 0.0)
        self.past.append(self.moment(felt))

    def follow_log(self):
        """Puts the car on the recorded drive, whose commands are taken to be what it shows."""
        next_state = self.logged(self.tick + 1)
        turn = wrap(next_state["yaw"] - self.state["yaw"])
        next_state["yaw"] = self.state["yaw"] + turn
        start = np.array(self.past[-1])
        self.state = next_state
        end = np.array(self.moment((next_state["acc"], next_state["v"] * next_state["r"])))
        for k in range(1, self.substeps + 1):
            self.past.append(tuple(start + (end - start) * k / self.substeps))
            self.sent.append((float(next_state["servo"][0]), float(next_state["acc"][0])))
        self.step += self.substeps

    # --- sensors -------------------------------------------------------------------------------------------------------

    def at(self, index, secs):
        """Returns a column of the past at a time since the start."""
        back = (self.tick * self.dt - secs) / DT
        place = np.clip(len(self.past) - 1 - back, 0, len(self.past) - 1)
        low = int(place)
        high = min(low + 1, len(self.past) - 1)
        return self.past[low][index] + (place - low) * (self.past[high][index] - self.past[low][index])

    def view(self, secs):
        """Returns what the sensors show at a time, without noise: the columns of `LOGGED`."""
        on, real = self.values.get, {key: value[0] for key, value in self.car.real.items()}
        pose = secs - real["pose_age"] - on("pose_latency", 0.0) - on("clock_drift", 0.0) * secs
        inertial = secs - real["imu_age"] - on("imu_latency", 0.0)
        yaw, arm, turn = self.at(2, pose), on("lever_arm", 0.0), on("imu_misalignment", 0.0)
        ax, ay = self.at(6, inertial), self.at(7, inertial) * (1 + real["roll_gain"] + on("suspension_roll", 0.0))
        return [
            self.at(0, pose) + arm * np.cos(yaw), self.at(1, pose) + arm * np.sin(yaw), yaw, self.at(3, pose),
            self.at(4, inertial) * (1 + on("gyro_scale", 0.0)) + on("gyro_bias", 0.0) + real["gyro_zero"],
            ax * np.cos(turn) + ay * np.sin(turn) + on("ax_bias", 0.0) + real["ax_zero"],
            ay * np.cos(turn) - ax * np.sin(turn) + on("ay_bias", 0.0) + real["ay_zero"],
            self.at(5, secs - real["encoder_age"]),
            self.at(8, secs - real["wheel_age"]) * real["wheel"] * on("wheel_scale", 1.0)]

    def readings(self):
        """Returns the two samples of the last tick: 20 Hz, in the middle of its halves."""
        if not self.spec.vehicle_log or self.tick == 0:
            return []
        made = []
        for part in (0, 1):
            number, secs = 2 * self.tick + part, (self.tick - 0.75 + 0.5 * part) * self.dt
            fresh = number
            while fresh > 2 and self.lost[fresh] and number - fresh < 20:
                fresh -= 1
            seen = np.array(self.view(min(secs - (number - fresh) * 0.5 * self.dt + self.late[fresh], self.tick * self.dt)))
            seen[:2] += self.wander[:, fresh]
            sd = np.array(NOISE) * self.noise_scale
            sd[5:7] = self.imu_noise * self.noise_scale
            seen += sd * self.white[fresh]
            if fresh != number:  # odometry of steering and wheels is not sent with what was lost
                own = np.array(self.view(secs)) + sd * self.white[number]
                seen[7:] = own[7:]
            steer, accel = self.sent[-1 - round((self.tick * self.dt - secs) / DT)]
            made.append(stage.PB["Reading"](
                secs=secs, cmd_steer_rad=steer, cmd_accel_mps2=accel, x_m=seen[0], y_m=seen[1], yaw_rad=seen[2], speed_mps=seen[3],
                yaw_rate_radps=seen[4], ax_mps2=seen[5], ay_mps2=seen[6], steering_rad=np.round(seen[7] / 0.0005) * 0.0005,
                wheel_speed_mps=seen[8]))
        return made

    # --- messages ------------------------------------------------------------------------------------------------------

    def ego_state(self, pose, velocity, yaw_rate, acceleration, steering):
        ego = stage.PB["EgoState"](yaw_rate_radps=yaw_rate, steering_rad=steering, steering_rate_radps=float(self.state["rate"][0]))
        ego.pose.x_m, ego.pose.y_m, ego.pose.heading_rad = pose
        ego.velocity_mps.x, ego.velocity_mps.y = velocity
        ego.acceleration_mps2.x, ego.acceleration_mps2.y = acceleration
        return ego

    def outputs(self, before, last):
        """Yields `world` and `ego` of the current tick."""
        s, tick = self.state, self.tick
        truth = self.ego_state(self.rig(), self.velocity, float(s["r"][0]), self.acceleration, float(s["wheel"][0]))
        world = stage.PB["World"](tick=tick, time_ns=tick * self.scenario.dt_ns, ego=truth, before=before, readings=self.readings())
        world.agents.extend(self.traffic.show(tick))
        world.lights.extend(head.states[min(tick, len(head.states) - 1)] if head.states else 1 for head in self.scenario.map.traffic_lights)
        world.contacts.extend(contacts(truth, self.scenario.vehicle, world.agents))
        if last:
            world.snapshot = self.snapshot()
        yield "world", tick, 0, tick, world
        known = self.ego_state(self.rig(), self.velocity, float(s["r"][0]), self.acceleration, float(s["servo"][0]))
        if SENSED & self.values.keys():
            seen, arm = self.view(tick * self.dt), self.scenario.vehicle.wheel_base_m * 0.5
            pose = (seen[0] - arm * np.cos(seen[2]), seen[1] - arm * np.sin(seen[2]), float(wrap(seen[2])))
            known = self.ego_state(pose, (seen[8], self.velocity[1]), seen[4], (seen[5], seen[6]), seen[7])
        yield "ego", tick, 0, tick, stage.PB["Ego"](estimate=known, command=route_command(self.route, np.array(self.rig()[:2])))

    def snapshot(self):
        """Returns all that the next tick depends on."""
        head = {"tick": self.tick, "step": self.step, "state": {key: float(value[0]) for key, value in self.state.items()},
                "hold": self.hold, "held": getattr(self, "held", []), "traffic": self.traffic.snapshot(),
                "velocity": self.velocity, "acceleration": self.acceleration}
        return json.dumps(head).encode() + b"\n" + np.array(self.sent).tobytes() + np.array(self.past).tobytes()

    def restore(self, order, inputs):
        if order.iteration == 0:
            return
        snapshot = inputs["world", order.first_tick - 1, 0].snapshot
        head, data = snapshot.split(b"\n", 1)
        head = json.loads(head)
        self.tick, self.step, self.velocity, self.acceleration = head["tick"], head["step"], head["velocity"], head["acceleration"]
        self.state = {key: np.array([value]) for key, value in head["state"].items()}
        self.hold, self.held = tuple(head["hold"]), [tuple(pair) for pair in head["held"]]
        values = np.frombuffer(data)
        count = values.size // (2 + len(LOGGED))
        self.sent = [tuple(row) for row in values[:2 * count].reshape(-1, 2).tolist()]
        self.past = [tuple(row) for row in values[2 * count:].reshape(-1, len(LOGGED)).tolist()]
        self.traffic.restore(head["traffic"])
        self.tracker = None

    def work(self, order, inputs):
        motion = order.WhichOneof("motion")
        if motion == "initial":
            self.start()
            yield from self.outputs(bytes(32), True)
            return
        if motion == "choice":
            raise stage.Fault("bad_settings", "this world ranks no proposals")
        if motion == "plan":
            self.tracker, self.planned_at = Tracker(order.plan, self.rig(), self.scenario.dt_ns), self.tick
        else:
            self.tracker = None
        before = order.border
        for tick in range(order.first_tick, order.last_tick + 1):
            self.advance()
            yield from self.outputs(before, tick == order.last_tick)
            before = bytes(32)  # the digest of a state within an iteration is its reader's business


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--kind", choices=["none", "single", "double"], default="single")
    parser.add_argument("--effect", action="append", default=[], metavar="ID=VALUE", help="instead of a draw")
    parser.add_argument("--answer", type=pathlib.Path, help="where the withheld effects are written")
    given = parser.parse_args()
    values = draw_effects(np.random.default_rng([given.seed, 0]), {"none": 0, "single": 1, "double": 2}[given.kind])
    if given.effect:
        values = {name: float(value) for name, value in (text.split("=") for text in given.effect)}
    if given.answer:
        effects = [{"id": name, "value": value, "unit": own_world.EFFECTS[name][0]} for name, value in values.items()]
        given.answer.write_text(json.dumps({"service": "sim" if effects else None, "effects": effects, "seed": given.seed}, indent=1))
    stage.serve("sim", lambda scene: World(scene, given.seed, values), describe="own world")


if __name__ == "__main__":
    main()
