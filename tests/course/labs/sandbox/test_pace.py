"""How fast time passes while a submission is checked."""

import itertools

import pytest

from taskrpc.course.labs.sandbox import pace, speed
from taskrpc.course.labs.sandbox.pace import Pace, slowness, stretch


@pytest.fixture
def speeds(monkeypatch):
    """The speeds that were set; the last one holds."""
    found = [1.0]
    monkeypatch.setattr(speed, "set_speed", lambda factor: found.append(factor))
    monkeypatch.setattr(speed, "speed", lambda: found[-1])
    return found


@pytest.mark.parametrize(("share", "found"), [(1.0, 1.0), (0.5, 2.0), (0.1, 10.0), (2.0, 1.0)])
def test_slowness_is_the_real_time_of_a_second_of_work(share, found):
    times = itertools.count()
    work = (share * number for number in itertools.count())
    assert slowness(lambda: float(next(times)), lambda: next(work)) == pytest.approx(found)


@pytest.mark.parametrize(
    ("slow", "run", "found"),
    [(1.0, 1, 1.0), (2.0, 1, 1.0), (2.0, 2, 2.0), (6.0, 1, 3.0), (6.0, 2, 6.0), (99.0, 1, 8.0)],
)
def test_time_passes_slower_on_a_busy_machine_and_in_the_second_run(slow, run, found):
    assert stretch(slow, run) == found


def test_a_machine_that_becomes_busy_gets_slower_time_for_the_second_run(speeds):
    measured = iter([1.0, 6.0])
    found = Pace(8.0, 8.0, lambda: next(measured))
    assert (speeds[-1], found.is_busy, found.slower) == (8.0, False, 1.0)
    found.second_run()
    assert (found.is_busy, found.slower) == (True, 6.0)
    found.first_run()
    assert found.slower == 3.0


def test_a_machine_that_was_busy_in_the_first_run_stays_busy(speeds):
    measured = iter([6.0, 1.0])
    found = Pace(8.0, 8.0, lambda: next(measured))
    found.second_run()
    assert (found.is_busy, found.slower) == (True, 6.0)


def test_real_time_stays_real_and_is_slower_than_usual(speeds):
    found = Pace(1.0, 8.0, lambda: 50.0)
    found.second_run()
    assert (speeds[-1], found.slower) == (1.0, 8.0)


def test_the_slowness_of_this_machine_can_be_measured():
    assert 1.0 <= pace.slowness() < float("inf")
