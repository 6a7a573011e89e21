"""Other road users of the Python world: recorded ones, and drivers of the intelligent driver model on their recorded path.

Own code, no crate: a driver takes over from the recording where the run asks for it (behind the ego, or everyone who
moves), looks for the nearest box ahead in its corridor, and brakes for it. Also the ego's contacts, by separating axes.
"""

import numpy as np

from dreamstream import stage

LOG_REPLAY, BEHIND_EGO, ALL = 1, 2, 3
DRIVERS = (1, 3)  # vehicles and cyclists
HEADWAY, GAP, MOST, COMFORT, HARDEST = 1.5, 1.0, 1.0, 2.0, 8.0
REACH, SIDE_MARGIN = 100.0, 0.2


def wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


class Path:
    """The recorded way of a road user, by distance; the last direction goes on beyond its end."""

    def __init__(self, ticks):
        seen = [tick.seen for tick in ticks if tick.HasField("seen")]
        points = np.array([(s.pose.x_m, s.pose.y_m, s.pose.heading_rad, np.hypot(s.velocity_mps.x, s.velocity_mps.y)) for s in seen])
        kept = [0]
        for k in range(1, len(points)):
            if np.hypot(*(points[k, :2] - points[kept[-1], :2])) >= 0.3:
                kept.append(k)
        self.points = points[kept] if len(points) else np.zeros((0, 4))
        self.along = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(self.points[:, :2], axis=0).T))]) if len(kept) > 1 else np.zeros(1)
        self.drivable = self.along[-1] >= 5.0 and len(self.points) > 2

    def at(self, along):
        """Returns x, y, heading and the desired speed at a distance."""
        x, y = (np.interp(along, self.along, self.points[:, i]) for i in (0, 1))
        heading = float(np.interp(along, self.along, np.unwrap(self.points[:, 2])))
        beyond = max(along - self.along[-1], 0.0)
        near = self.points[np.abs(self.along - along) <= 20.0, 3]
        desired = max(3.0, float(near.max()) if near.size else float(self.points[-1, 3]))
        return float(x) + beyond * np.cos(heading), float(y) + beyond * np.sin(heading), heading, desired

    def nearest(self, x, y):
        offsets = self.points[:, :2] - (x, y)
        return float(self.along[int(np.argmin((offsets**2).sum(axis=1)))])


class Traffic:
    """All road users but the ego."""

    def __init__(self, scenario, mode):
        self.tracks, self.mode = scenario.tracks, mode or BEHIND_EGO
        self.paths = [Path(track.ticks) if track.agent_class in DRIVERS else None for track in self.tracks]

    def start(self):
        self.driven = {}  # index: [along, speed]

    def snapshot(self):
        return {str(index): state for index, state in self.driven.items()}

    def restore(self, driven):
        self.driven = {int(index): list(state) for index, state in driven.items()}

    def place(self, index, tick):
        """Returns x, y, heading, speed of a road user, or nothing where it is not there."""
        if index in self.driven:
            along, speed = self.driven[index]
            x, y, heading, _ = self.paths[index].at(along)
            return x, y, heading, speed
        ticks = self.tracks[index].ticks
        if tick >= len(ticks) or not ticks[tick].HasField("seen"):
            return None
        seen = ticks[tick].seen
        return seen.pose.x_m, seen.pose.y_m, seen.pose.heading_rad, float(np.hypot(seen.velocity_mps.x, seen.velocity_mps.y))

    def advance(self, tick, rig, speed, vehicle, dt):
        """Moves the drivers one tick on; `rig` and `speed` are the ego's."""
        if self.mode == LOG_REPLAY:
            return
        places = {index: self.place(index, tick) for index in range(len(self.tracks))}
        cos, sin = np.cos(rig[2]), np.sin(rig[2])
        for index, place in places.items():
            if place is None or index in self.driven or not (self.paths[index] and self.paths[index].drivable):
                continue
            ahead = (place[0] - rig[0]) * cos + (place[1] - rig[1]) * sin
            behind = ahead < 0 and np.hypot(place[0] - rig[0], place[1] - rig[1]) < REACH and np.cos(place[2] - rig[2]) > 0
            if self.mode == ALL or behind:
                self.driven[index] = [self.paths[index].nearest(place[0], place[1]), place[3]]
        arm = vehicle.rear_axle_to_centre_m
        ego = (rig[0] + arm * cos, rig[1] + arm * sin, rig[2], speed, vehicle.size.length_m, vehicle.size.width_m)
        others = [ego] + [(*place, self.tracks[i].size.length_m, self.tracks[i].size.width_m) for i, place in places.items() if place]
        moved = {index: self.drive(index, others, dt) for index in self.driven}
        self.driven.update(moved)

    def drive(self, index, others, dt):
        along, speed = self.driven[index]
        x, y, heading, desired = self.paths[index].at(along)
        size = self.tracks[index].size
        cos, sin = np.cos(heading), np.sin(heading)
        gap, lead = None, 0.0
        for ox, oy, oheading, ospeed, length, width in others:
            ahead, aside = (ox - x) * cos + (oy - y) * sin, -(ox - x) * sin + (oy - y) * cos
            if 0.1 < ahead < 10 + 4 * speed and abs(aside) < 0.5 * (width + size.width_m) + SIDE_MARGIN:
                room = ahead - 0.5 * (length + size.length_m)
                if gap is None or room < gap:
                    gap, lead = room, ospeed * np.cos(oheading - heading)
        free = MOST * (1 - (speed / desired) ** 4)
        brake = 0.0
        if gap is not None:
            wish = GAP + max(0.0, speed * HEADWAY + speed * (speed - lead) / (2 * np.sqrt(MOST * COMFORT)))
            brake = MOST * (wish / max(gap, 0.05)) ** 2
        after = max(speed + dt * float(np.clip(free - brake, -HARDEST, MOST)), 0.0)
        return [along + 0.5 * (speed + after) * dt, after]

    def show(self, tick):
        """Yields the road users that are there as messages, in the order of their ids."""
        for index, track in enumerate(self.tracks):
            place = self.place(index, tick)
            if place is None:
                continue
            x, y, heading, speed = place
            agent = stage.PB["AgentState"](id=index, agent_class=track.agent_class, size=track.size, z_m=0.0)
            agent.pose.x_m, agent.pose.y_m, agent.pose.heading_rad = x, y, float(wrap(heading))
            if index in self.driven:
                agent.velocity_mps.x, agent.velocity_mps.y = speed * np.cos(heading), speed * np.sin(heading)
            else:
                agent.velocity_mps.CopyFrom(track.ticks[tick].seen.velocity_mps)
                agent.z_m = track.ticks[tick].seen.z_m
            yield agent


def corners(x, y, heading, length, width):
    cos, sin = np.cos(heading), np.sin(heading)
    half = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)]) * (0.5 * length, 0.5 * width)
    return np.column_stack([x + cos * half[:, 0] - sin * half[:, 1], y + sin * half[:, 0] + cos * half[:, 1]])


def overlap(a, b):
    """Says whether two convex quadrilaterals meet."""
    for shape in (a, b):
        for k in range(4):
            edge = shape[(k + 1) % 4] - shape[k]
            axis = np.array([-edge[1], edge[0]])
            pa, pb = a @ axis, b @ axis
            if pa.max() < pb.min() or pb.max() < pa.min():
                return False
    return True


def contacts(ego, vehicle, agents):
    """Yields the touches of the ego: rear, front or side, and whose fault it is."""
    arm, heading = vehicle.rear_axle_to_centre_m, ego.pose.heading_rad
    cos, sin = np.cos(heading), np.sin(heading)
    body = corners(ego.pose.x_m + arm * cos, ego.pose.y_m + arm * sin, heading, vehicle.size.length_m, vehicle.size.width_m)
    for agent in agents:
        dx, dy = agent.pose.x_m - ego.pose.x_m, agent.pose.y_m - ego.pose.y_m
        if np.hypot(dx, dy) > vehicle.size.length_m + 0.5 * np.hypot(agent.size.length_m, agent.size.width_m):
            continue
        box = corners(agent.pose.x_m, agent.pose.y_m, agent.pose.heading_rad, agent.size.length_m, agent.size.width_m)
        if agent.z_m > vehicle.size.height_m or not overlap(body, box):
            continue
        ahead = (dx * cos + dy * sin) / max(np.hypot(dx, dy), 1e-9)
        front = overlap(np.array([body[0], body[1], body[1], body[0]]) + 1e-6 * np.array([(cos, sin)] * 2 + [(-cos, -sin)] * 2), box)
        kind = 3 if ahead < -np.cos(np.pi / 6) else 1 if front else 2
        speed = np.hypot(ego.velocity_mps.x, ego.velocity_mps.y)
        standing = np.hypot(agent.velocity_mps.x, agent.velocity_mps.y) <= 0.05 or agent.agent_class in (4, 5)
        closing = ego.velocity_mps.x - (agent.velocity_mps.x * cos + agent.velocity_mps.y * sin)
        yield stage.PB["Contact"](agent=agent.id, kind=kind, at_fault=bool(speed > 0.05 and (standing or kind == 1)),
                                  closing_speed_mps=max(closing if kind == 1 else -closing if kind == 3 else 0.0, 0.0))
