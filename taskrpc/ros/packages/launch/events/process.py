"""Events of the programs that a launch starts, and matchers that choose among the programs."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import PurePath
from typing import Any

from taskrpc.ros.module_names import add_module_names

from ..event import Event


class ProcessEvent(Event):
    """Something that happened to a program."""

    name = "launch.events.process.ProcessEvent"

    def __init__(
        self,
        *,
        action: Any,
        name: str,
        cmd: Sequence[str],
        cwd: str | None,
        env: Mapping[str, str] | None,
        pid: int,
        **_: Any,
    ) -> None:
        self._action = action
        self._process_name = name
        self._cmd = list(cmd)
        self._cwd = cwd
        self._env = env
        self._pid = pid

    @property
    def action(self) -> Any:
        """The action that started the program."""
        return self._action

    @property
    def execute_process_action(self) -> Any:
        """As `action`."""
        return self._action

    @property
    def process_name(self) -> str:
        """The program's name, such as `talker-1`."""
        return self._process_name

    @property
    def cmd(self) -> list[str]:
        """The command and its arguments."""
        return self._cmd

    @property
    def cwd(self) -> str | None:
        """The working directory, None for that of the launch."""
        return self._cwd

    @property
    def env(self) -> Mapping[str, str] | None:
        """The environment, None for that of the launch."""
        return self._env

    @property
    def pid(self) -> int:
        """The process id."""
        return self._pid


class ProcessStarted(ProcessEvent):
    """A program has started."""

    name = "launch.events.process.ProcessStarted"


class ProcessExited(ProcessEvent):
    """A program has ended."""

    name = "launch.events.process.ProcessExited"

    def __init__(self, *, returncode: int, **details: Any) -> None:
        super().__init__(**details)
        self._returncode = returncode

    @property
    def returncode(self) -> int:
        """The exit code; a negative signal number if a signal ended the program."""
        return self._returncode


class ProcessIO(ProcessEvent):
    """A program has written something."""

    name = "launch.events.process.ProcessIO"

    def __init__(self, *, text: bytes, fd: int, **details: Any) -> None:
        super().__init__(**details)
        self._text = text
        self._fd = fd

    @property
    def text(self) -> bytes:
        """The bytes that the program has written."""
        return self._text

    @property
    def from_stdin(self) -> bool:
        """Whether the text is for standard input."""
        return self._fd == 0

    @property
    def from_stdout(self) -> bool:
        """Whether the text is from standard output."""
        return self._fd == 1

    @property
    def from_stderr(self) -> bool:
        """Whether the text is from standard error."""
        return self._fd == 2


class ProcessStdin(ProcessIO):
    """A text for a program's standard input."""

    name = "launch.events.process.ProcessStdin"

    def __init__(self, **details: Any) -> None:
        super().__init__(fd=0, **details)


class ProcessStdout(ProcessIO):
    """A program has written to standard output."""

    name = "launch.events.process.ProcessStdout"

    def __init__(self, **details: Any) -> None:
        super().__init__(fd=1, **details)


class ProcessStderr(ProcessIO):
    """A program has written to standard error."""

    name = "launch.events.process.ProcessStderr"

    def __init__(self, **details: Any) -> None:
        super().__init__(fd=2, **details)


class ProcessTargetedEvent(Event):
    """A request to the programs that a matcher chooses."""

    name = "launch.events.process.ProcessTargetedEvent"

    def __init__(self, *, process_matcher: Callable[[Any], bool]) -> None:
        self._process_matcher = process_matcher

    @property
    def process_matcher(self) -> Callable[[Any], bool]:
        """Returns whether the event is for the program of an action."""
        return self._process_matcher


class ShutdownProcess(ProcessTargetedEvent):
    """A request to end a program: it gets SIGINT, later SIGTERM, later SIGKILL."""

    name = "launch.events.process.ShutdownProcess"


class SignalProcess(ProcessTargetedEvent):
    """A request to send a program a signal."""

    name = "launch.events.process.SignalProcess"

    def __init__(
        self, *, signal_number: str | signal.Signals | int, process_matcher: Callable[[Any], bool]
    ) -> None:
        super().__init__(process_matcher=process_matcher)
        # Windows has no SIGKILL; its name still means: end the program at once.
        self._name = (
            signal_number if isinstance(signal_number, str) else signal.Signals(signal_number).name
        )
        if not hasattr(signal, self._name) and self._name != "SIGKILL":
            raise ValueError(f"'{signal_number}' is not a signal of {sys.platform}")

    @property
    def signal(self) -> int:
        """The signal's number."""
        return int(getattr(signal, self._name, signal.SIGTERM))

    @property
    def signal_name(self) -> str:
        """The signal's name."""
        return self._name


def matches_action(target_action: Any) -> Callable[[Any], bool]:
    """Choose the program of one action."""
    return lambda action: action is target_action


def matches_pid(pid: int) -> Callable[[Any], bool]:
    """Choose the program with a process id."""
    return lambda action: (action.process_details or {}).get("pid") == pid


def matches_name(name: str) -> Callable[[Any], bool]:
    """Choose the program with a name, such as `talker-1`."""
    return lambda action: (action.process_details or {}).get("name") == name


def matches_executable(executable: str) -> Callable[[Any], bool]:
    """Choose the programs whose command's file has a name."""

    def matches(action: Any) -> bool:
        command = (action.process_details or {}).get("cmd") or [""]
        return PurePath(command[0]).name == executable

    return matches


__all__ = [
    "ProcessExited",
    "ProcessIO",
    "ProcessStarted",
    "ProcessStderr",
    "ProcessStdin",
    "ProcessStdout",
    "ProcessTargetedEvent",
    "ShutdownProcess",
    "SignalProcess",
    "matches_action",
    "matches_executable",
    "matches_name",
    "matches_pid",
]

add_module_names(__name__)
