"""Messages as the bridge sends them, made with the generated code."""

import struct
import zlib

import numpy as np

from dreamstream._wire.dreamstream_policy.v1 import policy_pb2 as wire

WIDTH_PX, HEIGHT_PX = 16, 9


def picture(seed=0):
    return np.random.default_rng(seed).integers(0, 256, (HEIGHT_PX, WIDTH_PX, 3), dtype=np.uint8)


def png(pixels, *, kinds):
    """Packs pixels with the given PNG filter per row (written from the PNG specification, section 9)."""
    rows, above = [], np.zeros((pixels.shape[1], 3), np.int32)
    for y, row in enumerate(pixels.astype(np.int32)):
        left = np.vstack([np.zeros((1, 3), np.int32), row[:-1]])
        corner = np.vstack([np.zeros((1, 3), np.int32), above[:-1]])
        p = left + above - corner
        pa, pb, pc = abs(p - left), abs(p - above), abs(p - corner)
        paeth = np.where((pa <= pb) & (pa <= pc), left, np.where(pb <= pc, above, corner))
        kind = kinds[y % len(kinds)]
        guess = [0 * row, left, above, (left + above) // 2, paeth][kind]
        rows.append(bytes([kind]) + ((row - guess) % 256).astype(np.uint8).tobytes())
        above = row
    def chunk(name, body):
        return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
    header = struct.pack(">IIBBBBB", pixels.shape[1], pixels.shape[0], 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"".join(rows))) + chunk(b"IEND", b"")


def calibration(name="front"):
    return wire.Calibration(
        camera=name, width_px=WIDTH_PX, height_px=HEIGHT_PX, fx_px=11.4, fy_px=11.4, cx_px=8.0, cy_px=4.5, k1=0.0, k2=0.0,
        rig_from_camera_qx=-0.5, rig_from_camera_qy=0.5, rig_from_camera_qz=-0.5, rig_from_camera_qw=0.5,
        position_in_rig_x_m=1.5, position_in_rig_y_m=0.0, position_in_rig_z_m=1.6,
    )


def hello(**changes):
    fields = dict(version=1, cameras=[calibration()], history=1, horizon_ns=8 * 10**9, step_ns=10**8, deadline_millis=2000)
    return wire.SessionHello(**{**fields, **changes}).SerializeToString()


def observation(*, sequence=0, speed_mps=10.0, encoding=wire.ENCODING_RAW, data=None, **changes):
    data = picture(sequence).tobytes() if data is None else data
    sent = wire.Image(time_ns=0, width_px=WIDTH_PX, height_px=HEIGHT_PX, encoding=encoding, data=data)
    ego = wire.Ego(time_ns=0, pose=wire.Pose(x_m=0.0, y_m=0.0, heading_rad=0.0), velocity_x_mps=speed_mps)
    fields = dict(
        sequence=sequence, time_ns=5 * 10**8 * sequence, ego=[ego], command=wire.COMMAND_LEFT,
        cameras=[wire.CameraView(calibration=calibration(), images=[sent])],
        horizon_ns=8 * 10**9, step_ns=10**8, deadline_millis=2000,
    )
    return wire.Observation(**{**fields, **changes}).SerializeToString()


def goodbye(reason="completed"):
    return wire.SessionGoodbye(reason=reason).SerializeToString()


def plan(data):
    return wire.PolicyPlan.FromString(data)


def reason(data):
    return wire.PolicyGoodbye.FromString(data).reason
