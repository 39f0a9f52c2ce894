"""Services: a callback answers requests, on the thread that spins the node."""

from __future__ import annotations

import contextlib
import time
from collections import deque
from collections.abc import Callable
from types import CoroutineType
from typing import TYPE_CHECKING, Any, ClassVar, Generic, NamedTuple, Self, TypeVar

from taskrpc.errors import Code, HandlerFailed, InvalidRequest, WouldDeadlock
from taskrpc.spi import gid_of

from ._impl.bridge import detached
from ._impl.diagnostics import explain
from ._impl.diagnostics.limits import depth_of, wrapped_or_refused
from ._impl.execution.entity import Entity
from ._impl.node_interface import NodeInterface
from ._impl.reexports import names_of
from .callback_groups import CallbackGroup
from .handle import ArrivalHandle
from .service_introspection import Introspection, ServiceIntrospectionState

if TYPE_CHECKING:
    from taskrpc.deferred import DeferredCall

    from .clock import Clock
    from .qos import QoSProfile

SrvRequestT = TypeVar("SrvRequestT")
SrvResponseT = TypeVar("SrvResponseT")


class RequestHeader(NamedTuple):
    """Identifies a request that the program took from the handle, for `send_response`."""

    call: DeferredCall[Any, Any]
    source_timestamp: int
    """Nanoseconds since the epoch."""


class Service(Entity, Generic[SrvRequestT, SrvResponseT]):
    """Answers the requests for one service; `Node.create_service` creates it."""

    is_service: ClassVar[bool] = True

    def __init__(
        self,
        node: NodeInterface,
        srv_type: Any,
        srv_name: str,
        callback: Callable[..., Any],
        callback_group: CallbackGroup,
        qos_profile: Any,
    ) -> None:
        node.context.check("failed to create service")
        self.parent_node = node
        self.srv_type = srv_type
        self._full_name = self.srv_name = srv_name
        self.callback = callback
        of = f"the callback of {srv_name}"
        explain.callback_parameters(callback, of, "a request", "a response")
        self.callback_group = callback_group
        self.qos_profile = qos_profile
        self.handle = ServiceHandle(self)
        self._calls: deque[DeferredCall[Any, Any]] = deque()
        self._depth = depth_of(qos_profile)
        self._last: Callable[[], object] | None = None
        """A function to call after the running callback has answered."""
        self._introspection = Introspection(node, srv_type, srv_name)
        self.is_of_every_node = join = srv_type._TYPE.startswith(_OF_EVERY_NODE)
        """Whether the service is not the program's own, such as those of parameters."""
        self._offered = node.handle.bridge.offer(srv_type, srv_name, self._on_request, join=join)

    @property
    def service_name(self) -> str:
        """Its absolute name."""
        return self._full_name

    @property
    def logger_name(self) -> str:
        """The name of the logger of its node."""
        self.handle.check()
        return str(self.parent_node.get_logger().name)

    def oldest_request_id(self) -> int:
        """A number that identifies the oldest waiting request; IndexError when no request waits."""
        return id(self._calls[0])

    def send_response(self, response: SrvResponseT, header: RequestHeader) -> None:
        """Answer a request that was taken by its header; raises TypeError for another type."""
        self.handle.check()
        self._reply(header.call, response)

    def configure_introspection(
        self,
        clock: Clock,
        service_event_qos_profile: QoSProfile,
        introspection_state: ServiceIntrospectionState,
    ) -> None:
        """Publish the introspection events of the calls on `SERVICE/_service_event`, or stop."""
        self.handle.check()
        self._introspection.configure(clock, service_event_qos_profile, introspection_state)

    def destroy(self) -> None:
        """Withdraw the service; use it through `Node.destroy_service`, or `with`."""
        if self.handle.valid:
            self.handle.destroy_when_not_in_use()
            self._offered.close()
            self._introspection.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.parent_node.destroy_service(self)

    # On the thread of the event loop

    def _on_request(self, call: DeferredCall[Any, Any]) -> None:
        self._calls.append(call)
        if len(self._calls) > self._depth:
            if not explain.like_ros():
                explain.too_many_requests(self._full_name, self._depth)
            else:  # the oldest is never answered
                with contextlib.suppress(IndexError):
                    self._calls.popleft()
        self.notify_executor()
        self.handle.item_arrived()

    # On the spinning thread

    def when_answered(self, last: Callable[[], object]) -> None:
        """Call a function after the callback that runs on this thread has answered."""
        self._last = last

    def has_work(self) -> bool:
        """Whether a request waits to be taken."""
        return bool(self._calls)

    def take_work(self) -> Callable[[], Any] | None:
        """Take the oldest request and return the function that answers it."""
        self.handle.check()
        call = self._next()
        return None if call is None else lambda: self._serve(call)

    def _next(self) -> DeferredCall[Any, Any] | None:
        try:
            return self._calls.popleft()
        except IndexError:  # another thread took it
            return None

    def begin(self, call: DeferredCall[Any, Any]) -> None:
        """Note that the program begins a call."""
        call.started()
        if self._introspection.is_on:
            self._introspect(call, "REQUEST_RECEIVED", request=call.request)

    def _serve(self, call: DeferredCall[Any, Any]) -> Any:
        self.begin(call)
        try:
            response = self.callback(call.request, self.srv_type.Response())
            if type(response) is CoroutineType:
                return self._serve_async(call, response)
        except BaseException as error:
            self.raised(call, error)
            raise
        self._answer(call, response)
        return None

    async def _serve_async(
        self, call: DeferredCall[Any, Any], answer: CoroutineType[Any, Any, Any]
    ) -> None:
        try:
            response = await answer
        except BaseException as error:
            self.raised(call, error)
            raise
        self._answer(call, response)

    def _answer(self, call: DeferredCall[Any, Any], response: Any) -> None:
        """Send the value that the callback returned."""
        try:
            if self.parent_node.context.ok() and not self.handle.valid:
                self._destroyed(call)
            self._reply(call, response)
        finally:
            self._leave()

    def _destroyed(self, call: DeferredCall[Any, Any]) -> None:
        """Raise InvalidHandle, as ROS does: the callback destroyed its own service."""
        if not explain.like_ros():
            explain.service_destroyed(self._full_name)
            why = f"the callback of {self._full_name} destroyed its service before it returned"
            call.fail(HandlerFailed(Code.INTERNAL, why))
        self.handle.check()

    def _leave(self) -> None:
        if self._last is not None:
            last, self._last = self._last, None
            last()

    def _reply(self, call: DeferredCall[Any, Any], response: Any) -> None:
        expected = self.srv_type.Response
        if not isinstance(response, expected):
            if explain.like_ros():
                raise TypeError
            problem = f"the callback of {self._full_name} returned {_what(response)}"
            if response is None:
                problem += f"; is `return response` ({expected.__name__}) missing at its end?"
            else:
                problem += f", expected {expected.__name__}"
            explain.invalid_response(self._full_name, problem)
            call.fail(HandlerFailed(Code.INTERNAL, problem))
            raise TypeError(problem)
        response = detached(response)
        try:
            self._send(call, response)
        except InvalidRequest as error:
            if not explain.like_ros():
                why = f"the response of {self._full_name}: {error}"
                call.fail(HandlerFailed(Code.INTERNAL, why))
            raise
        if self._introspection.is_on:
            self._introspect(call, "RESPONSE_SENT", response=response)

    def _send(self, call: DeferredCall[Any, Any], response: Any) -> None:
        try:
            call.reply(response)
        except InvalidRequest as error:
            call.reply(wrapped_or_refused(response, self._full_name, error))

    def _introspect(self, call: DeferredCall[Any, Any], step: str, **messages: Any) -> None:
        info = call.info
        self._introspection.publish(step, gid_of(info.caller), info.number, **messages)

    def raised(self, call: DeferredCall[Any, Any], error: BaseException) -> None:
        """Tell the caller that the callback raised this."""
        if explain.like_ros():
            self._leave()
            return
        what = type(error).__name__
        if str(error) and not isinstance(error, WouldDeadlock):  # which has been explained in full
            what += f": {error}"
        problem = f"the callback of {self._full_name} raised {what}"
        # A program whose context was shut down while the callback ran needs no advice.
        of_itself = isinstance(error, Exception) and self.parent_node.context.ok()
        if of_itself and not isinstance(error, WouldDeadlock):
            explain.callback_raised(self._full_name, problem)
        call.fail(HandlerFailed(Code.INTERNAL, problem))
        self._leave()


class ServiceHandle(ArrivalHandle):
    """`Service.handle`: a program may take requests from it instead of by a callback."""

    def service_take_request(self, pymsg_type: Any) -> tuple[Any, Any]:
        """Take a request and its header; (None, None) when none waits."""
        self.check()
        call = self.owner._next()
        if call is None:
            return (None, None)
        self.owner.begin(call)
        return call.request, RequestHeader(call, time.time_ns())

    set_on_new_request_callback = ArrivalHandle.set_on_new_callback
    clear_on_new_request_callback = ArrivalHandle.clear_on_new_callback


_OF_EVERY_NODE = ("rcl_interfaces/", "type_description_interfaces/")
"""Services that every node has: ROS allows nodes of one name in several programs."""


def _what(response: Any) -> str:
    if isinstance(response, type):
        return f"the class {response.__name__}"
    return "nothing" if response is None else f"a value of the type {type(response).__name__}"


__getattr__ = names_of(
    __name__,
    __package__,
    {".type_support": "SrvType SrvTypeRequest SrvTypeResponse", ".qos": "QoSProfile"},
)
