"""Conditions: when an action is executed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from taskrpc.ros.module_names import add_module_names

from .launch_context import LaunchContext
from .some_substitutions_type import SomeSubstitutionsType
from .substitution import normalize_to_list_of_substitutions, perform, perform_substitutions

_TRUE = ("true", "1")
_FALSE = ("false", "0")


class Condition:
    """Decides whether the launch executes an action."""

    def __init__(self, *, predicate: Callable[[LaunchContext], bool] | None = None) -> None:
        self._predicate = predicate
        self._last: bool | None = None

    def describe(self) -> str:
        """Describe the condition."""
        return repr(self)

    def evaluate(self, context: LaunchContext) -> bool:
        """Return whether the condition holds."""
        self._last = True if self._predicate is None else bool(self._predicate(context))
        return self._last


class InvalidConditionExpressionError(Exception):
    """The text of a condition is neither true nor false."""

    def __init__(self, expression: str) -> None:
        super().__init__(
            f"expected condition expression to be one of {['true', 'false', '1', '0']}"
            f" but got '{expression}'"
        )


class UnsupportedConditionError(InvalidConditionExpressionError):
    """ROS's other name of the error."""


def evaluate_condition_expression(context: LaunchContext, expression: Any) -> bool:
    """Compute a text and return whether it is `true` or `1`; upper and lower case are equal.

    Raises InvalidConditionExpressionError if it is neither that nor `false` or `0`.
    """
    text = perform_substitutions(context, expression).strip().lower()
    if text in _TRUE:
        return True
    if text in _FALSE:
        return False
    raise InvalidConditionExpressionError(text)


class _OfExpression(Condition):
    """A condition on a text that is true or false."""

    def __init__(self, predicate_expression: SomeSubstitutionsType, wanted: bool) -> None:
        expression = normalize_to_list_of_substitutions(predicate_expression)
        self._expression = expression
        super().__init__(
            predicate=lambda context: evaluate_condition_expression(context, expression) is wanted
        )

    def describe(self) -> str:
        """Describe the condition."""
        inner = " + ".join(each.describe() for each in self._expression)
        return f"{type(self).__name__}({inner})"


class IfCondition(_OfExpression):
    """Executes the action if a text is `true` or `1`."""

    def __init__(self, predicate_expression: SomeSubstitutionsType) -> None:
        super().__init__(predicate_expression, True)


class UnlessCondition(_OfExpression):
    """Executes the action if a text is `false` or `0`."""

    def __init__(self, predicate_expression: SomeSubstitutionsType) -> None:
        super().__init__(predicate_expression, False)


class LaunchConfigurationEquals(Condition):
    """Executes the action if a launch configuration has this value.

    `None` as the value means that the configuration is not set.
    """

    def __init__(
        self, launch_configuration_name: str, expected_value: SomeSubstitutionsType | None
    ) -> None:
        self._name = launch_configuration_name
        super().__init__(predicate=_is_equal(launch_configuration_name, expected_value))

    def describe(self) -> str:
        """Describe the condition."""
        return f"{type(self).__name__}({self._name})"


class LaunchConfigurationNotEquals(LaunchConfigurationEquals):
    """Executes the action if a launch configuration does not have this value."""

    def evaluate(self, context: LaunchContext) -> bool:
        """Return whether the condition holds."""
        return not super().evaluate(context)


def _is_equal(name: str, expected: SomeSubstitutionsType | None) -> Callable[[LaunchContext], bool]:
    def predicate(context: LaunchContext) -> bool:
        context.used_configurations.add(name)
        value = context.launch_configurations.get(name)
        return value == (None if expected is None else perform(context, expected))

    return predicate


__all__ = [
    "Condition",
    "IfCondition",
    "InvalidConditionExpressionError",
    "LaunchConfigurationEquals",
    "LaunchConfigurationNotEquals",
    "UnlessCondition",
    "UnsupportedConditionError",
    "evaluate_condition_expression",
]

add_module_names(__name__)
