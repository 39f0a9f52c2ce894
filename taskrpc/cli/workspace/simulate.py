"""`taskrpc simulate`: runs a robot system many times in virtual time, until it breaks."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace

TYPE_CHECKING = False
if TYPE_CHECKING:
    from pathlib import Path

    from taskrpc.simulation.run.coverage import Coverage
    from taskrpc.simulation.search.search import Finding

_RUNS = 1000

_EPILOG = """\
FILE defines the programs, the faults and what must always be true, with the name `scenario`.
The exit code is 0 if no run failed, 1 if one did, 2 for a mistake of yours."""


def configure(parser: ArgumentParser) -> None:
    """Give the parser of `taskrpc simulate` its arguments."""
    from taskrpc.cli.shared.parsing import number, whole

    parser.epilog = _EPILOG
    add = parser.add_argument
    add("file", metavar="FILE", help="The scenario, such as warehouse.sim.py")
    amount = parser.add_mutually_exclusive_group()
    what = f"How many runs (default: {_RUNS})"
    amount.add_argument("--runs", metavar="N", type=whole(1), help=what)
    what = "Run for so many real seconds"
    seconds = number("above 0", lambda value: value > 0)
    amount.add_argument("--seconds", metavar="S", type=seconds, help=what)
    what = "The first seed; the same seed gives the same run (default: 0)"
    add("--seed", metavar="N", type=int, default=0, help=what)
    what = "How many processes simulate (default: as many as there are cores)"
    add("--jobs", metavar="N", type=whole(1), help=what)
    add("--json", action="store_true", help="Print one JSON object instead of text")
    what = "Record the failing run; `taskrpc view FILE` plays it"
    add("--record", metavar="FILE.mcap", help=what)
    add("--verbose", action="store_true", help="Show all events of a failing run")
    parser.set_defaults(run=_run)


def _run(options: Namespace) -> int:
    from pathlib import Path

    from taskrpc.cli.shared.command import UsageError
    from taskrpc.errors import TaskRpcError

    _check_installed()
    from taskrpc.simulation.search.search import search

    file = Path(options.file)
    if not file.is_file():
        raise UsageError(f"cannot read {options.file}: no such file")
    record = None if options.record is None else Path(options.record)
    if record is not None:
        _check_record(record)
    runs = options.runs or (None if options.seconds else _RUNS)
    try:
        found = search(
            file,
            runs=runs,
            seconds=options.seconds,
            seed=options.seed,
            jobs=options.jobs,
            records=record is not None,
            progress=_progress(runs, options.seconds),
        )
    except TaskRpcError as error:
        raise UsageError(str(error)) from None
    if options.json:
        _print_json(found)
    else:
        _print_text(found, file, verbose=options.verbose)
    if record is not None:
        _record(record, found)
    return 0 if found.failure is None else 1


def _check_installed() -> None:
    import importlib.util

    from taskrpc.cli.shared.command import UsageError
    from taskrpc.spi import install_command

    for module in "greenlet", "hypothesis":
        if importlib.util.find_spec(module) is None:
            raise UsageError(
                f"taskrpc simulate needs {module}, which is not installed;"
                f" {install_command('simulate', module)}"
            )


def _progress(runs: int | None, seconds: float | None):  # type: ignore[no-untyped-def]
    """Return a function that shows how far the search is."""
    import sys

    def show(coverage: Coverage, shapes: int, taken: float) -> None:
        if not sys.stderr.isatty():
            return
        done = coverage.runs / runs if runs else taken / (seconds or 1.0)
        bar = "█" * int(20 * min(1.0, done))
        rate = coverage.runs / taken if taken else 0.0
        text = f"{bar:░<20} {coverage.runs} runs, {rate:.0f} a second, {shapes} different courses"
        end = "\n" if done >= 1 else ""
        print(f"\r{text}\x1b[K", end=end, file=sys.stderr, flush=True)

    return show


def _print_text(found: Finding, file: Path, *, verbose: bool) -> None:
    from taskrpc.simulation.search.story import lines_of, story, summary

    if found.failure is not None:
        print(story(found.failure, lines_of(found.failure, file.parent), everything=verbose))
        print(f"\nRepeat it: taskrpc simulate {file} --seed {found.failure.seed} --runs 1")
        print(f"Hash of the run: {found.failure.hash}\n")
    elif found.hash:
        print(f"Hash of the run: {found.hash}")
    print(summary(found.coverage, found.shapes, found.seconds))
    if found.failure is None:
        print("No run failed.")


def _check_record(path: Path) -> None:
    """Raise UsageError if the recording could not be written, before the search."""
    from taskrpc.cli.shared.command import UsageError
    from taskrpc.errors import TaskRpcError

    try:
        from taskrpc.simulation.search.recording import check_path

        check_path(path)
    except TaskRpcError as error:
        raise UsageError(str(error)) from None


def _record(path: Path, found: Finding) -> None:
    """Write the failing run, if there is one, and say so."""
    import shlex
    import sys

    if found.failure is None:
        print("Nothing was recorded: no run failed.", file=sys.stderr)
        return
    from taskrpc.simulation.search.recording import write

    write(path, found.failure)
    command = shlex.join(["taskrpc", "view", str(path)])
    print(f"Recorded. Watch it: {command}", file=sys.stderr)


def _print_json(found: Finding) -> None:
    import msgspec

    if found.failure is not None:  # the contents of the calls are for the recording
        failure = msgspec.structs.replace(found.failure, contents=None)
        found = msgspec.structs.replace(found, failure=failure)
    print(msgspec.json.encode(found).decode())
