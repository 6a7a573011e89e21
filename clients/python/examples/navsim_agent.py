"""A small agent with NAVSIM's interface, in numpy, and how it is connected: put your own agent into `Mine.agent`.

python -m dreamstream run navsim_agent.py:Mine --name mine --connect tcp/127.0.0.1:7448
dreamstream run SCENARIO --policy mine --policy-listen tcp/127.0.0.1:7448 --history 16

It keeps its speed on one of nine arcs: which, says the command and how bright the road is to both sides.
"""

import numpy as np

from dreamstream.navsim import NavsimPolicy

CURVATURES = 0.01 * np.arange(-4, 5)


class Features:
    """A feature builder: what an agent makes of its input."""

    def get_unique_name(self):
        return "features"

    def compute_features(self, agent_input):
        now = agent_input.ego_statuses[-1]
        road = agent_input.cameras[-1].cam_f0.image[-24:].mean(axis=(0, 2)) / np.float32(255)
        left, right = np.array_split(road, 2)
        bright = np.float32(left.mean() - right.mean())
        status = np.concatenate([now.driving_command, now.ego_velocity, now.ego_acceleration]).astype(np.float32)
        return {"status": status, "bright": np.array([bright])}


class ArcAgent:
    """The methods of NAVSIM's AbstractAgent that an agent is driven by."""

    def name(self):
        return "arcs"

    def initialize(self):
        self.after_s = 0.5 * np.arange(1, 9, dtype=np.float32)

    def get_feature_builders(self):
        return [Features()]

    def forward(self, features):
        status = features["status"]
        way_m = np.maximum(status[:, 4:5], 0) * self.after_s
        turned = way_m[:, None] * CURVATURES[None, :, None]
        proposals = np.stack([np.sinc(turned / np.pi) * way_m[:, None], 0.5 * turned * way_m[:, None], turned], axis=-1)
        wanted = 0.02 * (status[:, 0] - status[:, 2]) + 0.5 * features["bright"][:, 0]
        scores = -np.abs(CURVATURES - wanted[:, None])
        best = np.argmax(scores, axis=1)
        return {"trajectory": proposals[np.arange(len(best)), best], "proposals": proposals, "pdm_score": scores}

    def compute_trajectory(self, agent_input):
        features = {}
        for builder in self.get_feature_builders():
            features.update(builder.compute_features(agent_input))
        return self.forward({key: value[None] for key, value in features.items()})["trajectory"][0]


class Mine(NavsimPolicy):
    name = "arcs"

    @staticmethod
    def agent():
        return ArcAgent()
