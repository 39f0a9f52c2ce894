"""What happens in a scene, in words: output of the program, calls and faults at the robot; pure."""

from __future__ import annotations

import re
from typing import NamedTuple

import msgspec

PROGRAM = "program"
NETWORK = "network"
ROBOT = "robot"
TASKRPC = "taskrpc"
SIMULATOR = "simulate"

_EXPLANATION = "[taskrpc] "
_ENDED_WITH = re.compile(r"\S*\.py:(\d+): (\w+): (.*)")
_FAULT = re.compile(r"fault in call (\d+) of \S+ from \S+: (.*)")
_QUEUED = re.compile(r"Task (\d+) queued: .*")
_EXECUTING = re.compile(r"Executing task (\d+): .*")


class Moment(NamedTuple):
    """One thing that happens in a scene."""

    at: float
    """Seconds since the first one."""
    actor: str
    """PROGRAM, NETWORK, ROBOT, SIMULATOR, or TASKRPC for an explanation of taskrpc."""
    text: str


def of_output(line: str) -> tuple[str, str] | None:
    """Return actor and text of a line that the program has written, None for an empty line."""
    line = line.strip()
    if not line:
        return None
    if line.startswith(_EXPLANATION):
        return TASKRPC, line.removeprefix(_EXPLANATION)
    if found := _ENDED_WITH.fullmatch(line):
        return PROGRAM, f"ends in line {found[1]} with {found[2]}"
    return PROGRAM, line


def of_log(text: str) -> tuple[str, str] | None:
    """Return actor and text of a log line of the robot; None if it says nothing to the class."""
    if found := _FAULT.fullmatch(text):
        return NETWORK, f"call {found[1]}: {found[2]}"
    if found := _QUEUED.fullmatch(text):
        return ROBOT, f"task {found[1]} is in the queue"
    if found := _EXECUTING.fullmatch(text):
        return ROBOT, f"executes task {found[1]}"
    return None


def of_request(number: int) -> tuple[str, str]:
    """Return actor and text for a request that has arrived."""
    return NETWORK, f"call {number}: the request arrives"


def of_response(number: int, *, repeated: bool) -> tuple[str, str]:
    """Return actor and text for a response that is sent."""
    which = "the stored response is sent" if repeated else "the response is sent"
    return NETWORK, f"call {number}: {which}"


class _SimulatedEvent(msgspec.Struct):
    time: float
    """In virtual seconds."""
    program: str
    kind: str
    text: str


class _SimulatedFailure(msgspec.Struct):
    text: str
    events: list[_SimulatedEvent]


class _Simulated(msgspec.Struct):
    """What `taskrpc simulate --json` prints."""

    failure: _SimulatedFailure | None = None


def of_simulation(output: bytes, runs: int) -> list[tuple[str, str]]:
    """Return actor and text for each part of what `taskrpc simulate --json` has printed.

    Raises msgspec.MsgspecError if it is no result.
    """
    failure = msgspec.json.decode(output, type=_Simulated).failure
    if failure is None:
        return [(SIMULATOR, f"{runs} runs in virtual time: none fails")]
    found = [f"a run fails: {failure.text.splitlines()[0]}"]
    words = {"begin": "executes", "print": "prints:"}
    found += [
        f"{each.time:.2f} s  {words[each.kind]} {each.text}"
        for each in failure.events
        if each.kind in words
    ]
    return [(SIMULATOR, text) for text in found]


def of_hang(seconds: float) -> tuple[str, str]:
    """Return actor and text for a program that was ended because it waits for ever."""
    return PROGRAM, f"still waits after {seconds:.1f} s; it would wait for ever, and is ended"
