"""Rules for every store; each kind of store runs them in a test file of its own."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import NamedTuple

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from taskrpc.core.request_ids.ids import Completion
from taskrpc.robot.tasks.model import EstimateChange, Task, TaskState
from taskrpc.robot.tasks.records.archive import EndedTasks, end_of, pages_of
from taskrpc.robot.tasks.records.history import AT_ONCE, History
from taskrpc.robot.tasks.records.store import TaskStore

# One store serves all examples, and several classes have the rules.
CHECKS = [HealthCheck.function_scoped_fixture, HealthCheck.differing_executors]


def make(number, **changes):
    fields = {"task_type": "scan", "target": "area_a", "priority": 9, "arrival": number}
    return Task(task_id=number, submitted_at=1_700_000_000.25, **(fields | changes))


ANN, BOB = ("ann", b"a" * 16), ("", b"\x00" * 16)


def completion(client, sequence, first=1, **changes):
    fields = {"fingerprint": b"f" * 16, "response": b"\x00\xff", "code": 0, "at": 1.5}
    return Completion(*client, sequence, first, **(fields | changes))


async def known(store):
    """Whose requests of which numbers are remembered."""
    completions = (await store.load()).completions
    return sorted((each.principal, each.client, each.sequence) for each in completions)


class StoreRules:
    """The rules; a subclass has the fixture `store`."""

    async def test_a_new_store_is_empty_and_begins_with_number_one(self, store):
        stored = await store.load()
        assert (stored.tasks, stored.next_id) == ((), 1)

    async def test_saved_tasks_are_loaded_unchanged(self, store):
        full = make(
            2,
            state=TaskState.FAILED,
            started_at=1.0,
            ended_at=2.5,
            accepted_estimate=12.75,
            progress=0.5,
            message="a 'quoted' \x00 sentence",
            result='{"ranges": [1.0]}',
            client="ü",
            changes=(EstimateChange(-1.5, "task 1 was cancelled"),),
        )
        await store.apply([make(1), full])
        assert (await store.load()).tasks == (make(1), full)

    async def test_the_last_word_about_a_task_counts(self, store):
        await store.apply([make(1)])
        await store.apply([make(1, state=TaskState.CANCELED)])
        assert [task.state for task in (await store.load()).tasks] == [TaskState.CANCELED]

    async def test_the_number_of_a_forgotten_task_is_never_given_again(self, store):
        await store.apply([make(1), make(7)])
        await store.apply([], [7])
        stored = await store.load()
        assert ([task.task_id for task in stored.tasks], stored.next_id) == ([1], 8)

    async def test_one_call_saves_and_forgets(self, store):
        await store.apply([make(1), make(2)])
        await store.apply([make(3)], [1, 2, 99])
        assert [task.task_id for task in (await store.load()).tasks] == [3]

    async def test_a_cleared_store_begins_with_number_one(self, store):
        await store.apply([make(5)])
        await store.clear()
        stored = await store.load()
        assert (stored.tasks, stored.next_id) == ((), 1)

    async def test_a_pause_is_remembered_until_it_is_undone(self, store):
        assert not (await store.load()).paused
        await store.remember_pause(True)
        await store.close()
        assert (await store.load()).paused
        await store.remember_pause(False)
        assert not (await store.load()).paused

    async def test_a_cleared_store_is_not_paused(self, store):
        await store.remember_pause(True)
        await store.clear()
        assert not (await store.load()).paused

    async def test_a_closed_store_still_knows_its_tasks_when_it_is_asked_again(self, store):
        await store.apply([make(1)])
        await store.close()
        await store.close()
        assert (await store.load()).tasks == (make(1),)

    async def test_calls_take_effect_in_the_order_in_which_they_were_made(self, store):
        calls = [store.apply([make(1, priority=priority)]) for priority in range(1, 11)]
        *_, stored = await asyncio.gather(*calls, store.load())
        assert stored.tasks[0].priority == 10

    async def test_a_completion_is_loaded_as_it_was_with_the_task_that_came_with_it(self, store):
        done = completion(ANN, 2**64 - 1, 2**64 - 1, code=5, at=1e9 + 0.25)
        await store.apply([make(1)], completion=done)
        stored = await store.load()
        assert (stored.tasks, stored.completions) == ((make(1),), (done,))

    async def test_completion_forgets_only_settled_requests_of_its_client(self, store):
        for client in (ANN, BOB):
            for sequence in (1, 2, 2**63, 2**63 + 1):
                await store.apply([], completion=completion(client, sequence))
        await store.apply([], completion=completion(ANN, 2**63 + 2, first=2**63))
        last = [(*ANN, 2**63 + more) for more in (0, 1, 2)]
        assert await known(store) == [*((*BOB, each) for each in (1, 2, 2**63, 2**63 + 1)), *last]

    async def test_the_last_word_about_a_request_counts(self, store):
        await store.apply([], completion=completion(ANN, 1))
        await store.apply([], completion=completion(ANN, 1, response=b"another"))
        assert [each.response for each in (await store.load()).completions] == [b"another"]

    async def test_forgetting_a_client_keeps_the_completion_of_the_same_call(self, store):
        for client in (ANN, BOB):
            await store.apply([], completion=completion(client, 1))
        await store.apply([], completion=completion(BOB, 2), clients=[ANN, BOB, ("", b"x" * 16)])
        assert await known(store) == [(*BOB, 2)]

    async def test_only_a_cleared_store_gets_another_id_and_loses_completions(self, store):
        await store.apply([make(1)], completion=completion(ANN, 1))
        first = (await store.load()).store_id
        await store.close()
        assert (await store.load()).store_id == first
        assert len(first) == 16
        await store.clear()
        stored = await store.load()
        assert stored.store_id != first
        assert (len(stored.store_id), stored.completions) == (16, ())

    @settings(max_examples=15, suppress_health_check=CHECKS)
    @given(text=st.text(), instant=st.floats(allow_nan=False, allow_infinity=False))
    async def test_any_text_and_number_come_back_unchanged(self, store, text, instant):
        task = make(1, target=text, message=text, result=text, client=text, started_at=instant)
        await store.apply([task])
        assert (await store.load()).tasks == (task,)


def ended(number, at, **changes):
    return make(number, state=TaskState.SUCCEEDED, started_at=at - 1, ended_at=at, **changes)


class Opened(NamedTuple):
    """A store, and how tasks end in it."""

    store: TaskStore
    end: Callable[..., Awaitable[object]]
    """Stores ended tasks."""
    source: EndedTasks
    """Reads the ended tasks beside the store."""


class HistoryRules:
    """The rules for stores with an archive; a subclass has the fixture `opened`.

    `await opened(history)` opens the store of the test, again after a first call.
    """

    async def ids(self, opened):
        """The tasks that a server has in memory, and the archived ones."""
        loaded = sorted(task.task_id for task in (await opened.store.load()).tasks)
        assert sorted(task.task_id for task in await opened.source.recent()) == loaded
        archived, after = [], (0.0, -1)
        while page := await opened.source.archived(after):
            archived += [task.task_id for task in page]
            after = end_of(page[-1])
        return loaded, archived

    async def test_older_tasks_are_archived_and_the_oldest_are_removed(self, opened):
        kept = await opened(History(count=5, recent=2))
        for number in range(1, 10):
            await kept.end(ended(number, number))
        assert await self.ids(kept) == ([8, 9], [5, 6, 7])

    async def test_tasks_are_kept_for_the_time_of_the_history(self, opened):
        kept = await opened(History(count=None, seconds=10.0, recent=2))
        for number in range(1, 21):
            await kept.end(ended(number, number))
        assert await self.ids(kept) == ([19, 20], list(range(10, 19)))
        await kept.end(ended(21, 1000.0))
        assert await self.ids(kept) == ([21], [])

    async def test_without_an_archive_old_tasks_are_removed(self, opened):
        kept = await opened(History(count=2))
        for number in range(1, 6):
            await kept.end(ended(number, number))
        assert await self.ids(kept) == ([4, 5], [])

    async def test_interrupted_tasks_are_kept_whatever_the_history_is(self, opened):
        kept = await opened(History(count=None, seconds=1.0, recent=1))
        await kept.end(make(1, state=TaskState.INTERRUPTED, ended_at=1.0))
        for number in range(2, 6):
            await kept.end(ended(number, number * 100))
        assert await self.ids(kept) == ([1, 5], [])

    async def test_a_shorter_history_removes_few_tasks_at_a_time(self, opened):
        kept = await opened(History(count=None, recent=10))
        for number in range(1, 301):
            await kept.end(ended(number, number))
        assert await self.ids(kept) == (list(range(291, 301)), list(range(1, 291)))
        kept = await opened(History(count=15, recent=10))
        await kept.end(ended(301, 301))
        loaded, archived = await self.ids(kept)
        assert loaded == list(range(292, 302))
        assert archived == list(range(AT_ONCE + 1, 292))
        for number in range(302, 310):
            await kept.end(ended(number, number))
        assert await self.ids(kept) == (list(range(300, 310)), list(range(295, 300)))

    async def test_fewer_tasks_in_memory_archive_the_others(self, opened):
        kept = await opened(History(count=20, recent=10))
        for number in range(1, 11):
            await kept.end(ended(number, number))
        kept = await opened(History(count=5, recent=5))
        for number in (11, 12):
            await kept.end(ended(number, number))
        assert await self.ids(kept) == ([8, 9, 10, 11, 12], [])

    async def test_a_cleared_store_has_no_archive(self, opened):
        kept = await opened(History(count=10, recent=1))
        for number in range(1, 5):
            await kept.end(ended(number, number))
        await kept.store.clear()
        assert await self.ids(kept) == ([], [])

    async def test_archived_tasks_are_read_unchanged(self, opened):
        kept = await opened(History(count=10, recent=1))
        task = ended(1, 5.0, message="a 'quoted' \x00 sentence", client="ü", machine="::1")
        task = task.decided(2.0, "ann", "moved to priority 9")
        await kept.end(task)
        assert await kept.source.recent() == [task]
        await kept.end(ended(2, 6.0))
        assert await kept.source.archived((0.0, -1)) == [task]

    async def test_reader_gets_each_ended_task_once_in_the_order_of_the_ends(self, opened):
        kept = await opened(History(count=None, recent=3))
        await kept.end(make(1, state=TaskState.INTERRUPTED, ended_at=4.5))
        await kept.store.apply([make(2)])
        for number in range(3, 12):
            await kept.end(ended(number, number))
        found = [task.task_id async for page in pages_of(kept.source, 0.0) for task in page]
        assert found == [3, 4, 1, 5, 6, 7, 8, 9, 10, 11]
        found = [task.task_id async for page in pages_of(kept.source, 8.0) for task in page]
        assert found == [8, 9, 10, 11]
