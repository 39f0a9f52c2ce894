"""The ended tasks of a database in pages, while its servers end and archive further tasks."""

from taskrpc.robot.tasks.records.archive import end_of, pages_of
from tests.robot.tasks.records.store_rules import ended


class Source:
    """Ended tasks in memory; each read of the archive archives one more of the recent ones."""

    def __init__(self, recent, archived, page):
        self._recent, self._archived, self._page = recent, archived, page

    async def recent(self):
        return list(self._recent)

    async def archived(self, after):
        found = sorted((task for task in self._archived if end_of(task) > after), key=end_of)
        if self._recent:
            self._archived.append(self._recent.pop(0))
        return found[: self._page]


async def found(source, since=0.0):
    return [[task.task_id for task in page] async for page in pages_of(source, since)]


async def test_task_that_is_archived_meanwhile_is_there_once():
    recent = [ended(number, float(number)) for number in (4, 5, 6)]
    archived = [ended(number, float(number)) for number in (1, 2, 3)]
    pages = await found(Source(recent, archived, page=2))
    assert [task_id for page in pages for task_id in page] == [1, 2, 3, 4, 5, 6]


async def test_tasks_with_the_same_end_are_in_the_order_of_their_ids_on_any_page():
    archived = [ended(number, 7.0) for number in (5, 1, 4, 2, 3)]
    assert await found(Source([], archived, page=2)) == [[1, 2], [3, 4], [5]]


async def test_only_tasks_that_ended_since_an_instant_are_found():
    archived = [ended(number, float(number)) for number in (1, 2, 3)]
    recent = [ended(4, 2.0), ended(5, 1.0)]
    assert await found(Source(recent, archived, page=10), 2.0) == [[2, 4, 3]]
