"""The stage protocol in Python: what any program needs to take a stage's place on the bus.

A stage joins the fleet over gRPC, is assigned roles of episodes, gathers the inputs that a work order makes due (pushed,
or asked for), has its maker make the outputs, publishes them, and publishes the same again when the order is repeated.
See docs/recipes/replace-a-stage.md. An extra of the package, `pip install 'dreamstream[stage]'`; messages come from the
descriptor set that the package carries, so that nothing has to be generated. It shares no code with the crates.

    from dreamstream import stage

    class Maker:                                   # one per assignment
        def __init__(self, scene): ...             # the `Scene` message
        def restore(self, order, inputs): ...      # make the state before the order
        def work(self, order, inputs): ...         # yields (topic, index, camera, tick, message)
    stage.serve("sim", Maker)
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import queue
import secrets
import signal
import threading
import time
from importlib import resources
from typing import Any, Callable, Optional

import zenoh
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

try:
    import grpc
except ImportError as error:
    raise ImportError("a stage speaks gRPC: pip install 'dreamstream[stage]'") from error

TOPICS = ["", "scene", "advance", "world", "ego", "layout", "frame", "cache", "plan", "score", "event"]
PER_CAMERA = {"layout", "frame", "cache"}
ROLES = ["", "sim", "layout", "video", "policy"]
MAKER = {"world": "sim", "ego": "sim", "layout": "layout", "frame": "video", "plan": "policy"}
TAKES = {"sim": [], "layout": ["world"], "video": ["layout", "world"], "policy": ["frame", "ego"]}
PULL_AFTER, REPEAT_AFTER, BEAT = 0.2, 1.0, 0.25
_log = logging.getLogger("stage")


def _messages():
    pool = descriptor_pool.DescriptorPool()
    data = (resources.files("dreamstream") / "_wire" / "dreamstream.binpb").read_bytes()
    for file in descriptor_pb2.FileDescriptorSet.FromString(data).file:
        pool.Add(file)
    classes = message_factory.GetMessageClassesForFiles(["dreamstream/v1/%s.proto" % f for f in (
        "header", "advance", "world", "ego", "layout", "frame", "plan", "scene", "fleet")], pool)
    return {name.rsplit(".", 1)[1]: kind for name, kind in classes.items() if name.startswith("dreamstream.v1.")}


#: Message classes by name, such as `PB["World"]`.
PB = _messages()
BODY = {topic: PB[topic.capitalize()] for topic in ("scene", "advance", "world", "ego", "layout", "frame", "plan")}


class Fault(Exception):
    """An episode cannot go on; `name` is a lower-case word."""

    def __init__(self, name, detail):
        super().__init__(detail)
        self.name = name


def header_of(data):
    """Reads the header of a message, which is its first field, and nothing of the body."""
    length, shift, at = 0, 0, 1
    while True:
        length |= (data[at] & 0x7F) << shift
        shift, at = shift + 7, at + 1
        if data[at - 1] < 0x80:
            return PB["Header"].FromString(data[at:at + length])


def ticks_of(spec, iteration):
    """Returns the first and last tick of an iteration."""
    if iteration == 0:
        return 0, 0
    first = (iteration - 1) * spec.replan_period + 1
    return first, min(first + spec.replan_period - 1, spec.last_tick)


def seen_at(spec, tick):
    """Returns the first and last tick of the frames that a plan at a tick is made from."""
    last = max(tick - spec.observation_delay, 0)
    return max(last + 1 - max(spec.history, 1), 0), last


def due(scene, role, order, standing):
    """Returns the slots (topic, index, camera) that an order makes a role take."""
    spec, cameras = scene.spec, range(len(scene.scenario.cameras))
    span = lambda topic, first, last: [(topic, k, 0) for k in range(first, last + 1)]
    images = lambda topic, first, last: [(topic, k, c) for k in range(first, last + 1) for c in cameras]
    if role == "sim":
        return [] if standing or order.iteration == 0 else [("world", order.first_tick - 1, 0)]
    if role == "layout":
        return span("world", order.first_tick, order.last_tick)
    if role == "video":
        needs_world = spec.observation in (2, 3, 9, 10, 11)  # reference, sim-rgb, reprojected, logged, second-camera
        world = span("world", order.first_tick, order.last_tick) if needs_world else []
        return world + images("layout", order.first_tick, order.last_tick)
    if not order.plan_due:
        return []
    first, last = seen_at(spec, order.last_tick)
    return span("ego", first, order.last_tick) + images("frame", first, last)


class Hold:
    """One role of one episode: inbox, outbox and the maker. Only the stage's main thread enters it."""

    def __init__(self, stage, assign, lease_until):
        self.stage, self.episode, self.epoch, self.attempt = stage, assign.episode, assign.epoch, assign.attempt
        self.term, self.lease_until = assign.term, lease_until
        self.scene = self.maker = self.order = self.broken = None
        self.owners, self.orders, self.inbox, self.outbox, self.asked = {}, {}, {}, {}, {}
        self.stands_after, self.sequence, self.told = None, 0, 0.0
        enqueue = lambda sample: stage.events.put(("message", self, sample.payload.to_bytes(), False))
        bus, topics = stage.bus, ["scene", "advance"] + TAKES[stage.role]
        self.declared = [bus.declare_subscriber(f"dreamstream/v1/{self.episode}/{t}" + ("/*" if t in PER_CAMERA else ""), enqueue) for t in topics]
        pulls = f"dreamstream/v1/{self.episode}/pull/{stage.instance}/**"
        self.declared.append(bus.declare_queryable(pulls, lambda query: stage.events.put(("asked", self, query))))

    def leased(self):
        return time.monotonic() < self.lease_until

    def close(self):
        for declared in self.declared:
            declared.undeclare()

    def answer(self, query):
        """Answers who asks for a message; nothing is said for one that is not there."""
        _, _, _, _, _, topic, index, camera = str(query.key_expr).split("/")
        held = self.outbox.get((topic, int(index), int(camera)))
        if held and self.leased():
            query.reply(str(query.key_expr), held[1])
        query.drop()

    def take(self, data, pulled_from):
        """Takes a message in: orders by term and owner, inputs by the epoch of their publisher."""
        header = header_of(data)
        topic = TOPICS[header.slot.topic]
        if header.episode != self.episode or header.attempt != self.attempt or header.term < self.term:
            return
        if topic == "scene":
            if self.scene is None:
                self.scene = BODY["scene"].FromString(data)
        elif topic == "advance":
            self.accept(BODY["advance"].FromString(data))
        else:
            owner = self.owners.get(MAKER.get(topic))
            if pulled_from == "@journal" or (owner and owner == (header.publisher, header.epoch)):
                self.inbox.setdefault((topic, header.slot.index, header.slot.camera), data)

    def accept(self, order):
        owners = {ROLES[o.role]: (o.instance, o.epoch) for o in order.owners}
        mine = owners.get(self.stage.role)
        if mine != (self.stage.instance, self.epoch):
            if mine and mine[1] >= self.epoch:
                self.stage.let_go(self)  # a later holder has the role
            return
        self.term = order.header.term
        for role, owner in owners.items():
            if role not in self.owners or self.owners[role][1] < owner[1]:
                self.owners[role] = owner
        known = self.orders.setdefault(order.iteration, order.header.content)
        if known != order.header.content:
            self.fail("conflicting_advance", f"advance[{order.iteration}] came with another content")
        elif self.order is None and order.iteration == max(self.orders) and not self.made(order.iteration):
            self.order = order
        elif self.leased():  # the same order again: the same answer again
            for iteration, data in [held for held in self.outbox.values() if held[0] == order.iteration]:
                self.stage.publish(data)

    def made(self, iteration):
        return self.stands_after is not None and self.stands_after >= iteration

    def fail(self, name, detail):
        self.broken = (name, detail)
        self.stage.say(fault=PB["Fault"](episode=self.episode, epoch=self.epoch, fault_class=2, name=name, detail=detail[:4000]))

    def missing(self):
        if self.scene is None:
            return [("scene", 0, 0)]
        if self.order is None:
            return [("advance", max(self.orders, default=-1) + 1, 0)]
        standing = self.maker is not None and self.stands_after == self.order.iteration - 1
        slots = due(self.scene, self.stage.role, self.order, standing)
        return [slot for slot in slots if slot not in self.inbox]

    def go_on(self):
        """Works if all is there; asks for what is not."""
        now = time.monotonic()
        if self.broken:
            return
        missing = self.missing()
        if self.order is not None and not missing:
            self.carry_out(self.order)
            missing = []
        elif self.scene is not None and not self.orders and now - self.told > REPEAT_AFTER:
            self.told = now
            self.stage.say(ready=PB["Ready"](episode=self.episode, epoch=self.epoch))
        self.asked = {slot: self.asked.get(slot, (now + PULL_AFTER, 0)) for slot in missing}
        for slot, (at, tries) in self.asked.items():
            if at <= now:
                self.asked[slot] = (now + PULL_AFTER * 2 ** min(tries, 3), tries + 1)
                owner = self.owners.get(MAKER.get(slot[0]))
                self.stage.pull(self, slot, owner[0] if owner and tries % 2 == 0 else "@journal")

    def carry_out(self, order):
        self.order = None
        inputs = {slot: BODY[slot[0]].FromString(data) for slot, data in self.inbox.items()}
        try:
            if self.maker is None or self.stands_after != order.iteration - 1:
                self.maker = self.stage.make(self.scene)
                self.maker.restore(order, inputs)
            messages = [self.message(order, *output) for output in self.maker.work(order, inputs)]
        except Exception as error:
            _log.exception("episode %s", self.episode)
            return self.fail(getattr(error, "name", None) or "maker_failed", f"{type(error).__name__}: {error}")
        self.stands_after = order.iteration
        self.outbox = {s: held for s, held in self.outbox.items() if held[0] >= order.iteration - 1}
        self.outbox.update(messages)
        oldest = seen_at(self.scene.spec, order.last_tick)[0]
        self.inbox = {slot: data for slot, data in self.inbox.items() if slot[1] >= oldest}
        if self.leased():
            for _, (_, data) in messages:
                self.stage.publish(data)

    def message(self, order, topic, index, camera, tick, body):
        """Puts a header on a body. It leaves out the digest of the content, which readers then make themselves."""
        header = body.header
        header.episode, header.attempt, header.term, header.epoch = self.episode, self.attempt, self.term, self.epoch
        header.iteration, header.tick, header.time_ns = order.iteration, tick, tick * self.scene.scenario.dt_ns
        header.sequence, header.publisher, header.schema_version = self.sequence, self.stage.instance, 1
        header.slot.topic, header.slot.index, header.slot.camera = TOPICS.index(topic), index, camera
        self.sequence += 1
        return (topic, index, camera), (order.iteration, body.SerializeToString())


class Stage:
    """An instance of a stage: a member of the fleet that holds roles of episodes."""

    def __init__(self, role, make, *, orchestrator, router, slots, describe):
        self.role, self.make, self.slots, self.describe = role, make, slots, describe
        self.orchestrator = orchestrator
        self.instance = f"{role}-python-{secrets.token_hex(8)}"
        self.events, self.said = queue.Queue(), queue.Queue()
        self.holds, self.beats, self.sent, self.heard, self.leaving = {}, 0, {}, time.monotonic(), False
        config = zenoh.Config()
        for key, value in (("mode", "client"), ("connect/endpoints", [router]), ("connect/exit_on_failure", True),
                           ("scouting/multicast/enabled", False)):
            config.insert_json5(key, json.dumps(value))
        self.bus = zenoh.open(config)

    def say(self, **message):
        self.said.put(PB["FromInstance"](**message))

    def publish(self, data):
        header = header_of(data)
        topic = TOPICS[header.slot.topic]
        key = f"dreamstream/v1/{header.episode}/{topic}" + (f"/{header.slot.camera}" if topic in PER_CAMERA else "")
        self.bus.put(key, data)

    def pull(self, hold, slot, holder):
        reply = lambda r: r.ok is not None and self.events.put(("message", hold, r.ok.payload.to_bytes(), holder))
        topic, index, camera = slot
        key = f"dreamstream/v1/{hold.episode}/pull/{holder}/{topic}/{index}/{camera}"
        self.bus.get(key, reply, timeout=1.0)

    def let_go(self, hold):
        if self.holds.pop((hold.episode, hold.epoch), None):
            hold.close()
            self.say(released=PB["Released"](episode=hold.episode, epoch=hold.epoch))

    def beat(self):
        self.beats += 1
        self.sent[self.beats] = time.monotonic()
        holds = [PB["Ready"](episode=episode, epoch=epoch) for episode, epoch in self.holds]
        self.say(heartbeat=PB["Heartbeat"](progress=self.beats, holds=holds))

    def obey(self, order):
        kind = order.WhichOneof("message")
        if kind == "assign":
            told = order.assign
            until = self.heard + told.lease_millis / 1000
            self.holds[told.episode, told.epoch] = Hold(self, told, until)
        elif kind == "renew" and order.renew.progress in self.sent:
            # A lease counts from when the heartbeat was sent, never from when its answer came.
            self.heard = self.sent.pop(order.renew.progress)
            self.sent = {beat: at for beat, at in self.sent.items() if beat > order.renew.progress}
            for held in order.renew.holds:
                if (held.episode, held.epoch) in self.holds:
                    hold = self.holds[held.episode, held.epoch]
                    hold.lease_until = max(hold.lease_until, self.heard + order.renew.lease_millis / 1000)
        elif kind == "release" and (order.release.episode, order.release.epoch) in self.holds:
            self.let_go(self.holds[order.release.episode, order.release.epoch])
        elif kind == "drain":
            self.leave()

    def leave(self):
        if not self.leaving:
            self.leaving = True
            self.say(leaving=PB["Leaving"](reason="drained"))

    def session(self):
        """Is a member until the stream ends or it has left."""
        kind = hashlib.sha256(self.describe.encode()).digest()
        self.say(hello=PB["Hello"](instance=self.instance, role=ROLES.index(self.role), slots=self.slots, version="python",
                                   schema_version=1, compute_class=kind, compute_class_name=self.describe))
        channel = grpc.insecure_channel(self.orchestrator.removeprefix("http://"))
        join = channel.stream_stream("/dreamstream.v1.Fleet/Join", request_serializer=PB["FromInstance"].SerializeToString,
                                     response_deserializer=PB["ToInstance"].FromString)
        said = self.said

        def listen(orders):
            try:
                for order in orders:
                    self.events.put(("order", order))
            except grpc.RpcError as error:
                _log.warning("the control stream broke: %s", error.details())
            self.events.put(("cut",))

        threading.Thread(target=listen, args=(join(iter(said.get, None)),), daemon=True).start()
        next_beat = 0.0
        while not (self.leaving and not self.holds):
            if time.monotonic() >= next_beat:
                next_beat = time.monotonic() + BEAT
                self.beat()
            try:
                event = self.events.get(timeout=0.05)
            except queue.Empty:
                event = None
            if event and event[0] == "cut":
                break
            self.on(event)
            for hold in list(self.holds.values()):
                hold.go_on()
            if self.leaving:
                for hold in [h for h in self.holds.values() if h.order is None]:
                    self.let_go(hold)
        time.sleep(0.1)
        said.put(None)
        channel.close()

    def on(self, event):
        if event is None:
            return
        if event[0] == "order":
            self.obey(event[1])
        elif event[0] == "message" and event[1] in self.holds.values():
            event[1].take(event[2], event[3])
        elif event[0] == "asked":
            event[1].answer(event[2])

    def run(self):
        """Joins again whenever the stream breaks, as a new member without roles."""
        while not self.leaving:
            self.session()
            for hold in list(self.holds.values()):
                hold.close()
            self.holds, self.said = {}, queue.Queue()
            time.sleep(0.0 if self.leaving else 0.5)
        self.bus.close()


def serve(role: str, make: Callable[[Any], Any], *, slots: int = 16, describe: str = "python",
          orchestrator: Optional[str] = None, router: Optional[str] = None) -> None:
    """Serves a role (sim, layout, video or policy) until SIGTERM; `make` gives a maker for the `Scene` of an episode.

    Where to join comes from the arguments or from the environment, as `--stage` sets it.
    """
    logging.basicConfig(level=logging.WARNING)
    stage = Stage(role, make, slots=slots, describe=f"python {describe}",
                  orchestrator=orchestrator or os.environ.get("DREAMSTREAM_CONTROL_ORCHESTRATOR", "http://127.0.0.1:4710"),
                  router=router or os.environ.get("DREAMSTREAM_BUS_ROUTER", "tcp/127.0.0.1:7447"))
    for name in (signal.SIGTERM, signal.SIGINT):
        signal.signal(name, lambda *_: stage.leave())
    stage.run()
