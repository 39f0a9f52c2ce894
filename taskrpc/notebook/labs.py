"""A lab in a notebook: its folder, the cells that are its files, and its checks."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import srvgen
from taskrpc.errors import TaskRpcError
from taskrpc.labs import catalogue
from taskrpc.labs.lab import Lab
from taskrpc.labs.starter import read_record, write_starter
from taskrpc.labs.variants import Variant
from taskrpc.ros import hook

_DEFINITIONS = (".srv", ".msg", ".action")
_END = 5.0
"""Seconds that the checks have to end after an interrupt."""

Run = Callable[[str, Path], object]
"""Runs the text of a file in the notebook's namespace."""


class NotebookLab:
    """A lab whose files are cells of a notebook; the folder is `labN` beside the notebook.

    Args:
        number: the number of the lab.
        place: the folder of the notebook.
        run: runs a Python file.
    """

    def __init__(self, number: int, place: Path, run: Run) -> None:
        self.lab: Lab = catalogue.lab(number)
        self.folder = place / f"lab{number}"
        self._run = run

    def begin(self) -> None:
        """Write the starter files, unless the lab was begun before; let cells import from it."""
        self.folder.mkdir(exist_ok=True)
        if read_record(self.folder) is None:
            write_starter(self.lab, Variant(), self.folder)
        if (folder := str(self.folder)) not in sys.path:
            sys.path.insert(0, folder)
        if not hook.real_rclpy():
            hook.install(self.folder)

    def write(self, name: str, text: str) -> None:
        """Write a file of the lab; a Python file also runs, and a definition is checked."""
        path = (self.folder / name).resolve()
        if not name or not path.is_relative_to(self.folder.resolve()):
            raise TaskRpcError(
                f"%%lab: expected a file of the lab, such as {self.lab.files[0]}, got {name!r}"
            )
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8", newline="\n")
        if path.suffix == ".py":
            self._run(text, path)
        elif path.suffix in _DEFINITIONS:
            _forget(path.parent.parent.name)
            package, kind, type_name = *path.parent.parts[-2:], path.stem
            srvgen.load(f"{package}/{kind}/{type_name}")

    def check(self) -> None:
        """Run the checks, and print what they say as soon as they say it."""
        command = [sys.executable, "-m", "taskrpc", "lab", "check", str(self.lab.number)]
        # A group of its own: the kernel's interrupt also goes to the kernel's group.
        checks = subprocess.Popen(
            command,
            cwd=self.folder,
            env={**os.environ, "PYTHONIOENCODING": "utf-8", "NO_COLOR": "1"},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,
        )
        assert checks.stdout is not None
        try:
            with checks.stdout:
                for line in checks.stdout:
                    print(line, end="", flush=True)
            checks.wait()
        finally:
            _end(checks)


def _end(process: subprocess.Popen[str]) -> None:
    """End a process as Ctrl-C does, or at once if it does not react."""
    if process.poll() is None:
        if sys.platform != "win32":
            process.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(_END)
        process.kill()
        process.wait()


def _forget(package: str) -> None:
    """Let the next import of a package read its definitions again."""
    for name in list(sys.modules):
        if name == package or name.startswith(f"{package}."):
            del sys.modules[name]
