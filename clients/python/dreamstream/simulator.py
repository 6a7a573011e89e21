"""Serves a simulator of your own to `dreamstream gap diagnose CASE --simulator "python yours.py"`.

Two functions are enough: `reset` starts the car in a state, `step` moves it on by one `dt`. JSON lines go over standard
input and output; whatever you print goes to standard error. SI units, x forward, y left, angles counter-clockwise, at the
centre of gravity. Nothing but the standard library is needed.

    from dreamstream.simulator import Parameter, serve

    serve(reset, step, dt=0.01, parameters=[Parameter("mass_kg", "kg", 1500.0, 1000.0, 2500.0)], ports=["drive"])

`python yours.py --check` tries it out: equal repeats, step, state after a reset, sign and unit of inputs and ports.
"""

from __future__ import annotations

import json
import math
import os
import sys
from dataclasses import asdict, dataclass
from typing import Any, Callable, Dict, IO, List, Mapping, Optional, Sequence

CHANNELS = ("x", "y", "yaw", "v", "yaw_rate", "ax", "ay")
PORTS = ("steering", "drive", "lateral.front", "lateral.rear")

Reset = Callable[[int, Dict[str, float], Dict[str, float], int], None]
Step = Callable[[int, float, float, Dict[str, float]], Mapping[str, float]]


@dataclass(frozen=True)
class Parameter:
    """A parameter that a reset can set; the names are listed in docs/simulators.md."""

    name: str
    unit: str
    nominal: float
    low: float
    high: float


def nominal_of_case(arguments: Optional[Sequence[str]] = None) -> Dict[str, Any]:
    """Returns what is known of the car, `nominal` of the `meta.json` of the case that the arguments (of the command line, if
    not given) name; ends the process where they name none."""
    words = sys.argv[1:] if arguments is None else arguments
    case = next((word for word in words if not word.startswith("--")), None)
    if case is None:
        raise SystemExit(f"usage: {os.path.basename(sys.argv[0])} CASE [--check]")
    with open(os.path.join(case, "meta.json"), encoding="utf-8") as file:
        return json.load(file)["nominal"]


def car_parameters(nominal: Mapping[str, float]) -> List[Parameter]:
    """Returns what can be set of any car with four wheels, at what is known of it: arms within 0.5 m, all else from a tenth to
    three times."""
    usual = {
        ("mass_kg", "kg"): nominal["mass"],
        ("yaw_inertia_kg_m2", "kg m2"): nominal["yaw_inertia"],
        ("front_arm_m", "m"): nominal["lf"],
        ("rear_arm_m", "m"): nominal["lr"],
        ("friction", ""): nominal.get("friction", 1.0),
    }

    def around(name: str, value: float) -> tuple:
        return (value - 0.5, value + 0.5) if name.endswith("_m") else (value - 0.9 * value, value + 2.0 * value)

    return [Parameter(name, unit, value, *around(name, value)) for (name, unit), value in usual.items()]


@dataclass(frozen=True)
class Served:
    """A simulator as it is served."""

    reset: Reset
    step: Step
    hello: Dict[str, Any]
    save: Optional[Callable[[int], str]] = None
    load: Optional[Callable[[int, str], None]] = None

    def answer(self, request: Mapping[str, Any]) -> Dict[str, Any]:
        """Returns the reply to a request."""
        if "hello" in request:
            return self.hello
        if "reset" in request:
            asked = request["reset"]
            self._instance(asked["id"])
            known = {parameter["name"]: parameter for parameter in self.hello["parameters"]}
            params = dict(asked.get("params", {}))
            for name, value in params.items():
                if name not in known:
                    raise ValueError(f"there is no parameter {name!r}")
                if not known[name]["low"] <= value <= known[name]["high"]:
                    raise ValueError(f"parameter {name!r} is {value}, outside {known[name]['low']} to {known[name]['high']}")
            self.reset(asked["id"], dict(asked["state"]), params, int(asked.get("seed", 0)))
            return {"ok": asked["id"]}
        if "step" in request:
            return self._steps(request["step"])
        if "save" in request and self.save is not None:
            self._instance(request["save"])
            return {"saved": {"id": request["save"], "snapshot": self.save(request["save"])}}
        if "load" in request and self.load is not None:
            self._instance(request["load"]["id"])
            self.load(request["load"]["id"], request["load"]["snapshot"])
            return {"ok": request["load"]["id"]}
        raise ValueError(f"request {next(iter(request), None)!r} is not understood")

    def _instance(self, number: int) -> None:
        if not 0 <= number < self.hello["instances"]:
            raise ValueError(f"instance {number} is not among {self.hello['instances']}")

    def _steps(self, asked: Mapping[str, Any]) -> Dict[str, Any]:
        self._instance(asked["id"])
        ports = asked.get("ports", {})
        for name in ports:
            if name not in self.hello["ports"]:
                raise ValueError(f"there is no port {name!r}")
        for name, values in (("steer", asked["steer"]), ("accel", asked["accel"]), *ports.items()):
            if len(values) != asked["n"]:
                raise ValueError(f"input {name!r} has {len(values)} values for {asked['n']} steps")
        out: Dict[str, Any] = {name: [] for name in self.hello["channels"]}
        for k in range(asked["n"]):
            found = self.step(asked["id"], asked["steer"][k], asked["accel"][k], {name: ports[name][k] for name in ports})
            for name in self.hello["channels"]:
                value = float(found[name])
                if not math.isfinite(value):
                    raise ValueError(f"channel {name!r} is {value}")
                out[name].append(value)
        return {"out": {"id": asked["id"], **out}}


def serve(
    reset: Reset,
    step: Step,
    *,
    dt: float,
    parameters: Sequence[Parameter] = (),
    ports: Sequence[str] = (),
    channels: Sequence[str] = CHANNELS,
    reset_state: Sequence[str] = ("x", "y", "yaw", "v", "yaw_rate"),
    includes: Sequence[str] = (),
    deterministic: bool = True,
    instances: int = 1,
    save: Optional[Callable[[int], str]] = None,
    load: Optional[Callable[[int, str], None]] = None,
    arguments: Optional[Sequence[str]] = None,
) -> None:
    """Serves a simulator until it is bid goodbye, or checks it where the arguments (of the command line, if not given) hold
    `--check`; ends the process with 1 where the check fails.

    `reset(id, state, params, seed)` starts an instance; `step(id, steer, accel, ports)` moves it on by `dt` and returns
    every channel at the end of the step. `steer` is the angle of the front wheels in rad, `accel` the drive or brake force
    over nominal mass in m/s2. `includes` names mismatch of a single track that the simulator has physics of its own for
    (`load_transfer`, `tyre_relaxation`, `tyre_knee`, `drive_split`).
    """
    hello = {
        "hello": 1,
        "dt": dt,
        "parameters": [asdict(parameter) for parameter in parameters],
        "ports": list(ports),
        "channels": list(channels),
        "deterministic": deterministic,
        "snapshot": save is not None and load is not None,
        "reset_state": list(reset_state),
        "instances": instances,
        "includes": list(includes),
    }
    served = Served(reset, step, hello, save, load)
    if "--check" in (sys.argv[1:] if arguments is None else arguments):
        failed = [line for line in check(served) if not line.startswith("ok")]
        if failed:
            raise SystemExit(1)
        return
    with _own_output() as output:
        listen(served, sys.stdin, output)


def _own_output() -> IO[str]:
    """Takes standard output for replies alone: prints, of compiled code too, go to standard error."""
    sys.stdout.flush()
    own = os.dup(1)
    os.dup2(2, 1)
    return os.fdopen(own, "w")


def listen(served: Served, lines: IO[str], output: IO[str]) -> None:
    """Answers requests, one a line, until there are no more."""
    for line in lines:
        try:
            request = json.loads(line)
            if "bye" in request:
                break
            reply = served.answer(request)
        except Exception as error:  # whatever goes wrong in a simulator is said, not died of
            reply = {"error": {"id": 0, "text": f"{type(error).__name__}: {error}"}}
        output.write(json.dumps(reply) + "\n")
        output.flush()


def check(served: Served, say: Callable[[str], None] = print) -> List[str]:
    """Tries a simulator out and returns one line for each property, `ok ...` or `FAILED ...`."""
    lines: List[str] = []

    def told(fine: bool, text: str) -> None:
        lines.append(("ok      " if fine else "FAILED  ") + text)
        say(lines[-1])

    hello = served.hello
    dt = hello["dt"]
    absent = [name for name in CHANNELS if name not in hello["channels"]]
    told(not absent, f"channels: {', '.join(absent)} missing" if absent else "channels: all there")
    told(0.0001 <= dt <= 0.1, f"dt = {dt} s, 0.0001 to 0.1 expected")
    for parameter in hello["parameters"]:
        told(parameter["low"] <= parameter["nominal"] <= parameter["high"], f"parameter {parameter['name']}: low <= nominal <= high")
    if absent:
        return lines

    def drive(secs: float, steer: float = 0.0, accel: float = 0.0, ports: Optional[Dict[str, float]] = None, **reset: Any) -> Dict[str, List[float]]:
        state = {"x": 3.0, "y": -2.0, "yaw": 0.5, "v": 15.0, "yaw_rate": 0.0}
        state = {name: value for name, value in {**state, **reset.get("state", {})}.items() if name in hello["reset_state"]}
        served.answer({"reset": {"id": 0, "state": state, "params": reset.get("params", {}), "seed": 1}})
        n = max(1, round(secs / dt))
        asked = {name: [value] * n for name, value in (ports or {}).items()}
        step = {"id": 0, "n": n, "steer": [steer] * n, "accel": [accel] * n, "ports": asked}
        return served.answer({"step": step})["out"]

    base = drive(1.0)
    again = drive(1.0)
    if hello["deterministic"]:
        told(all(base[name] == again[name] for name in CHANNELS), "equal resets and inputs give equal outputs")
    started = drive(dt, state={"yaw_rate": 0.0})
    for name, value, tolerance in (("v", 15.0, 0.1 + 2 * dt), ("yaw", 0.5, 0.01), ("x", 3.0 + 15 * dt * math.cos(0.5), 0.2)):
        if name in hello["reset_state"]:
            told(abs(started[name][0] - value) < tolerance, f"reset: {name} = {started[name][0]:.3f} one step after, {value:.3f} expected")
    path = math.hypot(base["x"][-1] - base["x"][0], base["y"][-1] - base["y"][0])
    length = sum(base["v"][1:]) * dt
    told(abs(path - length) < 0.02 * length, f"dt: {path:.2f} m driven, {length:.2f} m by v and dt")
    turn = drive(1.5, steer=0.02)
    turned = turn["yaw"][-1] - turn["yaw"][0]
    by_rate = sum(turn["yaw_rate"][1:]) * dt
    told(abs(turned - by_rate) < 0.05 * abs(by_rate) + 1e-3, f"dt: turned by {turned:.4f} rad, {by_rate:.4f} by yaw_rate and dt")
    told(turn["yaw_rate"][-1] > 0.02 and turn["ay"][-1] > 0.2, f"steer to the left: yaw_rate {turn['yaw_rate'][-1]:.3f}, ay {turn['ay'][-1]:.2f}, both positive expected")
    told(abs(turn["ay"][-1] - turn["v"][-1] * turn["yaw_rate"][-1]) < 0.25 * abs(turn["ay"][-1]), "ay agrees with v times yaw_rate")
    more = drive(1.0, accel=1.0)["v"][-1] - base["v"][-1]
    told(0.7 < more < 1.3, f"accel of 1 m/s2 for 1 s: {more:.2f} m/s faster, 1 expected")
    _check_ports(hello, drive, base, turn, told)
    for parameter in hello["parameters"]:
        same = drive(1.0, params={parameter["name"]: parameter["nominal"]})
        worst = max(abs(a - b) for name in CHANNELS for a, b in zip(same[name], base[name]))
        told(worst < 1e-6, f"parameter {parameter['name']}: its nominal value changes nothing ({worst:.1e})")
    return lines


def _check_ports(hello: Mapping[str, Any], drive: Callable[..., Dict[str, List[float]]], base: Mapping[str, List[float]], turn: Mapping[str, List[float]], told: Callable[[bool, str], None]) -> None:
    """Pulses on each port: sign, and unit where it can be told."""
    unknown = [name for name in hello["ports"] if name not in PORTS]
    told(not unknown, f"ports: {unknown or 'all'} known")
    if "steering" in hello["ports"]:
        same = drive(1.5, ports={"steering": 0.02})["yaw_rate"][-1]
        told(abs(same - turn["yaw_rate"][-1]) < 0.05 * abs(turn["yaw_rate"][-1]), "port steering: acts like the steering angle, in rad")
    if "drive" in hello["ports"]:
        pushed = drive(1.0, ports={"drive": 0.5})
        more = pushed["v"][-1] - base["v"][-1]
        told(0.35 < more < 0.65, f"port drive: 0.5 m/s2 for 1 s makes {more:.2f} m/s faster, 0.5 expected")
    mass = next((p["nominal"] for p in hello["parameters"] if p["name"] == "mass_kg"), None)
    for name, sign in (("lateral.front", 1.0), ("lateral.rear", -1.0)):
        if name not in hello["ports"]:
            continue
        pushed = drive(0.3, ports={name: 500.0})
        rate = pushed["yaw_rate"][-1] - base["yaw_rate"][len(pushed["yaw_rate"]) - 1]
        told(sign * rate > 1e-4, f"port {name}: 500 N to the left turn at {rate:.4f} rad/s, {'positive' if sign > 0 else 'negative'} expected")
        if mass is not None:
            early = drive(max(hello["dt"], 0.02), ports={name: 500.0})
            felt = early["ay"][0] - base["ay"][0]
            told(0.3 < felt * mass / 500.0 < 1.7, f"port {name}: 500 N are felt as {felt:.3f} m/s2, about {500.0 / mass:.3f} expected")
