"""The story of the demo in virtual time."""

from __future__ import annotations

import asyncio

import pytest

from taskrpc.cli.robot.demo.story import open_stage, perform
from taskrpc.testing import VirtualTimeLoop


def on_virtual_time(main):
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(main())


class Seen:
    """One run of the story, which all tests share."""

    def __init__(self):
        self.lines = []
        self.tasks = on_virtual_time(self._watch)

    async def _watch(self):
        async with open_stage(on_line=self.lines.append) as stage:
            tasks = await perform(stage)
        self.took = asyncio.get_running_loop().time()
        return tasks


@pytest.fixture(scope="module")
def seen():
    return Seen()
