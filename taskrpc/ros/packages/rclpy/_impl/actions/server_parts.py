"""The three services and two publishers that an action server consists of."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

from taskrpc.errors import NameInUse
from taskrpc.spi import ActionMessages, GoalRecord, names_of

from ...callback_groups import CallbackGroup
from ...publisher import Publisher
from ...service import RequestHeader, Service
from ..bridge import settle
from ..graph.endpoints import has_client_here
from ..node_interface import NodeInterface

if TYPE_CHECKING:
    from ...clock import Clock
    from ...context import Context
    from ...qos import QoSProfile
    from ...service_introspection import ServiceIntrospectionState


def check_context(context: Context, kind: str) -> None:
    """Raise ValueError after the shutdown, as ROS does for an action client or server."""
    if context.is_over:
        raise ValueError(f"Failed to create action {kind}: rcl node's context is invalid")


class Profiles(NamedTuple):
    """The QoS profiles of the services and the publishers."""

    goal: QoSProfile
    result: QoSProfile
    cancel: QoSProfile
    feedback: QoSProfile
    status: QoSProfile


class Taken(NamedTuple):
    """A request that was taken from one of the services."""

    service: Service[Any, Any]
    header: RequestHeader
    request: Any


class ServerParts:
    """The services and publishers of one action server; not listed among those of its node.

    Raises NameInUse when another program offers the action.
    """

    def __init__(
        self,
        node: NodeInterface,
        messages: ActionMessages,
        action_name: str,
        group: CallbackGroup,
        profiles: Profiles,
    ) -> None:
        self._node = node
        self._messages = messages
        self._group = group
        self._made: list[Service[Any, Any] | Publisher[Any]] = []
        names = names_of(action_name)
        try:
            self.goals = self._service(messages.send_goal, names.send_goal, profiles.goal)
            self.cancels = self._service(messages.cancel_goal, names.cancel_goal, profiles.cancel)
            self.results = self._service(messages.get_result, names.get_result, profiles.result)
            self._feedback = self._publisher(messages.feedback, names.feedback, profiles.feedback)
            self._status = self._publisher(messages.status, names.status, profiles.status)
        except BaseException as error:
            self.destroy()
            if isinstance(error, NameInUse):
                # As for a service: the user needs only this error, and rclpy cannot join.
                raise error.without_join() from None
            raise
        self.services = self.goals, self.cancels, self.results

    def _service(self, srv_type: Any, name: str, qos: QoSProfile) -> Service[Any, Any]:
        made: Service[Any, Any] = Service(
            self._node, srv_type, self._node.resolve_service_name(name), _untaken, self._group, qos
        )
        self._made.append(made)
        return made

    def _publisher(self, msg_type: Any, name: str, qos: QoSProfile) -> Publisher[Any]:
        made: Publisher[Any] = Publisher(
            self._node, msg_type, self._node.resolve_topic_name(name), qos, self._group
        )
        self._made.append(made)
        return made

    def has_work(self) -> bool:
        """Whether a request waits to be taken."""
        return any(service.has_work() for service in self.services)

    def take(self) -> Iterator[Taken]:
        """Take the oldest request of each service."""
        for service in self.services:
            request, header = service.handle.service_take_request(None)
            if header is not None:
                yield Taken(service, header, request)

    def publish_status(self, goals: Iterable[GoalRecord]) -> None:
        """Publish the states of goals."""
        self._status.publish_own(self._messages.statuses(goals))

    def publish_feedback(self, goal_id: Any, feedback: Any) -> None:
        """Publish the feedback of a goal."""
        self._feedback.publish(self._messages.feedback(goal_id=goal_id, feedback=feedback))

    def settle(self) -> None:
        """Wait a moment if this program itself calls the services, so that its messages arrive.

        As in ROS, the next round of its executor then has the response, feedback and events.
        """
        if any(has_client_here(service.service_name) for service in self.services):
            settle()

    def configure_introspection(
        self, clock: Clock, qos_profile: QoSProfile, state: ServiceIntrospectionState
    ) -> None:
        """Publish the introspection events of the services, or stop."""
        for service in self.services:
            service.configure_introspection(clock, qos_profile, state)

    def destroy(self) -> None:
        """Withdraw the services and stop publishing."""
        for part in self._made:
            part.destroy()


def _untaken(request: Any, response: Any) -> Any:
    """Replace the callback of a service whose requests the action server takes itself."""
    raise NotImplementedError
