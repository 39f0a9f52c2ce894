"""A subscriber that reads slowly, or not at all, costs a bounded number of messages and bytes."""

import asyncio

from msgspec.structs import replace

import srvgen
from taskrpc.core.security.roles import Account, Accounts, Role
from taskrpc.core.transport.pubsub import publishing
from tests.core.transport.helpers import Add, Gate, ask, until

String = srvgen.load("std_msgs/msg/String")
SIZE = 20_000


def text(number, size=SIZE):
    return String(data=f"{number:06d}" + "x" * size)


def number_of(message):
    return int(message.data[:6])


async def joined(net, qos=10, topic="text"):
    talker, listener = await net.node("talker"), await net.node("listener")
    got = []
    publisher = talker.create_publisher(String, topic, qos)
    subscription = listener.create_subscription(String, topic, got.append, qos)
    await until(publisher.get_subscription_count)
    return publisher, subscription, got


def reading_end(subscription):
    """The transport on which a subscription's messages come."""
    (link,) = subscription._receiver._topics._links.values()
    return link._connection.transport


async def fill(publisher, first=0):
    """Publish until the other side's buffers are full and messages are lost; returns the next."""
    number = first
    while not publisher.lost:
        publisher.publish(text(number))
        number += 1
        if not number % 10:
            await asyncio.sleep(0)
        assert number < 10_000
    return number


def owed(publisher):
    (feed,) = publisher._sender.feeds.values()
    return feed._subscriber.owed


async def test_a_slow_subscriber_gets_the_newest_messages_up_to_the_depth(net):
    publisher, subscription, got = await joined(net, 5)
    await asyncio.sleep(0.05)
    reading_end(subscription).pause_reading()
    count = await fill(publisher)
    for number in range(count, count + 50):
        publisher.publish(text(number))
    count += 50
    assert owed(publisher) <= 5 * (SIZE + 100)
    lost = publisher.lost
    assert lost >= 50
    reading_end(subscription).resume_reading()
    await until(lambda: got and number_of(got[-1]) == count - 1)
    numbers = [number_of(each) for each in got]
    assert numbers == sorted(numbers)
    assert numbers[-5:] == list(range(count - 5, count))
    assert len(numbers) == count - lost
    assert subscription.lost == lost
    assert owed(publisher) == 0


async def test_a_slow_subscriber_does_not_delay_others(net):
    publisher, slow, _ = await joined(net, 5)
    quick = []
    listener = await net.node("quick")
    listener.create_subscription(String, "text", quick.append, 5)
    await until(lambda: publisher.get_subscription_count() == 2)
    reading_end(slow).pause_reading()
    number = 0
    while not publisher.lost:
        publisher.publish(text(number))
        number += 1
        await until(lambda number=number: len(quick) == number)
    assert [number_of(each) for each in quick] == list(range(number))


async def test_waiting_messages_are_bounded_in_bytes(net, monkeypatch):
    monkeypatch.setattr(publishing, "MAX_OWED", 100_000)
    publisher, subscription, got = await joined(net, 1000)
    reading_end(subscription).pause_reading()
    await fill(publisher)
    for number in range(20):
        publisher.publish(text(number))
        assert owed(publisher) <= 100_000
    publisher.publish(text(999_999, 300_000))
    assert owed(publisher) < 301_000  # one message is kept, whatever its size
    reading_end(subscription).resume_reading()
    await until(lambda: got and number_of(got[-1]) == 999_999)


async def test_a_lost_subscriber_leaves_no_waiting_messages(net):
    publisher, subscription, _ = await joined(net, 5)
    reading_end(subscription).pause_reading()
    await fill(publisher)
    subscriber = next(iter(publisher._sender.feeds))
    reading_end(subscription).abort()
    await until(lambda: subscriber not in publisher._sender.feeds)
    assert subscriber.subscriber.owed == 0
    await until(publisher.get_subscription_count)  # it reconnects by itself


async def test_waiting_messages_of_a_destroyed_publisher_count_as_lost(net):
    publisher, subscription, _ = await joined(net, 5)
    reading_end(subscription).pause_reading()
    await fill(publisher)
    lost = publisher.lost
    publisher.destroy()
    assert publisher.lost == lost + 5
    talker = publisher._forget.__self__
    assert talker.status().topics["/text"].lost_sending == lost + 5


async def test_the_other_topics_of_a_connection_take_turns(net):
    publisher, subscription, got = await joined(net, 5)
    listener = subscription._forget.__self__
    talker = publisher._forget.__self__
    more = []
    second = talker.create_publisher(String, "more", 5)
    listener.create_subscription(String, "more", more.append, 5)
    await until(second.get_subscription_count)
    reading_end(subscription).pause_reading()
    number = await fill(publisher)
    for each in range(20):
        second.publish(text(each))
    reading_end(subscription).resume_reading()
    await until(lambda: more and number_of(more[-1]) == 19)
    await until(lambda: number_of(got[-1]) == number - 1)
    assert [number_of(each) for each in more[-5:]] == list(range(15, 20))


ACCOUNTS = Accounts(
    [
        Account("looker", "0123456789abcdef0123", Role.OBSERVE),
        Account("boss", "0123456789abcdef0124", Role.OPERATE),
    ]
)


async def test_an_account_that_may_look_may_subscribe_and_no_more_than_its_role(net, caplog):
    talker = await net.node("talker", accounts=ACCOUNTS)
    public = talker.create_publisher(String, "public")
    inner = talker.create_publisher(String, "inner", role=Role.OPERATE)
    looker = await net.node("looker", token="looker.0123456789abcdef0123", **peers(net, talker))
    boss = await net.node("boss", token="boss.0123456789abcdef0124", **peers(net, talker))
    seen, refused, allowed = [], [], []
    looker.create_subscription(String, "public", seen.append)
    looker.create_subscription(String, "inner", refused.append)
    boss.create_subscription(String, "inner", allowed.append)
    await until(lambda: public.get_subscription_count() and inner.get_subscription_count())
    await until(lambda: caplog.messages)
    public.publish(text(1))
    inner.publish(text(2))
    await until(lambda: seen and allowed)
    assert not refused
    assert caplog.messages == [
        "/inner needs the role operate; the account looker has observe",
    ]


async def test_a_subscriber_that_loses_its_role_gets_no_more_messages_during_a_long_call(net):
    boss = Account("boss", "0123456789abcdef0124", Role.OPERATE)
    accounts = Accounts([boss])
    talker = await net.node("talker", accounts=accounts)
    inner = talker.create_publisher(String, "inner", role=Role.OPERATE)
    public = talker.create_publisher(String, "public")
    gate = Gate()
    talker.create_service(Add, "wait", gate)
    listener = await net.node("boss", token=boss.token, **peers(net, talker))
    heard, seen = [], []
    listener.create_subscription(String, "inner", heard.append)
    listener.create_subscription(String, "public", seen.append)
    call = listener.create_client(Add, "wait").call_async(ask(1, 1))
    await until(lambda: inner.get_subscription_count() and gate.started)
    inner.publish(text(1))
    await until(lambda: heard)
    accounts._by_name["boss"] = replace(boss, role=Role.SUBMIT)
    await until(lambda: not inner.get_subscription_count())
    inner.publish(text(2))
    public.publish(text(3))
    await until(lambda: seen)
    assert [number_of(each) for each in heard] == [1]
    gate.opened.set()
    assert (await call).sum == 1
    await until(public.get_subscription_count)
    assert not inner.get_subscription_count()


def peers(net, talker):
    """Over TCP, an account is asked for only where a process is named."""
    return {} if net.is_virtual or not talker.address else {"peers": [talker.address]}


async def test_a_restarted_publisher_is_found_by_its_address_alone(net):
    if net.is_virtual:
        return  # in memory, programs cannot choose an address
    first = await net.node("first", token="a secret of sixteen")
    publisher = first.create_publisher(String, "text")
    place = first.address
    listener = await net.node("listener", token="a secret of sixteen", peers=[place])
    got = []
    subscription = listener.create_subscription(String, "text", got.append)
    await until(publisher.get_subscription_count)
    publisher.publish(text(1))
    await until(lambda: got)
    await first.destroy()
    await until(lambda: not subscription.get_publisher_count())
    second = await net.node("second", token="a secret of sixteen", listen=place)
    publisher = second.create_publisher(String, "text")
    await until(publisher.get_subscription_count)
    publisher.publish(text(2))
    await until(lambda: len(got) == 2)


async def test_a_peer_announces_a_topic_that_it_publishes_later(net):
    if net.is_virtual:
        return
    server = await net.node("server", token="a secret of sixteen")
    server.create_publisher(String, "other")
    listener = await net.node("listener", token="a secret of sixteen", peers=[server.address])
    got = []
    subscription = listener.create_subscription(String, "text", got.append)
    await asyncio.sleep(0.05)
    assert subscription.get_publisher_count() == 0
    publisher = server.create_publisher(String, "text")
    await until(subscription.get_publisher_count)
    publisher.publish(text(1))
    await until(lambda: got)


async def test_a_wrong_secret_is_logged_once(net, caplog, monkeypatch, tmp_path):
    if net.is_virtual:
        return
    server = await net.node("server", token="a secret of sixteen")
    server.create_publisher(String, "text")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))  # otherwise the registry would contain it
    stranger = await net.node("stranger", token="another secret", peers=[server.address])
    stranger.create_subscription(String, "text", print)
    await until(lambda: told(caplog))
    await asyncio.sleep(0.3)
    (said,) = told(caplog)
    assert "secret" in said or "token" in said


def told(caplog):
    """What a subscriber's own program was warned of."""
    return [each.getMessage() for each in caplog.records if each.name == "taskrpc.topics"]
