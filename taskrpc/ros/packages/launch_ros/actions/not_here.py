"""Actions for what taskrpc does not have: components.

The launch file runs; each of these actions says in one line what is left out.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from launch.action import Action
from launch.logging import get_logger
from launch.substitution import perform


class ComposableNodeContainer(Action):
    """Starts no container: components are compiled."""

    def __init__(
        self,
        *,
        name: Any = "",
        namespace: Any = "",
        composable_node_descriptions: Iterable[Any] | None = None,
        condition: Any = None,
        node_name: Any = "",
        **_: Any,
    ) -> None:
        super().__init__(condition=condition)
        self._name = name or node_name or ""
        self._components = list(composable_node_descriptions or ())

    def execute(self, context: Any) -> list[Any] | None:
        """Log that the components do not start."""
        _say_components(context, f"container '{perform(context, self._name)}'", self._components)
        return None


class LoadComposableNodes(Action):
    """Loads no components: they are compiled."""

    def __init__(
        self,
        *,
        target_container: Any,
        composable_node_descriptions: Iterable[Any],
        condition: Any = None,
        **_: Any,
    ) -> None:
        super().__init__(condition=condition)
        self._components = list(composable_node_descriptions)

    def execute(self, context: Any) -> list[Any] | None:
        """Log that the components do not start."""
        _say_components(context, "components", self._components)
        return None


def _say_components(context: Any, what: str, components: Iterable[Any]) -> None:
    names = ", ".join(each.describe(context) for each in components)
    inside = f" ({names})" if names else ""
    get_logger("launch").warning(
        f"taskrpc has no compiled components, so it does not start the {what}{inside};"
        " the other programs start"
    )
