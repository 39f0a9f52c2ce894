"""An action server in a separate process, which all tests of this folder may use."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[4]

PROGRAM = """
import asyncio, srvgen, taskrpc

Fibonacci = srvgen.load("example_interfaces/action/Fibonacci")

def accept(goal):
    if goal.order > 50:
        raise taskrpc.HandlerError("OUT_OF_RANGE", f"at most 49 numbers,\\nnot {goal.order}")
    return goal.order < 50

async def execute(goal):
    sequence = [0, 1]
    for _ in range(goal.request.order - 1):
        sequence.append(sequence[-1] + sequence[-2])
        goal.publish_feedback(Fibonacci.Feedback(sequence=sequence))
    result = Fibonacci.Result(sequence=sequence)
    if goal.request.order == 7:
        return goal.abort(result)
    if goal.request.order == 8:
        raise taskrpc.HandlerError("NOT_FOUND", "there is no eight")
    if goal.request.order == 9:
        await goal.wait_for_cancel()
        print("cancelled", flush=True)
        return goal.canceled(result)
    return result

async def main():
    async with taskrpc.Node("server") as node, taskrpc.Node("user") as user:
        node.create_action_server(Fibonacci, "fibonacci", execute, goal=accept)
        user.create_action_client(Fibonacci, "fibonacci")
        asyncio.get_running_loop().call_soon(lambda: print("ready", flush=True))
        await node.spin()

taskrpc.run(main())
"""


@contextlib.contextmanager
def _running(folder):
    runtime = folder / "runtime"
    runtime.mkdir(mode=0o700)
    environment = {"XDG_RUNTIME_DIR": str(runtime), "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM],
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        assert process.stdout.readline() == "ready\n"
        yield environment, process
    finally:
        process.kill()
        process.communicate()


@pytest.fixture(scope="session")
def running_action(tmp_path_factory):
    with _running(tmp_path_factory.mktemp("action")) as running:
        yield running


@pytest.fixture
def action(running_action, monkeypatch):
    """The process of the server of `/fibonacci`, in the environment of the test."""
    environment, process = running_action
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    return process
