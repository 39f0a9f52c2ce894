"""A subscription gets each matching message once and in order, or counts it as lost."""

import asyncio
import dataclasses

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

import srvgen
import taskrpc
from taskrpc import QoS
from taskrpc.testing import VirtualTimeLoop
from taskrpc.topic import Publisher, Subscription
from tests.properties import examples

TYPES = [srvgen.load("std_msgs/msg/String"), srvgen.load("std_msgs/msg/Char")]
TEXT = TYPES[0]
PROGRAMS = 3
SETTLED = 10.0
"""Seconds after which all connections are made and all messages are read."""

qualities = st.builds(
    QoS,
    st.integers(1, 5),
    st.sampled_from(["reliable", "reliable", "best_effort"]),
    st.sampled_from(["volatile", "transient_local"]),
)


@dataclasses.dataclass(eq=False)
class Talker:
    number: int
    program: int
    topic: str
    inner: Publisher
    sent: int = 0

    def matches(self, listener):
        """The rules of ROS 2, implemented a second time."""
        mine, asked = self.inner.qos, listener.inner.qos
        return (
            self.topic == listener.topic
            and self.inner.msg_type is listener.inner.msg_type
            and not (asked.is_reliable and not mine.is_reliable)
            and not (asked.is_latched and not mine.is_latched)
        )


@dataclasses.dataclass(eq=False)
class Listener:
    program: int
    topic: str
    inner: Subscription = None
    got: dict[int, list[int]] = dataclasses.field(default_factory=dict)
    """By talker."""
    since: dict[int, int] = dataclasses.field(default_factory=dict)
    """How many messages each talker had sent when it was matched."""

    def hear(self, message):
        talker, number = map(int, message.data.split()[:2])
        self.got.setdefault(talker, []).append(number)


class Topics(RuleBasedStateMachine):
    """Three programs in memory, on virtual time."""

    @initialize()
    def begin(self):
        self.runner = asyncio.Runner(loop_factory=VirtualTimeLoop)
        self.talkers, self.listeners, self.ever = [], [], 0
        self.nodes = [
            taskrpc.Node("node", transport="memory", token=f"program {number}")
            for number in range(PROGRAMS)
        ]
        for node in self.nodes:
            self.runner.run(node.start())
        kept = QoS(3, durability="transient_local")
        self.publisher(program=0, topic="a", cls=0, qos=kept)
        self.publish(which=0, count=3)
        self.subscription(program=1, topic="a", qos=kept)

    def teardown(self):
        if hasattr(self, "runner"):
            for node in self.nodes:
                self.runner.run(node.destroy())
            self.runner.close()

    def settle(self):
        self.runner.run(asyncio.sleep(SETTLED))
        for listener in self.listeners:
            for talker in self.talkers:
                if talker.matches(listener):
                    listener.since.setdefault(talker.number, talker.sent)

    @rule(
        program=st.integers(0, 2),
        topic=st.sampled_from("aab"),
        cls=st.integers(0, 6),
        qos=qualities,
    )
    def publisher(self, program, topic, cls, qos):
        async def create():
            return self.nodes[program].create_publisher(TYPES[cls == 6], topic, qos)

        self.ever += 1
        self.talkers.append(Talker(self.ever, program, topic, self.runner.run(create())))
        self.settle()

    @rule(program=st.integers(0, 2), topic=st.sampled_from("aab"), qos=qualities)
    def subscription(self, program, topic, qos):
        listener = Listener(program, topic)

        async def create():
            return self.nodes[program].create_subscription(TEXT, topic, listener.hear, qos)

        listener.inner = self.runner.run(create())
        self.listeners.append(listener)
        before = {each.number: each for each in self.talkers}
        self.settle()
        for talker in before.values():
            self.check_latched_messages(talker, listener)

    def check_latched_messages(self, talker, listener):
        mine, asked = talker.inner.qos, listener.inner.qos
        kept = min(mine.depth, asked.depth, talker.sent)
        if not (talker.matches(listener) and mine.is_latched and asked.is_latched):
            kept = 0
        got = listener.got.get(talker.number, [])
        expected = list(range(talker.sent - kept, talker.sent))
        if listener.inner.dropped:  # in one process, several may arrive at once
            assert got == expected[len(expected) - len(got) :]
        else:
            assert got == expected

    @precondition(lambda self: self.talkers)
    @rule(which=st.integers(0, 99), count=st.integers(1, 3))
    def publish(self, which, count):
        talker = self.talkers[which % len(self.talkers)]
        for _ in range(count):
            self.say(talker)
            self.settle()
        for listener in self.listeners:
            if talker.matches(listener):
                newest = list(range(talker.sent - count, talker.sent))
                assert listener.got[talker.number][-count:] == newest

    def check_newest_messages(self):
        for talker in self.talkers:
            for listener in self.listeners:
                if talker.matches(listener):
                    assert listener.got[talker.number][-1] == talker.sent - 1

    def say(self, talker, size=0):
        async def publish():
            text = f"{talker.number} {talker.sent} " + "x" * size
            is_text = talker.inner.msg_type is TEXT
            talker.inner.publish(TEXT(data=text) if is_text else talker.inner.msg_type())

        self.runner.run(publish())
        talker.sent += 1

    def links(self, program):
        topics = self.nodes[program]._transport._topics
        links = () if topics is None else topics._links.values()
        return [each._connection for each in links if each._connection is not None]

    @rule(program=st.integers(0, 2), count=st.integers(15, 30))
    def stop_reading(self, program, count):
        """A program does not read while all others publish; then it reads again."""
        ends = [each.transport for each in self.links(program)]
        for transport in ends:
            transport.pause_reading()
        for talker in self.talkers:
            for _ in range(count):
                self.say(talker, 20_000)
                self.runner.run(asyncio.sleep(0.001))
        for transport in ends:
            transport.resume_reading()
        self.settle()
        self.check_newest_messages()

    @rule(program=st.integers(0, 2), count=st.integers(0, 4))
    def cut(self, program, count):
        """A program's connections are lost, and messages are published before it reconnects."""
        for connection in self.links(program):
            connection.transport.abort()
        for talker in self.talkers:
            for _ in range(count):
                self.say(talker)
        self.settle()
        for talker in self.talkers:
            self.say(talker)
        self.settle()
        self.check_newest_messages()

    @precondition(lambda self: self.talkers)
    @rule(which=st.integers(0, 99))
    def destroy_publisher(self, which):
        talker = self.talkers.pop(which % len(self.talkers))
        self.runner.run(_do(talker.inner.destroy))
        self.settle()

    @precondition(lambda self: self.listeners)
    @rule(which=st.integers(0, 99))
    def destroy_subscription(self, which):
        listener = self.listeners.pop(which % len(self.listeners))
        self.runner.run(_do(listener.inner.destroy))
        self.settle()

    @invariant()
    def matches_are_counted_at_both_ends(self):
        if not hasattr(self, "runner"):
            return
        for talker in self.talkers:
            count = sum(talker.matches(each) for each in self.listeners)
            assert talker.inner.get_subscription_count() == count
        for listener in self.listeners:
            count = sum(each.matches(listener) for each in self.talkers)
            assert listener.inner.get_publisher_count() == count

    @invariant()
    def messages_arrive_once_and_in_order(self):
        for listener in getattr(self, "listeners", ()):
            for numbers in listener.got.values():
                assert numbers == sorted(set(numbers))

    @invariant()
    def lost_messages_are_counted(self):
        """For a subscription with one publisher, from its first message."""
        for listener in getattr(self, "listeners", ()):
            heard = {number: got for number, got in listener.got.items() if got}
            alone = [each for each in self.talkers if each.matches(listener)]
            if len(alone) == 1 and set(heard) == {alone[0].number}:
                (got,) = heard.values()
                lost = listener.inner.lost + listener.inner.dropped
                assert len(got) + lost >= got[-1] - got[0] + 1

    @invariant()
    def no_memory_is_owed(self):
        for node in getattr(self, "nodes", ()):
            served = () if node._transport is None else node._transport._served
            for connection in served:
                if connection.subscriber is not None:
                    assert connection.subscriber.owed == 0
                    assert not connection.subscriber.feeds_behind


async def _do(action):
    action()


TestTopics = Topics.TestCase
TestTopics.settings = settings(max_examples=examples(60), stateful_step_count=20)
