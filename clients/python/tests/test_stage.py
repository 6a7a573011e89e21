"""The stage protocol without a fleet: what is due when, and what a role does with orders that come once, twice or changed."""

import queue
import types

import pytest

from dreamstream import stage

PB = stage.PB


def scene(*, cameras=1, replan=5, last=12, history=1, delay=0, observation=1):
    made = PB["Scene"](scenario=dict(dt_ns=100_000_000, cameras=[{}] * cameras))
    made.spec.replan_period, made.spec.last_tick, made.spec.history = replan, last, history
    made.spec.observation_delay, made.spec.observation = delay, observation
    return head(made, "scene", 0)


def head(message, topic, index, publisher="orchestrator", epoch=0):
    message.header.episode, message.header.attempt, message.header.term, message.header.epoch = "e", 1, 1, epoch
    message.header.slot.topic, message.header.slot.index = stage.TOPICS.index(topic), index
    message.header.publisher = publisher
    return message


def order(iteration, first, last, *, plan_due=True, content=b"a"):
    made = PB["Advance"](iteration=iteration, first_tick=first, last_tick=last, plan_due=plan_due)
    for role, instance in [("layout", "me"), ("sim", "simulator")]:
        made.owners.add(role=stage.ROLES.index(role), instance=instance, epoch=3)
    made.header.content = content
    return head(made, "advance", iteration)


@pytest.mark.parametrize("iteration, ticks", [(0, (0, 0)), (1, (1, 5)), (2, (6, 10)), (3, (11, 12))])
def test_ticks_of_an_iteration(iteration, ticks):
    assert stage.ticks_of(scene().spec, iteration) == ticks


@pytest.mark.parametrize("history, delay, tick, seen", [(1, 0, 5, (5, 5)), (3, 0, 5, (3, 5)), (3, 2, 5, (1, 3)), (4, 9, 5, (0, 0))])
def test_ticks_that_a_plan_is_made_from(history, delay, tick, seen):
    assert stage.seen_at(scene(history=history, delay=delay).spec, tick) == seen


@pytest.mark.parametrize("role, standing, slots", [
    ("sim", True, []),
    ("sim", False, [("world", 5, 0)]),
    ("layout", True, [("world", 6, 0), ("world", 7, 0)]),
    ("video", True, [("layout", 6, 0), ("layout", 6, 1), ("layout", 7, 0), ("layout", 7, 1)]),
    ("policy", True, [("ego", 7, 0), ("frame", 7, 0), ("frame", 7, 1)]),
])
def test_what_an_order_makes_due(role, standing, slots):
    assert stage.due(scene(cameras=2), role, order(2, 6, 7), standing) == slots


def test_a_camera_of_the_world_takes_its_states_too():
    assert ("world", 6, 0) in stage.due(scene(observation=2), "video", order(2, 6, 7), True)


def test_a_policy_without_a_plan_due_takes_nothing():
    assert stage.due(scene(), "policy", order(2, 6, 7, plan_due=False), True) == []


def test_the_header_is_read_without_the_body():
    message = head(PB["Layout"](), "layout", 300)
    assert stage.header_of(message.SerializeToString() + b"\xff\xff\xff") == message.header


class Maker:
    """Makes one layout per tick; says when it had to be restored."""

    def __init__(self, given):
        self.restored = 0

    def restore(self, given, inputs):
        self.restored += 1

    def work(self, given, inputs):
        for tick in range(given.first_tick, given.last_tick + 1):
            yield "layout", tick, 0, tick, PB["Layout"]()


@pytest.fixture
def held():
    """A hold of the layout role on a bus that keeps what is published."""
    declared = types.SimpleNamespace(undeclare=lambda: None)
    bus = types.SimpleNamespace(declare_subscriber=lambda *_: declared, declare_queryable=lambda *_: declared)
    fake = types.SimpleNamespace(role="layout", instance="me", bus=bus, events=queue.Queue(), make=Maker, published=[], said=[], asked=[])
    fake.publish = fake.published.append
    fake.say = lambda **message: fake.said.append(message)
    fake.pull = lambda hold, slot, holder: fake.asked.append((slot, holder))
    fake.let_go = lambda hold: fake.said.append({"let_go": hold})
    assign = types.SimpleNamespace(episode="e", epoch=3, attempt=1, term=1)
    hold = stage.Hold(fake, assign, float("inf"))
    hold.take(scene().SerializeToString(), False)
    return hold, fake


def world(tick):
    return head(PB["World"](tick=tick), "world", tick, publisher="simulator", epoch=3).SerializeToString()


def give(hold, message):
    hold.take(message if isinstance(message, bytes) else message.SerializeToString(), False)
    hold.go_on()


def test_outputs_are_published_when_all_is_there_and_again_when_the_order_is_repeated(held):
    hold, fake = held
    for message in [order(0, 0, 0), world(0)]:
        give(hold, message)
    assert len(fake.published) == 1 and hold.maker.restored == 1
    header = stage.header_of(fake.published[0])
    assert (header.publisher, header.epoch, header.slot.index, stage.TOPICS[header.slot.topic]) == ("me", 3, 0, "layout")
    give(hold, order(0, 0, 0))
    assert fake.published[0] == fake.published[1] and hold.maker.restored == 1
    for message in [order(1, 1, 2), world(1), world(2)]:
        give(hold, message)
    assert [stage.header_of(data).slot.index for data in fake.published[2:]] == [1, 2] and hold.maker.restored == 1


def test_an_order_with_another_content_is_a_fault(held):
    hold, fake = held
    for message in [order(0, 0, 0), world(0), order(0, 0, 0, content=b"b")]:
        give(hold, message)
    assert fake.said[-1]["fault"].name == "conflicting_advance"


def test_a_later_holder_ends_the_hold(held):
    hold, fake = held
    later = order(0, 0, 0)
    later.owners[0].instance, later.owners[0].epoch = "another", 4
    hold.take(later.SerializeToString(), False)
    assert fake.said == [{"let_go": hold}] and fake.published == []


def test_what_does_not_come_is_asked_for_at_its_owner_and_the_journal_in_turn(held, monkeypatch):
    hold, fake = held
    now = [0.0]
    monkeypatch.setattr(stage.time, "monotonic", lambda: now[0])
    give(hold, order(0, 0, 0))
    for _ in range(6):
        now[0] += 0.3
        hold.go_on()
    assert fake.asked[:2] == [(("world", 0, 0), "simulator"), (("world", 0, 0), "@journal")]


def test_a_maker_that_fails_is_a_named_fault(held):
    hold, fake = held

    def fail(*_):
        raise stage.Fault("no_road", "the scene has no lane")

    fake.make = lambda given: types.SimpleNamespace(restore=fail)
    for message in [order(0, 0, 0), world(0)]:
        give(hold, message)
    assert fake.said[-1]["fault"].name == "no_road" and fake.published == []
