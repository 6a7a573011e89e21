"""MetaDrive's car (PyPI `metadrive-simulator`, Bullet's raycast vehicle) as the nominal simulator of a gap diagnosis.

    pip install metadrive-simulator
    dreamstream gap diagnose CASE --simulator "python metadrive_simulator.py {case}"

Chassis, suspension, four wheels and contact are MetaDrive's, stepped at 5 ms; mass, yaw inertia, axles and friction are set to
what the case's user knows of the car. Air and rolling resistance, which MetaDrive lacks, are forces on the body. Its wheels
hardly slip below their friction limit, whatever stiffness a case names, and take whatever pushes sideways: there is a port along
the car alone.
"""

import math

from metadrive.component.vehicle.vehicle_type import DefaultVehicle
from metadrive.engine import base_engine
from metadrive.envs.metadrive_env import MetaDriveEnv
from panda3d.core import Vec3

from dreamstream.simulator import car_parameters, nominal_of_case, serve

PHYSICS, EACH = 0.005, 4
DT = PHYSICS * EACH
G = 9.81
# the transform that Bullet hands out is behind its velocities by two steps, half of one gained back
LATE = 1.5 * PHYSICS
SETTLE_SECS = 1.5


def plane():
    """MetaDrive's engine without its map: a plane."""
    base_engine.BaseEngine.try_pull_asset = lambda self: None  # nothing is drawn, so no picture files are needed
    env = MetaDriveEnv({"use_render": False, "show_terrain": False, "traffic_density": 0.0, "num_scenarios": 1, "log_level": 50})
    env.reset(seed=0)
    env.engine.clear_objects(list(env.engine.get_objects()))
    env.current_map.detach_from_world()
    physics = env.engine.physics_world.dynamic_world
    physics.clearContactAddedCallback()
    physics.setGravity(Vec3(0, 0, -G))
    return env, physics


class Car:
    """One instance."""

    def __init__(self, nominal):
        self.nominal = nominal
        self.usual = {parameter.name: parameter.nominal for parameter in car_parameters(nominal)}
        self.env, self.physics = plane()
        self.vehicle = None

    def build(self, of):
        """Makes a new car, for wheels remember, and sets mass, inertia, axles and grip."""
        if self.vehicle is not None:
            self.env.engine.clear_objects([self.vehicle.name], force_destroy=True)
        config = {"navigation_module": None, "spawn_position_heading": ((0.0, 0.0), 0.0)}
        self.vehicle = self.env.engine.spawn_object(DefaultVehicle, vehicle_config=config, random_seed=0)
        self.body, self.system = self.vehicle.body, self.vehicle.system
        self.body.setMass(of["mass_kg"])
        inertia = self.body.getInertia()
        self.body.setInertia(Vec3(inertia.x, inertia.y, of["yaw_inertia_kg_m2"]))
        for number, wheel in enumerate(self.system.getWheels()):
            wheel.setMaxSuspensionForce(2.0 * of["mass_kg"] * G)  # as delivered 6 kN, on which heavy ones sit on the ground
            wheel.setFrictionSlip(of["friction"])
            at = wheel.getChassisConnectionPointCs()
            wheel.setChassisConnectionPointCs(Vec3(at.x, of["front_arm_m"] if number < 2 else -of["rear_arm_m"], at.z))
        self.of = of

    def stand(self, yaw):
        """Puts the car on its springs."""
        self.vehicle.set_position((0.0, 0.0), height=DefaultVehicle.TIRE_RADIUS + 0.1)
        self.vehicle.set_heading_theta(yaw)
        self.push(0.0, 0.0)
        for _ in range(round(SETTLE_SECS / PHYSICS)):
            self.physics.doPhysics(PHYSICS, 1, PHYSICS)

    def push(self, steer, force):
        for wheel in range(4):
            self.system.applyEngineForce(max(force, 0.0) / 4, wheel)
            self.system.setBrake(max(-force, 0.0) / 4 * PHYSICS, wheel)
            if wheel < 2:
                self.system.setSteeringValue(math.degrees(steer), wheel)

    def seen(self):
        """Position and heading at the instant of the velocities, body velocity and yaw rate."""
        velocity, rate = self.body.getLinearVelocity(), self.body.getAngularVelocity().z
        ahead = self.vehicle.origin.getQuat().xform(Vec3(0, 1, 0))
        yaw, at = math.atan2(ahead.y, ahead.x) + LATE * rate, self.vehicle.origin.getPos() + velocity * LATE
        return at, yaw, velocity, rate

    def reset(self, _id, state, params, _seed):
        self.build({**self.usual, **params})
        self.stand(state["yaw"])
        yaw, v, vy = state["yaw"], state["v"], state.get("vy", 0.0)
        velocity = Vec3(v * math.cos(yaw) - vy * math.sin(yaw), v * math.sin(yaw) + vy * math.cos(yaw), 0)
        self.body.setLinearVelocity(velocity)
        self.body.setAngularVelocity(Vec3(0, 0, state.get("yaw_rate", 0.0)))
        at, now, self.velocity, _ = self.seen()
        self.offset = (state["x"] - at.x, state["y"] - at.y)
        self.yaw, self.turn = yaw, yaw - now

    def step(self, _id, steer, accel, ports):
        mass = self.of["mass_kg"]
        self.push(steer, self.nominal["mass"] * accel)
        for _ in range(EACH):
            _, yaw, velocity, _ = self.seen()
            ahead = Vec3(math.cos(yaw), math.sin(yaw), 0)
            v = velocity.dot(ahead)
            resistance = self.nominal["drag_decel_per_v2"] * self.nominal["mass"] * v * abs(v) + mass * self.nominal["rolling_decel"] * (v > 0.05)
            self.body.applyCentralForce(ahead * (self.nominal["mass"] * ports.get("drive", 0.0) - resistance))
            self.physics.doPhysics(PHYSICS, 1, PHYSICS)
        at, yaw, velocity, rate = self.seen()
        cos, sin = math.cos(yaw), math.sin(yaw)
        felt, self.velocity = (velocity - self.velocity) / DT, velocity
        off = yaw + self.turn - self.yaw
        self.yaw += math.atan2(math.sin(off), math.cos(off))
        return {
            "x": at.x + self.offset[0], "y": at.y + self.offset[1], "yaw": self.yaw, "v": velocity.x * cos + velocity.y * sin, "yaw_rate": rate,
            "ax": felt.x * cos + felt.y * sin, "ay": felt.y * cos - felt.x * sin,
        }


def main():
    nominal = nominal_of_case()
    car = Car(nominal)
    serve(
        car.reset,
        car.step,
        dt=DT,
        parameters=car_parameters(nominal),
        ports=["drive"],
        reset_state=["x", "y", "yaw", "v", "vy", "yaw_rate"],
        includes=["load_transfer", "tyre_knee", "drive_split"],
    )


if __name__ == "__main__":
    main()
