"""The client's side of the protocol, first without a bus, then over a real Zenoh session."""

import queue
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import observed
from dreamstream import Policy
from dreamstream.__main__ import load, main
from dreamstream.bridge import Sessions

EXAMPLE = Path(__file__).resolve().parents[1] / "examples" / "constant_velocity.py"


class Straight(Policy):
    made = 0

    def begin(self, *, session):
        type(self).made += 1
        self.plans = 0

    def plan(self, observation):
        self.plans += 1
        return np.array([[observation.ego.speed_mps, float(self.plans), 0.0]])


class Broken(Policy):
    def plan(self, observation):
        return np.array([[np.nan, 0.0, 0.0]])


def serve(policy):
    sent = []
    return Sessions(policy, put=lambda *message: sent.append(message)), sent


def test_a_session_is_greeted_planned_and_ended():
    served, sent = serve(Straight)
    for leaf, data in [("hello", observed.hello()), ("hello", observed.hello()), ("observation", observed.observation()),
                       ("goodbye", observed.goodbye()), ("observation", observed.observation(sequence=1))]:
        served.take(session="s", leaf=leaf, data=data)
    assert [leaf for _, leaf, _ in sent] == ["ready", "ready", "plan"]
    assert observed.plan(sent[2][2]).poses[0].pose.x_m == 10.0
    assert (len(served), served.ended) == (0, 1)


def test_the_same_question_is_answered_the_same_way():
    served, sent = serve(Straight)
    served.take(session="s", leaf="hello", data=observed.hello())
    for sequence in (0, 0, 1, 0):
        served.take(session="s", leaf="observation", data=observed.observation(sequence=sequence))
    answers = [observed.plan(data) for _, leaf, data in sent if leaf == "plan"]
    assert [(answer.for_sequence, answer.poses[0].pose.y_m) for answer in answers] == [(0, 1.0), (0, 1.0), (1, 2.0)]


def test_sessions_do_not_share_a_policy():
    served, _ = serve(Straight)
    before = Straight.made
    for session in ("a", "b"):
        served.take(session=session, leaf="hello", data=observed.hello())
    assert (len(served), Straight.made - before) == (2, 2)


def test_a_session_waits_for_its_turn():
    served, sent = serve(type("OneAtATime", (Straight,), {"at_once": 1}))
    for session, leaf, data in [("a", "hello", observed.hello()), ("b", "hello", observed.hello()), ("a", "goodbye", observed.goodbye()),
                                ("b", "hello", observed.hello())]:
        served.take(session=session, leaf=leaf, data=data)
    assert [(session, leaf) for session, leaf, _ in sent] == [("a", "ready"), ("b", "ready")]


class Together(Policy):
    """A matrix product: libraries choose its kernel, and with it the rounding, by the number of rows."""

    batch = 4
    asked = []
    weights = np.random.default_rng(0).standard_normal((64, 24)).astype(np.float32)

    def plan_batch(self, observations):
        self.asked.append(len(observations))
        if any(seen.ego.speed_mps < 0 for seen in observations):
            raise RuntimeError("a car that drives backwards")
        seen = np.stack([seen.frames["front"][-1].reshape(-1)[:64] for seen in observations]).astype(np.float32)
        return list((seen @ self.weights).reshape(len(observations), 8, 3) / 1000)


def together(speeds_mps):
    served, sent = serve(Together)
    for session in speeds_mps:
        served.take(session=session, leaf="hello", data=observed.hello())
    for number, (session, speed_mps) in enumerate(speeds_mps.items()):
        assert not served.full
        data = observed.observation(sequence=number, speed_mps=speed_mps)
        served.take(session=session, leaf="observation", data=data)
        served.take(session=session, leaf="observation", data=data)
    assert served.full and served.due == len(speeds_mps)
    while served.due:
        served.plan_due()
    assert not served.full
    return {session: (leaf, data) for session, leaf, data in sent if leaf != "ready"}


def test_sessions_are_planned_in_one_call_of_fixed_size_and_each_as_if_alone():
    Together.asked.clear()
    answers = together({"a": 1.0, "b": 2.0, "c": 3.0})
    assert Together.asked == [4]
    assert together({"a": 1.0})["a"] == answers["a"]
    assert len({data for _, data in answers.values()}) == 3


def test_more_sessions_than_a_batch_are_planned_in_turn():
    served, sent = serve(Together)
    for session in "abcdef":
        served.take(session=session, leaf="hello", data=observed.hello())
        served.take(session=session, leaf="observation", data=observed.observation())
    assert served.full
    served.plan_due()
    assert (served.due, served.full) == (2, False)
    served.take(session="e", leaf="goodbye", data=observed.goodbye())
    served.plan_due()
    assert [session for session, leaf, _ in sent if leaf == "plan"] == ["a", "b", "c", "d", "f"]


def test_who_fails_in_a_batch_leaves_alone():
    answers = together({"a": 1.0, "backwards": -1.0, "c": 3.0})
    assert [answers[session][0] for session in ("a", "backwards", "c")] == ["plan", "leave", "plan"]
    assert "backwards" in observed.reason(answers["backwards"][1])


def test_a_batch_has_a_size():
    with pytest.raises(ValueError, match="batch = 1 to 64, found 0"):
        serve(type("Sizeless", (Together,), {"batch": 0}))


@pytest.mark.parametrize("leaf, data, says", [
    ("observation", observed.observation(), "poses[0].x_m"),
    ("observation", b"\xff", "cannot be decoded"),
    ("hello", observed.hello(version=9), "version"),
])
def test_a_failing_policy_leaves_and_says_why(leaf, data, says):
    served, sent = serve(Broken)
    served.take(session="other", leaf="hello", data=observed.hello())
    served.take(session="s", leaf="hello", data=observed.hello())
    served.take(session="s", leaf=leaf, data=data)
    assert sent[-1][1] == "leave" and says in observed.reason(sent[-1][2])
    assert len(served) == 1
    served.take(session="s", leaf="observation", data=observed.observation(sequence=1))
    assert sent[-1][1] == "leave"


def test_files_and_classes_are_named_when_absent(tmp_path):
    assert issubclass(load(f"{EXAMPLE}:ConstantVelocity"), Policy)
    for target, says in [("nothing", "FILE.py:CLASS"), ("no.py:A", "no.py"), (f"{EXAMPLE}:Velocity", "ConstantVelocity")]:
        with pytest.raises(SystemExit) as refused:
            load(target)
        assert says in str(refused.value)


def test_the_doctor_is_the_program_beside_this_python(tmp_path, monkeypatch):
    program = tmp_path / "dreamstream"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    started = []
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("os.execv", lambda program, words: started.append(words) or 0)
    main(["doctor", f"{EXAMPLE}:ConstantVelocity", "--json"])
    assert started[0][1:] == ["policy", "doctor", f"{EXAMPLE}:ConstantVelocity", "--python", sys.executable, "--json"]
    monkeypatch.setattr("shutil.which", lambda *_, **__: None)
    with pytest.raises(SystemExit, match="not on the PATH"):
        main(["doctor", f"{EXAMPLE}:ConstantVelocity"])


def test_the_example_drives_over_a_real_bus():
    import zenoh

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", f'["{address}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    answers = queue.Queue()
    prefix = "dreamstream-policy/v1/straight/5f1d"
    # The client comes first and waits for its bridge.
    client = subprocess.Popen(
        [sys.executable, "-m", "dreamstream", "run", f"{EXAMPLE}:ConstantVelocity", "--connect", address,
         "--name", "straight", "--sessions", "1"],
        cwd=EXAMPLE.parents[1],
    )
    time.sleep(1.0)
    with zenoh.open(config) as bus:
        take = lambda sample: answers.put((str(sample.key_expr).rsplit("/", 1)[1], sample.payload.to_bytes()))
        listening = [bus.declare_subscriber(f"{prefix}/{leaf}", take) for leaf in ("ready", "plan", "leave")]

        def ask(leaf, data, expected):
            for _ in range(60):
                bus.put(f"{prefix}/{leaf}", data)
                try:
                    while True:
                        found, answer = answers.get(timeout=0.5)
                        if found == expected:
                            return answer
                except queue.Empty:
                    assert client.poll() is None, "the client ended early"
            raise AssertionError(f"no {expected} came")

        try:
            ask("hello", observed.hello(), "ready")
            for sequence in range(3):
                answer = observed.plan(ask("observation", observed.observation(sequence=sequence, speed_mps=8.0), "plan"))
                while answer.for_sequence != sequence:
                    answer = observed.plan(ask("observation", observed.observation(sequence=sequence, speed_mps=8.0), "plan"))
                assert len(answer.poses) == 16 and answer.poses[15].pose.x_m == 64.0
            bus.put(f"{prefix}/goodbye", observed.goodbye())
            assert client.wait(timeout=20) == 0
        finally:
            if client.poll() is None:
                client.kill()
            for subscriber in listening:
                subscriber.undeclare()


def test_an_absent_bridge_is_named():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    client = subprocess.run(
        [sys.executable, "-m", "dreamstream", "run", f"{EXAMPLE}:ConstantVelocity", "--connect", address, "--wait", "1"],
        cwd=EXAMPLE.parents[1], capture_output=True, text=True, timeout=60,
    )
    assert client.returncode == 1 and address in client.stderr
