"""The types of arguments that may contain substitutions."""

from __future__ import annotations

from collections.abc import Iterable
from os import PathLike
from typing import TypeAlias

from .substitution import Substitution

OneSubstitution: TypeAlias = "str | PathLike[str] | Substitution"

SomeSubstitutionsType: TypeAlias = "OneSubstitution | Iterable[OneSubstitution]"
"""A text, a path, a substitution, or several of these, whose texts are joined."""

SomeSubstitutionsType_types_tuple = (str, PathLike, Substitution, Iterable)
"""The same for `isinstance`."""
