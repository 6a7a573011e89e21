"""Messages of the policy bus as the values of `policy.py`, and back. The generated code is named here alone."""

from __future__ import annotations

import numpy as np

from . import image
from ._wire.dreamstream_policy.v1 import policy_pb2 as wire
from .policy import Camera, Command, Ego, Observation, Plan, Session

VERSION = 1
MAX_TEXT_BYTES = 256
MAX_MESSAGE_BYTES = 64 << 20
_NS = 1e-9


class MessageError(ValueError):
    """Says which field of a message is wrong."""


def session(data: bytes) -> Session:
    """Reads `hello`."""
    message = _parse(wire.SessionHello, data, name="hello")
    if message.version != VERSION:
        raise MessageError(f'hello field "version" is {message.version}, this client speaks {VERSION}')
    return Session(
        cameras={calibration.camera: _camera(calibration) for calibration in message.cameras},
        history=message.history,
        horizon_s=message.horizon_ns * _NS,
        step_s=message.step_ns * _NS,
        deadline_s=message.deadline_millis * 1e-3,
    )


def observation(data: bytes) -> Observation:
    """Reads `observation`."""
    message = _parse(wire.Observation, data, name="observation")
    if not message.ego:
        raise MessageError('observation field "ego" is empty')
    if message.command not in (1, 2, 3):
        raise MessageError(f'observation field "command" is {message.command}')
    frames, times, cameras = {}, {}, {}
    for view in message.cameras:
        name = view.calibration.camera
        if not view.images:
            raise MessageError(f'observation field "cameras" holds no image of {name!r}')
        cameras[name] = _camera(view.calibration)
        frames[name] = np.stack([_pixels(sent) for sent in view.images])
        times[name] = np.array([sent.time_ns * _NS for sent in view.images])
    return Observation(
        sequence=message.sequence,
        time_s=message.time_ns * _NS,
        frames=frames,
        frame_times_s=times,
        cameras=cameras,
        history=tuple(_ego(sent) for sent in message.ego),
        command=Command(message.command),
        horizon_s=message.horizon_ns * _NS,
        step_s=message.step_ns * _NS,
        deadline_s=message.deadline_millis * 1e-3,
    )


def reason(data: bytes) -> str:
    """Reads `goodbye`."""
    return _parse(wire.SessionGoodbye, data, name="goodbye").reason


def ready(*, name: str) -> bytes:
    """Writes `ready`."""
    return wire.PolicyHello(version=VERSION, name=_short(name)).SerializeToString()


def leave(*, reason: str) -> bytes:
    """Writes `leave`."""
    return wire.PolicyGoodbye(reason=_short(reason)).SerializeToString()


def plan(answer: Plan, *, for_sequence: int) -> bytes:
    """Writes `plan`; the answer was checked."""
    proposals = [wire.PlanProposal(poses=_poses(other), score=score) for other, score in answer.proposals]
    message = wire.PolicyPlan(for_sequence=for_sequence, poses=_poses(answer), proposals=proposals)
    if answer.context is not None:
        message.context.channels = answer.context.shape[1]
        message.context.values.extend(answer.context.ravel().tolist())
    return message.SerializeToString()


def _poses(answer: Plan) -> list:
    return [
        wire.PlanPose(after_ns=round(after * 1e9), pose=wire.Pose(x_m=x, y_m=y, heading_rad=heading))
        for (x, y, heading), after in zip(answer.poses.tolist(), answer.times_s.tolist())
    ]


def _parse(kind, data: bytes, *, name: str):
    if len(data) > MAX_MESSAGE_BYTES:
        raise MessageError(f"{name} has {len(data)} bytes, the limit is {MAX_MESSAGE_BYTES}")
    message = kind()
    try:
        message.ParseFromString(data)
    except Exception as error:  # DecodeError lives in different places in different protobuf versions
        raise MessageError(f"{name} cannot be decoded: {error}") from error
    return message


def _short(text: str) -> str:
    return text.encode()[:MAX_TEXT_BYTES].decode(errors="ignore")


def _pixels(sent) -> np.ndarray:
    decode = {wire.ENCODING_RAW: image.from_raw, wire.ENCODING_PNG: image.from_png}.get(sent.encoding)
    if decode is None:
        raise MessageError(f'image field "encoding" is {sent.encoding}')
    return decode(sent.data, width_px=sent.width_px, height_px=sent.height_px)


def _camera(sent) -> Camera:
    return Camera(
        name=sent.camera,
        width_px=sent.width_px,
        height_px=sent.height_px,
        fx_px=sent.fx_px,
        fy_px=sent.fy_px,
        cx_px=sent.cx_px,
        cy_px=sent.cy_px,
        k1=sent.k1,
        k2=sent.k2,
        rig_from_camera=np.array(
            [sent.rig_from_camera_qx, sent.rig_from_camera_qy, sent.rig_from_camera_qz, sent.rig_from_camera_qw]
        ),
        position_in_rig_m=np.array([sent.position_in_rig_x_m, sent.position_in_rig_y_m, sent.position_in_rig_z_m]),
    )


def _ego(sent) -> Ego:
    return Ego(
        time_s=sent.time_ns * _NS,
        x_m=sent.pose.x_m,
        y_m=sent.pose.y_m,
        heading_rad=sent.pose.heading_rad,
        velocity_x_mps=sent.velocity_x_mps,
        velocity_y_mps=sent.velocity_y_mps,
        yaw_rate_radps=sent.yaw_rate_radps,
        acceleration_x_mps2=sent.acceleration_x_mps2,
        acceleration_y_mps2=sent.acceleration_y_mps2,
        steering_rad=sent.steering_rad,
    )
