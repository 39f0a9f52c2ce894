"""Service introspection: each step of a service's calls, told on `SERVICE/_service_event`.

The events are those of ROS 2: `taskrpc service echo` prints them for all kinds of programs.
"""

from __future__ import annotations

import hashlib
import logging
import time
from typing import Any, Literal, TypeAlias

import srvgen
from taskrpc.callinfo import CallInfo
from taskrpc.errors import InvalidRequest, TaskRpcError
from taskrpc.observer import Observer
from taskrpc.topic import Publisher

log = logging.getLogger("taskrpc.topics")

IntrospectionState: TypeAlias = Literal["off", "metadata", "contents"]
"""How much is told: nothing, that something happened, or the messages, too."""

SUFFIX = "/_service_event"


class ServiceEvents(Observer):
    """Publishes what becomes of one service's calls; nothing while nobody subscribes."""

    def __init__(self, publisher: Publisher[Any], srv_type: Any, *, contents: bool) -> None:
        self.publisher = publisher
        self._srv_type = srv_type
        self._contents = contents
        self._has_failed = False

    def call_began(self, call: CallInfo) -> None:
        """A request came."""
        self._tell("REQUEST_RECEIVED", call, request=getattr(call, "request", None))

    def call_answered(self, call: CallInfo, response: Any) -> None:
        """Its response goes back."""
        self._tell("RESPONSE_SENT", call, response=response)

    def _tell(self, step: str, call: CallInfo, **messages: Any) -> None:
        if not self.publisher.get_subscription_count():
            return
        told = messages if self._contents else {}
        gid, stamp = gid_of(call.caller), time.time_ns()
        event = service_event(self._srv_type, step, stamp, gid, call.number, **told)
        try:
            self.publisher.publish(event)
        except InvalidRequest as error:  # with what is around it, it has grown too large
            if not self._has_failed:
                self._has_failed = True
                log.warning("%s lacks an event: %s", self.publisher.topic_name, error)
        except TaskRpcError:
            pass  # a call's answer may come after the publisher's end


def service_event(
    srv_type: Any,
    step: str,
    stamp: int,
    gid: list[int],
    number: int,
    request: Any = None,
    response: Any = None,
) -> Any:
    """The event of a step, by its name in ServiceEventInfo; `stamp` in ns since 1970."""
    info_type = srvgen.load("service_msgs/msg/ServiceEventInfo")
    event = srv_type.Event()
    event.info = info_type(
        event_type=getattr(info_type, step), client_gid=gid, sequence_number=number
    )
    event.info.stamp.sec, event.info.stamp.nanosec = divmod(stamp, 10**9)
    event.request = [] if request is None else [request]
    event.response = [] if response is None else [response]
    return event


def gid_of(*parts: object) -> list[int]:
    """Sixteen numbers that tell one endpoint from every other."""
    return list(hashlib.sha256("\n".join(map(str, parts)).encode()).digest()[:16])
