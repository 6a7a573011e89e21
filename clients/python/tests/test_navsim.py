"""Agents of NAVSIM's interface are shown what they know, and their predictions become plans."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))
import observed
from dreamstream import PlanError, messages
from dreamstream._wire.dreamstream_policy.v1 import policy_pb2 as wire
from dreamstream.navsim import NavsimBatchPolicy, NavsimPolicy, answer
from navsim_agent import ArcAgent, Mine


def seen(*, ticks=16, speed_mps=4.0):
    """A car that drives a circle of 20 m to the left for so many ticks."""
    at_s = 0.1 * np.arange(ticks)
    turned = speed_mps * at_s / 20
    ego = [
        wire.Ego(time_ns=round(1e9 * t), pose=wire.Pose(x_m=20 * np.sin(a), y_m=20 * (1 - np.cos(a)), heading_rad=a),
                 velocity_x_mps=speed_mps, acceleration_y_mps2=speed_mps**2 / 20)
        for t, a in zip(at_s, turned)
    ]
    images = [
        wire.Image(time_ns=round(1e9 * t), width_px=observed.WIDTH_PX, height_px=observed.HEIGHT_PX,
                   encoding=wire.ENCODING_RAW, data=np.full_like(observed.picture(), tick).tobytes())
        for tick, t in enumerate(at_s)
    ]
    view = wire.CameraView(calibration=observed.calibration(), images=images)
    return messages.observation(observed.observation(ego=ego, cameras=[view]))


def test_an_agent_is_shown_four_moments_half_a_second_apart():
    shown = Mine().shown(seen())
    assert [cameras.cam_f0.image[0, 0, 0] for cameras in shown.cameras] == [0, 5, 10, 15]
    assert len(shown.ego_statuses) == len(shown.lidars) == 4
    turned = 4.0 * 0.5 * np.array([-3, -2, -1, 0]) / 20
    poses = np.stack([20 * np.sin(turned), 20 * (1 - np.cos(turned)), turned], axis=1)
    assert np.allclose([status.ego_pose for status in shown.ego_statuses], poses)
    now = shown.ego_statuses[-1]
    assert now.ego_velocity.tolist() == [4.0, 0.0] and np.allclose(now.ego_acceleration, [0.0, 0.8])
    assert now.driving_command.tolist() == [1, 0, 0, 0]
    front = shown.cameras[-1].cam_f0
    assert np.allclose(front.sensor2lidar_rotation @ [0, 0, 1], [1, 0, 0])
    assert front.sensor2lidar_translation.tolist() == [1.5, 0.0, 1.6]
    assert shown.cameras[-1].cam_l0.image is None and shown.lidars[-1].lidar_pc is None


def test_at_the_start_the_oldest_moment_is_shown_again():
    shown = Mine().shown(seen(ticks=8))
    assert [cameras.cam_f0.image[0, 0, 0] for cameras in shown.cameras] == [0, 0, 2, 7]


def test_candidates_become_proposals_best_first():
    plan = Mine().plan(seen())
    assert plan.times_s.tolist() == [0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0]
    scores = [score for _, score in plan.proposals]
    assert len(scores) == 9 and scores == sorted(scores, reverse=True)
    assert np.array_equal(plan.proposals[0][0].poses, plan.poses)
    assert plan.poses[-1, 1] > 1.0  # the command says left


class Sampled:
    """What NAVSIM's agents return: a trajectory with its sampling."""

    def __init__(self, poses):
        self.poses = poses
        self.trajectory_sampling = type("Sampling", (), {"interval_length": 0.25})


class OnlyTrajectory(NavsimPolicy):
    @staticmethod
    def agent():
        return type("Agent", (), {"compute_trajectory": lambda self, shown: Sampled(np.ones((16, 3)))})()


class OnlyForward(NavsimPolicy):
    @staticmethod
    def agent():
        agent = ArcAgent()
        return type("Agent", (), {"get_feature_builders": lambda self: agent.get_feature_builders(),
                                  "initialize": lambda self: agent.initialize(), "forward": lambda self, f: agent.forward(f)})()


class Batched(NavsimBatchPolicy):
    batch = 2

    @staticmethod
    def agent():
        return ArcAgent()


def test_either_method_will_do_and_batches_give_the_same():
    assert OnlyTrajectory().plan(seen()).times_s[-1] == 4.0
    plans = Batched().plan_batch([seen(), seen(speed_mps=8.0)])
    for found in (OnlyForward().plan(seen()), plans[0]):
        assert np.array_equal(found.poses, Mine().plan(seen()).poses) and len(found.proposals) == 9
    assert np.array_equal(plans[1].poses, Mine().plan(seen(speed_mps=8.0)).poses)


@pytest.mark.parametrize("prediction, says", [
    ({"proposals": np.zeros((2, 8, 3))}, "gives no \"trajectory\", it gives ['proposals']"),
    ({"trajectory": np.zeros((8, 2))}, "(8, 2)"),
    ({"trajectory": np.zeros((8, 3)), "all_candidates": np.zeros((2, 8, 3)), "confidence_scores": np.zeros(3)}, "(2, 8, 3) and (3,)"),
])
def test_wrong_predictions_are_named(prediction, says):
    with pytest.raises(PlanError) as refused:
        answer(prediction)
    assert says in str(refused.value)
