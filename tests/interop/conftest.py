"""Tests with programs of other projects: `pytest -m interop`; needs the extra `interop`."""

from __future__ import annotations

import asyncio
import functools
import inspect
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent
LIMIT = 180.0
"""Seconds for one async test; pyzeros compiles its messages first, which takes up to a minute."""


def pytest_collection_modifyitems(items):
    """Mark all tests of this folder, and limit the time of the async ones."""
    for item in items:
        if FOLDER in item.path.parents:
            item.add_marker(pytest.mark.interop)
            if inspect.iscoroutinefunction(item.obj):
                item.obj = limited(item.obj)


def limited(test):
    """Return the test with a time limit; that of a fixture would not reach into the test."""

    @functools.wraps(test)
    async def with_limit(*args, **kwargs):
        async with asyncio.timeout(LIMIT):
            await test(*args, **kwargs)

    return with_limit
