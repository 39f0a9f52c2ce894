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
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AbstractAsyncContextManager
from pathlib import Path

import msgspec

from taskrpc.course.labs import catalogue
from taskrpc.course.labs.grading import Finding, NewTrial, findings
from taskrpc.course.labs.hidden import hidden_checks, with_checks
from taskrpc.course.labs.lab import Check, Lab, NeedsCheck, NotMet
from taskrpc.course.labs.report import About, Line, Result, Slower, Stopped
from taskrpc.course.labs.sandbox import child_trial, speed
from taskrpc.course.labs.sandbox.limits import MEGABYTE, Limits, limit_this_process
from taskrpc.course.labs.sandbox.pace import Pace
from taskrpc.course.labs.similarity import structure
from taskrpc.course.labs.starter import RECORD, read_record, starter_files
from taskrpc.course.labs.submission import find_lab, find_root, remove, take
from taskrpc.course.labs.trial import Trial
from taskrpc.course.labs.variants import Variant
from taskrpc.errors import TaskRpcError
from taskrpc.ros.process_tree import end_children_with_this_process

if sys.platform != "win32":
    from taskrpc.course.labs.sandbox.box import Sandbox

_OWN = Limits(cpu=120, memory=2048 * MEGABYTE, file=100 * MEGABYTE, open_files=1024)
"""The limits of this process, in case a submission sends it far too much."""
_CHECK_LIMIT = 30.0
"""Real seconds of one check: far more than any needs, since each of its waits has a timeout."""
_LAB_LIMIT = 100.0
"""The same in the time of the lab, for time that passes slowly."""
_LONGEST = 1000
"""Most characters of a message."""
_LONGEST_ID = 200


class Request(msgspec.Struct, frozen=True):
    """What to grade.

    Attributes:
        source: the folder or ZIP file of the submission.
        lab: the number of the lab; None for that of the submission.
        variant: the ID of the variant; None for that of the submission.
        hidden: the folder with the lecturer's checks.
        speed: how much faster time passes; None for the lab's own.
        confined: whether to run its programs in a sandbox.
        scratch: a new folder for the files of the process; `grade` makes and removes it.
    """

    source: str
    lab: int | None = None
    variant: str | None = None
    hidden: str | None = None
    speed: float | None = None
    confined: bool = False
    scratch: str = ""


def main(text: str) -> int:
    """Grade the submission of a request."""
    request = msgspec.json.decode(text, type=Request)
    # Only `_report` writes to standard output; what a check prints goes to standard error.
    output = os.dup(1)
    os.dup2(2, 1)
    os.set_inheritable(output, False)
    if sys.platform == "win32":
        end_children_with_this_process()
    else:
        limit_this_process(_OWN)
    try:
        asyncio.run(_grade(request, output))
    except asyncio.CancelledError:
        with contextlib.suppress(OSError):
            remove(Path(request.scratch))
        return 1
    return 0


async def _grade(request: Request, output: int) -> None:
    def report(line: Line) -> None:
        os.write(output, msgspec.json.encode(line) + b"\n")

    base = Path(request.scratch)
    if sys.platform != "win32":
        # The process that asked has ended: nobody waits for the results.
        grading = asyncio.current_task()
        assert grading is not None
        asyncio.get_running_loop().add_reader(0, _end_without_reader, grading)
    try:
        await _graded(request, base, report)
    except TaskRpcError as error:
        inside = f"{base / 'taken'}{os.sep}"
        report(Stopped(str(error).replace(inside, "")[:_LONGEST]))


async def _graded(request: Request, base: Path, report: Callable[[Line], None]) -> None:
    taken = base / "taken"
    notes = take(Path(request.source), taken)
    part = find_lab(taken, request.lab)
    record = read_record(find_root(part, [RECORD]))
    number, id = _identity(request, record)
    lab, variant = catalogue.lab(number), Variant(id)
    lab.check_installed()
    root = find_root(part, [RECORD, *lab.files])
    digest = _digest(lab, variant, root)
    alike = _digest(lab, variant, root, structure)
    report(About(number, id, digest, tuple(notes), alike))
    shown = len(lab.checks)
    if request.hidden is not None:
        lab = with_checks(lab, hidden_checks(Path(request.hidden), lab))
    limited = [dataclasses.replace(each, run=_limited(each)) for each in lab.checks]
    lab = dataclasses.replace(lab, checks=tuple(limited))
    factor = _speed_for(lab, root) if request.speed is None else request.speed
    pace = Pace(factor, lab.speed)
    repetition = _Repetition(pace, report)
    async with _trials(root, variant, base, repetition, confined=request.confined) as new_trial:
        position = 0
        async for each in findings(lab, new_trial, repetition.again):
            pace.first_run()
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
                    repetition.remark(each),
                )
            )
            position += 1


class _Repetition:
    """Decides which failed checks run a second time: those whose result can depend on time."""

    def __init__(self, pace: Pace, report: Callable[[Line], None]) -> None:
        self.pace = pace
        self.trial: child_trial.ChildTrial | None = None
        """The latest trial; None if there was none, for example because of a busy machine."""
        self._report = report
        self._slower = 1.0
        self._tell()

    def again(self) -> bool:
        """After a check that did not pass: whether to run it once more, in slower time."""
        if self.trial is not None and not self.trial.depends_on_time:
            return False
        self.pace.second_run()
        self._tell()
        return True

    def remark(self, finding: Finding) -> str:
        """Return what the lecturer should know about a check that ran twice."""
        if finding.runs < 2:
            return ""
        if not finding.passed:
            return "failed twice"
        return "passed at the second run" + (": the machine was busy" * self.pace.is_busy)

    def _tell(self) -> None:
        if self.pace.slower > self._slower:
            self._slower = self.pace.slower
            self._report(Slower(self._slower))


@contextlib.asynccontextmanager
async def _trials(
    root: Path, variant: Variant, base: Path, repetition: _Repetition, *, confined: bool
) -> AsyncIterator[NewTrial]:
    """Return what makes the trial of each check."""
    if sys.platform == "win32":
        yield lambda: _trial(child_trial.spawned_trial(root, variant, base), repetition)
    else:
        async with Sandbox(root, base / "own", confined=confined) as sandbox:
            yield lambda: _trial(child_trial.sandboxed_trial(root, variant, sandbox), repetition)


@contextlib.asynccontextmanager
async def _trial(
    trial: AbstractAsyncContextManager[child_trial.ChildTrial], repetition: _Repetition
) -> AsyncIterator[Trial]:
    """Make a trial; raises NotMet if a program has destroyed what the trial needs."""
    repetition.trial = None
    try:
        async with trial as made:
            repetition.trial = made
            yield made
    except (OSError, TaskRpcError) as error:
        raise NotMet(
            "a program that leaves other programs and files alone",
            f"{type(error).__name__}: {error}",
            "which programs does it end, which files does it remove or change?",
        ) from error


def _limited(check: Check) -> Callable[[Trial], Awaitable[None]]:
    """Run a check so that it always ends, with NotMet if anything is wrong."""

    async def run(trial: Trial) -> None:
        limit = max(_CHECK_LIMIT * speed.speed(), _LAB_LIMIT)
        try:
            async with asyncio.timeout(limit):
                await check.run(trial)
        except (NotMet, NeedsCheck):
            raise
        except TimeoutError:
            happened = f"it did not end within {limit / speed.speed():.0f} s"
            raise NotMet("the check to end", happened, "what waits for ever?") from None
        except Exception as error:
            happened = f"it failed with {type(error).__name__}: {error}"
            look = "does the program send what its type allows? If so, show this to your lecturer"
            raise NotMet("the check to end", happened, look) from error

    return run


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


def _lines(data: bytes) -> bytes:
    """Return a file with the line ends of this system."""
    return b"\n".join(data.splitlines())


def _digest(lab: Lab, variant: Variant, root: Path, form: Callable[[bytes], bytes] = _lines) -> str:
    """Return the same text for submissions with the same files, "" for the starter files.

    Args:
        lab: the lab.
        variant: of the student.
        root: the folder of the submission.
        form: returns what is compared of a file.
    """
    found = hashlib.sha256()
    changed = False
    texts = starter_files(lab, variant)
    for name in sorted(texts):
        path = root / name
        data = form(path.read_bytes() if path.is_file() else b"")
        changed = changed or data != form(texts[name].encode())
        found.update(b"%d " % len(data) + data)
    return found.hexdigest() if changed else ""


def _speed_for(lab: Lab, root: Path) -> float:
    """Return the lab's speed; real time for programs that read clocks of `datetime`."""
    for path in root.rglob("*.py"):
        if path.is_file() and b"datetime" in path.read_bytes():
            return 1.0
    return lab.speed


def _end_without_reader(grading: asyncio.Task[None]) -> None:
    if not os.read(0, 1):
        asyncio.get_running_loop().remove_reader(0)
        grading.cancel()  # ends the sandbox first, so that no program writes any more
