"""Serves a co-simulation FMU (FMI 1.0, 2.0 or 3.0, by FMPy) as the nominal simulator of a gap diagnosis.

    pip install 'dreamstream[fmu]'
    python -m dreamstream.fmu model.fmu --check
    dreamstream gap diagnose CASE --simulator model.fmu

A map beside the FMU (`model.toml`, or `--map FILE`) says which of its variables are what, see docs/fmu.md. The FMU's machine
code runs in this process alone. Whole motions are turned and shifted to where a reset asks for them, so that an FMU need not
start anywhere but at its own origin; it has to be able to start at a speed.
"""

from __future__ import annotations

import argparse
import ctypes
import math
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple

from .simulator import CHANNELS, PORTS, Parameter, serve

POSE = ("x", "y", "yaw")
STARTED = ("v", "vy", "yaw_rate")
INPUTS = ("steer", "accel", *PORTS)
TABLES = {"inputs": INPUTS, "outputs": CHANNELS, "start": STARTED, "parameters": None, "values": None}
REALS = ("Real", "Float64")


class MapError(ValueError):
    """What a map says wrongly."""


@dataclass(frozen=True)
class Entry:
    """A variable of the FMU; its value is `scale` times the value in SI units."""

    variable: str
    scale: float = 1.0
    nominal: Optional[float] = None
    low: Optional[float] = None
    high: Optional[float] = None

    @staticmethod
    def of(where: str, given: Any) -> "Entry":
        """Reads `"name"` or `{ variable = "name", scale = 57.3 }`."""
        if isinstance(given, str):
            return Entry(given)
        if not isinstance(given, Mapping) or "variable" not in given:
            raise MapError(f"{where} is {given!r}, a variable's name or a table with `variable` is expected")
        unknown = set(given) - {"variable", "scale", "nominal", "low", "high"}
        if unknown or given.get("scale", 1.0) == 0.0:
            raise MapError(f"{where}: {sorted(unknown) or 'a scale of 0'} is not understood")
        return Entry(**given)


@dataclass(frozen=True)
class Map:
    """Which variables of an FMU are what."""

    inputs: Dict[str, Entry]
    outputs: Dict[str, Entry]
    start: Dict[str, Entry]
    parameters: Dict[str, Entry]
    values: Dict[str, Any]
    step_secs: Optional[float] = None
    includes: Sequence[str] = ()

    @staticmethod
    def of(text: Mapping[str, Any]) -> "Map":
        """Reads the tables of a map; what it does not know is refused by name."""
        for name in set(text) - set(TABLES) - {"step_secs", "includes"}:
            raise MapError(f"table {name!r} is not among {', '.join(TABLES)}")
        for table, known in TABLES.items():
            for name in text.get(table, {}):
                if known is not None and name not in known:
                    raise MapError(f"{table}.{name} is not among {', '.join(known)}")
        for table, needed in (("inputs", ("steer", "accel")), ("outputs", CHANNELS), ("start", ("v",))):
            for name in needed:
                if name not in text.get(table, {}):
                    raise MapError(f"{table}.{name} is missing: a diagnosis needs it")
        entries = {table: {k: Entry.of(f"{table}.{k}", v) for k, v in text.get(table, {}).items()} for table in TABLES if table != "values"}
        return Map(**entries, values=dict(text.get("values", {})), step_secs=text.get("step_secs"), includes=text.get("includes", ()))


class Fmu:
    """One instance of an FMU behind a map."""

    def __init__(self, path: Path, mapped: Map) -> None:
        import fmpy

        self.described = fmpy.read_model_description(str(path))
        if self.described.coSimulation is None:
            raise MapError(f"{str(path)!r} is no FMU for co-simulation")
        self.variables = {variable.name: variable for variable in self.described.modelVariables}
        self.map = mapped
        for name in mapped.values:
            self._variable(name)
        tables = (mapped.inputs, mapped.outputs, mapped.start, mapped.parameters)
        for entry in (entry for table in tables for entry in table.values()):
            if self._variable(entry.variable).type not in REALS:
                raise MapError(f"variable {entry.variable!r} is of type {self._variable(entry.variable).type}, a real number is expected")
        given = mapped.step_secs or getattr(self.described.defaultExperiment, "stepSize", None)
        if given is None:
            raise MapError("step_secs is missing, and the FMU names no step of its own")
        self.dt = float(given)
        self.folder = Path(fmpy.extract(str(path)))
        self.fmu: Any = None
        self.inputs = sorted({self._reference(entry) for entry in mapped.inputs.values()})
        self.outputs = [self._reference(mapped.outputs[name]) for name in CHANNELS]
        self.scales = [mapped.outputs[name].scale for name in CHANNELS]

    def _variable(self, name: str) -> Any:
        if name not in self.variables:
            raise MapError(f"the FMU has no variable {name!r}; it has {', '.join(list(self.variables)[:40])}")
        return self.variables[name]

    def _reference(self, entry: Entry) -> int:
        return self._variable(entry.variable).valueReference

    def parameters(self) -> List[Parameter]:
        """Returns what a reset can change, in SI units; what the map leaves out stands in the FMU's description."""

        def one(name: str, entry: Entry) -> Parameter:
            variable = self._variable(entry.variable)

            def said(key: str, described: str) -> float:
                mine, theirs = getattr(entry, key), getattr(variable, described, None)
                if mine is None and theirs is None:
                    raise MapError(f"parameters.{name} has no {key!r}, and the FMU says none of {entry.variable!r}")
                return float(mine) if mine is not None else float(theirs) / entry.scale

            return Parameter(name, "", said("nominal", "start"), said("low", "min"), said("high", "max"))

        return [one(name, entry) for name, entry in self.map.parameters.items()]

    def _fresh(self) -> None:
        """Brings the instance back to its beginning; one that cannot is made anew."""
        from fmpy.simulation import instantiate_fmu

        if self.fmu is not None:
            try:
                self.fmu.reset()
                return
            except Exception as error:
                print(f"the FMU cannot be reset, it is instantiated anew: {error}", file=sys.stderr)
                self.fmu.freeInstance()
        self.fmu = instantiate_fmu(str(self.folder), self.described, "CoSimulation")
        # FMPy 0.3 takes the status that these functions of FMI 1 return for a text, and follows it into memory
        known = getattr(self.fmu, "_functions", {})
        for name in ("fmi1InitializeSlave", "fmi1DoStep"):
            if name in known:
                known[name].restype = ctypes.c_int

    def _set(self, name: str, value: Any) -> None:
        variable = self._variable(name)
        getattr(self.fmu, f"set{variable.type}")([variable.valueReference], [value])

    def reset(self, _id: int, state: Mapping[str, float], params: Mapping[str, float], _seed: int) -> None:
        """Starts the instance in a state."""
        self._fresh()
        if self.described.fmiVersion == "2.0":
            self.fmu.setupExperiment(startTime=0.0)
        for name, value in self.map.values.items():
            self._set(name, value)
        for name, entry in self.map.parameters.items():
            value = params.get(name, entry.nominal)
            if value is not None:
                self._set(entry.variable, value * entry.scale)
        for name, entry in self.map.start.items():
            self._set(entry.variable, state.get(name, 0.0) * entry.scale)
        self._put({})
        if self.described.fmiVersion == "1.0":
            self.fmu.initialize()
        else:
            self.fmu.enterInitializationMode()
            self.fmu.exitInitializationMode()
        self.time = 0.0
        begun = self._read()
        self.turn = state.get("yaw", 0.0) - begun["yaw"]
        self.origin = (begun["x"], begun["y"])
        self.target = (state.get("x", 0.0), state.get("y", 0.0))

    def _put(self, asked: Mapping[str, float]) -> None:
        """Sets the inputs; those that share a variable add up."""
        sums = dict.fromkeys(self.inputs, 0.0)
        for name, entry in self.map.inputs.items():
            sums[self._reference(entry)] += asked.get(name, 0.0) * entry.scale
        self._reals("set")(list(sums), list(sums.values()))

    def _reals(self, verb: str) -> Any:
        return getattr(self.fmu, verb + ("Real" if self.described.fmiVersion in ("1.0", "2.0") else "Float64"))

    def _read(self) -> Dict[str, float]:
        return {name: value / scale for name, value, scale in zip(CHANNELS, self._reals("get")(self.outputs), self.scales)}

    def step(self, _id: int, steer: float, accel: float, ports: Mapping[str, float]) -> Dict[str, float]:
        """Moves on by one step and returns every channel."""
        self._put({"steer": steer, "accel": accel, **ports})
        self.fmu.doStep(self.time, self.dt)
        self.time += self.dt
        found = self._read()
        x, y = found["x"] - self.origin[0], found["y"] - self.origin[1]
        cos, sin = math.cos(self.turn), math.sin(self.turn)
        moved = {"x": self.target[0] + cos * x - sin * y, "y": self.target[1] + sin * x + cos * y, "yaw": found["yaw"] + self.turn}
        return {**found, **moved}

    def close(self) -> None:
        """Removes what was unpacked."""
        shutil.rmtree(self.folder, ignore_errors=True)


def read(path: Path) -> Map:
    """Reads a map's file."""
    try:
        import tomllib
    except ModuleNotFoundError:  # before Python 3.11
        import tomli as tomllib
    try:
        return Map.of(tomllib.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        raise MapError(f"there is no map {str(path)!r}: it says which variables of the FMU are what, see docs/fmu.md") from None
    except tomllib.TOMLDecodeError as error:
        raise MapError(f"map {str(path)!r} is no TOML: {error}") from None


def main(arguments: Optional[Sequence[str]] = None) -> None:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m dreamstream.fmu", description="Serve a co-simulation FMU to `dreamstream gap diagnose --simulator`.")
    parser.add_argument("fmu", type=Path)
    parser.add_argument("--map", type=Path, help="which variables are what (default: the FMU's path with .toml)")
    parser.add_argument("--check", action="store_true", help="try it out instead")
    given = parser.parse_args(arguments)
    try:
        if not given.fmu.is_file():
            raise MapError(f"there is no file {str(given.fmu)!r}")
        fmu = Fmu(given.fmu, read(given.map or given.fmu.with_suffix(".toml")))
        parameters = fmu.parameters()
    except MapError as error:
        raise SystemExit(str(error)) from None
    except ModuleNotFoundError as error:
        raise SystemExit(f"{error}: pip install 'dreamstream[fmu]'") from None
    ports = [name for name in PORTS if name in fmu.map.inputs]
    started: Tuple[str, ...] = tuple(name for name in STARTED if name in fmu.map.start)
    try:
        serve(
            fmu.reset,
            fmu.step,
            dt=fmu.dt,
            parameters=parameters,
            ports=ports,
            reset_state=(*POSE, *started),
            includes=fmu.map.includes,
            arguments=["--check"] if given.check else [],
        )
    finally:
        fmu.close()


if __name__ == "__main__":
    main()
