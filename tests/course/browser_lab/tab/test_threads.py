"""The threads of a tab take turns; their waits end by a wake, a timeout or an interrupt.

Only Pyodide can switch stacks. Here, a thread that waits runs the others on top of its own stack,
on a loop with virtual time.
"""

import asyncio
import heapq
import itertools

import pytest

from taskrpc import WouldDeadlock
from taskrpc.core.current_program import current_program
from taskrpc.course.browser_lab.tab.threads import CannotWait, Scheduler
from taskrpc.simulation.interpreter import threads
from taskrpc.simulation.interpreter.threads import Handle, Lock


class Loop:
    """An event loop with virtual time."""

    def __init__(self):
        self.now = 0.0
        self._order = itertools.count()
        self._planned = []

    def call_soon(self, action, *arguments, context=None):
        return self.call_later(0, action, *arguments, context=context)

    def call_later(self, seconds, action, *arguments, context=None):
        run = lambda: context.run(action, *arguments) if context else action(*arguments)  # noqa: E731
        timer = Timer(run)
        heapq.heappush(self._planned, (self.now + seconds, next(self._order), timer))
        return timer

    def run_until(self, is_over):
        while not is_over():
            assert self._planned, "nothing will ever happen"
            self.now, _, timer = heapq.heappop(self._planned)
            if not timer.cancelled:
                timer.run()


class Timer:
    def __init__(self, run):
        self.run = run
        self.cancelled = False

    def cancel(self):
        self.cancelled = True


class Promise:
    def __init__(self):
        self.is_resolved = False
        self.promise = self

    def resolve(self):
        self.is_resolved = True


@pytest.fixture
def tab(monkeypatch):
    loop = Loop()
    # The scheduler says which loop runs; asyncio accepts any object.
    monkeypatch.setattr(asyncio, "_set_running_loop", lambda _: None)
    suspend = lambda promise: loop.run_until(lambda: promise.is_resolved)  # noqa: E731
    scheduler = Scheduler(loop, Promise, suspend)
    monkeypatch.setattr(threads, "_scheduler", scheduler, raising=False)
    return scheduler


def start(tab, run):
    handle = Handle()
    tab.start(run, handle)
    return handle


def run(tab, action):
    """Run a function as a thread of the tab, and return its result."""
    results = []
    handle = start(tab, lambda: results.append(action()))
    tab.loop.run_until(handle.is_done)
    return results[0]


def test_a_released_lock_belongs_to_the_thread_that_waited(tab):
    lock = Lock()
    lock.acquire()
    tab.loop.call_later(2, lock.release)
    assert run(tab, lambda: (lock.acquire(), tab.loop.now)) == (True, 2)
    assert lock.locked()
    lock.release()
    assert not lock.locked()


def test_a_lock_is_not_taken_after_its_timeout(tab):
    lock = Lock()

    def waits():
        lock.acquire()
        assert not lock.acquire(blocking=False)
        return lock.acquire(timeout=3), tab.loop.now

    assert run(tab, waits) == (False, 3)
    with pytest.raises(RuntimeError, match="unlocked"):
        Lock().release()


def test_join_returns_at_the_end_of_the_thread_or_after_the_timeout(tab):
    slow = Handle()
    tab.loop.call_later(5, slow._set_done)
    run(tab, lambda: slow.join(1))
    assert (slow.is_done(), tab.loop.now) == (False, 1)
    run(tab, slow.join)
    assert (slow.is_done(), tab.loop.now) == (True, 5)


def test_an_interrupt_is_raised_where_the_thread_waits(tab):
    def sleeps():
        try:
            tab.sleep(10)
        except KeyboardInterrupt:
            return tab.loop.now
        return None

    tab.loop.call_later(2, lambda: tab.interrupt(tab.idents("")[0], KeyboardInterrupt()))
    assert run(tab, sleeps) == 2


def test_threads_have_numbers_and_belong_to_the_program_that_started_them(tab):
    name = current_program.set("a program")
    try:
        assert run(tab, lambda: (tab.idents("a program"), [tab.get_ident()]))[0]
    finally:
        current_program.reset(name)
    assert tab.idents("a program") == []


def test_a_browser_without_stack_switching_says_so():
    with pytest.raises(CannotWait, match="asynchronous version"):
        Scheduler(Loop(), Promise, None).wait(lambda _: None, 1)


def test_a_callback_of_the_event_loop_cannot_wait_for_ever(tab):
    with pytest.raises(WouldDeadlock, match="use `await`"):
        tab.wait(lambda _: None, None)
    assert tab.wait(lambda _: None, 0.001) is False
