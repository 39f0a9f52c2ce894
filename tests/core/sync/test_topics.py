"""Blocking programs publish from any thread, in order, and get their messages in threads."""

import threading
import time

import pytest

import srvgen
import taskrpc
import taskrpc.sync

pytestmark = pytest.mark.real_time

Int32 = srvgen.load("std_msgs/msg/Int32")


@pytest.fixture
def talker():
    with taskrpc.sync.Node("talker", token="t") as node:
        yield node


@pytest.fixture
def listener():
    with taskrpc.sync.Node("listener", token="l") as node:
        yield node


class Box:
    """What a subscription got, and a way to wait for it."""

    def __init__(self):
        self.got = []
        self.threads = set()
        self._came = threading.Condition()

    def __call__(self, message):
        with self._came:
            self.got.append(message.data)
            self.threads.add(threading.current_thread())
            self._came.notify_all()

    def wait(self, count):
        with self._came:
            assert self._came.wait_for(lambda: len(self.got) >= count, 60)
        return self.got


def connect(publisher, subscription):
    ends_at = time.monotonic() + 60
    while not (publisher.get_subscription_count() and subscription.get_publisher_count()):
        assert time.monotonic() < ends_at
        time.sleep(0.002)


def test_a_message_is_given_to_a_callback_in_a_thread_of_its_own(talker, listener):
    box = Box()
    publisher = talker.create_publisher(Int32, "counts")
    subscription = listener.create_subscription(Int32, "counts", box)
    connect(publisher, subscription)
    publisher.publish(Int32(data=5))
    assert box.wait(1) == [5]
    assert threading.current_thread() not in box.threads
    assert (publisher.sent, subscription.received) == (1, 1)


def test_the_messages_of_one_thread_stay_in_order(talker, listener):
    box = Box()
    publisher = talker.create_publisher(Int32, "counts", 10_000)
    connect(publisher, listener.create_subscription(Int32, "counts", box, 10_000))

    def publish(first):
        for number in range(500):
            publisher.publish(Int32(data=first + number))

    threads = [threading.Thread(target=publish, args=(1000 * n,)) for n in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    got = box.wait(2000)
    for n in range(4):
        mine = [each for each in got if each // 1000 == n]
        assert mine == [1000 * n + number for number in range(500)]


def test_a_callback_may_block_and_publish(talker, listener):
    box = Box()
    back = listener.create_publisher(Int32, "answers")

    def answer(message):
        time.sleep(0.01)
        back.publish(Int32(data=message.data * 2))

    publisher = talker.create_publisher(Int32, "counts")
    connect(publisher, listener.create_subscription(Int32, "counts", answer))
    connect(back, talker.create_subscription(Int32, "answers", box))
    publisher.publish(Int32(data=21))
    assert box.wait(1) == [42]


def test_a_timer_calls_in_a_thread_until_it_is_cancelled(talker):
    came = threading.Semaphore(0)
    threads = set()

    def tick():
        threads.add(threading.current_thread())
        came.release()

    timer = talker.create_timer(0.01, tick)
    assert came.acquire(timeout=60)
    assert came.acquire(timeout=60)
    timer.cancel()
    assert timer.is_canceled
    timer.reset()
    assert came.acquire(timeout=60)
    timer.destroy()
    assert threading.current_thread() not in threads


def test_an_async_callback_runs_on_the_loop(talker, listener):
    box = Box()

    async def note(message):
        box(message)

    publisher = talker.create_publisher(Int32, "counts")
    connect(publisher, listener.create_subscription(Int32, "counts", note))
    publisher.publish(Int32(data=3))
    assert box.wait(1) == [3]
    assert {thread.name for thread in box.threads} == {"taskrpc"}


def test_a_destroyed_publisher_says_so(talker):
    publisher = talker.create_publisher(Int32, "counts")
    publisher.destroy()
    with pytest.raises(taskrpc.TaskRpcError, match="the publisher of /counts is destroyed"):
        publisher.publish(Int32())


def test_too_large_message_is_refused_in_the_publishing_thread(talker, listener):
    box = Box()
    string = srvgen.load("std_msgs/msg/String")
    publisher = talker.create_publisher(string, "text")
    connect(publisher, listener.create_subscription(string, "text", box))
    with pytest.raises(taskrpc.InvalidRequest, match="at most 16842752 can be sent"):
        publisher.publish(string(data="x" * 17_000_000))
    publisher.publish(string(data="fits"))
    assert box.wait(1) == ["fits"]


def test_a_thread_that_is_faster_than_the_loop_waits_for_it(talker, monkeypatch):
    from taskrpc import topic

    monkeypatch.setattr(topic, "MOST_HANDED_OFF", 4)
    publisher = talker.create_publisher(Int32, "counts")
    go_on = threading.Event()
    talker._loop.soon(lambda: go_on.wait(60))

    def publish():
        for number in range(20):
            publisher.publish(Int32(data=number))

    thread = threading.Thread(target=publish)
    thread.start()
    thread.join(0.2)
    assert thread.is_alive()
    assert len(publisher._inner._pending) == 4
    go_on.set()
    thread.join(5)
    publisher.destroy()
    assert publisher.sent == 20


def test_a_node_that_has_not_started_says_how_to_start_it():
    node = taskrpc.sync.Node("talker")
    with pytest.raises(taskrpc.TaskRpcError, match=r"write `with taskrpc\.sync\.Node\(\.\.\.\) as"):
        node.create_publisher(Int32, "counts")
