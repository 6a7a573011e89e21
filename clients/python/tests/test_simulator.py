"""The simulator protocol without a diagnosis: what a check says of a sound simulator and of wrongly wrapped ones, and what is answered to bad requests."""

import io
import json
import math
import random
import subprocess
import sys

import pytest

from dreamstream.simulator import CHANNELS, PORTS, Parameter, Served, car_parameters, check, listen, nominal_of_case, serve

DT, BASE, MASS = 0.01, 2.8, 1500.0


class Car:
    """A kinematic car with a force along and side forces that turn it; faults are switched on by name."""

    def __init__(self, *faults):
        self.faults = faults
        self.noise = random.Random(1)

    def reset(self, number, state, params, seed):
        del number, seed
        self.state = [state.get(name, 0.0) for name in ("x", "y", "yaw", "v")]
        self.mass = params.get("mass_kg", MASS)
        if "still" in self.faults:
            self.state[3] = 0.0
        if "parameter" in self.faults and params:
            self.state[3] += 0.1

    def step(self, number, steer, accel, ports):
        del number
        x, y, yaw, v = self.state
        steer += ports.get("steering", 0.0)
        if "sign" in self.faults:
            steer = -steer
        if "degrees" in self.faults:
            steer = math.radians(steer)
        dt = 0.1 * DT if "dt" in self.faults else DT
        push = accel + ports.get("drive", 0.0) * (0.0 if "deaf" in self.faults else 1.0)
        front, rear = ports.get("lateral.front", 0.0), ports.get("lateral.rear", 0.0)
        if "sides" in self.faults:
            front, rear = -front, -rear
        v += push * DT
        rate = v * math.tan(steer) / BASE + 0.05 * (front - rear) / self.mass
        if "noise" in self.faults:
            rate += self.noise.gauss(0, 1e-3)
        x, y, yaw = x + v * math.cos(yaw) * dt, y + v * math.sin(yaw) * dt, yaw + rate * dt
        self.state = [x, y, yaw, v]
        ay = v * v * math.tan(steer) / BASE + (front + rear) / self.mass
        return {"x": x, "y": y, "yaw": yaw, "v": v, "yaw_rate": rate, "ax": push, "ay": math.nan if "nan" in self.faults else ay}


def served(*faults, ports=("steering", "drive", "lateral.front", "lateral.rear")):
    car = Car(*faults)
    parameter = {"name": "mass_kg", "unit": "kg", "nominal": MASS, "low": 1000.0, "high": 2500.0}
    hello = {"hello": 1, "dt": DT, "parameters": [parameter], "ports": list(ports), "channels": list(CHANNELS), "deterministic": True,
             "snapshot": False, "reset_state": ["x", "y", "yaw", "v", "yaw_rate"], "instances": 1, "includes": []}
    return Served(car.reset, car.step, hello)


def failed(*faults):
    return [line for line in check(served(*faults), say=lambda line: None) if line.startswith("FAILED")]


def test_a_sound_simulator_passes():
    assert failed() == []


@pytest.mark.parametrize(("fault", "named"), [
    ("sign", "steer to the left"), ("degrees", "steer to the left"), ("dt", "dt:"), ("noise", "equal resets"), ("still", "reset: v"),
    ("deaf", "port drive"), ("sides", "port lateral.front"), ("parameter", "parameter mass_kg"),
])
def test_a_wrongly_wrapped_one_is_named(fault, named):
    assert any(named in line for line in failed(fault)), failed(fault)


def test_unknown_ports_and_missing_channels_are_named():
    assert any("wheel" in line for line in check(served(ports=("wheel",)), say=lambda line: None) if line.startswith("FAILED"))
    bare = served()
    bare.hello["channels"].remove("ay")
    assert any("ay missing" in line for line in check(bare, say=lambda line: None))
    assert set(PORTS) == {"steering", "drive", "lateral.front", "lateral.rear"}


def replies(simulator, *requests):
    output = io.StringIO()
    listen(simulator, io.StringIO("".join(line + "\n" for line in requests)), output)
    return [json.loads(line) for line in output.getvalue().splitlines()]


def test_requests_are_answered_line_by_line_until_goodbye():
    reset = json.dumps({"reset": {"id": 0, "state": {"v": 10.0}, "params": {"mass_kg": 1600.0}, "seed": 1}})
    step = json.dumps({"step": {"id": 0, "n": 3, "steer": [0, 0, 0], "accel": [1, 1, 1], "ports": {"drive": [0, 0, 0]}}})
    hello, ready, out = replies(served(), '{"hello": 1}', reset, step, '{"bye": 1}', step)
    assert hello["hello"] == 1 and ready == {"ok": 0}
    assert [round(v, 2) for v in out["out"]["v"]] == [10.01, 10.02, 10.03]


@pytest.mark.parametrize(("request_", "named"), [
    ("{", "JSONDecodeError"), ('{"dance": 1}', "dance"),
    ('{"reset": {"id": 7, "state": {}}}', "instance 7"),
    ('{"reset": {"id": 0, "state": {}, "params": {"mass": 1}}}', "no parameter 'mass'"),
    ('{"reset": {"id": 0, "state": {}, "params": {"mass_kg": 1}}}', "outside 1000.0 to 2500.0"),
    ('{"step": {"id": 0, "n": 2, "steer": [0], "accel": [0, 0]}}', "input 'steer' has 1 values for 2"),
    ('{"step": {"id": 0, "n": 1, "steer": [0], "accel": [0], "ports": {"wing": [1]}}}', "no port 'wing'"),
])
def test_bad_requests_are_refused_by_name_and_the_next_is_answered(request_, named):
    reset = '{"reset": {"id": 0, "state": {"v": 10}, "params": {}, "seed": 1}}'
    first, error, last = replies(served(), reset, request_, reset)
    assert named in error["error"]["text"] and first == last == {"ok": 0}


def test_what_is_not_finite_is_an_error():
    reset = '{"reset": {"id": 0, "state": {"v": 10}, "params": {}, "seed": 1}}'
    _, error = replies(served("nan"), reset, '{"step": {"id": 0, "n": 1, "steer": [0], "accel": [0]}}')
    assert "channel 'ay' is nan" in error["error"]["text"]


def test_a_failed_check_ends_with_1():
    car = Car("sign")
    with pytest.raises(SystemExit) as end:
        serve(car.reset, car.step, dt=DT, parameters=[Parameter("mass_kg", "kg", MASS, 1000.0, 2500.0)], arguments=["--check"])
    assert end.value.code == 1
    sound = Car()
    serve(sound.reset, sound.step, dt=DT, arguments=["--check"])


def test_it_needs_nothing_but_the_standard_library():
    program = "import sys, dreamstream.simulator; sys.exit(any(name in sys.modules for name in ('numpy', 'zenoh', 'google.protobuf')))"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_what_is_known_of_a_car_comes_from_the_case_on_the_command_line(tmp_path):
    known = {"mass": 1500.0, "yaw_inertia": 2500.0, "lf": 1.2, "lr": 1.6}
    (tmp_path / "meta.json").write_text(json.dumps({"nominal": known}))
    assert nominal_of_case(["--check", str(tmp_path)]) == known
    with pytest.raises(SystemExit, match="CASE"):
        nominal_of_case(["--check"])
    of = {parameter.name: parameter for parameter in car_parameters(known)}
    assert list(of) == ["mass_kg", "yaw_inertia_kg_m2", "front_arm_m", "rear_arm_m", "friction"]
    assert (of["mass_kg"].unit, of["mass_kg"].nominal, of["mass_kg"].high) == ("kg", 1500.0, 4500.0)
    assert of["mass_kg"].low == pytest.approx(150.0)
    assert (of["rear_arm_m"].low, of["rear_arm_m"].high, of["friction"].nominal) == (1.1, 2.1, 1.0)
