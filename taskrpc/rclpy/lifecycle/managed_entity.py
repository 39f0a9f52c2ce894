"""What takes part in the steps of a lifecycle node."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from .._impl.lifecycle_states import LifecycleState
from .._impl.lifecycle_states import TransitionCallbackReturnType as TransitionCallbackReturn


class ManagedEntity:
    """Is told of every step, and may say that it failed; this one agrees to all of them."""

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """The node is being set up; `state` is the one before."""
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """What was set up is being given back."""
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """The node ends, from whatever state."""
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """The work begins."""
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """The work pauses."""
        return TransitionCallbackReturn.SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Another callback ended with an error; SUCCESS says that it was put right."""
        return TransitionCallbackReturn.SUCCESS


class SimpleManagedEntity(ManagedEntity):
    """Only remembers whether the node is active."""

    def __init__(self) -> None:
        self._enabled = False

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """From now on it is activated."""
        self._enabled = True
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """From now on it is not."""
        self._enabled = False
        return TransitionCallbackReturn.SUCCESS

    @property
    def is_activated(self) -> bool:
        """Whether the node is active."""
        return self._enabled

    @staticmethod
    def when_enabled(
        wrapped: Callable[..., Any] | None = None,
        *,
        when_not_enabled: Callable[[], Any] | None = None,
    ) -> Callable[..., Any]:
        """Decorates a method that does nothing (or calls another function) while not activated."""

        def decorated(method: Callable[..., Any]) -> Callable[..., None]:
            @functools.wraps(method)
            def only_when_enabled(self: SimpleManagedEntity, *args: Any, **values: Any) -> None:
                if self._enabled:
                    method(self, *args, **values)
                elif when_not_enabled is not None:
                    when_not_enabled()

            return only_when_enabled

        return decorated if wrapped is None else decorated(wrapped)
