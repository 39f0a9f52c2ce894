"""Watchers learn of every change, and of nothing else."""

import asyncio

from taskrpc.robot.tasks.records.change_feed import ChangeFeed


async def test_changed_tasks_are_listed_once_and_in_order():
    feed = ChangeFeed()
    start = feed.revision
    for task_id in (3, 1, 3, 2):
        feed.announce(task_id)
    assert feed.changed_since(start) == [1, 3, 2]
    assert feed.changed_since(feed.revision) == []


async def test_a_watcher_wakes_at_the_next_announcement():
    feed = ChangeFeed()
    watcher = asyncio.ensure_future(feed.wait_for_change(feed.revision, 60))
    await asyncio.sleep(5)
    assert not watcher.done()
    feed.announce(1)
    assert await watcher


async def test_a_change_before_the_watch_is_not_missed():
    feed = ChangeFeed()
    start = feed.revision
    feed.announce(1)
    assert await asyncio.wait_for(feed.wait_for_change(start, 60), 0.001)


async def test_a_watcher_of_one_task_sleeps_through_the_others():
    feed = ChangeFeed()
    began = asyncio.get_running_loop().time()
    watcher = asyncio.ensure_future(feed.wait_for_change(feed.revision, 60, task_id=7))
    for task_id in (1, 2, None, 7):
        await asyncio.sleep(1)
        assert not watcher.done()
        feed.announce(task_id)
    assert await watcher
    assert asyncio.get_running_loop().time() - began == 4


async def test_a_quiet_board_answers_when_the_time_is_up():
    feed = ChangeFeed()
    began = asyncio.get_running_loop().time()
    assert not await feed.wait_for_change(feed.revision, 2.5)
    assert asyncio.get_running_loop().time() - began == 2.5


async def test_a_watcher_that_knows_nothing_or_talks_to_a_new_server_starts_afresh():
    feed = ChangeFeed(1000)
    feed.announce(1)
    for foreign in (0, 999, 5000):
        assert feed.changed_since(foreign) is None
        assert await asyncio.wait_for(feed.wait_for_change(foreign, 60), 0.001)
        assert await asyncio.wait_for(feed.wait_for_change(foreign, 60, task_id=9), 0.001)


async def test_too_many_changes_are_admitted_not_hidden():
    feed = ChangeFeed(capacity=3)
    start = feed.revision
    for task_id in range(1, 5):
        feed.announce(task_id)
    assert feed.changed_since(start) is None
    assert feed.changed_since(start + 1) == [2, 3, 4]


async def test_closed_change_feed_ends_all_its_watchers():
    feed = ChangeFeed()
    watchers = [
        asyncio.ensure_future(feed.wait_for_change(feed.revision, 60, task_id=number))
        for number in range(3)
    ]
    await asyncio.sleep(1)
    feed.close()
    assert await asyncio.wait_for(asyncio.gather(*watchers), 0.001) == [False] * 3
    assert not await asyncio.wait_for(feed.wait_for_change(feed.revision, 60), 0.001)


def test_listener_gets_each_change_at_once_also_after_the_end():
    feed, heard = ChangeFeed(), []
    feed.add_listener(heard.append)
    feed.announce(3)
    feed.announce()
    feed.close()
    feed.announce(4)
    assert heard == [3, None, 4]
