"""Nothing takes more function calls than the committed figures say, and nothing takes fewer unseen.

A timed test fails on a busy machine; this one fails on a dearer call, and on nothing else.
"""

import asyncio
import json
from functools import partial

import pytest

from tests.steps import FIGURES, VERSION, WORKS, counted, steps_of

MARGIN = 0.05
UPDATE = "python -m tests.steps --update"


@pytest.fixture(scope="module")
def counts():
    return counted()


@pytest.fixture(scope="module")
def figures():
    known = json.loads(FIGURES.read_text())
    if VERSION not in known:
        pytest.skip(f"no figures for Python {VERSION} yet; `{UPDATE}` makes them")
    return known[VERSION]


@pytest.mark.parametrize("name", WORKS)
def test_a_piece_of_work_takes_as_many_steps_as_it_did(name, counts, figures):
    count, figure = counts[name], figures[name]
    assert count <= figure * (1 + MARGIN), (
        f"{name} takes {count:g} function calls, {count / figure - 1:+.0%}; find out why, or raise"
        f" the figure with `{UPDATE}`"
    )
    assert count >= figure * (1 - MARGIN), (
        f"{name} takes only {count:g} function calls, {count / figure - 1:+.0%}: well done; lower"
        f" the figure with `{UPDATE}`, so that it stays so"
    )


def test_exactly_once_service_costs_the_calls_of_other_services_nothing(counts):
    assert counts["a call beside an exactly-once service"] == counts["a call"]


def test_each_piece_of_work_has_a_figure_for_each_python():
    for version, figures in json.loads(FIGURES.read_text()).items():
        assert set(figures) == set(WORKS), version


async def test_functions_of_python_and_of_c_count_wherever_they_are_called():
    async def work(times):
        loop = asyncio.get_running_loop()
        for _ in range(times):
            loop.call_soon(lambda: max(1, 2))
            await asyncio.sleep(0)

    once, twice = [await steps_of(partial(work, times)) for times in (100, 200)]
    each = (twice - once) / 100
    assert each >= len(["call_soon", "lambda", "max", "sleep"])
    assert [await steps_of(partial(work, 100)) for _ in range(3)] == [once] * 3
