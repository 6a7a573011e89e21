"""Builds `car.c` as an FMU and writes its map, for trying `gap diagnose CASE --simulator car.fmu` out.

    pip install 'dreamstream[fmu]'
    python build.py --fmi 3 --case CASE -o car.fmu

Needs a C compiler as `cc`. With `--case` the car has the nominal parameters of that case, as an FMU of a known car would.
"""

import argparse
import json
import pathlib
import re
import subprocess
import tempfile
import zipfile

import fmpy
from fmpy.fmi1 import FMU1Slave
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

HERE = pathlib.Path(__file__).parent
INPUTS = ["steer", "force", "front_force", "rear_force"]
OUTPUTS = ["x", "y", "yaw", "v", "yaw_rate", "ax", "ay"]
PARAMETERS = {"v_start": 10.0, "vy_start": 0.0, "yaw_rate_start": 0.0, "mass": 1500.0, "inertia": 2500.0, "lf": 1.3, "lr": 1.5, "front_stiffness": 90000.0, "rear_stiffness": 100000.0, "rolling": 0.1, "drag": 0.6}
KNOWN = {"mass_kg": "mass", "yaw_inertia_kg_m2": "inertia", "front_arm_m": "lf", "rear_arm_m": "lr", "front_stiffness_n": "front_stiffness", "rear_stiffness_n": "rear_stiffness"}
STEP = 0.01


def described(fmi):
    """The model description of FMI 1.0, 2.0 or 3.0."""
    if fmi == 1:
        return described_before()
    real = fmi == 2
    names = [*INPUTS, *OUTPUTS, *PARAMETERS]
    lines = []
    for number, name in enumerate(names, start=1):
        causality = "input" if name in INPUTS else "output" if name in OUTPUTS else "parameter"
        start = "" if causality == "output" else f' start="{PARAMETERS.get(name, 0.0)!r}"'
        head = f'name="{name}" valueReference="{number}" causality="{causality}" variability="{"fixed" if causality == "parameter" else "continuous"}"'
        initial = {"parameter": ' initial="exact"', "output": ' initial="calculated"', "input": ""}[causality]
        lines.append(f"<ScalarVariable {head}{initial}><Real{start}/></ScalarVariable>" if real else f"<Float64 {head}{initial}{start}/>")
    places = range(len(INPUTS) + 1, len(INPUTS) + len(OUTPUTS) + 1)
    if real:
        structure = "<Outputs>" + "".join(f'<Unknown index="{k}"/>' for k in places) + "</Outputs>"
        structure += "<InitialUnknowns>" + "".join(f'<Unknown index="{k}"/>' for k in places) + "</InitialUnknowns>"
        kind = '<CoSimulation modelIdentifier="car" canHandleVariableCommunicationStepSize="true"/>'
        head = 'fmiVersion="2.0" modelName="car" guid="{dreamstream-car}"'
    else:
        lines.insert(0, '<Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>')
        structure = "".join(f'<Output valueReference="{k}"/>' for k in places) + "".join(f'<InitialUnknown valueReference="{k}"/>' for k in places)
        kind = '<CoSimulation modelIdentifier="car" canHandleVariableCommunicationStepSize="true"/>'
        head = 'fmiVersion="3.0" modelName="car" instantiationToken="{dreamstream-car}"'
    experiment = f'<DefaultExperiment startTime="0" stopTime="10" stepSize="{STEP}"/>'
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<fmiModelDescription {head}>{kind}{experiment}<ModelVariables>\n' + "\n".join(lines) + f"\n</ModelVariables><ModelStructure>{structure}</ModelStructure></fmiModelDescription>\n"


def described_before():
    """The model description of FMI 1.0, which knows neither a structure nor a step."""
    lines = []
    for number, name in enumerate([*INPUTS, *OUTPUTS, *PARAMETERS], start=1):
        causality = "input" if name in INPUTS else "output" if name in OUTPUTS else "internal"
        variability = "parameter" if name in PARAMETERS else "continuous"
        start = "" if causality == "output" else f' start="{PARAMETERS.get(name, 0.0)!r}"'
        lines.append(f'<ScalarVariable name="{name}" valueReference="{number}" causality="{causality}" variability="{variability}"><Real{start}/></ScalarVariable>')
    head = 'fmiVersion="1.0" modelName="car" modelIdentifier="car" guid="{dreamstream-car}" numberOfContinuousStates="0" numberOfEventIndicators="0"'
    kind = '<Implementation><CoSimulation_StandAlone><Capabilities canHandleVariableCommunicationStepSize="true"/></CoSimulation_StandAlone></Implementation>'
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<fmiModelDescription {head}><DefaultExperiment startTime="0" stopTime="10"/><ModelVariables>\n' + "\n".join(lines) + f"\n</ModelVariables>{kind}</fmiModelDescription>\n"


def mapped(nominal, fmi):
    """The map, with the parameters of a case where there is one."""
    mass = nominal.get("mass", PARAMETERS["mass"])
    force = '{ variable = "force", scale = %r }' % mass
    lines = [f"step_secs = {STEP}", ""] if fmi == 1 else []
    lines += ["[inputs]", 'steer = "steer"', f"accel = {force}", f"drive = {force}", '"lateral.front" = "front_force"', '"lateral.rear" = "rear_force"']
    lines += ["", "[outputs]", *(f'{name} = "{name}"' for name in OUTPUTS)]
    lines += ["", "[start]", *(f'{name} = "{name}_start"' for name in ("v", "vy", "yaw_rate"))]
    keys = {"mass": "mass", "inertia": "yaw_inertia", "lf": "lf", "lr": "lr", "front_stiffness": "cornering_stiffness_front", "rear_stiffness": "cornering_stiffness_rear"}
    value = {name: nominal.get(keys[name], PARAMETERS[name]) for name in KNOWN.values()}
    entry = '{ variable = "%s", nominal = %r, low = %r, high = %r }'
    lines += ["", "[parameters]", *(f"{known} = {entry % (name, value[name], 0.2 * value[name], 4.0 * value[name])}" for known, name in KNOWN.items())]
    resistance = {"rolling": nominal.get("rolling_decel", 0.1), "drag": mass * nominal.get("drag_decel_per_v2", 0.0004)}
    lines += ["", "[values]", *(f"{name} = {value!r}" for name, value in resistance.items())]
    return "\n".join(lines) + "\n"


def others(source):
    """C of the standards' functions that the car has no use for: each answers with an error."""
    have = set(re.findall(r"\b(?:car_fmi|fmi[23])[A-Z]\w+", source))
    kinds = ((FMU1Slave, "fmi1", "car_fmi"), (FMU2Slave, "fmi2", "fmi2"), (FMU3Slave, "fmi3", "fmi3"))
    names = [name.replace(start, symbol) for kind, start, symbol in kinds for name in dir(kind) if name.startswith(start)]
    return "\n".join(f"int {name}(void) {{ return 3; }}" for name in names if name not in have)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fmi", type=int, choices=[1, 2, 3], default=2)
    parser.add_argument("--case", type=pathlib.Path)
    parser.add_argument("-o", "--out", type=pathlib.Path, required=True)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        library = pathlib.Path(folder) / f"car{fmpy.sharedLibraryExtension}"
        rest = pathlib.Path(folder) / "others.c"
        rest.write_text(others((HERE / "car.c").read_text()))
        subprocess.run(["cc", "-O2", "-shared", "-fPIC", "-w", "-o", library, HERE / "car.c", rest, "-lm"], check=True)
        with zipfile.ZipFile(given.out, "w", zipfile.ZIP_DEFLATED) as fmu:
            fmu.writestr("modelDescription.xml", described(given.fmi))
            fmu.write(library, f"binaries/{fmpy.platform if given.fmi < 3 else fmpy.platform_tuple}/{library.name}")
    nominal = json.loads((given.case / "meta.json").read_text())["nominal"] if given.case else {}
    given.out.with_suffix(".toml").write_text(mapped(nominal, given.fmi))


if __name__ == "__main__":
    main()
