"""The virtual clock is exact, never sleeps, and reports a wait that nothing can end."""

import asyncio
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from taskrpc.testing import NothingWillEverHappen, VirtualTimeLoop
from tests.core.testing.one_seed import PLANTS
from tests.properties import examples

ROOT = Path(__file__).parents[3]


async def test_an_hour_passes_at_once_and_exactly():
    loop = asyncio.get_running_loop()
    began, real_began = loop.time(), time.perf_counter()
    await asyncio.sleep(3600)
    assert loop.time() - began == pytest.approx(3600, abs=1e-6)
    assert time.perf_counter() - real_began < 60


async def test_timers_fire_in_the_order_of_their_times():
    fired = []
    loop = asyncio.get_running_loop()
    for delay in (3, 1, 2):
        loop.call_later(delay, fired.append, delay)
    await asyncio.sleep(4)
    assert fired == [1, 2, 3]


async def test_the_clock_stands_still_while_a_thread_works():
    loop = asyncio.get_running_loop()
    release = threading.Event()
    timer = loop.call_later(0.001, lambda: None)
    job = loop.run_in_executor(None, release.wait, 5)
    loop.call_soon(release.set)
    before = loop.time()
    assert await job
    assert loop.time() == before
    timer.cancel()


def test_waiting_for_nothing_is_an_error_instead_of_a_hang():
    loop = VirtualTimeLoop()
    forever = loop.create_future()
    with pytest.raises(NothingWillEverHappen):
        loop.run_until_complete(forever)
    loop.close()


async def test_timers_are_never_early_not_even_by_rounding():
    loop = asyncio.get_running_loop()
    await asyncio.sleep(1 / 3)
    deadline = loop.time() + 1e-10
    for _ in range(3):
        loop.call_soon(lambda: None)
        await asyncio.sleep(deadline - loop.time())
    assert loop.time() >= deadline


# One seed, one run


def runs(hash_seed, count, *options):
    """A line for each seed, from a new process: the seed, and the size and digest of the trace."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.core.testing.one_seed", "0", str(count), *options],
        cwd=ROOT,
        env={**os.environ, "PYTHONHASHSEED": str(hash_seed)},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.splitlines()


@pytest.mark.hypothesis  # few seeds in the quick suite, all of them with this mark
def test_a_seed_gives_the_same_run_in_every_process():
    count = examples(20)
    first = runs(1, count)
    assert runs(2, count) == first
    assert len({line.split()[-1] for line in first}) == count, "other seeds give other runs"


@pytest.mark.faults
@pytest.mark.parametrize("plant", PLANTS)
def test_another_source_of_chance_or_time_is_found(plant):
    assert runs(1, 4, plant) != runs(2, 4, plant)
