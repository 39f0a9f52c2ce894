"""A started node on a router of its own kind, and foreign programs beside it."""

from __future__ import annotations

from importlib.util import find_spec

import pytest

import taskrpc

if find_spec("zenoh") is None:
    collect_ignore_glob = ["test_*.py"]  # without the extra `zenoh`, only these tests are left out
else:
    from tests.middleware.zenoh.helpers import Foreign


@pytest.fixture
async def node(zenoh_router):
    async with taskrpc.Node("here", transport="zenoh", peers=[zenoh_router]) as node:
        yield node


@pytest.fixture
def foreign(zenoh_router):
    """A program that is not taskrpc's."""
    program = Foreign(zenoh_router)
    yield program
    program.close()
