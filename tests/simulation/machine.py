"""The environment of the simulated programs: a wall clock that leaps, a robot, accounts."""

from __future__ import annotations

import asyncio

from taskrpc import Account, Accounts, Plan, Pose, Role
from taskrpc.robot.protocol import RobotStopped

WALL = 1_800_000_000.0
"""Seconds since 1970 when a simulation begins."""

LEAPS = (-100_000.0, 20.0, 100_000.0)
"""Seconds by which the clock is set forward or back."""

GRACE = 1.7
"""Seconds until a server notices that an account changed: it looks once a second,
and lets the caller read the reason."""


class WallClock:
    """The wall clock in seconds since 1970, which can be set."""

    def __init__(self, loop):
        self._loop = loop
        self._ahead = WALL

    def __call__(self):
        return self._ahead + self._loop.time()

    def leap(self, seconds):
        self._ahead += seconds


class ChangingAccounts(Accounts):
    """Accounts that change while servers use them."""

    def __init__(self, accounts):
        accounts = list(accounts)
        super().__init__(accounts)
        self._loop = asyncio.get_running_loop()
        self._past = {account.name: [(self._loop.time(), account)] for account in accounts}

    def change(self, account: Account) -> None:
        self._by_name[account.name] = account
        self._past[account.name].append((self._loop.time(), account))

    def might(self, name: str, role: Role, since: float | None = None) -> bool:
        """Whether a server may still believe that an account has this permission."""
        since = self._loop.time() if since is None else since
        for began, account in reversed(self._past[name]):
            if not account.revoked and account.role >= role:
                return True
            if began < since - GRACE:
                break
        return False


class CountingRobot:
    """A robot that only waits, and reports to the ledger."""

    speed = 1.0
    task_types = ("move",)

    def __init__(self, disk, ledger, chance):
        self._disk = disk
        self._ledger = ledger
        self._chance = chance
        self._left = 0.0
        self._going = asyncio.Event()
        self._going.set()
        self._is_stopped = False

    def plan(self, task_type, target, start):
        return Plan(0.3, start)

    def pose(self):
        return Pose(0.0, 0.0, 0.0)

    async def execute(self, task_type, target, report):
        self._ledger.moved(self._disk, target)
        self._left = self._chance.uniform(0.05, 0.8)
        try:
            while self._left:
                await self._going.wait()
                step = min(self._left, 0.2)
                await asyncio.sleep(step)
                if self._is_stopped:
                    raise RobotStopped("stopped")
                self._left -= step
        finally:
            self._left = 0.0
            self._is_stopped = False
            self._going.set()
        return {}

    def remaining(self):
        return self._left

    def pause(self):
        self._going.clear()

    def resume(self):
        self._going.set()

    def stop(self):
        self._is_stopped = self._left > 0
        self._going.set()
