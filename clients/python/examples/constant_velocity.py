"""Drives straight ahead at the present speed: sixteen poses, half a second apart."""
import numpy as np

from dreamstream import Policy


class ConstantVelocity(Policy):
    def plan(self, observation):
        times_s = 0.5 * np.arange(1, 17)
        return np.stack([observation.ego.speed_mps * times_s, 0 * times_s, 0 * times_s], axis=1)
