"""A change is stored before it is known, and known before it is announced."""

import asyncio

import pytest

from taskrpc.core.request_ids.ids import Completion
from taskrpc.errors import StoreError
from taskrpc.robot.tasks.model import Task, TaskState
from taskrpc.robot.tasks.records.change_feed import ChangeFeed
from taskrpc.robot.tasks.records.history import History
from taskrpc.robot.tasks.records.repository import TaskRepository
from tests.robot.tasks.fakes import FullStore


def make(number, **changes):
    fields = {"task_type": "move", "target": "1", "priority": 5, "arrival": number}
    return Task(task_id=number, submitted_at=0.0, **(fields | changes))


async def test_watcher_never_sees_an_unstored_change():
    store, feed = FullStore(), ChangeFeed()
    store.delay = 3.0
    repository = TaskRepository(store, feed)
    start = feed.revision
    saving = asyncio.ensure_future(repository.save(make(1)))
    await asyncio.sleep(2)
    assert repository.find(1) is None
    assert feed.revision == start
    assert not repository.is_settled(1)
    await saving
    assert (await store.load()).tasks == (make(1),)
    assert repository.find(1) == make(1)
    assert feed.changed_since(start) == [1]
    assert repository.is_settled(1)


async def test_a_completion_is_stored_with_the_task_that_it_is_about():
    store = FullStore()
    repository = TaskRepository(store, ChangeFeed())
    done = Completion("ann", b"c" * 16, 1, 1, b"f" * 16, b"answer", 0, 1.5)
    store.is_full = True
    with pytest.raises(StoreError):
        await repository.save(make(1), completion=done)
    assert (await store.load()).completions == ()
    store.is_full = False
    await repository.save(make(1), completion=done)
    assert (await store.load()).completions == (done,)
    await repository.save(clients=[("ann", b"c" * 16)])
    assert (await store.load()).completions == ()


async def test_a_refused_change_is_neither_known_nor_announced():
    store, feed = FullStore(), ChangeFeed()
    repository = TaskRepository(store, feed)
    store.is_full = True
    start = feed.revision
    with pytest.raises(StoreError, match="the disk is full"):
        await repository.save(make(1))
    assert repository.find(1) is None
    assert feed.revision == start
    assert not await repository.stored(1)


async def test_cancelled_save_leaves_no_half_saved_task():
    store, feed = FullStore(), ChangeFeed()
    store.delay = 3.0
    repository = TaskRepository(store, feed)
    saving = asyncio.ensure_future(repository.save(make(1)))
    await asyncio.sleep(1)
    saving.cancel()
    assert await repository.stored(1)
    assert repository.find(1) == make(1) == (await store.load()).tasks[0]


async def test_the_oldest_ended_tasks_are_forgotten_in_the_store_too():
    store, feed = FullStore(History(count=3)), ChangeFeed()
    repository = TaskRepository(store, feed)
    for number in range(1, 8):
        await repository.save(make(number))
    for number in (7, 1, 3, 2, 5):
        await repository.save(make(number, state=TaskState.CANCELED))
    assert [task.task_id for task in repository.ended()] == [5, 2, 3]
    assert [task.task_id for task in (await store.load()).tasks] == [2, 3, 4, 5, 6]


async def test_interrupted_tasks_are_never_forgotten():
    store = FullStore(History(count=2))
    repository = TaskRepository(store, ChangeFeed())
    for number in range(1, 5):
        await repository.save(make(number, state=TaskState.INTERRUPTED))
    for number in range(5, 10):
        await repository.save(make(number, state=TaskState.CANCELED))
    assert [task.task_id for task in (await store.load()).tasks] == [1, 2, 3, 4, 8, 9]
    assert [task.task_id for task in repository.ended()] == [4, 3, 2, 1, 9, 8]
    reopened = TaskRepository(store, ChangeFeed())
    await reopened.open()
    await reopened.save(make(10, state=TaskState.CANCELED))
    assert list(reopened.interrupted) == [1, 2, 3, 4]


async def test_an_interrupted_task_counts_as_ended_once_it_is_dropped():
    store = FullStore(History(count=2))
    repository = TaskRepository(store, ChangeFeed())
    await repository.save(make(1, state=TaskState.INTERRUPTED))
    await repository.save(*(make(number, state=TaskState.CANCELED) for number in (2, 3)))
    await repository.save(make(1, state=TaskState.CANCELED))
    assert list(repository.interrupted) == []
    assert [task.task_id for task in repository.ended()] == [1, 3]


async def test_requeued_task_is_not_forgotten():
    store, feed = FullStore(History(count=2)), ChangeFeed()
    repository = TaskRepository(store, feed)
    await repository.save(*(make(number, state=TaskState.CANCELED) for number in (1, 2)))
    store.delay = 1.0
    await asyncio.gather(repository.save(make(1)), repository.save(make(3, state=TaskState.FAILED)))
    assert repository.find(1).state is TaskState.QUEUED
    assert 1 in [task.task_id for task in (await store.load()).tasks]


async def test_numbers_go_on_where_the_server_before_ended():
    store = FullStore(History(count=0))
    first = TaskRepository(store, ChangeFeed())
    await first.open()
    numbers = [first.new_id(), first.new_id()]
    await first.save(*(make(number, arrival=first.new_arrival()) for number in numbers))
    await first.save(make(2, state=TaskState.CANCELED))
    second = TaskRepository(store, ChangeFeed())
    await second.open()
    assert (numbers, second.new_id()) == ([1, 2], 3)


async def test_a_book_closes_only_when_everything_is_stored():
    store = FullStore()
    store.delay = 2.0
    repository = TaskRepository(store, ChangeFeed())
    saving = asyncio.ensure_future(repository.save(make(1)))
    await asyncio.sleep(0.1)
    await repository.close()
    assert (await store.load()).tasks == (make(1),)
    await saving
