"""The lease of a server on its robot: join the fleet, renew in time, halt when that fails.

The database's clock decides when a lease ends for the others. This server counts from the instant
at which it *sent* the last renewal that succeeded, so its own end is always the earlier one.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

import msgspec

from taskrpc.errors import TaskRpcError
from taskrpc.robot.fleet import rules
from taskrpc.robot.fleet.model import RobotRecord
from taskrpc.robot.fleet.state import FleetState
from taskrpc.robot.fleet.store import FleetStore
from taskrpc.robot.protocol import Pose

log = logging.getLogger("taskrpc.fleet")

_SAFETY = 0.9  # of the lease; the rest is for halting the robot, and for clocks of other speed
_RENEWALS = 3  # in each lease
_RETRY_AFTER = 0.5


class Report(msgspec.Struct, frozen=True):
    """What a renewal tells the fleet about the robot."""

    remaining: float = 0.0
    """Real seconds until its task ends."""
    progress: float = 0.0
    pose: Pose | None = None
    """Where it is."""


class LeaseKeeper:
    """Holds a robot's lease from `join` until `leave`.

    Args:
        store: the fleet's store.
        robot: the robot's record; the epoch and the lease are set here.
        lease: seconds.
        report: returns what a renewal tells about the robot.
        on_end: called when the lease has ended for this server: halt the robot.
        on_joined: called with the epoch whenever the server has joined the fleet.
    """

    def __init__(
        self,
        store: FleetStore,
        robot: RobotRecord,
        lease: float,
        *,
        report: Callable[[], Report],
        on_end: Callable[[], object],
        on_joined: Callable[[int], object],
    ) -> None:
        self.epoch = 0
        """The epoch of the lease; 0 if another server may have ended the lease."""
        self._store = store
        self._robot = robot
        self._lease = lease
        self._report = report
        self._on_end = on_end
        self._on_joined = on_joined
        self._valid_until = 0.0  # on the loop's clock
        self._watchdog: asyncio.TimerHandle | None = None
        self._keeping: asyncio.Task[None] | None = None
        self._is_ended = False  # whether `on_end` was called since the last renewal

    @property
    def is_valid(self) -> bool:
        """Whether this server may drive the robot now."""
        return self.epoch > 0 and asyncio.get_running_loop().time() < self._valid_until

    async def join(self, address: str = "") -> None:
        """Join the fleet, and renew the lease from now on.

        Waits for the end of the lease of a server that has crashed. `address` is where this server
        listens.

        Raises:
            NameTaken: another server drives a robot of this name.
            StoreError: the database cannot be used.
        """
        self._robot = msgspec.structs.replace(self._robot, address=address)
        try:
            await self._join()
        except rules.NameTaken:
            earlier = self._store.state.robots[self._robot.name]
            wait = max(0.0, earlier.lease_until - self._store.now())
            log.info("waiting %.1f s for the lease of an earlier server of %s", wait, earlier.name)
            await asyncio.sleep(wait + 0.1)
            await self._join()
        self._keeping = asyncio.create_task(self._keep(), name="taskrpc lease")

    async def leave(self) -> None:
        """End the lease. Raises TaskRpcError if the end could not be stored."""
        keeping, self._keeping = self._keeping, None
        if keeping is not None:
            keeping.cancel()
            await asyncio.wait({keeping})
        if self._watchdog is not None:
            self._watchdog.cancel()
        epoch, self.epoch = self.epoch, 0
        if epoch:
            name = self._robot.name
            await self._store.transact(lambda state, now: rules.leave(state, now, name, epoch))

    async def _join(self) -> None:
        sent = asyncio.get_running_loop().time()

        def action(state: FleetState, now: float) -> RobotRecord:
            return rules.join(state, now, self._robot, self._lease)

        joined = await self._store.transact(action)
        self.epoch = joined.epoch
        self._on_joined(joined.epoch)
        self._renewed(sent)

    async def _keep(self) -> None:
        pause = self._lease / _RENEWALS
        problem = ""
        while True:
            await asyncio.sleep(pause)
            pause = self._lease / _RENEWALS
            try:
                await self._renew()
                problem = ""
            except rules.Fenced as fenced:
                log.error("%s", fenced)
                self.epoch = 0
                self._end()
                pause = _RETRY_AFTER
            except TaskRpcError as error:
                pause = min(pause, _RETRY_AFTER)
                # The text of NameTaken has the seconds that are left, so each one differs.
                found = "name taken" if isinstance(error, rules.NameTaken) else str(error)
                if found != problem:
                    problem = found
                    log.warning("the lease of %s is not renewed: %s", self._robot.name, error)

    async def _renew(self) -> None:
        report = self._report()
        if not self.epoch:
            if not report.remaining:  # the robot has halted
                pose = report.pose or self._robot.pose
                self._robot = msgspec.structs.replace(self._robot, pose=pose)
                await self._join()
            return
        name, epoch, sent = self._robot.name, self.epoch, asyncio.get_running_loop().time()

        def action(state: FleetState, now: float) -> None:
            rules.renew(
                state,
                now,
                name,
                epoch,
                self._lease,
                remaining=report.remaining,
                progress=report.progress,
                pose=report.pose,
            )

        await self._store.transact(action)
        self._renewed(sent)

    def _renewed(self, sent: float) -> None:
        loop = asyncio.get_running_loop()
        self._valid_until = sent + self._lease * _SAFETY
        if self._watchdog is not None:
            self._watchdog.cancel()
        self._watchdog = loop.call_at(self._valid_until, self._end)
        self._is_ended = self._valid_until <= loop.time()

    def _end(self) -> None:
        if not self._is_ended:
            self._is_ended = True
            self._on_end()
