"""Pairings of the camera world other than `aligned`: what the simulator shows is generated.

`same-layout`: the states of the real frames, other texture: a rendered scene with other looks, or a real frame whose
fine detail is redrawn; then the gap of the generator itself (softer, other tone, a slow wobble, its own noise).
`unpaired`: the same, of other states of the same kind of road. The gap belongs to the generator: its mean is fixed, a case
varies a little about it. Needs numpy and pillow only.
"""

import copy

import numpy as np

from camera_effects import blur_disc, box_blur, code, light, shifted
from camera_scene import Real, Rendered, noise, smooth_field


class Generator:
    """The gap of the generator in one case."""

    def __init__(self, r):
        self.soft = abs(r.normal(0.75, 0.08))
        self.tone = r.normal(1.06, 0.02)
        self.gain = 1 + r.normal([0.03, 0.0, -0.02], 0.012)
        self.wobble = abs(r.normal(0.35, 0.08))
        self.grain = abs(r.normal(0.5, 0.15))
        self.detail = r.normal(0.85, 0.05)

    def __call__(self, a, r):
        h, w, c = a.shape
        a = code(blur_disc(light(a), self.soft))
        dx, dy = self.wobble * r.normal(size=2)
        a = shifted(a, dx, dy)
        a = 255 * np.clip(a / 255, 0, 1) ** self.tone * (self.gain[:c] if c == 3 else 1.0)
        mean = box_blur(a, 6)
        a = mean + self.detail * (a - mean)
        return np.clip(a + r.normal(size=a.shape) * self.grain, 0, 255).astype(np.float32)


def redrawn(a, r, field):
    """A frame whose edges stay while the detail below a contrast is another one of the same strength."""
    wide = box_blur(a, 4)
    detail = a - wide
    strong = 1 / (1 + (np.abs(detail) / 16) ** 4)
    size = np.sqrt(box_blur((detail * strong) ** 2, 4))
    h, w, _ = a.shape
    x, y = int(r.integers(0, field.shape[1] - w)), int(r.integers(0, field.shape[0] - h))
    other = field[y:y + h, x:x + w, None]
    return np.clip(wide + detail * (1 - strong) + size * other, 0, 255).astype(np.float32)


def texture_field(r, h, w):
    out = np.tile(noise(r, 512, 0.95), (h // 512 + 2, w // 512 + 2))
    out = out - box_blur(out[..., None], 4)[..., 0]
    return out / out.std()


def other_state(scene, r, stream):
    """The scene that an unpaired simulator shows: the same camera at another place and time."""
    if isinstance(scene, Rendered):
        other = copy.copy(scene)
        other.speed, other.yaw = scene.speed[::-1].copy(), -scene.yaw[::-1]
        other.cars = [dict(c, z=c["z"] + r.uniform(5, 50), x=-c["x"]) for c in scene.cars]
        other.windows = [(r.integers(0, 452, 2), hh, ww, tone) for _, hh, ww, tone in scene.windows]
        other.textures(r)
        return other
    other = copy.copy(scene)
    free = [f for f in stream["files"] if f not in set(scene.files)]
    start = int(r.integers(max(len(free) - scene.n + 1, 1)))
    files = free[start:start + scene.n]
    other.files = (files * (scene.n // max(len(files), 1) + 1))[:scene.n]
    return other


def relooked(scene, r):
    """The same scene with other textures, where it is rendered."""
    if isinstance(scene, Real):
        return scene
    other = copy.copy(scene)
    other.windows = [(r.integers(0, 452, 2), hh, ww, tone) for _, hh, ww, tone in scene.windows]
    other.tints = np.clip(scene.tints * r.uniform(0.97, 1.03, scene.tints.shape), 0, 1.3)
    other.textures(r)
    return other
