"""Everything random comes from the source that the event loop or the thread has."""

from __future__ import annotations

import asyncio
import random
import threading
from functools import partial

import pytest

import taskrpc
from taskrpc.core.transport.chance import chance_of, give_chance, present_chance
from taskrpc.robot.tasks.records.sqlite_store import SqliteStore
from taskrpc.testing import VirtualTimeLoop


def test_loop_with_a_seed_is_the_source_of_everything_that_runs_on_it():
    async def drawn():
        chance = present_chance()
        return chance.random(), chance.randbytes(4)

    expected = random.Random(7)
    loop = VirtualTimeLoop(7)
    try:
        assert loop.run_until_complete(drawn()) == (expected.random(), expected.randbytes(4))
        assert chance_of(loop).random() == expected.random()
    finally:
        loop.close()


async def test_loop_without_a_seed_has_the_operating_systems_numbers(monkeypatch):
    monkeypatch.setattr("os.urandom", lambda count: b"\xff" * count)
    assert present_chance().randbytes(3) == b"\xff\xff\xff"
    assert present_chance().random() == 1 - 2**-53, "the largest number below 1"


def test_outside_of_a_loop_the_operating_system_is_the_source():
    assert len(present_chance().randbytes(16)) == 16
    assert 0 <= present_chance().random() < 1


def test_thread_draws_from_the_source_that_it_was_given():
    found, expected = [], random.Random(7).randbytes(16)

    def work():
        give_chance(random.Random(7))
        found.append(present_chance().randbytes(16))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert found == [expected]
    assert present_chance().randbytes(16) != expected, "other threads have their own source"


@pytest.mark.parametrize("store", [taskrpc.SqliteCompletions, SqliteStore])
def test_seed_determines_the_id_of_an_sqlite_store(store, tmp_path):
    ids = []
    for number, seed in enumerate((7, 7, 8)):
        with asyncio.Runner(loop_factory=partial(VirtualTimeLoop, seed)) as runner:
            ids.append(runner.run(id_of(store(tmp_path / f"{number}.db"))))
    assert ids[0] == ids[1] != ids[2]


async def id_of(store):
    """The id of a new store."""
    read = store.recall if isinstance(store, taskrpc.SqliteCompletions) else store.load
    try:
        return (await read()).store_id
    finally:
        await store.close()
