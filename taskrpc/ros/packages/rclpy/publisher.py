"""Publishers send messages to the subscriptions of a topic."""

from __future__ import annotations

from typing import Any, Generic, Self, TypeVar

from srvgen import from_cdr

from ._impl.bridge import detached
from ._impl.graph.endpoints import forget_profile, remember_profile
from ._impl.node_interface import NodeInterface
from ._impl.reexports import names_of
from .callback_groups import CallbackGroup
from .duration import Duration
from .endpoint_info import EndpointTypeEnum
from .event_handler import Events
from .handle import Handle

MsgT = TypeVar("MsgT")


class Publisher(Generic[MsgT]):
    """Publishes messages of one type on a topic; `Node.create_publisher` creates it."""

    def __init__(
        self,
        node: NodeInterface,
        msg_type: Any,
        topic: str,
        qos_profile: Any,
        callback_group: CallbackGroup,
        events: Events | None = None,
    ) -> None:
        self._context = node.context
        self._context.check("Failed to create publisher")
        self.parent_node = node
        self.msg_type = msg_type
        self._full_name = self.topic = topic
        self.qos_profile = qos_profile
        self.callback_group = callback_group
        self.handle = Handle(self)
        self._events = events
        self._timed = events if events is not None and events.are_timed else None
        """The events, if they depend on when messages are published."""
        self.event_handlers = [] if events is None else events.create_handlers(self.handle)
        mismatch = None if events is None else events.mismatch
        native = qos_profile.to_native()
        self._native = node.handle.bridge.publisher(msg_type, topic, native, mismatch)
        if events is not None:
            events.watch(self._native)
        node_name = node.get_fully_qualified_name()
        remember_profile(self, EndpointTypeEnum.PUBLISHER, node_name, topic, qos_profile)

    @property
    def topic_name(self) -> str:
        """The absolute name of the topic."""
        self.handle.check()
        return self._full_name

    @property
    def logger_name(self) -> str:
        """The name of the logger of its node."""
        self.handle.check()
        return str(self.parent_node.get_logger().name)

    def publish(self, msg: MsgT | bytes) -> None:
        """Send a message, or the bytes of `serialize_message`, without waiting.

        Raises TypeError for another type, InvalidRequest for a value that does not fit its field,
        RCLError after the shutdown.
        """
        self.handle.check()
        if self._context.is_over:
            self._check("Failed to publish")
        message: Any = from_cdr(self.msg_type, msg) if isinstance(msg, bytes) else msg
        if not isinstance(message, self.msg_type):
            raise TypeError(f"Expected {self.msg_type}, got {type(message)}")
        self.publish_own(detached(message))

    def publish_own(self, message: MsgT) -> None:
        """Send a message that the program does not know, so that no copy is needed."""
        if self._timed is not None:
            self._timed.exchanged()
        self._native.publish(message)

    def get_subscription_count(self) -> int:
        """How many subscriptions match."""
        self._check("failed to get subscription count")
        return self._native.get_subscription_count()

    def assert_liveliness(self) -> None:
        """Declare that the publisher is alive, as each message does."""
        self._check("Failed to assert liveliness on the Publisher")
        if self._timed is not None:
            self._timed.asserted()

    def wait_for_all_acked(self, timeout: Duration | None = None) -> bool:
        """Wait until all published messages are on their way; always returns True."""
        self._check("Failed to wait for all acknowledgements")
        self.parent_node.handle.bridge.do(lambda: None)  # the loop sends in order
        return True

    def _check(self, failed: str) -> None:
        """Raise InvalidHandle after `destroy`, RCLError after the shutdown."""
        self.handle.check()
        self._context.check(failed, "publisher")

    def destroy(self) -> None:
        """Stop publishing; use it through `Node.destroy_publisher`, or `with`."""
        if self.handle.valid:
            if self._events is not None:
                self._events.destroy()
            self.handle.destroy_when_not_in_use()
            self._native.close()
            forget_profile(self)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.parent_node.destroy_publisher(self)


__getattr__ = names_of(__name__, __package__, {".type_support": "MsgType"})
