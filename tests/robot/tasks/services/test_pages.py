"""The pages together are the whole list, also while the queue changes between them."""

import asyncio

import pytest

from taskrpc.robot.tasks.manager import TaskManager
from taskrpc.robot.tasks.model import TaskState
from taskrpc.robot.tasks.records.store import MemoryStore
from taskrpc.robot.tasks.services.pages import PAGE, page
from tests.robot.tasks.fakes import LineRobot


@pytest.fixture
async def manager():
    manager = TaskManager(LineRobot(), MemoryStore())
    await manager.start()
    yield manager
    await manager.close()


async def fill(manager, count):
    for number in range(count):
        await manager.submit("move", str(number % 5), 1 + number % 10)


def pages(manager, limit, *, ended=False, between=lambda: None):
    """All rows, page by page."""
    rows, cursor = [], ""
    while True:
        found = page(manager, cursor, limit=limit, ended=ended)
        assert len(found.rows) <= limit
        rows += found.rows
        if not found.next_page:
            return rows
        cursor = found.next_page
        between()


@pytest.mark.parametrize("limit", [1, 7, 30, 31, 32, 100])
async def test_pages_of_any_size_join_to_the_same_list(manager, limit):
    await fill(manager, 30)
    await asyncio.sleep(5)
    await manager.cancel(5)
    whole = page(manager, "", ended=True).rows
    assert [row.task.state for row in whole[:2]] == [TaskState.RUNNING, TaskState.QUEUED]
    assert whole[-1].task.state.is_ended
    keys = [row.task.order_key for row in whole if row.task.state is TaskState.QUEUED]
    assert keys == sorted(keys)
    times = [row.estimated_time for row in whole if not row.task.state.is_ended]
    assert times == sorted(times)
    assert pages(manager, limit, ended=True) == whole


async def test_ended_tasks_are_listed_on_request_newest_first(manager):
    await manager.pause()
    await fill(manager, 6)
    for number in (4, 2, 6):
        await manager.cancel(number)
    assert [row.task.task_id for row in page(manager, "").rows] == [5, 3, 1]
    rows = pages(manager, 2, ended=True)
    assert [row.task.task_id for row in rows] == [5, 3, 1, 6, 2, 4]


async def test_list_of_ended_tasks_only_begins_with_the_newest(manager):
    await manager.pause()
    await fill(manager, 2)
    for number in (1, 2):
        await manager.cancel(number)
    assert [row.task.task_id for row in pages(manager, 1, ended=True)] == [2, 1]


async def test_no_task_is_doubled_or_lost_while_the_queue_changes(manager):
    await manager.pause()
    await fill(manager, 40)
    listed = {row.task.task_id for row in page(manager, "").rows}
    gone = iter(range(1, 40, 4))
    removed = set()

    def meddle():
        number = next(gone, None)
        if number is not None:
            manager._estimated_queue.remove(number, "was cancelled")
            removed.add(number)

    rows = [row.task.task_id for row in pages(manager, 3, between=meddle)]
    assert len(rows) == len(set(rows))
    assert listed - removed <= set(rows) <= listed


async def test_a_page_is_never_longer_than_the_server_likes(manager):
    await manager.pause()
    await fill(manager, PAGE + 5)
    assert len(page(manager, "", limit=10**9).rows) == PAGE


@pytest.mark.parametrize("cursor", ["x", "w5", "w-5:x", "e1:", "w-5:1 ", "e1.5:2;drop", "w" * 999])
async def test_invalid_cursor_is_refused_in_one_sentence(manager, cursor):
    with pytest.raises(ValueError, match="page: expected `next_page` of an earlier response, got"):
        page(manager, cursor)
