"""Actions for what taskrpc does not have: components, and transitions of lifecycle nodes.

The launch file runs; each of these actions says in one line what is left out.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from launch.action import Action
from launch.logging import get_logger
from launch.substitution import perform

from .node import Node


class LifecycleNode(Node):
    """Starts a lifecycle node; the launch file does not change its state."""

    def __init__(self, *, autostart: bool = False, **kwargs: Any) -> None:
        super().__init__(**kwargs)

    def execute(self, context: Any) -> list[Any] | None:
        """Start the node, and log how to change its state."""
        found: list[Any] | None = super().execute(context)
        if self.process_details is not None:
            get_logger("launch").warning(
                f"taskrpc's launch does not change the state of the lifecycle node"
                f" {self.node_name}; call its service change_state with `taskrpc service call`"
            )
        return found


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


class LifecycleTransition(Action):
    """Changes no state of lifecycle nodes."""

    def __init__(
        self, *, lifecycle_node_names: Iterable[Any], transition_ids: Iterable[Any], **kwargs: Any
    ) -> None:
        super().__init__(**kwargs)
        self._names = list(lifecycle_node_names)

    def execute(self, context: Any) -> list[Any] | None:
        """Log that the states do not change."""
        names = ", ".join(perform(context, each) for each in self._names)
        get_logger("launch").warning(
            f"taskrpc's launch does not change the states of {names};"
            " call their service change_state with `taskrpc service call`"
        )
        return None


def _say_components(context: Any, what: str, components: Iterable[Any]) -> None:
    names = ", ".join(each.describe(context) for each in components)
    inside = f" ({names})" if names else ""
    get_logger("launch").warning(
        f"taskrpc has no compiled components, so it does not start the {what}{inside};"
        " the other programs start"
    )
