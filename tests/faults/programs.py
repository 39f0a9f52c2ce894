"""Programs that a harness starts, kills and stops: real processes that use the product."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import threading
from pathlib import Path

from tests.faults.harness import Bug

ROOT = Path(__file__).parents[2]

PLANTING = """\
import runpy, sys
from tests.faults.harness import plant_from
plant_from(sys.argv.pop(1))
del sys.argv[0]
runpy.run_path(sys.argv[0], run_name="__main__")
"""

ADDER = """\
import asyncio, sys
import srvgen, taskrpc
Add = srvgen.load("example_interfaces/srv/AddTwoInts")

async def add(request, response):
    if request.b:
        await asyncio.sleep(request.b / 1000)
    response.sum = request.a
    return response

async def main():
    async with taskrpc.Node("adder") as node:
        node.create_service(
            Add, "add", add, concurrency=10_000, idempotent="idempotent" in sys.argv,
            join="join" in sys.argv,
        )
        print("ready", flush=True)
        await node.spin()

taskrpc.run(main())
"""
"""Offers `add`: answers with `a` after `b` milliseconds; options `join` and `idempotent`."""

TASK_SERVER = """
import os, sys
os.dup2(1, 2)  # what it says of itself is on stderr
from taskrpc.cli.robot.server.command_line import main
sys.exit(main(sys.argv[1:]))
"""
"""`taskrpc-server`, whose lines begin with its name."""


class Programs:
    """Starts programs and stops each by its process id."""

    def __init__(self, folder: Path, bug: Bug | None) -> None:
        self._folder = folder
        self._bug = bug
        self._writing = threading.Lock()
        self._started: list[subprocess.Popen[str]] = []
        self.said = ""
        """What the program that was started last has printed until it was ready."""

    def __enter__(self) -> Programs:
        return self

    def __exit__(self, *_: object) -> None:
        for program in self._started:
            if program.poll() is None:
                program.kill()
            program.wait(10)
            _close(program)

    def command(self, script: Path, *arguments: str) -> list[str]:
        """The command that starts a script of the harness, with the planted bug."""
        planting = [] if self._bug is None else ["-c", PLANTING, self._bug.place]
        return [sys.executable, *planting, str(script), *arguments]

    async def start(
        self, source: str = ADDER, *arguments: str, ready: str = "ready", name: str = "adder.py"
    ) -> subprocess.Popen[str]:
        """Start a program of this text and wait until it prints a line that begins with `ready`."""
        return await asyncio.to_thread(self._start, source, arguments, ready, name)

    def _start(
        self, source: str, arguments: tuple[str, ...], ready: str, name: str
    ) -> subprocess.Popen[str]:
        script = self._folder / name
        with self._writing:  # one file each: none is read while another program writes it
            if not script.exists() or script.read_text() != source:
                script.write_text(source)
        program = subprocess.Popen(
            self.command(script, *arguments),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=self._folder,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )
        self._started.append(program)
        said = [program.stdout.readline()]
        while said[-1] and not said[-1].startswith(ready):
            said.append(program.stdout.readline())
        self.said = "".join(said)
        assert said[-1], f"{self.said}{program.stderr.read()}"
        return program


async def kill(program: subprocess.Popen[str]) -> None:
    """`kill -9`, and wait until the process has ended."""
    program.kill()
    await asyncio.to_thread(program.wait, 10)
    _close(program)


async def terminate(program: subprocess.Popen[str], patience: float = 30) -> int:
    """SIGTERM; returns the exit status."""
    program.terminate()
    status = await asyncio.to_thread(program.wait, patience)
    _close(program)
    return status


def _close(program: subprocess.Popen[str]) -> None:
    """Close the pipes: a soak run starts ten thousand programs."""
    for pipe in (program.stdin, program.stdout, program.stderr):
        pipe.close()
