"""Drives straight on, slower where it looks blocked, and tells what it attends to: a member of a panel of FDπ.

The features are means and contrasts of a grid of patches, drawn through one layer, in numpy; a network of your own gives its
tokens the same way. They are made of the newest frame alone: the speed enters afterwards.

python -m dreamstream run feature_policy.py:FeaturePolicy --name feature --connect tcp/127.0.0.1:7448
"""
import numpy as np

from dreamstream import Plan, Policy

ROWS, COLUMNS, CHANNELS = 6, 10, 16
WEIGHTS = np.random.default_rng(0).standard_normal((6, CHANNELS)).astype(np.float32)


def tokens(frame):
    """(height, width, 3), 8-bit, to (60, 16): one token for each patch of the frame."""
    height, width = frame.shape[0] // ROWS * ROWS, frame.shape[1] // COLUMNS * COLUMNS
    patches = frame[:height, :width].reshape(ROWS, height // ROWS, COLUMNS, width // COLUMNS, 3) / np.float32(255)
    seen = np.concatenate([patches.mean(axis=(1, 3)), patches.std(axis=(1, 3))], axis=2)
    return np.tanh(seen.reshape(ROWS * COLUMNS, 6) @ WEIGHTS)


class FeaturePolicy(Policy):
    def plan(self, observation):
        context = tokens(observation.frames["front"][-1])
        ahead = context.reshape(ROWS, COLUMNS, CHANNELS)[ROWS // 2 :, 4:6].mean()
        times_s = 0.5 * np.arange(1, 17)
        way_m = observation.ego.speed_mps * (0.9 + 0.1 * ahead) * times_s
        return Plan(np.stack([way_m, 0 * times_s, 0 * times_s], axis=1), times_s, context=context)
