"""The goals of an action server: which it knows, their states and results, and when they expire.

Pure: the caller passes the time. A goal id stands for one goal. A server that gets a known id again
finds the goal, and does not execute it a second time. The ledger keeps a goal that has ended, and
one that was rejected, until it expires; so a client can repeat any request in that time.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from enum import IntEnum
from typing import Any, Protocol, TypeVar

import msgspec

from taskrpc.actions.states import GoalEvent, GoalState, next_state
from taskrpc.errors import HandlerFailed

MOST_KEPT = 10_000
"""Goals that are kept after their end; with more, the ledger forgets the oldest of them."""


class CancelCode(IntEnum):
    """The return codes of `action_msgs/srv/CancelGoal`."""

    NONE = 0
    """At least one goal is being cancelled, or the request named no single goal."""
    REJECTED = 1
    """The server cancels none of the goals."""
    UNKNOWN_GOAL_ID = 2
    """The server has no goal of this id."""
    GOAL_TERMINATED = 3
    """The goal has ended."""


class GoalRecord(msgspec.Struct, eq=False):
    """What a server knows about one goal."""

    goal_id: bytes
    request: Any
    """The goal message."""
    stamp: int
    """When the server accepted or rejected it: nanoseconds since 1970."""
    state: GoalState = GoalState.ACCEPTED
    """UNKNOWN for a rejected goal."""
    result: Any = None
    """The result message, None before the end and if the callback gave none."""
    error: HandlerFailed | None = None
    """Why the goal was rejected or aborted; None if the callback did not say."""
    expires_at: float | None = None
    """When the ledger forgets the goal; None before its end."""

    def change(self, event: GoalEvent) -> None:
        """Change the state. Raises InvalidTransition."""
        self.state = next_state(self.state, event)

    @property
    def is_rejected(self) -> bool:
        """Whether the server did not accept it."""
        return self.state is GoalState.UNKNOWN


class GoalLedger:
    """The goals of one action server, by id; `keep` is the seconds for which it keeps results."""

    def __init__(self, keep: float) -> None:
        self._keep = keep
        self._goals: dict[bytes, GoalRecord] = {}
        self._active: dict[bytes, GoalRecord] = {}
        """The goals that have not ended, in the order in which they were accepted."""
        self._kept: dict[bytes, GoalRecord] = {}
        """The other goals, the oldest first."""

    def __len__(self) -> int:
        return len(self._goals)

    def find(self, goal_id: bytes) -> GoalRecord | None:
        """Return the goal of an id, also a rejected one; None if the ledger has none."""
        return self._goals.get(goal_id)

    def accept(self, goal_id: bytes, request: Any, stamp: int) -> GoalRecord:
        """Add an accepted goal. Raises ValueError for an id that the ledger knows."""
        goal = self._add(GoalRecord(goal_id, request, stamp))
        self._active[goal_id] = goal
        return goal

    def reject(
        self, goal_id: bytes, request: Any, stamp: int, now: float, error: HandlerFailed | None
    ) -> GoalRecord:
        """Add a rejected goal. Raises ValueError for an id that the ledger knows."""
        goal = self._add(GoalRecord(goal_id, request, stamp, GoalState.UNKNOWN, error=error))
        self._keep_until(goal, now + self._keep)
        return goal

    def end(
        self,
        goal: GoalRecord,
        event: GoalEvent,
        now: float,
        *,
        result: Any = None,
        error: HandlerFailed | None = None,
    ) -> None:
        """End an active goal, and keep its result. Raises InvalidTransition."""
        state = next_state(goal.state, event)
        if not state.is_ended:
            raise ValueError(f"{event.name} does not end a goal")
        goal.state, goal.result, goal.error = state, result, error
        del self._active[goal.goal_id]
        self._keep_until(goal, now + self._keep)

    @property
    def next_expiry(self) -> float | None:
        """The instant from which `expire` forgets a goal; None if all goals are active."""
        return next((goal.expires_at for goal in self._kept.values()), None)

    def expire(self, now: float) -> list[GoalRecord]:
        """Forget the goals whose time has passed, and return them."""
        expired = []
        while (expiry := self.next_expiry) is not None and expiry <= now:
            expired.append(self._forget_oldest())
        return expired

    @property
    def accepted(self) -> Mapping[bytes, GoalRecord]:
        """All accepted goals by id: first those that have ended, oldest first, then the others."""
        ended = {key: goal for key, goal in self._kept.items() if not goal.is_rejected}
        return ended | self._active

    def active(self) -> Iterator[GoalRecord]:
        """Return the goals that have not ended, in the order in which they were accepted."""
        return iter(self._active.values())

    def _add(self, goal: GoalRecord) -> GoalRecord:
        if goal.goal_id in self._goals:
            raise ValueError(f"the goal {goal.goal_id.hex()} is known already")
        self._goals[goal.goal_id] = goal
        return goal

    def _keep_until(self, goal: GoalRecord, expires_at: float) -> None:
        goal.expires_at = expires_at
        self._kept[goal.goal_id] = goal
        if len(self._kept) > MOST_KEPT:
            self._forget_oldest()

    def _forget_oldest(self) -> GoalRecord:
        oldest = self._kept.pop(next(iter(self._kept)))
        return self._goals.pop(oldest.goal_id)


class CancelableGoal(Protocol):
    """What `goals_to_cancel` must know about a goal."""

    @property
    def goal_id(self) -> bytes:
        """The 16 bytes of its id."""

    @property
    def stamp(self) -> int:
        """When it was accepted, in nanoseconds."""

    @property
    def state(self) -> GoalState:
        """Its state."""


_Goal = TypeVar("_Goal", bound=CancelableGoal)
_NO_ID = bytes(16)


def goals_to_cancel(
    goals: Mapping[bytes, _Goal], goal_id: bytes, stamp: int
) -> tuple[CancelCode, list[_Goal]]:
    """Return the goals that a `CancelGoal` request selects, and a code if it selects none.

    An id without a stamp selects the goal with this id. A stamp selects all goals that were
    accepted until then, and the goal with the id if there is one. Without both, it selects all
    goals. Goals that cannot be cancelled are left out.
    """
    if goal_id != _NO_ID and not stamp:
        named = goals.get(goal_id)
        if named is None:
            return CancelCode.UNKNOWN_GOAL_ID, []
        if not named.state.is_cancelable:
            return CancelCode.GOAL_TERMINATED, []
        return CancelCode.NONE, [named]
    means_all = goal_id == _NO_ID and not stamp
    return CancelCode.NONE, [
        goal
        for goal in goals.values()
        if goal.state.is_cancelable
        and (means_all or goal.stamp <= stamp or goal.goal_id == goal_id)
    ]
