"""CommonRoad's multi-body car (PyPI `commonroad-vehicle-models`) as the nominal simulator of a gap diagnosis.

    pip install commonroad-vehicle-models numba
    dreamstream gap diagnose CASE --simulator "python multibody_simulator.py {case}"

The 29-state model (Althoff and Würsching, TU München: roll, pitch, compliant suspension, four spinning wheels, Magic
Formula) is compiled as it stands. Its parameters of a BMW 320i are scaled to what the case's user knows of the car: weighed
mass, measured axles, yaw inertia, friction, drag; the axles' cornering stiffnesses are matched in steady turns, as one does
with compliances. Load transfer, the tyre's knee and the split of the drive are its own.
"""

import math
import sys
from collections import namedtuple
from types import SimpleNamespace

import numba
import numpy as np
import vehiclemodels.utils.tire_model as tyre
import vehiclemodels.utils.vehicle_dynamics_ks_cog as kinematic
import vehiclemodels.vehicle_dynamics_mb as multibody
from vehiclemodels.init_mb import init_mb
from vehiclemodels.vehicle_parameters import setup_vehicle_parameters

from dreamstream.simulator import car_parameters, nominal_of_case, serve

DT = 0.02
FINE = 20  # the wheels' spin is stiff at walking pace
SCALED = ("m", "m_s", "m_uf", "m_ur", "I_Phi_s", "I_y_s", "I_z", "I_uf", "I_ur", "K_sf", "K_sr", "K_sdf", "K_sdr", "K_tsf", "K_tsr", "K_zt", "K_ras", "K_rad")

for module in (tyre, kinematic, multibody):
    for name, thing in list(vars(module).items()):
        if callable(thing) and getattr(thing, "__module__", "").startswith("vehiclemodels") and name not in ("vehicle_dynamics_mb", "vehicle_dynamics_ks_cog"):
            setattr(module, name, numba.njit(thing))
multibody.vehicle_dynamics_ks_cog = numba.njit(kinematic.vehicle_dynamics_ks_cog)
dynamics = numba.njit(multibody.vehicle_dynamics_mb)


@numba.njit
def slopes(x, push, p, more, forces):
    """Their right-hand side with forces on the body (forward, left; N) and a moment (N m), and what the axles have `more`
    in stiffness (N/rad)."""
    f = np.array(dynamics(x, (0.0, push), p))
    v = max(x[3], 3.0)
    front = more[0] * min(max(x[2] - (x[10] + p.a * x[5]) / v, -0.06), 0.06)
    rear = more[1] * min(max(-(x[10] - p.b * x[5]) / v, -0.06), 0.06)
    f[3] += forces[0] / p.m
    f[10] += (forces[1] + front + rear) / p.m_s
    f[5] += (forces[2] + p.a * front - p.b * rear) / p.I_z
    return f


@numba.njit
def advance(x, steer, push, p, more, forces):
    """Moves on by DT and returns the mean specific force."""
    h, felt = DT / FINE, np.zeros(2)
    for _ in range(FINE):
        x[2] = steer
        k1 = slopes(x.copy(), push, p, more, forces)
        k2 = slopes(x + 0.5 * h * k1, push, p, more, forces)
        k3 = slopes(x + 0.5 * h * k2, push, p, more, forces)
        k4 = slopes(x + h * k3, push, p, more, forces)
        f = (k1 + 2 * k2 + 2 * k3 + k4) / 6
        felt[0] += (f[3] - x[5] * x[10]) / FINE
        felt[1] += (f[10] + x[5] * x[3]) / FINE
        x += h * f
    return felt


KINDS = {}


def frozen(given, name="Parameters"):
    """Their parameters as nested named tuples of one kind, which compiled code can read."""
    fields = {k: frozen(v, k) if hasattr(v, "__dict__") else float(v) for k, v in vars(given).items() if v is not None and k != "trailer"}
    kind = KINDS.setdefault((name, tuple(fields)), None) or namedtuple(name, fields)
    KINDS[name, tuple(fields)] = kind
    return kind(**fields)


def build(mass, inertia, front, rear, friction, stiff=1.0):
    """Their BMW with another mass, yaw inertia, axles, friction and tyre stiffness."""
    p = setup_vehicle_parameters(vehicle_id=2)
    p.tire, p.longitudinal = SimpleNamespace(**vars(p.tire)), SimpleNamespace(**vars(p.longitudinal))
    # left and right tyres are mirror images; theirs all pull one way
    p.tire.p_hy1 = p.tire.p_vy1 = p.tire.r_hy1 = p.tire.r_vy1 = p.tire.r_by3 = p.tire.r_hx1 = 0.0
    p.longitudinal.v_switch = p.longitudinal.v_max
    heavier = mass / p.m
    for key in SCALED:
        setattr(p, key, getattr(p, key) * heavier)
    p.K_lt /= heavier
    p.a, p.b, p.I_z = front, rear, inertia
    grip = friction / p.tire.p_dy1
    p.tire.p_dy1, p.tire.p_dx1, p.tire.p_ky1 = friction, p.tire.p_dx1 * grip, p.tire.p_ky1 * stiff
    return p


def stiffnesses(p, more):
    """The axles' stiffnesses as steady turns of 2 m/s2 show them."""
    fixed, base, rows = frozen(p), p.a + p.b, []
    for v in (12.0, 22.0):
        x = np.array(init_mb([0, 0, 0, v, 0, 0, 0], p), dtype=float)
        for k in range(400):
            steer = base * 2.0 / v**2 * min(1.0, k / 100)
            advance(x, steer, 1.5 * (v - x[3]), fixed, more, np.zeros(3))
        slips = steer - (x[10] + p.a * x[5]) / x[3], -(x[10] - p.b * x[5]) / x[3]
        side = p.m * x[3] * x[5]
        rows.append([side * p.b / base / slips[0], side * p.a / base / slips[1]])
    return np.mean(rows, axis=0)


class Car:
    """One instance."""

    def __init__(self, nominal):
        self.nominal = nominal
        wanted = np.array([nominal["cornering_stiffness_front"], nominal["cornering_stiffness_rear"]])
        self.usual = {parameter.name: parameter.nominal for parameter in car_parameters(nominal)}
        self.stiff, self.more = 1.0, np.zeros(2)
        for _ in range(4):
            self.stiff *= float(np.clip(np.min(wanted / stiffnesses(self.parameters({}), np.zeros(2))), 0.5, 2.0))
        for _ in range(4):
            self.more = self.more + wanted - stiffnesses(self.parameters({}), self.more)
        self.known = {}

    def parameters(self, params):
        of = {**self.usual, **params}
        p = build(self.nominal["mass"], of["yaw_inertia_kg_m2"], of["front_arm_m"], of["rear_arm_m"], of["friction"], self.stiff)
        added = of["mass_kg"] - self.nominal["mass"]
        p.m, p.m_s = p.m + added, p.m_s + added
        return p

    def reset(self, _id, state, params, _seed):
        key = tuple(sorted(params.items()))
        if key not in self.known:
            p = self.parameters(params)
            self.known[key] = p, frozen(p)
        self.p, self.fixed = self.known[key]
        v = max(state["v"], 0.5)
        slip = math.atan2(state.get("vy", 0.0), v)
        self.x = np.array(init_mb([state["x"], state["y"], 0.0, v, state["yaw"], state["yaw_rate"], slip], self.p), dtype=float)

    def step(self, _id, steer, accel, ports):
        x, p, n = self.x, self.p, self.nominal
        push = n["mass"] / p.m * (1 + 4 * p.I_y_w / p.R_w**2 / n["mass"]) * accel
        drag = n["mass"] * n["drag_decel_per_v2"] * x[3] * abs(x[3]) + p.m * n["rolling_decel"]
        front, rear = ports.get("lateral.front", 0.0), ports.get("lateral.rear", 0.0)
        forces = np.array([n["mass"] * ports.get("drive", 0.0) - drag, front + rear, p.a * front - p.b * rear])
        felt = advance(x, steer, push, self.fixed, self.more, forces)
        return {"x": x[0], "y": x[1], "yaw": x[4], "v": x[3], "vy": x[10], "yaw_rate": x[5], "ax": felt[0], "ay": felt[1]}


def main():
    nominal = nominal_of_case()
    car = Car(nominal)
    print(f"axle stiffnesses matched with {car.more.round()} N/rad, tyres times {car.stiff:.3f}", file=sys.stderr)
    serve(
        car.reset,
        car.step,
        dt=DT,
        parameters=car_parameters(nominal),
        ports=["drive", "lateral.front", "lateral.rear"],
        reset_state=["x", "y", "yaw", "v", "vy", "yaw_rate"],
        includes=["load_transfer", "tyre_knee", "drive_split"],
    )


if __name__ == "__main__":
    main()
