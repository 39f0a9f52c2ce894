"""Promise 25: messages arrive in order, losses are counted, slow readers cost bounded memory.

Publishers are killed and restarted, subscribers are disconnected, crash, or do not read; all in
memory, on virtual time, from one seed.
"""

import asyncio
import contextlib
import random

import pytest

import srvgen
import taskrpc
from taskrpc import QoS
from taskrpc.core.transport.pubsub import publishing, subscribing
from taskrpc.testing import FaultyNetwork
from tests.faults.harness import Bug, read_nothing
from tests.faults.planted import let_a_lost_subscription_go

pytestmark = pytest.mark.faults

String = srvgen.load("std_msgs/msg/String")
DEPTH = 8
SIZE = 8_000
LISTENERS = 5
SECONDS = 6.0
BUFFERS = 200_000
"""Bytes that may be in transit besides the queued ones: two buffers, and a message in each."""


def keeps_whatever_comes(patch):
    def keep(self, sequence, body):
        if not self.waiting:
            self._subscriber.feeds_behind[self] = None
        self.waiting.append((sequence, body))
        self._subscriber.owed += len(body)

    patch(publishing.Feed, "_keep", keep)


def drops_the_newest(patch):
    kept = publishing.Feed._keep

    def keep(self, sequence, body):
        if len(self.waiting) < DEPTH:
            kept(self, sequence, body)

    patch(publishing.Feed, "_keep", keep)


def overtakes_what_waits(patch):
    def behind(self):
        return self.connection.writing_paused and not len(self.feeds_behind) % 2

    patch(publishing.RemoteSubscriber, "is_behind", property(behind))


def gives_kept_messages_twice(patch):
    patch(subscribing, "_HALF", 2**33)


def forgets_nobody(patch):
    patch(publishing.RemoteSubscriber, "unsubscribe", lambda self, number: None)


class Talker:
    """A program that publishes numbers and may be killed; each start has its own letter."""

    def __init__(self, network, counts, chance):
        self.life = 0
        self.node = None
        self.publisher = None
        self._network, self._counts, self._chance = network, counts, chance

    async def begin(self):
        self.life += 1
        self.node = taskrpc.Node("talker", transport="memory", listen="talker")
        await self.node.start()
        qos = QoS(DEPTH, durability="transient_local")
        self.publisher = self.node.create_publisher(String, "numbers", qos)

    async def die(self):
        self._counts["publishers killed"] += 1
        self._network.crash("talker")
        await self.node.destroy()

    async def talk(self, seconds):
        loop = asyncio.get_running_loop()
        ends = loop.time() + seconds
        while loop.time() < ends:
            for _ in range(self._chance.choice((1, 1, 1, 40))):
                self.say()
            self.look()
            await asyncio.sleep(self._chance.uniform(0.0, 0.05))

    def say(self):
        number = self.publisher.sent
        self.publisher.publish(String(data=f"{self.life} {number} " + "x" * SIZE))
        self._counts["published"] += 1

    def look(self):
        """No subscriber costs more than the queue depth and the bytes in transit."""
        for feed in self.publisher._sender.feeds.values():
            transport = feed._subscriber.connection.transport
            buffered = 0 if transport is None else transport.get_write_buffer_size()
            size = feed._subscriber.owed + buffered
            if len(feed.waiting) > DEPTH or size > DEPTH * (SIZE + 100) + BUFFERS:
                self._counts["owed too much"] += 1


class Listener:
    """A program that subscribes and checks the messages."""

    def __init__(self, number, network, counts, chance):
        self.program = f"listener{number}"
        self.seen = {}
        self.node = None
        self._network, self._counts, self._chance = network, counts, chance

    async def begin(self):
        self.seen = {}
        self.node = taskrpc.Node(self.program, transport="memory", listen=self.program)
        await self.node.start()
        qos = QoS(1000, durability="transient_local")
        self.subscription = self.node.create_subscription(String, "numbers", self.take, qos)

    def take(self, message):
        life, number = map(int, message.data.split()[:2])
        last = self.seen.get(life, -1)
        self._counts["received"] += 1
        if number == last:
            self._counts["twice"] += 1
        elif number < last:
            self._counts["out of order"] += 1
        self.seen[life] = number

    async def suffer(self, seconds):
        loop = asyncio.get_running_loop()
        ends = loop.time() + seconds
        while loop.time() < ends:
            await asyncio.sleep(self._chance.uniform(0.5, 3.0))
            await self._chance.choice((self._cut, self._crash, self._sleep, self._sleep))()

    async def _cut(self):
        self._counts["cuts"] += 1
        self._network.cut(self.program, "talker")

    async def _crash(self):
        self._counts["subscribers crashed"] += 1
        self._network.crash(self.program)
        await self.node.destroy()
        await self.begin()

    async def _sleep(self):
        await read_nothing(self.node, self._counts, self._chance.uniform(0.2, 2.0))


async def until(condition, seconds):
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(seconds):
            while not condition():
                await asyncio.sleep(0.01)
    return condition()


@pytest.mark.planted(
    Bug(keeps_whatever_comes, "owed too much"),
    Bug(drops_the_newest, "without the newest"),
    Bug(overtakes_what_waits, "owed too much"),
    Bug(let_a_lost_subscription_go, "without the newest"),
    Bug(gives_kept_messages_twice, "out of order"),
    Bug(forgets_nobody, "fed after death"),
)
async def test_published_messages_arrive_in_order_or_are_counted(counts, seed, large):
    for round_ in range(40 if large else 3):
        await rehearse(counts, random.Random(f"{seed} {round_}"), round_)
    counts.check(
        *("out of order", "twice", "owed too much", "without the newest", "lost unseen"),
        "fed after death",
        happened=("received", "cuts", "subscribers crashed", "stopped reading", "lost"),
    )


async def rehearse(counts, chance, number):
    with FaultyNetwork(seed=number, delay=(0.0, 0.01), pieces=3000) as network:
        talker = Talker(network, counts, chance)
        listeners = [Listener(n, network, counts, chance) for n in range(LISTENERS)]
        await talker.begin()
        for listener in listeners:
            await listener.begin()
        for _ in range(2):
            await asyncio.gather(
                talker.talk(SECONDS), *(listener.suffer(SECONDS) for listener in listeners)
            )
            counts["lost"] += talker.publisher.lost
            await judge(counts, talker, listeners)
            await talker.die()
            await talker.begin()
        talker.say()
        await judge(counts, talker, listeners)
        for each in (talker, *listeners):
            await each.node.destroy()


async def judge(counts, talker, listeners):
    """All faults have ended: each subscriber must get the newest message, and know its losses."""
    publisher = talker.publisher
    for _ in range(2):  # the last message during the faults, then one more
        newest = publisher.sent - 1
        for listener in listeners:
            has = lambda each=listener, n=newest: each.seen.get(talker.life) == n  # noqa: E731
            if not await until(has, 20):
                counts["without the newest"] += 1
        talker.say()
    if publisher.get_subscription_count() > len(listeners):
        counts["fed after death"] += 1


async def test_each_message_arrived_or_was_counted_at_both_ends(counts, seed, large):
    """For one publisher, over all connections: arrived + lost = published since the first."""
    for round_ in range(20 if large else 3):
        chance = random.Random(f"{seed} {round_}")
        with FaultyNetwork(seed=round_, delay=(0.0, 0.01), pieces=3000) as network:
            talker = Talker(network, counts, chance)
            listener = Listener(0, network, counts, chance)
            await talker.begin()
            await listener.begin()
            await until(lambda talker=talker: talker.publisher.get_subscription_count(), 5)
            listener._crash = listener._cut
            await asyncio.gather(talker.talk(SECONDS), listener.suffer(SECONDS))
            await judge(counts, talker, [listener])
            subscription = listener.subscription
            newest = talker.publisher.sent - 1
            has = lambda life=talker.life, n=newest: listener.seen.get(life) == n  # noqa: B023,E731
            await until(has, 20)
            came, lost = subscription.received, subscription.lost
            counts["lost"] += lost
            if came + lost != talker.publisher.sent or subscription.dropped:
                counts["lost unseen"] += 1
            await talker.node.destroy()
            await listener.node.destroy()
    counts.check("lost unseen", "out of order", "twice", happened=("lost", "received", "cuts"))
