"""Subscriptions call a callback for each message, on the thread that spins the node."""

from __future__ import annotations

import inspect
import time
from collections import deque
from collections.abc import Callable, Sequence
from enum import Enum
from typing import Any, Generic, Self, TypeAlias, TypedDict, TypeVar

from srvgen import to_cdr

from ._impl.content_filter import FilterError, Test, compile_filter
from ._impl.execution.entity import Entity
from ._impl.graph.endpoints import forget_profile, remember_profile
from ._impl.node_interface import NodeInterface
from ._impl.reexports import names_of
from .callback_groups import CallbackGroup
from .endpoint_info import EndpointTypeEnum
from .event_handler import Events
from .exceptions import RCLError
from .handle import ArrivalHandle
from .subscription_content_filter_options import ContentFilterOptions

MsgT = TypeVar("MsgT")


class MessageInfo(TypedDict):
    """The second argument of callbacks with two parameters; times in nanoseconds since 1970."""

    source_timestamp: int
    received_timestamp: int
    publication_sequence_number: int | None
    reception_sequence_number: int | None


SubscriptionCallback: TypeAlias = (
    Callable[[MsgT], object]
    | Callable[[MsgT, MessageInfo], object]
    | Callable[[bytes], object]
    | Callable[[bytes, MessageInfo], object]
)
"""With `raw`, a callback gets the message as bytes."""


class Subscription(Entity, Generic[MsgT]):
    """Receives the messages of a topic; `Node.create_subscription` creates it.

    While callbacks are slow, the last messages wait, as many as the depth of the profile.
    """

    class CallbackType(Enum):
        """The arguments that a callback takes."""

        MessageOnly = 0
        WithMessageInfo = 1

    def __init__(
        self,
        node: NodeInterface,
        msg_type: Any,
        topic: str,
        callback: Callable[..., Any],
        callback_group: CallbackGroup,
        qos_profile: Any,
        raw: bool = False,
        events: Events | None = None,
        content_filter_options: ContentFilterOptions | None = None,
    ) -> None:
        node.context.check("Failed to create subscription")
        self.parent_node = node
        self.msg_type = msg_type
        self._full_name = self.topic = topic
        self.callback = callback
        self.callback_group = callback_group
        self.qos_profile = qos_profile
        self.raw = raw
        self._filter: tuple[ContentFilterOptions, Test] | None = None
        if content_filter_options is not None and content_filter_options.filter_expression:
            self._filter = self._compiled("create subscription", *content_filter_options)
        self.handle = SubscriptionHandle(self)
        self._events = events
        self._timed = events if events is not None and events.are_timed else None
        """The events, if they depend on when messages arrive."""
        self.event_handlers = [] if events is None else events.create_handlers(self.handle)
        mismatch = None if events is None else events.mismatch
        native = qos_profile.to_native(subscribes=True)
        self._received = 0
        self._messages: deque[tuple[Any, MessageInfo]] = deque(maxlen=native.depth)
        self._native = node.handle.bridge.subscription(
            msg_type, topic, self._on_message, native, mismatch
        )
        if events is not None:
            events.watch(self._native)
        node_name = node.get_fully_qualified_name()
        remember_profile(self, EndpointTypeEnum.SUBSCRIPTION, node_name, topic, qos_profile)

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

    @property
    def callback(self) -> Callable[..., Any]:
        """Receives each message, and its `MessageInfo` if it has two parameters.

        Setting it raises RuntimeError for a callback with another number of parameters.
        """
        return self._callback

    @callback.setter
    def callback(self, value: Callable[..., Any]) -> None:
        self._callback = value
        self._callback_type = _callback_type(value)

    @property
    def is_cft_enabled(self) -> bool:
        """Whether messages are filtered by content."""
        self.handle.check()
        return self._filter is not None

    def set_content_filter(
        self, filter_expression: str, expression_parameters: Sequence[str]
    ) -> None:
        """Receive only messages for which the expression is true, such as `data > %0`.

        Each `%n` stands for a parameter. An empty expression removes the filter. Raises RCLError
        for an invalid expression, and if there is no filter to remove.
        """
        self.handle.check()
        what = "set cft expression parameters"
        if filter_expression == "" and self._filter is None:
            raise RCLError(f"Failed to {what}: the subscription has no content filter to remove")
        compiled = self._compiled(what, filter_expression, expression_parameters)
        self._filter = compiled if filter_expression else None

    def get_content_filter(self) -> ContentFilterOptions:
        """The filter. Raises RCLError without one."""
        self.handle.check()
        if self._filter is None:
            raise RCLError(
                "Failed to get cft expression parameters: the subscription has no content filter"
            )
        return self._filter[0]

    def _compiled(
        self, what: str, expression: str, parameters: Sequence[str]
    ) -> tuple[ContentFilterOptions, Test]:
        """A checked filter. Raises RCLError with `what` could not be done, or TypeError."""
        if not isinstance(expression, str):
            raise TypeError(f"expected a filter_expression (str), got {expression!r}")
        given = None if isinstance(parameters, str) else parameters
        if not (isinstance(given, Sequence) and all(isinstance(one, str) for one in given)):
            raise TypeError(f"expected expression_parameters (list of str), got {parameters!r}")
        options = ContentFilterOptions(expression, list(given))
        if not expression:
            return options, bool
        try:
            return options, compile_filter(expression, given, self.msg_type)
        except FilterError as error:
            raise RCLError(f"Failed to {what}: {error}") from None

    def get_publisher_count(self) -> int:
        """How many publishers match."""
        self.handle.check()
        return self._native.get_publisher_count()

    def destroy(self) -> None:
        """Stop receiving; use it through `Node.destroy_subscription`, or `with`."""
        if self.handle.valid:
            if self._events is not None:
                self._events.destroy()
            self.handle.destroy_when_not_in_use()
            self._native.close()
            forget_profile(self)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.parent_node.destroy_subscription(self)

    def _on_message(self, message: Any) -> None:
        """Store a message that passes the filter; runs on the thread of the event loop."""
        active = self._filter
        if active is not None and not active[1](message):
            return
        if self._timed is not None:
            self._timed.exchanged()
        now = time.time_ns()
        self._received += 1
        info = MessageInfo(
            source_timestamp=now,
            received_timestamp=now,
            publication_sequence_number=None,
            reception_sequence_number=self._received,
        )
        self._messages.append((message, info))
        self.notify_executor()
        self.handle.item_arrived()

    def has_work(self) -> bool:
        """Whether a message waits to be taken."""
        return bool(self._messages)

    def oldest_message(self) -> Any:
        """The oldest message that waits to be taken; IndexError when none waits."""
        return self._messages[0][0]

    def take_work(self) -> Callable[[], Any] | None:
        """Take the oldest message and return the call of the callback."""
        self.handle.check()
        taken = self._next()
        if taken is None:
            return None
        message, info = taken
        callback = self._callback
        if self._callback_type is Subscription.CallbackType.MessageOnly:
            return lambda: callback(message)
        return lambda: callback(message, info)

    def _next(self) -> tuple[Any, MessageInfo] | None:
        try:
            message, info = self._messages.popleft()
        except IndexError:  # another thread took it
            return None
        return to_cdr(message) if self.raw else message, info


class SubscriptionHandle(ArrivalHandle):
    """`Subscription.handle`: a program may take messages from it instead of by a callback."""

    def take_message(self, pymsg_type: Any, raw: bool) -> tuple[Any, MessageInfo] | None:
        """Take a message and its info; None when none waits."""
        self.check()
        taken: tuple[Any, MessageInfo] | None = self.owner._next()
        if taken is None or not raw or isinstance(taken[0], bytes):
            return taken
        return to_cdr(taken[0]), taken[1]

    set_on_new_message_callback = ArrivalHandle.set_on_new_callback
    clear_on_new_message_callback = ArrivalHandle.clear_on_new_callback


def _callback_type(callback: Callable[..., Any]) -> Subscription.CallbackType:
    """The kind of a callback, by the number of its parameters."""
    try:
        signature = inspect.signature(callback)
    except ValueError:  # some built-in functions have no signature
        return Subscription.CallbackType.MessageOnly
    except TypeError:  # not callable
        signature = inspect.Signature()
    for count, kind in ((1, "MessageOnly"), (2, "WithMessageInfo")):
        try:
            signature.bind(*range(count))
        except TypeError:
            continue
        return Subscription.CallbackType[kind]
    raise RuntimeError(
        "Subscription.__init__(): callback should be either be callable with one argument"
        " (to get only the message) or two (to get message and message info)"
    )


__getattr__ = names_of(__name__, __package__, {".type_support": "MsgType"})
