"""What the checks of a scenario may ask about a run."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Protocol

import msgspec

from taskrpc.errors import TaskRpcError
from taskrpc.simulation.run.trace import Event, Trace


class CallRecord(msgspec.Struct):
    """One call that a program made."""

    program: str
    process: str
    """The value of `current_program`."""
    service: str
    began: float
    """Virtual seconds."""
    began_at: int
    """How many events the run had then."""
    where: str
    """The program's line, if the run tells it."""
    is_hidden: bool
    """Whether taskrpc makes it by itself."""
    ok: bool | None = None
    """True once it got its response, False once it ended with an error."""
    code: str = ""
    """The name of the error code once it has ended; `OK` for a response."""
    ended: float = 0.0
    """Virtual seconds, once it has ended."""


class Lived(Protocol):
    """One life of a program."""

    name: str
    lines: list[str]


class Observed(Protocol):
    """What the world knows of a run."""

    calls: list[CallRecord]
    messages: dict[str, list[Any]]
    trace: Trace

    @property
    def now(self) -> float:
        """Virtual seconds since the begin."""

    @property
    def names(self) -> Sequence[str]:
        """The names of the programs."""

    @property
    def lives(self) -> Iterable[Lived]:
        """All starts of all programs."""

    def call(self, service: str, fields: dict[str, object]) -> object:
        """Call a service."""


class SimulatedWorld:
    """The state of a run, for the functions of `always` and `finally_`.

    Methods that take the name of a program raise TaskRpcError for a name that the scenario lacks.
    """

    def __init__(self, run: Observed) -> None:
        self._run = run

    @property
    def time(self) -> float:
        """Virtual seconds since the begin of the run."""
        return self._run.now

    def calls(self, service: str, ok: bool | None = None) -> int:
        """Return how many calls of a service programs began.

        With `ok=True`, only those that got a response; with `ok=False`, only those that ended with
        an error.
        """
        name = service if service.startswith("/") else f"/{service}"
        return sum(
            each.service == name and each.program != "" and (ok is None or each.ok is ok)
            for each in self._run.calls
        )

    def lines(self, program: str) -> list[str]:
        """Return the lines that a program printed or logged, over all its starts."""
        return [line for each in self._lives(program) for line in each.lines]

    def count(self, program: str, text: str) -> int:
        """Return how many lines of a program contain a text."""
        return sum(text in line for line in self.lines(program))

    def messages(self, topic: str) -> list[Any]:
        """Return the messages that were published on a topic."""
        name = topic if topic.startswith("/") else f"/{topic}"
        return self._run.messages.get(name, [])

    def faults(self) -> list[Event]:
        """Return the faults that have happened, and when programs were killed.

        Each has a `time` in virtual seconds, a `program` and a `text`.
        """
        return [each for each in self._run.trace.events if each.kind in ("fault", "crash")]

    def starts(self, program: str) -> int:
        """Return how often a program was started."""
        return len(self._lives(program))

    def call(self, service: str, **fields: Any) -> Any:
        """Call a service and return its response; only in functions of `finally_`.

        No faults happen any more. Raises TaskRpcError if the call fails.
        """
        return self._run.call(service, fields)

    def _lives(self, program: str) -> list[Lived]:
        if program not in self._run.names:
            known = ", ".join(self._run.names)
            raise TaskRpcError(f"expected the name of a program ({known}), got {program!r}")
        return [each for each in self._run.lives if each.name == program]
