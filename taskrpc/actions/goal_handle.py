"""A goal that a server has accepted, as its client sees it: feedback, result, cancellation."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable
from typing import Any, Generic, Self

from taskrpc.actions.states import GoalState
from taskrpc.client import UNSET, Unset
from taskrpc.errors import Code, DeadlineExceeded, GoalAborted, GoalCanceled, TaskRpcError
from taskrpc.message_types import FeedbackT, ResultT


class Feedback(Generic[FeedbackT]):
    """The feedback of one goal, for `async for`; the loop ends when the goal ends.

    It keeps the newest `depth` messages that the program has not read, and drops older ones.
    """

    def __init__(self, depth: int) -> None:
        self.dropped = 0
        """Messages that were dropped because the program read too slowly."""
        self._waiting: deque[FeedbackT] = deque()
        self._depth = depth
        self._has_ended = False
        self._changed = asyncio.Event()

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> FeedbackT:
        while not self._waiting:
            if self._has_ended:
                raise StopAsyncIteration
            self._changed.clear()
            await self._changed.wait()
        return self._waiting.popleft()

    def _arrived(self, feedback: FeedbackT) -> None:
        if self._has_ended:
            return
        if len(self._waiting) >= self._depth:
            self._waiting.popleft()
            self.dropped += 1
        self._waiting.append(feedback)
        self._changed.set()

    def _end(self) -> None:
        self._has_ended = True
        self._changed.set()


class GoalHandle(Generic[ResultT, FeedbackT]):
    """A goal that the server has accepted; returned by `ActionClient.send_goal`."""

    def __init__(
        self,
        goal_id: bytes,
        action_name: str,
        depth: int,
        cancel: Callable[[bytes, float | Unset | None], Awaitable[bool]],
    ) -> None:
        self._feedback: Feedback[FeedbackT] = Feedback(depth)
        self._goal_id = goal_id
        self._action_name = action_name
        self._cancel = cancel
        self._state = GoalState.ACCEPTED
        self._requests = 0
        """Requests of the client with this id that have no response yet."""
        self._is_accepted = False
        self._is_over = False
        """Whether the status has reported that the goal has ended."""
        self._waiting: asyncio.Timeout | None = None
        """The limit of the call that waits for the result; None if no call waits."""
        self._response: asyncio.Future[Any] = asyncio.get_running_loop().create_future()
        """The response with the result; an error if there is none."""

    @property
    def goal_id(self) -> str:
        """The goal's id: 32 hexadecimal digits."""
        return self._goal_id.hex()

    @property
    def feedback(self) -> Feedback[FeedbackT]:
        """The goal's feedback, for `async for`."""
        return self._feedback

    @property
    def state(self) -> GoalState:
        """The last state of the goal that the client knows."""
        return self._state

    async def result(self, timeout: float | None = None) -> ResultT:
        """Wait until the goal has ended, and return its result; it may be called repeatedly.

        Without `timeout` (seconds), it waits without limit. The goal continues if the timeout
        passes or the waiting task is cancelled.

        Raises:
            GoalAborted: the server ended the goal without completing it, or its callback raised.
            GoalCanceled: the goal was cancelled.
            DeadlineExceeded: the goal has not ended in time; it continues.
            OutcomeUnknown: the server ended, or no longer has the result.
        """
        if not self._response.done():
            await asyncio.wait([self._response], timeout=timeout)
        if not self._response.done():
            raise DeadlineExceeded(
                f"the goal {self.goal_id} of {self._action_name} has not ended within {timeout} s;"
                " it continues: wait again, or call `cancel()`"
            )
        response = self._response.result()
        result: ResultT = response.result
        if self._state is GoalState.SUCCEEDED:
            return result
        which = f"the goal {self.goal_id} of {self._action_name}"
        if self._state is GoalState.CANCELED:
            raise GoalCanceled(Code.CANCELLED, f"{which} was cancelled", result)
        raise GoalAborted(Code.ABORTED, f"{which} was aborted", result)

    async def cancel(self, timeout: float | Unset | None = UNSET) -> bool:
        """Ask the server to cancel the goal; return whether it agrees.

        True: the goal ends soon; `result()` waits for the end. False: the goal has ended already,
        or the server refuses. Raises the errors of `Client.call`.
        """
        agrees = await self._cancel(self._goal_id, timeout)
        if agrees:  # the message with the new state may not have arrived yet
            self._advanced(GoalState.CANCELING)
        return agrees

    def _advanced(self, state: GoalState) -> None:
        """Note an active state that the server reports; an older report changes nothing."""
        if not self._response.done():
            self._state = max(self._state, state)

    def _ended(self, state: GoalState, response: Any) -> None:
        self._state = state
        self._response.set_result(response)

    def _failed(self, state: GoalState, error: TaskRpcError) -> None:
        if not self._response.done():
            self._state = state
            self._response.set_exception(error)
            self._response.exception()  # a program need not ask for the result
