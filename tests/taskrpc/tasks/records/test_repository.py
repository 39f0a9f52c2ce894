"""A change is stored before it is known, and known before it is announced."""

import asyncio

import pytest

from taskrpc.errors import StoreError
from taskrpc.request_ids.ids import Completion
from taskrpc.tasks.model import State, Task
from taskrpc.tasks.records.change_feed import Board
from taskrpc.tasks.records.repository import TaskBook
from tests.taskrpc.tasks.fakes import FullStore


def make(number, **changes):
    fields = {"task_type": "move", "target": "1", "priority": 5, "arrival": number}
    return Task(task_id=number, submitted_at=0.0, **(fields | changes))


async def test_a_watcher_never_sees_what_is_not_stored():
    store, board = FullStore(), Board()
    store.delay = 3.0
    book = TaskBook(store, board)
    start = board.revision
    saving = asyncio.ensure_future(book.save(make(1)))
    await asyncio.sleep(2)
    assert book.find(1) is None
    assert board.revision == start
    assert not book.is_settled(1)
    await saving
    assert (await store.load()).tasks == (make(1),)
    assert book.find(1) == make(1)
    assert board.changed_since(start) == [1]
    assert book.is_settled(1)


async def test_a_completion_is_stored_with_the_task_that_it_is_about():
    store = FullStore()
    book = TaskBook(store, Board())
    done = Completion("ann", b"c" * 16, 1, 1, b"f" * 16, b"answer", 0, 1.5)
    store.is_full = True
    with pytest.raises(StoreError):
        await book.save(make(1), completion=done)
    assert (await store.load()).completions == ()
    store.is_full = False
    await book.save(make(1), completion=done)
    assert (await store.load()).completions == (done,)
    await book.save(clients=[("ann", b"c" * 16)])
    assert (await store.load()).completions == ()


async def test_a_refused_change_is_neither_known_nor_announced():
    store, board = FullStore(), Board()
    book = TaskBook(store, board)
    store.is_full = True
    start = board.revision
    with pytest.raises(StoreError, match="the disk is full"):
        await book.save(make(1))
    assert book.find(1) is None
    assert board.revision == start
    assert not await book.stored(1)


async def test_a_caller_who_gives_up_leaves_no_half_saved_task():
    store, board = FullStore(), Board()
    store.delay = 3.0
    book = TaskBook(store, board)
    saving = asyncio.ensure_future(book.save(make(1)))
    await asyncio.sleep(1)
    saving.cancel()
    assert await book.stored(1)
    assert book.find(1) == make(1) == (await store.load()).tasks[0]


async def test_the_oldest_ended_tasks_are_forgotten_in_the_store_too():
    store, board = FullStore(), Board()
    book = TaskBook(store, board, keep_ended=3)
    for number in range(1, 8):
        await book.save(make(number))
    for number in (7, 1, 3, 2, 5):
        await book.save(make(number, state=State.CANCELED))
    assert [task.task_id for task in book.ended()] == [5, 2, 3]
    assert [task.task_id for task in (await store.load()).tasks] == [2, 3, 4, 5, 6]


async def test_interrupted_tasks_are_never_forgotten():
    store = FullStore()
    book = TaskBook(store, Board(), keep_ended=2)
    for number in range(1, 5):
        await book.save(make(number, state=State.INTERRUPTED))
    for number in range(5, 10):
        await book.save(make(number, state=State.CANCELED))
    assert [task.task_id for task in (await store.load()).tasks] == [1, 2, 3, 4, 8, 9]
    assert [task.task_id for task in book.ended()] == [4, 3, 2, 1, 9, 8]
    reopened = TaskBook(store, Board(), keep_ended=2)
    await reopened.open()
    await reopened.save(make(10, state=State.CANCELED))
    assert list(reopened.interrupted) == [1, 2, 3, 4]


async def test_an_interrupted_task_counts_as_ended_once_it_is_dropped():
    store = FullStore()
    book = TaskBook(store, Board(), keep_ended=2)
    await book.save(make(1, state=State.INTERRUPTED))
    await book.save(*(make(number, state=State.CANCELED) for number in (2, 3)))
    await book.save(make(1, state=State.CANCELED))
    assert list(book.interrupted) == []
    assert [task.task_id for task in book.ended()] == [1, 3]


async def test_a_task_queued_once_more_is_not_forgotten():
    store, board = FullStore(), Board()
    book = TaskBook(store, board, keep_ended=2)
    await book.save(*(make(number, state=State.CANCELED) for number in (1, 2)))
    store.delay = 1.0
    await asyncio.gather(book.save(make(1)), book.save(make(3, state=State.FAILED)))
    assert book.find(1).state is State.QUEUED
    assert 1 in [task.task_id for task in (await store.load()).tasks]


async def test_numbers_go_on_where_the_server_before_ended():
    store = FullStore()
    first = TaskBook(store, Board(), keep_ended=0)
    await first.open()
    numbers = [first.new_id(), first.new_id()]
    await first.save(*(make(number, arrival=first.new_arrival()) for number in numbers))
    await first.save(make(2, state=State.CANCELED))
    second = TaskBook(store, Board())
    await second.open()
    assert (numbers, second.new_id()) == ([1, 2], 3)


async def test_a_book_closes_only_when_everything_is_stored():
    store = FullStore()
    store.delay = 2.0
    book = TaskBook(store, Board())
    saving = asyncio.ensure_future(book.save(make(1)))
    await asyncio.sleep(0.1)
    await book.close()
    assert (await store.load()).tasks == (make(1),)
    await saving
