"""One goal, as the callback of an action server sees it."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, Generic, TypeAlias

from taskrpc.actions.goals import GoalRecord
from taskrpc.actions.states import GoalEvent, GoalState, next_state
from taskrpc.message_types import FeedbackT, GoalT, ResultT


class ServerGoal(Generic[GoalT, ResultT, FeedbackT]):
    """One goal in the callback of an action server.

    The methods may be called in the thread of a plain callback, except `wait_for_cancel`.
    """

    def __init__(self, record: GoalRecord, publish: Callable[[GoalRecord, Any], None]) -> None:
        self._record = record
        """The goal in the server's ledger."""
        self._publish = publish
        self._cancelled = asyncio.Event()
        """Set when a cancellation is accepted."""
        self._ending = GoalEvent.SUCCEED
        """How the goal ends when its callback returns."""

    @property
    def request(self) -> GoalT:
        """The goal message that the client sent."""
        request: GoalT = self._record.request
        return request

    @property
    def goal_id(self) -> str:
        """The goal's id: 32 hexadecimal digits."""
        return self._record.goal_id.hex()

    @property
    def state(self) -> GoalState:
        """The state of the goal."""
        return self._record.state

    @property
    def is_cancel_requested(self) -> bool:
        """Whether a client has cancelled the goal, or the program ends, and the server
        has accepted this.
        """
        return self._record.state is GoalState.CANCELING

    async def wait_for_cancel(self) -> None:
        """Wait until the goal is cancelled: by a client, or because the program ends."""
        await self._cancelled.wait()

    def publish_feedback(self, feedback: FeedbackT) -> None:
        """Send a feedback message to the client, without waiting for it.

        Raises InvalidRequest for a message of another type or with an invalid value; TaskRpcError
        once the goal has ended.
        """
        self._publish(self._record, feedback)

    def canceled(self, result: ResultT) -> ResultT:
        """End the goal as cancelled: write `return goal.canceled(result)`.

        Raises InvalidTransition if the goal is not being cancelled.
        """
        next_state(self._record.state, GoalEvent.CANCELED)
        self._ending = GoalEvent.CANCELED
        return result

    def abort(self, result: ResultT) -> ResultT:
        """End the goal as aborted: write `return goal.abort(result)`."""
        self._ending = GoalEvent.ABORT
        return result


Execute: TypeAlias = Callable[
    [ServerGoal[GoalT, ResultT, FeedbackT]], "ResultT | Awaitable[ResultT]"
]
"""`execute(goal)`, plain or async; returns the result."""
AcceptGoal: TypeAlias = Callable[[GoalT], "bool | Awaitable[bool]"]
"""`goal(request)`, plain or async: whether the server accepts the goal."""
AcceptCancel: TypeAlias = Callable[
    [ServerGoal[GoalT, ResultT, FeedbackT]], "bool | Awaitable[bool]"
]
"""`cancel(goal)`, plain or async: whether the server cancels the goal."""
