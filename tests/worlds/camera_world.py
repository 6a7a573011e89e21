"""An independent camera world for the gap diagnosis of frames: writes labelled cases in the practice schema from a seed.

Shares no code with the crates. Scenes are rendered (camera_scene.py: a textured corridor with true depth and ego motion)
or real frames of a data folder (--source, --part tune|report: streams that share no frame). Every frame is made at three
times the size and resampled once at 2 x 2 samples per pixel; nuisances are those of the practice README. Effects are in
camera_effects.py, pairings other than aligned in camera_pairing.py. Needs numpy and pillow only.

    python tests/worlds/camera_world.py --out DIR --seed 1 --singles 58 --none 20 --pairs 12 --unknown 13 \
        [--weak 10] [--stripped 10] [--unseen] [--source DIR --part tune] [--pairing same-layout]
"""

import argparse
import json
import pathlib

import numpy as np
from PIL import Image

from camera_effects import EFFECTS, ORDER, PAIRS, UNKNOWN, UNSEEN, code, edit, jpeg, light, place_of, sample, weakened
from camera_pairing import Generator, other_state, redrawn, relooked, texture_field
from camera_scene import OVER, Real, Rendered, describe, streams


def scene_of(r, need, found):
    """A scene that can show what is needed, and the stream it is of."""
    for _ in range(400):
        if found:
            stream = found[int(r.integers(len(found)))]
            if ("motion" in need and stream["speed"] is None) or ("boxes" in need and not stream["boxes"]) \
                    or ("order" in need and not stream["contiguous"]) or ("colour" in need and not stream["colour"]):
                continue
            scene = Real(r, stream)
        else:
            scene, stream = Rendered(r), None
        if "colour" not in need or scene.colour:
            return scene, stream
    return scene_of(r, need, None)


class Case:
    """One case: the scene, its effects, and what is drawn once."""

    def __init__(self, r, kind, ids, options):
        need = {EFFECTS[i][3] for i in ids if i in EFFECTS}
        self.scene, stream = scene_of(r, need, options["streams"])
        scene = self.scene
        self.frames = [scene.frame(k) for k in range(scene.n)]
        self.colour = self.frames[0][0].shape[2] == 3
        self.effects = [(i, EFFECTS[i][4](r) if i in EFFECTS else UNKNOWN[i](r)) for i in ids]
        if kind == "weak":
            self.effects = [(i, weakened(i, p, r.uniform(0.25, 0.55))) for i, p in self.effects]
        for i, p in self.effects:
            if i == "rain_streaks":
                p["count"] *= scene.w * scene.h / 53248
        lit = np.ones(scene.n)
        if "light" in need or r.random() < 0.3:
            at = int(r.integers(3, max(4, scene.n - 8)))
            lit[at:] = r.choice([0.45, 2.2])
        self.anchors = [0] + list(range(int(r.integers(6, 12)), scene.n, int(r.integers(8, 13))))
        boxes = [b for _, b in self.frames]
        self.state = dict(light=lit, anchors=self.anchors, dropped={}, boxes=boxes, depth=[scene.true_depth(b) for b in boxes])
        self.fixed, self.memory, self.dropped = dict(blobs=[], offsets={}), {}, []
        self.content, self.stamp = np.arange(scene.n), np.zeros(scene.n)
        for i, p in self.effects:
            self.draw_once(r, i, p)
        self.constant, self.gain, self.noise = r.uniform(-0.25, 0.25, 2), 1 + r.uniform(-0.01, 0.01), r.uniform(0.8, 1.6)
        self.pairing = options["pairing"]
        if self.pairing != "aligned":
            other = relooked(scene, r) if self.pairing == "same-layout" else other_state(scene, r, stream)
            self.shown = [other.frame(k)[0] for k in range(scene.n)]
            self.generator = Generator(r)
            self.field = texture_field(r, scene.h + 64, scene.w + 64)

    def draw_once(self, r, i, p):
        n = self.scene.n
        if i == "lens_dirt":
            self.fixed["blobs"] = [(r.uniform(), r.uniform(), r.uniform(0.05, 0.14), p["opacity"] * r.uniform(0.7, 1)) for _ in range(p["blobs"])]
        if i == "object_dropout":
            for k, boxes in enumerate(self.state["boxes"]):
                lost = [b for b in range(len(boxes)) if boxes[b][4] == "car" and r.random() < p["prob"]]
                self.state["dropped"][k] = [boxes[b] for b in lost]
                self.dropped += [[k, b] for b in lost]
        if i in ("obs_latency", "condition_delay"):
            self.content = np.maximum(self.content - p["frames"], 0)
            if i == "obs_latency":
                self.stamp = self.stamp - p["frames"] / self.scene.rate
        if i == "dropped_frames":
            for k in range(1, n):
                if r.random() < p["rate"]:
                    self.content[k] = self.content[k - 1]

    def sim(self, k, r):
        plain = sample(self.frames[k][0], self.scene, lambda x, y: (x, y))
        if self.pairing == "aligned":
            return plain
        shown = sample(self.shown[k], self.scene, lambda x, y: (x, y))
        if isinstance(self.scene, Real):
            shown = redrawn(shown, r, self.field)
        return self.generator(shown, r)

    def real(self, k, r):
        """The frame through the effects, and the one of a twin without."""
        scene, src = self.scene, int(self.content[k])
        shift, g = self.constant + r.uniform(-0.25, 0.25, 2), self.gain * (1 + r.normal(0, 0.003))
        depth = self.state["depth"]
        real = sample(self.frames[src][0], scene, place_of(scene, self.effects, src, shift, depth[src]))
        twin = sample(self.frames[k][0], scene, place_of(scene, [], k, shift, depth[k]))
        grain = r.normal(size=twin.shape) * self.noise
        real = code(light(real) * g)
        for i, p in sorted(self.effects, key=lambda e: ORDER.index(e[0]) if e[0] in ORDER else 9):
            real = edit(real, i, p, scene, k, r, self.fixed, self.memory, self.state)
        return real + grain, code(light(twin) * g) + grain


def make(out, name, seed, kind, ids, options):
    r = np.random.default_rng(seed)
    case = Case(r, kind, ids, options)
    scene, folder = case.scene, out / name
    for s in ("sim", "real"):
        (folder / s).mkdir(parents=True, exist_ok=True)
    held = scene.n - 4
    sums = np.zeros((scene.n, 2, 4, 6))
    for k in range(scene.n):
        saved = []
        sim = case.sim(k, r)
        real, twin = case.real(k, r)
        for s, a, q in (("sim", sim, 95), ("real", real, 92), (None, twin, 92)):
            im = Image.fromarray(np.clip(np.round(a), 0, 255).astype(np.uint8).squeeze())
            if s:
                im.save(folder / s / f"{k:04d}.jpg", quality=q)
            saved.append(jpeg(a, q))
        for d, a in enumerate(saved[1:]):
            e = ((a - saved[0]) ** 2).mean(2)
            sums[k, d] = [[e[i * scene.h // 4:(i + 1) * scene.h // 4, j * scene.w // 6:(j + 1) * scene.w // 6].mean() for j in range(6)] for i in range(4)]
    fit, tiles = sums[:held].mean(0), []
    if kind != "none":
        tiles = [[i, j] for i in range(4) for j in range(6) if fit[0, i, j] - fit[1, i, j] > 0.25 * (fit[1, i, j] + 1)]
    stripped = [s for s in ("depth", "boxes", "motion") if kind == "stripped" and r.random() < 0.6]
    write_tables(folder, case, r, stripped)
    listed = []
    for i, p in case.effects:
        main, unit, group = EFFECTS[i][:3] if i in EFFECTS else (next(iter(p)), "1", "out_of_library")
        listed.append(dict(id=i, params={a: float(b) for a, b in p.items()}, value=float(p[main]), unit=unit, group=group))
    named = {"weak": "single", "stripped": "single"}.get(kind, kind)
    return dict(kind=named, weak=kind == "weak", stripped=stripped, source=scene.source, pairing=case.pairing, effects=listed, tiles=tiles,
                excess=float(fit[0].mean() / fit[1].mean() - 1), dropped_boxes=case.dropped,
                heldout_rmse=dict(before=float(np.sqrt(sums[held:, 0].mean())), floor=float(np.sqrt(sums[held:, 1].mean()))))


def write_tables(folder, case, r, stripped):
    scene, state = case.scene, case.state
    if "depth" not in stripped:
        Image.fromarray(np.clip(scene.proxy * 100, 0, 65535).astype(np.uint16)).save(folder / "depth_proxy.png")
    rows = ["frame,time_s,real_stamp_s,speed_mps,yaw_rate_radps,light_rel"]
    moving = scene.motion and "motion" not in stripped
    for k in range(scene.n):
        t = k / scene.rate
        motion = f"{scene.speed[k]:.2f},{scene.yaw[k]:.4f}" if moving else ","
        rows.append(f"{k},{t:.4f},{t + case.stamp[k] + r.normal(0, 0.0005):.4f},{motion},{state['light'][k]:.3f}")
    (folder / "frames.csv").write_text("\n".join(rows) + "\n")
    has_boxes = any(state["boxes"]) and "boxes" not in stripped
    if has_boxes:
        lines = ["frame,box,x0,y0,x1,y1,class"]
        lines += [f"{k},{i},{b[0]:.1f},{b[1]:.1f},{b[2]:.1f},{b[3]:.1f},{b[4]}" for k, bs in enumerate(state["boxes"]) for i, b in enumerate(bs)]
        (folder / "boxes.csv").write_text("\n".join(lines) + "\n")
    meta = dict(case=folder.name, width=scene.w, height=scene.h, channels="rgb" if case.colour else "grey", frame_rate_hz=scene.rate,
                contiguous=scene.contiguous, intrinsics=dict(fx=scene.f, fy=scene.f, cx=scene.cx, cy=scene.cy), intrinsics_assumed=False,
                camera_height_m=scene.height, sensor_rows=1280, depth_proxy="depth_proxy.png", rollout_anchor_frames=case.anchors,
                has_motion=moving, has_boxes=has_boxes, tiles=[4, 6], frames=[0, scene.n - 1],
                suggested_split=dict(fit=[0, scene.n - 5], held_out=[scene.n - 4, scene.n - 1]))
    if case.pairing != "aligned":
        meta["pairing"] = case.pairing
    (folder / "meta.json").write_text(json.dumps(meta, indent=1))


def plan_of(o):
    names, kinds = list(EFFECTS), [u for u in UNKNOWN if o.unseen or u not in UNSEEN]
    r = np.random.default_rng([o.seed, 77])
    kinds = [kinds[k] for k in r.permutation(len(kinds))]
    plan = [("single", [names[k % len(names)]]) for k in range(o.singles)] + [("none", [])] * o.none
    plan += [("weak", [names[k]]) for k in r.permutation(len(names))[:o.weak]]
    plan += [("stripped", [names[k]]) for k in r.permutation(len(names))[:o.stripped]]
    plan += [("double", list(PAIRS[k])) for k in r.permutation(len(PAIRS))[:o.pairs]]
    return plan + [("out_of_library", [kinds[k % len(kinds)]]) for k in range(o.unknown)]


def main():
    a = argparse.ArgumentParser()
    a.add_argument("--out", required=True)
    a.add_argument("--seed", type=int, required=True)
    for name, count in (("singles", 29), ("none", 8), ("pairs", 6), ("unknown", 8), ("weak", 0), ("stripped", 0)):
        a.add_argument(f"--{name}", type=int, default=count)
    a.add_argument("--source")
    a.add_argument("--part", choices=("tune", "report"), default="tune")
    a.add_argument("--pairing", choices=("aligned", "same-layout", "unpaired"), default="aligned")
    a.add_argument("--unseen", action="store_true", help="kinds out of library that were never drawn for tuning as well")
    o = a.parse_args()
    out = pathlib.Path(o.out)
    found = streams(o.source, o.part) if o.source else None
    if o.source:
        print(describe(found))
    options = dict(streams=found, pairing=o.pairing)
    plan = plan_of(o)
    labels = {}
    for place, k in enumerate(np.random.default_rng(o.seed).permutation(len(plan))):
        name = f"case_{place:03d}"
        labels[name] = make(out, name, [o.seed, int(k)], *plan[k], options)
        (out / "labels.json").write_text(json.dumps(labels, indent=1))


if __name__ == "__main__":
    main()
