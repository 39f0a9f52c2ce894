"""`taskrpc classroom bundle`: makes the folder for students, or checks it."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from taskrpc.cli.shared.command import Exit, UsageError
from taskrpc.course.classroom.bundle import check_bundle, make_bundle
from taskrpc.course.classroom.bundle_pages import START
from taskrpc.course.classroom.wheels import PYTHONS, SYSTEMS, Wanted


def make_or_check(options: argparse.Namespace) -> Exit:
    """Make the bundle, or check it with `--check`. Raises TaskRpcError."""
    folder = Path(options.folder)
    if options.check:
        if options.python or options.system or options.jupyter:
            problem = "--check checks all that is in the folder: use it without other options"
            raise UsageError(f"taskrpc classroom bundle: error: {problem}")
        count = check_bundle(folder, lambda step: _say(f"checking {step} ..."))
        print(f"{folder} is complete: {count} combinations of system and Python can install it")
        return Exit.DONE
    wanted = Wanted(
        options.system or [*SYSTEMS], options.python or PYTHONS, jupyter=options.jupyter
    )
    try:
        missing = make_bundle(folder, wanted, lambda step: _say(f"getting {step} ..."))
    except KeyboardInterrupt:
        _say(f"{folder} is not complete; the same command continues, and keeps what is there")
        raise
    for part in missing:
        _say(f"left out: {part}")
    megabytes = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file()) / 1e6
    how = f"students begin with {folder / START}"
    print(f"{folder} is ready ({megabytes:.0f} MB); {how}")
    return Exit.DONE


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
