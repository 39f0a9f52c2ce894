"""How many examples Hypothesis tries: few in the quick suite, all of them everywhere else."""

from __future__ import annotations

from hypothesis import settings

FEW = 10
"""Most examples of a test in the quick suite. `pytest -m hypothesis` tries them all."""

ALL, QUICK = "taskrpc", "taskrpc-quick"
"""Hypothesis's profiles."""
# How long an example takes depends on what else the machine does.
settings.register_profile(ALL, deadline=None)
settings.register_profile(QUICK, deadline=None, max_examples=FEW)


def examples(count: int) -> int:
    """Return this number, or in the quick suite at most the number that it tries of each test."""
    usual = settings().max_examples
    return min(count, usual) if usual == FEW else count
