"""The one class to subclass, and the values that it is shown and answers with."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import Mapping, Optional, Sequence, Union

import numpy as np

MAX_POSES = 256
MAX_HORIZON_S = 30.0
MAX_DISTANCE_M = 2000.0
MAX_PROPOSALS = 64
MAX_CONTEXT = 4096


class PlanError(ValueError):
    """Says which field of a plan is wrong, with its value."""


class Command(enum.Enum):
    """What the navigation says about the next manoeuvre."""

    STRAIGHT = 1
    LEFT = 2
    RIGHT = 3


@dataclass(frozen=True)
class Camera:
    """A camera of the rig: pixel = (cx + fx*u*d, cy + fy*v*d), u = x/z, v = y/z, d = 1 + k1*r^2 + k2*r^4."""

    name: str
    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    k1: float
    k2: float
    #: Turns camera axes into rig axes, unit quaternion (x, y, z, w).
    rig_from_camera: np.ndarray
    #: The camera in the rig, in metres.
    position_in_rig_m: np.ndarray

    @property
    def intrinsics(self) -> np.ndarray:
        """The 3x3 matrix of the pinhole."""
        return np.array([[self.fx_px, 0.0, self.cx_px], [0.0, self.fy_px, self.cy_px], [0.0, 0.0, 1.0]])

    @property
    def rotation(self) -> np.ndarray:
        """The 3x3 matrix that turns camera axes into rig axes."""
        x, y, z, w = self.rig_from_camera
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )


@dataclass(frozen=True)
class Ego:
    """What the car knows of itself at one time; the pose is given in the rig at the session's first observation."""

    time_s: float
    x_m: float
    y_m: float
    heading_rad: float
    velocity_x_mps: float
    velocity_y_mps: float
    yaw_rate_radps: float
    acceleration_x_mps2: float
    acceleration_y_mps2: float
    steering_rad: float

    @property
    def speed_mps(self) -> float:
        """Speed forward."""
        return self.velocity_x_mps


@dataclass(frozen=True)
class Session:
    """An episode as its policy knows it."""

    cameras: Mapping[str, Camera]
    #: Images per camera in each observation.
    history: int
    horizon_s: float
    step_s: float
    deadline_s: float


@dataclass(frozen=True)
class Observation:
    """What the policy sees."""

    #: Counts the observations of the session, from 0.
    sequence: int
    #: Time since the session's start.
    time_s: float
    #: For each camera its last images, oldest first: (K, height, width, 3), 8-bit RGB.
    frames: Mapping[str, np.ndarray]
    #: For each camera the times of its images.
    frame_times_s: Mapping[str, np.ndarray]
    cameras: Mapping[str, Camera]
    #: Ego estimates at the images' times, oldest first, the present one last.
    history: Sequence[Ego]
    command: Command
    #: How far the plan should reach.
    horizon_s: float
    #: Spacing of poses that the simulator works with; a plan may use another.
    step_s: float
    #: Time for the answer.
    deadline_s: float

    @property
    def ego(self) -> Ego:
        """The present ego estimate."""
        return self.history[-1]


@dataclass(frozen=True)
class Plan:
    """Poses (x forward, y left, heading) in the rig at the observation, with their times after it."""

    poses: np.ndarray
    times_s: np.ndarray
    #: Other candidates with a score each, larger is better.
    proposals: Sequence[tuple["Plan", float]] = field(default_factory=tuple)
    #: What the network attends to of the newest frames, before motion or command enter: (tokens, channels) or (channels,), at
    #: most 4096 numbers, of the same size with every answer of a session. FDπ compares frames by it.
    context: Optional[np.ndarray] = None

    @staticmethod
    def of(answer: Union["Plan", np.ndarray, Sequence[Sequence[float]]], *, spacing_s: float) -> "Plan":
        """Checks a policy's answer; an N x 3 array has its poses `spacing_s` apart, the first one `spacing_s` ahead."""
        if isinstance(answer, Plan):
            poses, times_s = _checked(answer.poses, answer.times_s)
            return Plan(poses, times_s, proposals=_proposals(answer.proposals), context=_context(answer.context))
        poses = _array(answer, name="poses")
        if poses.ndim != 2 or poses.shape[1] != 3:
            raise PlanError(f'plan field "poses" has shape {poses.shape}, (N, 3) expected')
        return Plan(*_checked(poses, spacing_s * np.arange(1, len(poses) + 1)))


def _array(value: object, *, name: str) -> np.ndarray:
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise PlanError(f'plan field "{name}" is {type(value).__name__}, numbers expected') from error


def _checked(poses: object, times_s: object) -> tuple[np.ndarray, np.ndarray]:
    poses, times_s = _array(poses, name="poses"), _array(times_s, name="times_s")
    if poses.ndim != 2 or poses.shape[1] != 3:
        raise PlanError(f'plan field "poses" has shape {poses.shape}, (N, 3) expected')
    if times_s.shape != (len(poses),):
        raise PlanError(f'plan field "times_s" has shape {times_s.shape}, ({len(poses)},) expected')
    if not 1 <= len(poses) <= MAX_POSES:
        raise PlanError(f'plan field "poses" holds {len(poses)} poses, 1 to {MAX_POSES} expected')
    for index, (x, y, heading) in enumerate(poses):
        for name, value in (("x_m", x), ("y_m", y), ("heading_rad", heading)):
            if not np.isfinite(value):
                raise PlanError(f'plan field "poses[{index}].{name}" is {value}')
        if np.hypot(x, y) > MAX_DISTANCE_M:
            raise PlanError(f'plan field "poses[{index}]" lies {np.hypot(x, y):.0f} m away, limit {MAX_DISTANCE_M} m')
    previous = 0.0
    for index, after in enumerate(times_s):
        if not np.isfinite(after) or after <= previous:
            raise PlanError(f'plan field "times_s[{index}]" is {after}, not after {previous}')
        if after > MAX_HORIZON_S:
            raise PlanError(f'plan field "times_s[{index}]" is {after}, limit {MAX_HORIZON_S}')
        previous = after
    return poses, times_s


def _proposals(proposals: Sequence[tuple[Plan, float]]) -> tuple[tuple[Plan, float], ...]:
    if len(proposals) > MAX_PROPOSALS:
        raise PlanError(f'plan field "proposals" holds {len(proposals)}, limit {MAX_PROPOSALS}')
    checked = []
    for index, (plan, score) in enumerate(proposals):
        if not np.isfinite(score):
            raise PlanError(f'plan field "proposals[{index}].score" is {score}')
        try:
            checked.append((Plan(*_checked(plan.poses, plan.times_s)), float(score)))
        except PlanError as error:
            raise PlanError(f"proposals[{index}]: {error}") from error
    return tuple(checked)


def _context(context: object) -> Optional[np.ndarray]:
    if context is None:
        return None
    tokens = _array(context, name="context")
    if tokens.ndim not in (1, 2):
        raise PlanError(f'plan field "context" has shape {tokens.shape}, (tokens, channels) or (channels,) expected')
    if not 1 <= tokens.size <= MAX_CONTEXT:
        raise PlanError(f'plan field "context" holds {tokens.size} numbers, 1 to {MAX_CONTEXT} expected')
    with np.errstate(over="ignore"):
        tokens = np.atleast_2d(tokens.astype(np.float32))
    if not np.isfinite(tokens).all():
        token, channel = np.argwhere(~np.isfinite(tokens))[0]
        raise PlanError(f'plan field "context[{token}][{channel}]" is {tokens[token, channel]}')
    return tokens


class Policy:
    """A driver. One instance is made per session, so an instance may remember what it has seen.

    Keep what is dear to load (network weights) in a class attribute or behind `functools.cache`. A policy writes `plan`, or
    `plan_batch` to answer several sessions at once.
    """

    #: What the policy calls itself, with its version.
    name = "python-policy"
    #: Spacing of the poses when `plan` returns a bare N x 3 array, in seconds.
    spacing_s = 0.5
    #: How many sessions it takes at a time; further ones wait for their turn, a minute at most.
    at_once = 64
    #: How many observations `plan_batch` is given, always.
    batch = 0
    #: How long an observation waits for those of other sessions before `plan_batch` is called, in seconds.
    gather_s = 0.005

    def begin(self, *, session: Session) -> None:
        """Called once, before the first observation."""

    def plan(self, observation: Observation) -> Union[Plan, np.ndarray]:
        """Returns where to drive: a `Plan`, or an N x 3 array of (x, y, heading) `spacing_s` apart."""
        raise NotImplementedError("subclass dreamstream.Policy and write plan() or plan_batch()")

    def plan_batch(self, observations: Sequence[Observation]) -> Sequence[Union[Plan, np.ndarray]]:
        """Returns an answer for each of exactly `batch` observations, in their order.

        Called instead of `plan` where it is written: with the newest observations of several sessions, and the last one
        again where there are fewer. `batch` is fixed since libraries choose kernels by it, and those round otherwise. It
        is called on any session's instance, so an answer may depend on nothing but its observation.
        """
        raise NotImplementedError("write plan_batch() and set batch")

    def end(self, *, reason: str) -> None:
        """Called once, after the last observation."""
