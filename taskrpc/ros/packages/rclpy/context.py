"""Contexts: the state that nodes and executors share between `init` and `shutdown`."""

from __future__ import annotations

import inspect
import os
import sys
import threading
import weakref
from collections.abc import Callable, Sequence
from typing import Any, NoReturn, Protocol, Self, TypeVar

from taskrpc import errors

from ._impl.arguments import Arguments, parse
from ._impl.diagnostics.explain import like_ros
from ._impl.execution.wakeups import Sleep
from ._impl.log import output
from .exceptions import RCLError, RCLInvalidROSArgsError, UnknownROSArgsError
from .handle import Handle

_Thing = TypeVar("_Thing")


class _TrackedNode(Protocol):
    def destroy_node(self) -> None: ...


_living: weakref.WeakKeyDictionary[Context, None] = weakref.WeakKeyDictionary()
"""Contexts that were initialised; a signal shuts all of them down."""


class ContextHandle(Handle):
    """`Context.handle` after `init`; `ok()` is True until the shutdown."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._ok = True

    def ok(self) -> bool:
        """Whether the context is not shut down."""
        return self._ok

    def get_domain_id(self) -> int:
        """The domain that the context is in."""
        return int(self.owner.get_domain_id())

    def shutdown(self) -> None:
        """Shut the context down without calling its callbacks."""
        self._ok = False
        self.owner.is_over = True


class Context:
    """The state that nodes and executors share from `init` to `shutdown`.

    Most programs use the default context, which `rclpy.init()` initialises, and never see it.
    """

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._callbacks: list[Callable[[], Callable[[], Any] | None]] = []
        self._handle: ContextHandle | None = None
        self._by_signal = False
        """Whether a signal shut it down and `shutdown` was not called since."""
        self.was_interrupted = False
        """Whether a signal ever shut it down."""
        self.is_over = False
        """Whether nodes and entities refuse to work. An attribute: publishers read it often."""
        self._domain_id = 0
        self._nodes: list[weakref.ReferenceType[_TrackedNode]] = []
        # Where executors and clocks sleep; the shutdown wakes them.
        self._sleeps: weakref.WeakKeyDictionary[Sleep, None] = weakref.WeakKeyDictionary()
        self.arguments = Arguments()

    @property
    def handle(self) -> ContextHandle | None:
        """Its handle; None before `init`."""
        return self._handle

    def init(
        self,
        args: Sequence[str] | None = None,
        *,
        initialize_logging: bool = True,
        domain_id: int | None = None,
    ) -> None:
        """Initialise it with the ROS arguments of a command line, by default the program's.

        Raises RuntimeError the second time, for a negative domain id and for ROS arguments that
        do not exist or cannot be read.
        """
        if domain_id is not None and domain_id < 0:
            raise RuntimeError(f"Domain id ({domain_id}) should not be lower than zero.")
        with self._lock:
            if self._handle is not None:
                raise RuntimeError("Context.init() must only be called once")
            self.arguments = _read(sys.argv if args is None else args)
            self._domain_id = _domain_of_the_environment() if domain_id is None else domain_id
            if initialize_logging:
                output.begin(self, self.arguments)
            self._handle = ContextHandle(self)
            _living[self] = None

    def track_node(self, node: _TrackedNode) -> None:
        """Destroy the node at the shutdown."""
        self._nodes.append(weakref.ref(node))

    def untrack_node(self, node: _TrackedNode) -> None:
        """Forget a node that was destroyed."""
        self._nodes = [known for known in self._nodes if known() not in (None, node)]

    def add_sleep(self, sleep: Sleep) -> None:
        """Wake the threads of a sleep at the shutdown."""
        self._sleeps[sleep] = None

    def ok(self) -> bool:
        """Whether it is initialised and not shut down."""
        handle = self._handle
        return handle is not None and handle._ok

    def check(self, failed: str, kind: str = "rcl node") -> None:
        """Raise RCLError after the shutdown; `failed` is what cannot be done, in ROS's words."""
        if self.is_over:
            self.refuse(failed, kind)

    def refuse(self, failed: str, kind: str = "rcl node") -> NoReturn:
        """Raise the error of `check`, also while the shutdown is only beginning."""
        raise RCLError(f"{failed}: {kind}'s context is invalid")

    def check_valid(self, failed: str) -> None:
        """Raise RCLError before `init` and after the shutdown; `failed` is what cannot be done."""
        if not self.ok():
            raise RCLError(
                f"{failed}: the given context is not valid, either rcl_init() was not called or"
                " rcl_shutdown() was called."
            )

    def destroy(self) -> None:
        """Destroy the handle."""
        if self._handle is not None:
            self._handle.destroy_when_not_in_use()

    def shutdown(self) -> None:
        """Shut it down: destroys its nodes and stops the executors.

        Raises RuntimeError before `init` and the second time, unless a signal was the first.
        """
        if self._handle is None:
            raise RuntimeError("Context must be initialized before it can be shutdown")
        if not self._handle._ok and (like_ros() or not self._by_signal):
            raise RCLError("failed to shutdown: rcl_shutdown already called on the given context")
        self._end()

    def try_shutdown(self) -> None:
        """Shut it down, unless it is not initialised or already shut down."""
        if self._handle is not None and (self._handle._ok or self._by_signal):
            self._end()

    def on_shutdown(self, callback: Callable[[], Any]) -> None:
        """Call the callback at the shutdown; at once if the context is already shut down."""
        if not callable(callback):
            raise TypeError(f"callback should be a callable, got {type(callback)}")
        with self._lock:
            if self._handle is None or self._handle._ok:
                self._callbacks.append(_reference(callback))
                return
        callback()

    def get_domain_id(self) -> int:
        """The domain of its nodes; they see only nodes of the same domain."""
        if self._handle is None:
            raise RuntimeError("Context must be initialized before it can have a domain id")
        return self._domain_id

    def __enter__(self) -> Self:
        if self._handle is None:
            self.init()
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.try_shutdown()

    def _end(self) -> None:
        with self._lock:
            if self._handle is not None:
                self._handle._ok = False
            by_signal, self._by_signal = self._by_signal, False
            callbacks, self._callbacks = self._callbacks, []
            nodes, self._nodes = self._nodes, []
        self.is_over = True  # the callbacks cannot publish: in ROS, the nodes are gone by now
        for reference in callbacks:
            if (callback := reference()) is not None:
                callback()
        for sleep in _all(self._sleeps):  # after the callbacks, which may shut executors down
            sleep.end()
        self.is_over = by_signal  # a node may publish in its `destroy_node`, for example a stop
        for known in nodes:
            if (node := known()) is not None:
                node.destroy_node()
        self.is_over = True
        output.end(self)

    def _end_by_signal(self) -> None:
        """Shut it down as far as a signal handler may: takes no lock and calls no callback."""
        if self._handle is not None and self._handle._ok:
            self._by_signal = self.was_interrupted = True
            self._handle._ok = False
            self.is_over = True
            for sleep in _all(self._sleeps):
                sleep.end()


def end_all_by_signal() -> None:
    """Shut every context down, from a signal handler."""
    for context in _all(_living):
        context._end_by_signal()


def _all(known: weakref.WeakKeyDictionary[_Thing, None]) -> list[_Thing]:
    """The keys of a dict to which other threads may add at the same time."""
    while True:
        try:
            return list(known)
        except RuntimeError:  # it grew under the iteration
            continue


def _reference(callback: Callable[[], Any]) -> Callable[[], Callable[[], Any] | None]:
    """A weak reference to a method, which does not keep its object; functions are kept."""
    if inspect.ismethod(callback):
        return weakref.WeakMethod(callback)
    return lambda: callback


def _read(args: Sequence[str]) -> Arguments:
    for argument in args:
        argument.encode()  # ROS encodes them as UTF-8, and so raises UnicodeEncodeError
    try:
        return parse(list(args), failed="failed to initialize rcl")
    except (RCLInvalidROSArgsError, UnknownROSArgsError):
        errors.show_in_one_message()  # the user made the mistake, not the program
        raise


def _domain_of_the_environment() -> int:
    """ROS_DOMAIN_ID; 0 when it is not a number, as in ROS."""
    text = os.environ.get("ROS_DOMAIN_ID", "")
    return int(text) if text.isdecimal() else 0
