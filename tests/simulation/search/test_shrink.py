"""Shrinking leaves the faults that matter, and no other."""

import pytest

from taskrpc.simulation.run.run import Failure, Result
from taskrpc.simulation.search.shrink import GROUPS, shrink
from tests.simulation.small_programs import CLIENT, ROBOT


def result(faults, failure):
    return Result(1, failure, tuple(faults), "hash", 0, 1.0)


def shrunk(faults, is_failing):
    """Shrink a run that fails if `is_failing` says so of the faults and the order."""
    failure = Failure("wrong", "text")
    tries = []

    def play(kept, orderly):
        tries.append(kept)
        return result(kept, failure if is_failing(set(kept), orderly) else None)

    return shrink(result(faults, failure), play), tries


FAULTS = [f"lose request {number} of /pick" for number in range(1, 7)]


@pytest.mark.parametrize(
    "needed",
    [
        set(),
        {FAULTS[5]},
        {FAULTS[0], FAULTS[3]},
        {FAULTS[1], *GROUPS},
        set(FAULTS),
        {*FAULTS, *GROUPS},
    ],
)
def test_what_is_left_is_what_the_failure_needs(needed):
    (kept, in_order), _ = shrunk(FAULTS, lambda kept, orderly: needed <= kept)
    assert set(kept) == needed
    assert in_order


def test_one_of_two_sufficient_faults_is_left():
    (kept, _), _ = shrunk(FAULTS, lambda kept, orderly: bool(kept & set(FAULTS[2:4])))
    assert len(kept) == 1
    assert kept[0] in FAULTS[2:4]


def test_order_of_the_threads_is_kept_if_it_matters():
    (kept, in_order), _ = shrunk(FAULTS, lambda kept, orderly: not orderly)
    assert (kept, in_order) == ([], False)


def test_another_failure_does_not_count():
    failure = Failure("wrong", "text")

    def play(kept, orderly):
        return result(kept, failure if FAULTS[0] in kept else Failure("other", "text"))

    assert shrink(result(FAULTS, failure), play) == ([FAULTS[0]], True)


def test_failure_that_does_not_come_again_is_an_error():
    with pytest.raises(RuntimeError, match="seed 1 fails at one time and not at another"):
        shrunk(FAULTS, lambda kept, orderly: False)


@pytest.mark.real_time
def test_story_of_a_run_has_only_the_faults_that_matter(simulated):
    loaded = simulated(
        """
        scenario.faults(lose_requests=0.3, lose_responses=0.3, delay=(0.0, 0.2))

        @scenario.finally_
        def all_picked(world):
            assert world.count("client", "failed 1") == 0
        """,
        robot=ROBOT,
        client=CLIENT,
    )
    failure = loaded.first_failure()
    assert failure.kind == "all_picked"
    assert len(failure.faults) == 1
    assert failure.faults[0].startswith("lose re")
    assert failure.groups == []
    assert failure.in_order
    assert sum(each.kind == "fault" for each in failure.events) == 1
