"""One small network twice: exported as ONNX with its manifest, and computed by numpy in a policy process.

own_policy.py export FOLDER            writes numpy.onnx and numpy.toml
own_policy.py compare ONE OTHER        prints the largest difference between the plans of two recordings, between the plans of
                                       one, and between the contexts of both where there are some
"""
import sys
from pathlib import Path

import numpy as np

from dreamstream import Command, Plan, Policy

CELLS, PATCH, POSES = (12, 20), 8, 8
DRAWN = np.random.default_rng(7)
EYE = DRAWN.normal(0, 0.05, (3 * PATCH * PATCH, 6)).astype(np.float32)
HEAD = DRAWN.normal(0, 0.05, (CELLS[0] * CELLS[1] * 6 + 3, 3 * POSES)).astype(np.float32)
UNIT = np.stack([[0.2 * k, 0.2 * k, 0.01 * k] for k in range(1, POSES + 1)]).reshape(1, -1).astype(np.float32)
PICK = np.float32([[0.01]] + 8 * [[0]])
AHEAD = np.stack([[0.5 * k, 0.0, 0.0] for k in range(1, POSES + 1)]).reshape(1, -1).astype(np.float32)

MANIFEST = """version = 1
[policy]
name = "numpy"
file = "numpy.onnx"
[image]
input = "image"
size_px = [160, 96]
camera = { raw = "front" }
scale = 0.00392156862745098
[state]
input = "speed"
fields = ["speed_mps"]
[command]
input = "command"
one_hot = ["left", "straight", "right"]
[calibration]
intrinsics = "lens"
[plan]
output = "plan"
first_s = 0.5
spacing_s = 0.5
beyond = "hold"
[feature]
output = "seen"
"""


class Twin(Policy):
    def plan(self, observation):
        image = observation.frames["front"][-1].astype(np.float32) / np.float32(255)
        rows, columns = CELLS
        patches = image.transpose(2, 0, 1).reshape(3, rows, PATCH, columns, PATCH).transpose(1, 3, 0, 2, 4)
        tokens = np.tanh(patches.reshape(rows * columns, -1) @ EYE)
        said = np.float32([[observation.command is way for way in (Command.LEFT, Command.STRAIGHT, Command.RIGHT)]])
        lens = observation.cameras["front"].intrinsics.reshape(1, 9).astype(np.float32) @ PICK
        offsets = np.tanh(np.concatenate([tokens.reshape(1, -1), said], axis=1) @ HEAD) * UNIT * lens
        poses = (offsets + np.float32(observation.ego.speed_mps) * AHEAD).reshape(POSES, 3)
        return Plan(poses, 0.5 * np.arange(1, POSES + 1), context=tokens)


def export(folder: Path) -> None:
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    rows, columns = CELLS
    shapes = {"apart": [-1, 3, rows, PATCH, columns, PATCH], "cells": [-1, 3 * PATCH * PATCH], "flat": [-1, rows * columns * 6]}
    shapes |= {"nine": [-1, 9], "poses": [-1, POSES, 3]}
    weights = {"eye": EYE, "head": HEAD, "unit": UNIT, "ahead": AHEAD, "pick": PICK}
    weights |= {name: np.array(shape, dtype=np.int64) for name, shape in shapes.items()}
    node = helper.make_node
    nodes = [
        node("Reshape", ["image", "apart"], ["a"]),
        node("Transpose", ["a"], ["b"], perm=[0, 2, 4, 1, 3, 5]),
        node("Reshape", ["b", "cells"], ["c"]),
        node("MatMul", ["c", "eye"], ["d"]),
        node("Tanh", ["d"], ["seen"]),
        node("Reshape", ["seen", "flat"], ["f"]),
        node("Concat", ["f", "command"], ["g"], axis=1),
        node("Gemm", ["g", "head"], ["h"]),
        node("Tanh", ["h"], ["i"]),
        node("Reshape", ["lens", "nine"], ["n"]),
        node("MatMul", ["n", "pick"], ["o"]),
        node("Mul", ["i", "unit"], ["p"]),
        node("Mul", ["p", "o"], ["j"]),
        node("Mul", ["speed", "ahead"], ["k"]),
        node("Add", ["j", "k"], ["l"]),
        node("Reshape", ["l", "poses"], ["plan"]),
    ]
    inputs = {"image": ["batch", 3, 96, 160], "speed": ["batch", 1], "command": ["batch", 3], "lens": ["batch", 3, 3]}
    values = [helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name, shape in inputs.items()]
    plan = helper.make_tensor_value_info("plan", TensorProto.FLOAT, ["batch", POSES, 3])
    initializers = [numpy_helper.from_array(value, name) for name, value in weights.items()]
    seen = helper.make_tensor_value_info("seen", TensorProto.FLOAT, ["tokens", 6])
    graph = helper.make_graph(nodes, "twin", values, [plan, seen], initializers)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model)
    onnx.save(model, folder / "numpy.onnx")
    (folder / "numpy.toml").write_text(MANIFEST)


def plans(recording: str) -> tuple[np.ndarray, np.ndarray]:
    from mcap_protobuf.reader import read_protobuf_messages

    with open(recording, "rb") as stream:
        messages = [message.proto_msg for message in read_protobuf_messages(stream) if message.topic.split("/")[-1] == "plan"]
    poses = [[[p.after_ns * 1e-9, p.pose.x_m, p.pose.y_m, p.pose.heading_rad] for p in m.trajectory.poses] for m in messages]
    contexts = [np.reshape(m.context.values, m.context.shape) for m in messages if m.HasField("context")]
    return np.array(poses), np.array(contexts)


if __name__ == "__main__":
    if sys.argv[1] == "export":
        export(Path(sys.argv[2]))
    else:
        (one, seen), (other, told) = plans(sys.argv[2]), plans(sys.argv[3])
        assert one.shape == other.shape, (one.shape, other.shape)
        assert seen.shape == told.shape and len(seen) in (0, len(one)), (seen.shape, told.shape)
        apart = [np.abs(seen - told).max()] if seen.size else []
        print(np.abs(one - other).max(), np.abs(one[1:] - one[:-1]).max(), *apart)
