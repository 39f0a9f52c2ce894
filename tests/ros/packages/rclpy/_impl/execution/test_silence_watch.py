"""Silence is reported after each period, or once until something happens."""

import asyncio

from taskrpc.ros.packages.rclpy._impl.execution.silence_watch import SilenceWatch


class Watched:
    """A watch of 2 s, and the seconds at which it reported."""

    def __init__(self, **settings):
        self._loop = asyncio.get_running_loop()
        self._began = self._loop.time()
        self.told = []
        self.watch = SilenceWatch(self._loop, 2.0, lambda: self._note("silent"), **settings)

    def _note(self, what):
        self.told.append((what, round(self._loop.time() - self._began, 3)))

    def resumed(self):
        self._note("resumed")


async def test_each_period_of_silence_is_reported_from_the_first_message_on():
    watched = Watched(repeats=True)
    await asyncio.sleep(5)
    assert watched.told == []
    watched.watch.happened()
    await asyncio.sleep(5)
    assert watched.told == [("silent", 7.0), ("silent", 9.0)]


async def test_messages_in_time_are_no_silence():
    watched = Watched(repeats=True)
    for _ in range(5):
        watched.watch.happened()
        await asyncio.sleep(1.5)
    assert watched.told == []
    await asyncio.sleep(1)
    assert watched.told == [("silent", 8.0)]


async def test_a_message_after_a_silence_begins_the_period_anew():
    watched = Watched(repeats=True)
    watched.watch.happened()
    await asyncio.sleep(3)
    watched.watch.happened()
    await asyncio.sleep(2.5)
    assert watched.told == [("silent", 2.0), ("silent", 5.0)]


async def test_a_lapsed_lease_is_reported_once_until_it_is_renewed():
    watched = Watched(repeats=False, resumed=lambda: watched.resumed())
    watched.watch.happened()
    await asyncio.sleep(7)
    watched.watch.happened()
    await asyncio.sleep(1)
    watched.watch.happened()
    await asyncio.sleep(7)
    assert watched.told == [("resumed", 0.0), ("silent", 2.0), ("resumed", 7.0), ("silent", 10.0)]


async def test_a_renewal_at_the_moment_of_the_lapse_is_not_lost(monkeypatch):
    watched = Watched(repeats=False, resumed=lambda: watched.resumed())
    lefts = iter([-1.0])  # the lapse is seen, then another thread renews the lease
    real = watched.watch._left

    def left():
        lapsed = next(lefts, None)
        if lapsed is None:
            return real()
        watched.watch.happened()
        return lapsed

    watched.watch.happened()
    await asyncio.sleep(0)
    monkeypatch.setattr(watched.watch, "_left", left)
    watched.watch._check()
    await asyncio.sleep(1.5)
    assert watched.told == [("resumed", 0.0)]
    await asyncio.sleep(1)
    assert watched.told == [("resumed", 0.0), ("silent", 2.0)]


async def test_a_closed_watch_reports_nothing():
    watched = Watched(repeats=True)
    watched.watch.happened()
    watched.watch.close()
    watched.watch.happened()
    await asyncio.sleep(5)
    assert watched.told == []
