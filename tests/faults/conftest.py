"""Fault harnesses: `pytest -m faults` runs the small sizes, `--soak` the large ones."""

from __future__ import annotations

import pytest

from tests.faults.harness import TOLD, Counts


@pytest.fixture
def large(request):
    """Whether the large size is wanted."""
    return request.config.getoption("soak")


@pytest.fixture
def seed(request):
    """What chance begins with; another one by `--seed`."""
    given = request.config.getoption("seed")
    print(f"seed {given}; again with: pytest -m faults --seed {given} '{request.node.nodeid}'")
    return given


@pytest.fixture
def counts(request):
    """Counts what happens in this test."""
    held = Counts()
    TOLD.append((request.node.name, held))
    return held


def pytest_terminal_summary(terminalreporter):
    """Tell what really happened."""
    if TOLD:
        terminalreporter.section("what happened in the fault harnesses")
        for name, held in TOLD:
            terminalreporter.line(f"{name}: {held}")
