"""What a ROS 2 node is told, and how its path is read. Whole drives are tested in tests/python_policy.rs."""

import struct
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags")
sys.path.insert(0, str(Path(__file__).parent))
import observed
from dreamstream import PlanError, messages, ros2
from dreamstream._wire.dreamstream_policy.v1 import policy_pb2 as wire
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)


def heard(sent):
    return {one.topic: STORE.deserialize_cdr(one.data, one.kind) for one in sent}


def test_bytes_are_those_of_cdr():
    """Written from the specification of CDR: a header, then fields aligned to their size, counted after the header."""
    seen = messages.observation(observed.observation())
    sent = {one.topic: one.data for one in ros2.observation(seen, start_ns=7 * 10**9, after_ns=0)}
    assert sent["clock"] == b"\x00\x01\x00\x00" + struct.pack("<iI", 7, 0)
    assert sent["dreamstream/command"] == b"\x00\x01\x00\x00\x02"
    frame = b"\x0e\x00\x00\x00front_optical\x00"
    head = struct.pack("<iI", 7, 0) + frame
    head += b"\x00" * (-len(head) % 4) + struct.pack("<II", observed.HEIGHT_PX, observed.WIDTH_PX) + b"\x05\x00\x00\x00rgb8\x00\x00"
    head += b"\x00" * (-len(head) % 4) + struct.pack("<II", 3 * observed.WIDTH_PX, 3 * observed.WIDTH_PX * observed.HEIGHT_PX)
    assert sent["dreamstream/camera/front/image_raw"] == b"\x00\x01\x00\x00" + head + observed.picture(0).tobytes()


def test_each_topic_says_what_the_car_knows():
    ego = wire.Ego(time_ns=10**8, pose=wire.Pose(x_m=3.0, y_m=-1.0, heading_rad=2.0), velocity_x_mps=5.0, velocity_y_mps=0.25,
                   yaw_rate_radps=0.5, acceleration_x_mps2=-1.0, acceleration_y_mps2=2.5)
    images = [wire.Image(time_ns=10**8, width_px=observed.WIDTH_PX, height_px=observed.HEIGHT_PX, encoding=wire.ENCODING_RAW,
                         data=observed.picture(1).tobytes())]
    view = wire.CameraView(calibration=observed.calibration("front-left"), images=images)
    seen = messages.observation(observed.observation(ego=[ego], cameras=[view]))
    sent = list(ros2.observation(seen, start_ns=10**9, after_ns=0))
    assert sent[0].topic == "clock" and sent[-1].topic == "dreamstream/camera/front_left/image_raw"
    told = heard([*sent, ros2.static_transforms(list(seen.cameras.values()), time_ns=10**9)])
    odom, accel = told["dreamstream/odom"], told["dreamstream/accel"]
    assert (odom.header.stamp.sec, odom.header.stamp.nanosec, odom.header.frame_id, odom.child_frame_id) == (1, 10**8, "odom", "base_link")
    assert (odom.pose.pose.position.x, odom.pose.pose.position.y) == (3.0, -1.0)
    assert ros2.heading_rad(odom.pose.pose.orientation) == pytest.approx(2.0, abs=1e-15)
    assert (odom.twist.twist.linear.x, odom.twist.twist.linear.y, odom.twist.twist.angular.z) == (5.0, 0.25, 0.5)
    assert (accel.header.frame_id, accel.accel.linear.x, accel.accel.linear.y) == ("base_link", -1.0, 2.5)
    info = told["dreamstream/camera/front_left/camera_info"]
    assert info.k.tolist() == [11.4, 0, 8.0, 0, 11.4, 4.5, 0, 0, 1] and info.p.tolist()[:4] == [11.4, 0, 8.0, 0]
    assert (info.header.frame_id, info.distortion_model, len(info.d)) == ("front_left_optical", "plumb_bob", 5)
    (mounted,) = told["tf_static"].transforms
    assert (mounted.header.frame_id, mounted.child_frame_id) == ("base_link", "front_left_optical")
    assert (mounted.transform.translation.z, mounted.transform.rotation.y) == (1.6, 0.5)


def test_only_what_is_new_is_told():
    images = [wire.Image(time_ns=k * 10**8, width_px=observed.WIDTH_PX, height_px=observed.HEIGHT_PX, encoding=wire.ENCODING_RAW,
                         data=observed.picture(k).tobytes()) for k in range(4)]
    ego = [wire.Ego(time_ns=k * 10**8, pose=wire.Pose(x_m=0.0, y_m=0.0, heading_rad=0.0)) for k in range(4)]
    view = wire.CameraView(calibration=observed.calibration(), images=images)
    seen = messages.observation(observed.observation(ego=ego, cameras=[view]))
    sent = list(ros2.observation(seen, start_ns=0, after_ns=10**8))
    assert [one.topic for one in sent].count("dreamstream/camera/front/image_raw") == 2
    clocks = [STORE.deserialize_cdr(one.data, one.kind).clock.nanosec for one in sent if one.topic == "clock"]
    assert clocks == [2 * 10**8, 3 * 10**8]


def path(*, second=7, frame="base_link", quaternion=(0.0, 0.0, np.sin(0.1), np.cos(0.1))):
    """The CDR bytes of a nav_msgs/Path of one pose, half a second after 7.25 s, written from the specification."""
    aligned = lambda data, size: data + b"\x00" * (-len(data) % size)
    text = lambda word: struct.pack("<I", len(word) + 1) + word.encode() + b"\x00"
    data = aligned(struct.pack("<iI", second, 250_000_000) + text(frame), 4) + struct.pack("<I", 1)
    data = aligned(data + struct.pack("<iI", 7, 750_000_000) + text(frame), 8)
    return b"\x00\x01\x00\x00" + data + struct.pack("<7d", 4.0, -0.5, 0.0, *quaternion)


def test_a_path_becomes_a_plan():
    read = ros2._STORE.deserialize_cdr(path(), "nav_msgs/msg/Path")
    plan = ros2.plan(read, now_ns=7_250_000_000)
    assert plan.times_s.tolist() == [0.5] and plan.poses[0, :2].tolist() == [4.0, -0.5]
    assert plan.poses[0, 2] == pytest.approx(0.2, abs=1e-15)


class Bus:
    """A bus whose node answers when it is told an image for the second time, first for another moment."""

    def __init__(self):
        self.told, self.tokens = [], []

    def declare_subscriber(self, key, callback):
        self.answer = callback
        return self

    def liveliness(self):
        return self

    def declare_token(self, key):
        self.tokens.append(key)
        return self

    def zid(self):
        return "5f1d"

    def undeclare(self):
        pass

    def put(self, key, data):
        self.told.append((key, data))
        if [key for key, _ in self.told].count("dreamstream/command") == 2 and key.endswith("image_raw"):
            for payload in (path(second=6), path()):
                self.answer(type("Sample", (), {"payload": type("Payload", (), {"to_bytes": lambda self: payload})()}))


def test_what_is_not_answered_is_told_again_and_the_clock_does_not_go_back():
    images = [wire.Image(time_ns=k * 10**8, width_px=observed.WIDTH_PX, height_px=observed.HEIGHT_PX, encoding=wire.ENCODING_RAW,
                         data=observed.picture(k).tobytes()) for k in range(3)]
    view = wire.CameraView(calibration=observed.calibration(), images=images)
    seen = messages.observation(observed.observation(cameras=[view]))
    bus = Bus()
    ros = ros2.Ros(bus, repeat_s=0.05)
    sent = list(ros2.observation(seen, start_ns=7 * 10**9, after_ns=0))
    ros.mount(list(seen.cameras.values()), time_ns=7 * 10**9)
    found = ros.ask(sent, stamp_ns=7_250_000_000, within_s=20.0)
    assert found.header.stamp.nanosec == 250_000_000
    clocks = [STORE.deserialize_cdr(data, "rosgraph_msgs/msg/Clock").clock.nanosec for key, data in bus.told if key == "clock"]
    assert clocks == [0, 10**8, 2 * 10**8, 2 * 10**8]
    keys = [key for key, _ in bus.told]
    assert keys[0] == "tf_static" and keys.count("tf_static") >= 2
    with pytest.raises(TimeoutError, match="stamped 9.000000000 s .* the last one is stamped 7.250000000 s"):
        ros.ask([], stamp_ns=9 * 10**9, within_s=0.1)
    ros.close()
    assert "@/5f1d/@ros2_lv/MS/dreamstream§plan/nav_msgs§msg§Path/:1:0:0,10" in bus.tokens


@pytest.mark.parametrize("changes, says", [({"frame": "map"}, '"map"'.replace('"', "'")), ({"quaternion": (0.0, 0.0, 0.0, 0.0)}, "length 0")])
def test_a_path_in_another_frame_or_without_direction_is_named(changes, says):
    with pytest.raises(PlanError) as refused:
        ros2.plan(ros2._STORE.deserialize_cdr(path(**changes), "nav_msgs/msg/Path"), now_ns=0)
    assert says in str(refused.value)
