"""The base class of substitutions: texts that are known when the launch file is executed."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

from .launch_context import LaunchContext


class SubstitutionFailure(RuntimeError):
    """A substitution has no value, for example because a command failed."""


class Substitution:
    """A text that is computed when the launch file is executed."""

    def describe(self) -> str:
        """Describe the substitution, without computing it."""
        return f"{type(self).__name__}()"

    def perform(self, context: LaunchContext) -> str:
        """Compute the text."""
        return ""


class TextSubstitution(Substitution):
    """A text that is known from the start."""

    def __init__(self, *, text: str) -> None:
        if not isinstance(text, str):
            raise TypeError(f"TextSubstitution expected Text object got '{type(text)}' instead.")
        self._text = text

    @property
    def text(self) -> str:
        """The text."""
        return self._text

    def describe(self) -> str:
        """Describe the substitution."""
        return f"'{self._text}'"

    def perform(self, context: LaunchContext) -> str:
        """Return the text."""
        return self._text


def normalize_to_list_of_substitutions(subs: Any) -> list[Substitution]:
    """Turn a text, a path, a substitution, or an iterable of these into a list of substitutions.

    Raises TypeError for anything else.
    """
    if isinstance(subs, str):
        return [TextSubstitution(text=subs)]
    if isinstance(subs, os.PathLike):
        return [TextSubstitution(text=os.fspath(subs))]
    if isinstance(subs, Substitution):
        return [subs]
    if isinstance(subs, Iterable):
        return [_single(each) for each in subs]
    raise _wrong_type(subs)


def _single(value: Any) -> Substitution:
    if isinstance(value, Substitution):
        return value
    if isinstance(value, (str, os.PathLike)):
        return TextSubstitution(text=os.fspath(value))
    raise _wrong_type(value)


def _wrong_type(value: Any) -> TypeError:
    return TypeError(
        "Failed to normalize given item of type "
        f"'{type(value)}', when only "
        "str, Path, Substitution or a list of these is expected"
    )


def perform_substitutions(context: LaunchContext, subs: Iterable[Substitution]) -> str:
    """Compute several substitutions and join their texts."""
    return "".join(context.perform_substitution(each) for each in subs)


def perform(context: LaunchContext, value: Any) -> str:
    """Compute a text, a substitution, or several of these."""
    return perform_substitutions(context, normalize_to_list_of_substitutions(value))
