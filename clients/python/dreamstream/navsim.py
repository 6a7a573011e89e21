"""Drives with an agent of NAVSIM's interface, as it is: subclass `NavsimPolicy`, make the agent in `agent`.

The agent is handed what NAVSIM's `AgentInput` holds: `ego_statuses`, `cameras` and `lidars`, four of each, half a second
apart, oldest first (the oldest one again at the start of a drive); poses relative to now, velocities in the car, the
driving command as one of left, straight, right, unknown. Cameras that this car lacks are empty, and so are lidars;
`sensor2lidar` leads into the rig (x forward, y left, origin on the ground under the rear axle), which stands in for the
lidar. Nothing of NAVSIM is imported: an agent is known by its methods `compute_trajectory(agent_input)`, or
`get_feature_builders()` and `forward(features)`.

    from dreamstream.navsim import NavsimPolicy

    class Mine(NavsimPolicy):
        @staticmethod
        def agent():
            return MyAgent(checkpoint="mine.ckpt")
"""

from __future__ import annotations

import contextlib
import functools
import sys
from dataclasses import dataclass, field
from typing import Any, Mapping, Optional, Sequence

import numpy as np

from .policy import MAX_PROPOSALS, Command, Ego, Observation, Plan, PlanError, Policy

SPACING_S = 0.5
#: Names of candidates and of their scores in the predictions of published agents.
CANDIDATES = (("proposals", "pdm_score"), ("all_candidates", "confidence_scores"))
_COMMANDS = (Command.LEFT, Command.STRAIGHT, Command.RIGHT)


@dataclass
class Camera:
    """A camera of NAVSIM; empty where the car has none."""

    image: Optional[np.ndarray] = None
    sensor2lidar_rotation: Optional[np.ndarray] = None
    sensor2lidar_translation: Optional[np.ndarray] = None
    intrinsics: Optional[np.ndarray] = None
    #: k1, k2, p1, p2, k3.
    distortion: Optional[np.ndarray] = None


@dataclass
class Cameras:
    """The eight cameras of NAVSIM."""

    cam_f0: Camera = field(default_factory=Camera)
    cam_l0: Camera = field(default_factory=Camera)
    cam_l1: Camera = field(default_factory=Camera)
    cam_l2: Camera = field(default_factory=Camera)
    cam_r0: Camera = field(default_factory=Camera)
    cam_r1: Camera = field(default_factory=Camera)
    cam_r2: Camera = field(default_factory=Camera)
    cam_b0: Camera = field(default_factory=Camera)


@dataclass
class Lidar:
    """No lidar."""

    lidar_pc: Optional[np.ndarray] = None


@dataclass
class EgoStatus:
    """The car at one time."""

    ego_pose: np.ndarray
    ego_velocity: np.ndarray
    ego_acceleration: np.ndarray
    driving_command: np.ndarray
    in_global_frame: bool = False


@dataclass
class AgentInput:
    """What an agent is shown."""

    ego_statuses: list[EgoStatus]
    cameras: list[Cameras]
    lidars: list[Lidar]


class NavsimPolicy(Policy):
    """Asks an agent of NAVSIM's interface for a plan; its candidates, if it tells them, become proposals."""

    spacing_s = SPACING_S
    #: Which camera of the car stands for which of NAVSIM's; one of the same name needs no entry.
    cameras: Mapping[str, str] = {"cam_f0": "front"}
    #: How many past moments the agent sees, half a second apart: `--history` must span them, 16 frames for 4.
    moments = 4

    @staticmethod
    def agent() -> Any:
        """Makes the agent; called once a process."""
        raise NotImplementedError("return an agent of NAVSIM's interface")

    def plan(self, observation: Observation) -> Plan:
        """Asks the agent."""
        agent, shown = _ready(type(self)), self.shown(observation)
        if not hasattr(agent, "compute_trajectory"):
            return answer(predict(agent, [shown])[0])
        agent.told = {}
        driven = agent.compute_trajectory(shown)
        told = {key: value[0] for key, value in _arrays(agent.told).items() if np.ndim(value)}
        sampling = getattr(driven, "trajectory_sampling", None)
        spacing_s = getattr(sampling, "interval_length", SPACING_S)
        return answer({**told, "trajectory": _array(getattr(driven, "poses", driven))}, spacing_s=spacing_s)

    def shown(self, observation: Observation) -> AgentInput:
        """Returns what the agent is shown."""
        times_s = observation.ego.time_s - SPACING_S * np.arange(self.moments - 1, -1, -1)
        egos = [_newest(observation.history, [ego.time_s for ego in observation.history], at_s) for at_s in times_s]
        says = [observation.command is command for command in _COMMANDS]
        command = np.array([*says, False], dtype=np.int64)
        return AgentInput(
            ego_statuses=[_status(ego, observation.ego, command) for ego in egos],
            cameras=[self._cameras(observation, at_s) for at_s in times_s],
            lidars=[Lidar() for _ in times_s],
        )

    def _cameras(self, observation: Observation, at_s: float) -> Cameras:
        named = {name: self.cameras.get(name, name) for name in Cameras.__dataclass_fields__}
        there = {name: here for name, here in named.items() if here in observation.cameras}
        return Cameras(**{name: _camera(observation, here, at_s) for name, here in there.items()})


class NavsimBatchPolicy(NavsimPolicy):
    """Asks for several sessions at once by the agent's `forward`; set `batch`."""

    def plan_batch(self, observations: Sequence[Observation]) -> list[Plan]:
        """Asks the agent once."""
        predictions = predict(_ready(type(self)), [self.shown(observation) for observation in observations])
        return [answer(prediction) for prediction in predictions]


@functools.cache
def _ready(made_by: type[NavsimPolicy]) -> Any:
    """Returns the agent, set up, which keeps in `told` what its `forward` returned last."""
    agent = made_by.agent()
    if hasattr(agent, "initialize"):
        agent.initialize()
    if hasattr(agent, "eval"):
        agent.eval()
    forward = getattr(agent, "forward", None)

    def telling(*arguments: Any, **named: Any) -> Any:
        agent.told = forward(*arguments, **named)
        return agent.told

    if forward is not None:
        agent.forward = telling
    return agent


def predict(agent: Any, inputs: Sequence[AgentInput]) -> list[dict[str, np.ndarray]]:
    """Returns what `forward` says of each input, asked at once."""
    shown = []
    for one in inputs:
        features: dict[str, Any] = {}
        for builder in agent.get_feature_builders():
            features.update(builder.compute_features(one))
        shown.append(features)
    batch = {key: _stacked([features[key] for features in shown]) for key in shown[0]}
    torch = sys.modules.get("torch")
    with torch.no_grad() if torch else contextlib.nullcontext():
        said = _arrays(agent.forward(batch))
    return [{key: value[row] for key, value in said.items()} for row in range(len(inputs))]


def answer(prediction: Mapping[str, np.ndarray], *, spacing_s: float = SPACING_S) -> Plan:
    """Returns the plan of one prediction: its `trajectory`, and the best of its candidates as proposals."""
    if "trajectory" not in prediction:
        raise PlanError(f'the agent gives no "trajectory", it gives {sorted(prediction)}')
    plan = Plan.of(prediction["trajectory"], spacing_s=spacing_s)
    for poses, scores in CANDIDATES:
        if poses in prediction and scores in prediction:
            candidates, scored = prediction[poses], np.ravel(prediction[scores])
            if candidates.ndim != 3 or len(candidates) != len(scored):
                shapes = f"{candidates.shape} and {scored.shape}"
                raise PlanError(f'"{poses}" and "{scores}" have shapes {shapes}, (N, poses, 3) and (N,) expected')
            best = np.argsort(-scored, kind="stable")[: MAX_PROPOSALS]
            proposals = [(Plan.of(candidates[place], spacing_s=spacing_s), float(scored[place])) for place in best]
            return Plan(plan.poses, plan.times_s, proposals=proposals)
    return plan


def _newest(values: Sequence[Any], times_s: Sequence[float], at_s: float) -> Any:
    """Returns the newest value that is not younger than `at_s`, or the oldest."""
    return values[max(int(np.searchsorted(times_s, at_s + 1e-6, side="right")) - 1, 0)]


def _status(ego: Ego, now: Ego, command: np.ndarray) -> EgoStatus:
    cos, sin = np.cos(now.heading_rad), np.sin(now.heading_rad)
    x, y = ego.x_m - now.x_m, ego.y_m - now.y_m
    turned = np.arctan2(np.sin(ego.heading_rad - now.heading_rad), np.cos(ego.heading_rad - now.heading_rad))
    return EgoStatus(
        ego_pose=np.array([cos * x + sin * y, cos * y - sin * x, turned]),
        ego_velocity=np.array([ego.velocity_x_mps, ego.velocity_y_mps], dtype=np.float32),
        ego_acceleration=np.array([ego.acceleration_x_mps2, ego.acceleration_y_mps2], dtype=np.float32),
        driving_command=command,
    )


def _camera(observation: Observation, name: str, at_s: float) -> Camera:
    seen = observation.cameras[name]
    return Camera(
        image=_newest(observation.frames[name], observation.frame_times_s[name], at_s),
        sensor2lidar_rotation=seen.rotation,
        sensor2lidar_translation=seen.position_in_rig_m,
        intrinsics=seen.intrinsics,
        distortion=np.array([seen.k1, seen.k2, 0.0, 0.0, 0.0]),
    )


def _array(value: Any) -> np.ndarray:
    """Returns an array, of a PyTorch tensor on any device too."""
    return np.asarray(value.detach().cpu().numpy() if hasattr(value, "detach") else value)


def _arrays(said: Mapping[str, Any]) -> dict[str, np.ndarray]:
    wanted = {"trajectory", *[name for pair in CANDIDATES for name in pair]}
    return {key: _array(value) for key, value in said.items() if key in wanted}


def _stacked(values: Sequence[Any]) -> Any:
    if not hasattr(values[0], "unsqueeze"):
        return np.stack(values)
    import torch

    return torch.stack(list(values))
