"""An independent camera world for the gap diagnosis of frames: writes labelled cases in the practice schema from a seed.

Shares no code with the crates. Scenes are either rendered here (a textured corridor: road with markings, walls with
windows, boxes, trees and sky, with true depth and ego motion) or real frames given with --source. Every frame is made
at three times the size and resampled once at 2 x 2 samples per pixel; nuisances are those of the practice README.
Needs numpy and pillow only.

    python tests/worlds/camera_world.py --out DIR --seed 1 --singles 46 --none 16 --pairs 10 --unknown 16 [--source DIR]
"""

import argparse
import io
import json
import pathlib

import numpy as np
from PIL import Image

OVER = 3


def side(r):
    return 1 if r.random() < 0.5 else -1


# id: (main parameter, unit, group, what it needs, draw of parameters)
EFFECTS = {
    "mount_pitch": ("deg", "deg", "mount_vertical", "", lambda r: dict(deg=side(r) * r.uniform(0.3, 1.5))),
    "mount_yaw": ("deg", "deg", "mount_horizontal", "", lambda r: dict(deg=side(r) * r.uniform(0.3, 1.5))),
    "mount_roll": ("deg", "deg", "mount_roll", "", lambda r: dict(deg=side(r) * r.uniform(0.4, 1.8))),
    "focal_error": ("rel", "1", "radial", "", lambda r: dict(rel=side(r) * r.uniform(0.012, 0.05))),
    "radial_distortion": ("k1", "1", "radial", "", lambda r: dict(k1=side(r) * r.uniform(0.04, 0.16))),
    "rolling_shutter": ("line_us", "us", "rolling", "motion", lambda r: dict(line_us=r.uniform(15, 40))),
    "motion_blur": ("shutter_ms", "ms", "sharpness", "motion", lambda r: dict(shutter_ms=r.uniform(10, 28))),
    "exposure_lag": ("tau", "s", "brightness_time", "light", lambda r: dict(tau=r.uniform(0.2, 0.8))),
    "gamma": ("exponent", "1", "tone", "", lambda r: dict(exponent=r.choice([r.uniform(0.75, 0.92), r.uniform(1.1, 1.35)]))),
    "white_balance": ("red", "1", "colour", "colour", lambda r: dict(red=side(r) * r.uniform(0.05, 0.15), blue=side(r) * r.uniform(0.05, 0.15))),
    "vignetting": ("loss", "1", "shading", "", lambda r: dict(loss=r.uniform(0.2, 0.5), power=r.uniform(2, 3.5))),
    "sensor_noise": ("read", "levels", "noise", "", lambda r: dict(read=r.uniform(3, 7), shot=r.uniform(0, 5))),
    "fog_haze": ("beta", "1/m", "veil", "", lambda r: dict(beta=r.uniform(0.004, 0.02), air=r.uniform(0.6, 0.9))),
    "rain_streaks": ("count", "1", "rain", "", lambda r: dict(count=r.uniform(80, 300), strength=r.uniform(20, 50))),
    "lens_dirt": ("opacity", "1", "dirt", "", lambda r: dict(opacity=r.uniform(0.4, 0.8), blobs=int(r.integers(4, 12)))),
    "night_illumination": ("ambient", "x", "night", "", lambda r: dict(ambient=r.uniform(0.15, 0.5), headlamp=r.uniform(0.3, 0.9))),
    "defocus": ("radius", "px", "sharpness", "", lambda r: dict(radius=r.uniform(0.9, 2.5))),
    "jpeg_loss": ("quality", "1", "encoder", "", lambda r: dict(quality=float(r.integers(18, 55)))),
    "obs_latency": ("frames", "frames", "age", "order", lambda r: dict(frames=int(r.integers(1, 4)))),
    "condition_delay": ("frames", "frames", "age", "order", lambda r: dict(frames=int(r.integers(1, 4)))),
    "dropped_frames": ("rate", "1", "drops", "order", lambda r: dict(rate=r.uniform(0.12, 0.35))),
    "temporal_flicker": ("sd", "ln", "brightness_time", "order", lambda r: dict(sd=r.uniform(0.04, 0.12))),
    "texture_washing": ("share", "1", "sharpness", "", lambda r: dict(share=r.uniform(0.5, 0.95))),
    "object_dropout": ("prob", "1", "objects", "boxes", lambda r: dict(prob=r.uniform(0.3, 0.7))),
    "rollout_drift": ("per_100", "1 per 100 frames", "rollout", "order", lambda r: dict(per_100=r.uniform(1.2, 3.0))),
}
PAIRS = [("mount_roll", "vignetting"), ("mount_yaw", "gamma"), ("fog_haze", "defocus"), ("mount_pitch", "sensor_noise"),
         ("focal_error", "jpeg_loss"), ("white_balance", "mount_yaw"), ("exposure_lag", "mount_roll"), ("lens_dirt", "mount_pitch"),
         ("condition_delay", "gamma"), ("vignetting", "defocus"), ("motion_blur", "gamma"), ("night_illumination", "mount_roll")]
UNKNOWN = ["x_stripes", "x_ghost", "x_chromatic", "x_posterise", "x_sharpen", "x_tear", "x_glare", "x_interlace", "x_bloom", "x_blend"]


def light(v):
    return np.clip(v / 255.0, 0, None) ** 2.2


def code(l):
    return 255.0 * np.clip(l, 0, None) ** (1 / 2.2)


def smooth_field(r, h, w, knots):
    grid = r.normal(size=(knots, knots + 2)).astype(np.float32)
    return np.asarray(Image.fromarray(grid).resize((w, h), Image.BICUBIC), float)


class Scene:
    """A corridor with textured planes, or a folder of real frames."""

    def __init__(self, r, source):
        self.colour = r.random() < 0.5
        tall = r.random() < 0.35
        self.w, self.h = (320, 240) if tall else (416, 128)
        self.f = r.uniform(0.85, 1.05) * self.w * (0.95 if tall else 0.72)
        self.cx, self.cy = self.w / 2 + r.uniform(-6, 6), self.h * r.uniform(0.44, 0.5)
        self.height = r.uniform(1.4, 1.7)
        self.n = int(r.integers(16, 28))
        self.rate = 10.0
        self.speed = np.clip(r.uniform(5, 13) + np.cumsum(r.normal(0, 0.08, self.n)), 1, 20)
        self.yaw = np.cumsum(r.normal(0, 0.012, self.n)) + r.uniform(-0.06, 0.06)
        self.walls = (r.uniform(5, 9), r.uniform(5, 9))
        self.source = self.choose(r, source)
        self.motion = self.source is None
        if self.source is None:
            self.textures(r)
        self.wobble = 1 + 0.12 * smooth_field(r, self.h, self.w, 3)

    def choose(self, r, source):
        if source is None or r.random() < 0.3:
            return None
        folders = sorted({p.parent for p in pathlib.Path(source).rglob("*.jpg") if "gap-camera" not in str(p)})
        folders = [f for f in folders if f.name in ("image_00", "image_02", "image_l")]
        files = sorted(folders[int(r.integers(len(folders)))].glob("*.jpg"))
        self.n = min(self.n, len(files) // 2)
        start = int(r.integers(len(files) - self.n))
        return files[start:start + self.n]

    def textures(self, r):
        def noise(size, rough):
            out = np.zeros((size, size))
            for k in range(3, 10):
                n = 2 ** k
                if n > size:
                    break
                g = r.normal(size=(n, n)).astype(np.float32)
                out += np.asarray(Image.fromarray(g).resize((size, size), Image.BICUBIC), float) * rough ** (9 - k) / 4
            return out

        size = 512
        road = 95 + 22 * noise(size, 0.75)
        road[:, 250:258] = 215
        wall = 130 + 35 * noise(size, 0.7)
        for _ in range(60):
            y, x = r.integers(0, size - 60, 2)
            wall[y:y + r.integers(12, 60), x:x + r.integers(8, 50)] = r.uniform(15, 240)
        other = 110 + 45 * noise(size, 0.85)
        for _ in range(40):
            x = r.integers(0, size - 20)
            other[:, x:x + r.integers(3, 18)] *= r.uniform(0.3, 1.5)
        self.planes = [np.clip(t, 4, 250) for t in (road, wall, other)]
        self.tints = r.uniform(0.75, 1.2, (3, 3)) if self.colour else np.ones((3, 1))
        self.cars = [dict(z=r.uniform(6, 60), x=r.choice([-1, 1]) * r.uniform(1.6, 3.6), w=r.uniform(1.5, 2.0), h=r.uniform(1.3, 1.8),
                          v=r.uniform(-4, 12), tone=r.uniform(20, 230), t=r.uniform(0.6, 1.3, 3)) for _ in range(7)]

    def depth(self, over=1):
        y, x = np.mgrid[0:self.h * over, 0:self.w * over]
        u = ((x + 0.5) / over - 0.5 - self.cx) / self.f
        v = ((y + 0.5) / over - 0.5 - self.cy) / self.f
        with np.errstate(divide="ignore"):
            ground = np.where(v > 1e-4, self.height / np.maximum(v, 1e-4), 150.0)
            left = np.where(u < -1e-4, self.walls[0] / np.maximum(-u, 1e-4), 150.0)
            right = np.where(u > 1e-4, self.walls[1] / np.maximum(u, 1e-4), 150.0)
        return u, v, ground, left, right

    def frame(self, k):
        """The frame in encoded values at OVER times the size, and boxes in px."""
        if self.source is not None:
            im = Image.open(self.source[k])
            im = im.convert("RGB" if self.colour and im.mode == "RGB" else "L")
            W, H = im.size
            want = self.w / self.h
            cw, ch = (min(W, int(H * want)), min(H, int(W / want)))
            left, top = (W - cw) // 2, int((H - ch) * 0.6)
            im = im.crop((left, top, left + cw, top + ch)).resize((self.w * OVER, self.h * OVER), Image.LANCZOS)
            a = np.asarray(im, float)
            return (a if a.ndim == 3 else a[:, :, None]), []
        u, v, ground, left, right = self.depth(OVER)
        s = float(np.sum(self.speed[:k]) / self.rate)
        heading = float(np.sum(self.yaw[:k]) / self.rate) * 0.3
        u = u - heading
        d = np.minimum(np.minimum(ground, left), right)
        size = 512
        out = np.zeros(d.shape + (self.tints.shape[1],))
        sky = 235 - 40 * np.clip(-v * 2, 0, 1)
        for plane, (mask, a, b) in enumerate([
            ((ground <= left) & (ground <= right), u * ground * 24 + 254, (ground + s) * 14),
            ((left < ground) & (left <= right), (left + s) * 16, v * left * 40 + 300),
            ((right < ground) & (right < left), (right + s) * 16, v * right * 40 + 300),
        ]):
            tex = self.planes[plane]
            far = np.clip(d / 40, 0, 1)
            value = tex[b.astype(int) % size, a.astype(int) % size] * (1 - far) + tex.mean() * far
            top = (plane > 0) & (-v * d > 6.5 + 1.5 * np.sin((d + s) / 7.0))
            value = np.where(top | (d > 149), sky, value)
            for c in range(out.shape[2]):
                out[..., c] = np.where(mask, value * np.where(top | (d > 149), 1.0, self.tints[plane, c]), out[..., c])
        boxes = []
        for car in sorted(self.cars, key=lambda c: -c["z"]):
            z = car["z"] + (car["v"] * k / self.rate - s)
            z = 4 + (z - 4) % 60
            x0, x1 = ((car["x"] + e * car["w"] / 2) / z * self.f + self.cx for e in (-1, 1))
            y0, y1 = ((self.height - e) / z * self.f + self.cy for e in (car["h"], 0))
            X0, X1, Y0, Y1 = (int(round(t * OVER)) for t in (x0, x1, y0, y1))
            X0, X1, Y0, Y1 = max(X0, 0), min(X1, self.w * OVER), max(Y0, 0), min(Y1, self.h * OVER)
            if X1 - X0 < 15 or Y1 - Y0 < 15:
                continue
            for c in range(out.shape[2]):
                tone = min(250, car["tone"] * car["t"][c])
                out[Y0:Y1, X0:X1, c] = tone
                out[Y0 + (Y1 - Y0) // 6:Y0 + (Y1 - Y0) // 2, X0 + (X1 - X0) // 8:X1 - (X1 - X0) // 8, c] = 35
                out[Y1 - (Y1 - Y0) // 6:Y1, X0:X1, c] = 18
            boxes.append((X0 / OVER, Y0 / OVER, X1 / OVER, Y1 / OVER))
        return np.clip(out, 0, 255), boxes


def sample(big, scene, place):
    """Resamples at the places (u, v) px of the small picture, 2 x 2 samples a pixel, bilinear in the big one."""
    h, w, _ = big.shape
    y, x = np.mgrid[0:scene.h, 0:scene.w].astype(float)
    total = 0
    for ox in (-0.25, 0.25):
        for oy in (-0.25, 0.25):
            u, v = place(x + ox, y + oy)
            bu, bv = np.clip((u + 0.5) * OVER - 0.5, 0, w - 1.001), np.clip((v + 0.5) * OVER - 0.5, 0, h - 1.001)
            i, j = bu.astype(int), bv.astype(int)
            a, b = (bu - i)[..., None], (bv - j)[..., None]
            total = total + (1 - b) * ((1 - a) * big[j, i] + a * big[j, i + 1]) + b * ((1 - a) * big[j + 1, i] + a * big[j + 1, i + 1])
    return total / 4


def flow(scene, k, x, y):
    """Image motion of the static corridor, px/s."""
    u, v = (x - scene.cx) / scene.f, (y - scene.cy) / scene.f
    z = np.minimum(np.minimum(np.where(v > 1e-4, scene.height / np.maximum(v, 1e-4), 150),
                              np.where(u < 0, scene.walls[0] / np.maximum(-u, 1e-4), scene.walls[1] / np.maximum(u, 1e-4))), 150)
    z = z * np.asarray(scene.wobble)[np.clip(y.astype(int), 0, scene.h - 1), np.clip(x.astype(int), 0, scene.w - 1)]
    close, turn = scene.speed[k] / z, scene.yaw[k]
    return scene.f * (u * close + turn * (1 + u * u)), scene.f * (v * close + turn * u * v)


def place_of(scene, effects, k, shift):
    def place(x, y):
        x, y = x + shift[0], y + shift[1]
        for name, p in effects:
            u, v = (x - scene.cx) / scene.f, (y - scene.cy) / scene.f
            if name == "mount_yaw":
                s, c = np.sin(np.radians(p["deg"])), np.cos(np.radians(p["deg"]))
                u, v = (u * c - s) / (c + u * s), v / (c + u * s)
            elif name == "mount_pitch":
                s, c = np.sin(np.radians(p["deg"])), np.cos(np.radians(p["deg"]))
                u, v = u / (c - v * s), (v * c + s) / (c - v * s)
            elif name == "mount_roll":
                s, c = np.sin(np.radians(p["deg"])), np.cos(np.radians(p["deg"]))
                u, v = u * c - v * s, u * s + v * c
            elif name == "focal_error":
                u, v = u / (1 + p["rel"]), v / (1 + p["rel"])
            elif name == "radial_distortion":
                rd = np.hypot(u, v)
                ru = rd.copy()
                for _ in range(20):
                    ru = ru - (ru * (1 + p["k1"] * ru ** 2) - rd) / (1 + 3 * p["k1"] * ru ** 2)
                q = np.where(rd > 1e-9, ru / np.maximum(rd, 1e-9), 1)
                u, v = u * q, v * q
            elif name == "rolling_shutter":
                fx, fy = flow(scene, k, x, y)
                late = p["line_us"] * 1e-6 * 1280 * ((y + 0.5) / scene.h - 0.5)
                u, v = u - fx * late / scene.f, v - fy * late / scene.f
            elif name == "x_tear" and k % 3 == 1:
                u = np.where(y > p["row"] * scene.h, u + p["jump"] / scene.f, u)
            x, y = u * scene.f + scene.cx, v * scene.f + scene.cy
        return x, y
    return place


def shifted(a, dx, dy):
    i, j = int(np.floor(dx)), int(np.floor(dy))
    fx, fy = dx - i, dy - j
    pad = 40
    p = np.pad(a, ((pad, pad), (pad, pad), (0, 0)), "edge")
    h, w = a.shape[:2]
    def g(ii, jj):
        return p[pad + jj:pad + jj + h, pad + ii:pad + ii + w]
    return (1 - fy) * ((1 - fx) * g(i, j) + fx * g(i + 1, j)) + fy * ((1 - fx) * g(i, j + 1) + fx * g(i + 1, j + 1))


def blur_disc(l, radius):
    taps = [(x, y) for x in np.arange(-4, 4.01, 0.5) for y in np.arange(-4, 4.01, 0.5) if x * x + y * y <= radius * radius]
    return sum(shifted(l, x, y) for x, y in taps) / len(taps)


def box_blur(a, n):
    for axis in (0, 1):
        a = sum(np.roll(a, s, axis) for s in range(-n, n + 1)) / (2 * n + 1)
    return a


def edit(a, name, p, scene, k, r, fixed, memory, state):
    """One effect on encoded values; `r` draws per frame, `fixed` holds what is drawn once per case."""
    h, w, _ = a.shape
    y, x = np.mgrid[0:h, 0:w]
    rad = np.hypot(x + 0.5 - w / 2, y + 0.5 - h / 2) / np.hypot(w / 2, h / 2)
    if name == "gamma":
        a = 255 * (a / 255) ** p["exponent"]
    elif name == "white_balance":
        a = a * np.array([(1 + p["red"]) ** (1 / 2.2), 1, (1 + p["blue"]) ** (1 / 2.2)])
    elif name == "vignetting":
        a = code(light(a) * (1 - p["loss"] * rad ** p["power"])[..., None])
    elif name == "fog_haze":
        t = np.exp(-p["beta"] * np.clip(scene.true_depth, 0.5, 200))[..., None]
        a = code(light(a) * t + p["air"] * (1 - t))
    elif name == "night_illumination":
        u, v = (x - scene.cx) / scene.f, (y - scene.cy) / scene.f
        cone = np.exp(-((u / 0.35) ** 2) - ((v - 0.12) / 0.12) ** 2)
        a = code(light(a) * (p["ambient"] + p["headlamp"] * cone)[..., None])
    elif name == "defocus":
        a = code(blur_disc(light(a), p["radius"]))
    elif name == "motion_blur":
        fx, fy = flow(scene, k, x.astype(float), y.astype(float))
        l, total, n = light(a), 0, 9
        for e in (np.arange(n) + 0.5) / n - 0.5:
            u, v = np.clip(x - fx * e * p["shutter_ms"] * 1e-3, 0, w - 1.001), np.clip(y - fy * e * p["shutter_ms"] * 1e-3, 0, h - 1.001)
            i, j = u.astype(int), v.astype(int)
            b, c = (u - i)[..., None], (v - j)[..., None]
            total = total + (1 - c) * ((1 - b) * l[j, i] + b * l[j, i + 1]) + c * ((1 - b) * l[j + 1, i] + b * l[j + 1, i + 1])
        a = code(total / n)
    elif name == "texture_washing":
        d = a - box_blur(a, 2)
        a = a - p["share"] * d / (1 + (d / 14) ** 4)
    elif name == "exposure_lag":
        dt = 1 / scene.rate
        e = memory.setdefault("e", state["light"][0])
        e = e + (state["light"][k] - e) * (1 - np.exp(-dt / p["tau"]))
        memory["e"] = e
        a = code(light(a) * state["light"][k] / e)
    elif name == "temporal_flicker":
        g = p["sd"] * (0.7 * r.normal() + 0.7 * smooth_field(r, h, w, 4))
        a = code(light(a) * np.exp(g)[..., None])
    elif name == "rollout_drift":
        q = p["per_100"] / 100 * (k - max(t for t in state["anchors"] if t <= k))
        l = light(a)
        m = l.mean()
        l = (m + (l - m) * (1 + 0.5 * q)) * (1 - 0.1 * q)
        if a.shape[2] == 3:
            l = l * np.array([1 + 0.1 * q, 1, 1 - 0.1 * q])
        a = code(l)
        d = a - box_blur(a, 2)
        a = a - min(1, 0.8 * q) * d / (1 + (d / 14) ** 4)
    elif name == "lens_dirt":
        for bx, by, br, o in fixed["blobs"]:
            m = o / (1 + (np.hypot(x - bx * w, y - by * h) / (br * h)) ** 6)
            a = a * (1 - m[..., None]) + 60 * m[..., None]
    elif name == "rain_streaks":
        l = a.copy()
        for _ in range(r.poisson(p["count"])):
            sx, sy, n, s = r.uniform(0, w), r.uniform(-10, h), r.uniform(0.05, 0.14) * h, p["strength"] * r.uniform(0.4, 1)
            slope = r.normal(0, 0.04)
            for t in range(int(n)):
                px, py = int(sx + slope * t), int(sy + t)
                if 0 <= px < w and 0 <= py < h:
                    l[py, px] += s
        a = l
    elif name == "object_dropout":
        for x0, y0, x1, y1 in state["dropped"][k]:
            x0, y0, x1, y1 = int(x0), int(y0), int(np.ceil(x1)), int(np.ceil(y1))
            top, bottom = a[max(y0 - 2, 0), x0:x1], a[min(y1 + 1, h - 1), x0:x1]
            s = np.linspace(0, 1, max(y1 - y0, 1))[:, None, None]
            a[y0:y1, x0:x1] = (top * (1 - s) + bottom * s)[: a[y0:y1, x0:x1].shape[0]]
    elif name == "sensor_noise":
        a = a + r.normal(size=a.shape) * np.sqrt(p["read"] ** 2 + p["shot"] ** 2 * np.clip(a, 0, 255) / 255)
    elif name == "jpeg_loss":
        a = jpeg(a, int(p["quality"]))
    elif name == "x_stripes":
        a = a * (1 + p["amp"] * np.sin(2 * np.pi * (x * np.cos(p["angle"]) + y * np.sin(p["angle"])) / p["period"]))[..., None]
    elif name == "x_ghost":
        a = code(light(a) * (1 - p["share"]) + p["share"] * light(shifted(a, p["dx"], p["dy"])))
    elif name == "x_chromatic":
        g = sample(np.repeat(np.repeat(a, OVER, 0), OVER, 1), scene, lambda u, v: (scene.cx + (u - scene.cx) * (1 + p["rel"]), scene.cy + (v - scene.cy) * (1 + p["rel"])))
        a = np.stack([g[..., 0], a[..., 1 % a.shape[2]], a[..., -1]], -1) if a.shape[2] == 3 else 0.5 * (a + g)
    elif name == "x_posterise":
        a = np.round(a / p["step"]) * p["step"]
    elif name == "x_sharpen":
        a = a + p["gain"] * (a - box_blur(a, 1))
    elif name == "x_glare":
        m = np.exp(-((x - p["x"] * w) ** 2 + (y - p["y"] * h) ** 2) / (2 * (p["size"] * h) ** 2))
        a = code(light(a) + p["gain"] * (0.5 + 0.5 * np.sin(k * 1.7)) * m[..., None])
    elif name == "x_interlace":
        b = np.roll(a, int(p["px"]), 1)
        a = np.where((y % 2 == 1)[..., None], b, a)
    elif name == "x_bloom":
        l = light(a)
        a = code(l + p["gain"] * box_blur(np.where(l > 0.7, l, 0), 7))
    elif name == "x_blend":
        before = memory.get("before", a)
        memory["before"] = a.copy()
        a = (1 - p["share"]) * a + p["share"] * before
    return np.clip(a, 0, 255)


def draw_unknown(r, name):
    return {
        "x_stripes": lambda: dict(amp=r.uniform(0.05, 0.1), angle=r.uniform(0, np.pi), period=r.uniform(3, 9)),
        "x_ghost": lambda: dict(share=r.uniform(0.15, 0.3), dx=r.uniform(5, 15), dy=r.uniform(-4, 4)),
        "x_chromatic": lambda: dict(rel=r.uniform(0.008, 0.02)),
        "x_posterise": lambda: dict(step=r.uniform(14, 30)),
        "x_sharpen": lambda: dict(gain=r.uniform(0.6, 1.5)),
        "x_tear": lambda: dict(row=r.uniform(0.3, 0.7), jump=side(r) * r.uniform(4, 10)),
        "x_glare": lambda: dict(x=r.uniform(0.2, 0.8), y=r.uniform(0.1, 0.6), size=r.uniform(0.15, 0.3), gain=r.uniform(0.15, 0.4)),
        "x_interlace": lambda: dict(px=r.integers(2, 4)),
        "x_bloom": lambda: dict(gain=r.uniform(0.2, 0.5)),
        "x_blend": lambda: dict(share=r.uniform(0.25, 0.45)),
    }[name]()


def jpeg(a, quality):
    im = Image.fromarray(np.clip(np.round(a), 0, 255).astype(np.uint8).squeeze())
    b = io.BytesIO()
    im.save(b, "JPEG", quality=quality)
    out = np.asarray(Image.open(io.BytesIO(b.getvalue())), float)
    return out if out.ndim == 3 else out[:, :, None]


ORDER = ["object_dropout", "texture_washing", "rollout_drift", "temporal_flicker", "fog_haze", "night_illumination", "rain_streaks", "motion_blur",
         "defocus", "lens_dirt", "vignetting", "exposure_lag", "white_balance", "gamma", "sensor_noise", "jpeg_loss"]


def make(out, name, seed, kind, ids, source):
    r = np.random.default_rng(seed)
    need = {EFFECTS[i][3] for i in ids if i in EFFECTS}
    while True:
        scene = Scene(r, None if need & {"motion", "boxes"} else source)
        if "colour" not in need or scene.colour:
            break
    u, v, ground, left, right = scene.depth()
    proxy = np.minimum(np.minimum(np.minimum(ground, left), right), 150)
    scene.true_depth = proxy * scene.wobble
    frames = [scene.frame(k) for k in range(scene.n)]
    colour = frames[0][0].shape[2] == 3
    if "colour" in need and not colour:
        frames = [(np.repeat(f, 3, 2) * np.array([1.05, 1, 0.9]), b) for f, b in frames]
    effects = [(i, EFFECTS[i][4](r) if i in EFFECTS else draw_unknown(r, i)) for i in ids]
    lit = np.ones(scene.n)
    if "light" in need or r.random() < 0.3:
        at = int(r.integers(3, max(4, scene.n - 8)))
        lit[at:] = r.choice([0.45, 2.2])
    anchors = [0] + list(range(int(r.integers(6, 12)), scene.n, int(r.integers(8, 13))))
    state = dict(light=lit, anchors=anchors, dropped={})
    fixed = dict(blobs=[])
    dropped = []
    for i, p in effects:
        if i == "lens_dirt":
            fixed["blobs"] = [(r.uniform(), r.uniform(), r.uniform(0.05, 0.14), p["opacity"] * r.uniform(0.7, 1)) for _ in range(p["blobs"])]
        if i == "object_dropout":
            for k, (_, boxes) in enumerate(frames):
                lost = [b for b in range(len(boxes)) if r.random() < p["prob"]]
                state["dropped"][k] = [boxes[b] for b in lost]
                dropped += [[k, b] for b in lost]
    content = np.arange(scene.n)
    stamp = np.zeros(scene.n)
    for i, p in effects:
        if i in ("obs_latency", "condition_delay"):
            content = np.maximum(content - p["frames"], 0)
            if i == "obs_latency":
                stamp = stamp - p["frames"] / scene.rate
        if i == "dropped_frames":
            for k in range(1, scene.n):
                if r.random() < p["rate"]:
                    content[k] = content[k - 1]
    folder = out / name
    for s in ("sim", "real"):
        (folder / s).mkdir(parents=True, exist_ok=True)
    constant, gain, noise = r.uniform(-0.25, 0.25, 2), 1 + r.uniform(-0.01, 0.01), r.uniform(0.8, 1.6)
    tiles, held = [], scene.n - 4
    memory = {}
    sums = np.zeros((scene.n, 2, 4, 6))
    for k in range(scene.n):
        sim = sample(frames[k][0], scene, lambda x, y: (x, y))
        shift, g = constant + r.uniform(-0.25, 0.25, 2), gain * (1 + r.normal(0, 0.003))
        grain = r.normal(size=sim.shape) * noise
        src = int(content[k])
        real = sample(frames[src][0], scene, place_of(scene, effects, src, shift))
        twin = sample(frames[k][0], scene, place_of(scene, [], k, shift))
        ordered = sorted(effects, key=lambda e: ORDER.index(e[0]) if e[0] in ORDER else 9)
        real = code(light(real) * g)
        for i, p in ordered:
            real = edit(real, i, p, scene, k, r, fixed, memory, state)
        real, twin = real + grain, code(light(twin) * g) + grain
        saved = []
        for s, a, q in (("sim", sim, 95), ("real", real, 92), (None, twin, 92)):
            im = Image.fromarray(np.clip(np.round(a), 0, 255).astype(np.uint8).squeeze())
            if s:
                im.save(folder / s / f"{k:04d}.jpg", quality=q)
            saved.append(jpeg(a, q))
        for d, a in enumerate(saved[1:]):
            e = ((a - saved[0]) ** 2).mean(2)
            sums[k, d] = [[e[i * scene.h // 4:(i + 1) * scene.h // 4, j * scene.w // 6:(j + 1) * scene.w // 6].mean() for j in range(6)] for i in range(4)]
    fit = sums[:held].mean(0)
    if kind != "none":
        tiles = [[i, j] for i in range(4) for j in range(6) if fit[0, i, j] - fit[1, i, j] > 0.25 * (fit[1, i, j] + 1)]
    Image.fromarray(np.clip(proxy * 100, 0, 65535).astype(np.uint16)).save(folder / "depth_proxy.png")
    rows = ["frame,time_s,real_stamp_s,speed_mps,yaw_rate_radps,light_rel"]
    for k in range(scene.n):
        t = k / scene.rate
        motion = f"{scene.speed[k]:.2f},{scene.yaw[k]:.4f}" if scene.motion else ","
        rows.append(f"{k},{t:.4f},{t + stamp[k] + r.normal(0, 0.0005):.4f},{motion},{lit[k]:.3f}")
    (folder / "frames.csv").write_text("\n".join(rows) + "\n")
    if any(b for _, b in frames):
        lines = ["frame,box,x0,y0,x1,y1,class"]
        lines += [f"{k},{i},{b[0]:.1f},{b[1]:.1f},{b[2]:.1f},{b[3]:.1f},car" for k, (_, bs) in enumerate(frames) for i, b in enumerate(bs)]
        (folder / "boxes.csv").write_text("\n".join(lines) + "\n")
    meta = dict(case=name, width=scene.w, height=scene.h, channels="rgb" if frames[0][0].shape[2] == 3 else "grey", frame_rate_hz=scene.rate,
                contiguous=True, intrinsics=dict(fx=scene.f, fy=scene.f, cx=scene.cx, cy=scene.cy), intrinsics_assumed=False,
                camera_height_m=scene.height, sensor_rows=1280, depth_proxy="depth_proxy.png", rollout_anchor_frames=anchors,
                has_motion=scene.motion, has_boxes=any(b for _, b in frames), tiles=[4, 6], frames=[0, scene.n - 1],
                suggested_split=dict(fit=[0, held - 1], held_out=[held, scene.n - 1]))
    (folder / "meta.json").write_text(json.dumps(meta, indent=1))
    listed = []
    for i, p in effects:
        main, unit, group = (EFFECTS[i][0], EFFECTS[i][1], EFFECTS[i][2]) if i in EFFECTS else (next(iter(p)), "1", "out_of_library")
        listed.append(dict(id=i, params={a: float(b) for a, b in p.items()}, value=float(p[main]), unit=unit, group=group))
    return dict(kind=kind, effects=listed, tiles=tiles, excess=float(fit[0].mean() / fit[1].mean() - 1),
                heldout_rmse=dict(before=float(np.sqrt(sums[held:, 0].mean())), floor=float(np.sqrt(sums[held:, 1].mean()))))


def main():
    a = argparse.ArgumentParser()
    a.add_argument("--out", required=True)
    a.add_argument("--seed", type=int, required=True)
    for name, count in (("singles", 25), ("none", 8), ("pairs", 6), ("unknown", 8)):
        a.add_argument(f"--{name}", type=int, default=count)
    a.add_argument("--source")
    o = a.parse_args()
    out = pathlib.Path(o.out)
    names = list(EFFECTS)
    plan = [("single", [names[k % len(names)]]) for k in range(o.singles)] + [("none", [])] * o.none
    plan += [("double", list(PAIRS[k % len(PAIRS)])) for k in range(o.pairs)]
    plan += [("out_of_library", [UNKNOWN[k % len(UNKNOWN)]]) for k in range(o.unknown)]
    order = np.random.default_rng(o.seed).permutation(len(plan))
    labels = {}
    for place, k in enumerate(order):
        name = f"case_{place:03d}"
        labels[name] = make(out, name, [o.seed, int(k)], *plan[k], o.source)
        (out / "labels.json").write_text(json.dumps(labels, indent=1))


if __name__ == "__main__":
    main()
