"""The action that starts any program."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import PurePath
from typing import Any

from taskrpc.ros.command_line import split_words

from ..launch_context import LaunchContext
from ..some_substitutions_type import SomeSubstitutionsType
from ..substitution import Substitution, normalize_to_list_of_substitutions, perform
from .execute_local import ExecuteLocal, PreparedCommand, texts_of


class ExecuteProcess(ExecuteLocal):
    """Starts a program.

    Args:
        cmd: the program and its arguments.
        prefix: a command in front of it, such as `gdb -ex run --args`.
        name: the program's name in the output; by default that of its file.
        cwd: the working directory.
        env: the whole environment.
        additional_env: variables to add to the environment.
    """

    def __init__(
        self,
        *,
        cmd: Iterable[Any],
        prefix: SomeSubstitutionsType | None = None,
        name: SomeSubstitutionsType | None = None,
        cwd: SomeSubstitutionsType | None = None,
        env: Mapping[Any, Any] | None = None,
        additional_env: Mapping[Any, Any] | None = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(**kwargs)
        parts = [cmd] if isinstance(cmd, (str, Substitution)) else cmd
        self._cmd = [normalize_to_list_of_substitutions(each) for each in parts]
        self._prefix = prefix
        self._name = name
        self._cwd = cwd
        self._env = None if env is None else dict(env)
        self._additional_env = None if additional_env is None else dict(additional_env)

    @property
    def cmd(self) -> list[list[Substitution]]:
        """The program and its arguments."""
        return self._cmd

    @property
    def name(self) -> Any:
        """The program's name, before it is computed."""
        return self._name

    @property
    def cwd(self) -> Any:
        """The working directory, None for that of the launch."""
        return self._cwd

    @property
    def env(self) -> dict[Any, Any] | None:
        """The whole environment, None for that of the launch."""
        return self._env

    @property
    def additional_env(self) -> dict[Any, Any] | None:
        """The added variables."""
        return self._additional_env

    def prepare_command(self, context: LaunchContext) -> PreparedCommand | None:
        """The program with its arguments, working directory and environment."""
        words = texts_of(context, self._cmd)
        if not words:
            raise ValueError("cmd: expected a program and its arguments, got an empty list")
        if self._shell:
            first = next(iter(_split(words[0])), words[0])
        else:
            words = [each for each in words if each] or words
            first = words[0]
        return self.finished_command(context, PurePath(first).name, words, words)

    def finished_command(
        self, context: LaunchContext, file: str, words: list[str], shown: list[str]
    ) -> PreparedCommand:
        """Add prefix, name, working directory and environment to a command."""
        name = file if self._name is None else perform(context, self._name)
        prefix = self._prefix_for(context, file)
        command: list[str] | str = [*prefix, *words]
        if self._shell:
            command = " ".join([*prefix, *words])
        cwd = None if self._cwd is None else perform(context, self._cwd)
        return PreparedCommand(name, command, [*prefix, *shown], cwd, self.environment_for(context))

    def _prefix_for(self, context: LaunchContext, file: str) -> list[str]:
        known = context.launch_configurations
        if self._prefix is not None:
            given = perform(context, self._prefix)
        else:
            given = known.get("launch-prefix", "")
        wanted = known.get("launch-prefix-filter")
        if wanted is not None and not re.match(wanted, file):
            return []
        return _split(given)

    def environment_for(self, context: LaunchContext) -> dict[str, str] | None:
        """The program's environment; None for that of the launch."""
        if self._env is None and self._additional_env is None:
            return None
        found = dict(context.environment) if self._env is None else _texts(context, self._env)
        return {**found, **_texts(context, self._additional_env or {})}


def _texts(context: LaunchContext, values: Mapping[Any, Any]) -> dict[str, str]:
    return {
        perform(context, name): perform(context, _text(value)) for name, value in values.items()
    }


def _text(value: Any) -> Any:
    return str(value) if isinstance(value, (bool, int, float)) else value


def _split(text: str) -> list[str]:
    """Split a command line as a shell does."""
    try:
        return split_words(text)
    except ValueError:  # a quote that only the shell's rules close
        return text.split()
