"""A lab in a notebook: its folder, the cells that are its files, and its checks."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import srvgen
from taskrpc.course.labs import catalogue
from taskrpc.course.labs.lab import Lab
from taskrpc.course.labs.starter import read_record, write_starter
from taskrpc.course.labs.variants import Variant
from taskrpc.course.notebook.programs import Program, Programs
from taskrpc.errors import TaskRpcError
from taskrpc.ros import hook

_DEFINITIONS = (".srv", ".msg", ".action")
Run = Callable[[str, Path], object]
"""Runs the text of a file in the notebook's namespace."""


class NotebookLab:
    """A lab whose files are cells of a notebook; the folder is `labN` beside the notebook.

    Args:
        number: the number of the lab.
        folder: the folder of the notebook.
        run: runs a Python file.
    """

    def __init__(self, number: int, folder: Path, run: Run) -> None:
        self.lab: Lab = catalogue.lab(number)
        self.folder = folder / f"lab{number}"
        self._run = run
        self._programs = Programs()

    def begin(self) -> None:
        """Write the starter files, unless the lab was begun before; let cells import from it."""
        try:
            self.folder.mkdir(exist_ok=True)
        except OSError as error:
            problem = f"cannot make the folder {self.folder} of the lab: {error.strerror}"
            raise TaskRpcError(problem) from None
        if read_record(self.folder) is None:
            write_starter(self.lab, Variant(), self.folder)
        if (folder := str(self.folder)) not in sys.path:
            sys.path.insert(0, folder)
        if not hook.real_rclpy():
            hook.install(self.folder)

    def write(self, name: str, text: str) -> None:
        """Write a file of the lab; a Python file also runs, and a definition is checked."""
        folder = self.folder.resolve()
        path = folder if "\0" in name else (folder / name).resolve()
        if path == folder or not path.is_relative_to(folder):
            raise TaskRpcError(
                f"%%lab: expected a file of the lab, such as {self.lab.files[0]}, got {name!r}"
            )
        if path.suffix in _DEFINITIONS and len(path.relative_to(folder).parts) < 3:
            kind = path.suffix[1:]
            raise TaskRpcError(
                f"%%lab: expected a definition in PACKAGE/{kind}/{path.name}, got {name!r}"
            )
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8", newline="\n")
        except OSError as error:
            raise TaskRpcError(f"%%lab: cannot write {name}: {error.strerror}") from None
        if path.suffix == ".py":
            self._run(text, path)
        elif path.suffix in _DEFINITIONS:
            _forget(path.parent.parent.name)
            package, kind, type_name = *path.parent.parts[-2:], path.stem
            srvgen.load(f"{package}/{kind}/{type_name}")

    def check(self) -> None:
        """Run the checks, and print what they say as soon as they say it."""
        if not self.folder.is_dir():
            raise TaskRpcError(
                f"{self.folder} is gone: run the first cell again, which calls"
                f" notebook.lab({self.lab.number})"
            )
        Program(["lab", "check", str(self.lab.number)], self.folder).show_output()

    def run(self, file: str, arguments: Sequence[str]) -> None:
        """Run a file as a program of its own, and print its output until it ends."""
        Program(["run", self._known(file), *arguments], self.folder).show_output()

    def start(self, file: str, arguments: Sequence[str]) -> None:
        """Start a file as a program of its own, and print its output from now on."""
        self._programs.start(self._known(file), arguments, self.folder)

    def stop(self, file: str) -> None:
        """End the program of a file, if it runs."""
        self._programs.stop(self._known(file))

    def _known(self, file: str) -> str:
        if not (self.folder / file).is_file():
            names = " and ".join(sorted(path.name for path in self.folder.glob("*.py")))
            raise TaskRpcError(f"there is no file {file} in {self.folder}; expected one of {names}")
        return file


def _forget(package: str) -> None:
    """Let the next import of a package read its definitions again."""
    for name in list(sys.modules):
        if name == package or name.startswith(f"{package}."):
            del sys.modules[name]
