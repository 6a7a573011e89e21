"""A vdm-worker in Python: the picture as a camera of `camera_world.py` would have taken it.

Serves the observation source `layout`: the condition image, through that world's own lens and image operators, noise and
gain. One effect, none or two are drawn from a seed and written to a file apart. Needs numpy and pillow.

    dreamstream run SCENARIOS --policy log-replay --observation layout --vehicle-log --out RUN \\
        --stage "video=python tests/worlds/frame_stage.py --seed 5 --answer ANSWER.json"
"""

import argparse
import io
import json
import pathlib
import types
import zlib

import numpy as np
from PIL import Image

import camera_world
from dreamstream import stage

GEOMETRY = ["mount_pitch", "mount_yaw", "mount_roll", "focal_error", "radial_distortion"]
# Those that need no boxes, light or record of motion; of those left, all that a flat picture can show.
DRAWN = GEOMETRY + ["gamma", "white_balance", "vignetting", "sensor_noise", "defocus", "jpeg_loss", "fog_haze",
                    "night_illumination", "lens_dirt"]
GROUP = 2  # index of the group in the table of effects


def draw_effects(r, count):
    """Draws effects of different groups with their parameters."""
    table, drawn = camera_world.EFFECTS, {}
    while len(drawn) < count:
        name = str(r.choice(DRAWN))
        if all(table[name][GROUP] != table[other][GROUP] for other in drawn):
            drawn[name] = {key: float(value) for key, value in table[name][4](r).items()}
    return drawn


def pixels(image):
    """Returns an image message as rows of floats."""
    if image.encoding == 1:
        rows = np.frombuffer(image.data, np.uint8).reshape(image.height_px, image.width_px, 3)
    else:
        rows = np.asarray(Image.open(io.BytesIO(image.data)).convert("RGB"))
    return rows.astype(float)


class Camera:
    """Maker of `frame`."""

    def __init__(self, scene, seed, effects):
        if scene.spec.observation != 4:
            raise stage.Fault("bad_settings", "this camera serves the observation source layout only")
        self.scene, self.seed, self.effects = scene, seed, effects
        r = np.random.default_rng([seed, 1])
        self.gain, self.noise = 1 + r.uniform(-0.01, 0.01), r.uniform(0.8, 1.6)
        self.lenses = [self.lens(camera, r) for camera in scene.scenario.cameras]

    def lens(self, camera, r):
        """Describes a camera as the operators of `camera_world` want it: a flat road below, at most 150 m of depth."""
        inner = camera.intrinsics
        w, h = inner.width_px, inner.height_px
        lens = types.SimpleNamespace(w=w, h=h, f=inner.fx_px, cx=inner.cx_px, cy=inner.cy_px, rate=10.0)
        down = (np.mgrid[0:h, 0:w][0] - inner.cy_px) / inner.fy_px
        height = camera.rig_from_camera.translation_m.z
        lens.true_depth = np.where(down > 1e-3, np.minimum(height / np.maximum(down, 1e-3), 150.0), 150.0)
        blobs = int(self.effects.get("lens_dirt", {}).get("blobs", 0))
        lens.fixed = {"blobs": [(r.random(), r.random(), r.uniform(0.04, 0.12), self.effects["lens_dirt"]["opacity"] * r.uniform(0.7, 1))
                                for _ in range(blobs)]}
        return lens

    def restore(self, order, inputs):
        """Frames have no memory."""

    def work(self, order, inputs):
        for tick in range(order.first_tick, order.last_tick + 1):
            for index, lens in enumerate(self.lenses):
                seen = self.see(pixels(inputs["layout", tick, index].image), lens, tick, index)
                frame = stage.PB["Frame"](seam=0.0)
                frame.image.width_px, frame.image.height_px, frame.image.encoding = lens.w, lens.h, 1
                frame.image.data = np.clip(np.round(seen), 0, 255).astype(np.uint8).tobytes()
                yield "frame", tick, index, tick, frame

    def see(self, a, lens, tick, index):
        spec = self.scene.spec
        r = np.random.default_rng([self.seed, zlib.crc32(spec.scenario.encode()), spec.seed, tick, index])
        bends = [(name, p) for name, p in self.effects.items() if name in GEOMETRY]
        if bends:
            image = Image.fromarray(a.astype(np.uint8)).resize((lens.w * camera_world.OVER, lens.h * camera_world.OVER), Image.BICUBIC)
            a = camera_world.sample(np.asarray(image, float), lens, camera_world.place_of(lens, bends, tick, (0.0, 0.0), lens.true_depth))
        for name in (n for n in camera_world.ORDER if n in self.effects and n not in ("sensor_noise", "jpeg_loss")):
            a = camera_world.edit(a, name, self.effects[name], lens, tick, r, lens.fixed, {}, {"depth": {tick: lens.true_depth}})
        a = camera_world.code(camera_world.light(a) * self.gain * (1 + r.normal(0, 0.003)))
        a = np.clip(a + r.normal(0, self.noise, a.shape), 0, 255)
        for name in (n for n in ("sensor_noise", "jpeg_loss") if n in self.effects):
            a = camera_world.edit(a, name, self.effects[name], lens, tick, r, lens.fixed, {}, {})
        return a


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--kind", choices=["none", "single", "double"], default="single")
    parser.add_argument("--answer", type=pathlib.Path, help="where the withheld effects are written")
    given = parser.parse_args()
    effects = draw_effects(np.random.default_rng([given.seed, 0]), {"none": 0, "single": 1, "double": 2}[given.kind])
    if given.answer:
        told = [{"id": name, "value": p[camera_world.EFFECTS[name][0]], "unit": camera_world.EFFECTS[name][1]} for name, p in effects.items()]
        given.answer.write_text(json.dumps({"service": "video" if told else None, "effects": told, "seed": given.seed}, indent=1))
    stage.serve("video", lambda scene: Camera(scene, given.seed, effects), slots=1, describe="own camera")


if __name__ == "__main__":
    main()
