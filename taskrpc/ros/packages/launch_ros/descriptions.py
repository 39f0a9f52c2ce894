"""Descriptions of components and parameters."""

from __future__ import annotations

from typing import Any

from launch.substitution import perform

from taskrpc.ros.module_names import add_module_names

from .parameter_descriptions import Parameter, ParameterFile, ParameterValue


class ComposableNode:
    """A node that a container loads; taskrpc only names it."""

    def __init__(self, *, package: Any, plugin: Any = None, name: Any = None, **other: Any) -> None:
        self.package = package
        self.node_plugin = other.get("node_plugin") if plugin is None else plugin
        self.node_name = other.get("node_name") if name is None else name

    def describe(self, context: Any) -> str:
        """The component's class, or its package."""
        return str(perform(context, self.node_plugin or self.package))


__all__ = ["ComposableNode", "Parameter", "ParameterFile", "ParameterValue"]

add_module_names(__name__)
