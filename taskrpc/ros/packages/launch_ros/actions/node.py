"""The action that starts a node."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import Any

from launch.actions.execute_local import PreparedCommand, texts_of
from launch.actions.execute_process import ExecuteProcess
from launch.logging import warn_once
from launch.substitution import normalize_to_list_of_substitutions, perform
from rclpy.exceptions import InvalidNamespaceException, InvalidNodeNameException
from rclpy.validate_namespace import validate_namespace
from rclpy.validate_node_name import validate_node_name

from taskrpc.ros import hook
from taskrpc.ros.executables import NotHere, run_arguments

from ..parameter_descriptions import Parameter, ParameterFile
from ..parameters import (
    NAMESPACE,
    global_arguments,
    joined_namespace,
    parameter_arguments,
    remap_arguments,
)

__all__ = ["Node", "Parameter", "ParameterFile"]  # programs import all three from here

_UNNAMED = "<node_name_unspecified>"


class Node(ExecuteProcess):
    """Starts a node: an executable of a package, with parameters and remappings.

    Args:
        package: the package; None if `executable` is the path of a program.
        executable: the executable.
        name: the node's name; without it, the program's own.
        namespace: the node's namespace.
        exec_name: the name in front of its output.
        parameters: dicts, paths of parameter files, or single parameters.
        remappings: pairs of an old and a new name.
        arguments: arguments for the program itself.
        ros_arguments: arguments behind `--ros-args`.
    """

    def __init__(
        self,
        *,
        executable: Any = None,
        package: Any = None,
        name: Any = None,
        namespace: Any = None,
        exec_name: Any = None,
        parameters: Iterable[Any] | None = None,
        remappings: Iterable[tuple[Any, Any]] | None = None,
        ros_arguments: Iterable[Any] | None = None,
        arguments: Iterable[Any] | None = None,
        node_executable: Any = None,
        node_name: Any = None,
        node_namespace: Any = None,
        **kwargs: Any,
    ) -> None:
        # The last three names are those of old releases of ROS 2.
        executable = node_executable if executable is None else executable
        if executable is None:
            raise TypeError("Node() expected the argument 'executable'")
        super().__init__(cmd=[executable], name=exec_name, **kwargs)
        self._package = package
        self._executable = normalize_to_list_of_substitutions(executable)
        self._node_name = node_name if name is None else name
        self._node_namespace = node_namespace if namespace is None else namespace
        if isinstance(parameters, (str, dict)):
            raise TypeError(f"Node expected 'parameters' to be a list, got {type(parameters)}")
        self._parameters = list(parameters or ())
        pairs = remappings.items() if isinstance(remappings, dict) else remappings
        self._remappings = list(pairs or ())
        self._arguments = [arguments] if isinstance(arguments, str) else list(arguments or ())
        self._ros_arguments = list(ros_arguments or ())
        self._full_name: str | None = None

    @property
    def node_package(self) -> Any:
        """The package, before it is computed."""
        return self._package

    @property
    def node_executable(self) -> Any:
        """The executable, before it is computed."""
        return self._executable

    @property
    def node_name(self) -> str:
        """The node's full name; raises RuntimeError before the start."""
        if self._full_name is None:
            raise RuntimeError("cannot access 'node_name' before executing action")
        return self._full_name

    @property
    def expanded_node_namespace(self) -> str:
        """The node's namespace; raises RuntimeError before the start."""
        return self.node_name.rpartition("/")[0] or "/"

    def is_node_name_fully_specified(self) -> bool:
        """Return whether the launch file names the node."""
        return self._full_name is not None and _UNNAMED not in self._full_name

    def describe(self) -> str:
        """Describe the action."""
        return repr(self)

    def prepare_command(self, context: Any) -> PreparedCommand | None:
        """Return the program to start; None if taskrpc does not have it."""
        executable = perform(context, self._executable)
        words = [executable]
        shown = words
        if self._package is not None:
            package = perform(context, self._package)
            try:
                run = run_arguments(package, executable, hook.starts())
            except NotHere as reason:
                advice = "".join(f" ({note})" for note in getattr(reason, "__notes__", ()))
                said = f"{reason}, so it is not started; the other programs start"
                warn_once(context, said + advice)
                return None
            words = [sys.executable, "-m", "taskrpc", "run", *run]
            shown = ["taskrpc", "run", *run]
        arguments = self._node_arguments(context)
        file = executable.replace("\\", "/").rpartition("/")[2]
        return self.finished_command(context, file, [*words, *arguments], [*shown, *arguments])

    def environment_for(self, context: Any) -> dict[str, str] | None:
        """The environment; Python programs write each line at once."""
        found = super().environment_for(context)
        known = dict(context.environment) if found is None else found
        return {"PYTHONUNBUFFERED": "1", **known}

    def _node_arguments(self, context: Any) -> list[str]:
        name, namespace = self._names(context)
        self._full_name = f"{namespace.rstrip('/')}/{name or _UNNAMED}"
        rules = [f"__node:={name}"] if name else []
        rules += [f"__ns:={namespace}"] if namespace else []
        ros = [
            *texts_of(context, self._ros_arguments),
            *(word for rule in rules for word in ("-r", rule)),
            *global_arguments(context),
            *parameter_arguments(context, self._full_name if name else "", self._parameters),
            *remap_arguments(context, self._remappings),
        ]
        given = texts_of(context, self._arguments)
        return [*given, *(["--ros-args", *ros] if ros else [])]

    def _names(self, context: Any) -> tuple[str, str]:
        """The node's name and namespace, "" if it is the program's own; raises for invalid ones."""
        name = "" if self._node_name is None else perform(context, self._node_name)
        own = "" if self._node_namespace is None else perform(context, self._node_namespace)
        outer = context.launch_configurations.get(NAMESPACE, "")
        namespace = joined_namespace(outer, own)
        try:
            if name:
                validate_node_name(name)
            if namespace:
                validate_namespace(namespace)
        except (InvalidNodeNameException, InvalidNamespaceException) as error:
            problem = " ".join(str(error).split())
            raise RuntimeError(f"Node: {problem}") from None
        return name, namespace
