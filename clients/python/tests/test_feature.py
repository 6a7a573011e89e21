"""The example that tells what it attends to: tokens of the frame alone travel with each answer."""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
import observed
from dreamstream.__main__ import load
from dreamstream.bridge import Sessions

EXAMPLE = Path(__file__).resolve().parents[1] / "examples" / "feature_policy.py"


def answered(**shown):
    sent = []
    served = Sessions(load(f"{EXAMPLE}:FeaturePolicy"), put=lambda *message: sent.append(message))
    for leaf, data in (("hello", observed.hello()), ("observation", observed.observation(**shown))):
        served.take(session="s", leaf=leaf, data=data)
    assert [leaf for _, leaf, _ in sent] == ["ready", "plan"]
    plan = observed.plan(sent[-1][2])
    return plan.poses[-1].pose.x_m, np.reshape(plan.context.values, (-1, plan.context.channels))


def test_tokens_are_of_the_frame_alone():
    way_m, tokens = answered()
    assert tokens.shape == (60, 16) and np.isfinite(tokens).all()
    faster_m, same = answered(speed_mps=20.0)
    assert faster_m > 1.5 * way_m and np.array_equal(tokens, same)
    _, others = answered(data=observed.picture(7).tobytes())
    assert not np.array_equal(tokens, others)
