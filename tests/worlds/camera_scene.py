"""Scenes of the camera world: a rendered corridor with its own textures, cars and motion, or real frames of a folder.

A scene gives, for frame k, a picture at OVER times the size in encoded values (float32, h x w x c), the layout boxes in
px, and the depth that effects act by. What the simulator is told (`proxy`) is a bare corridor; the true depth differs
from it by 12 % of low frequency and by all objects. Needs numpy and pillow only.
"""

import json
import pathlib

import numpy as np
from PIL import Image

OVER = 3
FARTHEST = 150.0


def smooth_field(r, h, w, knots):
    grid = r.normal(size=(knots, knots + 2)).astype(np.float32)
    return np.asarray(Image.fromarray(grid).resize((w, h), Image.BICUBIC), np.float32)


def noise(r, size, rough):
    out = np.zeros((size, size), np.float32)
    for k in range(3, 10):
        n = 2 ** k
        if n > size:
            break
        g = r.normal(size=(n, n)).astype(np.float32)
        out += np.asarray(Image.fromarray(g).resize((size, size), Image.BICUBIC), np.float32) * rough ** (9 - k) / 4
    return out


class Scene:
    """What both kinds of scene share: camera, corridor, motion, light."""

    SIZES = [(416, 128), (416, 128), (320, 240), (512, 160), (400, 300), (352, 176)]

    def camera(self, r, size, focal_share):
        self.w, self.h = size
        self.f = focal_share * self.w
        self.cx, self.cy = self.w / 2 + r.uniform(-6, 6), self.h * r.uniform(0.44, 0.5)
        self.height = r.uniform(1.4, 1.7)
        self.walls = (r.uniform(5, 9), r.uniform(5, 9))

    def depth(self, over=1):
        y, x = np.mgrid[0:self.h * over, 0:self.w * over].astype(np.float32)
        u = ((x + 0.5) / over - 0.5 - self.cx) / self.f
        v = ((y + 0.5) / over - 0.5 - self.cy) / self.f
        with np.errstate(divide="ignore"):
            ground = np.where(v > 1e-4, self.height / np.maximum(v, 1e-4), FARTHEST)
            left = np.where(u < -1e-4, self.walls[0] / np.maximum(-u, 1e-4), FARTHEST)
            right = np.where(u > 1e-4, self.walls[1] / np.maximum(u, 1e-4), FARTHEST)
        return u, v, ground, left, right

    def settle_depth(self, r):
        _, _, ground, left, right = self.depth()
        self.proxy = np.minimum(np.minimum(np.minimum(ground, left), right), FARTHEST)
        self.wobble = np.clip(1 + 0.12 * smooth_field(r, self.h, self.w, 3), 0.6, 1.5)

    def true_depth(self, boxes):
        d = self.proxy * self.wobble
        for x0, y0, x1, y1, *_ in boxes:
            x0, y0, x1, y1 = (int(max(v, 0)) for v in (x0, y0, x1, y1))
            foot = np.clip((min(y1, self.h - 1) - self.cy) / self.f, 0.01, None)
            d[y0:y1, x0:x1] = np.minimum(d[y0:y1, x0:x1], self.height / foot)
        return d


class Rendered(Scene):
    """A corridor with textured planes, windows, a road with markings, cars, trees and sky."""

    source = "rendered"

    def __init__(self, r, looks=None):
        self.colour = r.random() < 0.5
        size = self.SIZES[int(r.integers(len(self.SIZES)))]
        self.camera(r, size, r.uniform(0.85, 1.05) * (0.95 if size[0] / size[1] < 1.5 else 0.72))
        self.n = int(r.integers(14, 24))
        self.rate = 10.0
        self.contiguous = True
        self.speed = np.clip(r.uniform(5, 13) + np.cumsum(r.normal(0, 0.08, self.n)), 1, 20)
        self.yaw = np.cumsum(r.normal(0, 0.012, self.n)) + r.uniform(-0.06, 0.06)
        self.motion = True
        self.cars = [dict(z=r.uniform(6, 60), x=r.choice([-1, 1]) * r.uniform(1.6, 3.6), w=r.uniform(1.5, 2.0), h=r.uniform(1.3, 1.8),
                          v=r.uniform(-4, 12), tone=r.uniform(20, 230), t=r.uniform(0.6, 1.3, 3)) for _ in range(7)]
        self.windows = [(r.integers(0, 452, 2), r.integers(12, 60), r.integers(8, 50), r.uniform(15, 240)) for _ in range(60)]
        self.trees = [(r.integers(0, 492), r.integers(3, 18), r.uniform(0.3, 1.5)) for _ in range(40)]
        self.tints = r.uniform(0.75, 1.2, (3, 3)) if self.colour else np.ones((3, 1))
        self.textures(looks or r)
        self.settle_depth(r)

    def textures(self, r):
        size = 512
        road = 95 + 22 * noise(r, size, 0.75)
        road[:, 250:258] = 215
        wall = 130 + 35 * noise(r, size, 0.7)
        for (y, x), h, w, tone in self.windows:
            wall[y:y + h, x:x + w] = tone
        other = 110 + 45 * noise(r, size, 0.85)
        for x, w, gain in self.trees:
            other[:, x:x + w] *= gain
        self.planes = [np.clip(t, 4, 250).astype(np.float32) for t in (road, wall, other)]

    def layer(self, boxes, s, k):
        """Cars in px of the big picture, far ones first."""
        for number, car in sorted(enumerate(self.cars), key=lambda c: -c[1]["z"]):
            z = car["z"] + (car["v"] * k / self.rate - s)
            z = 4 + (z - 4) % 60
            x0, x1 = ((car["x"] + e * car["w"] / 2) / z * self.f + self.cx for e in (-1, 1))
            y0, y1 = ((self.height - e) / z * self.f + self.cy for e in (car["h"], 0))
            X0, X1, Y0, Y1 = (int(round(t * OVER)) for t in (x0, x1, y0, y1))
            X0, X1, Y0, Y1 = max(X0, 0), min(X1, self.w * OVER), max(Y0, 0), min(Y1, self.h * OVER)
            if X1 - X0 >= 15 and Y1 - Y0 >= 15:
                boxes.append((X0 / OVER, Y0 / OVER, X1 / OVER, Y1 / OVER, "car", number))
                yield car, X0, Y0, X1, Y1

    def frame(self, k):
        u, v, ground, left, right = self.depth(OVER)
        s = float(np.sum(self.speed[:k]) / self.rate)
        u = u - float(np.sum(self.yaw[:k]) / self.rate) * 0.3
        d = np.minimum(np.minimum(ground, left), right)
        size = 512
        out = np.zeros(d.shape + (self.tints.shape[1],), np.float32)
        sky = 235 - 40 * np.clip(-v * 2, 0, 1)
        far = np.clip(d / 40, 0, 1)
        for plane, (mask, a, b) in enumerate([
            ((ground <= left) & (ground <= right), u * ground * 24 + 254, (ground + s) * 14),
            ((left < ground) & (left <= right), (left + s) * 16, v * left * 40 + 300),
            ((right < ground) & (right < left), (right + s) * 16, v * right * 40 + 300),
        ]):
            tex = self.planes[plane]
            value = tex[b[mask].astype(int) % size, a[mask].astype(int) % size] * (1 - far[mask]) + tex.mean() * far[mask]
            above = (((plane > 0) & (-v * d > 6.5 + 1.5 * np.sin((d + s) / 7.0))) | (d > 149))[mask]
            value = np.where(above, sky[mask], value)
            for c in range(out.shape[2]):
                out[..., c][mask] = value * np.where(above, 1.0, self.tints[plane, c])
        boxes = []
        for car, x0, y0, x1, y1 in self.layer(boxes, s, k):
            for c in range(out.shape[2]):
                out[y0:y1, x0:x1, c] = min(250, car["tone"] * car["t"][c])
                out[y0 + (y1 - y0) // 6:y0 + (y1 - y0) // 2, x0 + (x1 - x0) // 8:x1 - (x1 - x0) // 8, c] = 35
                out[y1 - (y1 - y0) // 6:y1, x0:x1, c] = 18
        return np.clip(out, 0, 255), boxes


class Real(Scene):
    """Frames of a stream of real pictures (see `streams`), cropped and resized."""

    def __init__(self, r, stream):
        self.source = stream["name"]
        self.colour = stream["colour"]
        self.contiguous, self.rate = stream["contiguous"], stream["rate"]
        files = stream["files"]
        self.n = min(int(r.integers(14, 26)), len(files))
        start = int(r.integers(len(files) - self.n + 1))
        self.files = files[start:start + self.n]
        W, H = Image.open(self.files[0]).size
        sizes = [s for s in self.SIZES if abs(np.log(s[0] / s[1] / (W / H))) < 0.75] or self.SIZES[2:3]
        size = sizes[int(r.integers(len(sizes)))]
        want = size[0] / size[1]
        share = r.uniform(0.82, 1.0)
        self.crop_w, self.crop_h = share * min(W, H * want), share * min(H, W / want)
        self.left, self.top = (W - self.crop_w) * r.uniform(0.2, 0.8), (H - self.crop_h) * r.uniform(0.3, 0.8)
        self.camera(r, size, stream["focal"] / self.crop_w)
        scale = size[0] / self.crop_w
        self.cx, self.cy = (stream["centre"][0] - self.left) * scale, (stream["centre"][1] - self.top) * scale
        self.motion = stream["speed"] is not None
        self.speed = stream["speed"][start:start + self.n] if self.motion else np.zeros(self.n)
        self.yaw = stream["yaw"][start:start + self.n] if self.motion else np.zeros(self.n)
        self.boxes = stream["boxes"]
        self.settle_depth(r)

    def frame(self, k):
        im = Image.open(self.files[k]).convert("RGB" if self.colour else "L")
        box = (self.left, self.top, self.left + self.crop_w, self.top + self.crop_h)
        a = np.asarray(im.resize((self.w * OVER, self.h * OVER), Image.BICUBIC, box=box), np.float32)
        boxes = []
        if self.boxes:
            s = self.w / self.crop_w
            for number, (x0, y0, x1, y1, name) in enumerate(self.boxes(self.files[k])):
                b = [(x0 - self.left) * s, (y0 - self.top) * s, (x1 - self.left) * s, (y1 - self.top) * s]
                b = [max(b[0], 0), max(b[1], 0), min(b[2], self.w), min(b[3], self.h)]
                if b[2] - b[0] >= 8 and b[3] - b[1] >= 8:
                    boxes.append((*b, name, number))
        return (a if a.ndim == 3 else a[:, :, None]), boxes


def labelled_boxes(path):
    """Boxes of connected regions of cars, pedestrians and cyclists in a class picture, on a grid of 4 px."""
    path = pathlib.Path(path)
    label = np.asarray(Image.open(path.parent.parent / "labels" / (path.stem + ".png")))[::4, ::4]
    out = []
    for code, name in ((8, "car"), (9, "pedestrian"), (10, "cyclist")):
        left = label == code
        while left.any():
            y, x = np.argwhere(left)[0]
            stack, cells = [(y, x)], []
            left[y, x] = False
            while stack:
                y, x = stack.pop()
                cells.append((y, x))
                for j, i in ((y + 1, x), (y - 1, x), (y, x + 1), (y, x - 1)):
                    if 0 <= j < left.shape[0] and 0 <= i < left.shape[1] and left[j, i]:
                        left[j, i] = False
                        stack.append((j, i))
            if len(cells) >= 20:
                c = np.array(cells)
                (y0, x0), (y1, x1) = c.min(0), c.max(0) + 1
                out.append((4.0 * x0, 4.0 * y0, 4.0 * x1, 4.0 * y1, name))
    return out


def streams(root, part):
    """Real streams under a data folder; `part` is `tune` or `report`, which share no frame."""
    root, found = pathlib.Path(root), []

    def add(name, files, focal, centre, rate, colour, speed=None, yaw=None, contiguous=True, boxes=None):
        if len(files) >= 8:
            found.append(dict(name=name, files=files, focal=focal, centre=centre, rate=rate, colour=colour, speed=speed, yaw=yaw,
                              contiguous=contiguous, boxes=boxes))

    grey = sorted((root / "kitti-raw-grey-1392x512" / "image_00").glob("*.jpg"))
    rows = [line.split() for line in (root / "kitti-raw-grey-1392x512" / "oxts_100Hz_sparse.txt").read_text().splitlines()] if grey else []
    if rows:
        at = np.array([float(x[0]) for x in rows]) / 10.33
        number = np.array([float(p.stem) for p in grey])
        speed, yaw = np.interp(number, at, [float(x[9]) for x in rows]), np.interp(number, at, [float(x[20]) for x in rows])
        cut = slice(0, 130) if part == "tune" else slice(140, None)
        add("kitti-grey", grey[cut], 984.2, (690.0, 233.2), 9.679, False, speed[cut], yaw[cut])
    if part == "tune":
        day = sorted((root / "camvid" / "images").glob("0006R0*.jpg"))
        add("camvid-day", day, 461.0, (240.0, 175.0), 1.0, True, contiguous=False, boxes=labelled_boxes)
        return found
    dusk = sorted((root / "camvid" / "images").glob("0001TP*.jpg"))
    add("camvid-dusk", dusk, 461.0, (240.0, 175.0), 1.0, True, contiguous=False, boxes=labelled_boxes)
    colour = sorted((root / "kitti-raw-colour-1242x375" / "image_02").glob("*.jpg"))
    add("kitti-colour", colour, 721.5, (609.6, 172.9), 10.0, True)
    odometry = sorted((root / "kitti-odometry-51" / "image_l").glob("*.jpg"))
    if odometry:
        poses = np.array([[float(v) for v in line.split()] for line in (root / "kitti-odometry-51" / "poses.txt").read_text().splitlines()])
        place, ahead = poses[:, [3, 7, 11]], poses[:, [2, 10]]
        step = np.linalg.norm(np.diff(place, axis=0), axis=1) * 10
        turn = -np.diff(np.unwrap(np.arctan2(ahead[:, 0], ahead[:, 1]))) * 10
        add("kitti-odometry", odometry, 707.1, (601.9, 183.1), 10.0, False, np.append(step, step[-1]), np.append(turn, turn[-1]))
    return found


def describe(found):
    return json.dumps({s["name"]: len(s["files"]) for s in found})
