"""The actions and substitutions that XML and YAML launch files know, by their names there."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

_Exposed = TypeVar("_Exposed")

action_parsers: dict[str, Callable[[Any, Any], Any]] = {}
"""By an element's name: a function of the element and the parser that returns the action."""

substitution_parsers: dict[str, Callable[..., Any]] = {}
"""By a substitution's name: a function of its arguments that returns the substitution."""


def expose_action(name: str) -> Callable[[_Exposed], _Exposed]:
    """Let XML and YAML launch files use an action; its class needs a class method `parse`.

    `parse(entity, parser)` returns the class and the arguments of its constructor.
    """

    def add(exposed: _Exposed) -> _Exposed:
        def build(entity: Any, parser: Any) -> Any:
            found: Any = exposed
            cls, arguments = (found.parse if hasattr(found, "parse") else found)(entity, parser)
            return cls(**arguments)

        action_parsers[name] = build
        return exposed

    return add


def expose_substitution(name: str) -> Callable[[_Exposed], _Exposed]:
    """Let XML and YAML launch files use a substitution; its class needs a class method `parse`.

    `parse(arguments)` returns the class and the arguments of its constructor.
    """

    def add(exposed: _Exposed) -> _Exposed:
        def build(*arguments: Any) -> Any:
            found: Any = exposed
            cls, keywords = (found.parse if hasattr(found, "parse") else found)(arguments)
            return cls(**keywords)

        substitution_parsers[name] = build
        return exposed

    return add
