"""The types of remappings in annotations."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeAlias

SomeRemapRule: TypeAlias = "tuple[Any, Any]"
"""An old name and a new one: texts or substitutions."""

SomeRemapRules: TypeAlias = "Iterable[SomeRemapRule]"
RemapRule: TypeAlias = SomeRemapRule
RemapRules: TypeAlias = SomeRemapRules
