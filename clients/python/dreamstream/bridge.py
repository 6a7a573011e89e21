"""Serves a policy on the policy bus: keys `dreamstream-policy/v1/{policy}/{session}/{leaf}`.

The bridge puts `hello`, `observation` and `goodbye`, and repeats what is not answered; this side puts `ready`, `plan`
and `leave`, and answers the same question the same way. A policy that fails leaves its session and says why; the
other sessions go on. Observations for `plan_batch` wait a few milliseconds for those of other sessions.
"""

from __future__ import annotations

import json
import logging
import queue
import re
import time
from dataclasses import dataclass
from typing import Callable, Mapping, Optional, Type, Union

import numpy as np
import zenoh

from . import messages
from .policy import Observation, Plan, Policy

ROOT = "dreamstream-policy/v1"
MAX_WAITING = 256
MAX_LEFT = 64
_WORD = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_.-]{0,95}")
_log = logging.getLogger("dreamstream")

#: What leaves: (session, leaf, bytes).
Put = Callable[[str, str, bytes], None]


@dataclass
class _Drive:
    """A session under way."""

    policy: Policy
    sequence: int = -1
    answer: bytes = b""


class Sessions:
    """The client's side of the protocol, without a bus: messages in, messages out."""

    def __init__(self, policy: Type[Policy], *, put: Put) -> None:
        self._make = policy
        self._put = put
        self._drives: dict[str, _Drive] = {}
        self._left: dict[str, bytes] = {}
        self._due: dict[str, Observation] = {}
        self.ended = 0
        self._together = policy.plan_batch is not Policy.plan_batch
        if self._together and not 1 <= policy.batch <= policy.at_once:
            raise ValueError(f"{policy.__name__}.plan_batch needs batch = 1 to {policy.at_once}, found {policy.batch!r}")

    def __len__(self) -> int:
        return len(self._drives)

    @property
    def due(self) -> int:
        """How many observations wait for `plan_due`."""
        return len(self._due)

    @property
    def full(self) -> bool:
        """Whether waiting longer is of no use: the batch is full, or every session waits."""
        return bool(self._due) and len(self._due) >= min(self._make.batch, len(self._drives))

    def plan_due(self) -> None:
        """Answers what waits, up to one batch."""
        taken = list(self._due)[: self._make.batch]
        self._plan_together({session: self._due.pop(session) for session in taken})

    def take(self, *, session: str, leaf: str, data: bytes) -> None:
        """Handles one message; a policy's fault ends its session only."""
        if session in self._left:
            if leaf != "goodbye":
                self._put(session, "leave", self._left[session])
            return
        try:
            if leaf == "hello":
                self._hello(session=session, data=data)
            elif leaf == "observation":
                self._observation(session=session, data=data)
            elif leaf == "goodbye":
                self._goodbye(session=session, data=data)
        except Exception as error:
            self._fail(session, error)

    def close(self, *, reason: str) -> None:
        """Leaves every session."""
        for session in list(self._drives):
            _log.info("session %s is left: %s", session, reason)
            self._leave(session=session, reason=reason)

    def _hello(self, *, session: str, data: bytes) -> None:
        shown = messages.session(data)
        if session not in self._drives:
            if len(self._drives) >= self._make.at_once:
                return  # the bridge greets again
            policy = self._make()
            policy.begin(session=shown)
            self._drives[session] = _Drive(policy=policy)
            _log.info("session %s begins with cameras %s", session, ", ".join(shown.cameras))
        self._put(session, "ready", messages.ready(name=self._drives[session].policy.name))

    def _observation(self, *, session: str, data: bytes) -> None:
        drive = self._drives.get(session)
        if drive is None:
            return
        seen = messages.observation(data)
        if seen.sequence == drive.sequence:
            self._put(session, "plan", drive.answer)
        elif seen.sequence > drive.sequence and self._together:
            self._due[session] = seen
        elif seen.sequence > drive.sequence:
            self._answer(session, seen, drive.policy.plan(seen))

    def _plan_together(self, seen: Mapping[str, Observation]) -> None:
        """Asks for all at once, filled up to the batch; each by itself where that fails, so that only the guilty leave."""
        shown = [*seen.values(), *[list(seen.values())[-1]] * (self._make.batch - len(seen))]
        try:
            answers = list(self._drives[next(iter(seen))].policy.plan_batch(shown))
            if len(answers) != len(shown):
                raise ValueError(f"plan_batch returned {len(answers)} answers for {len(shown)} observations")
        except Exception as error:
            if len(seen) > 1:
                for session in seen:
                    self._plan_together({session: seen[session]})
                return
            self._fail(next(iter(seen)), error)
            return
        for session, answer in zip(seen, answers):
            try:
                self._answer(session, seen[session], answer)
            except Exception as error:
                self._fail(session, error)

    def _answer(self, session: str, seen: Observation, answer: Union[Plan, np.ndarray]) -> None:
        drive = self._drives[session]
        checked = Plan.of(answer, spacing_s=drive.policy.spacing_s)
        drive.answer = messages.plan(checked, for_sequence=seen.sequence)
        drive.sequence = seen.sequence
        self._put(session, "plan", drive.answer)

    def _goodbye(self, *, session: str, data: bytes) -> None:
        drive = self._drives.pop(session, None)
        self._due.pop(session, None)
        if drive is None:
            return
        self.ended += 1
        reason = messages.reason(data)
        _log.info("session %s ends: %s", session, reason)
        drive.policy.end(reason=reason)

    def _fail(self, session: str, error: Exception) -> None:
        _log.error("policy leaves session %s", session, exc_info=error)
        self._leave(session=session, reason=f"{type(error).__name__}: {error}")

    def _leave(self, *, session: str, reason: str) -> None:
        drive = self._drives.pop(session, None)
        self._due.pop(session, None)
        if len(self._left) >= MAX_LEFT:
            self._left.pop(next(iter(self._left)))
        self._left[session] = messages.leave(reason=reason)
        self._put(session, "leave", self._left[session])
        self.ended += 1
        if drive is not None:
            drive.policy.end(reason=reason)


def opened(connect: str, *, wait_s: float, config_file: Optional[str] = None) -> zenoh.Session:
    """Connects to a Zenoh router as a client; it may open up to `wait_s` later."""
    config = zenoh.Config.from_file(config_file) if config_file else zenoh.Config()
    for key, value in (
        ("mode", "client"),
        ("connect/endpoints", [connect]),
        ("connect/timeout_ms", round(1000 * wait_s)),
        ("connect/exit_on_failure", True),
        ("connect/retry", {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 1.5}),
        ("scouting/multicast/enabled", False),
    ):
        config.insert_json5(key, json.dumps(value))
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise ConnectionError(f"no bridge at {connect} within {wait_s:.0f} s: {error}") from error


def run(
    policy: Type[Policy],
    *,
    connect: str = "tcp/127.0.0.1:7448",
    name: str = "guest",
    sessions: Optional[int] = None,
    wait_s: float = 120.0,
    config_file: Optional[str] = None,
) -> None:
    """Serves `policy` under `name` until interrupted, or until `sessions` sessions have ended.

    `connect` is the bridge's address (`tcp/HOST:PORT`), which may open up to `wait_s` later; `config_file` a Zenoh
    configuration, for certificates.
    """
    if not _WORD.fullmatch(name):
        raise ValueError(f"policy name {name!r} may hold only letters, digits, '_', '-' and '.'")
    waiting: "queue.Queue[tuple[str, str, bytes]]" = queue.Queue(maxsize=MAX_WAITING)

    def enqueue(sample) -> None:
        parts = str(sample.key_expr).split("/")
        try:
            waiting.put_nowait((parts[-2], parts[-1], sample.payload.to_bytes()))
        except queue.Full:
            _log.warning("queue full, message dropped; the bridge will repeat it")

    with opened(connect, wait_s=wait_s, config_file=config_file) as bus:

        def put(session: str, leaf: str, data: bytes) -> None:
            bus.put(f"{ROOT}/{name}/{session}/{leaf}", data)

        served = Sessions(policy, put=put)
        listening = [bus.declare_subscriber(f"{ROOT}/{name}/*/{leaf}", enqueue) for leaf in ("hello", "observation", "goodbye")]
        until, bridge = 0.0, None
        _log.info("policy %r waits as %r at %s", policy.__name__, name, connect)
        try:
            while sessions is None or served.ended < sessions:
                try:
                    session, leaf, data = waiting.get(timeout=max(0.0, until - time.monotonic()) if served.due else 0.2)
                    if leaf == "hello" and bridge != (there := [str(zid) for zid in bus.info.routers_zid()]):
                        served.close(reason="another bridge took the place of this one")
                        bridge = there
                    if not served.due:
                        until = time.monotonic() + policy.gather_s
                    served.take(session=session, leaf=leaf, data=data)
                except queue.Empty:
                    pass
                while served.full or (served.due and time.monotonic() >= until):
                    served.plan_due()
        finally:
            served.close(reason="the policy's process ends")
            for subscriber in listening:
                subscriber.undeclare()
