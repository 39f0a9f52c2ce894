"""Action clients of blocking nodes: each object passes its methods on to the asynchronous one."""

from __future__ import annotations

from typing import Generic, Self

from taskrpc.actions import client as _client
from taskrpc.actions import goal_handle as _goal_handle
from taskrpc.actions.states import GoalState
from taskrpc.client import UNSET, Unset
from taskrpc.message_types import FeedbackT, GoalT, ResultT
from taskrpc.sync.loop_thread import LoopThread


class ActionClient(Generic[GoalT, ResultT, FeedbackT]):
    """Sends goals to one action and waits; may be used from several threads at once."""

    def __init__(
        self, loop: LoopThread, inner: _client.ActionClient[GoalT, ResultT, FeedbackT]
    ) -> None:
        self._loop = loop
        self._inner = inner
        self.action_type = inner.action_type
        self.action_name = inner.action_name

    def server_is_ready(self) -> bool:
        """Whether a server of the action is known."""
        return self._loop.do(self._inner.server_is_ready, "server_is_ready()")

    def wait_for_server(self, timeout: float | None = None) -> bool:
        """Wait until a server offers the action; False if none does within `timeout` seconds."""
        return self._loop.run(self._inner.wait_for_server(timeout), "wait_for_server()")

    def send_goal(
        self, goal: GoalT, timeout: float | Unset | None = UNSET, goal_id: str = ""
    ) -> GoalHandle[ResultT, FeedbackT]:
        """Send a goal, and wait until the server has accepted it; as `taskrpc.ActionClient`."""
        sent = self._inner.send_goal(goal, timeout, goal_id)
        return GoalHandle(self._loop, self._loop.run(sent, "send_goal()"))

    def destroy(self) -> None:
        """End the client; its goals continue, but their handles get no result."""
        self._loop.do(self._inner.destroy, "destroy()")


class GoalHandle(Generic[ResultT, FeedbackT]):
    """A goal that a server has accepted; returned by `ActionClient.send_goal`."""

    def __init__(
        self, loop: LoopThread, inner: _goal_handle.GoalHandle[ResultT, FeedbackT]
    ) -> None:
        self._loop = loop
        self._inner = inner

    @property
    def goal_id(self) -> str:
        """The goal's id: 32 hexadecimal digits."""
        return self._inner.goal_id

    @property
    def feedback(self) -> Feedback[FeedbackT]:
        """The goal's feedback, for a `for` loop; a second loop does not get the same messages."""
        return Feedback(self._loop, self._inner.feedback)

    @property
    def state(self) -> GoalState:
        """The last state of the goal that the client knows."""
        return self._inner.state

    def result(self, timeout: float | None = None) -> ResultT:
        """Wait until the goal has ended, and return its result; as `taskrpc.GoalHandle`."""
        return self._loop.run(self._inner.result(timeout), "result()")

    def cancel(self, timeout: float | Unset | None = UNSET) -> bool:
        """Ask the server to cancel the goal; return whether it agrees."""
        return self._loop.run(self._inner.cancel(timeout), "cancel()")


class Feedback(Generic[FeedbackT]):
    """The feedback of one goal, for a `for` loop; the loop ends when the goal ends."""

    def __init__(self, loop: LoopThread, inner: _goal_handle.Feedback[FeedbackT]) -> None:
        self._loop = loop
        self._inner = inner

    @property
    def dropped(self) -> int:
        """Messages that were dropped because the program read too slowly."""
        return self._inner.dropped

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> FeedbackT:
        # A future cannot hold StopIteration, but StopAsyncIteration passes through it.
        try:
            return self._loop.run(self._inner.__anext__(), "feedback")
        except StopAsyncIteration:
            raise StopIteration from None
