"""Guard conditions: a program triggers their callback itself, from any thread."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ._impl.diagnostics.explain import callback_parameters
from ._impl.execution.entity import Entity
from .callback_groups import CallbackGroup
from .context import Context
from .handle import Handle
from .utilities import get_default_context


class GuardCondition(Entity):
    """Runs its callback on the spinning thread after one or more triggers."""

    def __init__(
        self,
        callback: Callable[[], Any] | None,
        callback_group: CallbackGroup | None,
        context: Context | None = None,
    ) -> None:
        self._context = get_default_context() if context is None else context
        self._context.check_valid("failed to create guard_condition")
        self.callback = callback
        callback_parameters(callback, "the callback of a guard condition")
        self.callback_group = callback_group
        self.handle = Handle(self)
        self._triggered = False

    def trigger(self) -> None:
        """Make the callback run; raises InvalidHandle after `destroy`."""
        self.handle.check()
        self._triggered = True
        self.notify_executor()

    def destroy(self) -> None:
        """Stop running the callback for ever."""
        self.handle.destroy_when_not_in_use()
        self._triggered = False

    def has_work(self) -> bool:
        """Whether it was triggered since its callback ran last."""
        return self._triggered

    def take_work(self) -> Callable[[], Any] | None:
        """Reset it and return the callback."""
        if not self._triggered:
            return None
        self._triggered = False
        return self.callback
