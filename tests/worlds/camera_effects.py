"""Effects of the camera world: draws of their parameters and what they do to a frame. Shares no code with the crates.

Geometry is a map of places (`place_of`), everything else an edit of encoded values (`edit`). `UNKNOWN` holds kinds that
are in no library; the ones of `UNSEEN` are never drawn for tuning.
"""

import io

import numpy as np
from PIL import Image

from camera_scene import OVER, smooth_field


def side(r):
    return 1 if r.random() < 0.5 else -1


# id: (main parameter, unit, group, what it needs, draw of parameters, neutral value)
EFFECTS = {
    "mount_pitch": ("deg", "deg", "mount_vertical", "", lambda r: dict(deg=side(r) * r.uniform(0.3, 1.5))),
    "mount_yaw": ("deg", "deg", "mount_horizontal", "", lambda r: dict(deg=side(r) * r.uniform(0.3, 1.5))),
    "mount_roll": ("deg", "deg", "mount_roll", "", lambda r: dict(deg=side(r) * r.uniform(0.4, 1.8))),
    "mount_position": ("left", "m", "position", "depth", lambda r: dict(left=side(r) * r.uniform(0.15, 0.5), up=side(r) * r.uniform(0.1, 0.4))),
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
    "object_hallucination": ("rate", "per frame", "objects", "", lambda r: dict(rate=r.uniform(0.5, 2.0))),
    "identity_switch": ("rate", "per box and frame", "objects", "boxes", lambda r: dict(rate=r.uniform(0.25, 0.7))),
    "layout_misalignment": ("offset", "px", "objects", "boxes", lambda r: dict(offset=r.uniform(3, 9))),
    "rollout_drift": ("per_100", "1 per 100 frames", "rollout", "order", lambda r: dict(per_100=r.uniform(1.2, 3.0))),
}
NEUTRAL = {"gamma": 1.0, "night_illumination": 1.0, "jpeg_loss": 100.0}
PAIRS = [("mount_roll", "vignetting"), ("mount_yaw", "gamma"), ("fog_haze", "defocus"), ("mount_pitch", "sensor_noise"),
         ("focal_error", "jpeg_loss"), ("white_balance", "mount_yaw"), ("exposure_lag", "mount_roll"), ("lens_dirt", "mount_pitch"),
         ("condition_delay", "gamma"), ("vignetting", "defocus"), ("motion_blur", "gamma"), ("night_illumination", "mount_roll"),
         ("gamma", "jpeg_loss"), ("vignetting", "sensor_noise"), ("radial_distortion", "fog_haze"), ("mount_yaw", "texture_washing"),
         ("temporal_flicker", "mount_pitch"), ("obs_latency", "vignetting"), ("white_balance", "defocus"), ("rain_streaks", "gamma"),
         ("rolling_shutter", "gamma"), ("object_dropout", "mount_yaw"), ("rollout_drift", "mount_roll"), ("dropped_frames", "white_balance")]
UNKNOWN = {
    "x_stripes": lambda r: dict(amp=r.uniform(0.05, 0.1), angle=r.uniform(0, np.pi), period=r.uniform(3, 9)),
    "x_ghost": lambda r: dict(share=r.uniform(0.15, 0.3), dx=r.uniform(5, 15), dy=r.uniform(-4, 4)),
    "x_chromatic": lambda r: dict(rel=r.uniform(0.008, 0.02)),
    "x_posterise": lambda r: dict(step=r.uniform(14, 30)),
    "x_sharpen": lambda r: dict(gain=r.uniform(0.6, 1.5)),
    "x_tear": lambda r: dict(row=r.uniform(0.3, 0.7), jump=side(r) * r.uniform(4, 10)),
    "x_glare": lambda r: dict(x=r.uniform(0.2, 0.8), y=r.uniform(0.1, 0.6), size=r.uniform(0.15, 0.3), gain=r.uniform(0.15, 0.4)),
    "x_interlace": lambda r: dict(px=r.integers(2, 4)),
    "x_bloom": lambda r: dict(gain=r.uniform(0.2, 0.5)),
    "x_blend": lambda r: dict(share=r.uniform(0.25, 0.45)),
    "x_banding": lambda r: dict(amp=r.uniform(0.06, 0.15), cycles=r.uniform(2, 6), speed=r.uniform(0.5, 3)),
    "x_rows": lambda r: dict(sd=r.uniform(3, 7)),
    "x_mosaic": lambda r: dict(px=r.integers(3, 6)),
    # never drawn for tuning
    "x_wave": lambda r: dict(px=r.uniform(1.5, 3.5), period=r.uniform(20, 60)),
    "x_solarise": lambda r: dict(level=r.uniform(150, 200), gain=r.uniform(0.4, 0.9)),
    "x_local_tone": lambda r: dict(gain=r.uniform(0.3, 0.7)),
    "x_salt": lambda r: dict(share=r.uniform(0.004, 0.02)),
    "x_lost_blocks": lambda r: dict(share=r.uniform(0.02, 0.08)),
    "x_desaturate": lambda r: dict(share=r.uniform(0.4, 0.9)),
    "x_double_exposure": lambda r: dict(share=r.uniform(0.1, 0.25)),
    "x_stuck_columns": lambda r: dict(count=int(r.integers(3, 9))),
}
UNSEEN = ["x_wave", "x_solarise", "x_local_tone", "x_salt", "x_lost_blocks", "x_desaturate", "x_double_exposure", "x_stuck_columns"]
ORDER = ["object_dropout", "object_hallucination", "identity_switch", "layout_misalignment", "texture_washing", "rollout_drift",
         "temporal_flicker", "fog_haze", "night_illumination", "rain_streaks", "motion_blur", "defocus", "lens_dirt", "vignetting",
         "exposure_lag", "white_balance", "gamma", "sensor_noise", "jpeg_loss"]


def weakened(name, p, share):
    """Parameters whose main value lies nearer to neutral."""
    main, neutral = EFFECTS[name][0], NEUTRAL.get(name, 0.0)
    if name in ("obs_latency", "condition_delay"):
        return dict(p, frames=1)
    out = dict(p)
    out[main] = neutral + share * (p[main] - neutral)
    if name == "white_balance":
        out["blue"] = share * p["blue"]
    return out


def light(v):
    return np.clip(v / 255.0, 0, None) ** 2.2


def code(l):
    return 255.0 * np.clip(l, 0, None) ** (1 / 2.2)


def sample(big, scene, place):
    """Resamples at the places (u, v) px of the small picture, 2 x 2 samples a pixel, bilinear in the big one."""
    h, w, c = big.shape
    flat = big.reshape(h * w, c)
    y, x = np.mgrid[0:scene.h, 0:scene.w].astype(np.float32)
    total = 0
    for ox in (-0.25, 0.25):
        for oy in (-0.25, 0.25):
            u, v = place(x + ox, y + oy)
            bu, bv = np.clip((u + 0.5) * OVER - 0.5, 0, w - 1.001), np.clip((v + 0.5) * OVER - 0.5, 0, h - 1.001)
            i, j = bu.astype(np.int32), bv.astype(np.int32)
            a, b = (bu - i).astype(np.float32)[..., None], (bv - j).astype(np.float32)[..., None]
            k = j * w + i
            total = total + (1 - b) * ((1 - a) * flat[k] + a * flat[k + 1]) + b * ((1 - a) * flat[k + w] + a * flat[k + w + 1])
    return total / 4


def flow(scene, k, x, y, depth):
    """Image motion of the static scene, px/s."""
    u, v = (x - scene.cx) / scene.f, (y - scene.cy) / scene.f
    z = depth[np.clip(y.astype(int), 0, scene.h - 1), np.clip(x.astype(int), 0, scene.w - 1)]
    close, turn = scene.speed[k] / z, scene.yaw[k]
    return scene.f * (u * close + turn * (1 + u * u)), scene.f * (v * close + turn * u * v)


def place_of(scene, effects, k, shift, depth):
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
            elif name == "mount_position":
                z = depth[np.clip(y.astype(int), 0, scene.h - 1), np.clip(x.astype(int), 0, scene.w - 1)]
                u, v = u - p["left"] / z, v - p["up"] / z
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
                fx, fy = flow(scene, k, x, y, depth)
                late = p["line_us"] * 1e-6 * 1280 * ((y + 0.5) / scene.h - 0.5)
                u, v = u - fx * late / scene.f, v - fy * late / scene.f
            elif name == "x_tear" and k % 3 == 1:
                u = np.where(y > p["row"] * scene.h, u + p["jump"] / scene.f, u)
            elif name == "x_wave":
                u = u + p["px"] / scene.f * np.sin(2 * np.pi * (y / p["period"] + 0.31 * k))
            x, y = u * scene.f + scene.cx, v * scene.f + scene.cy
        return x, y
    return place


def shifted(a, dx, dy):
    i, j = int(np.floor(dx)), int(np.floor(dy))
    fx, fy = dx - i, dy - j
    pad = 24
    p = np.pad(a, ((pad, pad), (pad, pad), (0, 0)), "edge")
    h, w = a.shape[:2]

    def g(ii, jj):
        return p[pad + jj:pad + jj + h, pad + ii:pad + ii + w]
    return (1 - fy) * ((1 - fx) * g(i, j) + fx * g(i + 1, j)) + fy * ((1 - fx) * g(i, j + 1) + fx * g(i + 1, j + 1))


def blur_disc(l, radius):
    taps = [(x, y) for x in np.arange(-4, 4.01, 0.5) for y in np.arange(-4, 4.01, 0.5) if x * x + y * y <= radius * radius]
    kernel = np.zeros((11, 11), np.float32)
    for x, y in taps:
        i, j = int(np.floor(x)), int(np.floor(y))
        a, b = x - i, y - j
        for di, wi in ((0, 1 - a), (1, a)):
            for dj, wj in ((0, 1 - b), (1, b)):
                kernel[5 + j + dj, 5 + i + di] += wi * wj / len(taps)
    h, w = l.shape[:2]
    p = np.pad(l, ((5, 5), (5, 5), (0, 0)), "edge")
    return sum(kernel[j, i] * p[j:j + h, i:i + w] for j in range(11) for i in range(11) if kernel[j, i] > 0)


def box_blur(a, n):
    for axis in (0, 1):
        a = sum(np.roll(a, s, axis) for s in range(-n, n + 1)) / (2 * n + 1)
    return a


def jpeg(a, quality):
    im = Image.fromarray(np.clip(np.round(a), 0, 255).astype(np.uint8).squeeze())
    b = io.BytesIO()
    im.save(b, "JPEG", quality=quality)
    out = np.asarray(Image.open(io.BytesIO(b.getvalue())), np.float32)
    return out if out.ndim == 3 else out[:, :, None]


def filled(a, b):
    """The picture with a box filled from above and below."""
    h = a.shape[0]
    x0, y0, x1, y1 = int(b[0]), int(b[1]), int(np.ceil(b[2])), int(np.ceil(b[3]))
    y1 = min(y1, h)
    top, bottom = a[max(y0 - 2, 0), x0:x1], a[min(y1 + 1, h - 1), x0:x1]
    s = np.linspace(0, 1, max(y1 - y0, 1))[:, None, None]
    out = a.copy()
    out[y0:y1, x0:x1] = (top * (1 - s) + bottom * s)[: y1 - y0]
    return out


def objects(a, name, p, k, r, fixed, state):
    """Effects of the video model on single objects."""
    h, w, _ = a.shape
    boxes = state["boxes"][k]
    if name == "object_dropout":
        for b in state["dropped"].get(k, []):
            a = filled(a, b)
    elif name == "identity_switch":
        for x0, y0, x1, y1, *_ in boxes:
            if r.random() < p["rate"]:
                x0, y0, x1, y1 = int(x0), int(y0), int(x1), int(y1)
                if a.shape[2] == 3 and r.random() < 0.5:
                    a[y0:y1, x0:x1] = np.clip(a[y0:y1, x0:x1][..., r.permutation(3)] * r.uniform(0.7, 1.3, 3), 0, 250)
                else:
                    a[y0:y1, x0:x1] = np.clip(a[y0:y1, x0:x1] * r.choice([r.uniform(0.5, 0.75), r.uniform(1.3, 1.7)]) + r.uniform(-20, 20), 4, 250)
    elif name == "layout_misalignment":
        before = a.copy()
        for b in boxes:
            a = filled(a, b)
        for b in sorted(boxes, key=lambda b: b[3]):
            dx, dy = fixed["offsets"].setdefault(b[5], r.normal(size=2) * p["offset"])
            x0, y0, x1, y1 = int(b[0]), int(b[1]), int(b[2]), int(b[3])
            i, j = int(round(dx)), int(round(dy * 0.5))
            X0, Y0, X1, Y1 = max(x0 + i, 0), max(y0 + j, 0), min(x1 + i, w), min(y1 + j, h)
            if X1 > X0 and Y1 > Y0:
                a[Y0:Y1, X0:X1] = before[Y0 - j:Y1 - j, X0 - i:X1 - i]
    elif name == "object_hallucination":
        for _ in range(r.poisson(p["rate"])):
            bw, bh = int(w * r.uniform(0.06, 0.16)), int(h * r.uniform(0.1, 0.25))
            x0, y0 = int(r.uniform(0, w - bw)), int(h * r.uniform(0.4, 0.7))
            y0 = min(y0, h - bh)
            tone = r.uniform(15, 235, a.shape[2])
            a[y0:y0 + bh, x0:x0 + bw] = tone
            a[y0 + bh // 6:y0 + bh // 2, x0 + bw // 8:x0 + bw - bw // 8] = 40
            a[y0 + bh - bh // 6:y0 + bh, x0:x0 + bw] = 20
    return a


def unknown(a, name, p, scene, k, r, fixed, memory):
    h, w, _ = a.shape
    y, x = np.mgrid[0:h, 0:w].astype(np.float32)
    if name == "x_stripes":
        a = a * (1 + p["amp"] * np.sin(2 * np.pi * (x * np.cos(p["angle"]) + y * np.sin(p["angle"])) / p["period"]))[..., None]
    elif name == "x_ghost":
        a = code(light(a) * (1 - p["share"]) + p["share"] * light(shifted(a, p["dx"], p["dy"])))
    elif name == "x_chromatic":
        def at(s):
            return sample(np.repeat(np.repeat(a, OVER, 0), OVER, 1), scene,
                          lambda u, v: (scene.cx + (u - scene.cx) * s, scene.cy + (v - scene.cy) * s))
        if a.shape[2] == 3:
            a = np.stack([at(1 + p["rel"])[..., 0], a[..., 1], at(1 - p["rel"])[..., 2]], -1)
        else:
            a = 0.5 * (a + at(1 + p["rel"]))
    elif name == "x_posterise":
        a = np.round(a / p["step"]) * p["step"]
    elif name == "x_sharpen":
        a = a + p["gain"] * (a - box_blur(a, 1))
    elif name == "x_glare":
        m = np.exp(-((x - p["x"] * w) ** 2 + (y - p["y"] * h) ** 2) / (2 * (p["size"] * h) ** 2))
        a = code(light(a) + p["gain"] * (0.5 + 0.5 * np.sin(k * 1.7)) * m[..., None])
    elif name == "x_interlace":
        a = np.where((y % 2 == 1)[..., None], np.roll(a, int(p["px"]), 1), a)
    elif name == "x_bloom":
        l = light(a)
        a = code(l + p["gain"] * box_blur(np.where(l > 0.7, l, 0), 7))
    elif name == "x_blend":
        before = memory.get("before", a)
        memory["before"] = a.copy()
        a = (1 - p["share"]) * a + p["share"] * before
    elif name == "x_banding":
        a = code(light(a) * (1 + p["amp"] * np.sin(2 * np.pi * (p["cycles"] * y / h + 0.1 * p["speed"] * k)))[..., None])
    elif name == "x_rows":
        a = a + r.normal(size=(h, 1, 1)) * p["sd"]
    elif name == "x_mosaic":
        n = int(p["px"])
        a = a[(y // n * n).astype(int), (x // n * n).astype(int)]
    elif name == "x_solarise":
        a = np.where(a > p["level"], p["level"] - p["gain"] * (a - p["level"]), a)
    elif name == "x_local_tone":
        wide = box_blur(box_blur(a, 9), 9)
        a = wide + (128 - wide) * p["gain"] + (a - wide) * (1 + p["gain"])
    elif name == "x_salt":
        hit = r.random((h, w)) < p["share"]
        a = np.where(hit[..., None], np.where(r.random((h, w)) < 0.5, 0.0, 255.0)[..., None], a)
    elif name == "x_lost_blocks":
        hit = (r.random((h // 16 + 1, w // 16 + 1)) < p["share"])[(y // 16).astype(int), (x // 16).astype(int)]
        a = np.where(hit[..., None], 128.0, a)
    elif name == "x_desaturate":
        grey = a.mean(2, keepdims=True)
        a = a + p["share"] * (grey - a) if a.shape[2] == 3 else np.where(a < 128, a, 255 - a * 0.5)
    elif name == "x_double_exposure":
        first = memory.setdefault("first", a.copy())
        a = code((1 - p["share"]) * light(a) + p["share"] * light(first))
    elif name == "x_stuck_columns":
        columns = fixed.setdefault("columns", r.integers(0, w, p["count"]))
        a = a.copy()
        a[:, columns] = 245
    return a


def edit(a, name, p, scene, k, r, fixed, memory, state):
    """One effect on encoded values; `r` draws per frame, `fixed` holds what is drawn once per case."""
    h, w, _ = a.shape
    y, x = np.mgrid[0:h, 0:w]
    if name == "gamma":
        a = 255 * (a / 255) ** p["exponent"]
    elif name == "white_balance":
        a = a * np.array([(1 + p["red"]) ** (1 / 2.2), 1, (1 + p["blue"]) ** (1 / 2.2)])
    elif name == "vignetting":
        rad = np.hypot(x + 0.5 - w / 2, y + 0.5 - h / 2) / np.hypot(w / 2, h / 2)
        a = code(light(a) * (1 - p["loss"] * rad ** p["power"])[..., None])
    elif name == "fog_haze":
        t = np.exp(-p["beta"] * np.clip(state["depth"][k], 0.5, 200))[..., None]
        a = code(light(a) * t + p["air"] * (1 - t))
    elif name == "night_illumination":
        u, v = (x - scene.cx) / scene.f, (y - scene.cy) / scene.f
        cone = np.exp(-((u / 0.35) ** 2) - ((v - 0.12) / 0.12) ** 2)
        a = code(light(a) * (p["ambient"] + p["headlamp"] * cone)[..., None])
    elif name == "defocus":
        a = code(blur_disc(light(a), p["radius"]))
    elif name == "motion_blur":
        fx, fy = flow(scene, k, x.astype(float), y.astype(float), state["depth"][k])
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
        a = a.copy()
        for _ in range(r.poisson(p["count"])):
            sx, sy, n, s = r.uniform(0, w), r.uniform(-10, h), r.uniform(0.05, 0.14) * h, p["strength"] * r.uniform(0.4, 1)
            slope = r.normal(0, 0.04)
            for t in range(int(n)):
                px, py = int(sx + slope * t), int(sy + t)
                if 0 <= px < w and 0 <= py < h:
                    a[py, px] += s
    elif name == "sensor_noise":
        a = a + r.normal(size=a.shape) * np.sqrt(p["read"] ** 2 + p["shot"] ** 2 * np.clip(a, 0, 255) / 255)
    elif name == "jpeg_loss":
        a = jpeg(a, int(p["quality"]))
    elif name.startswith("x_"):
        a = unknown(a, name, p, scene, k, r, fixed, memory)
    else:
        a = objects(a.copy(), name, p, k, r, fixed, state)
    return np.clip(a, 0, 255)
