"""Runs a program here and with the real ROS 2 of this computer, and compares what they print."""

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

_OURS = Path(__file__).resolve().parents[1]
_STAMP = re.compile(r"\[\d+\.\d{9}\]")
_ASK = "import rclpy; print(rclpy.__file__)"
_GRACE = 5.0
"""Seconds for a program to end after Ctrl-C."""


class Outcome(NamedTuple):
    """What a program did."""

    out: str
    err: str
    """Both with `[T]` for each time stamp of the log."""
    code: int | None
    """None where it did not end by itself."""


def real_python() -> str:
    """The Python that imports a real rclpy, "" where none on this computer does."""
    for python in dict.fromkeys((sys.executable, shutil.which("python3") or "")):
        if not python:
            continue
        command = [python, "-c", _ASK]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        place = done.stdout.strip()
        if done.returncode == 0 and place and not Path(place).resolve().is_relative_to(_OURS):
            return python
    return ""


def differences(python: str, path: Path, arguments: Sequence[str], seconds: float) -> Iterator[str]:
    """Run it with both, one after the other; lines that tell where they differ, none if nowhere.

    Args:
        python: what `real_python` found.
        path: the program.
        arguments: its own.
        seconds: after so many, one that has not ended by itself gets Ctrl-C.
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
