"""Decides when to retry and how long to wait; pure: the caller passes the time and the chance."""

from __future__ import annotations

import math

import msgspec

_BUDGET_FULL = 10.0
_BUDGET_GAIN = 0.1
_BUDGET_FLOOR = 3.0  # retries a second that an empty budget still allows


class RetryPolicy(msgspec.Struct, frozen=True):
    """How a client retries a failed call, if a retry is safe.

    The wait before retry n (from 0) is `min(wait_max, wait_initial * wait_exp_base**n)` seconds, of
    which the fraction `wait_jitter` (0 to 1) is random. `attempts` includes the first one; None:
    retry until the call's deadline.

    `attempt_timeout` limits each attempt of an idempotent or exactly-once service, in seconds. An
    attempt without a response by then counts as failed. Calls of other services are refused with
    InvalidRequest, because the attempt may still run. None: only the call's deadline ends an
    attempt.
    """

    attempts: int | None = None
    wait_initial: float = 0.05
    wait_max: float = 2.0
    wait_exp_base: float = 2.0
    wait_jitter: float = 1.0
    attempt_timeout: float | None = None

    def __post_init__(self) -> None:
        attempts = self.attempts
        if attempts is not None and (not _is_number(attempts, int) or attempts < 1):
            raise ValueError(f"attempts: expected a whole number from 1 or None, got {attempts!r}")
        for name in ("wait_initial", "wait_max"):
            _check(name, getattr(self, name), 0, math.inf, "finite seconds from 0")
        _check("wait_exp_base", self.wait_exp_base, 1, math.inf, "a finite number from 1")
        _check("wait_jitter", self.wait_jitter, 0, 1, "a share from 0 to 1")
        if (seconds := self.attempt_timeout) is not None:
            expected = "finite seconds above 0, or None"
            _check("attempt_timeout", seconds, math.ulp(0.0), math.inf, expected)

    def allows(self, attempt: int) -> bool:
        """Return whether attempt number `attempt` (the first is 1) is allowed."""
        return self.attempts is None or attempt <= self.attempts

    def attempt_ends(self, now: float, deadline: float | None) -> float | None:
        """Return when an attempt that begins `now` ends, given the call's deadline; None: never."""
        if self.attempt_timeout is None:
            return deadline
        end = now + self.attempt_timeout
        return end if deadline is None else min(end, deadline)

    def wait(self, retry: int, chance: float) -> float:
        """Return the seconds to wait before retry number `retry` (from 0).

        `chance` is a random number in [0, 1).
        """
        try:
            whole = min(self.wait_max, self.wait_initial * float(self.wait_exp_base) ** retry)
        except OverflowError:
            whole = self.wait_max if self.wait_initial else 0.0
        return whole * (1 - self.wait_jitter) + whole * self.wait_jitter * chance


class RetryBudget:
    """Limits retries during an outage: each costs a token, each successful call earns a tenth.

    An empty budget does not forbid retries; it allows three a second.
    """

    def __init__(self) -> None:
        self.booked = 0
        """How many retries there were."""
        self.spent = 0.0
        """How many tokens are missing; at 0.0 the budget is full, and `earn` does nothing."""
        self._next_floor = float("-inf")
        """The instant of the last retry that was booked on an empty budget."""

    def earn(self) -> None:
        """Earn a tenth of a token: a call succeeded."""
        self.spent = max(0.0, self.spent - _BUDGET_GAIN)

    def book(self, now: float, wait: float, latest: float) -> float | None:
        """Book one retry for `wait` seconds after `now`, or for later if the budget is empty.

        Returns the seconds to wait. Returns None, and books nothing, if the retry could not begin
        before the instant `latest`.
        """
        if now + wait >= latest:
            return None
        if self.spent + 1 <= _BUDGET_FULL:
            self.spent += 1
            self.booked += 1
            return wait
        slot = max(now, self._next_floor) + 1 / _BUDGET_FLOOR
        if slot >= latest:
            return None  # do not book it: calls with a later deadline can use this slot
        self._next_floor = slot
        self.booked += 1
        return max(wait, slot - now)


def reconnect_delay(failures: int, chance: float) -> float:
    """Return the seconds to wait before connecting again, after `failures` failures in a row.

    `rand(0.5, 1) * min(5 s, 0.05 s * 1.6**n)`: short at first, and different for each client.
    """
    return float((0.5 + chance / 2) * min(5.0, 0.05 * 1.6 ** min(failures, 64)))


def _check(name: str, value: float, lowest: float, highest: float, expected: str) -> None:
    is_number = _is_number(value, (int, float))
    if not is_number or not lowest <= value <= highest or value == math.inf:
        raise ValueError(f"{name}: expected {expected}, got {value!r}")


def _is_number(value: object, kinds: type | tuple[type, ...]) -> bool:
    return isinstance(value, kinds) and not isinstance(value, bool)  # a bool is an int
