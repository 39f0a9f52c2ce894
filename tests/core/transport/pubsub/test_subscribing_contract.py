"""Programs that misuse topics, by mistake or on purpose, do not affect others."""

import asyncio
import gc
import random
import threading
import time

import msgspec
import pytest

import srvgen
import taskrpc
from taskrpc import QoS, topic
from taskrpc.core.transport.connection.server_side import ServingConnection
from taskrpc.core.transport.network import Address
from taskrpc.core.wire import messages
from taskrpc.core.wire import topics as wire
from taskrpc.core.wire.events import SubscribeReceived
from taskrpc.errors import ProtocolError
from tests.core.transport.helpers import Add, add, ask, outcome, until

String = srvgen.load("std_msgs/msg/String")
Int32 = srvgen.load("std_msgs/msg/Int32")
SECRET = "a secret of sixteen"


async def joined(net, callback, depth=10):
    talker, listener = await net.node("talker"), await net.node("listener")
    publisher = talker.create_publisher(Int32, "counts", depth)
    subscription = listener.create_subscription(Int32, "counts", callback, depth)
    await until(publisher.get_subscription_count)
    await until(subscription.get_publisher_count)
    return publisher, subscription


async def test_an_endless_publishing_callback_does_not_block_the_loop(net):
    if net.is_virtual:
        return  # no time passes there as long as there is something to do
    node = await net.node("both")
    publisher = node.create_publisher(Int32, "counts")
    got = []

    def once_more(message):
        got.append(message.data)
        publisher.publish(Int32(data=message.data + 1))

    subscription = node.create_subscription(Int32, "counts", once_more)
    publisher.publish(Int32())
    await until(lambda: len(got) > 100)
    subscription.destroy()
    assert got == list(range(len(got)))


async def test_a_call_is_heard_beside_a_flood_that_is_never_read_up(net):
    server, client = await net.node("server"), await net.node("client")
    publisher = server.create_publisher(String, "text", 1000)
    server.create_service(Add, "add", add)
    got = []
    subscription = client.create_subscription(String, "text", got.append)
    calling = client.create_client(Add, "add")
    await until(publisher.get_subscription_count)
    assert await calling.wait_for_service(60)
    (feed,) = publisher._sender.feeds.values()
    over = asyncio.Event()

    async def flood():
        while not over.is_set():
            for _ in range(500 - len(feed.waiting)):
                publisher.publish(String(data="x" * 20_000))
            await asyncio.sleep(0.0001)

    flooding = asyncio.create_task(flood())
    await until(lambda: len(got) > 20)
    for _ in range(3):
        assert (await calling.call(ask(2, 3), timeout=3)).sum == 5
    subscription.destroy()
    await until(lambda: not publisher.get_subscription_count(), 3)
    over.set()
    await flooding


def ends_who_subscribes(self, event):
    self.refuse(ProtocolError("frame type 14 is not part of this protocol"))


async def test_a_peer_of_before_there_were_topics_is_asked_once_and_can_be_called(
    net, caplog, monkeypatch
):
    monkeypatch.setitem(ServingConnection.handlers, SubscribeReceived, ends_who_subscribes)
    if not net.by_address:
        return  # elsewhere, only publishing processes are asked
    server = await net.node("server", token=SECRET)
    server.create_service(Add, "add", add)
    client = await net.node("client", token=SECRET, peers=[server.address])
    subscription = client.create_subscription(String, "text", print)
    await until(lambda: of_topics(caplog))
    calling = client.create_client(Add, "add")
    assert await calling.wait_for_service(60)
    client.create_subscription(String, "more", print)
    for _ in range(20):
        assert (await calling.call(ask(2, 3))).sum == 5
        await asyncio.sleep(0.01)
    assert of_topics(caplog) == [
        f"{server.address} has no topics: it closed the connection when this program subscribed"
        " (frame type 14 is not part of this protocol)"
    ]
    assert subscription.get_publisher_count() == 0


async def test_a_peer_that_falls_silent_before_it_responds_is_asked_again(net, caplog, monkeypatch):
    talker, listener = await net.node("talker"), await net.node("listener")
    publisher = talker.create_publisher(Int32, "counts")
    asked = []
    with monkeypatch.context() as silent:
        silent.setitem(
            ServingConnection.handlers, SubscribeReceived, lambda _, it: asked.append(it)
        )
        listener.create_subscription(Int32, "counts", print)
        await until(lambda: asked)
    for connection in list(listener._transport.dialler.connections):
        connection.abort(ProtocolError("the peer did not acknowledge our output in time"))
    await until(publisher.get_subscription_count)
    assert of_topics(caplog) == []


def of_topics(caplog):
    return [each.getMessage() for each in caplog.records if each.name == "taskrpc.topics"]


async def test_a_peer_that_closes_connections_is_dialled_at_growing_intervals(net, monkeypatch):
    dialled = []

    def hangs_up(self, event):
        dialled.append(event)
        self.transport.abort()

    monkeypatch.setitem(ServingConnection.handlers, SubscribeReceived, hangs_up)
    talker, listener = await net.node("talker"), await net.node("listener")
    talker.create_publisher(Int32, "counts")
    listener.create_subscription(Int32, "counts", print)
    await asyncio.sleep(0.6)
    assert 1 < len(dialled) < 10


async def test_a_program_that_names_itself_among_its_peers_gets_its_messages_once(net, monkeypatch):
    if not net.by_address:
        return
    node = await net.node("both", token=SECRET, peers=["127.0.0.1:1"])
    got = []
    publisher = node.create_publisher(Int32, "counts")
    network, own = node._transport.network, Address(node.address, SECRET.encode())
    dial = network.dial
    monkeypatch.setattr(network, "dial", lambda _, factory: dial(own, factory))
    node.create_subscription(Int32, "counts", lambda message: got.append(message.data))
    await until(lambda: node._transport.dialler.connections)
    await asyncio.sleep(0.05)
    publisher.publish(Int32(data=1))
    publisher.publish(Int32(data=2))
    await asyncio.sleep(0.05)
    assert got == [1, 2]
    assert publisher.get_subscription_count() == 1


async def test_publishers_of_one_topic_never_share_a_number(net):
    talker, listener = await net.node("talker"), await net.node("listener")
    first = talker.create_publisher(Int32, "counts")
    talker._transport.topics._last_publisher = first._sender.number - 3 & 0xFFFF
    others = [talker.create_publisher(Int32, "counts") for _ in range(5)]
    got = []
    subscription = listener.create_subscription(Int32, "counts", got.append)
    await until(lambda: subscription.get_publisher_count() == 6)
    for publisher in (first, *others):
        publisher.publish(Int32())
    await until(lambda: len(got) == 6)
    assert subscription.lost == 0


async def test_destroyed_publishers_leave_nothing_for_a_slow_subscriber(net):
    talker, listener = await net.node("talker"), await net.node("listener")
    steady = talker.create_publisher(String, "text", 5)
    subscription = listener.create_subscription(String, "text", print, 5)
    await until(steady.get_subscription_count)
    (link,) = listener._transport.topics._links.values()
    link._connection.transport.pause_reading()
    while not steady.lost:
        steady.publish(String(data="x" * 60_000))
        await asyncio.sleep(0)
    (feed,) = steady._sender.feeds.values()
    for _ in range(100):
        passing = talker.create_publisher(String, "text", 5)
        passing.publish(String(data="x"))
        passing.destroy()
    assert list(feed._subscriber.feeds_behind) == [feed]
    subscription.destroy()
    link._connection.transport.resume_reading()
    await until(lambda: not steady.get_subscription_count())
    assert not feed._subscriber.feeds_behind
    assert feed._subscriber.owed == 0


async def test_a_callback_may_destroy_its_own_subscription_and_go_on(net):
    got, ended = [], asyncio.Event()

    async def only_one(message):
        await asyncio.sleep(0)
        got.append(message.data)
        subscription.destroy()
        await asyncio.sleep(0.001)
        ended.set()

    publisher, subscription = await joined(net, only_one)
    for number in range(3):
        publisher.publish(Int32(data=number))
    async with asyncio.timeout(60):
        await ended.wait()
    assert got == [0]


async def test_messages_that_are_not_valid_do_not_fill_the_log(net, caplog):
    got = []
    publisher, subscription = await joined(net, got.append)
    for _ in range(300):
        publisher._sender.publish(b"\xc1")
    publisher.publish(Int32(data=1))
    await until(lambda: got)
    lines = [text for text in caplog.messages if text.startswith("a message of /counts is not")]
    assert len(lines) == topic.MOST_LOGGED
    assert subscription.received == 301


async def test_a_plain_callback_that_is_too_slow_gets_the_newest_and_the_loop_goes_on(net):
    if net.is_virtual:
        return  # no time passes there while a callback runs
    got = []

    def slow(message):
        got.append(message.data)
        time.sleep(0.004)

    publisher, subscription = await joined(net, slow, 2)
    for number in range(500):
        publisher.publish(Int32(data=number))
    await until(lambda: got and got[-1] == 499)
    assert got == sorted(got)
    assert len(got) < 100  # of 500, in two seconds otherwise
    assert len(got) + subscription.dropped + subscription.lost == 500


@pytest.mark.parametrize(
    ("callback", "problem"),
    [
        (None, "expected a function that takes a message, got None"),
        (lambda: None, "expected a function that takes a message, got .*too many positional"),
        (lambda a, b: None, "expected a function that takes a message, got .*missing a required"),
    ],
)
async def test_an_invalid_callback_is_refused_at_once(net, callback, problem):
    node = await net.node("node")
    with pytest.raises(TypeError, match=f"the callback of /counts: {problem}"):
        node.create_subscription(Int32, "counts", callback)
    with pytest.raises(TypeError, match="expected a function that takes nothing"):
        node.create_timer(1.0, lambda message: None)
    assert node._transport._topics is None
    with pytest.raises(taskrpc.InvalidRequest, match=r"the class Int32 itself; write Int32\(\)"):
        node.create_publisher(Int32, "counts").publish(Int32)


async def test_a_program_has_so_many_subscriptions_at_another_and_no_more(net, caplog, monkeypatch):
    monkeypatch.setattr(wire, "MAX_SUBSCRIPTIONS", 50)
    server, client = await net.node("server"), await net.node("client")
    publisher = server.create_publisher(Int32, "counts")
    server.create_service(Add, "add", add)
    first = [client.create_subscription(Int32, "counts", print) for _ in range(50)]
    await until(lambda: publisher.get_subscription_count() == 50)
    more = [client.create_subscription(Int32, "counts", print) for _ in range(3)]
    await until(lambda: of_topics(caplog))
    assert "has 50 subscriptions of this program, the most it takes" in caplog.text
    first[0].destroy()
    await until(more[0].get_publisher_count)
    assert publisher.get_subscription_count() == 50
    assert len(of_topics(caplog)) == 1


async def test_a_caller_with_too_many_subscriptions_is_disconnected_alone(net, caplog):
    server, client = await net.node("server"), await net.node("client")
    publisher = server.create_publisher(Int32, "counts")
    server.create_service(Add, "add", add)
    subscription = client.create_subscription(Int32, "counts", print)
    await until(subscription.get_publisher_count)
    (link,) = client._transport.topics._links.values()
    wanted = subscription._receiver.named

    def subscribe_without_end(session):
        for number in range(10, wire.MAX_SUBSCRIPTIONS + 20):
            wire.subscribe(session, number, wanted)

    link._connection.say(subscribe_without_end)
    await until(lambda: any("more than 4096 subscriptions" in text for text in caplog.messages))
    other = await net.client(Add, "add", node="other")
    assert await other.wait_for_service(60)
    assert (await other.call(ask(1, 1))).sum == 2
    await until(lambda: publisher.get_subscription_count() == 1)


async def test_thousands_of_subscriptions_that_come_and_go_leave_nothing(net):
    talker, listener = await net.node("talker"), await net.node("listener")
    publisher = talker.create_publisher(Int32, "counts", QoS(2, durability="transient_local"))
    publisher.publish(Int32(data=1))
    wanted = QoS(1, durability="transient_local")
    keeper = listener.create_subscription(Int32, "counts", print, wanted)
    await until(publisher.get_subscription_count)
    rounds, each = (20, 50) if net.is_virtual else (4, 25)
    for _ in range(rounds):
        got = []
        some = [
            listener.create_subscription(Int32, "counts", got.append, wanted) for _ in range(each)
        ]
        await until(lambda got=got: len(got) == each)
        for subscription in some:
            subscription.destroy()
        await until(lambda: publisher.get_subscription_count() == 1)
        some.clear()
        del subscription
    gc.collect()
    alive = [each for each in gc.get_objects() if isinstance(each, topic.Subscription)]
    assert [each for each in alive if each.topic_name == "/counts"] == [keeper]
    if listener._transport.network.native is not None:
        return  # the connections carry no topics
    ours, theirs = listener._transport.topics, talker._transport.topics
    (link,) = ours._links.values()
    assert list(link.subscriptions.values()) == [keeper._receiver]
    assert [list(these) for these in ours._local_subscriptions.values()] == [[keeper._receiver]]
    assert [len(these) for these in theirs._remote_subscriptions.values()] == [1]


async def test_a_thread_that_waits_to_publish_learns_that_the_publisher_is_gone(net, monkeypatch):
    monkeypatch.setattr(topic, "MOST_HANDED_OFF", 2)
    node = await net.node("node")
    publisher = node.create_publisher(Int32, "counts")
    found = []

    def publish():
        try:
            for number in range(3):
                publisher.publish(Int32(data=number))
        except taskrpc.TaskRpcError as error:
            found.append(error)

    thread = threading.Thread(target=publish)
    thread.start()
    while len(publisher._pending) < 2:  # the loop is kept busy by us
        time.sleep(0.001)
    publisher.destroy()
    await asyncio.get_running_loop().run_in_executor(None, thread.join, 5)
    assert "is destroyed" in str(found)
    assert publisher.sent == 2
    assert await outcome(asyncio.sleep(0)) is None


async def test_publishers_of_one_turn_are_announced_together_before_their_messages(net):
    talker, listener = await net.node("talker"), await net.node("listener")
    known = []

    def hear(message):
        known.append((message.data, subscription.get_publisher_count()))

    first = talker.create_publisher(Int32, "counts")
    subscription = listener.create_subscription(Int32, "counts", hear)
    await until(subscription.get_publisher_count)
    told = []
    reception = subscription._receiver
    announced = reception.announced
    reception.announced = lambda link, publishers: [
        told.append(len(publishers)),
        announced(link, publishers),
    ]
    more = [talker.create_publisher(Int32, "counts") for _ in range(200)]
    await until(lambda: subscription.get_publisher_count() == 201)
    assert told == [201]
    for each in more:
        each.destroy()
    last = talker.create_publisher(Int32, "counts")
    last.publish(Int32(data=7))
    await until(lambda: known)
    assert known == [(7, 2)]
    assert (first.get_subscription_count(), last.get_subscription_count()) == (1, 1)


async def test_invalid_topic_frames_do_not_affect_other_callers(net, caplog):
    talker, hostile, other = [await net.node(name) for name in ("talker", "hostile", "other")]
    got = []
    publisher = talker.create_publisher(Int32, "counts", QoS(3, durability="transient_local"))
    mine = hostile.create_subscription(Int32, "counts", lambda message: None)
    other.create_subscription(Int32, "counts", got.append, 100)
    await until(lambda: publisher.get_subscription_count() == 2)
    chance = random.Random(7)
    (own,) = mine._announced
    wanted = [own, *_wishes(own)]

    def misuse(session):
        kind, number = chance.choice((14, 14, 14, 15, 16)), chance.choice((0, 1, 2, 3, 2**32 - 1))
        bodies = [b"", b"\xc1", b"\x97" + b"\xa1a" * 4, *map(messages.encode, wanted)]
        flags, method, arg = chance.randrange(256), chance.randrange(2**16), chance.randrange(2**32)
        session.send(kind, flags, method, number, arg, chance.choice(bodies))

    for number in range(100):
        for link in hostile._transport.topics._links.values():
            if link._connection is not None:
                for _ in range(chance.randrange(4)):
                    link._connection.say(misuse)
        publisher.publish(Int32(data=number))
        await asyncio.sleep(0.02 if net.is_virtual else 0.002)
    await until(lambda: len(got) == 100)
    assert numbers_of(got) == list(range(100))
    assert not [each for each in caplog.records if each.exc_info]
    mine.destroy()
    await until(lambda: publisher.get_subscription_count() == 1)


def numbers_of(got):
    return [message.data for message in got]


def _wishes(named):
    """Subscriptions that no program has: with great depths, long names, and other topics."""
    long = "/" + "é" * 511
    return [
        msgspec.structs.replace(named, depth=2**31, latched=True),
        msgspec.structs.replace(named, name=long, type_name=long, type_hash=long, node=long),
        msgspec.structs.replace(named, name="", node=""),
        msgspec.structs.replace(named, type_hash="another"),
    ]


async def test_a_blocking_sleep_between_messages_is_explained_in_the_log(net, caplog):
    if net.is_virtual:
        return  # no time passes there in a turn of the loop
    talker = await net.node("talker")
    publisher = talker.create_publisher(Int32, "counts")
    for number in range(3):
        publisher.publish(Int32(data=number))
        await asyncio.sleep(0.15)
    assert not caplog.messages
    for number in range(4):
        publisher.publish(Int32(data=number))
        time.sleep(0.15)
    (said,) = of_topics(caplog)
    assert said.startswith("messages were published on /counts for 0.")
    assert "write `await asyncio.sleep(...)` instead of `time.sleep(...)`" in said
