"""One PyTorch network, used in two ways: inside DreamStream as ONNX, or served from this process.

python torch_policy.py FOLDER      writes FOLDER/torch.onnx and FOLDER/torch.toml; then
dreamstream run SCENARIO --policy FOLDER/torch.toml

python -m dreamstream run torch_policy.py:TorchPolicy --name torch --connect tcp/127.0.0.1:7448
dreamstream run SCENARIO --policy torch --policy-listen tcp/127.0.0.1:7448

Both drive the same drive. The weights here are drawn, so the car wanders: put your own into `network()`.
"""
import functools
import sys
from pathlib import Path

import numpy as np
import torch
from torch import nn

from dreamstream import Command, Policy

WIDTH_PX, HEIGHT_PX, POSES, SPACING_S = 160, 96, 8, 0.5
MEAN, STD = 0.45, 0.25


class Network(nn.Module):
    """[1, 3, 96, 160] and [1, 4] (speed in m/s, left, straight, right) to eight poses, [1, 8, 3]."""

    def __init__(self):
        super().__init__()
        sizes = [3, 8, 16, 24, 32]
        layers = [[nn.Conv2d(a, b, 3, stride=2, padding=1), nn.ReLU()] for a, b in zip(sizes, sizes[1:])]
        self.eye = nn.Sequential(*[part for layer in layers for part in layer], nn.Flatten())
        self.head = nn.Sequential(nn.Linear(32 * 6 * 10 + 4, 64), nn.ReLU(), nn.Linear(64, 3 * POSES))
        after_s = SPACING_S * torch.arange(1, POSES + 1)
        self.register_buffer("after_s", after_s)
        self.register_buffer("unit", torch.stack([0.5 * after_s, 0.5 * after_s, 0.05 * after_s], dim=1))

    def forward(self, image, state):
        numbers = self.head(torch.cat([self.eye(image), state * torch.tensor([0.1, 1.0, 1.0, 1.0])], dim=1))
        straight_on = nn.functional.pad((state[:, :1] * self.after_s)[:, :, None], (0, 2))
        return straight_on + self.unit * torch.tanh(numbers.view(1, POSES, 3))


@functools.cache
def network() -> Network:
    torch.manual_seed(0)
    return Network().eval()


class TorchPolicy(Policy):
    name = "torch"
    spacing_s = SPACING_S

    def plan(self, observation):
        image = (torch.from_numpy(observation.frames["front"][-1] / np.float32(255)) - MEAN) / STD
        said = [observation.command is way for way in (Command.LEFT, Command.STRAIGHT, Command.RIGHT)]
        state = torch.tensor([[observation.ego.speed_mps, *said]], dtype=torch.float32)
        with torch.inference_mode():
            return network()(image.permute(2, 0, 1)[None], state)[0].numpy()


MANIFEST = f"""version = 1
[policy]
name = "torch"
file = "torch.onnx"
[image]
input = "image"
size_px = [{WIDTH_PX}, {HEIGHT_PX}]
camera = {{ raw = "front" }}
scale = {1 / 255}
mean = [{MEAN}, {MEAN}, {MEAN}]
std = [{STD}, {STD}, {STD}]
[state]
input = "state"
fields = ["speed_mps", "command_left", "command_straight", "command_right"]
[plan]
output = "plan"
first_s = {SPACING_S}
spacing_s = {SPACING_S}
beyond = "hold"
"""


def export(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    example = (torch.zeros(1, 3, HEIGHT_PX, WIDTH_PX), torch.zeros(1, 4))
    names = {"input_names": ["image", "state"], "output_names": ["plan"]}
    torch.onnx.export(network(), example, folder / "torch.onnx", opset_version=17, **names)
    (folder / "torch.toml").write_text(MANIFEST)


if __name__ == "__main__":
    export(Path(sys.argv[1]))
