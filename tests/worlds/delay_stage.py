"""A policy-bridge in Python whose transport ages observations: the policy is shown frames of a while ago.

Hosts the recorded drive as its policy, seen from where the car believes to be; like every bridge it says with its answer
of what time the newest frame was. The delay is drawn from a seed, or none, and written to a file apart.

    dreamstream run SCENARIOS --policy log-replay --observation layout --vehicle-log --out RUN \\
        --stage "policy=python tests/worlds/delay_stage.py --seed 5 --answer ANSWER.json"
"""

import argparse
import json
import pathlib

import numpy as np

from dreamstream import stage


def wrap(angle):
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


class Bridge:
    """Maker of `plan`."""

    def __init__(self, scene, delay_secs):
        self.scene, self.delay_ns = scene, round(1e9 * delay_secs)
        self.arrived = [0]

    def restore(self, order, inputs):
        """What arrived before is known from the stamps alone."""
        self.arrived = list(range(order.first_tick)) or [0]

    def logged(self, tick):
        """Returns the recorded pose at a tick; past its end the last speed and heading go on."""
        log = self.scene.scenario.ego_log
        last = log[min(tick, len(log) - 1)]
        beyond = max(tick - len(log) + 1, 0) * self.scene.scenario.dt_ns * 1e-9 * max(last.velocity_mps.x, 0.0)
        heading = last.pose.heading_rad
        return last.pose.x_m + beyond * np.cos(heading), last.pose.y_m + beyond * np.sin(heading), heading

    def work(self, order, inputs):
        self.arrived.extend(range(order.first_tick, order.last_tick + 1))
        if not order.plan_due:
            return
        now, dt = order.last_tick, self.scene.scenario.dt_ns
        shown = max([tick for tick in self.arrived if tick * dt <= now * dt - self.delay_ns], default=0)
        ego = inputs["ego", now, 0].estimate
        cos, sin = np.cos(ego.pose.heading_rad), np.sin(ego.pose.heading_rad)
        plan = stage.PB["Plan"](observed_ns=shown * dt)
        for k in range(1, self.scene.spec.horizon + 1):
            x, y, heading = self.logged(now + k)
            dx, dy = x - ego.pose.x_m, y - ego.pose.y_m
            point = plan.trajectory.poses.add(after_ns=k * dt)
            point.pose.x_m, point.pose.y_m = cos * dx + sin * dy, -sin * dx + cos * dy
            point.pose.heading_rad = wrap(heading - ego.pose.heading_rad)
        yield "plan", order.iteration, 0, now, plan


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--kind", choices=["none", "single"], default="single")
    parser.add_argument("--answer", type=pathlib.Path, help="where the withheld delay is written")
    given = parser.parse_args()
    r = np.random.default_rng([given.seed, 0])
    delay = float(r.uniform(0.06, 0.5)) if given.kind == "single" else 0.0
    if given.answer:
        effects = [{"id": "obs_latency", "value": delay, "unit": "s"}] if delay else []
        given.answer.write_text(json.dumps({"service": "policy" if delay else None, "effects": effects, "seed": given.seed}, indent=1))
    stage.serve("policy", lambda scene: Bridge(scene, delay), describe="late bridge")


if __name__ == "__main__":
    main()
