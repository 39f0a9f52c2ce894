"""Services of ROS 2: this program's, as ROS programs call them, and theirs, as it calls them."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import Any

from srvgen import FieldError
from taskrpc.errors import InvalidRequest, OutcomeUnknown, TaskRpcError
from taskrpc.middleware.ros import qualities
from taskrpc.middleware.ros.conversion import from_ros, to_ros
from taskrpc.spi import Handoff, NativeReply, OnDone, ServiceType

log = logging.getLogger("taskrpc.transport")

_POLL = 0.005
"""Seconds between two looks whether DDS has connected a client with the server."""
_LONGEST_POLL = 0.1
_MAX_TEXT = 500
"""The most characters of an error in a response."""


class NativeServer:
    """A service of this program, for ROS programs."""

    def __init__(
        self,
        ros: Any,
        node: Any,
        name: str,
        types: tuple[ServiceType, Any],
        serve: Callable[[Any, NativeReply], None],
        handoff: Handoff,
    ) -> None:
        self._srv_type, ros_type = types
        self._request = from_ros(self._srv_type.Request, ros_type.Request)
        self.response = to_ros(self._srv_type.Response, ros_type.Response)
        self.response_class = self._srv_type.Response
        self.name = name
        self._serve = serve
        self._handoff = handoff
        self._node = node
        profile = qualities.service_profile(ros)
        # rclpy passes what the callback returns to `send_response`, together with the header of the
        # request. The response comes later, so the callback returns the request, and this object
        # keeps the header.
        self._service = node.create_service(ros_type, name, _request, qos_profile=profile)
        self._send = self._service.send_response
        self._service.send_response = self._on_thread
        self._is_closed = False

    def close(self) -> None:
        """Stop serving it; calls in flight get no response."""
        if not self._is_closed:
            self._is_closed = True
            self._node.destroy_service(self._service)

    def send(self, response: Any, header: Any) -> None:
        """Send a response of ROS's class."""
        if not self._is_closed:
            self._send(response, header)

    def _on_thread(self, request: Any, header: Any) -> None:
        self._handoff.put(self._arrived, request, header)

    def _arrived(self, request: Any, header: Any) -> None:
        if self._is_closed:
            return
        reply = _Reply(self, header)
        message = self._request(request)
        try:
            message._check()
        except FieldError as error:
            reply.fail(InvalidRequest(error.path, error.problem))
            return
        self._serve(message, reply)


def _request(request: Any, _: Any) -> Any:
    return request


class _Reply:
    """Sends the response to one request of a ROS program."""

    caller = ""

    def __init__(self, server: NativeServer, header: Any) -> None:
        self._server = server
        self._header = header

    def reply(self, response: Any) -> None:
        """Send the response."""
        self._server.send(self._server.response(response), self._header)

    def fail(self, error: TaskRpcError) -> None:
        """Send the error in the fields `success` and `message`; without them, send nothing."""
        response = refusal(self._server.response_class, str(error))
        name = self._server.name
        if response is None:
            log.warning(
                "a call of a ROS program to %s failed, and it gets no response: %s", name, error
            )
        else:
            log.warning("a call of a ROS program to %s failed: %s", name, error)
            self.reply(response)


def refusal(response_class: Any, text: str) -> Any:
    """Return a response that says why a call failed; None if the class cannot say it.

    Many services of ROS have `bool success` and `string message`, such as std_srvs/srv/Trigger.
    """
    fields = dict(response_class._FIELDS)
    if fields.get("success") == "bool" and fields.get("message") == "string":
        return response_class(success=False, message=text[:_MAX_TEXT])
    return None


class NativeClient:
    """A client of one native service; used on the event loop."""

    def __init__(
        self, node: Any, name: str, types: tuple[ServiceType, Any], handoff: Handoff
    ) -> None:
        srv_type, ros_type = types
        self.name = name
        self.handoff = handoff
        self.request = to_ros(srv_type.Request, ros_type.Request)
        self.response = from_ros(srv_type.Response, ros_type.Response)
        self.node = node
        self.client = node.create_client(ros_type, name)

    def call(self, request: Any, on_done: OnDone) -> NativeCall:
        """Send a request as soon as DDS has connected the client with a server."""
        try:
            request._check()
            message = self.request(request)
        except FieldError as error:
            raise InvalidRequest(error.path, error.problem) from None
        call = NativeCall(self, message, on_done)
        call.begin()
        return call

    def close(self) -> None:
        """Destroy the client."""
        self.node.destroy_client(self.client)


class NativeCall:
    """A call to a native server."""

    def __init__(self, client: NativeClient, request: Any, on_done: OnDone) -> None:
        self._client = client
        self._request = request
        self._on_done = on_done
        self._future: Any = None
        """rclpy's future; None until the request is sent."""
        self._timer: asyncio.TimerHandle | None = None
        self._poll = _POLL
        self._is_over = False

    def begin(self) -> None:
        """Send the request, or try again later: without a server, rclpy would lose it."""
        if self._is_over:
            return
        client = self._client.client
        if not client.service_is_ready():
            loop = asyncio.get_running_loop()
            self._timer = loop.call_later(self._poll, self.begin)
            self._poll = min(2 * self._poll, _LONGEST_POLL)
            return
        try:
            self._future = client.call_async(self._request)
        except Exception as error:  # rclpy's own errors have no common class
            self._client.handoff.put(self._end, None, OutcomeUnknown(f"ROS 2: {error}"))
            return
        self._future.add_done_callback(self._done_on_thread)

    def cancel(self) -> None:
        """Stop waiting; ROS has no message that cancels a call."""
        self._is_over = True
        if self._timer is not None:
            self._timer.cancel()
        if self._future is not None:
            self._client.client.remove_pending_request(self._future)

    def _done_on_thread(self, future: Any) -> None:
        self._client.handoff.put(self._done, future)

    def _done(self, future: Any) -> None:
        if future.exception() is not None:
            self._end(None, OutcomeUnknown(f"ROS 2: {future.exception()}"))
        elif not future.cancelled():
            self._end(self._client.response(future.result()), None)

    def _end(self, response: Any, error: TaskRpcError | None) -> None:
        if not self._is_over:
            self._is_over = True
            self._on_done(response, error)


class Unserved:
    """A service that ROS programs cannot call."""

    def close(self) -> None:
        """Do nothing."""
