"""What others learn of the gap: a single track whose accelerations are corrected by sparse regression (PySINDy) or by a small
network (scikit-learn) on the residuals of a case's first three drives, served as a simulator.

    pip install pysindy scikit-learn
    dreamstream gap evaluate NONE.json CASE --drives 3 --simulator "python tests/worlds/learned_residual.py {case} --fit CASE --kind sparse"

Both see what a law of `gap discover` may be made of: speed, yaw rate, wheel angle, drive request, side acceleration and the rates
of the two commands, and products of two of them; not time, place or the past. Sparsity and weight decay are chosen on the third
of those drives, the model then is of all three.
"""

import argparse
import json
import pathlib

import numpy as np
from scipy.signal import savgol_filter

from dreamstream.simulator import nominal_of_case, serve

DT, RATE_HZ = 0.01, 20


def turning(n, steer, v, vy, r):
    """Side and yaw acceleration of the linear single track, m/s2 and rad/s2."""
    v = np.maximum(v, 3.0)
    front = n["cornering_stiffness_front"] * (steer - (vy + n["lf"] * r) / v)
    rear = n["cornering_stiffness_rear"] * (n["lr"] * r - vy) / v
    return (front + rear) / n["mass"] - v * r, (n["lf"] * front - n["lr"] * rear) / n["yaw_inertia"]


def along(n, accel, v):
    """Acceleration along the car, m/s2."""
    return accel - n["rolling_decel"] - n["drag_decel_per_v2"] * v * v


def signals(v, r, steer, accel, steer_rate, accel_rate):
    """What a correction may depend on, of order one."""
    return np.stack([v / 20, r / 0.3, steer / 0.05, accel / 1.5, v * r / 3, steer_rate / 0.1, accel_rate / 3], axis=-1)


def followed(command, lag_s):
    """A command behind a first-order lag."""
    out = np.empty_like(command)
    level = command[0]
    for k, wanted in enumerate(command):
        level += (wanted - level) * (1 - np.exp(-1 / (RATE_HZ * max(lag_s, 1e-3))))
        out[k] = level
    return out


def rows(case, n, number):
    """Signals of a drive and what the single track leaves of its accelerations (along, m/s2; turning, rad/s2)."""
    drive = json.loads((case / "meta.json").read_text())["drives"][number]["file"]
    log = np.genfromtxt(case / drive, delimiter=",", names=True)
    v, r = log["v"], log["yaw_rate"]
    steer, accel = followed(log["cmd_steer"], n["steer_lag"]), followed(log["cmd_accel"], n["accel_lag"])
    slope = lambda of: savgol_filter(of, 9, 2, deriv=1, delta=1 / RATE_HZ)
    vy = np.zeros_like(v)
    for k in range(1, v.size):  # sideways speed is not logged: as the single track has it at what was measured
        part = vy[k - 1]
        for _ in range(5):
            part += turning(n, steer[k - 1], v[k - 1], part, r[k - 1])[0] / (5 * RATE_HZ)
        vy[k] = part
    left = np.stack([slope(v) - along(n, accel, v), slope(r) - turning(n, steer, v, vy, r)[1]], axis=-1)
    return signals(v, r, steer, accel, slope(steer), slope(accel))[10:-10], left[10:-10]


def products(x):
    """One, the signals, and products of two, in PySINDy's order."""
    one, pairs = np.ones(x.shape[:-1] + (1,)), [x[..., i] * x[..., j] for i in range(x.shape[-1]) for j in range(i, x.shape[-1])]
    return np.concatenate([one, x, np.stack(pairs, axis=-1)], axis=-1)


def sparse(x, y, threshold):
    """A sparse sum of products (Brunton et al. 2016, sequentially thresholded least squares)."""
    import pysindy

    library = pysindy.PolynomialLibrary(degree=2)
    made = np.asarray(library.fit_transform(x))
    assert np.allclose(made, products(x)), "the order of products is another one"
    scale = y.std(axis=0)
    weights = pysindy.STLSQ(threshold=threshold, alpha=1e-3).fit(made, y / scale).coef_ * scale[:, None]
    return lambda z: products(z) @ weights.T


def network(x, y, decay):
    """Two hidden layers of sixteen, the mean of three."""
    from sklearn.neural_network import MLPRegressor

    mean, scale = y.mean(axis=0), y.std(axis=0)
    layers = []
    for seed in range(3):
        made = MLPRegressor(hidden_layer_sizes=(16, 16), activation="tanh", alpha=decay, max_iter=400, random_state=seed).fit(x, (y - mean) / scale)
        layers.append(list(zip(made.coefs_, made.intercepts_)))

    def predict(z):
        total = 0.0
        for (a, b), (c, d), (e, f) in layers:
            total = total + np.tanh(np.tanh(z @ a + b) @ c + d) @ e + f
        return mean + scale * total / 3

    return predict


KINDS = {"sparse": (sparse, (0.03, 0.1, 0.3, 1.0)), "network": (network, (1e-3, 1e-1, 1e1)), "none": (None, ())}


def learned(case, n, kind):
    """The correction of a case's first three drives."""
    make, knobs = KINDS[kind]
    if make is None:
        return lambda z: np.zeros(2)
    drives = [rows(case, n, number) for number in range(3)]
    join = lambda some: tuple(np.concatenate(part) for part in zip(*some))
    told, kept = join(drives[:2]), drives[2]
    misses = [np.mean(((make(*told, knob)(kept[0]) - kept[1]) / told[1].std(axis=0)) ** 2) for knob in knobs]
    return make(*join(drives), knobs[int(np.argmin(misses))])


class Car:
    """One instance."""

    def __init__(self, nominal, correction):
        self.n, self.correction = nominal, correction

    def reset(self, _id, state, _params, _seed):
        self.at = np.array([state["x"], state["y"], state["yaw"], max(state["v"], 0.5), state.get("vy", 0.0), state["yaw_rate"]])
        self.last = None

    def step(self, _id, steer, accel, _ports):
        last = self.last or (steer, accel)
        self.last = steer, accel
        rates = (steer - last[0]) / DT, (accel - last[1]) / DT
        felt = np.zeros(2)

        def slopes(at):
            _, _, yaw, v, vy, r = at
            more = self.correction(signals(v, r, steer, accel, *rates))
            side, turn = turning(self.n, steer, v, vy, r)
            push = along(self.n, accel, v) + more[0]
            felt[:] = push, side + v * r
            c, s = np.cos(yaw), np.sin(yaw)
            return np.array([v * c - vy * s, v * s + vy * c, r, push, side, turn + more[1]])

        first = slopes(self.at)
        self.at = self.at + 0.5 * DT * (first + slopes(self.at + DT * first))
        self.at[3] = max(self.at[3], 0.5)
        x, y, yaw, v, vy, r = map(float, self.at)
        return {"x": x, "y": y, "yaw": yaw, "v": v, "vy": vy, "yaw_rate": r, "ax": float(felt[0]), "ay": float(felt[1])}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case", type=pathlib.Path)
    parser.add_argument("--fit", type=pathlib.Path, required=True, help="the case whose first three drives are learned from")
    parser.add_argument("--kind", choices=list(KINDS), required=True)
    parser.add_argument("--check", action="store_true")
    given = parser.parse_args()
    nominal = nominal_of_case([str(given.case)])
    car = Car(nominal, learned(given.fit, nominal, given.kind))
    serve(car.reset, car.step, dt=DT, channels=("x", "y", "yaw", "v", "vy", "yaw_rate", "ax", "ay"), arguments=["--check"] if given.check else [])


if __name__ == "__main__":
    main()
