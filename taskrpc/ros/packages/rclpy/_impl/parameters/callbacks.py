"""The callbacks of a program that run when parameters are set."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any, TypeAlias

import srvgen

from ...parameter import Parameter

SetParametersResult = srvgen.load("rcl_interfaces/msg/SetParametersResult")
PreSetCallback: TypeAlias = Callable[[list[Parameter]], list[Parameter]]
OnSetCallback: TypeAlias = Callable[[list[Parameter]], Any]
PostSetCallback: TypeAlias = Callable[[list[Parameter]], None]


class ParameterCallbacks:
    """Keeps the callbacks of a node; the callback that was added last runs first."""

    def __init__(self) -> None:
        self.pre_set_callbacks: list[PreSetCallback] = []
        self.on_set_callbacks: list[OnSetCallback] = []
        self.post_set_callbacks: list[PostSetCallback] = []

    def add_pre_set_parameters_callback(self, callback: PreSetCallback) -> None:
        """As `Node.add_pre_set_parameters_callback`."""
        self.pre_set_callbacks.insert(0, callback)

    def add_on_set_parameters_callback(self, callback: OnSetCallback) -> None:
        """As `Node.add_on_set_parameters_callback`."""
        self.on_set_callbacks.insert(0, callback)

    def add_post_set_parameters_callback(self, callback: PostSetCallback) -> None:
        """As `Node.add_post_set_parameters_callback`."""
        self.post_set_callbacks.insert(0, callback)

    def remove_pre_set_parameters_callback(self, callback: PreSetCallback) -> None:
        """As `Node.remove_pre_set_parameters_callback`."""
        self.pre_set_callbacks.remove(callback)

    def remove_on_set_parameters_callback(self, callback: OnSetCallback) -> None:
        """As `Node.remove_on_set_parameters_callback`."""
        self.on_set_callbacks.remove(callback)

    def remove_post_set_parameters_callback(self, callback: PostSetCallback) -> None:
        """As `Node.remove_post_set_parameters_callback`."""
        self.post_set_callbacks.remove(callback)

    def _rejection(self, parameters: list[Parameter]) -> Any:
        """The result of the first callback that rejects the parameters; None if all accept them.

        A callback that returns no SetParametersResult rejects them, with a warning.
        """
        for callback in self.on_set_callbacks:
            result = callback(parameters)
            if not hasattr(result, "successful"):
                name = getattr(callback, "__name__", repr(callback))
                warnings.warn(
                    f"the callback {name} of add_on_set_parameters_callback returned {result!r},"
                    " expected a SetParametersResult: the parameters are not set",
                    stacklevel=2,
                )
                return SetParametersResult(
                    successful=False, reason="Callback returned an invalid type"
                )
            if not result.successful:
                return result
        return None
