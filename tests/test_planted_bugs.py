"""The fault harnesses fit the product: each can be imported, and each of its bugs can be planted.

The harnesses take minutes, so the plain run leaves them out. A renamed function that a planted bug
replaces is found here, within seconds.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.faults.harness import Bug

HARNESSES = sorted(path.stem for path in (Path(__file__).parent / "faults").glob("test_*.py"))


def planted_bugs(harness: str) -> Iterator[Bug]:
    """The bugs that the tests of a harness must find."""
    module = importlib.import_module(f"tests.faults.{harness}")
    for test in vars(module).values():
        for mark in getattr(test, "pytestmark", []):
            if getattr(mark, "name", "") == "planted":
                yield from mark.args


@pytest.mark.parametrize("harness", HARNESSES)
def test_bugs_can_be_planted(harness):
    bugs = list(planted_bugs(harness))
    assert bugs, "a harness without a planted bug proves nothing"
    for bug in bugs:
        with bug.planted():
            pass
