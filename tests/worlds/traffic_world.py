"""An independent world of traffic: labelled cases for the diagnosis of agents and map, sharing no code with the crates.

Its own integrator (0.02 s), car following (the intelligent driver model of 2000 with drivers that differ), lane changes
(MOBIL with a cosine path), yielding by time gaps, walking with gap acceptance, lights, detections with noise. The
effects are written down here a second time. Roads: two or three lanes east, a street from the south with the right of
way, a light, a crosswalk. Seeds draw everything.

    python tests/worlds/traffic_world.py --out CASES_DIR --seed 1 [--each 2] [--none 8] [--only EFFECT,EFFECT]
"""

import argparse
import json
import math
import pathlib
import random

from real_traffic import lane, scenario, track

STEP, OUT, SECS, LANE = 0.02, 0.1, 20.0, 3.5
NOISE = (0.15, 0.02, 0.2)
REACH = 80.0
RANGES = {  # how far from the usual: smallest and largest, sign drawn where both sides are sound
    "tr_delay": (0.4, 1.1, "+"), "tr_headway": (0.25, 0.6, "log"), "tr_v0": (0.1, 0.25, "log"), "tr_accel": (0.25, 0.5, "log"),
    "tr_brake": (0.3, 0.5, "log"), "tr_min_gap": (1.0, 3.0, "+"), "lane_change_politeness": (0.6, 1.0, "value"), "non_yielding": (0.5, 1.0, "value"),
    "pedestrian_behaviour": (0.2, 0.4, "log"), "log_replay_not_reactive": (1.0, 1.0, "value"), "lane_offset": (0.4, 1.2, "both"),
    "missing_lane": (1.0, 1.0, "value"), "missing_crosswalk": (1.0, 1.0, "value"), "stop_line_shift": (2.0, 5.0, "both")}


class Driver:
    def __init__(self, rng, number, lane_at, x, speed, world, north=None):
        self.number, self.lane, self.x, self.v, self.north, self.want = number, lane_at, x, speed, north, speed
        spread = lambda sd: math.exp(rng.gauss(0, sd))
        value = world.get
        self.headway = 1.5 * spread(0.03) * value("tr_headway", 1.0)
        self.gap0 = 1.0 + abs(rng.gauss(0, 0.1)) + value("tr_min_gap", 0.0)
        self.a, self.b = 1.0 * spread(0.04) * value("tr_accel", 1.0), 2.0 * spread(0.04) * value("tr_brake", 1.0)
        self.v0 = speed * spread(0.01) * value("tr_v0", 1.0)
        self.delay = max(0.0, rng.gauss(0.02, 0.02)) + value("tr_delay", 0.0)
        self.rude = rng.random() < value("non_yielding", 0.0)
        self.aside = rng.gauss(0, 0.05) + value("lane_offset", 0.0)
        self.beyond = bool(value("missing_lane", 0)) and north is None and lane_at == 0 and rng.random() < 0.5
        self.since, self.source, self.wishes, self.gone, self.v_log = 99.0, lane_at, [], False, speed

    def acc(self, v, gap, lead, v0=None):
        v0 = v0 or self.v0
        free = 1 - (v / v0) ** 4 if v <= v0 else -self.b / self.a * (1 - (v0 / v) ** (4 * self.a / self.b))
        wanted = self.gap0 + max(0.0, v * self.headway + v * (v - lead) / (2 * math.sqrt(self.a * self.b)))
        return max(-8.0, min(self.a, self.a * (free - (wanted / max(gap, 0.05)) ** 2)))

    def lateral(self):
        share = min(self.since / 4.0, 1.0)
        smooth = 0.5 - 0.5 * math.cos(math.pi * share)
        return LANE * (self.source + (self.lane - self.source) * smooth) + self.aside - LANE * self.beyond

    def place(self):
        return (self.north + 0.0, self.x, math.pi / 2) if self.north is not None else (self.x, self.lateral(), 0.0)


class Walker:
    def __init__(self, rng, number, at, start, speed, world):
        self.number, self.at, self.y, self.v, self.usual = number, at, start, speed, speed
        self.pace = speed * math.exp(rng.gauss(0, 0.02)) * world.get("pedestrian_behaviour", 1.0)
        self.gap = 2.0


class World:
    def __init__(self, seed, effects):
        rng = self.rng = random.Random(seed)
        self.effects, self.lanes = effects, rng.choice((2, 3))
        self.crossing = rng.uniform(45, 85)
        self.walk = self.crossing + rng.uniform(35, 55)
        self.light = self.walk + rng.uniform(45, 65)
        self.green, self.ego_lane = rng.uniform(7, 14), rng.randrange(self.lanes)
        self.ego_x, self.ego_v = -20.0, rng.uniform(6, 8)
        self.pace = rng.uniform(0.7, 1.1)
        self.drivers, self.walkers = [], []
        count = 0
        for at in range(self.lanes):
            x = -100 + rng.uniform(0, 15)
            while x < 70:
                if at != self.ego_lane or abs(x + 20) > 14:
                    self.drivers.append(Driver(rng, count, at, x, rng.uniform(5, 13), effects))
                    count += 1
                x += rng.uniform(18, 45)
        y = -30.0
        for _ in range(5):
            y -= rng.uniform(15, 45)
            self.drivers.append(Driver(rng, count, 0, y, rng.uniform(6, 10), effects, north=self.crossing))
            count += 1
        for place in (self.walk, self.walk, self.walk, self.walk + 26, self.walk + 33, self.crossing - 30):
            speed = rng.uniform(1.0, 1.7)
            self.walkers.append(Walker(rng, count, place + rng.uniform(-1, 1), -4 - speed * rng.uniform(1, 13), speed, effects))
            count += 1
        self.line = self.light + effects.get("stop_line_shift", 0.0)
        self.first = [(d.number, d.place(), d.v) for d in self.drivers] + [(w.number, (w.at, w.y, math.pi / 2), w.v) for w in self.walkers]

    def ahead(self, me, lane_at, others):
        """Gap and speed of the next one ahead, and of the one behind, in a lane."""
        front, back = (1e9, 0.0, None), (1e9, 0.0, None)
        for x, y, v, width, length, who in others:
            if who is me or abs(y - lane_at) > 0.5 * (width + 1.9) + 0.1:
                continue
            gap = abs(x - me.x) - 0.5 * (length + 4.5)
            if x > me.x and gap < front[0]:
                front = (gap, v, who)
            elif x <= me.x and gap < back[0]:
                back = (gap, v, who)
        return front, back

    def wish(self, me, bodies, t):
        if me.north is not None:
            others = [(b[1], b[0], b[5].v if isinstance(b[5], Driver) and b[5].north is not None else 0.0, 4.5, 1.9, b[5]) for b in bodies]
            front, _ = self.ahead(me, me.north, [b for b in others if abs(b[1] - me.north) < 3])
            return me.acc(me.v, front[0], front[1])
        lanes = {me.lateral(), LANE * me.lane + me.aside - LANE * me.beyond}
        a = min(me.acc(me.v, *self.ahead(me, y, bodies)[0][:2]) for y in lanes)
        nose = me.x + 2.25
        if t < self.green and 0 <= self.line - nose and me.v**2 / 16 <= self.line - nose:
            a = min(a, me.acc(me.v, self.line - nose, 0.0))
        for gap in self.waits(me, nose):
            a = min(a, me.acc(me.v, gap, 0.0))
        return a

    def waits(self, me, nose):
        """Gaps to places where somebody else goes first."""
        if me.rude:
            return
        hurry = lambda s: (math.sqrt(me.v**2 + 2 * me.a * max(s, 0)) - me.v) / me.a
        enter, leave = self.crossing - 2.3, self.crossing + 2.3
        gap = enter - nose
        if gap >= 0 and me.v**2 / 8 <= gap:
            for other in self.drivers:
                if other.north is None or other.gone:
                    continue
                y = me.lateral()
                into, out = y - 2.3 - other.x - 2.25, y + 2.3 - other.x + 2.25
                if out > 0 and (other.v > 1.0 or into < 0) and into / max(other.v, 0.1) < hurry(leave + 2.25 - me.x) + 1.0 and out / max(other.v, 0.1) + 0.5 > hurry(gap):
                    yield gap
        for walker in self.walkers:
            marked = abs(walker.at - self.walk) < 2 or self.effects.get("missing_crosswalk")
            gap = walker.at - 2.0 - nose
            y = me.lateral()
            if marked and gap >= 0 and me.v**2 / 6 <= gap and y - 6.0 < walker.y < y + 2.0:
                yield gap

    def change(self, me, bodies):
        if me.since < 7.0 or me.north is not None or self.effects.get("log_replay_not_reactive"):
            return
        p = self.effects.get("lane_change_politeness", 0.25)
        best = (0.2, None)
        front, back = self.ahead(me, me.lateral(), bodies)
        acc = lambda who, gap, lead: who.acc(who.v, gap, lead) if isinstance(who, Driver) else 0.0
        for to in (me.lane - 1, me.lane + 1):
            if not 0 <= to < self.lanes or me.beyond:
                continue
            new_front, new_back = self.ahead(me, LANE * to + me.aside, bodies)
            after = acc(new_back[2], new_back[0], me.v)
            if new_front[0] < me.gap0 or new_back[0] < me.gap0 or after < -3.0:
                continue
            mine = me.acc(me.v, *new_front[:2]) - me.acc(me.v, *front[:2])
            theirs = after - acc(new_back[2], new_back[0] + 4.5 + new_front[0], new_front[1]) if new_back[2] else 0.0
            theirs += acc(back[2], back[0] + 4.5 + front[0], front[1]) - acc(back[2], back[0], me.v) if back[2] else 0.0
            if mine + p * theirs > best[0]:
                best = (mine + p * theirs, to)
        if best[1] is not None:
            me.source, me.lane, me.since = me.lane, best[1], 0.0

    def step(self, t, tick):
        bodies = [(*d.place()[:2], d.v if d.north is None else 0.0, 1.9 if d.north is None else 4.5, 4.5 if d.north is None else 1.9, d) for d in self.drivers if not d.gone]
        bodies += [(w.at, w.y, 0.0, 0.6, 0.6, w) for w in self.walkers]
        bodies.append((self.ego_x, LANE * self.ego_lane, self.ego_v * self.pace, 1.73, 4.08, None))
        if self.effects.get("log_replay_not_reactive") or t < 0.5:
            for d in self.drivers:
                d.x += d.v_log * STEP
            for w in self.walkers:
                w.y += w.usual * STEP
        else:
            if tick % 5 == 0:
                for d in self.drivers:
                    self.change(d, bodies)
            wishes = [self.wish(d, bodies, t) for d in self.drivers]
            for d, wish in zip(self.drivers, wishes):
                d.wishes.append(wish)
                back = int(round(d.delay / STEP))
                a = d.wishes[-1 - back] if len(d.wishes) > back else 0.0
                after = max(0.0, d.v + a * STEP)
                d.x += 0.5 * (d.v + after) * STEP
                d.v = after
                d.since += STEP * (min(1.0, d.v / 3.0) if d.since < 4 else 1.0)
                d.gone = d.x > 330 or d.north is not None and d.x > 250
            for w in self.walkers:
                self.stride(w)
        self.ego_x += self.ego_v * (self.pace if t >= 0.5 else 1.0) * STEP

    def stride(self, w):
        marked = abs(w.at - self.walk) < 2 or self.effects.get("missing_crosswalk")
        stop = False
        cars = [(d.lateral(), d.x, d.v) for d in self.drivers if d.north is None and not d.gone] + [(LANE * self.ego_lane, self.ego_x, self.ego_v * self.pace)]
        for y, x, v in cars:
            to_zone = y - 2.0 - w.y
            away = w.at - 2.0 - x - 2.25
            if 0 <= to_zone <= 1.2 and x - 2.25 < w.at + 2.0 and v > 1.0:
                need = self.accepted + (0.0 if marked else (y + 2.0 - w.y) / max(w.pace, 0.3))
                stop |= max(away, 0) / v < need
        aim = 0.0 if stop else w.pace
        after = w.v + max(-2.0 * STEP, min(1.0 * STEP, aim - w.v))
        w.y += 0.5 * (w.v + after) * STEP
        w.v = after

    def record(self):
        self.accepted = 2.0 + self.effects.get("gap", 0.0)
        rng, rows, steps = self.rng, [], int(SECS / OUT)
        sub = int(round(OUT / STEP))
        for k in range(steps + 1):
            rows.append((k * OUT, -1, self.ego_x + rng.gauss(0, 0.02), LANE * self.ego_lane + rng.gauss(0, 0.02), rng.gauss(0, 0.002), self.ego_v * (self.pace if k * OUT >= 0.5 else 1.0)))
            seen = [(d.number, *d.place(), d.v) for d in self.drivers if not d.gone] + [(w.number, w.at, w.y, math.pi / 2, w.v) for w in self.walkers]
            for n, x, y, yaw, v in seen:
                if math.hypot(x - self.ego_x, y - LANE * self.ego_lane) < REACH:
                    rows.append((k * OUT, n, x + rng.gauss(0, NOISE[0]), y + rng.gauss(0, NOISE[0]), yaw + rng.gauss(0, NOISE[1]), v + rng.gauss(0, NOISE[2])))
            for j in range(sub):
                self.step(k * OUT + j * STEP, k * sub + j)
        return "t,id,x,y,yaw,v\n" + "\n".join(",".join(f"{c:.4f}" if isinstance(c, float) else str(c) for c in row) for row in rows)

    def scene(self, name):
        ticks = range(int(SECS / OUT) + 1)
        tracks = []
        people = {w.number for w in self.walkers}
        for number, (x, y, yaw), v in self.first:
            if number not in people and yaw == 0.0:
                y = LANE * self.drivers[number].source
            rows = {k: (x + v * math.cos(yaw) * k * OUT, y + v * math.sin(yaw) * k * OUT, yaw, v * math.cos(yaw), v * math.sin(yaw)) for k in ticks}
            kind, size = ("pedestrian", (0.6, 0.6)) if number in people else ("vehicle", (4.5, 1.9))
            tracks.append(track(f"{kind}-{number}", kind, size, rows))
        lanes = [lane(f"east-{k}", [[-250.0, LANE * k], [600.0, LANE * k]]) for k in range(self.lanes)]
        lanes.append(lane("north", [[self.crossing, -300.0], [self.crossing, 300.0]]))
        top = LANE * self.lanes
        crosswalk = [[self.walk - 2, -4.0], [self.walk + 2, -4.0], [self.walk + 2, top + 2], [self.walk - 2, top + 2]]
        start = self.ego_x if not hasattr(self, "accepted") else -20.0
        ego = [(start + self.ego_v * k * OUT, LANE * self.ego_lane, 0.0, self.ego_v) for k in ticks]
        made = scenario(name, tracks, lanes, ego, crosswalks=[crosswalk], source="independent world of traffic")
        made["map"]["stop_lines"] = [{"light": 0, "points_m": [[self.light, -3.0], [self.light, top]]}]
        red = int(round(self.green / OUT))
        made["map"]["traffic_lights"] = [{"x_m": self.light + 10, "y_m": 0.0, "z_m": 5.0, "facing_rad": math.pi, "lanes": [f"east-{k}" for k in range(self.lanes)],
                                          "states": [["red", red], ["green", 1]]}]
        return made


def draw(rng, effect):
    low, high, kind = RANGES[effect]
    size, sign = rng.uniform(low, high), rng.choice((-1, 1))
    return {"+": size, "value": size, "both": sign * size, "log": math.exp(sign * size)}[kind]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--each", type=int, default=2)
    parser.add_argument("--none", type=int, default=8)
    parser.add_argument("--only", default="")
    given = parser.parse_args()
    rng = random.Random(given.seed)
    wanted = [e for e in RANGES for _ in range(given.each)] + [None] * given.none
    labels = {}
    for number, effect in enumerate(wanted):
        effects = {effect: draw(rng, effect)} if effect else {}
        if effect == "pedestrian_behaviour":
            effects["gap"] = rng.uniform(1.0, 3.0)
        if given.only and (effect or "none") not in given.only.split(","):
            continue
        folder = given.out / f"{number:03d}"
        folder.mkdir(parents=True, exist_ok=True)
        recordings = []
        for k in range(8):
            world = World(given.seed * 100_000 + number * 100 + k, effects)
            scene = world.scene(f"recording-{k}")
            (folder / f"{k}.csv").write_text(world.record())
            (folder / f"{k}.scenario.json").write_text(json.dumps(scene))
            recordings.append({"scene": f"{k}.scenario.json", "tracks": f"{k}.csv", "from_secs": 0.5})
        (folder / "meta.json").write_text(json.dumps({"model": "traffic", "recordings": recordings}))
        listed = [{"id": effect, "value": effects[effect]}] if effect else []
        labels[f"{number:03d}"] = {"effects": listed}
    (given.out / "labels.json").write_text(json.dumps(labels, indent=1))


if __name__ == "__main__":
    main()
