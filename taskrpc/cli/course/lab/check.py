"""`taskrpc lab check`: checks the lab in a folder, or those of all students."""

from __future__ import annotations

import asyncio
import os
import sys
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from pathlib import Path

from taskrpc.cli.shared.command import Exit, UsageError

TYPE_CHECKING = False  # typing itself is heavy
if TYPE_CHECKING:
    from collections.abc import Callable

    from taskrpc.course.labs.progress import Progress
    from taskrpc.course.labs.report import Graded, Result
    from taskrpc.course.labs.sandbox.worker import Request


def variant_id(text: str) -> str:
    """Return the value of --variant. Raises ArgumentTypeError if it is no text."""
    try:
        text.encode()
    except UnicodeEncodeError:
        raise ArgumentTypeError(f"expected text in UTF-8, got {text!r}") from None
    return text


def here() -> Path:
    """Return the current folder. Raises UsageError if it was removed."""
    try:
        return Path.cwd()
    except FileNotFoundError:
        problem = "the folder of this terminal does not exist any more: change to another one"
        raise UsageError(problem) from None


def configure(parser: ArgumentParser) -> None:
    """Give the parser of `taskrpc lab check` its arguments."""
    what = "The lab, 1 to 6 (default: the lab that was started in this folder)"
    parser.add_argument("number", type=int, metavar="N", nargs="?", help=what)
    what = "Check for this student or group (default: as in `taskrpc lab start`)"
    parser.add_argument("--variant", metavar="ID", type=variant_id, help=what)
    what = "A folder with further checks of the lecturer: labN/hidden.py"
    parser.add_argument("--hidden", metavar="FOLDER", help=what)
    what = "Check all submissions in this folder: one folder or .zip file for each student"
    parser.add_argument("--all", metavar="FOLDER", help=what)
    what = "With --all: write a table to this file (default: to standard output)"
    parser.add_argument("--csv", metavar="FILE", nargs="?", const="-", help=what)
    what = "With --all: how many to check at the same time (default: two for each processor)"
    parser.add_argument("--jobs", type=int, metavar="N", help=what)
    what = "With --all: check without a sandbox, with all rights of your account"
    parser.add_argument("--trusted", action="store_true", help=what)
    what = "Print the results.json of Gradescope"
    parser.add_argument("--json", action="store_true", help=what)
    parser.set_defaults(run=run)


def run(options: Namespace) -> Exit:
    """Check. Raises TaskRpcError."""
    from srvgen.cli import process

    _check_options(options)
    process.start_work()
    if options.all is None:
        return asyncio.run(_check_one(options))
    return _check_all(options)


def _check_options(options: Namespace) -> None:
    from taskrpc.course.labs import catalogue
    from taskrpc.course.labs.hidden import hidden_checks

    if options.number is not None:
        catalogue.lab(options.number).check_installed()
    if options.all is None and (options.csv is not None or options.jobs is not None):
        option = "--csv" if options.csv is not None else "--jobs"
        raise UsageError(f"{option} needs --all FOLDER, the folder with all submissions")
    if options.all is None and options.trusted:
        raise UsageError("--trusted needs --all FOLDER: your own work needs no sandbox")
    if options.all is not None and options.json:
        raise UsageError("--json is for one submission; use --csv with --all")
    if options.all is not None and options.variant is not None:
        raise UsageError("--variant is for one submission; with --all each has its own")
    if options.jobs is not None and options.jobs < 1:
        raise UsageError(f"--jobs: expected a number of at least 1, got {options.jobs}")
    if options.hidden is not None:
        # A mistake in the lecturer's files is not each student's.
        folder = Path(options.hidden).resolve()
        found = [hidden_checks(folder, lab) for lab in catalogue.LABS]
        if not any(found):
            raise UsageError(f"--hidden: expected a folder with lab1/hidden.py, got {folder}")


def _has_sandbox(options: Namespace) -> bool:
    """Return whether programs run in a sandbox; say so if one runs beside hidden checks without.

    Raises TaskRpcError if those of other people would run without.
    """
    from taskrpc.course.labs.sandbox import bubblewrap
    from taskrpc.errors import TaskRpcError

    reason = bubblewrap.why_not()
    if reason and options.all is not None and not options.trusted:
        raise TaskRpcError(
            "--all: expected a sandbox for the programs of other people, but"
            f" {reason}. Install the Debian package bubblewrap, or grade in a container:"
            " see docs/how-to/grade-labs.md. --trusted goes on without: then the programs can read"
            " and change all that you can"
        )
    if reason and options.all is None and options.hidden is not None:
        print(
            f"--hidden: this submission runs without a sandbox, because {reason}: it can read"
            f" {Path(options.hidden).resolve()} and all that you can. If it is not your own work,"
            " install the Debian package bubblewrap",
            file=sys.stderr,
        )
    return reason == ""


def _request(options: Namespace, source: Path, *, confined: bool) -> Request:
    from taskrpc.course.labs.sandbox.worker import Request

    hidden = None if options.hidden is None else str(Path(options.hidden).resolve())
    return Request(
        str(source.resolve()), options.number, options.variant, hidden, confined=confined
    )


async def _check_one(options: Namespace) -> Exit:
    import json

    from taskrpc.course.labs import grader, report
    from taskrpc.errors import TaskRpcError

    def show(result: Result) -> None:
        if not options.json:
            print("\n".join(report.lines_of(result, colours=_has_colours())), flush=True)

    folder = here()
    request = _request(options, folder, confined=_has_sandbox(options))
    graded = await grader.grade(request, folder.name, show)
    if options.json:
        print(json.dumps(report.gradescope(graded), indent=2))
        return Exit.DONE  # Gradescope takes another exit code for a failure of the grader
    if graded.stopped and graded.about is None:
        raise TaskRpcError(report.plain(graded.stopped))
    print()
    print("\n".join(report.summary(graded)))
    return Exit.DONE if graded.passed else Exit.ERROR


def _check_all(options: Namespace) -> Exit:
    from taskrpc.course.labs import report
    from taskrpc.course.labs.grader import submissions

    sources = submissions(Path(options.all))
    confined = _has_sandbox(options)
    progress = _progress(options, sources)
    left = [source for source in sources if progress is None or not progress.has(source.name)]
    results = [] if progress is None else progress.all()
    if results:
        done = f"{len(results)} of {len(sources)} submissions are done and have not changed"
        again = f"to check them again, remove {report.plain(options.csv)}"
        print(f"{done}; {again}", file=sys.stderr)

    def ready(source: Path, one: Graded) -> None:
        results.append(one)
        if progress is not None:
            progress.add(source.name, one)
        count = f"{len(results)}/{len(sources)}"
        # Progress is not part of a table on standard output.
        stream = sys.stdout if options.csv is None else sys.stderr
        print(f"{count}  {_line_of(one)}", file=stream, flush=True)

    code = Exit.DONE
    try:
        asyncio.run(_grade(options, left, ready, confined=confined))
    except KeyboardInterrupt:
        code = Exit.INTERRUPTED
        goes_on = "--csv FILE would keep them"
        if options.csv is not None:
            goes_on = "they are in the table"
        if progress is not None:
            goes_on = "the same command goes on with the others"
        count = f"{len(results)} of {len(sources)}"
        print(f"interrupted: {count} submissions are done; {goes_on}", file=sys.stderr)
    results.sort(key=lambda one: one.student)
    if options.csv == "-":
        print(report.as_csv(results), end="")
    if progress is not None:
        progress.write()
    for one, remark in zip(results, report.remarks(results), strict=True):
        if options.csv is None and remark and remark != one.stopped:
            print(f"{report.plain(one.student)}: {report.plain(remark)}")
    return code


def _progress(options: Namespace, sources: list[Path]) -> Progress | None:
    """Return the results of earlier, interrupted runs; None without a file for the table."""
    from taskrpc.course.labs.progress import Progress, checksum

    if options.csv in (None, "-"):
        return None
    hidden = "" if options.hidden is None else checksum(Path(options.hidden))
    return Progress(
        Path(options.csv),
        {source.name: checksum(source, options.number, hidden) for source in sources},
    )


async def _grade(
    options: Namespace,
    sources: list[Path],
    ready: Callable[[Path, Graded], None],
    *,
    confined: bool,
) -> None:
    """Grade submissions; `ready` gets each result when it is there."""
    from taskrpc.course.labs.grader import grade_all

    jobs = options.jobs or 2 * (os.cpu_count() or 1)  # most of their time is waiting

    def request(source: Path) -> Request:
        return _request(options, source, confined=confined)

    async for source, one in grade_all(sources, request, jobs):
        ready(source, one)


def _line_of(one: Graded) -> str:
    from taskrpc.course.labs import report

    points = f"{report.number(one.points)} of {report.number(one.most)}"
    stopped = f"  {report.plain(one.stopped)}" if one.stopped else ""
    return f"{report.plain(one.student)}: {points}{stopped}"


def _has_colours() -> bool:
    return sys.stdout.isatty() and "NO_COLOR" not in os.environ
