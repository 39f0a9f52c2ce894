"""Topics behave the same over every transport: receivers, order and losses."""

import asyncio

import pytest

import srvgen
import taskrpc
from taskrpc import QoS
from taskrpc.qos import Timing
from tests.core.transport.helpers import until, until_seen

String = srvgen.load("std_msgs/msg/String")
Int32 = srvgen.load("std_msgs/msg/Int32")
LATCHED = QoS(3, durability="transient_local")


def numbers(messages):
    return [message.data for message in messages]


async def joined(net, qos=10, callback=None):
    """A publisher and a subscription in endpoints of their own, and what the latter gets."""
    talker, listener = await net.node("talker"), await net.node("listener")
    got = []
    publisher = talker.create_publisher(Int32, "counts", qos)
    subscription = listener.create_subscription(Int32, "counts", callback or got.append, qos)
    await until(publisher.get_subscription_count)
    await until(subscription.get_publisher_count)
    return publisher, subscription, got


async def test_messages_come_in_the_order_in_which_they_were_published(net):
    publisher, subscription, got = await joined(net)
    for number in range(500):
        publisher.publish(Int32(data=number))
    await until(lambda: len(got) == 500)
    assert numbers(got) == list(range(500))
    assert (publisher.sent, subscription.received) == (500, 500)
    assert publisher.lost == subscription.lost == subscription.dropped == 0


async def test_only_native_topics_use_no_connection_of_taskrpc(net):
    """So native topics have none of a connection's queues, limits, announcements and retries."""
    talker, listener = await net.node("talker"), await net.node("listener")
    got = []
    publisher = talker.create_publisher(Int32, "counts")
    listener.create_subscription(Int32, "counts", got.append)
    await until(publisher.get_subscription_count)
    publisher.publish(Int32(data=7))
    await until(lambda: got)
    assert len(listener._transport.topics._links) == (0 if net.has_native_topics else 1)


async def test_publisher_and_subscription_match_in_any_order(net):
    listener = await net.node("listener")
    got = []
    subscription = listener.create_subscription(Int32, "counts", got.append)
    assert subscription.get_publisher_count() == 0
    publisher = (await net.node("talker")).create_publisher(Int32, "counts")
    await until(publisher.get_subscription_count)
    publisher.publish(Int32(data=7))
    await until(lambda: got)
    assert numbers(got) == [7]


@pytest.mark.parametrize("reader", ["talker", "listener"])
async def test_both_sides_are_notified_of_matches_and_their_ends(net, reader):
    """Whether they are in one endpoint or in two."""
    nodes = {name: await net.node(name) for name in ("talker", "listener")}
    told = []
    subscription = nodes[reader].create_subscription(Int32, "counts", print)
    subscription.on_matched = lambda: told.append(subscription.get_publisher_count())
    publisher = nodes["talker"].create_publisher(Int32, "counts")
    publisher.on_matched = lambda: told.append(-publisher.get_subscription_count())
    await until(lambda: {1, -1} <= set(told))
    told.clear()
    publisher.destroy()
    await until(lambda: told)
    assert set(told) == {0}


async def test_many_publishers_feed_many_subscriptions(net):
    got = [[] for _ in range(6)]
    listeners = [await net.node(f"listener{number}") for number in range(3)]
    for number, box in enumerate(got):
        listeners[number % 3].create_subscription(Int32, "counts", box.append, 100)
    talkers = [await net.node(f"talker{number}") for number in range(3)]
    publishers = [node.create_publisher(Int32, "counts", 100) for node in talkers]
    for publisher in publishers:
        await until(lambda publisher=publisher: publisher.get_subscription_count() == 6)
    for number in range(20):
        for sender, publisher in enumerate(publishers):
            publisher.publish(Int32(data=100 * sender + number))
    await until(lambda: all(len(box) == 60 for box in got))
    for box in got:
        for sender in range(3):
            assert [each for each in numbers(box) if each // 100 == sender] == [
                100 * sender + number for number in range(20)
            ]


async def test_a_program_gets_what_it_publishes_itself(net):
    node = await net.node("both")
    got, more = [], []
    publisher = node.create_publisher(Int32, "counts")
    node.create_subscription(Int32, "counts", got.append)
    node.create_subscription(Int32, "/counts", more.append)
    assert publisher.get_subscription_count() == 2
    publisher.publish(Int32(data=1))
    assert not got  # never in the midst of publish()
    await until(lambda: got and more)
    assert got[0] == more[0] == Int32(data=1)
    assert got[0] is not more[0]


async def test_a_callback_may_publish_what_it_gets(net):
    node = await net.node("both")
    publisher = node.create_publisher(Int32, "counts")
    got = []

    def once_more(message):
        got.append(message.data)
        if message.data < 50:
            publisher.publish(Int32(data=message.data + 1))

    node.create_subscription(Int32, "counts", once_more)
    publisher.publish(Int32())
    await until(lambda: len(got) == 51)
    assert got == list(range(51))


async def test_a_large_message_arrives_whole(net):
    talker, listener = await net.node("talker"), await net.node("listener")
    got = []
    publisher = talker.create_publisher(String, "text")
    listener.create_subscription(String, "text", got.append)
    await until(publisher.get_subscription_count)
    text = "0123456789" * 300_000
    publisher.publish(String(data="before"))
    publisher.publish(String(data=text))
    publisher.publish(String(data="after"))
    await until(lambda: len(got) == 3)
    assert numbers(got) == ["before", text, "after"]


async def test_latecomers_get_the_last_messages_of_a_transient_local_publisher(net):
    talker, listener = await net.node("talker"), await net.node("listener")
    got, volatile, own = [], [], []
    publisher = talker.create_publisher(Int32, "counts", LATCHED)
    for number in range(10):
        publisher.publish(Int32(data=number))
    # A middleware may still have the messages on their way: then they would be no earlier ones.
    await asyncio.sleep(0.1)
    subscriptions = [
        listener.create_subscription(Int32, "counts", got.append, LATCHED),
        listener.create_subscription(Int32, "counts", volatile.append),
        talker.create_subscription(Int32, "counts", own.append, LATCHED),
    ]
    await until(lambda: publisher.get_subscription_count() == 3)
    await until(lambda: all(each.get_publisher_count() == 1 for each in subscriptions))
    await until(lambda: len(got) == 3)
    publisher.publish(Int32(data=10))
    await until(lambda: got and volatile and own and volatile[0].data == got[-1].data)
    assert numbers(got) == [7, 8, 9, 10]
    assert numbers(own)[-1] == 10
    assert numbers(volatile) == [10]


async def test_a_latecomer_that_keeps_one_gets_the_last_one(net):
    talker, listener = await net.node("talker"), await net.node("listener")
    publisher = talker.create_publisher(Int32, "counts", LATCHED)
    for number in range(3):
        publisher.publish(Int32(data=number))
    await asyncio.sleep(0.1)  # as above
    got = []
    latest = QoS(1, durability="transient_local")
    listener.create_subscription(Int32, "counts", got.append, latest)
    await until(lambda: got)
    assert numbers(got) == [2]


@pytest.mark.parametrize(
    ("offered", "wanted", "policy"),
    [
        (QoS(reliability="best_effort"), QoS(), "RELIABILITY"),
        (QoS(), LATCHED, "DURABILITY"),
    ],
)
async def test_both_ends_report_incompatible_qos(net, caplog, offered, wanted, policy):
    talker, listener = await net.node("talker"), await net.node("listener")
    publisher = talker.create_publisher(Int32, "counts", offered)
    subscription = listener.create_subscription(Int32, "counts", print, wanted)
    await until(lambda: len(caplog.records) >= 2)
    publisher.publish(Int32())
    assert publisher.get_subscription_count() == subscription.get_publisher_count() == 0
    assert sorted(caplog.messages) == [
        "New publisher discovered on topic '/counts', offering incompatible QoS. No messages"
        f" will be received from it. Last incompatible policy: {policy}",
        "New subscription discovered on topic '/counts', requesting incompatible QoS. No messages"
        f" will be sent to it. Last incompatible policy: {policy}",
    ]


@pytest.mark.parametrize(
    ("offered", "wanted"),
    [(QoS(), QoS(reliability="best_effort")), (LATCHED, QoS()), (LATCHED, LATCHED)],
)
async def test_more_than_was_asked_for_matches(net, caplog, offered, wanted):
    talker, listener = await net.node("talker"), await net.node("listener")
    publisher = talker.create_publisher(Int32, "counts", offered)
    listener.create_subscription(Int32, "counts", print, wanted)
    await until(publisher.get_subscription_count)
    assert not caplog.records


async def test_both_ends_report_a_different_type(net, caplog):
    talker, listener = await net.node("talker"), await net.node("listener")
    publisher = talker.create_publisher(Int32, "counts")
    subscription = listener.create_subscription(String, "counts", print)
    await until(lambda: len(caplog.records) >= 2)
    assert publisher.get_subscription_count() == subscription.get_publisher_count() == 0
    for message in caplog.messages:
        assert "std_msgs/msg/Int32" in message
        assert "std_msgs/msg/String" in message


async def test_a_destroyed_publisher_or_subscription_exchanges_no_messages(net):
    publisher, subscription, got = await joined(net)
    subscription.destroy()
    await until(lambda: not publisher.get_subscription_count())
    publisher.publish(Int32(data=1))
    publisher.destroy()
    with pytest.raises(taskrpc.TaskRpcError, match="destroyed"):
        publisher.publish(Int32())
    subscription.destroy()
    publisher.destroy()
    assert not got


async def test_a_subscription_survives_its_publishers(net):
    listener = await net.node("listener")
    got = []
    subscription = listener.create_subscription(Int32, "counts", got.append)
    for number in range(3):
        talker = await net.node("talker")
        publisher = talker.create_publisher(Int32, "counts")
        await until(publisher.get_subscription_count)
        publisher.publish(Int32(data=number))
        await until(lambda number=number: len(got) == number + 1)
        await talker.destroy()
        await until(lambda: not subscription.get_publisher_count())
    assert numbers(got) == [0, 1, 2]
    assert subscription.lost == 0


async def test_the_last_words_of_a_node_arrive(net):
    publisher, _, got = await joined(net)
    for number in range(100):
        publisher.publish(Int32(data=number))
    await publisher._forget.__self__.destroy()
    await until(lambda: len(got) == 100)


async def test_the_graph_contains_publishers_and_subscriptions(net):
    publisher, subscription, _ = await joined(net, LATCHED)
    looking = await net.node("looking")
    entries = await looking.graph()
    publishers = [each for entry in entries for each in entry.publishers]
    subscriptions = [each for entry in entries for each in entry.subscriptions]
    (there,), (wanted,) = publishers, subscriptions
    assert (there.name, there.type_name, there.node) == ("/counts", "std_msgs/msg/Int32", "/talker")
    assert (there.depth, there.reliable, there.latched) == (3, True, True)
    assert wanted.node == "/listener"
    publisher.destroy()
    subscription.destroy()
    await until_seen(
        looking, lambda them: not any([*each.publishers, *each.subscriptions] for each in them)
    )


async def test_a_slow_callback_keeps_the_last_messages_and_counts_the_others(net):
    gate, got = asyncio.Event(), []

    async def slow(message):
        got.append(message.data)
        await gate.wait()

    publisher, subscription, _ = await joined(net, 4, slow)
    for number in range(50):
        publisher.publish(Int32(data=number))
    await until(lambda: subscription.received == 50)
    assert got == [0]
    gate.set()
    await until(lambda: len(got) == 5)
    assert got == [0, 46, 47, 48, 49]
    assert subscription.dropped == 45
    assert publisher.lost == subscription.lost == 0


async def test_an_exception_in_a_callback_is_logged_and_ends_nothing(net, caplog):
    got = []

    def shaky(message):
        got.append(message.data)
        raise RuntimeError("this one")

    publisher, _, _ = await joined(net, 10, shaky)
    publisher.publish(Int32(data=1))
    publisher.publish(Int32(data=2))
    await until(lambda: len(got) == 2)
    assert "this one" in caplog.text


async def test_a_message_of_another_type_is_refused(net):
    publisher, _, _ = await joined(net)
    with pytest.raises(taskrpc.InvalidRequest, match="expected a std_msgs/msg/Int32"):
        publisher.publish(String())
    with pytest.raises(taskrpc.InvalidRequest, match="data"):
        publisher.publish(Int32(data=2**40))


async def test_a_service_is_no_message(net):
    node = await net.node("node")
    with pytest.raises(TypeError, match="expected a message type"):
        node.create_publisher(srvgen.load("std_srvs/srv/Trigger"), "x")
    with pytest.raises(taskrpc.InvalidName, match="Invalid topic name"):
        node.create_subscription(Int32, "no spaces", print)


async def test_mismatches_that_a_peer_makes_up_do_not_fill_the_log(net, caplog):
    talker, listener = await net.node("talker"), await net.node("listener")
    talker.create_publisher(Int32, "counts", QoS(reliability="best_effort"))
    matching = talker.create_publisher(Int32, "counts")
    for depth in range(1, 151):
        listener.create_subscription(Int32, "counts", print, depth)
    await until(lambda: matching.get_subscription_count() == 150)
    of_publisher = [text for text in caplog.messages if text.startswith("New subscription")]
    assert len(of_publisher) == 100


async def test_a_mismatch_callback_replaces_the_log_line(net, caplog):
    talker, listener = await net.node("talker"), await net.node("listener")
    offered, wanted = [], []
    talker.create_publisher(
        Int32, "counts", QoS(reliability="best_effort"), on_mismatch=offered.append
    )
    listener.create_subscription(Int32, "counts", print, on_mismatch=wanted.append)
    latched = QoS(3, "best_effort", "transient_local")
    talker.create_subscription(Int32, "counts", print, latched, on_mismatch=wanted.append)
    await until(lambda: len(offered) == len(wanted) == 2)
    assert sorted(offered) == sorted(wanted) == ["DURABILITY", "RELIABILITY"]
    assert not caplog.records


async def test_a_subscription_knows_whether_its_publishers_are_alive(net):
    manual = QoS(timing=Timing(lease=10**9, is_manual=True))
    talker, listener = await net.node("talker"), await net.node("listener")
    publisher = talker.create_publisher(Int32, "counts", manual)
    near, far = (
        each.create_subscription(Int32, "counts", print, manual) for each in (talker, listener)
    )
    await until(lambda: publisher.get_subscription_count() == 2)
    await until(far.get_publisher_count)
    told = []
    far.on_matched = lambda: told.append(far.get_liveliness())
    assert far.get_liveliness() == near.get_liveliness() == (0, 0)  # it was not declared yet

    async def both_see(expected):
        await until(lambda: told[-1:] == [expected] == [near.get_liveliness()])

    publisher.set_alive(True)
    await both_see((1, 0))
    publisher.set_alive(False)
    await both_see((0, 1))
    publisher.destroy()
    await both_see((0, 0))


async def test_many_subscriptions_made_at_once_look_for_publishers_together(net, monkeypatch):
    listener = await net.node("listener")
    network = listener._transport.network
    looks = []
    publishing = network.publishing
    monkeypatch.setattr(network, "publishing", lambda topics: looks.append(1) or publishing(topics))
    listener.create_subscription(Int32, "first", print)
    await asyncio.sleep(0.05)
    looks.clear()
    for number in range(50):
        listener.create_subscription(Int32, f"t{number}", print)
    await asyncio.sleep(0.01)
    assert 1 <= len(looks) <= 3  # what they change in the directory is news too


async def test_in_a_lab_a_relative_name_means_the_labs_topic_while_one_has_none_of_ones_own(net):
    robot, student = await net.node("robot"), await net.node("ada", namespace="/ada")
    student._is_in_lab = True
    pose = robot.create_publisher(Int32, "robot_task/pose", LATCHED)
    pose.publish(Int32(data=1))
    got, absolute = [], []
    subscription = student.create_subscription(Int32, "robot_task/pose", got.append, LATCHED)
    student.create_subscription(Int32, "/ada/robot_task/pose", absolute.append)
    await until(lambda: numbers(got) == [1])
    assert subscription.get_publisher_count() == 1
    own = (await net.node("more", namespace="/ada")).create_publisher(
        Int32, "robot_task/pose", LATCHED
    )
    await until(lambda: own.get_subscription_count() == 2 and subscription._receiver.matched)
    own.publish(Int32(data=2))
    pose.publish(Int32(data=3))
    await until(lambda: absolute and got[-1].data == 2)
    own.destroy()
    await until(lambda: subscription._elsewhere.matched and not subscription._receiver.matched)
    pose.publish(Int32(data=4))
    await until(lambda: got[-1].data == 4)
    assert numbers(got) == [1, 2, 4]
    assert numbers(absolute) == [2]
    subscription.destroy()
    await until(lambda: not pose.get_subscription_count())
