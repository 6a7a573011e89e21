"""The law of the simulator's default tracker, from its description alone: the LQR tracker of nuPlan and NAVSIM.

Speed over one step of 1 s (q = 10, r = 1); lateral offset, heading error and steering angle over ten ticks of a kinematic
bicycle linearised about the plan, Q = diag(1, 10, 0), R = 1 on the steering rate. Speed and curvature of the plan come
from regularised least squares over its poses. A world that drives by it hears the same commands as the nominal car.
"""

import numpy as np

G = 9.81
PREVIEW = 10


def wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


class Tracker:
    """Follows a plan whose poses are relative to the rig at `anchor` (x, y, heading)."""

    def __init__(self, plan, anchor, dt_ns):
        self.dt = dt_ns * 1e-9
        after = [0] + [point.after_ns for point in plan.poses]
        local = np.array([(0.0, 0.0, 0.0)] + [(p.pose.x_m, p.pose.y_m, p.pose.heading_rad) for p in plan.poses])
        local[:, 2] = np.unwrap(local[:, 2])
        steps = max(after[-1] // dt_ns, 1)
        at = np.minimum(np.arange(steps + 1) * dt_ns, after[-1])
        x, y, heading = (np.interp(at, after, local[:, i]) for i in range(3))
        cos, sin = np.cos(anchor[2]), np.sin(anchor[2])
        self.poses = np.column_stack([anchor[0] + cos * x - sin * y, anchor[1] + sin * x + cos * y, anchor[2] + heading])
        self.speed, self.curvature = self.profile()

    def profile(self):
        """Fits speed and curvature to the displacements."""
        n, dt, poses = len(self.poses) - 1, self.dt, self.poses
        moved, turned = np.diff(poses[:, :2], axis=0), np.diff(poses[:, 2])
        ahead = moved[:, 0] * np.cos(poses[:-1, 2]) + moved[:, 1] * np.sin(poses[:-1, 2])
        slopes = np.diff(np.eye(n), axis=0) / dt
        rows = slopes[:-2]
        if n >= 3:  # the published penalty: accelerations, but in its last row the difference of the last two
            rows = np.vstack([rows, slopes[-1] - slopes[-2]])
        normal = dt * dt * np.eye(n) + 1e-4 * rows.T @ rows
        speed = np.linalg.solve(normal, dt * ahead)
        step = speed * dt
        first = np.eye(n)[:1]
        normal = np.diag(step * step) + 1e-10 * first.T @ first + 1e-2 * slopes.T @ slopes
        curvature = np.linalg.solve(normal + 1e-14 * np.eye(n), step * turned)
        return speed, curvature

    def command(self, step, ego, wheel_base):
        """Returns acceleration and steering rate `step` ticks after the plan; `ego` is x, y, heading, speed, steering."""
        x, y, heading, speed, steering = ego
        last, dt = len(self.speed) - 1, self.dt
        ahead = min(step + PREVIEW, last)
        wanted = 0.0 if step > last else self.speed[ahead]
        if speed <= 0.2 and wanted <= 0.2:
            return -0.5 * (speed - wanted), 0.0
        reach = PREVIEW * dt
        acceleration = -10.0 * reach / (10.0 * reach * reach + 1.0) * (speed - wanted)
        target = self.poses[min(step, len(self.poses) - 1)]
        sin, cos = np.sin(target[2]), np.cos(target[2])
        z = [(y - target[1]) * cos - (x - target[0]) * sin, wrap(heading - target[2]), steering]
        b = [0.0, 0.0, 0.0]
        for i in range(PREVIEW):
            way = (speed + i * dt * acceleration) * dt
            bend = 0.0 if step > last else self.curvature[min(step + i, ahead)]
            z = [z[0] + way * z[1], z[1] + way / wheel_base * z[2] - way * bend, z[2]]
            b = [b[0] + way * b[1], b[1] + way / wheel_base * b[2], b[2] + dt]
        return acceleration, -(b[0] * z[0] + 10.0 * b[1] * wrap(z[1])) / (b[0] ** 2 + 10.0 * b[1] ** 2 + 1.0)


def wheel_base_that_turns(wheel_base, speed, front=14.0, rear=20.0):
    """Returns the wheel base of the slip-free car that turns like the nominal one: understeer added, blended in from 2 to
    4 m/s. Stiffness over axle load, per radian."""
    share = np.clip((speed - 2.0) / 2.0, 0.0, 1.0)
    return wheel_base + share * share * (3 - 2 * share) * (1 / front - 1 / rear) / G * speed * speed


def route_command(route, position):
    """Returns 1 straight, 2 left, 3 right: the largest turn of the route from 10 m behind to 30 m ahead, beyond 0.5 rad."""
    if len(route) < 2:
        return 1
    steps = np.diff(route, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    along = np.concatenate([[0], np.cumsum(lengths)])
    share = np.clip(((position - route[:-1]) * steps).sum(axis=1) / np.maximum(lengths**2, 1e-12), 0, 1)
    feet = route[:-1] + share[:, None] * steps
    nearest = int(np.argmin(((feet - position) ** 2).sum(axis=1)))
    here = along[nearest] + share[nearest] * lengths[nearest]
    at = here - 10.0 + 2.0 * np.arange(21)
    segment = np.clip(np.searchsorted(along, at, side="right") - 1, 0, len(steps) - 1)
    angles = np.arctan2(steps[segment, 1], steps[segment, 0])
    turned = np.cumsum(wrap(np.diff(angles)))
    largest = turned[np.argmax(np.abs(turned))]
    return 2 if largest > 0.5 else 3 if largest < -0.5 else 1
