"""Messages of the bus become values, and broken ones are named."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import observed
from dreamstream import Command, Plan, image, messages
from dreamstream._wire.dreamstream_policy.v1 import policy_pb2 as wire

REPOSITORY = Path(__file__).resolve().parents[3]


def test_an_observation_is_read():
    seen = messages.observation(observed.observation(sequence=3))
    assert (seen.sequence, seen.command, seen.horizon_s, seen.step_s) == (3, Command.LEFT, 8.0, 0.1)
    assert seen.frames["front"].shape == (1, observed.HEIGHT_PX, observed.WIDTH_PX, 3)
    assert np.array_equal(seen.frames["front"][0], observed.picture(3))
    assert seen.ego.speed_mps == 10.0
    camera = seen.cameras["front"]
    assert np.allclose(camera.rotation @ [0, 0, 1], [1, 0, 0]) and np.allclose(camera.rotation @ [1, 0, 0], [0, -1, 0])


@pytest.mark.parametrize("kinds", [[0], [1], [2], [3], [4], [0, 1, 2, 3, 4]])
def test_png_rows_are_unfiltered(kinds):
    packed = observed.png(observed.picture(), kinds=kinds)
    seen = messages.observation(observed.observation(encoding=wire.ENCODING_PNG, data=packed))
    assert np.array_equal(seen.frames["front"][0], observed.picture())


PNG = observed.png(observed.picture(), kinds=[1])


@pytest.mark.parametrize(
    "data, says",
    [
        (b"\xff\xff\xff", "cannot be decoded"),
        (observed.observation(data=b"short"), "holds 5 bytes"),
        (observed.observation(encoding=9), "encoding"),
        (observed.observation(encoding=wire.ENCODING_PNG, data=b"GIF89a.."), "not a PNG"),
        (observed.observation(encoding=wire.ENCODING_PNG, data=PNG[:60]), "ends inside"),
        (observed.observation(encoding=wire.ENCODING_PNG, data=PNG.replace(b"\x00\x00\x00\x10\x00\x00\x00\x09", b"\x00\x01\x00\x10\x00\x00\x00\x09")), "holds (65552, 9)"),
        (observed.observation(ego=[]), "ego"),
        (observed.observation(command=7), "command"),
    ],
)
def test_broken_observations_are_named(data, says):
    with pytest.raises((messages.MessageError, image.ImageError)) as refused:
        messages.observation(data)
    assert says in str(refused.value)


def test_another_version_is_refused():
    with pytest.raises(messages.MessageError, match='"version" is 2'):
        messages.session(observed.hello(version=2))


def test_a_plan_is_written_in_nanoseconds():
    sent = observed.plan(messages.plan(Plan.of([[1.5, -0.5, 0.25]], spacing_s=0.5), for_sequence=7))
    assert (sent.for_sequence, sent.poses[0].after_ns) == (7, 500_000_000)
    assert (sent.poses[0].pose.x_m, sent.poses[0].pose.y_m, sent.poses[0].pose.heading_rad) == (1.5, -0.5, 0.25)


def test_a_context_travels_with_its_channels():
    told = Plan(np.zeros((1, 3)), np.array([0.5]), context=np.arange(6.0).reshape(2, 3))
    sent = observed.plan(messages.plan(Plan.of(told, spacing_s=0.5), for_sequence=0))
    assert (sent.context.channels, list(sent.context.values)) == (3, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0])
    without = observed.plan(messages.plan(Plan.of(np.zeros((1, 3)), spacing_s=0.5), for_sequence=0))
    assert not without.HasField("context")


def test_generated_code_is_that_of_the_contract():
    """Compares the committed code with the descriptors that the Rust side was compiled from."""
    from google.protobuf import descriptor_pb2

    compiled = REPOSITORY / "crates/protocol/wire/src/generated/dreamstream.binpb"
    if not compiled.exists():
        pytest.skip(f"{compiled} is not there: the client stands outside its repository")
    files = descriptor_pb2.FileDescriptorSet.FromString(compiled.read_bytes()).file
    (expected,) = [file for file in files if file.name.endswith("dreamstream_policy/v1/policy.proto")]
    found = descriptor_pb2.FileDescriptorProto()
    wire.DESCRIPTOR.CopyToProto(found)
    for file in (expected, found):
        file.ClearField("source_code_info")
        for message in file.message_type:
            for part in message.field:
                part.ClearField("json_name")
    assert found == expected
