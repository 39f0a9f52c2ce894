"""A task server in memory and virtual time, and the commands that call it."""

from __future__ import annotations

import asyncio

import pytest

import taskrpc
from taskrpc.cli.robot.task.command_line import configure, perform
from taskrpc.cli.shared.parsing import Parser
from taskrpc.cli.shared.remote import Remote
from taskrpc.robot import KinematicRobot, default_world
from taskrpc.robot.tasks import MemoryStore, TaskServer


@pytest.fixture(autouse=True)
def _in_memory(monkeypatch):
    monkeypatch.setattr(Remote, "node", lambda self: taskrpc.Node("_cli", transport="memory"))


class Lab:
    """A task server that can be ended and started again over the same store."""

    def __init__(self, **settings):
        self.store = MemoryStore()
        self._settings = settings
        self._node = self._server = None

    async def start(self):
        # A token of its own: a client's connection ends with this server, as between programs.
        self._node = taskrpc.Node("task_server", transport="memory", token="server")
        await self._node.start()
        robot = KinematicRobot(default_world())
        # Virtual like all other time: servers that follow each other must not share an instant.
        clock = asyncio.get_running_loop().time
        self._server = TaskServer(
            self._node,
            robot,
            self.store,
            wall_clock=lambda: 1_700_000_000 + clock(),
            **self._settings,
        )
        await self._server.start()

    async def stop(self):
        if self._node:
            await self._server.close()
            await self._node.destroy()
            self._node = None


@pytest.fixture
async def lab():
    lab = Lab()
    await lab.start()
    yield lab
    await lab.stop()


def parsed(*argv):
    parser = Parser(prog="taskrpc task")
    configure(parser)
    return parser.parse_args(argv)


async def task(*argv):
    return await perform(parsed(*map(str, argv)))


@pytest.fixture
def lines(capsys):
    """What was printed to stdout since the last look, line by line."""
    return lambda: capsys.readouterr().out.splitlines()
