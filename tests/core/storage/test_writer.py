"""Group commit: many changes share one transaction, and each gets its own correct outcome."""

import asyncio
import contextlib
import sqlite3
import threading

import pytest

from taskrpc.core.exactly_once.stores import SqliteCompletions
from taskrpc.core.request_ids.ids import Completion
from taskrpc.core.storage.lock import FileInUse
from taskrpc.core.storage.writer import Writer
from taskrpc.errors import OutcomeUnknown, StoreError

TABLE = "CREATE TABLE IF NOT EXISTS booked (seat INTEGER PRIMARY KEY)"


@pytest.fixture
async def path(tmp_path):
    return tmp_path / "seats.db"


@pytest.fixture
async def store(path):
    store = SqliteCompletions(path, [TABLE])
    await store.recall()
    yield store
    await store.close()


def completion(sequence, first=1):
    return Completion("", b"c" * 16, sequence, first, b"f" * 16, b"", 0, 1.0)


async def book(store, *seats):
    """Book seats at once, each in a request of its own; returns what became of each."""
    return await asyncio.gather(*(book_one(store, seat) for seat in seats), return_exceptions=True)


def book_one(store, seat):
    effect = [("INSERT INTO booked VALUES (?)", (seat,))]
    return asyncio.ensure_future(store.complete(completion(seat), effect))


def booked(path):
    """The seats and the requests that the file remembers."""
    with contextlib.closing(sqlite3.connect(path)) as connection:
        seats = [seat for (seat,) in connection.execute("SELECT seat FROM booked ORDER BY seat")]
        rows = connection.execute("SELECT sequence FROM taskrpc_completion ORDER BY sequence")
        return seats, [int(sequence, 16) for (sequence,) in rows]


async def test_changes_of_one_iteration_share_a_transaction(disk, store, path):
    before = disk.commits
    assert await book(store, *range(1, 51)) == [None] * 50
    assert disk.commits - before == 1
    assert booked(path) == (list(range(1, 51)), list(range(1, 51)))


async def test_changes_while_the_disk_is_busy_are_the_next_transaction(disk, store, path):
    before = disk.commits
    busy, go_on = threading.Event(), threading.Event()

    def wait_in_the_thread(connection):
        busy.set()
        go_on.wait()

    working = asyncio.ensure_future(store._writer.read(wait_in_the_thread))
    while not busy.is_set():
        await asyncio.sleep(0)
    booking = [book_one(store, seat) for seat in (1, 2, 3)]
    await asyncio.sleep(0)
    assert disk.commits == before
    go_on.set()
    assert await asyncio.gather(*booking) == [None] * 3
    await working
    assert disk.commits - before == 1


@pytest.mark.parametrize("bad", range(7))
async def test_invalid_change_does_not_affect_the_others(store, path, bad):
    await book(store, 100)
    seats = list(range(1, 8))
    seats[bad] = 100
    outcomes = await book(store, *seats)
    assert [type(outcome) for outcome in outcomes].count(StoreError) == 1
    assert "UNIQUE constraint failed: booked.seat" in str(outcomes[bad])
    others = sorted({*range(1, 8)} - {bad + 1} | {100})
    assert booked(path) == (others, others)


async def test_cancelled_caller_does_not_stop_its_change(store, path):
    booking = book_one(store, 1)
    await asyncio.sleep(0)
    booking.cancel()
    assert await book(store, 2) == [None]
    assert booked(path)[0] == [1, 2]


async def test_changes_refused_by_a_full_disk_are_not_stored(disk, store, path):
    disk.failures = [sqlite3.SQLITE_FULL] * 2
    outcomes = await book(store, 1, 2, 3)
    assert [str(outcome) for outcome in outcomes] == [
        f"{path}: the disk is full; nothing was stored"
    ] * 3
    assert await book(store, 4) == [None]
    assert booked(path) == ([4], [4])


async def test_space_of_the_log_is_used_again_on_a_full_disk(disk, store, path):
    assert await book(store, 1) == [None]
    disk.failures = [sqlite3.SQLITE_FULL]
    assert await book(store, 2, 3) == [None] * 2
    assert booked(path) == ([1, 2, 3], [1, 2, 3])
    assert b"seat" in path.read_bytes()  # what was in the log has gone into the file


async def test_failed_commit_without_effect_is_refused(disk, store, path):
    disk.failures = ["before"]
    outcomes = await book(store, 1, 2, 3)
    assert {type(outcome) for outcome in outcomes} == {StoreError}
    assert str(outcomes[0]) == f"{path}: writing to it failed (disk I/O error); nothing was stored"
    assert await book(store, 4) == [None]
    assert booked(path) == ([4], [4])


async def test_failed_commit_with_effect_counts_as_stored(disk, store, path):
    disk.failures = ["after"]
    assert await book(store, 1, 2, 3) == [None] * 3
    assert await book(store, 4) == [None]
    assert booked(path) == ([1, 2, 3, 4], [1, 2, 3, 4])


@pytest.mark.parametrize("first", ["before", "after"])
@pytest.mark.parametrize("then", ["before", "after"])
async def test_second_failed_commit_is_not_confused_with_the_first(disk, store, path, first, then):
    disk.failures = [first, None, then]
    outcomes = [*await book(store, 1), *await book(store, 2)]
    done = [seat for seat, outcome in enumerate(outcomes, 1) if outcome is None]
    assert done == [seat for seat, failure in ((1, first), (2, then)) if failure == "after"]
    assert booked(path) == (done, done)


@pytest.mark.parametrize("failures", [["before", "before"], ["after", "after"], ["before", 13]])
async def test_outcome_is_unknown_if_the_next_commit_fails_too(disk, store, path, failures):
    disk.failures = failures
    outcomes = await book(store, 1, 2)
    assert {type(outcome) for outcome in outcomes} == {OutcomeUnknown}
    assert len({id(outcome) for outcome in outcomes}) == 2
    (refused,) = await book(store, 3)
    assert type(refused) is StoreError
    assert str(refused).startswith(f"{path} cannot be used any more, because writing to it failed")
    assert "\n" not in str(refused)
    assert 3 not in booked(path)[0]


async def test_missing_file_refuses_all_work_until_it_is_restored(disk, store, path):
    disk.failures, disk.is_gone = ["after"], True
    (unknown,) = await book(store, 1)
    assert type(unknown) is OutcomeUnknown
    assert "unable to open database file" in str(unknown)
    with pytest.raises(StoreError, match="unable to open database file"):
        await store.recall()
    assert type((await book(store, 2))[0]) is StoreError
    disk.is_gone = False
    assert [each.sequence for each in (await store.recall()).completions] == [1]
    assert await book(store, 3) == [None]
    assert booked(path) == ([1, 3], [1, 3])


async def test_calls_take_effect_in_order_despite_failures(disk, store):
    disk.failures = [None, "before"]
    calls = [
        book_one(store, 1),
        asyncio.ensure_future(store._writer.read(_count)),
        book_one(store, 2),
        asyncio.ensure_future(store._writer.read(_count)),
        book_one(store, 3),
        asyncio.ensure_future(store._writer.read(_count)),
    ]
    _, one, refused, still_one, _, two = await asyncio.gather(*calls, return_exceptions=True)
    assert (one, type(refused), still_one, two) == (1, StoreError, 1, 2)


def _count(connection):
    return connection.execute("SELECT count(*) FROM booked").fetchone()[0]


@pytest.mark.real_time
def test_store_works_in_a_second_asyncio_run(path):
    store = SqliteCompletions(path, [TABLE])
    for seat in (1, 2):
        assert asyncio.run(book(store, seat)) == [None]
    asyncio.run(store.close())
    assert booked(path) == ([1, 2], [1, 2])


class Pages:
    """A file that keeps what is written, one transaction after another."""

    is_broken = False

    def __init__(self):
        self.written = []
        self.gate = threading.Event()
        self.gate.set()

    def write(self, database, changes):
        assert database is self
        self.gate.wait(5)
        self.written.append(list(changes))

    def change(self, work):
        work(self.written)

    def close(self):
        self.written.append("closed")


@pytest.fixture
async def pages():
    return Pages()


@pytest.fixture
async def writer(pages):
    writer = Writer(lambda: pages, pages.write)
    yield writer
    pages.gate.set()
    await writer.close()


async def test_changes_of_several_iterations_share_a_transaction_while_the_disk_is_busy(
    writer, pages
):
    pages.gate.clear()
    asked = [writer.change("a")]
    await asyncio.sleep(0)
    for change in "bcd":
        asked.append(writer.change(change))
        await asyncio.sleep(0)
    pages.gate.set()
    await asyncio.gather(*asked)
    assert pages.written == [["a"], ["b", "c", "d"]]
    assert writer.transactions == {1: 1, 3: 1}
    await writer.change("e")
    assert writer.transactions == {1: 2, 3: 1}


async def test_cancelled_caller_does_not_delay_the_results_of_others(writer, pages):
    asked = [writer.change(change) for change in "abc"]
    asked[0].cancel()
    async with asyncio.timeout(60):
        assert await asyncio.gather(*asked[1:]) == [None, None]
    assert pages.written == [["a", "b", "c"]]


async def test_separate_work_runs_between_the_changes_around_it(writer, pages):
    asked = [writer.change("a")]
    alone = asyncio.ensure_future(writer.change_alone(lambda written: written.append("alone")))
    await asyncio.sleep(0)
    asked.append(writer.change("b"))
    await asyncio.gather(alone, *asked)
    assert pages.written == [["a"], "alone", ["b"]]


async def test_file_that_another_process_uses_is_claimed_once_it_is_free(pages):
    in_use = [FileInUse("in use"), FileInUse("still in use")]

    def open_file():
        if in_use:
            raise in_use.pop(0)
        return pages

    writer, told = Writer(open_file, pages.write), []
    began = asyncio.get_running_loop().time()
    await writer.claim(told.append)
    assert asyncio.get_running_loop().time() - began == pytest.approx(0.1)
    assert [each.fact for each in told] == ["in use"], "it is reported once"
    await writer.change("a")
    await writer.close()
    assert pages.written == [["a"], "closed"]


def test_unfinished_change_of_one_asyncio_run_does_not_block_the_next():
    pages = Pages()
    writer = Writer(lambda: pages, pages.write)

    async def leave():
        pages.gate.clear()
        writer.change("left behind")
        await asyncio.sleep(0.01)

    async def change():
        pages.gate.set()
        async with asyncio.timeout(60):
            await writer.change("a")
            await writer.close()

    asyncio.run(leave())
    asyncio.run(change())
    assert pages.written[-2:] == [["a"], "closed"]
