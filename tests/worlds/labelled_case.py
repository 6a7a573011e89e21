"""What the reference worlds by other authors share: which effects a case has, its files, and another try where a car cannot drive it."""

import copy
import shutil

import numpy as np

DIGITS = {"cmd_steer": 5, "cmd_accel": 3, "x": 3, "y": 3, "yaw": 4, "v": 3, "yaw_rate": 4, "ax": 2, "ay": 2, "steer_meas": 4, "v_wheel": 3}


class Unfit(Exception):
    """The vehicle that was drawn cannot drive its case."""


def draw_ids(r, kind, index, effects, unknown):
    """Draws the effects of a case: singles and unknown ones in turn, pairs from two groups (second entry of an effect)."""
    names, strange = list(effects), list(unknown)
    ids = {"none": [], "single": [names[index % len(names)]], "out_of_library": [strange[index % len(strange)]]}.get(kind)
    if ids is None:
        first = names[r.integers(len(names))]
        others = [n for n in names if effects[n][1] != effects[first][1]]
        ids = [first, others[r.integers(len(others))]]
    return ids


# What a day brings to a vehicle: tyres and road, weather, the zeros of its sensors; its load varies as well.
DAILY = ("grip", "mu", "steer_zero", "gyro_zero", "ax_zero", "ay_zero", "crown", "wind", "wind_x", "wind_y", "hill", "hill_phase")


def draw_car(r, seed, number, fleet, draw):
    """Draws the vehicle of a case by `draw(rng)`, which gives what its user knows of it and what it is: another one for every
    case, or, of a fleet of so many, each in turn with a day of its own. Also returns the names of vehicle and day."""
    if not fleet:
        return *draw(r), {}
    member = number % fleet
    nominal, real = draw(np.random.default_rng([seed, 10**6 + member]))
    _, other = draw(np.random.default_rng([seed, 2 * 10**6 + number]))
    real.update({key: other[key] for key in DAILY if key in other})
    heavy = real if "mass" in real else real["build"]
    heavy["mass"] *= 1 + r.normal(0, 0.006)
    return nominal, real, {"vehicle": f"{seed}-{member}", "day": f"{number:03d}"}


def write_log(path, t, rows, missing):
    """Writes the log of one drive in the practice schema, missing channels empty."""
    cells = [[f"{v:.3f}" for v in t]] + [[f"{v:.{p}f}" if k not in missing else "" for v in rows[k]] for k, p in DIGITS.items()]
    path.write_text("t," + ",".join(DIGITS) + "\n" + "\n".join(",".join(row) for row in zip(*cells)) + "\n")


def make_case(seed, number, out, draw, write, twins=False):
    """Draws and drives one case by `draw(rng)` and `write(rng, case, folder)`; again with another vehicle if this one is
    unfit. What no library contains is driven a second time without it into `without`, so that its size can be told; with
    `twins` every effect is, so that the cells in which it shows can be told."""
    for attempt in range(50):
        rng = np.random.default_rng([seed, number, attempt])
        case = draw(rng)
        again = copy.deepcopy(rng)
        try:
            write(rng, case, out / case["name"])
            if case["label"]["kind"] == "out_of_library" or (twins and case["values"]):
                write(again, {**case, "values": {}}, out / "without" / case["name"])
            return case
        except Unfit:
            shutil.rmtree(out / case["name"], ignore_errors=True)
    raise SystemExit(f"case {number}: no vehicle can drive it")
