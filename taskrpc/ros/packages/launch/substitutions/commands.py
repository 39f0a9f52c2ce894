"""Substitutions that run something: a command, a Python expression, or a look at the disk."""

from __future__ import annotations

import importlib.util
import json
import shutil
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from taskrpc.ros import hook
from taskrpc.ros.command_line import split_words, startable

from ..launch_context import LaunchContext
from ..logging import get_logger
from ..some_substitutions_type import SomeSubstitutionsType
from ..substitution import (
    Substitution,
    SubstitutionFailure,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from .texts import describe_all

_FROM_PIP = {"xacro": "; install it: pip install xacro"}
"""The next step for commands of ROS that Python's package index has."""


# The xacro of Python's package index finds no packages of ROS: `$(find PACKAGE)` would fail.
_XACRO = (
    "import json, sys; from taskrpc.ros import hook; hook.install(*json.loads(sys.argv.pop(1)));"
    " from xacro import main; sys.exit(main())"
)


def _xacro(words: list[str]) -> list[str]:
    """The command that runs xacro with the packages of this workspace; [] for other commands."""
    if words[:1] != ["xacro"] or importlib.util.find_spec("xacro") is None:
        return []
    folders = json.dumps([str(folder) for folder in hook.starts()])
    return [sys.executable, "-P", "-c", _XACRO, folders, *words[1:]]


class PythonExpression(Substitution):
    """The value of a Python expression, as a text.

    The names of the given modules are known by their own names (`math.pi`), those of `math` also
    without it (`pi`).
    """

    def __init__(
        self, expression: SomeSubstitutionsType, python_modules: Iterable[Any] = ("math",)
    ) -> None:
        self._expression = normalize_to_list_of_substitutions(expression)
        self._modules = [normalize_to_list_of_substitutions(each) for each in python_modules]

    @property
    def expression(self) -> list[Substitution]:
        """The expression."""
        return self._expression

    def describe(self) -> str:
        """Describe the substitution."""
        return f"PythonExpr({describe_all(self._expression)})"

    def perform(self, context: LaunchContext) -> str:
        """Evaluate the expression; raises SubstitutionFailure if Python cannot."""
        known: dict[str, Any] = {}
        for each in self._modules:
            name = perform_substitutions(context, each)
            module = importlib.import_module(name)
            known[name] = module
            if name == "math":
                known.update(vars(module))
        text = perform_substitutions(context, self._expression)
        try:
            return str(eval(text, {}, known))
        except Exception as error:
            raise SubstitutionFailure(
                f"cannot evaluate the Python expression {text!r}: {type(error).__name__}: {error}"
            ) from error


class Command(Substitution):
    """What a command prints.

    Args:
        command: the command line, which is split as a shell does.
        on_stderr: what happens if the command prints to standard error: `fail`, `ignore`, `warn`,
            or `capture`, which adds it to the text.
    """

    def __init__(
        self, command: SomeSubstitutionsType, *, on_stderr: SomeSubstitutionsType = "fail"
    ) -> None:
        self._command = normalize_to_list_of_substitutions(command)
        self._on_stderr = normalize_to_list_of_substitutions(on_stderr)

    @property
    def command(self) -> list[Substitution]:
        """The command line."""
        return self._command

    def describe(self) -> str:
        """Describe the substitution."""
        return f"Command({describe_all(self._command)})"

    def perform(self, context: LaunchContext) -> str:
        """Run the command; raises SubstitutionFailure if it fails."""
        line = perform_substitutions(context, self._command)
        on_stderr = perform_substitutions(context, self._on_stderr)
        words = split_words(line)
        join = subprocess.STDOUT if on_stderr == "capture" else subprocess.PIPE
        try:
            command = _xacro(words) or startable(words, None)
            done = subprocess.run(
                command, stdout=subprocess.PIPE, stderr=join, text=True, check=False
            )
        except (OSError, IndexError):
            name = words[0] if words else line
            step = _FROM_PIP.get(name, "")
            raise SubstitutionFailure(f"file not found: [Errno 2] '{name}'{step}") from None
        if done.returncode != 0:
            problem = f"executed command failed. Command: {line}"
            if done.stderr:
                problem += f"\nCaptured stderr output: {done.stderr.rstrip()}"
            raise SubstitutionFailure(problem)
        if done.stderr:
            problem = (
                "executed command showed stderr output. Command:"
                f" {line}\nCaptured stderr output:\n{done.stderr}"
            )
            if on_stderr == "fail":
                raise SubstitutionFailure(problem)
            if on_stderr == "warn":
                get_logger("launch").warning(problem)
        return done.stdout


class FindExecutable(Substitution):
    """The path of a command that the shell would find."""

    def __init__(self, *, name: SomeSubstitutionsType) -> None:
        self._name = normalize_to_list_of_substitutions(name)

    @property
    def name(self) -> list[Substitution]:
        """The name of the command."""
        return self._name

    def describe(self) -> str:
        """Describe the substitution."""
        return f"FindExec({describe_all(self._name)})"

    def perform(self, context: LaunchContext) -> str:
        """Find the command; raises SubstitutionFailure if there is none."""
        name = perform_substitutions(context, self._name)
        found = shutil.which(name, path=context.environment.get("PATH"))
        if found is None:
            step = _FROM_PIP.get(name, "")
            raise SubstitutionFailure(f"executable '{name}' not found on the PATH{step}")
        return found


class FileContent(Substitution):
    """The text of a file."""

    def __init__(self, path: SomeSubstitutionsType) -> None:
        self._path = normalize_to_list_of_substitutions(path)

    def describe(self) -> str:
        """Describe the substitution."""
        return f"FileContent({describe_all(self._path)})"

    def perform(self, context: LaunchContext) -> str:
        """Read the file; raises SubstitutionFailure if it cannot be read."""
        path = perform_substitutions(context, self._path)
        try:
            return Path(path).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise SubstitutionFailure(f"Failed to open file {path}: {error}") from None
