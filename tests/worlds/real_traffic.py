"""Recorded traffic (CommonRoad NGSIM, nuScenes scenarios, Argoverse 2) as cases for the diagnosis of agents and map.

Each recording becomes a scenario file with its map and logged tracks; a case lists them with the nominal driver. The
scenes of one data set that are kept from the fit are named in `meta.json`; with one scene a third of its agents is kept.

    python tests/worlds/real_traffic.py DATA_DIR --out CASES_DIR
    dreamstream gap diagnose CASES_DIR --out OUT_DIR
"""

import argparse
import csv
import json
import math
import pathlib
import xml.etree.ElementTree as xml

STEP = 0.1
VEHICLE = {"length_m": 4.5, "width_m": 1.9, "height_m": 1.6, "wheel_base_m": 2.7, "rear_axle_to_centre_m": 1.35,
           "max_steering_rad": 0.6, "max_steering_rate_radps": 0.8, "max_acceleration_mps2": 4.0,
           "max_deceleration_mps2": 8.0, "mass_kg": 1600.0}
CAMERA = {"name": "front", "width_px": 160, "height_px": 96, "fx_px": 114.25, "fy_px": 114.25, "cx_px": 80.0, "cy_px": 48.0, "k1": 0.0, "k2": 0.0,
          "x_in_rig_m": 1.5, "y_in_rig_m": 0.0, "z_in_rig_m": 1.6, "yaw_left_rad": 0.0, "pitch_down_rad": 0.05, "roll_rad": 0.0}
NOMINAL = {"headway": 1.4, "min_gap": 2.5, "max_accel": 1.5, "comfort_decel": 2.0, "interactive": True}
CLASSES = {"VEHICLE": "vehicle", "PEDESTRIAN": "pedestrian", "CYCLIST": "cyclist", "TRAFFIC_CONE": "cone", "TRAFFIC_BARRIER": "barrier",
           "vehicle": "vehicle", "bus": "vehicle", "pedestrian": "pedestrian", "cyclist": "cyclist", "motorcyclist": "cyclist",
           "REGULAR_VEHICLE": "vehicle", "LARGE_VEHICLE": "vehicle", "BUS": "vehicle", "BOX_TRUCK": "vehicle", "TRUCK": "vehicle",
           "BICYCLIST": "cyclist", "MOTORCYCLIST": "cyclist", "car": "vehicle", "truck": "vehicle"}


def pieces(ticks):
    """First and last of each unbroken stretch."""
    out = []
    for tick in ticks:
        if out and tick == out[-1][1] + 1:
            out[-1][1] = tick
        else:
            out.append([tick, tick])
    return out


def track(name, kind, size, rows):
    """A track of rows {tick: (x, y, heading, vx, vy)}."""
    ticks = sorted(rows)
    column = lambda k: [round(rows[t][k], 4) for t in ticks]
    return {"name": str(name), "class": kind, "length_m": max(size[0], 0.2), "width_m": max(size[1], 0.2), "height_m": 1.6,
            "valid_ticks": pieces(ticks), "x_m": column(0), "y_m": column(1), "z_m": [0.0], "heading_rad": column(2),
            "vx_mps": column(3), "vy_mps": column(4)}


def lane(name, centre, *, kind="road", successors=(), left=None, right=None):
    return {"name": str(name), "kind": kind, "speed_limit_mps": None, "successors": [str(s) for s in successors], "predecessors": [],
            "left": left, "right": right, "centre_line_m": centre, "polygon_m": []}


def distinct(points):
    out = []
    for p in points:
        if not out or math.dist(out[-1], p) > 0.01:
            out.append([round(p[0], 3), round(p[1], 3)])
    return out


def middle(left, right, count=None):
    """The line half-way between two borders."""
    def sample(line, share):
        lengths = [0.0]
        for a, b in zip(line, line[1:]):
            lengths.append(lengths[-1] + math.dist(a, b))
        at, k = share * lengths[-1], 1
        while k < len(line) - 1 and lengths[k] < at:
            k += 1
        part = (at - lengths[k - 1]) / max(lengths[k] - lengths[k - 1], 1e-9)
        return [line[k - 1][d] + part * (line[k][d] - line[k - 1][d]) for d in (0, 1)]

    n = count or max(len(left), len(right), 2)
    pairs = [(sample(left, k / (n - 1)), sample(right, k / (n - 1))) for k in range(n)]
    return distinct([[(a[0] + b[0]) / 2, (a[1] + b[1]) / 2] for a, b in pairs])


def scenario(name, tracks, lanes, ego, *, crosswalks=(), source=""):
    """`ego`: one (x, y, heading, speed) of the centre per tick."""
    shift = VEHICLE["rear_axle_to_centre_m"]
    column = lambda values: [round(v, 4) for v in values]
    count = len(ego)
    log = {"x_m": column(e[0] - shift * math.cos(e[2]) for e in ego), "y_m": column(e[1] - shift * math.sin(e[2]) for e in ego),
           "heading_rad": column(e[2] for e in ego), "forward_mps": column(e[3] for e in ego)}
    log |= {key: [0.0] * count for key in ("left_mps", "yaw_rate_radps", "forward_mps2", "left_mps2", "steering_rad", "steering_rate_radps")}
    route = distinct([(e[0], e[1]) for e in ego])
    last = ego[-1]
    route.append([round(last[0] + 30 * math.cos(last[2]), 3), round(last[1] + 30 * math.sin(last[2]), 3)])
    known = {one["name"] for one in lanes}
    for one in lanes:
        one["successors"] = [s for s in one["successors"] if s in known and s != one["name"]]
    by_name = {one["name"]: one for one in lanes}
    for one in lanes:
        for s in one["successors"]:
            by_name[s]["predecessors"].append(one["name"])
    return {"format": "dreamstream-scenario", "version": 1, "name": name, "family": "", "prompt": "recorded traffic",
            "origin": {"source": source, "licence": "see source", "attribution": source}, "frame": "x-east y-north z-up", "dt_secs": STEP,
            "vehicle": VEHICLE, "cameras": [CAMERA], "ego_log": log, "route_m": route, "tracks": tracks,
            "map": {"lanes": lanes, "junctions_m": [], "drivable_m": [], "road_edges_m": [], "lane_lines": [],
                    "crosswalks_m": list(crosswalks), "stop_lines": [], "traffic_lights": []}}


def ngsim(path):
    root = xml.parse(path).getroot()
    exact = lambda node, where: float(node.find(f"{where}/exact").text)
    point = lambda p: [float(p.find("x").text), float(p.find("y").text)]
    tracks, last = [], 0
    for obstacle in [o for tag in ("dynamicObstacle", "obstacle") for o in root.iter(tag)]:
        shape = obstacle.find("shape/rectangle")
        states = [obstacle.find("initialState")] + obstacle.findall("trajectory/state")
        if shape is None or any(s is None for s in states) or len(states) < 20:
            continue
        rows = {}
        for s in states:
            spot, yaw, v = point(s.find("position/point")), exact(s, "orientation"), exact(s, "velocity")
            rows[int(float(s.find("time/exact").text))] = (*spot, yaw, v * math.cos(yaw), v * math.sin(yaw))
        last = max(last, *rows)
        size = (float(shape.find("length").text), float(shape.find("width").text))
        tracks.append(track(obstacle.get("id"), CLASSES.get(obstacle.findtext("type", "car"), "vehicle"), size, rows))
    lanes = []
    for one in root.iter("lanelet"):
        centre = middle(*[[point(p) for p in one.findall(f"{side}Bound/point")] for side in ("left", "right")])
        if len(centre) > 1:
            lanes.append(lane(one.get("id"), centre, successors=[s.get("ref") for s in one.findall("successor")]))
    away = [(3000.0, 3000.0, 0.0, 0.0)] * (last + 1)
    yield scenario(path.stem, tracks, lanes, away, source="NGSIM (US DOT) through CommonRoad")


def nuscenes(path):
    data = json.loads(path.read_text())
    tracks, ego = [], None
    for one in data["tracks"]:
        rows = {s: v for s, v in zip(one["steps"], zip(one["x"], one["y"], one["heading"], one["vx"], one["vy"]))}
        if one["id"] == data["ego_id"]:
            ego = [(r[0], r[1], r[2], r[3] * math.cos(r[2]) + r[4] * math.sin(r[2])) for _, r in sorted(rows.items())]
        elif one["type"] in CLASSES and len(rows) > 1:
            tracks.append(track(f"{one['id'][:24]}", CLASSES[one["type"]], (one["length"], one["width"]), rows))
    lanes = [lane(f["id"], distinct(f["polyline"])) for f in data["map_features"] if f["type"].startswith("LANE") and len(distinct(f["polyline"])) > 1]
    ends = {}
    for one in lanes:
        ends.setdefault(tuple(round(c) for c in one["centre_line_m"][0]), []).append(one["name"])
    for one in lanes:
        one["successors"] = ends.get(tuple(round(c) for c in one["centre_line_m"][-1]), [])
    yield scenario(path.stem, tracks, lanes, ego, source="nuScenes v1.0-mini (Motional), CC BY-NC-SA 4.0")


def argoverse_map(folder, near):
    data = json.loads((folder / "log_map_archive.json").read_text())
    flat = lambda line: [[p["x"] - near[0], p["y"] - near[1]] for p in line]
    lanes = []
    for one in data["lane_segments"].values():
        centre = middle(flat(one["left_lane_boundary"]), flat(one["right_lane_boundary"]), 12)
        if one.get("lane_type", "VEHICLE") != "BIKE" and len(centre) > 1:
            kind = "connector" if one.get("is_intersection") else "road"
            lanes.append(lane(one["id"], centre, kind=kind, successors=one["successors"]))
    crossings = [flat(c["edge1"]) + flat(c["edge2"])[::-1] for c in data["pedestrian_crossings"].values()]
    return lanes, crossings


def forecasting(folder):
    with open(folder / "scenario.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    av = [r for r in rows if r["track_id"] == "AV"]
    near = (float(av[0]["position_x"]), float(av[0]["position_y"]))
    found, kinds = {}, {}
    for r in rows:
        state = tuple(float(r[k]) for k in ("heading", "velocity_x", "velocity_y"))
        spot = (float(r["position_x"]) - near[0], float(r["position_y"]) - near[1])
        found.setdefault(r["track_id"], {})[int(r["timestep"])] = (*spot, *state)
        kinds[r["track_id"]] = r["object_type"]
    sizes = {"vehicle": (4.5, 1.9), "pedestrian": (0.7, 0.7), "cyclist": (1.8, 0.7)}
    ego = [(r[0], r[1], r[2], math.hypot(r[3], r[4])) for _, r in sorted(found.pop("AV").items())]
    tracks = [track(n, CLASSES[kinds[n]], sizes[CLASSES[kinds[n]]], rows) for n, rows in found.items() if kinds[n] in CLASSES and len(rows) > 1]
    lanes, crossings = argoverse_map(folder, near)
    yield scenario("argoverse-forecasting", tracks, lanes, ego, crosswalks=crossings, source="Argoverse 2, CC BY-NC-SA 4.0")


def sensor_log(folder):
    yaw_of = lambda r: math.atan2(2 * (r[0] * r[3] + r[1] * r[2]), 1 - 2 * (r[2] ** 2 + r[3] ** 2))
    with open(folder / "city_SE3_egovehicle.csv", encoding="utf-8") as file:
        poses = sorted((int(r["timestamp_ns"]), *(float(r[k]) for k in ("qw", "qx", "qy", "qz", "tx_m", "ty_m"))) for r in csv.DictReader(file))
    with open(folder / "annotations.csv", encoding="utf-8") as file:
        boxes = list(csv.DictReader(file))
    near = poses[0][5:7]
    stamps = sorted({int(b["timestamp_ns"]) for b in boxes})
    at = {}
    for stamp in stamps:
        pose = min(poses, key=lambda p: abs(p[0] - stamp))
        at[stamp] = (pose[5] - near[0], pose[6] - near[1], yaw_of(pose[1:5]))
    tick_of = {stamp: k for k, stamp in enumerate(stamps)}
    found, kinds = {}, {}
    for b in boxes:
        stamp = int(b["timestamp_ns"])
        x0, y0, yaw = at[stamp]
        x, y = float(b["tx_m"]), float(b["ty_m"])
        heading = yaw + yaw_of([float(b[k]) for k in ("qw", "qx", "qy", "qz")])
        spot = (x0 + x * math.cos(yaw) - y * math.sin(yaw), y0 + x * math.sin(yaw) + y * math.cos(yaw))
        found.setdefault(b["track_uuid"], {})[tick_of[stamp]] = (*spot, math.atan2(math.sin(heading), math.cos(heading)))
        kinds[b["track_uuid"]] = (b["category"], float(b["length_m"]), float(b["width_m"]))
    tracks = []
    for name, rows in found.items():
        category, length, width = kinds[name]
        if category not in CLASSES and category != "PEDESTRIAN" or len(rows) < 5:
            continue
        full = {}
        for t, (x, y, heading) in rows.items():
            a, b = max((k for k in rows if k <= t - 2), default=min(rows)), min((k for k in rows if k >= t + 2), default=max(rows))
            span = STEP * max(b - a, 1)
            full[t] = (x, y, heading, (rows[b][0] - rows[a][0]) / span, (rows[b][1] - rows[a][1]) / span)
        tracks.append(track(name[:24], CLASSES.get(category, "pedestrian"), (length, width), full))
    ego = []
    shift = VEHICLE["rear_axle_to_centre_m"]
    for k, stamp in enumerate(stamps):
        x, y, yaw = at[stamp]
        before, after = at[stamps[max(k - 2, 0)]], at[stamps[min(k + 2, len(stamps) - 1)]]
        speed = math.dist(before[:2], after[:2]) / (STEP * (min(k + 2, len(stamps) - 1) - max(k - 2, 0)))
        ego.append((x + shift * math.cos(yaw), y + shift * math.sin(yaw), yaw, speed))
    lanes, crossings = argoverse_map(folder, near)
    yield scenario("argoverse-sensor", tracks, lanes, ego, crosswalks=crossings, source="Argoverse 2, CC BY-NC-SA 4.0")


def write(folder, scenes, desired, held_out):
    folder.mkdir(parents=True, exist_ok=True)
    recordings, scenes = [], list(scenes)
    for scene in scenes:
        (folder / f"{scene['name']}.scenario.json").write_text(json.dumps(scene))
        recordings.append({"scene": f"{scene['name']}.scenario.json"})
    meta = {"case": folder.name, "model": "traffic", "recordings": recordings, "nominal": {**NOMINAL, "desired_speed": desired},
            "suggested_split": {"held_out": held_out}}
    (folder / "meta.json").write_text(json.dumps(meta, indent=1))
    print(folder.name, [(s["name"], len(s["tracks"])) for s in scenes])


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    given = parser.parse_args()
    data = given.data
    for name, desired in (("USA_US101-4_1_T-1", 29.0), ("USA_Lanker-1_1_T-1", 15.6)):
        write(given.out / name, ngsim(data / "commonroad-ngsim" / f"{name}.xml"), desired, [])
    scenes = [s for path in sorted((data / "nuscenes-mini-scenarios").glob("scene-*.json")) for s in nuscenes(path)]
    write(given.out / "nuscenes", scenes, 14.0, [1, 4])
    scenes = [*forecasting(data / "argoverse2" / "forecasting-0a1e6f0a"), *sensor_log(data / "argoverse2" / "sensor-log-adcf7d18")]
    write(given.out / "argoverse", scenes, 14.0, [])


if __name__ == "__main__":
    main()
