"""Grades submissions, each in a process of its own that cannot stop or fool this one."""

from __future__ import annotations

import asyncio
import contextlib
import os
import tempfile
import time
from collections.abc import AsyncIterator, Callable, Sequence
from pathlib import Path

import msgspec

from taskrpc.course.labs import catalogue
from taskrpc.course.labs.hidden import hidden_checks
from taskrpc.course.labs.report import About, Graded, Line, Result, Slower, Stopped
from taskrpc.course.labs.sandbox import boot
from taskrpc.course.labs.sandbox.child import system_environment
from taskrpc.course.labs.sandbox.pace import slowness, stretch
from taskrpc.course.labs.sandbox.worker import Request
from taskrpc.course.labs.submission import remove
from taskrpc.errors import TaskRpcError
from taskrpc.ros.process_tree import ProcessTree

LIMIT = 90.0
"""Seconds of one submission: a lab takes at most 5 on a quiet machine, and longer on a busy one."""
_KEPT = 2000
"""Last bytes of standard error that are kept, to explain a crash."""

OnResult = Callable[[Result], None]


async def grade(request: Request, student: str, on_result: OnResult = lambda _: None) -> Graded:
    """Grade one submission; an error of `on_result` ends the checks at once.

    Raises TaskRpcError if `request` itself is wrong, and what `on_result` raises.
    """
    began = time.monotonic()
    lines: list[Line] = []
    rest = b""
    errors = b""
    failures: list[Exception] = []

    def written(stream: int, data: bytes) -> None:
        nonlocal rest, errors
        if stream == 2:
            errors = (errors + data)[-_KEPT:]
            return
        *complete, rest = (rest + data).split(b"\n")
        for each in complete:
            line = msgspec.json.decode(each, type=Line)
            lines.append(line)
            if isinstance(line, Result) and not failures:
                try:
                    on_result(line)
                except Exception as error:  # nobody reads the output any more, for example
                    failures.append(error)
                    tree.kill()

    scratch = tempfile.mkdtemp(prefix="taskrpc-lab-")
    request = msgspec.structs.replace(request, scratch=scratch)
    command = boot.command("worker", msgspec.json.encode(request).decode())
    try:
        tree = await ProcessTree.start(command, written, env=system_environment())
    except BaseException:
        os.rmdir(scratch)
        raise
    stopped = ""
    try:
        code = await _end(tree, lines)
        if code is None:
            stopped = f"the checks did not end within {time.monotonic() - began:.0f} s"
        elif code != 0:
            last = errors.decode(errors="replace").strip().rpartition("\n")[2]
            stopped = f"the process of the checks ended with {code}: {last}"
    finally:
        # A cancelled command leaves nothing either: see `supervisor` for the programs.
        tree.kill()
        with contextlib.suppress(asyncio.CancelledError):
            await asyncio.shield(tree.wait())
        with contextlib.suppress(OSError):  # without a sandbox, the supervisor removes it too
            remove(Path(scratch))
    if failures:
        raise failures[0]
    stopped = next((each.reason for each in lines if isinstance(each, Stopped)), stopped)
    about = next((each for each in lines if isinstance(each, About)), None)
    results = tuple(each for each in lines if isinstance(each, Result))
    seconds = time.monotonic() - began
    return Graded(student, about, results, _most(request, about), stopped, seconds)


async def _end(tree: ProcessTree, lines: Sequence[Line]) -> int | None:
    """Wait for the end of the checks; the exit code, or None after the limit."""
    now = asyncio.get_running_loop().time
    began = now()
    slower = stretch(slowness(), 1)  # a busy machine needs long until there is the first line
    waiting = asyncio.ensure_future(tree.wait())
    try:
        while (left := began + _limit(lines, slower) - now()) > 0:  # the limit can grow meanwhile
            await asyncio.wait([waiting], timeout=left)
            if waiting.done():
                return waiting.result()
    finally:
        waiting.cancel()
    return None


def _limit(lines: Sequence[Line], slower: float = 1.0) -> float:
    """Return the seconds that a submission may take, after these lines of its checks."""
    factors = [each.factor for each in lines if isinstance(each, Slower)]
    return LIMIT * max([slower, *factors])


def _most(request: Request, about: About | None) -> float:
    """Return the points of all checks."""
    number = about.lab if about else request.lab
    if number is None:
        return 0.0
    lab = catalogue.lab(number)
    more = () if request.hidden is None else hidden_checks(Path(request.hidden), lab)
    return sum(each.points for each in (*lab.checks, *more))


def submissions(folder: Path) -> list[Path]:
    """Return the submissions in a folder: each folder and each ZIP file in it.

    Raises TaskRpcError if there are none.
    """
    try:
        found = sorted(each for each in folder.iterdir() if not each.name.startswith("."))
    except OSError as error:
        raise TaskRpcError(
            f"--all: expected a folder with the submissions, got {folder}: {error.strerror}"
        ) from None
    found = [
        each
        for each in found
        if not each.is_symlink()
        and (each.is_dir() or (each.is_file() and each.suffix.lower() == ".zip"))
    ]
    if not found:
        raise TaskRpcError(f"--all: expected a folder or .zip file for each student in {folder}")
    return found


async def grade_all(
    sources: Sequence[Path], request: Callable[[Path], Request], jobs: int
) -> AsyncIterator[tuple[Path, Graded]]:
    """Grade submissions, some at the same time; yields each one when it is ready."""
    free = asyncio.Semaphore(jobs)

    async def one(source: Path) -> tuple[Path, Graded]:
        async with free:
            name = source.stem if source.suffix.lower() == ".zip" else source.name
            try:
                return source, await grade(request(source), name)
            except OSError as error:
                reason = f"cannot be graded: {error.strerror or error}"
                return source, Graded(name, None, (), 0.0, reason, 0.0)

    tasks = [asyncio.ensure_future(one(source)) for source in sources]
    try:
        for task in asyncio.as_completed(tasks):
            yield await task
    finally:
        for each in tasks:
            each.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
