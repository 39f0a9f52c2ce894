"""Substitutions that join texts, or decide something about them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from typing import Any

from ..conditions import evaluate_condition_expression
from ..launch_context import LaunchContext
from ..some_substitutions_type import SomeSubstitutionsType
from ..substitution import (
    Substitution,
    normalize_to_list_of_substitutions,
    perform,
    perform_substitutions,
)


def describe_all(subs: Iterable[Substitution]) -> str:
    """Describe several substitutions whose texts are joined."""
    return " + ".join(each.describe() for each in subs)


class PathJoinSubstitution(Substitution):
    """A path of several parts; `/` adds one more."""

    def __init__(self, substitutions: Iterable[Any]) -> None:
        self._parts = [normalize_to_list_of_substitutions(each) for each in substitutions]

    @property
    def substitutions(self) -> list[list[Substitution]]:
        """The parts of the path."""
        return self._parts

    def describe(self) -> str:
        """Describe the substitution."""
        return f"PathJoin({', '.join(describe_all(part) for part in self._parts)})"

    def perform(self, context: LaunchContext) -> str:
        """Join the parts."""
        return os.path.join(*(perform_substitutions(context, part) for part in self._parts))

    def __truediv__(self, other: SomeSubstitutionsType) -> PathJoinSubstitution:
        return PathJoinSubstitution([*self._parts, other])


class PathSubstitution(PathJoinSubstitution):
    """A path that begins with one part; `/` adds more."""

    def __init__(self, path: SomeSubstitutionsType) -> None:
        super().__init__([path])


class StringJoinSubstitution(Substitution):
    """Several texts with a delimiter between them."""

    def __init__(self, substitutions: Iterable[Any], delimiter: SomeSubstitutionsType = "") -> None:
        self._parts = [normalize_to_list_of_substitutions(each) for each in substitutions]
        self._delimiter = normalize_to_list_of_substitutions(delimiter)

    def describe(self) -> str:
        """Describe the substitution."""
        return f"StringJoin({', '.join(describe_all(part) for part in self._parts)})"

    def perform(self, context: LaunchContext) -> str:
        """Join the texts."""
        delimiter = perform_substitutions(context, self._delimiter)
        return delimiter.join(perform_substitutions(context, part) for part in self._parts)


class EqualsSubstitution(Substitution):
    """`true` if two values are equal, as numbers, truth values or texts, else `false`."""

    def __init__(self, left: Any, right: Any) -> None:
        self._left, self._right = _operand(left), _operand(right)

    def describe(self) -> str:
        """Describe the substitution."""
        return f"{type(self).__name__}({describe_all(self._left)} {describe_all(self._right)})"

    def perform(self, context: LaunchContext) -> str:
        """Compare the values."""
        return str(self._are_equal(context)).lower()

    def _are_equal(self, context: LaunchContext) -> bool:
        left = perform_substitutions(context, self._left)
        right = perform_substitutions(context, self._right)
        if left == right:
            return True
        truths = [_TRUTHS.get(each.strip().lower()) for each in (left, right)]
        if None not in truths:
            return truths[0] is truths[1]
        try:
            return float(left) == float(right)
        except ValueError:
            return False


class NotEqualsSubstitution(EqualsSubstitution):
    """`false` if two values are equal, else `true`."""

    def perform(self, context: LaunchContext) -> str:
        """Compare the values."""
        return str(not self._are_equal(context)).lower()


_TRUTHS = {"true": True, "1": True, "false": False, "0": False}


def _operand(value: Any) -> list[Substitution]:
    if value is None:
        value = ""
    return normalize_to_list_of_substitutions(
        str(value) if isinstance(value, (bool, int, float)) else value
    )


class _OfTruths(Substitution):
    """A substitution that is `true` or `false`, computed from others of this kind."""

    _decide: Callable[[Iterable[bool]], bool]

    def __init__(self, *values: Any) -> None:
        self._values = [normalize_to_list_of_substitutions(each) for each in values]

    def describe(self) -> str:
        """Describe the substitution."""
        inner = ", ".join(describe_all(each) for each in self._values)
        return f"{type(self).__name__}({inner})"

    def perform(self, context: LaunchContext) -> str:
        """Compute the values, as far as they are needed, and decide."""
        truths = (evaluate_condition_expression(context, each) for each in self._values)
        return str(type(self)._decide(truths)).lower()


class NotSubstitution(_OfTruths):
    """`true` if a value is false."""

    _decide = staticmethod(lambda truths: not next(iter(truths)))

    def __init__(self, value: SomeSubstitutionsType) -> None:
        super().__init__(value)


class AndSubstitution(_OfTruths):
    """`true` if both values are true."""

    _decide = staticmethod(all)

    def __init__(self, left: SomeSubstitutionsType, right: SomeSubstitutionsType) -> None:
        super().__init__(left, right)


class OrSubstitution(_OfTruths):
    """`true` if one of two values is true."""

    _decide = staticmethod(any)

    def __init__(self, left: SomeSubstitutionsType, right: SomeSubstitutionsType) -> None:
        super().__init__(left, right)


class AnySubstitution(_OfTruths):
    """`true` if one of several values is true."""

    _decide = staticmethod(any)


class AllSubstitution(_OfTruths):
    """`true` if all of several values are true."""

    _decide = staticmethod(all)


class IfElseSubstitution(Substitution):
    """One of two texts, chosen by a condition."""

    def __init__(
        self,
        condition: SomeSubstitutionsType,
        if_value: SomeSubstitutionsType = "",
        else_value: SomeSubstitutionsType = "",
    ) -> None:
        self._condition = normalize_to_list_of_substitutions(condition)
        self._if, self._else = if_value, else_value

    def describe(self) -> str:
        """Describe the substitution."""
        return f"IfElseSubstitution({describe_all(self._condition)})"

    def perform(self, context: LaunchContext) -> str:
        """Compute the chosen text."""
        chosen = evaluate_condition_expression(context, self._condition)
        return perform(context, self._if if chosen else self._else)
