"""Finds the fewest faults with which a run still fails in the same way."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Final

from taskrpc.simulation.run.run import Result

GROUPS: Final = ("delays", "order of starts")
"""Decisions that are left out or kept as a whole, besides the single faults."""

_MOST_TRIES = 400

Play = Callable[[Sequence[str], bool], Result]
"""Runs the seed again with only these faults; the flag says whether the stacks run in order."""


def shrink(found: Result, play: Play) -> tuple[list[str], bool]:
    """Return the faults that the failure needs, and whether it happens with stacks in order.

    Raises RuntimeError if the same seed and faults do not fail again.
    """
    names = [*found.faults, *GROUPS]

    @functools.cache  # a run may take seconds
    def again_with(kept: tuple[str, ...], orderly: bool) -> bool:
        again = play(kept, orderly).failure
        return again is not None and found.failure is not None and again.kind == found.failure.kind

    def fails(kept: Sequence[str], orderly: bool) -> bool:
        return again_with(tuple(kept), orderly)

    if not fails(names, False):
        raise RuntimeError(f"seed {found.seed} fails at one time and not at another")
    orderly = fails(names, True)
    if fails([], orderly):
        return [], orderly
    kept = _fewest(names, lambda chosen: fails(chosen, orderly))
    return _each_matters(kept, lambda chosen: fails(chosen, orderly)), orderly


def _fewest(names: list[str], fails: Callable[[list[str]], bool]) -> list[str]:
    """Let Hypothesis search a small set of names with which the run fails."""
    from hypothesis import HealthCheck, Phase, find, settings
    from hypothesis import strategies as st
    from hypothesis.errors import NoSuchExample

    def chosen(flags: tuple[bool, ...]) -> list[str]:
        return [name for name, is_kept in zip(names, flags, strict=True) if is_kept]

    try:
        flags = find(
            st.tuples(*[st.booleans() for _ in names]),
            lambda flags: fails(chosen(flags)),
            settings=settings(
                max_examples=_MOST_TRIES,
                derandomize=True,
                database=None,
                deadline=None,
                phases=[Phase.generate, Phase.shrink],
                suppress_health_check=list(HealthCheck),
            ),
        )
    except NoSuchExample:  # the failure needs most of the faults
        return names
    return chosen(flags)


def _each_matters(kept: list[str], fails: Callable[[list[str]], bool]) -> list[str]:
    """Leave out every name without which the run still fails."""
    for name in list(kept):
        less = [each for each in kept if each != name]
        if fails(less):
            kept = less
    return kept
