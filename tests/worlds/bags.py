"""Writes one drive of a made vehicle as a ROS 2 MCAP, a ROS 1 bag and rosbag2's SQLite file, by the `rosbags` package.

A kinematic vehicle with first-order steering and drive, sensors without bias: what a bag says is known, so that the three can
be compared with each other and with it. `--lean` writes the few topics and rows of the fixtures of `crates/diagnosis/bags/tests`.

    pip install rosbags numpy
    python tests/worlds/bags.py --out BAGS [--secs 60] [--hz 100] [--lean] [--bz2] [--only mcap|bag|db3]
"""

import argparse
import pathlib
import shutil
import sqlite3

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

START_NANOS = 1_700_000_000_123_456_789
LATENCY_NANOS = 4_000_000
BASE_M = 2.7
FIRST_FIX = (48.137, 11.575)
DEGREE_M = (111_203.0, 74_450.0)
EXTRA = {
    "ackermann_msgs/msg/AckermannDrive": "float32 steering_angle\nfloat32 steering_angle_velocity\nfloat32 speed\nfloat32 acceleration\nfloat32 jerk\n",
    "ackermann_msgs/msg/AckermannDriveStamped": "std_msgs/Header header\nackermann_msgs/AckermannDrive drive\n",
    "own_msgs/msg/Wheels": "# of a maker's own\nstd_msgs/Header header\nstring[] names\nfloat32[4] rear_and_front_mps\nbool moving\n",
}


def drive(secs, hz):
    """Returns columns by name, one row a step."""
    count, step = int(round(secs * hz)), 1.0 / hz
    t = np.arange(count) * step
    steer = 0.035 * np.sin(0.61 * t) + 0.02 * np.sin(1.7 * t) * np.sin(0.013 * t)
    accel = 1.1 * np.sin(0.23 * t) + 0.5 * np.sin(0.9 * t + 1.0) * np.cos(0.021 * t)
    angle, pull = np.zeros(count), np.zeros(count)
    x, y, yaw, v = np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(count)
    v[0], yaw[0] = 14.0, 0.4
    for k in range(1, count):
        angle[k] = angle[k - 1] + step / 0.12 * (steer[k - 1] - angle[k - 1])
        pull[k] = pull[k - 1] + step / 0.2 * (accel[k - 1] - pull[k - 1])
        v[k] = max(v[k - 1] + step * pull[k - 1], 0.5)
        yaw[k] = yaw[k - 1] + step * v[k - 1] * np.tan(angle[k - 1]) / BASE_M
        x[k] = x[k - 1] + step * v[k - 1] * np.cos(yaw[k - 1])
        y[k] = y[k - 1] + step * v[k - 1] * np.sin(yaw[k - 1])
    rate = v * np.tan(angle) / BASE_M
    return {"t": t, "steer": steer, "accel": accel, "x": x, "y": y, "yaw": yaw, "v": v, "rate": rate, "ax": pull, "ay": v * rate, "angle": angle}


class Maker:
    """Makes messages of one ROS version."""

    def __init__(self, store, ros1):
        self.store, self.ros1, self.count = store, ros1, 0
        types = {}
        for name, text in EXTRA.items():
            types.update(get_types_from_msg(text, name))
        store.register(types)

    def __call__(self, kind, **fields):
        return self.store.types[kind](**fields)

    def header(self, nanos, frame):
        stamp = self("builtin_interfaces/msg/Time", sec=nanos // 10**9, nanosec=nanos % 10**9)
        more = {"seq": self.count} if self.ros1 else {}
        self.count += 1
        return self("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **more)

    def vector(self, x=0.0, y=0.0, z=0.0, kind="Vector3"):
        return self(f"geometry_msgs/msg/{kind}", x=x, y=y, z=z)

    def heading(self, yaw):
        return self("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=np.sin(yaw / 2), w=np.cos(yaw / 2))


def rows(made, make, lean, hz):
    """Yields topic, type, stamp and message."""
    zeros36, zeros9 = np.zeros(36), np.zeros(9)
    every = max(int(round(hz / 10.0)), 1)
    names = list(made)
    for k, values in enumerate(zip(*(made[name].tolist() for name in names))):
        row = dict(zip(names, values))
        nanos = START_NANOS + int(round(row["t"] * 1e9))
        command = make("ackermann_msgs/msg/AckermannDrive", steering_angle=row["steer"], steering_angle_velocity=0.0, speed=0.0, acceleration=row["accel"], jerk=0.0)
        yield "/cmd", "ackermann_msgs/msg/AckermannDriveStamped", nanos, make("ackermann_msgs/msg/AckermannDriveStamped", header=make.header(nanos, "base"), drive=command)
        pose = make("geometry_msgs/msg/Pose", position=make.vector(row["x"], row["y"], kind="Point"), orientation=make.heading(row["yaw"]))
        twist = make("geometry_msgs/msg/Twist", linear=make.vector(row["v"]), angular=make.vector(z=row["rate"]))
        if lean:
            yield "/pose", "geometry_msgs/msg/PoseStamped", nanos, make("geometry_msgs/msg/PoseStamped", header=make.header(nanos, "map"), pose=pose)
            yield "/twist", "geometry_msgs/msg/TwistStamped", nanos, make("geometry_msgs/msg/TwistStamped", header=make.header(nanos, "base"), twist=twist)
            if k % 4 == 0:
                yield fix(make, nanos, row)
            continue
        yield "/odometry", "nav_msgs/msg/Odometry", nanos, make(
            "nav_msgs/msg/Odometry", header=make.header(nanos, "map"), child_frame_id="base",
            pose=make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=zeros36),
            twist=make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=zeros36),
        )
        yield "/imu", "sensor_msgs/msg/Imu", nanos, make(
            "sensor_msgs/msg/Imu", header=make.header(nanos, "imu"), orientation=make.heading(row["yaw"]), orientation_covariance=zeros9,
            angular_velocity=make.vector(z=row["rate"]), angular_velocity_covariance=zeros9,
            linear_acceleration=make.vector(row["ax"], row["ay"], 9.81), linear_acceleration_covariance=zeros9,
        )
        yield "/vehicle/steering_angle", "std_msgs/msg/Float64", nanos, make("std_msgs/msg/Float64", data=row["angle"])
        if k % every == 0:
            yield fix(make, nanos, row)
            speeds = np.full(4, row["v"], dtype=np.float32)
            yield "/wheels", "own_msgs/msg/Wheels", nanos, make("own_msgs/msg/Wheels", header=make.header(nanos, "base"), names=["rl", "rr", "fl", "fr"], rear_and_front_mps=speeds, moving=True)


def fix(make, nanos, row):
    return "/fix", "sensor_msgs/msg/NavSatFix", nanos, make(
        "sensor_msgs/msg/NavSatFix", header=make.header(nanos, "gps"), status=make("sensor_msgs/msg/NavSatStatus", status=0, service=1),
        latitude=FIRST_FIX[0] + row["y"] / DEGREE_M[0], longitude=FIRST_FIX[1] + row["x"] / DEGREE_M[1], altitude=500.0,
        position_covariance=np.zeros(9), position_covariance_type=0,
    )


def write(bag, connect, make, serialise, made, lean, hz):
    connections = {}
    for topic, kind, nanos, message in rows(made, make, lean, hz):
        if topic not in connections:
            connections[topic] = connect(topic, kind)
        bag.write(connections[topic], nanos + LATENCY_NANOS, serialise(message, kind))


def ros1(path, made, lean, hz, bz2):
    store = get_typestore(Stores.ROS1_NOETIC)
    path.unlink(missing_ok=True)
    bag = rosbag1.Writer(path)
    bag.set_compression(rosbag1.Writer.CompressionFormat.BZ2 if bz2 else rosbag1.Writer.CompressionFormat.LZ4)
    with bag:
        write(bag, lambda topic, kind: bag.add_connection(topic, kind, typestore=store), Maker(store, True), store.serialize_ros1, made, lean, hz)


def ros2(folder, plugin, made, lean, hz):
    store = get_typestore(Stores.ROS2_HUMBLE)
    shutil.rmtree(folder, ignore_errors=True)
    with rosbag2.Writer(folder, version=9, storage_plugin=plugin) as bag:
        write(bag, lambda topic, kind: bag.add_connection(topic, kind, typestore=store), Maker(store, False), store.serialize_cdr, made, lean, hz)
    if lean and plugin is rosbag2.StoragePlugin.SQLITE3:
        base = sqlite3.connect(next(folder.glob("*.db3")))
        base.executescript("PRAGMA page_size = 512; VACUUM;")
        base.close()


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--secs", type=float, default=60.0)
    parser.add_argument("--hz", type=float, default=100.0)
    parser.add_argument("--lean", action="store_true")
    parser.add_argument("--bz2", action="store_true", help="chunks of the ROS 1 bag by bzip2")
    parser.add_argument("--only", choices=("mcap", "bag", "db3"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    made = drive(given.secs, given.hz)
    if given.only in (None, "mcap"):
        ros2(given.out / "ros2_mcap", rosbag2.StoragePlugin.MCAP, made, given.lean, given.hz)
    if given.only in (None, "bag"):
        ros1(given.out / "ros1.bag", made, given.lean, given.hz, given.bz2)
    if given.only in (None, "db3"):
        ros2(given.out / "ros2_sqlite", rosbag2.StoragePlugin.SQLITE3, made, given.lean, given.hz)


if __name__ == "__main__":
    main()
