"""Grades one submission in a process of its own, and reports on standard output.

The process has accelerated time, as the programs that it starts. A fault here ends this
submission's grading and no other.
"""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import hashlib
import os
import sys
import tempfile
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path
from typing import Any

import msgspec

from taskrpc.errors import TaskRpcError
from taskrpc.labs import catalogue
from taskrpc.labs.grading import findings
from taskrpc.labs.hidden import hidden_checks, with_checks
from taskrpc.labs.lab import Check, Lab, NotMet
from taskrpc.labs.report import About, Line, Result, Stopped
from taskrpc.labs.sandbox import child, fork_server, linux, speed
from taskrpc.labs.sandbox.child_trial import child_trial
from taskrpc.labs.sandbox.limits import MEGABYTE, Limits, limit_this_process
from taskrpc.labs.sandbox.program import SpawnStarter, Starter
from taskrpc.labs.starter import RECORD, read_record, starter_files
from taskrpc.labs.submission import find_lab, find_root, remove, take
from taskrpc.labs.trial import Trial
from taskrpc.labs.variants import Variant
from taskrpc.ros.process_tree import end_children_with_this_process
from taskrpc.transport.tcp.tcp_network import TcpNetwork

_OWN = Limits(cpu=120, memory=2048 * MEGABYTE, file=100 * MEGABYTE, open_files=1024)
"""The limits of this process, in case a submission sends it far too much."""
_CHECK_LIMIT = 30.0
"""Real seconds of one check: far more than any needs, since each of its waits has a timeout."""
_BUSY = 0.05
"""Real seconds that a timer of this process may be late before time passes too fast."""
_BEAT = 0.02
_SLOWER = 2.0
_LONGEST = 1000
"""Most characters of a message."""
_LONGEST_ID = 200
_LONGEST_FOLDER = 30


class Request(msgspec.Struct, frozen=True):
    """What to grade.

    Attributes:
        source: the folder or ZIP file of the submission.
        lab: the number of the lab; None for that of the submission.
        variant: the ID of the variant; None for that of the submission.
        hidden: the folder with the lecturer's checks.
        speed: how much faster time passes; None for the lab's own.
    """

    source: str
    lab: int | None = None
    variant: str | None = None
    hidden: str | None = None
    speed: float | None = None


def main(text: str) -> int:
    """Grade the submission of a request."""
    request = msgspec.json.decode(text, type=Request)
    end_children_with_this_process()
    # Only `_report` writes to standard output; what a check prints goes to standard error.
    output = os.dup(1)
    os.dup2(2, 1)
    os.set_inheritable(output, False)
    if sys.platform != "win32":
        limit_this_process(_OWN)
        child.preload()
    # As late as possible: until the fork server is there, nobody removes it after a kill.
    base = Path(tempfile.mkdtemp(prefix="taskrpc-lab-", dir=_short_folder()))
    if sys.platform == "win32":
        server = None
    else:
        server = fork_server.fork_server(base)  # outside of `try`: programs leave through here
    linux.die_with_parent()
    try:
        asyncio.run(_grade(request, base, server, output))
    finally:
        remove(base)
    return 0


async def _grade(request: Request, base: Path, server: object, output: int) -> None:
    def report(line: Line) -> None:
        os.write(output, msgspec.json.encode(line) + b"\n")

    if sys.platform != "win32":
        # The process that asked has ended: nobody waits for the results.
        asyncio.get_running_loop().add_reader(0, _end_without_reader)
    if linux.can_confine():
        TcpNetwork.default_place = "unix:"  # confined programs have no other sockets
    try:
        await _graded(request, base, _starter(server), report)
    except TaskRpcError as error:
        places = f"{base / 'taken'}{os.sep}"
        report(Stopped(str(error).replace(places, "")[:_LONGEST]))


async def _graded(
    request: Request, base: Path, starter: Starter, report: Callable[[Line], None]
) -> None:
    taken = base / "taken"
    notes = take(Path(request.source), taken)
    part = find_lab(taken, request.lab)
    record = read_record(find_root(part, [RECORD]))
    number, id = _identity(request, record)
    lab, variant = catalogue.lab(number), Variant(id)
    root = find_root(part, [RECORD, *lab.files])
    report(About(number, id, _digest(lab, variant, root), tuple(notes)))
    shown = len(lab.checks)
    if request.hidden is not None:
        lab = with_checks(lab, hidden_checks(Path(request.hidden), lab))
    limited = [dataclasses.replace(each, run=_limited(each)) for each in lab.checks]
    lab = dataclasses.replace(lab, checks=tuple(limited))
    pace = _Pace(_speed_for(lab, root) if request.speed is None else request.speed)
    async with pace:
        found = findings(lab, lambda: _trial(root, variant, base, starter), pace.slow_down)
        position = 0
        async for each in found:
            pace.next_check()
            problem = each.problem or NotMet("", "", "")
            report(
                Result(
                    each.check.title,
                    each.check.points,
                    each.passed,
                    problem.expected[:_LONGEST],
                    problem.happened[:_LONGEST],
                    problem.look[:_LONGEST],
                    each.waits_for,
                    position >= shown,
                )
            )
            position += 1


class _Pace:
    """How fast time passes: slower for a check that failed while this machine was busy."""

    def __init__(self, factor: float) -> None:
        self._factor = factor
        self._latest = 0.0
        self._beating: asyncio.Task[None] | None = None

    async def __aenter__(self) -> None:
        self.next_check()
        self._beating = asyncio.ensure_future(self._beat())

    async def __aexit__(self, *_: object) -> None:
        assert self._beating is not None
        self._beating.cancel()

    def next_check(self) -> None:
        """Let time pass at full speed."""
        self._latest = 0.0
        speed.set_speed(self._factor)

    def slow_down(self) -> bool:
        """After a check that did not pass: whether to run it once more, in slower time."""
        if self._latest <= _BUSY or speed.speed() < self._factor or self._factor == 1:
            return False
        speed.set_speed(max(1.0, self._factor / _SLOWER))
        return True

    async def _beat(self) -> None:
        while True:
            before = speed.real_monotonic()
            await asyncio.sleep(_BEAT * speed.speed())
            self._latest = max(self._latest, speed.real_monotonic() - before - _BEAT)


@contextlib.asynccontextmanager
async def _trial(
    root: Path, variant: Variant, base: Path, starter: Starter
) -> AsyncIterator[Trial]:
    """Make a trial; raises NotMet if a program has destroyed what the trial needs."""
    try:
        async with child_trial(root, variant, base, starter) as trial:
            yield trial
    except (OSError, TaskRpcError) as error:
        raise NotMet(
            "a program that leaves other files alone",
            f"{type(error).__name__}: {error}",
            "which files does the program remove or change?",
        ) from error


def _limited(check: Check) -> Callable[[Trial], Awaitable[None]]:
    """Run a check so that it always ends, with NotMet if anything is wrong."""

    async def run(trial: Trial) -> None:
        try:
            async with asyncio.timeout(_CHECK_LIMIT * speed.speed()):
                await check.run(trial)
        except NotMet:
            raise
        except TimeoutError:
            happened = f"it did not end within {_CHECK_LIMIT:g} s"
            raise NotMet("the check to end", happened, "what waits for ever?") from None
        except Exception as error:
            happened = f"it failed with {type(error).__name__}: {error}"
            look = "does the program send what its type allows? If so, show this to your lecturer"
            raise NotMet("the check to end", happened, look) from error

    return run


def _starter(server: Any) -> Starter:
    if sys.platform == "win32":
        return SpawnStarter()
    else:
        from taskrpc.labs.sandbox.program import ForkStarter

        return ForkStarter(server)


def _identity(request: Request, record: tuple[int, str] | None) -> tuple[int, str]:
    """Return the number of the lab and the ID of the variant."""
    number = request.lab if request.lab is not None else record[0] if record else None
    if number is None:
        raise TaskRpcError(
            f"expected a lab in this folder, but it has no {RECORD}: change to the folder in which"
            " you ran `taskrpc lab start`, or name the lab, such as `taskrpc lab check 1`"
        )
    if record and record[0] != number:
        raise TaskRpcError(
            f"expected lab {number}, but this folder contains lab {record[0]}: change to the"
            f" folder of lab {number}, or run `taskrpc lab check` without a number"
        )
    if request.variant is not None:
        return number, request.variant
    return number, record[1][:_LONGEST_ID] if record else ""


def _digest(lab: Lab, variant: Variant, root: Path) -> str:
    """Return the same text for submissions with the same files, "" for the starter files."""
    found = hashlib.sha256()
    changed = False
    texts = starter_files(lab, variant)
    for name in sorted(texts):
        path = root / name
        data = path.read_bytes() if path.is_file() else b""
        changed = changed or b"\n".join(data.splitlines()) != b"\n".join(
            texts[name].encode().splitlines()
        )
        found.update(b"%d " % len(data) + data)
    return found.hexdigest() if changed else ""


def _speed_for(lab: Lab, root: Path) -> float:
    """Return the lab's speed; real time for programs that read clocks of `datetime`."""
    for path in root.rglob("*.py"):
        if path.is_file() and b"datetime" in path.read_bytes():
            return 1.0
    return lab.speed


def _end_without_reader() -> None:
    if not os.read(0, 1):
        os._exit(1)  # the fork server sees it, kills the programs and removes the folder


def _short_folder() -> str | None:
    """Return the folder for temporary files: paths of Unix sockets have at most 107 bytes."""
    return "/tmp" if linux.can_confine() and len(tempfile.gettempdir()) > _LONGEST_FOLDER else None
