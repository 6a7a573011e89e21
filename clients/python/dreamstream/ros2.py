"""`python -m dreamstream.ros2` lets a ROS 2 node drive: it is a guest of DreamStream and speaks CDR on Zenoh keys.

Between those keys and ROS 2 stands `zenoh-bridge-ros2dds`. Told under `/dreamstream`: `camera/ID/image_raw` (rgb8),
`camera/ID/camera_info`, `odom`, `accel`, `command` (1 straight, 2 left, 3 right); besides `/clock`, and `/tf_static`
each second and before each observation. The answer comes on `plan`: a `nav_msgs/Path` in `base_link` with the header
stamp of the newest image; its poses carry their own times. `base_link` is the rig (x forward, y left, on the ground
under the rear axle), `odom` the rig at the session's start, `ID_optical` a camera (x right, y down, z forward). Time
never goes back: a later session begins at the next full second. An observation that is not answered is told again.
Needs `pip install 'dreamstream[ros2]'`.
"""

from __future__ import annotations

import argparse
import logging
import queue
import re
import sys
import threading
import time
from dataclasses import dataclass
from typing import Any, Iterator, Optional, Sequence

import numpy as np

try:
    from rosbags.typesys import Stores, get_typestore
except ImportError as error:
    raise ImportError("ROS 2 messages need rosbags: pip install 'dreamstream[ros2]'") from error

from .bridge import opened, run
from .policy import Camera, Ego, Observation, Plan, PlanError, Policy, Session

#: All topics but `/tf_static` and `/clock` stand under this name.
SPACE = "dreamstream"
SECOND_NS = 1_000_000_000
_NS = 1e-9
_STORE = get_typestore(Stores.ROS2_HUMBLE)
_log = logging.getLogger("dreamstream")

#: Reliability, durability, history and depth as the bridge writes them: reliable, the last ten.
QOS = ":1:0:0,10"
#: The same for `/tf_static`: kept for late joiners, the last one.
QOS_KEPT = ":1:1:0,1"


@dataclass(frozen=True)
class CdrMessage:
    """A message as it leaves: a topic's name without leading slash, its type, and CDR bytes."""

    topic: str
    kind: str
    data: bytes


def told(topic: str, message: Any) -> CdrMessage:
    """Serialises a message of `rosbags`, little-endian with its four bytes of header."""
    return CdrMessage(topic, message.__msgtype__, bytes(_STORE.serialize_cdr(message, message.__msgtype__)))


def word(camera: str) -> str:
    """Returns a camera's name as ROS allows it in a topic."""
    plain = re.sub(r"[^A-Za-z0-9_]", "_", camera)
    return plain if not plain[0].isdigit() else f"_{plain}"


def _make(kind: str, **fields: Any) -> Any:
    return _STORE.types[kind](**fields)


def _stamp(time_ns: int) -> Any:
    return _make("builtin_interfaces/msg/Time", sec=time_ns // SECOND_NS, nanosec=time_ns % SECOND_NS)


def _header(time_ns: int, frame: str) -> Any:
    return _make("std_msgs/msg/Header", stamp=_stamp(time_ns), frame_id=frame)


def _vector(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
    return _make("geometry_msgs/msg/Vector3", x=float(x), y=float(y), z=float(z))


def _quaternion(x: float, y: float, z: float, w: float) -> Any:
    return _make("geometry_msgs/msg/Quaternion", x=float(x), y=float(y), z=float(z), w=float(w))


def static_transforms(cameras: Sequence[Camera], *, time_ns: int) -> CdrMessage:
    """Tells where each camera is mounted."""
    transforms = [
        _make(
            "geometry_msgs/msg/TransformStamped",
            header=_header(time_ns, "base_link"),
            child_frame_id=f"{word(camera.name)}_optical",
            transform=_make(
                "geometry_msgs/msg/Transform",
                translation=_vector(*camera.position_in_rig_m),
                rotation=_quaternion(*camera.rig_from_camera),
            ),
        )
        for camera in cameras
    ]
    return told("tf_static", _make("tf2_msgs/msg/TFMessage", transforms=transforms))


def motion(ego: Ego, *, time_ns: int) -> list[CdrMessage]:
    """Tells pose, velocity and acceleration of the car."""
    half = 0.5 * ego.heading_rad
    point = _make("geometry_msgs/msg/Point", x=ego.x_m, y=ego.y_m, z=0.0)
    pose = _make("geometry_msgs/msg/Pose", position=point, orientation=_quaternion(0, 0, np.sin(half), np.cos(half)))
    twist = _make(
        "geometry_msgs/msg/Twist",
        linear=_vector(ego.velocity_x_mps, ego.velocity_y_mps),
        angular=_vector(z=ego.yaw_rate_radps),
    )
    accel = _make(
        "geometry_msgs/msg/Accel", linear=_vector(ego.acceleration_x_mps2, ego.acceleration_y_mps2), angular=_vector()
    )
    unknown = np.zeros(36)
    odometry = _make(
        "nav_msgs/msg/Odometry",
        header=_header(time_ns, "odom"),
        child_frame_id="base_link",
        pose=_make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=unknown),
        twist=_make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=unknown),
    )
    accelerated = _make("geometry_msgs/msg/AccelStamped", header=_header(time_ns, "base_link"), accel=accel)
    return [told(f"{SPACE}/odom", odometry), told(f"{SPACE}/accel", accelerated)]


def picture(camera: Camera, pixels: np.ndarray, *, time_ns: int) -> list[CdrMessage]:
    """Tells one image with its calibration."""
    height, width = pixels.shape[:2]
    header = _header(time_ns, f"{word(camera.name)}_optical")
    matrix = camera.intrinsics
    region = _make("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    info = _make(
        "sensor_msgs/msg/CameraInfo",
        header=header,
        height=height,
        width=width,
        distortion_model="plumb_bob",
        d=np.array([camera.k1, camera.k2, 0.0, 0.0, 0.0]),
        k=matrix.ravel(),
        r=np.eye(3).ravel(),
        p=np.hstack([matrix, np.zeros((3, 1))]).ravel(),
        binning_x=0,
        binning_y=0,
        roi=region,
    )
    rows = np.ascontiguousarray(pixels).reshape(-1)
    image = _make(
        "sensor_msgs/msg/Image",
        header=header,
        height=height,
        width=width,
        encoding="rgb8",
        is_bigendian=0,
        step=3 * width,
        data=rows,
    )
    space = f"{SPACE}/camera/{word(camera.name)}"
    return [told(f"{space}/camera_info", info), told(f"{space}/image_raw", image)]


def observation(seen: Observation, *, start_ns: int, after_ns: int) -> Iterator[CdrMessage]:
    """Tells what is newer than `after_ns`, moment by moment, images last; `start_ns` is when the session began."""
    at_ns = lambda time_s: start_ns + round(time_s * SECOND_NS)
    moments: dict[int, list[CdrMessage]] = {}
    for ego in seen.history:
        moments.setdefault(at_ns(ego.time_s), []).extend(motion(ego, time_ns=at_ns(ego.time_s)))
    command = told(f"{SPACE}/command", _make("std_msgs/msg/UInt8", data=seen.command.value))
    moments.setdefault(at_ns(seen.ego.time_s), []).append(command)
    for name, frames in seen.frames.items():
        for pixels, time_s in zip(frames, seen.frame_times_s[name]):
            moments.setdefault(at_ns(time_s), []).extend(picture(seen.cameras[name], pixels, time_ns=at_ns(time_s)))
    for time_ns in sorted(time_ns for time_ns in moments if time_ns > after_ns):
        yield told("clock", _make("rosgraph_msgs/msg/Clock", clock=_stamp(time_ns)))
        yield from moments[time_ns]


def _ns(stamp: Any) -> int:
    return stamp.sec * SECOND_NS + stamp.nanosec


def heading_rad(orientation: Any) -> float:
    """Returns the heading of a quaternion."""
    x, y, z, w = orientation.x, orientation.y, orientation.z, orientation.w
    return float(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))


def plan(path: Any, *, now_ns: int) -> Plan:
    """Reads the poses of a `nav_msgs/Path`; `now_ns` is the time of the observation."""
    if path.header.frame_id != "base_link":
        raise PlanError(f'plan field "header.frame_id" is {path.header.frame_id!r}, "base_link" expected')
    poses, times_s = [], []
    for index, stamped in enumerate(path.poses):
        turned = stamped.pose.orientation
        length = float(np.linalg.norm([turned.x, turned.y, turned.z, turned.w]))
        if not abs(length - 1) < 1e-3:
            raise PlanError(f'plan field "poses[{index}].pose.orientation" has length {length:.3g}, 1 expected')
        poses.append([stamped.pose.position.x, stamped.pose.position.y, heading_rad(turned)])
        times_s.append((_ns(stamped.header.stamp) - now_ns) * _NS)
    return Plan(np.array(poses).reshape(-1, 3), np.array(times_s))


class Ros:
    """The side of ROS: what is told and heard on Zenoh keys, and the tokens by which the bridge knows of it."""

    def __init__(self, bus: Any, *, repeat_s: float = 2.0) -> None:
        self._bus = bus
        self.repeat_s = repeat_s
        self._known: dict[str, Any] = {}
        self._static: Optional[CdrMessage] = None
        self._ending = threading.Event()
        self.answers: "queue.Queue[bytes]" = queue.Queue(maxsize=16)
        self._plans = bus.declare_subscriber(f"{SPACE}/plan", self._hear)
        self._announce("MS", f"{SPACE}/plan", "nav_msgs/msg/Path")
        self._telling = threading.Thread(target=self._tell_static, daemon=True)
        self._telling.start()

    def _hear(self, sample: Any) -> None:
        try:
            self.answers.put_nowait(sample.payload.to_bytes())
        except queue.Full:
            _log.warning("too many plans at once, one is dropped")

    def _announce(self, role: str, topic: str, kind: str) -> None:
        if topic not in self._known:
            qos = QOS_KEPT if topic == "tf_static" else QOS
            key = "/".join(part.replace("/", "§") for part in (topic, kind, qos))
            token = f"@/{self._bus.zid()}/@ros2_lv/{role}/{key}"
            self._known[topic] = self._bus.liveliness().declare_token(token)

    def tell(self, message: CdrMessage) -> None:
        """Publishes a message."""
        self._announce("MP", message.topic, message.kind)
        self._bus.put(message.topic, message.data)

    def mount(self, cameras: Sequence[Camera], *, time_ns: int) -> None:
        """Sets the mounting of the cameras, which is told each second and before all that is asked."""
        words = [word(camera.name) for camera in cameras]
        if len(set(words)) < len(words):
            raise ValueError(f"cameras have the same name in ROS: {words}")
        self._static = static_transforms(cameras, time_ns=time_ns)

    def _tell_static(self) -> None:
        while not self._ending.wait(1.0):
            if self._static is not None:
                self.tell(self._static)

    def ask(self, messages: Sequence[CdrMessage], *, stamp_ns: int, within_s: float) -> Any:
        """Tells the mounting and messages until a `nav_msgs/Path` with this stamp comes, and returns it."""
        ends, again, heard = time.monotonic() + within_s, 0.0, "none came"
        # What is told again is told at the present time: clocks do not go back.
        clocks = [message for message in messages if message.topic == "clock"]
        repeated = [*clocks[-1:], *[message for message in messages if message.topic != "clock"]]
        while (now := time.monotonic()) < ends:
            if now >= again:
                again = now + self.repeat_s
                for message in filter(None, (self._static, *messages)):
                    self.tell(message)
                messages = repeated
            try:
                data = self.answers.get(timeout=max(0.0, min(again, ends) - now))
            except queue.Empty:
                continue
            path = _STORE.deserialize_cdr(data, "nav_msgs/msg/Path")
            if _ns(path.header.stamp) == stamp_ns:
                return path
            heard = f"the last one is stamped {_ns(path.header.stamp) * _NS:.9f} s"
        raise TimeoutError(f"no plan stamped {stamp_ns * _NS:.9f} s on /{SPACE}/plan within {within_s:.1f} s: {heard}")

    def close(self) -> None:
        """Takes back what was announced."""
        self._ending.set()
        self._telling.join()
        self._plans.undeclare()
        for token in self._known.values():
            token.undeclare()


class Ros2Policy(Policy):
    """Drives as a ROS 2 node says; the topics have room for one session at a time."""

    name = "ros2"
    at_once = 1
    ros: Ros
    _last_ns = 0

    def begin(self, *, session: Session) -> None:
        """Begins after the last session's time."""
        self._start_ns = (Ros2Policy._last_ns // SECOND_NS + 1) * SECOND_NS
        self._told_ns = self._start_ns - 1
        self.ros.mount(list(session.cameras.values()), time_ns=self._start_ns)

    def plan(self, seen: Observation) -> Plan:
        """Tells the observation and waits for the path."""
        now_ns = self._start_ns + round(seen.ego.time_s * SECOND_NS)
        newest_s = max(float(times_s[-1]) for times_s in seen.frame_times_s.values())
        messages = list(observation(seen, start_ns=self._start_ns, after_ns=self._told_ns))
        self._told_ns = Ros2Policy._last_ns = now_ns
        stamp_ns = self._start_ns + round(newest_s * SECOND_NS)
        path = self.ros.ask(messages, stamp_ns=stamp_ns, within_s=0.9 * seen.deadline_s)
        return plan(path, now_ns=now_ns)


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m dreamstream.ros2", description="Let a ROS 2 node drive: docs/ros2.md.")
    parser.add_argument("--connect", default="tcp/127.0.0.1:7448", help="where DreamStream listens (default %(default)s)")
    parser.add_argument("--name", default="ros2", help="the policy's name, as --policy asks for it (default %(default)s)")
    parser.add_argument("--ros", default="tcp/127.0.0.1:7447", help="where zenoh-bridge-ros2dds listens (default %(default)s)")
    parser.add_argument("--repeat", type=float, default=2.0, help="seconds until an observation is told again (default %(default)s)")
    parser.add_argument("--sessions", type=int, default=None, help="end after this many sessions")
    parser.add_argument("--wait", type=float, default=120.0, help="seconds to wait for either side (default %(default)s)")
    parser.add_argument("--config", default=None, help="a Zenoh configuration file for DreamStream's side, for certificates")
    parser.add_argument("--ros-config", default=None, help="the same for the bridge's side")
    given = parser.parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(levelname)s %(message)s")
    try:
        with opened(given.ros, wait_s=given.wait, config_file=given.ros_config) as bus:
            ros = Ros(bus, repeat_s=given.repeat)
            driven: type[Policy] = type("Ros2", (Ros2Policy,), {"ros": ros})
            try:
                run(driven, connect=given.connect, name=given.name, sessions=given.sessions, wait_s=given.wait, config_file=given.config)
            finally:
                ros.close()
    except KeyboardInterrupt:
        return 130
    except ConnectionError as error:
        logging.error("%s", error)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
