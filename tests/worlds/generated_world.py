"""Labelled cases of a video model's own frames: injects one effect, or none, into the camera side of effect-free pairs.

The pairs are those of `dreamstream video pairs --over 3`: clips with several generated streams and the reference camera's
frames at three times the size, which are resampled once here. Effects are those of camera_effects.py, which share no code
with the crates; nothing else is changed but for the encoder of the camera (JPEG, quality 92). All clips of a case have the
same effect. A case without effect is one of the pairs; each clip of another is that clip of a pair drawn for it. Needs numpy
and pillow only.

    dreamstream video pairs --over 3 --cases 12 --first-seed SEED -o PAIRS
    python tests/worlds/generated_world.py PAIRS --out CASES --seed SEED --singles 28 --none 12
"""

import argparse
import csv
import json
import os
import pathlib
import shutil

import numpy as np
from PIL import Image

from camera_effects import EFFECTS, ORDER, edit, place_of, sample
from camera_world import Case

# no drive changes the light by itself, so that exposure lag cannot show
KINDS = [name for name in EFFECTS if name != "exposure_lag"]


class Clip:
    """A clip as a scene of camera_scene.py: what effects may know of it."""

    def __init__(self, folder):
        self.folder = folder
        meta = json.loads((folder / "meta.json").read_text())
        self.meta = meta
        self.w, self.h, self.rate = meta["width"], meta["height"], meta["frame_rate_hz"]
        lens = meta["intrinsics"]
        self.f, self.cx, self.cy = lens["fx"], lens["cx"], lens["cy"]
        with open(folder / "frames.csv", newline="") as file:
            self.rows = list(csv.DictReader(file))
        self.numbers = [int(row["frame"]) for row in self.rows]
        self.n = len(self.numbers)
        self.speed = [float(row["speed_mps"]) for row in self.rows]
        self.yaw = [float(row["yaw_rate_radps"]) for row in self.rows]
        self.boxes = {number: [] for number in self.numbers}
        with open(folder / "boxes.csv", newline="") as file:
            for row in csv.DictReader(file):
                edges = [float(row[edge]) for edge in ("x0", "y0", "x1", "y1")]
                self.boxes[int(row["frame"])].append((*edges, row["class"], int(row["box"])))

    def depth(self, k):
        return np.asarray(Image.open(self.folder / "depth" / f"{self.numbers[k]:04d}.png"), np.float32) / 100

    def large(self, k):
        return np.asarray(Image.open(self.folder / "large" / f"{self.numbers[k]:04d}.png").convert("RGB"), np.float32)


class Injected:
    """The camera side of one clip with the effects of its case."""

    draw_once = Case.draw_once

    def __init__(self, r, clip, effects, fixed):
        self.scene, self.effects = clip, effects
        boxes = [clip.boxes[number] for number in clip.numbers]
        self.state = dict(light=np.ones(clip.n), anchors=[-clip.numbers[0]], dropped={}, boxes=boxes)
        self.state["depth"] = [clip.depth(k) for k in range(clip.n)]
        self.fixed, self.memory, self.dropped = dict(fixed, offsets={}), {}, []
        self.content, self.stamp = np.arange(clip.n), np.zeros(clip.n)
        for i, p in effects:
            if i != "lens_dirt":
                self.draw_once(r, i, p)

    def frame(self, k, r):
        clip, src = self.scene, int(self.content[k])
        a = sample(clip.large(src), clip, place_of(clip, self.effects, src, (0.0, 0.0), self.state["depth"][src]))
        for i, p in sorted(self.effects, key=lambda e: ORDER.index(e[0]) if e[0] in ORDER else 9):
            a = edit(a, i, p, clip, k, r, self.fixed, self.memory, self.state)
        return a


def spots(r, effects):
    """The dirt of a lens, which is the same in all clips."""
    dirt = [p for i, p in effects if i == "lens_dirt"]
    return dict(blobs=[(r.uniform(), r.uniform(), r.uniform(0.05, 0.14), p["opacity"] * r.uniform(0.7, 1)) for p in dirt for _ in range(p["blobs"])])


def linked(source, target):
    target.mkdir(parents=True, exist_ok=True)
    for file in source.iterdir():
        try:
            os.link(file, target / file.name)
        except OSError:
            shutil.copyfile(file, target / file.name)


def make(sources, out, seed, ids):
    """A case of the effects; `sources` holds the pairs of each of its clips."""
    r = np.random.default_rng(seed)
    meta = json.loads((sources[0] / "meta.json").read_text())
    effects = [(i, EFFECTS[i][4](r)) for i in ids]
    for i, p in effects:
        if i == "rain_streaks":
            p["count"] *= meta["width"] * meta["height"] / 53248
    fixed = spots(r, effects)
    for source, name in zip(sources, meta["clips"]):
        clip, folder = Clip(source / name), out / name
        for stream in [*clip.meta["seeds"], "depth"]:
            linked(clip.folder / stream, folder / stream)
        (folder / "real").mkdir(exist_ok=True)
        injected = Injected(r, clip, effects, fixed)
        for k, number in enumerate(clip.numbers):
            a = np.clip(np.round(injected.frame(k, r)), 0, 255).astype(np.uint8)
            Image.fromarray(a).save(folder / "real" / f"{number:04d}.jpg", quality=92)
            stamp = float(clip.rows[k]["time_s"]) + injected.stamp[k] + r.normal(0, 0.0005)
            clip.rows[k]["real_stamp_s"] = f"{stamp:.4f}"
        with open(folder / "frames.csv", "w", newline="") as file:
            table = csv.DictWriter(file, list(clip.rows[0]))
            table.writeheader()
            table.writerows(clip.rows)
        shutil.copyfile(clip.folder / "boxes.csv", folder / "boxes.csv")
        shutil.copyfile(clip.folder / "meta.json", folder / "meta.json")
    meta["case"] = out.name
    (out / "meta.json").write_text(json.dumps(meta, indent=1))
    listed = []
    for i, p in effects:
        main, unit, group = EFFECTS[i][:3]
        listed.append(dict(id=i, params={a: float(b) for a, b in p.items()}, value=float(p[main]), unit=unit, group=group))
    return dict(kind="single" if ids else "none", effects=listed)


def main():
    a = argparse.ArgumentParser()
    a.add_argument("pairs", type=pathlib.Path)
    a.add_argument("--out", type=pathlib.Path, required=True)
    a.add_argument("--seed", type=int, required=True)
    a.add_argument("--singles", type=int, default=28)
    a.add_argument("--none", type=int, default=12)
    a.add_argument("--kinds", default=",".join(KINDS), help="effects that are injected in turn")
    o = a.parse_args()
    kinds = o.kinds.split(",")
    plan = [[kinds[k % len(kinds)]] for k in range(o.singles)] + [[]] * o.none
    pairs = sorted(path.parent for path in o.pairs.glob("*/meta.json"))
    if len(pairs) < max(o.none, 1):
        raise SystemExit(f"{o.none} cases without effect need as many pairs; {o.pairs} has {len(pairs)}")
    clips = len(json.loads((pairs[0] / "meta.json").read_text())["clips"])
    r = np.random.default_rng(o.seed)
    labels = {}
    for place, k in enumerate(r.permutation(len(plan))):
        name = f"case_{place:03d}"
        picked = [int(r.integers(len(pairs))) if plan[k] else int(k) - o.singles for _ in range(clips)]
        labels[name] = make([pairs[p] for p in picked], o.out / name, [o.seed, int(k)], plan[k])
        (o.out / "labels.json").write_text(json.dumps(labels, indent=1))


if __name__ == "__main__":
    main()
