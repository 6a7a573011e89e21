"""What a policy may answer, and how wrong answers are named."""

import numpy as np
import pytest

from dreamstream import Plan, PlanError


def line(count):
    return np.stack([np.arange(1.0, count + 1), np.zeros(count), np.zeros(count)], axis=1)


def test_a_bare_array_is_spaced_evenly():
    plan = Plan.of(line(8), spacing_s=0.5)
    assert plan.times_s.tolist() == [0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0]
    assert plan.poses.shape == (8, 3)


def test_a_list_is_taken_like_an_array():
    assert Plan.of([[1, 0, 0], [2, 0, 0]], spacing_s=1.0).times_s.tolist() == [1.0, 2.0]


def test_a_context_is_tokens_of_single_precision():
    one = Plan.of(Plan(line(1), np.array([1.0]), context=[0.5, 1.5]), spacing_s=0.5).context
    assert (one.shape, one.dtype, one.tolist()) == ((1, 2), np.float32, [[0.5, 1.5]])
    assert Plan.of(line(1), spacing_s=0.5).context is None


def nan_at(index, column):
    poses = line(8)
    poses[index, column] = np.nan
    return poses


@pytest.mark.parametrize(
    "answer, says",
    [
        (nan_at(3, 0), "poses[3].x_m"),
        (nan_at(0, 2), "poses[0].heading_rad"),
        (np.zeros((8, 2)), "(8, 2)"),
        (np.zeros(3), "(3,)"),
        (np.zeros((0, 3)), "holds 0 poses"),
        (np.zeros((300, 3)), "holds 300 poses"),
        (1e6 * line(2), "poses[0]"),
        ("straight ahead", "str"),
        (None, "shape ()"),
        (Plan(line(2), np.array([1.0, 0.5])), "times_s[1]"),
        (Plan(line(2), np.array([0.0, 0.5])), "times_s[0]"),
        (Plan(line(2), np.array([1.0, 31.0])), "limit 30"),
        (Plan(line(2), np.array([1.0])), "times_s"),
        (Plan(line(1), np.array([1.0]), proposals=[(Plan(nan_at(1, 1), np.arange(1, 9)), 0.5)]), "proposals[0]"),
        (Plan(line(1), np.array([1.0]), proposals=[(Plan(line(1), np.array([1.0])), np.inf)]), "proposals[0].score"),
        (Plan(line(1), np.array([1.0]), context=np.zeros((2, 3, 4))), "(2, 3, 4)"),
        (Plan(line(1), np.array([1.0]), context=np.zeros((0, 3))), "holds 0 numbers"),
        (Plan(line(1), np.array([1.0]), context=np.zeros(4097)), "holds 4097 numbers"),
        (Plan(line(1), np.array([1.0]), context=[[0.0, 0.0], [0.0, np.nan]]), "context[1][1]"),
        (Plan(line(1), np.array([1.0]), context="tokens"), "context"),
    ],
)
def test_wrong_answers_are_named(answer, says):
    with pytest.raises(PlanError) as refused:
        Plan.of(answer, spacing_s=0.5)
    assert says in str(refused.value)
