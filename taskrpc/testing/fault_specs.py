"""The faults of calls, as `taskrpc-server --fault` names them, and the choice of the calls; pure.

A specification is a kind, a colon, and parts that commas separate: `lose-response:first=1`,
`delay-response:0.5s`, `busy:0.2,seed=7`, `slow:2s,service=/robot_task/list`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from enum import Enum

import msgspec

from taskrpc.core import names
from taskrpc.errors import InvalidName

MAX_SECONDS = 3600.0
"""The longest delay of a fault."""
MAX_NUMBER = 10**9
"""The largest value of `first` and `seed`."""

ALLOWED = (
    "allowed are lose-request, duplicate-request, lose-response, delay-response:0.5s, slow:2s,"
    " busy, cut-connection; then 0.3 (a share of the calls), first=N, service=NAME, seed=N, as in"
    " busy:0.3,first=9"
)
"""The end of each error message."""


class FaultKind(Enum):
    """What happens to a call."""

    LOSE_REQUEST = "lose-request"
    """The service never gets the request."""
    DUPLICATE_REQUEST = "duplicate-request"
    """The service handles the request twice; the caller gets the first response."""
    LOSE_RESPONSE = "lose-response"
    """The service handles the request, and the caller never gets the response."""
    DELAY_RESPONSE = "delay-response"
    """The caller gets the response later."""
    SLOW = "slow"
    """The service handles the request more slowly."""
    BUSY = "busy"
    """The caller gets `ServerBusy`."""
    CUT_CONNECTION = "cut-connection"
    """The service handles the request, and the connection ends before the response."""

    @property
    def needs_seconds(self) -> bool:
        """Whether a fault of this kind takes a time."""
        return self in (FaultKind.DELAY_RESPONSE, FaultKind.SLOW)

    @property
    def concerns_response(self) -> bool:
        """Whether the service handles the request before the fault happens."""
        return self not in (
            FaultKind.LOSE_REQUEST,
            FaultKind.DUPLICATE_REQUEST,
            FaultKind.SLOW,
            FaultKind.BUSY,
        )


_EFFECTS = {
    FaultKind.LOSE_REQUEST: "the request is lost",
    FaultKind.DUPLICATE_REQUEST: "the request arrives twice",
    FaultKind.LOSE_RESPONSE: "the response is lost",
    FaultKind.DELAY_RESPONSE: "the response is {seconds:g} s late",
    FaultKind.SLOW: "the handler takes {seconds:g} s longer",
    FaultKind.BUSY: "the caller gets ServerBusy",
    FaultKind.CUT_CONNECTION: "the connection is cut before the response",
}


class Fault(msgspec.Struct, frozen=True):
    """One fault, and the calls that get it."""

    kind: FaultKind
    seconds: float = 0.0
    """How long it delays the call."""
    share: float = 1.0
    """The share of the calls that get it, above 0 and at most 1."""
    first: int | None = None
    """How many calls can get it, from the first one on; None: all calls."""
    service: str = ""
    """The absolute name of the service; "" for every service."""
    seed: int = 0
    """The same seed gives the fault to the same calls."""

    def strikes(self, count: int, chance: float) -> bool:
        """Return whether call number `count` (from 1) gets the fault.

        `chance` is a random number in [0, 1).
        """
        return (self.first is None or count <= self.first) and chance < self.share

    @property
    def effect(self) -> str:
        """What happens to a call, in words."""
        return _EFFECTS[self.kind].format(seconds=self.seconds)

    def __str__(self) -> str:
        """The fault in words: what happens, and to which calls."""
        return f"{self.effect} in {self._calls()} of {self.service or 'every service'}"

    def _calls(self) -> str:
        if self.first is None:
            return "every call" if self.share == 1 else f"{self.share * 100:g} % of the calls"
        calls = "the first call" if self.first == 1 else f"the first {self.first} calls"
        return calls if self.share == 1 else f"{self.share * 100:g} % of {calls}"


def parse_fault(text: str, service: str = "") -> Fault:
    """Return the fault of a specification; `service` applies if it names none.

    Raises ValueError with one line that lists what is allowed.
    """
    name, colon, rest = text.partition(":")
    kind = next((kind for kind in FaultKind if kind.value == name.strip()), None)
    if kind is None:
        raise _invalid(f"expected a fault, got {name.strip()!r}", text)
    found: dict[str, object] = {}
    for part in rest.split(",") if colon else ():
        key, value = _part(part.strip(), text)
        if key in found:
            raise _invalid(f"{part.strip()!r} repeats the {key}", text)
        found[key] = value
    if kind.needs_seconds and "seconds" not in found:
        raise _invalid(f"expected a time, such as {name.strip()}:0.5s", text)
    if not kind.needs_seconds and "seconds" in found:
        raise _invalid(f"{name.strip()} takes no time", text)
    return msgspec.convert({"kind": kind, "service": service, **found}, Fault)


def _part(part: str, text: str) -> tuple[str, object]:
    key, equals, value = part.partition("=")
    if equals and key == "service":
        try:
            return key, names.expand(value)
        except InvalidName:
            raise _invalid(f"expected the name of a service, got {value!r}", text) from None
    if equals and key in ("first", "seed"):
        least = 1 if key == "first" else 0
        number = int(value) if value.isascii() and value.isdecimal() and len(value) < 12 else -1
        if not least <= number <= MAX_NUMBER:
            raise _invalid(f"{key}: expected a whole number from {least}, got {value!r}", text)
        return key, number
    if seconds := re.fullmatch(r"([0-9.]+)(ms|s)", part):
        unit = 1000 if seconds[2] == "ms" else 1
        duration = _number(seconds[1]) / unit
        if not 0 < duration <= MAX_SECONDS:
            raise _invalid(f"expected a time above 0 s up to {MAX_SECONDS:g} s, got {part!r}", text)
        return "seconds", duration
    share = _number(part)
    if not 0 < share <= 1:
        raise _invalid(
            f"expected a share above 0 up to 1, or a time such as 2s, got {part!r}", text
        )
    return "share", share


def _number(text: str) -> float:
    """Return a plain decimal number, NaN for any other text."""
    return float(text) if re.fullmatch(r"[0-9]*\.?[0-9]+|[0-9]+\.", text) else math.nan


def _invalid(problem: str, text: str) -> ValueError:
    return ValueError(f"{problem} (in {text[:80]!r}); {ALLOWED}")


class FaultPlan:
    """Decides for each call which fault it gets.

    Several faults share the calls in their order: a call that gets one fault does not count for
    the later ones.

    Args:
        faults: the faults.
        chances: for each fault, a function that returns the next random number in [0, 1).
    """

    def __init__(self, faults: Sequence[Fault], chances: Sequence[Callable[[], float]]) -> None:
        self._faults = list(zip(faults, chances, strict=True))
        self._counts = [0] * len(self._faults)
        """How many calls each fault has seen."""

    def concerns(self, service: str) -> bool:
        """Return whether calls of a service can get a fault."""
        return any(fault.service in ("", service) for fault, _ in self._faults)

    def next(self, service: str) -> Fault | None:
        """Return the fault of the next call of a service, None for none."""
        for number, (fault, chance) in enumerate(self._faults):
            if fault.service in ("", service):
                self._counts[number] += 1
                # One number for each call, so that the decision depends only on seed and count.
                if fault.strikes(self._counts[number], chance()):
                    return fault
        return None
