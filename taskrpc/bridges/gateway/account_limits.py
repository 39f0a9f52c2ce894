"""How many calls of one account reach the robot: per second, and at a time. Pure."""

from __future__ import annotations

import msgspec

_ROUNDING = 1e-9
"""So that a caller that waits for exactly the given time is not refused again."""
_MOST_ACCOUNTS = 1024
"""Accounts that are remembered; those without calls are forgotten first."""


class _Use(msgspec.Struct):
    """What one account uses."""

    allowance: float
    """The calls that the account may begin at `since`: at most those of one second."""
    since: float
    in_flight: int = 0


class AccountLimits:
    """The limits of all accounts.

    An account may begin `rate` calls per second on average, as many of them at once after a pause,
    and have `in_flight` calls without a response.
    """

    def __init__(self, rate: float, in_flight: int) -> None:
        self.rate = rate
        self.in_flight = in_flight
        self._most = max(rate, 1.0)
        self._uses: dict[str, _Use] = {}

    def begin(self, account: str, now: float) -> float:
        """Count a call that an account begins; return 0.0.

        If a limit is reached, the call does not count, and the result is the seconds after which
        the account may try again.
        """
        use = self._uses.get(account)
        if use is None:
            self._forget_idle(now)
            use = self._uses[account] = _Use(self._most, now)
        use.allowance = min(self._most, use.allowance + (now - use.since) * self.rate)
        use.since = now
        if use.in_flight >= self.in_flight:
            return 1.0 / self.rate
        if use.allowance < 1.0 - _ROUNDING:
            return (1.0 - use.allowance) / self.rate
        use.allowance -= 1.0
        use.in_flight += 1
        return 0.0

    def end(self, account: str) -> None:
        """Count the end of a call."""
        self._uses[account].in_flight -= 1

    def _forget_idle(self, now: float) -> None:
        if len(self._uses) < _MOST_ACCOUNTS:
            return
        for account, use in list(self._uses.items()):
            rested = use.allowance + (now - use.since) * self.rate >= self._most
            if rested and not use.in_flight:
                del self._uses[account]
