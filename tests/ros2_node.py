"""Stands in for zenoh-bridge-ros2dds and a node behind it: hears CDR on Zenoh keys and answers with a nav_msgs/Path.

python ros2_node.py tcp/127.0.0.1:PORT     answers until its input ends, then prints as JSON what it heard
ros2_node.py:Direct                        the same driver as a policy that is connected directly

Messages are read by `rosbags` with the definitions of another distribution than the client writes by.
"""
import json
import sys
import threading

import numpy as np
import zenoh
from rosbags.typesys import Stores, get_typestore

from dreamstream import Policy
from dreamstream.ros2 import heading_rad

AFTER_S = 0.5 * np.arange(1, 9)
STORE = get_typestore(Stores.ROS2_JAZZY)


def way(pixels, speed_mps, command):
    """Returns positions and quaternions of an arc that a picture and a command call for."""
    left, right = np.array_split(pixels.astype(np.float64), 2, axis=1)
    curvature = 1e-3 * (left.mean() - right.mean()) + 0.01 * (int(command == 2) - int(command == 3))
    turned = curvature * speed_mps * AFTER_S
    xy = np.stack([np.sinc(turned / np.pi), 0.5 * turned], axis=1) * (speed_mps * AFTER_S)[:, None]
    return xy, [STORE.types["geometry_msgs/msg/Quaternion"](0.0, 0.0, float(np.sin(a / 2)), float(np.cos(a / 2))) for a in turned]


class Direct(Policy):
    def plan(self, observation):
        xy, turned = way(observation.frames["front"][-1], observation.ego.speed_mps, observation.command.value)
        return np.hstack([xy, [[heading_rad(one)] for one in turned]])


class Node:
    def __init__(self, bus):
        self.bus, self.seen, self.counts, self.times = bus, {}, {}, []

    def hear(self, sample):
        topic = str(sample.key_expr)
        if topic == "dreamstream/plan":
            return
        self.counts[topic] = self.counts.get(topic, 0) + 1
        kind = {"camera_info": "sensor_msgs/msg/CameraInfo", "image_raw": "sensor_msgs/msg/Image", "odom": "nav_msgs/msg/Odometry",
                "accel": "geometry_msgs/msg/AccelStamped", "command": "std_msgs/msg/UInt8", "clock": "rosgraph_msgs/msg/Clock",
                "tf_static": "tf2_msgs/msg/TFMessage"}[topic.rsplit("/")[-1]]
        message = STORE.deserialize_cdr(sample.payload.to_bytes(), kind)
        self.seen[topic] = message
        if topic == "clock":
            self.times.append(message.clock.sec * 10**9 + message.clock.nanosec)
        if topic == "dreamstream/camera/front/image_raw":
            self.answer(message)

    def answer(self, image):
        odom = self.seen["dreamstream/odom"]
        assert (odom.header.stamp, image.encoding, image.step) == (image.header.stamp, "rgb8", 3 * image.width)
        pixels = image.data.reshape(image.height, image.width, 3)
        xy, turned = way(pixels, odom.twist.twist.linear.x, self.seen["dreamstream/command"].data)
        types = STORE.types
        header = lambda ns: types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](ns // 10**9, ns % 10**9), "base_link")
        now_ns = image.header.stamp.sec * 10**9 + image.header.stamp.nanosec
        pose = lambda place, orientation: types["geometry_msgs/msg/Pose"](types["geometry_msgs/msg/Point"](*map(float, place), 0.0), orientation)
        stamped = [types["geometry_msgs/msg/PoseStamped"](header(now_ns + round(1e9 * after)), pose(place, orientation))
                   for after, place, orientation in zip(AFTER_S, xy, turned)]
        path = types["nav_msgs/msg/Path"](header(now_ns), stamped)
        self.bus.put("dreamstream/plan", bytes(STORE.serialize_cdr(path, "nav_msgs/msg/Path")))


def main(endpoint):
    config = zenoh.Config()
    for key, value in (("mode", "router"), ("listen/endpoints", [endpoint]), ("scouting/multicast/enabled", False)):
        config.insert_json5(key, json.dumps(value))
    tokens = set()
    with zenoh.open(config) as bus:
        node = Node(bus)
        # One callback at a time, in the order of arrival, as a node with one executor has them.
        listening = [bus.declare_subscriber(key, node.hear) for key in ("dreamstream/**", "tf_static", "clock")]
        alive = bus.liveliness().declare_subscriber("@/*/@ros2_lv/**", lambda sample: tokens.add(str(sample.key_expr).split("@ros2_lv/")[1]), history=True)
        sys.stdin.read()
        for declared in (*listening, alive):
            declared.undeclare()
    rising = all(one <= other for one, other in zip(node.times, node.times[1:]))
    print(json.dumps({"counts": node.counts, "tokens": sorted(tokens), "clock_rises": rising}))


if __name__ == "__main__":
    main(sys.argv[1])
