"""Everything that arrives is served once, and its turn comes soon, in whatever order it arrives."""

from __future__ import annotations

import threading
from collections import Counter, deque

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.ros.packages.rclpy._impl.execution.entity import Entity
from taskrpc.ros.packages.rclpy.callback_groups import (
    MutuallyExclusiveCallbackGroup,
    ReentrantCallbackGroup,
)
from taskrpc.ros.packages.rclpy.context import Context
from taskrpc.ros.packages.rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from taskrpc.ros.packages.rclpy.task import Future
from tests.ros.packages.rclpy.fakes import FakeNode


class Inbox(Entity):
    """Letters in the order in which they came, each given to the callback."""

    def __init__(self, node, group, callback):
        self.parent_node = node
        self.callback_group = group
        group.add_entity(self)
        self.letters = deque()
        self.callback = callback

    def put(self, letter):
        self.letters.append(letter)
        self.notify_executor()

    def has_work(self):
        return bool(self.letters)

    def take_work(self):
        try:
            letter = self.letters.popleft()
        except IndexError:
            return None
        return lambda: self.callback(letter)


def office(kind, inboxes, **settings):
    """An executor and its node, which has as many inboxes as are given group and callback for."""
    context = Context()
    context.init([])
    executor, node = kind(context=context, **settings), FakeNode(context)
    node.services = [Inbox(node, *each) for each in inboxes]
    executor.add_node(node)
    return executor, node


numbers = st.integers(0, 3)


@given(st.lists(st.one_of(numbers, st.none()), max_size=40))
def test_letters_are_read_in_order_and_no_inbox_waits_for_more_than_one_of_each_other(events):
    """An event is a letter in that inbox, or None: spin once."""
    read = []
    group = MutuallyExclusiveCallbackGroup()
    executor, node = office(
        SingleThreadedExecutor, [(group, lambda at, n=n: read.append((n, at))) for n in range(4)]
    )
    put = Counter()
    for event in events:
        if event is None:
            executor.spin_once(0)
        else:
            node.services[event].put(put[event])
            put[event] += 1
    waiting = [n for n in range(4) if node.services[n].letters]
    before = len(read)
    for _ in range(2 * len(waiting)):
        executor.spin_once(0)
    assert {n for n, _ in read[before:]} >= set(waiting)
    for _ in range(put.total()):
        executor.spin_once(0)
    for number in range(4):
        assert [at for n, at in read if n == number] == list(range(put[number]))


@given(st.lists(st.lists(numbers, min_size=1, max_size=4), max_size=6))
def test_coroutines_end_in_whatever_order_their_futures_do(orders):
    futures = [Future() for _ in range(4)]
    ended = []

    async def wait(letter):
        await futures[letter]
        ended.append(letter)

    executor, node = office(SingleThreadedExecutor, [(ReentrantCallbackGroup(), wait)])
    for letter in range(4):
        node.services[0].put(letter)
    for _ in range(4):
        executor.spin_once(0)
    done = set()
    for order in orders:
        for number in order:
            futures[number].set_result(None)
            done.add(number)
        for _ in range(8):
            executor.spin_once(0)
        assert set(ended) == done
    assert len(ended) == len(done)


@pytest.mark.real_time
@pytest.mark.parametrize(
    ("kind", "settings"),
    [(SingleThreadedExecutor, {}), (MultiThreadedExecutor, {"num_threads": 3})],
)
def test_no_letter_is_lost_or_read_twice_when_threads_write_and_read_at_once(kind, settings):
    writers, letters = 3, 400
    read, pending, lock = Counter(), deque(), threading.Lock()

    def note(letter):
        with lock:
            read[letter] += 1

    async def wait(letter):
        future = Future()
        pending.append(future)
        await future
        note(letter)

    groups = [MutuallyExclusiveCallbackGroup(), ReentrantCallbackGroup()]
    inboxes = [(groups[n % 2], [note, note, wait][n % 3]) for n in range(6)]
    executor, node = office(kind, inboxes, **settings)

    def write(writer):
        for number in range(letters):
            node.services[number % 6].put((writer, number))

    def complete():
        while read.total() < writers * letters:
            while pending:
                pending.popleft().set_result(None)
            threading.Event().wait(0.0005)
        executor.shutdown()

    threads = [threading.Thread(target=write, args=(n,)) for n in range(writers)]
    threads.append(threading.Thread(target=complete, daemon=True))
    for thread in threads:
        thread.start()
    executor.spin()
    assert set(read.values()) == {1}
    assert read.total() == writers * letters
