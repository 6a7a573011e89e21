"""An FMU behind the simulator protocol: what a map may say, and, where FMPy and a C compiler are there, the example car in every version of the standard."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from dreamstream.fmu import Entry, Map, MapError

EXAMPLE = Path(__file__).parent.parent / "examples" / "fmu"
OUTPUTS = {name: name for name in ("x", "y", "yaw", "v", "yaw_rate", "ax", "ay")}


def whole(**tables):
    return {"inputs": {"steer": "s", "accel": "a"}, "outputs": OUTPUTS, "start": {"v": "v0"}, **tables}


def test_a_map_names_variables_with_their_scales():
    read = Map.of(whole(inputs={"steer": {"variable": "s", "scale": 57.3}, "accel": "a", "drive": "a"}, values={"abs": True}))
    assert read.inputs["steer"] == Entry("s", 57.3) and read.inputs["drive"].variable == "a" and read.values == {"abs": True}


@pytest.mark.parametrize(("text", "named"), [
    (whole(start={}), "start.v is missing"),
    (whole(inputs={"steer": "s"}), "inputs.accel is missing"),
    (whole(outputs={"x": "x"}), "outputs.y is missing"),
    (whole(inputs={"steer": "s", "accel": "a", "wing": "w"}), "inputs.wing"),
    (whole(wheels={}), "table 'wheels'"),
    (whole(start={"v": 3}), "start.v is 3"),
    (whole(start={"v": {"variable": "v0", "factor": 2}}), "factor"),
    (whole(start={"v": {"variable": "v0", "scale": 0.0}}), "scale of 0"),
])
def test_what_is_wrong_with_a_map_is_named(text, named):
    with pytest.raises(MapError) as refused:
        Map.of(text)
    assert named in str(refused.value)


def built(tmp_path, version):
    pytest.importorskip("fmpy", reason="FMPy is not installed: pip install 'dreamstream[fmu]'")
    if shutil.which("cc") is None:
        pytest.skip("there is no C compiler `cc`")
    path = tmp_path / "car.fmu"
    subprocess.run([sys.executable, EXAMPLE / "build.py", "--fmi", version, "-o", path], check=True)
    return path


@pytest.mark.parametrize("version", ["1", "2", "3"])
def test_the_example_passes_its_check(tmp_path, version):
    path = built(tmp_path, version)
    said = subprocess.run([sys.executable, "-m", "dreamstream.fmu", path, "--check"], capture_output=True, text=True, check=False)
    assert said.returncode == 0 and "FAILED" not in said.stdout and "port drive" in said.stdout, said.stdout + said.stderr


@pytest.mark.parametrize(("before", "after", "named"), [
    ('x = "x"', 'x = "wing"', "no variable 'wing'"),
    (", high = 6000.0", "", "parameters.mass_kg has no 'high'"),
])
def test_a_map_that_does_not_fit_is_refused_by_name(tmp_path, before, after, named):
    path = built(tmp_path, "2")
    text = path.with_suffix(".toml").read_text()
    assert before in text
    path.with_suffix(".toml").write_text(text.replace(before, after))
    said = subprocess.run([sys.executable, "-m", "dreamstream.fmu", path], input="", capture_output=True, text=True, check=False)
    assert said.returncode != 0 and named in said.stderr, said.stderr
    gone = subprocess.run([sys.executable, "-m", "dreamstream.fmu", tmp_path / "no.fmu"], capture_output=True, text=True, check=False)
    assert "there is no file" in gone.stderr
