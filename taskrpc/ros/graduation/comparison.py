"""Runs a program with taskrpc and with this computer's real ROS 2, and compares the outputs."""

from __future__ import annotations

import difflib
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

_TASKRPC = Path(__file__).resolve().parents[2]
_STAMP = re.compile(r"\[\d+\.\d{9}\]")
_PRINT_PATH = "import rclpy; print(rclpy.__file__)"
_GRACE = 5.0
"""Seconds that a program has to end after Ctrl-C."""


class Outcome(NamedTuple):
    """The output and the end of a program."""

    out: str
    err: str
    """In both texts `[T]` replaces the log's time stamps."""
    code: int | None
    """None if the program did not end by itself."""


def real_python() -> str:
    """The path of a Python that imports a real rclpy, or "" if this computer has none."""
    for python in dict.fromkeys((sys.executable, shutil.which("python3") or "")):
        if not python:
            continue
        command = [python, "-c", _PRINT_PATH]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        path = done.stdout.strip()
        if done.returncode == 0 and path and not Path(path).resolve().is_relative_to(_TASKRPC):
            return python
    return ""


def differences(python: str, path: Path, arguments: Sequence[str], seconds: float) -> Iterator[str]:
    """Run a program with taskrpc, then with ROS 2, and yield the lines of a diff; none if equal.

    Args:
        python: the Python that imports the real rclpy, from `real_python`.
        path: the program.
        arguments: the program's own arguments.
        seconds: the time after which a program that still runs gets Ctrl-C.
    """
    ours = _run([sys.executable, "-m", "taskrpc", "run", str(path), *arguments], seconds)
    real = _run([python, str(path), *arguments], seconds)
    for stream, here, there in (("stdout", ours.out, real.out), ("stderr", ours.err, real.err)):
        yield from difflib.unified_diff(
            here.splitlines(),
            there.splitlines(),
            f"taskrpc {stream}",
            f"ROS 2 {stream}",
            "",
            "",
            1,
            "",
        )
    if ours.code != real.code:
        yield f"taskrpc: {_end(ours.code)}; ROS 2: {_end(real.code)}"


def _run(command: Sequence[str], seconds: float) -> Outcome:
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, errors="replace"
    )
    ended = True
    try:
        out, err = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        ended = False
        out, err = _interrupted(process)
    out, err = (_STAMP.sub("[T]", text) for text in (out, err))
    return Outcome(out, err, process.returncode if ended else None)


def _interrupted(process: subprocess.Popen[str]) -> tuple[str, str]:
    if sys.platform == "win32":
        process.terminate()
    else:
        process.send_signal(signal.SIGINT)
    try:
        return process.communicate(timeout=_GRACE)
    except subprocess.TimeoutExpired:
        process.kill()
        return process.communicate()


def _end(code: int | None) -> str:
    return "did not end" if code is None else f"exit code {code}"
