"""Action clients: send goals, receive their feedback, cancel them and fetch their results."""

from __future__ import annotations

import math
import time
import uuid
import weakref
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Generic, TypedDict

from taskrpc import GoalState
from taskrpc.errors import Code, HandlerFailed
from taskrpc.message_types import Action, FeedbackT, GoalT, ResultT
from taskrpc.spi import ActionMessages, bytes_of, present_chance
from taskrpc.spi import names_of as action_names

from .._impl.actions.goal_ids import shown
from .._impl.actions.server_parts import check_context
from .._impl.node_interface import NodeInterface
from .._impl.reexports import names_of
from ..callback_groups import CallbackGroup
from ..client import Client
from ..executors import await_or_execute
from ..handle import Handle
from ..qos import (
    QoSProfile,
    qos_profile_action_status_default,
    qos_profile_default,
    qos_profile_services_default,
)
from ..service_introspection import ServiceIntrospectionState
from ..subscription import Subscription
from ..task import Future, set_executor
from ..type_support import GetResultServiceResponse, check_is_valid_action_type
from ..waitable import NumberOfEntities, Waitable

if TYPE_CHECKING:
    from ..clock import Clock

_UNCHECKED = "Failed to check if action server is available"
_POLL_INTERVAL = 0.01
"""Seconds between two checks while a program waits for a server."""


class SendGoalKWargs(TypedDict):
    """The options of `ActionClient.send_goal`, for annotations."""

    feedback_callback: Callable[[Any], object] | None
    goal_uuid: Any


class ClientGoalHandle(Generic[GoalT, ResultT, FeedbackT]):
    """A goal that an action client has sent, after the response of the server."""

    def __init__(
        self,
        action_client: ActionClient[GoalT, ResultT, FeedbackT],
        goal_id: Any,
        goal_response: Any,
    ) -> None:
        self._action_client = action_client
        self._goal_id = goal_id
        self._goal_response = goal_response
        self._status = int(GoalState.UNKNOWN)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ClientGoalHandle) and self._goal_id == other.goal_id

    __hash__ = None  # type: ignore[assignment]  # as in ROS

    def __repr__(self) -> str:
        return (
            f"ClientGoalHandle <id={shown(bytes_of(self._goal_id))}, accepted={self.accepted},"
            f" status={self.status}>"
        )

    @property
    def goal_id(self) -> Any:
        """The id of the goal, a `unique_identifier_msgs.msg.UUID`."""
        return self._goal_id

    @property
    def stamp(self) -> Any:
        """When the server accepted the goal, a `builtin_interfaces.msg.Time`."""
        return self._goal_response.stamp

    @property
    def accepted(self) -> bool:
        """Whether the server accepted the goal."""
        return bool(self._goal_response.accepted)

    @property
    def status(self) -> int:
        """The last state that the server reported, a constant of `action_msgs.msg.GoalStatus`."""
        return self._status

    def cancel_goal(self) -> Any:
        """Cancel the goal and wait for the response, while another thread spins the node."""
        return self._action_client._cancel_goal(self)

    def cancel_goal_async(self) -> Future[Any]:
        """Cancel the goal; returns the future of the response of `CancelGoal`."""
        return self._action_client._cancel_goal_async(self)

    def get_result(self) -> Any:
        """Wait for the end of the goal, while another thread spins the node.

        Returns a response with the attributes `status` and `result`.
        """
        return self._action_client._get_result(self)

    def get_result_async(self) -> Future[GetResultServiceResponse[ResultT]]:
        """Return the future of a response with `status` and `result`, done when the goal ends."""
        return self._action_client._get_result_async(self)


class _PartClient(Client[Any, Any]):
    """A client of one service of an action."""

    def _as_in_ros(
        self, response: Any, error: BaseException | None
    ) -> tuple[Any, BaseException | None]:
        """Replace the error of a rejected or aborted goal by the response that ROS defines for it.

        A server of the native API sends an error with the reason; a server of ROS cannot.

        The future keeps the error if the callback that accepts goals raised an exception, and if
        the server ended before the goal.
        """
        if not isinstance(error, HandlerFailed):
            return response, error
        made = self.srv_type.Response()
        is_result = hasattr(made, "status")
        if error.code is (Code.UNAVAILABLE if is_result else Code.INTERNAL):
            return response, error
        if is_result:
            made.status = int(GoalState.ABORTED)
        return made, None


class ActionClient(Waitable[Any], Generic[GoalT, ResultT, FeedbackT]):
    """Sends goals to one action.

    Responses and feedback arrive only while a thread spins the node. `destroy` ends it.
    """

    def __init__(
        self,
        node: NodeInterface,
        action_type: type[Action[GoalT, ResultT, FeedbackT]],
        action_name: str,
        *,
        callback_group: CallbackGroup | None = None,
        goal_service_qos_profile: QoSProfile = qos_profile_services_default,
        result_service_qos_profile: QoSProfile = qos_profile_services_default,
        cancel_service_qos_profile: QoSProfile = qos_profile_services_default,
        feedback_sub_qos_profile: QoSProfile = qos_profile_default,
        status_sub_qos_profile: QoSProfile = qos_profile_action_status_default,
    ) -> None:
        node.handle.check_waitables()
        group = node.default_callback_group if callback_group is None else callback_group
        super().__init__(group)
        check_is_valid_action_type(action_type)
        remapped = node.resolve_topic_name(action_name)  # raises for an invalid name
        check_context(node.context, "client")
        self._node = self.parent_node = node
        self._action_type: Any = action_type
        self._action_name = action_name
        self._logger = node.get_logger().get_child("action_client")
        self._handle = Handle(self)
        self._goal_handles: dict[bytes, weakref.ref[ClientGoalHandle[Any, Any, Any]]] = {}
        """The accepted goals that have not ended, by id."""
        self._feedback_callbacks: dict[bytes, Callable[[Any], Any]] = {}
        self._unanswered: set[bytes] = set()
        """The goals without a response of the server. Their feedback waits: over another connection
        it may arrive before the response, and in ROS it comes after."""
        names = action_names(remapped)
        self._messages = messages = ActionMessages(action_type)

        def client(kind: Any, name: str, qos: QoSProfile) -> Client[Any, Any]:
            return _PartClient(node, kind, node.resolve_service_name(name), qos, group)

        def subscription(kind: Any, name: str, take: Any, qos: QoSProfile) -> Subscription[Any]:
            return Subscription(node, kind, node.resolve_topic_name(name), take, group, qos)

        self._send = client(messages.send_goal, names.send_goal, goal_service_qos_profile)
        self._cancel = client(messages.cancel_goal, names.cancel_goal, cancel_service_qos_profile)
        self._result = client(messages.get_result, names.get_result, result_service_qos_profile)
        self._feedback = subscription(
            messages.feedback, names.feedback, self._on_feedback, feedback_sub_qos_profile
        )
        self._status = subscription(
            messages.status, names.status, self._on_status, status_sub_qos_profile
        )
        self.clients = self._send, self._cancel, self._result
        """The clients that it consists of, for the diagnostics."""
        self._parts: tuple[Client[Any, Any] | Subscription[Any], ...]
        self._parts = (*self.clients, self._feedback, self._status)
        node.add_waitable(self)

    # Goals

    def send_goal(
        self,
        goal: GoalT,
        feedback_callback: Callable[[Any], Any] | None = None,
        goal_uuid: Any = None,
    ) -> Any:
        """Send a goal and wait for its end, while another thread spins the node.

        Returns a response with the attributes `status` and `result`. Raises TypeError for a goal of
        another type.
        """
        request = self._request(goal, feedback_callback, goal_uuid)
        try:
            response = self._send.call(request)
        finally:
            self._end_wait(request)
        return self._get_result(self._goal_answered(request.goal_id, response))

    def send_goal_async(
        self,
        goal: GoalT,
        feedback_callback: Callable[[Any], Any] | None = None,
        goal_uuid: Any = None,
    ) -> Future[ClientGoalHandle[GoalT, ResultT, FeedbackT]]:
        """Send a goal; returns the future of its handle, done when the server has responded.

        `feedback_callback(message)` receives messages with the attributes `goal_id` and `feedback`.
        `goal_uuid` is the id of the goal, by default a random one. Raises TypeError for a goal of
        another type.
        """
        request = self._request(goal, feedback_callback, goal_uuid)
        try:
            answer = self._send.call_async(request)
        except BaseException:
            self._end_wait(request)
            raise
        future: Future[ClientGoalHandle[GoalT, ResultT, FeedbackT]] = Future()

        def answered() -> None:
            self._end_wait(request)
            if (executor := self._node.executor) is not None:
                set_executor(future, executor)
            if (error := answer.exception()) is not None:
                future.set_exception(error)
                future.exception()  # marks it as retrieved: the client has reported the error
            elif future.cancelled():
                self._logger.warning(
                    "Ignoring unexpected goal response. There may be more than one action server"
                    f" for the action '{self._action_name}'"
                )
            else:
                future.set_result(self._goal_answered(request.goal_id, answer.result()))

        answer.when_done(answered)
        return future

    def _request(
        self, goal: GoalT, feedback_callback: Callable[[Any], Any] | None, goal_uuid: Any
    ) -> Any:
        expected = self._action_type.Goal
        if not isinstance(goal, expected):
            raise TypeError(f"Expected goal type ({expected}) but received ({type(goal)})")
        self._handle.check()
        request = self._messages.send_goal.Request()
        request.goal_id = self._messages.goal_id(_random_id()) if goal_uuid is None else goal_uuid
        request.goal = goal
        key = bytes_of(request.goal_id)
        if feedback_callback is not None:
            self._feedback_callbacks[key] = feedback_callback
        self._unanswered.add(key)
        return request

    def _end_wait(self, request: Any) -> None:
        """Let the feedback of a goal be handled: its request has ended."""
        self._unanswered.discard(bytes_of(request.goal_id))
        self.notify_executor()

    def _goal_answered(
        self, goal_id: Any, response: Any
    ) -> ClientGoalHandle[GoalT, ResultT, FeedbackT]:
        handle: ClientGoalHandle[GoalT, ResultT, FeedbackT]
        handle = ClientGoalHandle(self, goal_id, response)
        key = bytes_of(goal_id)
        if not handle.accepted:
            self._feedback_callbacks.pop(key, None)
            return handle
        if key in self._goal_handles:
            raise RuntimeError(f"Two goals were accepted with the same ID ({handle})")
        self._goal_handles[key] = weakref.ref(handle)
        return handle

    def _cancel_goal(self, goal_handle: ClientGoalHandle[GoalT, ResultT, FeedbackT]) -> Any:
        return self._cancel.call(self._cancel_request(goal_handle))

    def _cancel_goal_async(
        self, goal_handle: ClientGoalHandle[GoalT, ResultT, FeedbackT]
    ) -> Future[Any]:
        return self._cancel.call_async(self._cancel_request(goal_handle))

    def _cancel_request(self, goal_handle: ClientGoalHandle[GoalT, ResultT, FeedbackT]) -> Any:
        _check_handle(goal_handle)
        request = self._messages.cancel_goal.Request()
        request.goal_info.goal_id = goal_handle.goal_id
        return request

    def _get_result(self, goal_handle: ClientGoalHandle[GoalT, ResultT, FeedbackT]) -> Any:
        response = self._result.call(self._result_request(goal_handle))
        self._feedback_callbacks.pop(bytes_of(goal_handle.goal_id), None)
        return response

    def _get_result_async(
        self, goal_handle: ClientGoalHandle[GoalT, ResultT, FeedbackT]
    ) -> Future[Any]:
        request = self._result_request(goal_handle)
        future = self._result.call_async(request)
        key = bytes_of(request.goal_id)

        def ended() -> None:
            # A task, as in ROS: feedback that was taken together with the result is still handled.
            if (executor := self._node.executor) is not None:
                executor.create_task(self._feedback_callbacks.pop, key, None)
            else:
                self._feedback_callbacks.pop(key, None)

        future.when_done(ended)
        return future

    def _result_request(self, goal_handle: ClientGoalHandle[GoalT, ResultT, FeedbackT]) -> Any:
        _check_handle(goal_handle)
        return self._messages.get_result.Request(goal_id=goal_handle.goal_id)

    # The server

    def server_is_ready(self) -> bool:
        """Whether a server of the action is known; raises RCLError after the shutdown."""
        self._node.handle.check()
        self._handle.check()
        self._node.context.check(_UNCHECKED)
        topics = self._feedback, self._status
        return all(client.service_is_ready() for client in self.clients) and all(
            topic.get_publisher_count() for topic in topics
        )

    def wait_for_server(self, timeout_sec: float | None = None) -> bool:
        """Wait for a server of the action, at most `timeout_sec` seconds; False without one.

        Raises RCLError when a signal has shut the context down, InvalidHandle when the program has.
        """
        end = math.inf if timeout_sec is None else time.monotonic() + timeout_sec
        while self._node.context.ok() and not self.server_is_ready():
            left = end - time.monotonic()
            if left <= 0:
                return False
            time.sleep(min(left, _POLL_INTERVAL))
        is_ready = self.server_is_ready()
        if not self._node.context.ok():  # another thread is shutting it down
            self._node.context.refuse(_UNCHECKED)
        return is_ready

    def configure_introspection(
        self,
        clock: Clock,
        service_event_qos_profile: QoSProfile,
        introspection_state: ServiceIntrospectionState,
    ) -> None:
        """Publish the introspection events of the calls of its three services, or stop."""
        self._handle.check()
        for client in self.clients:
            client.configure_introspection(clock, service_event_qos_profile, introspection_state)

    def destroy(self) -> None:
        """End the client; goals that the server executes continue."""
        if self._handle.valid:
            self._handle.destroy_when_not_in_use()
            self._node.remove_waitable(self)
            for part in self._parts:
                part.destroy()

    node_destroyed = destroy

    # Waitable

    def has_work(self) -> bool:
        """Whether a response, feedback or a status waits to be taken."""
        return any(part.has_work() for part in self._parts if self._may_take(part))

    def is_ready(self, wait_set: Any) -> bool:
        """Whether a response, feedback or a status waits to be taken."""
        return self.has_work()

    def take_data(self) -> list[Callable[[], Any]]:
        """Take one message of each kind; returns the functions that handle them."""
        self._handle.check()
        # The order of these checks matters, as messages arrive between them: the response to a
        # cancellation arrives before the result, and a result ends the feedback.
        checked = (self._result, self._cancel, self._send, self._feedback, self._status)
        ready = [part for part in checked if part.has_work() and self._may_take(part)]
        if self._cancel in ready and self._result in ready:
            # The callbacks of one round run in the opposite order. The result waits for the next.
            ready.remove(self._result)
        taken = [part.take_work() for part in self._parts if part in ready]
        return [handle for handle in taken if handle is not None]

    async def execute(self, taken_data: list[Callable[[], Any]]) -> None:
        """Complete the futures, and call the callbacks of feedback."""
        for handle in taken_data:
            result = handle()
            if result is not None:
                await result

    def get_num_entities(self) -> NumberOfEntities:
        """How many clients and subscriptions it consists of."""
        return NumberOfEntities(num_subs=2, num_clients=3)

    def _may_take(self, part: Client[Any, Any] | Subscription[Any]) -> bool:
        """Whether the oldest message of a part may be taken: feedback waits for the response."""
        if part is not self._feedback or not self._unanswered:
            return True
        try:
            oldest = self._feedback.oldest_message()
        except IndexError:  # another thread took it
            return True
        return bytes_of(oldest.goal_id) not in self._unanswered

    def _on_feedback(self, message: Any) -> Any:
        callback = self._feedback_callbacks.get(bytes_of(message.goal_id))
        return None if callback is None else await_or_execute(callback, message)

    def _on_status(self, message: Any) -> None:
        for each in message.status_list:
            key = bytes_of(each.goal_info.goal_id)
            known = self._goal_handles.get(key)
            if known is None:
                continue
            if (handle := known()) is not None:
                handle._status = each.status
            if handle is None or GoalState(each.status).is_ended:
                self._goal_handles.pop(key, None)


def _random_id() -> bytes:
    return uuid.UUID(bytes=present_chance().randbytes(16), version=4).bytes


def _check_handle(goal_handle: Any) -> None:
    if not isinstance(goal_handle, ClientGoalHandle):
        raise TypeError(f"Expected type ClientGoalHandle but received {type(goal_handle)}")


__getattr__ = names_of(
    __name__,
    __package__,
    {
        "action_msgs/msg": "GoalStatus",
        "action_msgs/srv": "CancelGoal",
        "unique_identifier_msgs/msg": "UUID",
        "builtin_interfaces/msg": "Time",
    },
)
