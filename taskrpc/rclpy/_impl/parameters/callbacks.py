"""The callbacks of a program that settings of parameters go through."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

from ...parameter import Parameter

PreSetCallback: TypeAlias = Callable[[list[Parameter]], list[Parameter]]
OnSetCallback: TypeAlias = Callable[[list[Parameter]], Any]
PostSetCallback: TypeAlias = Callable[[list[Parameter]], None]


class ParameterCallbacks:
    """The part of a node that keeps them; the one that was added last comes first."""

    def _init_callbacks(self) -> None:
        self._pre_set_parameters_callbacks: list[PreSetCallback] = []
        self._on_set_parameters_callbacks: list[OnSetCallback] = []
        self._post_set_parameters_callbacks: list[PostSetCallback] = []

    @property
    def _parameters_callbacks(self) -> list[OnSetCallback]:
        """Those that allow or refuse, by the name that ROS 2 Humble has for them."""
        return self._on_set_parameters_callbacks

    def add_pre_set_parameters_callback(self, callback: PreSetCallback) -> None:
        """Have what is to be set go through a callback, before it is checked.

        It takes a list of parameters and returns the list to set instead. It is asked about every
        setting, and about no declaration.
        """
        self._pre_set_parameters_callbacks.insert(0, callback)

    def add_on_set_parameters_callback(self, callback: OnSetCallback) -> None:
        """Have a callback allow or refuse values: it returns a SetParametersResult.

        It is asked about every setting and declaration; the one that was added last, first.
        """
        self._on_set_parameters_callbacks.insert(0, callback)

    def add_post_set_parameters_callback(self, callback: PostSetCallback) -> None:
        """Have a callback told of what was set or declared."""
        self._post_set_parameters_callbacks.insert(0, callback)

    def remove_pre_set_parameters_callback(self, callback: PreSetCallback) -> None:
        """Ask it no more. Raises ValueError for one that was not added."""
        self._pre_set_parameters_callbacks.remove(callback)

    def remove_on_set_parameters_callback(self, callback: OnSetCallback) -> None:
        """Ask it no more. Raises ValueError for one that was not added."""
        self._on_set_parameters_callbacks.remove(callback)

    def remove_post_set_parameters_callback(self, callback: PostSetCallback) -> None:
        """Tell it no more. Raises ValueError for one that was not added."""
        self._post_set_parameters_callbacks.remove(callback)

    def _verdict(self, parameters: list[Parameter]) -> Any:
        """The first refusal of a callback; None where all allow it.

        Raises AttributeError where a callback returns something else than a verdict.
        """
        for callback in self._on_set_parameters_callbacks:
            result = callback(parameters)
            if not hasattr(result, "successful"):
                name = getattr(callback, "__name__", repr(callback))
                raise AttributeError(
                    f"the callback {name}, which add_on_set_parameters_callback was given, returned"
                    f" {result!r}, expected a SetParametersResult, which has 'successful'"
                )
            if not result.successful:
                return result
        return None
