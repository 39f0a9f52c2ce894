"""The robot's tasks as an action: a goal is a task, its feedback is the task's progress.

The same manager queues and cancels the tasks of goals and the tasks of the service. So both have
one order, the same reasons for rejection and one store.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from typing import TYPE_CHECKING, Any, Final, Protocol, TypeAlias

import srvgen
from taskrpc import ActionServer, ServerGoal, current_call
from taskrpc.errors import (
    Code,
    HandlerError,
    OutcomeUnknown,
    StoreError,
    TaskRpcError,
    text_for_callers,
)
from taskrpc.node import Node
from taskrpc.robot.tasks.managed import ManagedTasks
from taskrpc.robot.tasks.model import Task, TaskState
from taskrpc.robot.tasks.responses import TaskResponse
from taskrpc.robot.tasks.services.permissions import client_name, refuse_others_task, submitter
from taskrpc.spi import Denied, answering, bytes_of

if TYPE_CHECKING:
    from srvgen.stubs.my_robot_interfaces.action import ExecuteTask

    _Goal: TypeAlias = ServerGoal[ExecuteTask.Goal, ExecuteTask.Result, ExecuteTask.Feedback]

ACTION_TYPE: Final = "my_robot_interfaces/action/ExecuteTask"
FEEDBACK_PERIOD = 0.5
"""Seconds between two feedback messages of a task that has begun; each change sends one too."""
QUEUED_PERIOD = 5.0
"""Seconds between two feedback messages of a queued task."""
_GOALS = 1_000_000  # the queue of tasks has the limit, not the action
_log = logging.getLogger("taskrpc.tasks")


class SubmittingTasks(ManagedTasks, Protocol):
    """The tasks of one robot or of a fleet, which accept further ones."""

    async def submit(
        self,
        task_type: str,
        target: str,
        priority: int,
        *,
        client: str = "",
        account: str = "",
        machine: str = "",
    ) -> TaskResponse:
        """Queue a task, or refuse it with the reason."""


class TaskAction:
    """Offers the tasks of a manager as the action `NAME/execute`.

    `opened` is set once the tasks of the earlier server are read.
    """

    def __init__(
        self, node: Node, manager: SubmittingTasks, name: str, opened: asyncio.Event
    ) -> None:
        self._manager = manager
        self._opened = opened
        self._type = srvgen.load(ACTION_TYPE)
        self._task_ids: dict[str, int] = {}
        """The task of each accepted goal that has not ended, by goal id."""
        self._changed: dict[int, asyncio.Event] = {}
        """Set when this task changes, or its goal is cancelled."""
        self._cancelled_by: dict[str, str] = {}
        """The client that cancelled a goal."""
        self._dropping: set[asyncio.Future[None]] = set()
        """Asyncio tasks that drop the tasks of goals whose client stopped waiting."""
        self._is_closed = False
        self._server: ActionServer = node.create_action_server(
            self._type,
            f"{name}/execute",
            self._execute,
            goal=self._accept,
            cancel=self._cancel,
            concurrency=_GOALS,
        )
        manager.change_feed.add_listener(self._on_change)

    def close(self) -> None:
        """End all goals, and accept no more; the tasks stay with the manager."""
        self._is_closed = True
        self._server.destroy()
        for changed in self._changed.values():
            changed.set()

    async def _accept(self, goal: ExecuteTask.Goal) -> bool:
        """Queue the task; it is stored when the goal is accepted."""
        if not self._opened.is_set():
            await self._opened.wait()
        if self._manager.is_closed or self._is_closed:
            raise HandlerError(Code.UNAVAILABLE, "the task server is ending")
        client, account, machine = submitter()
        submitting = asyncio.ensure_future(
            self._manager.submit(
                goal.task_type,
                goal.target,
                goal.priority,
                client=client,
                account=account,
                machine=machine,
            )
        )
        try:
            response = await asyncio.shield(submitting)
        except asyncio.CancelledError:  # the client no longer waits, so there will be no goal
            dropping = asyncio.ensure_future(self._drop(submitting, client))
            self._dropping.add(dropping)
            dropping.add_done_callback(self._dropping.discard)
            raise
        except (StoreError, OutcomeUnknown) as error:
            _log.error("%s", error)
            code = Code.OUTCOME_UNKNOWN if isinstance(error, OutcomeUnknown) else Code.UNAVAILABLE
            raise HandlerError(code, text_for_callers(error)) from error
        if not response.success:
            raise HandlerError(Code.INVALID_ARGUMENT, response.message)
        self._task_ids[_goal_id()] = response.task_id
        return True

    async def _drop(self, submitting: asyncio.Future[TaskResponse], client: str) -> None:
        """Drop a task whose client stopped waiting while the task was being stored."""
        with contextlib.suppress(TaskRpcError):
            response = await submitting
            if response.success:
                await self._manager.cancel(response.task_id, client=client)

    async def _cancel(self, goal: _Goal) -> bool:
        if answering.get() is None:
            return False  # the node ends: the task is interrupted, and not cancelled
        try:
            refuse_others_task(self._manager.repository.find(self._task_ids[goal.goal_id]))
        except Denied as error:
            _log.warning("a goal was not cancelled: %s", error)
            return False
        self._cancelled_by[goal.goal_id] = client_name()
        return True

    async def _execute(self, goal: _Goal) -> ExecuteTask.Result:
        task_id = self._task_ids[goal.goal_id]
        changed = self._changed[task_id] = asyncio.Event()
        cancelling = asyncio.ensure_future(self._cancel_when_requested(goal, task_id, changed))
        try:
            return await self._follow(goal, task_id, changed)
        finally:
            cancelling.cancel()
            del self._changed[task_id], self._task_ids[goal.goal_id]
            self._cancelled_by.pop(goal.goal_id, None)

    async def _cancel_when_requested(
        self, goal: _Goal, task_id: int, changed: asyncio.Event
    ) -> None:
        await goal.wait_for_cancel()
        client = self._cancelled_by.get(goal.goal_id, "")
        try:
            await self._manager.cancel(task_id, client=client)
        except (StoreError, OutcomeUnknown) as error:  # the goal goes on until the task ends
            _log.error("%s", error)
        changed.set()

    async def _follow(
        self, goal: _Goal, task_id: int, changed: asyncio.Event
    ) -> ExecuteTask.Result:
        """Send feedback until the task has ended; return the result."""
        while True:
            changed.clear()
            task = self._manager.repository.find(task_id)
            if task is None:
                raise HandlerError(Code.NOT_FOUND, f"task {task_id} was forgotten")
            if task.state.is_ended:
                return self._ended(goal, task)
            if self._is_closed:
                text = f"the task server has ended; task {task_id} was {task.state.value}"
                raise HandlerError(Code.OUTCOME_UNKNOWN, text)
            goal.publish_feedback(self._feedback(task))
            period = FEEDBACK_PERIOD if task.state.is_begun else QUEUED_PERIOD
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(period):
                    await changed.wait()

    def _ended(self, goal: _Goal, task: Task) -> ExecuteTask.Result:
        result = self._type.Result(
            success=task.state is TaskState.SUCCEEDED,
            message=task.message,
            task_id=task.task_id,
            state=task.state.value,
            result=task.result,
        )
        if task.state is TaskState.CANCELED and goal.is_cancel_requested:
            return goal.canceled(result)
        return result if result.success else goal.abort(result)

    def _feedback(self, task: Task) -> ExecuteTask.Feedback:
        manager = self._manager
        manager.update_estimates()
        feedback = self._type.Feedback(
            task_id=task.task_id,
            state=task.state.value,
            progress=task.progress,
            estimated_time=manager.estimate(task.task_id),
        )
        # In a fleet, another robot may execute the task; it may not have reported a pose yet.
        others = [each for each in manager.robots() if each.name == task.robot and not each.is_own]
        pose = others[0].pose if others else manager.pose()
        if pose is not None:
            feedback.pose.x, feedback.pose.y, feedback.pose.theta = pose.x, pose.y, pose.theta
        return feedback

    def _on_change(self, task_id: int | None) -> None:
        if task_id is not None and (changed := self._changed.get(task_id)) is not None:
            changed.set()


def _goal_id() -> str:
    """Return the id of the goal that the running call sends."""
    request: Any = getattr(current_call(), "request")  # noqa: B009 - only incoming calls have it
    return bytes_of(request.goal_id).hex()
